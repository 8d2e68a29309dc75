"""Steps that all reductions share: static responses, and the projection of a part onto a basis.

For several reductions of one part, a `Reductor` computes static responses once. The module also has
the simplest reduction: a rigid part with inertia and bores, without elastic coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import VerificationError
from fenics_ehd.base.progress import SILENT, Progress
from fenics_ehd.reduction.body import (
    ELASTIC,
    InertiaIntegrals,
    ModeRecord,
    ReducedBody,
    ResidualFlexibility,
)
from fenics_ehd.reduction.bore import rigid_fields, turned
from fenics_ehd.reduction.eigenmodes import LowestModes
from fenics_ehd.reduction.family_responses import (
    FamilyResponses,
    Responses,
    missing_flexibility,
)
from fenics_ehd.reduction.matrices import (
    MassOperator,
    blocks,
    combine,
    inner,
    load_columns,
    multiply,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.matrix_check import absolute
from fenics_ehd.reduction.pressure_family import PressureFamily
from fenics_ehd.reduction.static import StaticSolver, Work, bore_rows, room_for_columns
from fenics_ehd.reduction.structure import Structure, check_structure

#: Largest relative deviation of reduced matrices from the form that a method requires.
FORM_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Basis:
    """Basis of a reduction with its reduced matrices and the results of checks.

    Attributes
    ----------
    columns
        Basis T, rows of this rank, shape (owned dofs, n).
    stiffness, mass
        Reduced matrices ``T^T K T`` and ``T^T M T``, shape (n, n).
    kinds
        Kind of each column, see `ReducedBody`.
    dropped
        Records of the modes that were dropped.
    accuracy
        Accuracy figures from the checks of the method, by name.
    """

    columns: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray
    kinds: tuple[str, ...]
    dropped: tuple[ModeRecord, ...]
    accuracy: Mapping[str, float]


def product(
    left: np.ndarray,
    operator: Callable[[np.ndarray], np.ndarray],
    right: np.ndarray,
    comm: MPI.Comm,
) -> np.ndarray:
    """Product ``left^T A right`` of columns with an operator A, the same on every rank.

    The product is computed block by block, so that ``A right`` is never stored completely.
    """
    parts = blocks(right.shape[1], len(right), comm)
    products = [inner(left, operator(right[:, part]), comm) for part in parts]
    return np.hstack([np.zeros((left.shape[1], 0)), *products])


def gram_matrices(
    solver: StaticSolver | Reductor, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Reduced matrices ``T^T K T`` and ``T^T M T`` of columns T, the same on every rank."""
    comm = solver.structure.comm
    stiffness = product(columns, solver.elastic_forces, columns, comm)
    mass_matrix = product(columns, solver.mass.multiply, columns, comm)
    return symmetric(stiffness), symmetric(mass_matrix)


def require_small(defects: Mapping[str, float]) -> dict[str, float]:
    """Check that defects of a basis do not exceed `FORM_TOLERANCE`; return the defects by name.

    Raises
    ------
    VerificationError
        If a defect exceeds the tolerance; the message names the defect.
    """
    for name, value in defects.items():
        if not value <= FORM_TOLERANCE:
            raise VerificationError(
                f"the reduced basis fails its check: {name} {value:.1e} above {FORM_TOLERANCE:.0e}"
            )
    return {name: float(value) for name, value in defects.items()}


def inertia_integrals(
    structure: Structure, mass: MassOperator, fields: np.ndarray
) -> InertiaIntegrals:
    """Compute the inertia integrals of fields, rows of this rank, shape (owned dofs, 3 + n)."""
    spun = turned(fields, 2)
    comm = structure.comm
    spin = product(spun, mass.multiply, fields, comm).T
    return InertiaIntegrals(
        mass=symmetric(product(fields, mass.multiply, fields, comm)),
        spin=0.5 * (spin - spin.T),
        centrifugal=symmetric(product(spun, mass.multiply, spun, comm)),
    )


