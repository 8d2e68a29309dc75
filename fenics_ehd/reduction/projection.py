"""Project a structure onto a basis: the last step of every reduction method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.errors import VerificationError
from fenics_ehd.reduction.body import ModeRecord, ReducedBody, ResidualFlexibility
from fenics_ehd.reduction.bore import all_outward
from fenics_ehd.reduction.distributed import (
    blocks,
    inner,
    multiply,
    node_rows,
    spread_rows,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.inertia import ELASTIC, InertiaIntegrals
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.rigid_motion import rigid_fields, turned
from fenics_ehd.reduction.structure import Structure

#: Largest defect of the reduced matrices from the form they must have, relative.
FORM_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Basis:
    """Part-size columns T of a reduction with what is known about them.

    Attributes
    ----------
    columns
        Owned rows, shape (owned dofs, n).
    stiffness, mass
        Reduced matrices, shape (n, n).
    kinds
        Kind of each column.
    dropped
        Modes left out.
    accuracy
        Figures of the method's own checks.
    """

    columns: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray
    kinds: tuple[str, ...]
    dropped: tuple[ModeRecord, ...]
    accuracy: Mapping[str, float]

    @property
    def frequencies(self) -> np.ndarray:
        """Natural frequency of each column taken alone [Hz]."""
        return np.sqrt(np.diag(self.stiffness) / np.diag(self.mass)) / (2 * np.pi)


@dataclass(frozen=True, eq=False)
class BoreFlexibility:
    """Static response of all bores to nodal pressures, ``G J`` of the whole part.

    Attributes
    ----------
    displacement
        Of the bore nodes, shape (m, 3, k) [m/Pa].
    energy
        ``J^T G J``, shape (k, k) [J/Pa^2].
    """

    displacement: np.ndarray
    energy: np.ndarray


def bore_rows(structure: Structure, columns: np.ndarray) -> np.ndarray:
    """Rows of the nodes of all bores of part-size columns, on every rank, shape (m, 3, n)."""
    return node_rows(columns, structure.node_range[0], structure.bore_nodes, structure.comm)


def on_bores(structure: Structure, values: np.ndarray) -> np.ndarray:
    """Owned rows (owned dofs, n) of fields that are zero but at the bores' nodes, (m, 3, n)."""
    first, last = structure.node_range
    return spread_rows(values, first, last - first, structure.bore_nodes)


