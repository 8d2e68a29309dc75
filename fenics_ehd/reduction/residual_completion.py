"""M4: a few dynamic modes, and the remaining bore flexibility as a quasi-static response.

A residual mode of M3 has a frequency of up to 700 kHz, so that its dynamics are negligible. M4 uses
the complete flexibility ``G_c = G J`` of the bores. The elastic coordinates q, with the basis T,
contain a part of it, and the residual flexibility S_res is the rest. With nodal pressures P, the
displacement of the bores is

    u_bore = Psi q + S_res w,   S_res = G_c - T K_r^-1 T^T J,   w + zeta dw/dt = P.

Psi are the rows of T at the bores, and K_r is the reduced stiffness. The damping matrix is the
stiffness times zeta, so that the pressures w, which act on S_res, lag behind P.

For all nodes of a part and any load f, the static response that a basis does not contain is

    (G - T K_r^-1 T^T) f.

The sum of this response and the displacement ``T q`` contains the full static response to the
loads. This is the mode acceleration method (T. Irvine, The mode acceleration method, 2014,
scribd.com/document/659487661). Loads on a free part are first brought into equilibrium with
inertia forces. The displacement is correct up to a rigid motion, which depends on the frame and
causes no stress.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fenics_ehd.base.errors import SettingsError, VerificationError
from fenics_ehd.base.renamed import renamed_arguments
from fenics_ehd.reduction.body import ReducedBody, ResidualFlexibility
from fenics_ehd.reduction.bore import all_outward
from fenics_ehd.reduction.family_responses import (
    FlexibilityForm,
    Responses,
    flexibility_form,
    largest_energy,
    relative_error,
)
from fenics_ehd.reduction.load_dependent_basis import dual_basis
from fenics_ehd.reduction.matrices import (
    MassOperator,
    blocks,
    combine,
    inner,
    load_columns,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.pressure_family import PressureFamily, edges_of, edges_text
from fenics_ehd.reduction.reductor import Basis, Reductor, StaticResponses
from fenics_ehd.reduction.static import StaticSolver, bore_rows, on_bores
from fenics_ehd.reduction.structure import Structure


def missing_response(
    static: StaticSolver,
    body: ReducedBody,
    columns: np.ndarray,
    loads: Callable[[slice], np.ndarray],
    count: int,
) -> np.ndarray:
    """Static response of a part minus that of its reduced body; collective.

    Parameters
    ----------
    static
        Static solver of the part.
    body
        Reduced body of the part.
    columns
        Basis T of the body, rows of this rank, shape (owned dofs, n).
    loads
        Function that returns the load columns of a range of column numbers, rows of this rank [N].
    count
        Number of loads.

    Returns
    -------
    numpy.ndarray
        Displacements that the basis does not contain, shape (owned dofs, count) [m].
    """
    comm = static.structure.comm
    fields = np.empty((len(columns), count))
    with static.work.progress.stage("static solves", count) as stage:
        for some in blocks(count, len(columns), comm):
            forces = loads(some)
            work = inner(columns, static.equilibrate(forces), comm)
            covered = combine(columns, np.linalg.solve(body.stiffness, work))
            fields[:, some] = static.solve(forces) - covered
            stage.to(some.stop)
    return fields


def centrifugal_load(structure: Structure, mass: MassOperator) -> np.ndarray:
    """Centrifugal load ``M (x, y, 0)`` of unit angular speed about z, shape (owned dofs, 1)."""
    radius = structure.coordinates.copy()
    radius[:, 2] = 0.0
    return mass.multiply(np.asfortranarray(radius.reshape(-1, 1)))


def missing_fields(
    structure: Structure,
    body: ReducedBody,
    columns: np.ndarray,
    forces: np.ndarray,
    speeds: np.ndarray,
) -> np.ndarray:
    """Static displacements that a basis does not contain, due to bore forces and to rotation.

    Forces on boundary points need no such displacement, because every basis contains the response
    to them. Two loads are neglected: the rigid inertia that balances these forces in the frame of
    M1 and M2, and the inertia of elastic motion.

    Parameters
    ----------
    structure, body, columns
        See `missing_response`.
    forces
        Forces on the nodes of all bores for each of c cases, shape (c, m, 3) [N].
    speeds
        Angular speed of the part about z for each case, shape (c,) [rad/s].

    Returns
    -------
    numpy.ndarray
        Displacements, rows of this rank, shape (owned dofs, c) [m].
    """
    static = StaticSolver(structure)
    turning = centrifugal_load(structure, static.mass)

    def loads(some: slice) -> np.ndarray:
        return on_bores(structure, np.moveaxis(forces[some], 0, 2)) + turning * speeds[some] ** 2

    return missing_response(static, body, columns, loads, len(speeds))


#: Largest relative difference at which two reductions count as those of the same part.
SAME_BASIS = 1e-6


def basis_of(body: ReducedBody, made: ReducedBody, columns: np.ndarray) -> np.ndarray:
    """Compute the basis T of a body that was stored without T, from a new reduction of the part.

    On another computer, modes may have other signs, and modes of equal frequency may be combined
    differently. The relation between the coordinates of both bodies follows from their
    displacements of bores and boundary points.

    Parameters
    ----------
    body
        Stored body.
    made
        Body of the new reduction.
    columns
        Basis of `made`, rows of this rank, shape (owned dofs, n).

    Raises
    ------
    VerificationError
        If the bodies are not reductions of the same part by the same method.
    """
    old = _displacements(body)
    new = _displacements(made)
    if old.shape != new.shape:
        raise VerificationError(
            f"the part reduced again has {made.modes} modes and {len(made.bore_basis)} bore nodes, "
            f"but the body of the run has {body.modes} and {len(body.bore_basis)}: was the model "
            "changed?"
        )
    size = np.abs(old).max(initial=0.0)
    if np.abs(new - old).max(initial=0.0) <= 1e-3 * SAME_BASIS * size:
        return columns
    scale = np.linalg.norm(new, axis=0)
    turn = np.linalg.lstsq(new / scale, old, rcond=None)[0] / scale[:, None]
    defects = [np.abs(new @ turn - old).max() / size]
    for matrix, stored in ((made.stiffness, body.stiffness), (made.mass, body.mass)):
        root = np.sqrt(np.diag(stored))
        defects.append(np.abs((turn.T @ matrix @ turn - stored) / np.outer(root, root)).max())
    if not max(defects) <= SAME_BASIS:
        raise VerificationError(
            f"the part reduced again differs from the body of the run by {max(defects):.1e}, above "
            f"{SAME_BASIS:.0e}: was the model changed?"
        )
    return columns @ turn


def _displacements(body: ReducedBody) -> np.ndarray:
    """Displacements of bore nodes and boundary points for unit coordinates, shape (rows, n)."""
    points = [field[:, 3:] for field in body.points.values()]
    return np.vstack([body.bore_basis.reshape(-1, body.modes), *points])


#: Largest error of the bore's displacement under the verification pressures, relative to it. The
#: base family has 2e-4 with 20 x 5 cells and 6e-4 with 40 x 10; see docs/reduction.md.
TOLERANCE = 2e-3


@renamed_arguments(truncation="tolerance")
def residual_flexibility(
    part: Structure | Reductor,
    n_vibration: int,
    *,
    tolerance: float = TOLERANCE,
    centrifugal: bool = True,
    estimate_error: bool = True,
    keep_basis: bool = False,
) -> ReducedBody:
    """M4: reduce a part to vibration and static modes, with a quasi-static residual flexibility.

    Parameters
    ----------
    part
        The part, free or clamped, or its `Reductor`.
    n_vibration
        Number of vibration modes.
    tolerance
        Limit of the relative error of the bores' displacement under the verification pressures. If
        the error is larger, the next level of the pressure family is used. With 0, every nodal
        pressure is used.
    centrifugal
        Whether the basis contains the static response to the centrifugal load of a part that
        rotates about z.
    estimate_error
        Whether to compute the mass matrix of the residual patterns, whose inertia the method
        neglects. No further static solves are needed.
    keep_basis
        See `load_dependent`.

    Returns
    -------
    ReducedBody
        Body with a `residual`. The verified error is in `accuracy`, the edges and the level of the
        pressure family are in `provenance`.

    Raises
    ------
    SettingsError
        If a number of modes is negative, if there is no mode at all, or if `tolerance` is outside
        [0, 1).
    SolverError, VerificationError
        If a solver or a check of the result fails.
    """
    reductor = Reductor.of(part)
    if not 0.0 <= tolerance < 1.0:
        raise SettingsError(f"flexibility_tolerance {tolerance:g} is not in [0, 1)")
    if not n_vibration + reductor.points.shape[1] + centrifugal:
        raise SettingsError(
            "vibration_modes is 0, and the part has no boundary point and no centrifugal mode: at "
            "least one mode is needed"
        )
    basis = reductor.once(
        "m4", (n_vibration, centrifugal), lambda: _basis(reductor, n_vibration, centrifugal)
    )
    remainder = Remainder(reductor, basis, keep_columns=estimate_error)
    level = reductor.family.last if tolerance == 0.0 else 0
    residual = remainder.residual(level)
    while (error := remainder.error(residual)) > tolerance and level < reductor.family.last:
        level += 1
        residual = remainder.residual(level)
    if estimate_error:
        residual = replace(residual, mass=remainder.inertia(level))
    body = reductor.project(basis, "m4", residual=residual, keep_basis=keep_basis)
    solved = remainder.responses.up_to(level).pressures.shape[1]
    figures = {"flexibility_error": error, "flexibility_columns": float(solved)}
    texts = {"pressure_level": str(level), "film_edges": edges_text(reductor.film_edges)}
    return replace(
        body,
        accuracy={**body.accuracy, **figures},
        provenance={**body.provenance, **texts},
    )


def _basis(reductor: Reductor, n_vibration: int, centrifugal: bool) -> Basis:
    """Basis of vibration modes and of static responses to forces on boundary points.

    With `centrifugal`, the basis also has the static response to rotation.
    """
    fields = reductor.points
    if centrifugal:
        fields = np.hstack([fields, centrifugal_load(reductor.structure, reductor.mass)])
    none = np.zeros((reductor.structure.pressures, 0))
    responses = StaticResponses(reductor.static, fields, none, *reductor.vibration(n_vibration))
    return dual_basis(responses, np.eye(responses.count), responses.count)


class Remainder:
    """Residual flexibility S_res of a part beyond a basis, from responses to a pressure family.

    Parameters
    ----------
    reductor
        Reductor of the part.
    basis
        Basis T of the reduction.
    keep_columns
        Whether part-size responses are kept; the method `inertia` needs them.

    Attributes
    ----------
    responses
        Static responses of the whole part to the pressure family.
    """

    def __init__(self, reductor: Reductor, basis: Basis, *, keep_columns: bool):
        self._reductor = reductor
        self._basis = basis
        self.responses = reductor.family_responses(keep_columns=keep_columns)
        structure = reductor.structure
        self._shape = bore_rows(structure, basis.columns)
        self._load = transpose_multiply(structure.load, basis.columns).T
        self._forms: dict[int, FlexibilityForm] = {}

    def _coordinates(self, pressures: np.ndarray) -> np.ndarray:
        """Coordinates of the static response to r pressures Q, ``K_r^-1 T^T J Q``, shape (n, r)."""
        return np.linalg.solve(self._basis.stiffness, self._load @ pressures)

    def _displacement(self, responses: Responses) -> np.ndarray:
        """Displacement of the bores' nodes that the basis does not contain, shape (m, 3, r) [m]."""
        return responses.displacement - self._shape @ self._coordinates(responses.pressures)

    def _form(self, level: int) -> FlexibilityForm:
        """Patterns of the residual flexibility, from all levels of the family up to `level`."""
        if level not in self._forms:
            responses = self.responses.up_to(level)
            pressures = responses.pressures
            work = responses.work - self._load.T @ self._coordinates(pressures)
            self._forms[level] = flexibility_form(pressures, work, largest_energy(responses))
        return self._forms[level]

    def residual(self, level: int) -> ResidualFlexibility:
        """Residual flexibility, from all levels of the family up to `level`, without masses."""
        form = self._form(level)
        displacement = self._displacement(self.responses.up_to(level)) @ form.combinations
        return ResidualFlexibility(displacement, form.patterns.T, form.stiffness, np.zeros((0, 0)))

    def error(self, residual: ResidualFlexibility) -> float:
        """Largest relative error of the bores' displacement under verification pressures."""
        bores = self._reductor.structure.bores
        verification = self.responses.verification
        approximate = residual.displacement @ (residual.patterns @ verification.pressures)
        errors = all_outward(bores, self._displacement(verification) - approximate)
        error = relative_error(errors, all_outward(bores, verification.displacement))
        return float(self._reductor.structure.comm.bcast(error))

    def inertia(self, level: int) -> np.ndarray:
        """Mass matrix of the n patterns from all levels up to `level`, (n, n) [kg m^2/Pa^2]."""
        responses = self.responses.up_to(level)
        modes = self._basis.columns
        coordinates = self._coordinates(responses.pressures)
        comm = self._reductor.structure.comm
        mass = np.zeros((responses.pressures.shape[1],) * 2)
        start = 0
        with self._reductor.work.progress.stage("masses of patterns", len(mass)) as stage:
            for columns in responses.columns:
                for part in blocks(columns.shape[1], len(columns), comm):
                    now = slice(start + part.start, start + part.stop)
                    fields = columns[:, part] - combine(modes, coordinates[:, now])
                    momentum = self._reductor.mass.multiply(np.asfortranarray(fields))
                    every = [inner(block, momentum, comm) for block in responses.columns]
                    covered = coordinates.T @ inner(modes, momentum, comm)
                    mass[:, now] = np.vstack(every) - covered
                    stage.to(now.stop)
                start += columns.shape[1]
        combinations = self._form(level).combinations
        return combinations.T @ symmetric(mass) @ combinations