def _inventory(
    body: ReducedBody, dropped: Sequence[ModeRecord], measure: np.ndarray, total: float | None
) -> tuple[ModeRecord, ...]:
    """Records of all modes, kept and dropped, with their shares in the flexibility of the bores.

    Parameters
    ----------
    body, dropped
        Body with the kept modes, and records of the dropped modes.
    measure
        Orthonormal pressures over which flexibility is measured, shape (k, r).
    total
        Flexibility of the part, the trace over `measure`. None: sum of the flexibilities of all
        records.
    """
    load = body.load_projection[ELASTIC] @ measure
    if body.frame != "clamped" and body.modes:
        rigid_load = body.rigid_load @ measure
        load = load - body.rigid_coupling.T @ np.linalg.solve(body.rigid_mass, rigid_load)
    shares = np.einsum("ij,ij->i", load, np.linalg.solve(body.stiffness, load))
    kept = [
        ModeRecord(kind, float(frequency), float(share))
        for kind, frequency, share in zip(body.kinds, body.frequencies, shares, strict=True)
    ]
    if body.residual is not None:
        within = np.sum((body.residual.patterns @ measure) ** 2, axis=1)
        energies = body.residual.stiffness * within
        kept += [ModeRecord("quasi-static", np.inf, float(share)) for share in energies]
    records = [*kept, *dropped]
    if total is None:
        total = sum(record.participation for record in records)
    return tuple(replace(r, participation=r.participation / max(total, 1e-300)) for r in records)


class StaticResponses:
    """Static responses ``X = G L`` of (29), from which the share of known modes is subtracted (30).

    The columns of the loads L are f fields of nodal forces, then p pressure patterns (33).

    Parameters
    ----------
    solver
        Static solver of the part.
    fields
        Nodal forces, rows of this rank, shape (owned dofs, f) [N].
    pressures
        Pressure patterns ``P_c``, the same on every rank, shape (k, p) [Pa].
    angular, modes
        Angular frequencies [rad/s] and shapes of the modes whose share is subtracted. The modes are
        mass-normalised and uncoupled in stiffness.

    Attributes
    ----------
    count
        Number f + p of responses.
    stiffness
        Work of every load on every response, ``L^T X = X^T K X``, shape (count, count).
    nodal_work
        Work of unit nodal pressures on every response, ``J^T X``, shape (k, count).
    columns
        Responses X, rows of this rank, shape (owned dofs, count).
    """

    def __init__(
        self,
        solver: StaticSolver,
        fields: np.ndarray,
        pressures: np.ndarray,
        angular: np.ndarray,
        modes: np.ndarray,
    ):
        self.solver = solver
        self._fields = fields
        self._pressures = pressures
        self.angular = angular
        self.modes = modes
        comm = solver.structure.comm
        load = solver.structure.load
        a = fields.shape[1]
        self.count = a + pressures.shape[1]
        covered = self.work(modes).T / angular[:, None] ** 2
        stiffness = np.empty((self.count, self.count))
        works = [np.zeros((load.size[1], 0))]
        self.columns = room_for_columns(len(modes), self.count, comm)
        with solver.work.progress.stage("static solves", self.count) as stage:
            for part in blocks(self.count, len(modes), comm):
                patterns = pressures[:, max(part.start - a, 0) : max(part.stop - a, 0)]
                loads = np.hstack([fields[:, part], load_columns(load, patterns)])
                responses = solver.solve(np.asfortranarray(loads))
                responses -= combine(modes, covered[:, part])
                works.append(transpose_multiply(load, responses))
                stiffness[:, part] = self.work(responses, works[-1])
                self.columns[:, part] = responses
                stage.to(part.stop)
        self.stiffness = symmetric(stiffness)
        self.nodal_work = np.hstack(works)

    def work(self, columns: np.ndarray, nodal: np.ndarray | None = None) -> np.ndarray:
        """Work ``L^T @ columns`` of the loads on w displacements `columns`, shape (count, w).

        `nodal` is the work ``J^T @ columns`` of unit nodal pressures, or None if it is unknown.
        """
        structure = self.solver.structure
        if nodal is None:
            nodal = transpose_multiply(structure.load, columns)
        return np.vstack([inner(self._fields, columns, structure.comm), self._pressures.T @ nodal])

    @cached_property
    def mass(self) -> np.ndarray:
        """Reduced mass matrix ``X^T M X`` of the responses, shape (count, count); collective."""
        mass = np.zeros((self.count,) * 2)
        comm = self.solver.structure.comm
        with self.solver.work.progress.stage("masses of responses", self.count) as stage:
            for part in blocks(self.count, len(self.columns), comm):
                inertia = self.solver.mass.multiply(self.columns[:, part])
                above = slice(part.stop)
                mass[above, part] = inner(self.columns[:, above], inertia, comm)
                stage.to(part.stop)
        return np.triu(mass) + np.triu(mass, 1).T