def gram_matrices(
    structure: Structure, mass: MassOperator, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """``T^T K T`` and ``T^T M T``, on every rank."""
    n, comm = columns.shape[1], structure.comm
    reduced = np.empty((n, n)), np.empty((n, n))
    for part in blocks(n, len(columns), comm):
        own = columns[:, part]
        reduced[0][:, part] = inner(columns, multiply(structure.stiffness, own), comm)
        reduced[1][:, part] = inner(columns, mass.multiply(own), comm)
    return symmetric(reduced[0]), symmetric(reduced[1])


def require_small(defects: Mapping[str, float]) -> dict[str, float]:
    """The defects, all below `FORM_TOLERANCE`.

    Raises
    ------
    VerificationError
        One is not, by its name.
    """
    for name, value in defects.items():
        if not value <= FORM_TOLERANCE:
            raise VerificationError(
                f"the reduced basis fails its check: {name} {value:.1e} above {FORM_TOLERANCE:.0e}"
            )
    return {name: float(value) for name, value in defects.items()}


def require_positive(name: str, matrix: np.ndarray) -> None:
    """Raise unless a reduced matrix is positive definite.

    Raises
    ------
    VerificationError
        It is not, or holds what is no number.
    """
    scale = np.sqrt(np.abs(np.diag(matrix)))
    smallest = -np.inf
    if np.isfinite(matrix).all() and scale.all():
        smallest = np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min(initial=1.0)
    if not smallest > 0.0:
        raise VerificationError(
            f"the reduced {name} matrix is not positive definite: smallest eigenvalue "
            f"{smallest:.1e} with a diagonal of ones"
        )


def inertia_integrals(
    structure: Structure, mass: MassOperator, fields: np.ndarray
) -> InertiaIntegrals:
    """Inertia coupling of the given fields, owned rows (owned dofs, 3 + n)."""
    n, comm = fields.shape[1], structure.comm
    whole = [np.empty((n, n)) for _ in range(3)]
    spun = turned(fields, 2)
    for part in blocks(n, len(fields), comm):
        mass_fields = mass.multiply(fields[:, part])
        whole[0][:, part] = inner(fields, mass_fields, comm)
        whole[1][part] = inner(mass_fields, spun, comm)
        whole[2][:, part] = inner(spun, mass.multiply(spun[:, part]), comm)
    return InertiaIntegrals(
        mass=symmetric(whole[0]),
        spin=0.5 * (whole[1] - whole[1].T),
        centrifugal=symmetric(whole[2]),
    )


def attachment_rows(structure: Structure, fields: np.ndarray) -> dict[str, np.ndarray]:
    """Mean displacement of every boundary point for unit fields, shape (3, fields) each."""
    return {
        name: inner(np.column_stack([v.array for v in vectors]), fields, structure.comm)
        for name, vectors in structure.attachments.items()
    }


def project(
    structure: Structure,
    mass: MassOperator,
    basis: Basis,
    *,
    method: str,
    frame: str,
    residual: ResidualFlexibility | None = None,
    full_flexibility: BoreFlexibility | None = None,
    keep_basis: bool = False,
) -> ReducedBody:
    """Reduced body of a basis.

    Parameters
    ----------
    structure, mass
        The part and the products with its mass.
    basis
        T with its reduced matrices.
    method, frame, residual
        As in `ReducedBody`.
    full_flexibility
        Of the whole part, or None when no error estimate is wanted.
    keep_basis
        Leave the part-size columns in the body.
    """
    require_positive("stiffness", basis.stiffness)
    require_positive("mass", basis.mass)
    position = structure.coordinates.reshape(-1, 1)
    rigid = rigid_fields(structure.coordinates)
    fields = np.hstack([position, rigid[:, :2], basis.columns])
    load = structure.load
    mass_rigid = mass.multiply(rigid)
    body = ReducedBody(
        method=method,
        frame=frame,
        stiffness=basis.stiffness,
        mass=basis.mass,
        frequencies=basis.frequencies,
        kinds=basis.kinds,
        bores={name: bore.surface() for name, bore in structure.bores.items()},
        bore_basis=bore_rows(structure, basis.columns),
        load_projection=transpose_multiply(load, fields).T,
        spin_load_projection=transpose_multiply(load, turned(fields, 2)).T,
        inertia=inertia_integrals(structure, mass, fields),
        rigid_mass=symmetric(inner(rigid, mass_rigid, structure.comm)),
        rigid_coupling=inner(mass_rigid, basis.columns, structure.comm),
        rigid_load=transpose_multiply(load, rigid).T,
        points=attachment_rows(structure, fields),
        missing_flexibility=np.zeros((0, 0)),
        residual=residual,
        accuracy=basis.accuracy,
        provenance={"degrees_of_freedom": str(structure.size)},
        columns=basis.columns if keep_basis else None,
    )
    if full_flexibility is None:
        return replace(body, inventory=_inventory(body, basis.dropped, None))
    whole = all_outward(body.bores, full_flexibility.displacement)
    inventory = _inventory(body, basis.dropped, float(np.trace(full_flexibility.energy)))
    followed = sum(record.participation for record in inventory if not record.dropped)
    return replace(
        body,
        missing_flexibility=whole - body.basis_flexibility(),
        inventory=inventory,
        accuracy={**body.accuracy, "flexibility_followed": followed},
    )


def _inventory(
    body: ReducedBody, dropped: Sequence[ModeRecord], total: float | None
) -> tuple[ModeRecord, ...]:
    """Kept modes and dropped ones with their shares of `total`, or of the sum of all."""
    load = body.load_projection[ELASTIC]
    if body.frame != "clamped" and body.modes:
        load = load - body.rigid_coupling.T @ np.linalg.solve(body.rigid_mass, body.rigid_load)
    shares = np.einsum("ij,ij->i", load, np.linalg.solve(body.stiffness, load))
    kept = [
        ModeRecord(kind, float(frequency), float(share))
        for kind, frequency, share in zip(body.kinds, body.frequencies, shares, strict=True)
    ]
    if body.residual is not None:
        kept += [
            ModeRecord("quasi-static", np.inf, float(share)) for share in body.residual.stiffness
        ]
    records = [*kept, *dropped]
    if total is None:
        total = sum(record.participation for record in records)
    return tuple(replace(r, participation=r.participation / max(total, 1e-300)) for r in records)
