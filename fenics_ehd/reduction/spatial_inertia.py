"""Inertia coupling of a floating frame that moves in space, from the part's own mass matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.errors import StructureError
from fenics_ehd.reduction.distributed import blocks, inner, symmetric
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.rigid_motion import rigid_fields, turned
from fenics_ehd.reduction.structure import Structure

#: Largest difference of the inertia along x, y and z, relative to the inertia of the fields.
ISOTROPY_TOLERANCE = 1e-8

#: Position and unit translations stand before the elastic modes.
FIRST_MODE = 4


@dataclass(frozen=True, eq=False)
class SpatialInertia:
    """Inertia coupling of any motion in space, exact for the finite-element mass matrix.

    Fields F, in order: the position x (from the bore centre), the unit translations along x, y
    and z, the n elastic modes; ``S_c F`` is ``e_c x F`` node by node for the axis c. What
    `InertiaIntegrals` is for plane motion, which is the axis c = z of this.

    Attributes
    ----------
    mass
        ``F^T M F``, shape (4 + n, 4 + n).
    spin
        ``F^T M S_c F``, shape (3, 4 + n, 4 + n), antisymmetric for each c.
    centrifugal
        ``(S_c F)^T M (S_d F)``, shape (3, 3, 4 + n, 4 + n).
    """

    mass: np.ndarray
    spin: np.ndarray
    centrifugal: np.ndarray

    @property
    def modes(self) -> int:
        """Number of elastic modes n."""
        return len(self.mass) - FIRST_MODE

    @property
    def total_mass(self) -> float:
        """Mass of the part [kg]."""
        return float(self.mass[1, 1])

    @property
    def centre_of_mass(self) -> np.ndarray:
        """Centre of mass from the bore centre, shape (3,) [m]."""
        return self.mass[0, 1:FIRST_MODE] / self.total_mass

    @property
    def inertia_tensor(self) -> np.ndarray:
        """Inertia tensor about the bore centre, shape (3, 3) [kg m^2]."""
        return self.centrifugal[:, :, 0, 0]


def spatial_inertia(
    structure: Structure, mass: MassOperator, columns: np.ndarray
) -> SpatialInertia:
    """Inertia coupling of elastic modes with rotations about all three axes.

    Collective: four products with M for each field, a block of fields at a time.

    Parameters
    ----------
    structure, mass
        The part and the products with its mass.
    columns
        Part-size basis T, owned rows, shape (owned dofs, n): `ReducedBody.columns`, or
        `ReducedPart.columns`.

    Raises
    ------
    StructureError
        The columns are not of this part, or M is not the same along x, y and z: a part that
        turns would then have another mass matrix in every position.
    """
    rows = structure.stiffness.local_size[0]
    if columns.ndim != 2 or len(columns) != rows:
        raise StructureError(f"columns of shape {columns.shape} for a part of {rows} owned rows")
    position = structure.coordinates.reshape(-1, 1)
    fields = np.hstack([position, rigid_fields(structure.coordinates)[:, :3], columns])
    n, comm = fields.shape[1], structure.comm
    gram, spin, centrifugal = (np.empty((*axes, n, n)) for axes in ((), (3,), (3, 3)))
    for part in blocks(n, rows, comm):
        own = fields[:, part]
        gram[:, part] = inner(fields, mass.multiply(own), comm)
        for d in range(3):
            force = mass.multiply(turned(own, d))
            spin[d][:, part] = inner(fields, force, comm)
            for c in range(3):
                # S_c^T = -S_c: the fields need not be turned as well.
                centrifugal[c, d][:, part] = -inner(fields, turned(force, c), comm)
    _check_isotropic(gram, spin, centrifugal)
    return SpatialInertia(
        mass=symmetric(gram),
        spin=0.5 * (spin - spin.transpose(0, 2, 1)),
        centrifugal=0.5 * (centrifugal + centrifugal.transpose(1, 0, 3, 2)),
    )


def _check_isotropic(gram: np.ndarray, spin: np.ndarray, centrifugal: np.ndarray) -> None:
    """M must commute with rotations: ``S^T M = -M S`` and ``sum_c S_c^T M S_c = 2 M``."""
    size = np.sqrt(np.diag(gram))
    scale = np.maximum(np.outer(size, size), 1e-300)
    antisymmetry = np.abs(spin + spin.transpose(0, 2, 1)) / scale
    trace = np.abs(np.einsum("ccij->ij", centrifugal) - 2.0 * gram) / scale
    defect = max(antisymmetry.max(), trace.max())
    if not defect <= ISOTROPY_TOLERANCE:
        raise StructureError(
            f"mass is not the same along x, y and z: relative defect {defect:.1e}, limit "
            f"{ISOTROPY_TOLERANCE:.0e}; a part that turns in space needs that"
        )