def pattern_pressures(body: ReducedBody) -> np.ndarray:
    """Pressures whose residual displacements are those of the patterns, shape (k, r).

    These pressures are combinations ``Q (V^T Q)^+`` of the pressure family Q of the body, for its
    patterns V. If Q contains every nodal pressure, they are the patterns themselves.
    """
    assert body.residual is not None
    patterns = body.residual.patterns
    if "pressure_level" not in body.provenance:  # of version 0.3: every nodal pressure
        return patterns.T
    family = PressureFamily(body.bores, edges_of(body.provenance["film_edges"]))
    pressures = family.up_to(int(body.provenance["pressure_level"]))
    return np.asarray(pressures @ np.linalg.pinv(patterns @ pressures))


def pattern_fields(
    structure: Structure,
    body: ReducedBody,
    columns: np.ndarray,
    amplitudes: np.ndarray | None = None,
) -> np.ndarray:
    """Displacements of all nodes due to the residual patterns V; collective.

        (G_c - T K_r^-1 T^T J) V

    A body stores only the displacements of the bores, `ResidualFlexibility.displacement`. The
    complete fields are computed again, with one static solve per pattern or per combination of
    patterns.

    Parameters
    ----------
    structure
        Matrices and geometry of the part.
    body
        Body of the part reduced by M4.
    columns
        Basis T of the body, rows of this rank, shape (owned dofs, n).
    amplitudes
        Amplitudes of the patterns in c combinations, shape (r, c) [Pa]; None for each of the r
        patterns with unit amplitude.

    Returns
    -------
    numpy.ndarray
        Displacements, rows of this rank, shape (owned dofs, r) [m/Pa] or (owned dofs, c) [m];
        zeros if the body has no patterns.
    """
    residual = body.residual
    if residual is None:
        return np.zeros((len(columns), 0 if amplitudes is None else amplitudes.shape[1]))
    pressures = pattern_pressures(body)
    if amplitudes is not None:
        pressures = pressures @ amplitudes

    def loads(some: slice) -> np.ndarray:
        return load_columns(structure.load, pressures[:, some])

    return missing_response(StaticSolver(structure), body, columns, loads, pressures.shape[1])