T = TypeVar("T")


class Reductor(Described):
    """A part together with intermediate results that its reductions share.

    Reductions accept it in place of the part:

        part = Reductor(structure)
        bodies = [craig_bampton(part, 37), load_dependent(part, 6, 31), full_interface(part)]

    Every result is computed once, at its first use: factors of the stiffness matrix and, for M2, of
    its interior; the flexibility of the bores; modes; the first step of M2; the basis of M4. Modes
    are computed again only if more modes are requested than before; request the largest number
    first. Static responses to pressure sets are large. Only the responses to the last set are kept,
    for consecutive reductions with the same set.

    Parameters
    ----------
    structure
        Matrices and geometry of the part, free or clamped.
    attachment_directions
        Directions (0, 1, 2 for x, y, z) of the unit forces at every boundary point, which are
        also the directions of its boundary dofs in M1 and M2.
    solver
        ``"direct"``, ``"iterative"``, or ``"auto"`` to choose by the number of dofs.
    options_prefix
        Text that is put before the prefixes ``static_``, ``modes_`` and ``interior_`` of the
        PETSc options.
    film_edges
        Heights of the films' edges in a bore, measured from its middle, by the name of the bore
        [m], see `PressureFamily`.
    every_pressure
        Whether errors of M1 to M3 are estimated from the responses to every nodal pressure, with
        one static solve each, instead of from those to the base family.
    progress
        Progress in which solvers open their stages.

    Attributes
    ----------
    work
        Counts of factorisations and solves since the last body.

    Raises
    ------
    StructureError
        If `check_structure` refuses the part.
    """

    def __init__(
        self,
        structure: Structure,
        *,
        attachment_directions: tuple[int, ...] = (0, 1),
        solver: str = "auto",
        options_prefix: str = "",
        film_edges: Mapping[str, Sequence[float]] | None = None,
        every_pressure: bool = False,
        progress: Progress = SILENT,
    ):
        require_class("structure", structure, Structure)
        self._motions = check_structure(structure)
        self.structure = structure
        self.solver = solver
        self.options_prefix = options_prefix
        self.film_edges = film_edges or {}
        self._every_pressure = every_pressure
        self.work = Work(progress=progress)
        self._family_responses: FamilyResponses | None = None
        self._directions = attachment_directions
        self._kept: dict[str, tuple[Hashable, Any]] = {}

    @staticmethod
    def of(part: Structure | Reductor) -> Reductor:
        """Return a reductor unchanged, or make one with default options for a structure."""
        require_class("part", part, Structure, Reductor)
        return Reductor(part) if isinstance(part, Structure) else part

    @cached_property
    def mass(self) -> MassOperator:
        """Operator that multiplies columns by the mass matrix M of the part."""
        return MassOperator(self.structure.mass)

    @property
    def free(self) -> bool:
        """Whether the part has no supports."""
        return self._motions.free

    def elastic_forces(self, columns: np.ndarray) -> np.ndarray:
        """Elastic forces as `StaticSolver.elastic_forces`; only a rounded K is factorised."""
        if self.free and self._motions.rounding is not None:
            return self.static.elastic_forces(columns)
        return multiply(self.structure.stiffness, columns)

    def stiffness_rounding(self, columns: np.ndarray) -> dict[str, float]:
        """Largest relative error of strain energies of columns t that rounding of K can cause.

        The error is ``u |t|^T |K| |t| / (t^T K t)``, with the relative error u of the values of K
        and t without its rigid motion; its name is ``stiffness_rounding``. It is a bound: errors of
        many values cancel, and it is 10 to 500 times the error of a rod. The result is empty if
        rigid motions show no rounding.
        """
        rounding = self._motions.rounding
        if rounding is None or not columns.shape[1]:
            return {}
        comm = self.structure.comm
        magnitudes = absolute(self.structure.stiffness)
        columns = self.static.admissible(columns)
        sizes = np.abs(columns)
        terms, energies = (
            comm.allreduce(np.sum(one * multiply(matrix, one), axis=0))
            for matrix, one in ((magnitudes, sizes), (self.structure.stiffness, columns))
        )
        magnitudes.destroy()
        return {"stiffness_rounding": float(rounding.unit * np.max(terms / energies))}

    @cached_property
    def static(self) -> StaticSolver:
        """Static solver of the part, which factorises the stiffness matrix once."""
        prefix = f"{self.options_prefix}static_"
        return StaticSolver(
            self.structure,
            mass=self.mass,
            motions=self._motions,
            solver=self.solver,
            options_prefix=prefix,
            work=self.work,
        )

    @cached_property
    def vibration(self) -> LowestModes:
        """Vibration modes of the part, free or clamped, as a function of the number of modes."""
        return LowestModes(self.static, f"{self.options_prefix}modes_")

    @cached_property
    def points(self) -> np.ndarray:
        """Nodal forces equivalent to n_a unit forces on boundary points, (owned dofs, n_a)."""
        points = self.structure.attachments.values()
        vectors = [point[d].array for point in points for d in self._directions]
        return np.column_stack(vectors or [np.zeros((self.structure.stiffness.local_size[0], 0))])

    @cached_property
    def family(self) -> PressureFamily:
        """Family of film pressures with which the flexibility of the bores is computed."""
        return PressureFamily(self.structure.bores, self.film_edges)

    @property
    def measure(self) -> np.ndarray:
        """Orthonormal pressures over which traces of flexibilities are computed, (k, r) [Pa]."""
        known = self._family_responses
        if known is not None and not self._every_pressure:
            return known.up_to(0).pressures
        every = np.eye(self.structure.pressures)
        return every if self._every_pressure else self.structure.comm.bcast(self.family.base)

    def family_responses(self, *, keep_columns: bool = False) -> FamilyResponses:
        """Static responses of the part to its pressure family; collective.

        Parameters
        ----------
        keep_columns
            Whether the part-size responses are kept.
        """
        known = self._family_responses
        if known is None or (keep_columns and not known.keeps_columns):
            known = FamilyResponses(self.static, self.family, keep_columns=keep_columns)
            self._family_responses = known
        return known

    def measured_responses(self) -> Responses:
        """Static responses of the part to the pressures of `measure`; collective."""
        level = self.family.last if self._every_pressure else 0
        return self.family_responses().up_to(level)

    def forget(self) -> None:
        """Free factors and all intermediate results; they are computed again if needed."""
        for name in ("static", "vibration"):
            self.__dict__.pop(name, None)
        self._family_responses = None
        self._kept.clear()

    def once(self, name: str, key: Hashable, make: Callable[[], T]) -> T:
        """Return the stored result `name` for `key`, or compute it by `make` and store it.

        For each name, only the result for the last key is stored.
        """
        if name not in self._kept or self._kept[name][0] != key:
            self._kept.pop(name, None)
            self._kept[name] = key, make()
        return self._kept[name][1]

    def project(
        self,
        basis: Basis,
        method: str,
        *,
        frame: str = "mean-axis",
        residual: ResidualFlexibility | None = None,
        estimate_error: bool = True,
        keep_basis: bool = False,
    ) -> ReducedBody:
        """Make the reduced body from a basis, by projection of all matrices of the part.

        For the parameters see `ReducedBody` and `load_dependent`. For a clamped part, `frame`
        is not used.
        """
        structure = self.structure
        mass = self.mass
        comm = self.structure.comm
        rigid = rigid_fields(structure.coordinates)
        fields = np.hstack([structure.coordinates.reshape(-1, 1), rigid[:, :2], basis.columns])
        load = structure.load
        mass_rigid = mass.multiply(rigid)
        angular = np.sqrt(np.diag(basis.stiffness) / np.diag(basis.mass))
        body = ReducedBody(
            method=method,
            frame=frame if self.free else "clamped",
            stiffness=basis.stiffness,
            mass=basis.mass,
            frequencies=angular / (2 * np.pi),
            kinds=basis.kinds,
            bores={name: bore.surface() for name, bore in structure.bores.items()},
            bore_basis=bore_rows(structure, basis.columns),
            load_projection=transpose_multiply(load, fields).T,
            spin_load_projection=transpose_multiply(load, turned(fields, 2)).T,
            inertia=inertia_integrals(structure, mass, fields),
            rigid_mass=symmetric(inner(rigid, mass_rigid, comm)),
            rigid_coupling=inner(mass_rigid, basis.columns, comm),
            rigid_load=transpose_multiply(load, rigid).T,
            points={
                name: inner(np.column_stack([v.array for v in three]), fields, comm)
                for name, three in structure.attachments.items()
            },
            missing_flexibility=np.zeros((0, 0)),
            residual=residual,
            accuracy={**basis.accuracy, **self.stiffness_rounding(basis.columns)},
            columns=basis.columns if keep_basis else None,
        )
        if not estimate_error:
            inventory = _inventory(body, basis.dropped, self.measure, None)
            return replace(body, inventory=inventory, provenance=self._provenance())
        responses = self.measured_responses()
        total = float(np.sum(responses.pressures * responses.work))
        inventory = _inventory(body, basis.dropped, responses.pressures, total)
        followed = sum(record.participation for record in inventory if not record.dropped)
        body = replace(
            body,
            inventory=inventory,
            accuracy={**body.accuracy, "flexibility_followed": followed},
            provenance=self._provenance(),
        )
        if residual is not None:
            return body
        return replace(body, missing_flexibility=missing_flexibility(responses, body))

    def _provenance(self) -> dict[str, str]:
        """Provenance of a body: size of the part, and counts of solves since the last body."""
        return {"degrees_of_freedom": str(self.structure.size), **self.work.take()}


# Without modes


def rigid(
    part: Structure | Reductor,
    *,
    estimate_error: bool = False,
    keep_basis: bool = False,
) -> ReducedBody:
    """Reduce a part to a rigid body without elastic coordinates.

    Parameters
    ----------
    part
        The part, free or clamped, or its `Reductor`.
    estimate_error
        Whether to compute the neglected flexibility of the bores. This needs a factorisation and
        one static solve per pressure of the family.
    keep_basis
        Whether to store the basis, which has no columns, in the body.
    """
    reductor = Reductor.of(part)
    nothing = np.zeros((0, 0))
    columns = np.zeros((reductor.structure.stiffness.local_size[0], 0))
    return reductor.project(
        Basis(columns, nothing, nothing, (), (), {}),
        "rigid",
        estimate_error=estimate_error,
        keep_basis=keep_basis,
    )
