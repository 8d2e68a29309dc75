"""Check of the matrices of a part from another program: order of nodes, units, mass.

A free part has no elastic forces in a rigid motion: ``K R = 0`` with the columns of R the unit
translations and rotations about the coordinates' origin. If coordinates and matrices have different
orders of nodes, translations remain without force, but not rotations. Forces in a translation are
those of a part that is held, or of damaged rows: the check cannot distinguish them. M gives mass
and centre by the same motions, ``R^T M R``.

Two estimates show units that do not belong together. The speed of elastic waves follows from the
mean stiffness and mass of a node and from the distance h to the nearest node,

    c = h sqrt(tr K / tr M),

and the mean density in the convex hull of the nodes from the mass. In SI units the first is 0.1 to
3 times sqrt(E / rho), by the shape and order of the cells, and the second is below the density.
Matrices in N, mm and t have the same ``tr K / tr M`` in 1/s^2 as in SI units: with coordinates in
mm, c is 1000 times too large; with coordinates in m, the density is 1000 times too small.

Imports inside functions: scipy.spatial is needed only for a check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import rigid_fields

#: Largest elastic force in a rigid motion, relative to the largest sum of absolute entries in a
#: row of K times the largest displacement. Text files with 10 digits have 1e-10, with a wrong
#: order of nodes it is above 1e-2.
RIGID_LIMIT = 1e-6

#: Largest difference between the masses along x, y and z, relative to the largest. Files with 7
#: digits have 1e-7.
SAME_MASS = 1e-5

#: Largest difference between a matrix and its transpose, relative to its largest entry.
SYMMETRY_LIMIT = 1e-6

#: Elastic forces in rigid motions above which too few digits of K make verified reductions of a
#: free part fail: with 12 digits they are 1e-13, with 10 digits 1e-11.
DIGITS_LIMIT = 1e-12

#: Estimated speeds of elastic waves that are usual [m/s]. Solids have 300 (soft plastics), 5000
#: (steel) to 12 000 (ceramics); the estimate is 0.1 times as much on a shaft of long cells, and 3
#: times on quadratic cells.
SPEEDS = (400.0, 40e3)

#: Densities in the convex hull of a part [kg/m^3]: from a thin frame of magnesium to tungsten.
DENSITIES = (30.0, 20e3)


@dataclass(frozen=True)
class MatrixCheck(Described):
    """Mass, centre, elastic defects and estimates from a part's K and M; printed as lines of text.

    Attributes
    ----------
    nodes
        Number of nodes.
    mass
        Mass of the part, mean of the three directions [kg].
    centre
        Centre of mass, shape (3,) [m].
    translation_defect, rotation_defect
        Largest elastic force in a translation and in a rotation, relative to the terms that cancel.
    wave_speed
        Estimated speed of elastic waves [m/s].
    density
        Mass over the volume of the nodes' convex hull [kg/m^3].
    """

    nodes: int
    mass: float
    centre: tuple[float, float, float]
    translation_defect: float
    rotation_defect: float
    wave_speed: float
    density: float

    @property
    def held(self) -> bool:
        """Whether the part is held, so that translations have elastic forces."""
        return self.translation_defect > RIGID_LIMIT

    @property
    def notices(self) -> list[str]:
        """Lines about a part that is not free, about few digits, and about mixed units."""
        lines = []
        if self.held:
            lines.append(
                f"translations have elastic forces of {self.translation_defect:.1e} of their "
                "terms: the part is held, or rows of K are damaged, missing or in another order"
            )
        elif max(self.translation_defect, self.rotation_defect) > DIGITS_LIMIT:
            lines.append(
                f"rigid motions have elastic forces above {DIGITS_LIMIT:.0e} of their terms, too "
                "much for a verified reduction: write K and M with 16 digits or in binary form"
            )
        if not SPEEDS[0] <= self.wave_speed <= SPEEDS[1]:
            lines.append(
                f"elastic waves of {self.wave_speed:.3g} m/s are outside "
                f"{SPEEDS[0]:g} to {SPEEDS[1]:g}: give coordinates in m, K in N/m, M in kg"
            )
        elif not DENSITIES[0] <= self.density <= DENSITIES[1]:
            lines.append(
                f"a mean density of {self.density:.3g} kg/m^3 is outside "
                f"{DENSITIES[0]:g} to {DENSITIES[1]:g}: of matrices in N, mm and t, "
                "multiply K and M by 1000"
            )
        return lines

    def __str__(self) -> str:
        x, y, z = self.centre
        state = "held" if self.held else "free"
        lines = [
            f"{self.nodes} nodes, {state}; mass {self.mass:.6g} kg, "
            f"centre ({x:.6g}, {y:.6g}, {z:.6g}) m",
            f"elastic forces in translations {self.translation_defect:.1e}, in rotations "
            f"{self.rotation_defect:.1e} of their terms",
            f"elastic waves {self.wave_speed:.0f} m/s, density in the convex hull "
            f"{self.density:.0f} kg/m^3",
        ]
        return "\n".join([*lines, *(f"notice: {line}" for line in self.notices)])


def check_matrices(
    stiffness: sparse.spmatrix, mass: sparse.spmatrix, coordinates: ArrayLike
) -> MatrixCheck:
    """Check the order of the nodes of K and M against their coordinates; report units and mass.

    Parameters
    ----------
    stiffness, mass
        K [N/m] and M [kg] as SciPy matrices, degrees of freedom ``3 * node + component``.
    coordinates
        Positions of the nodes, shape (n, 3) [m].

    Returns
    -------
    MatrixCheck
        Mass, centre, defects and estimates; its `notices` are lines about units.

    Raises
    ------
    StructureError
        If the numbers of nodes differ; if a matrix is not finite, not symmetric or has no positive
        diagonal; if the masses along x, y and z differ; or if a rotation of a free part has elastic
        forces: the matrices then have another order of nodes or directions than the coordinates.
    """
    try:
        points = np.asarray(coordinates, dtype=float)
    except (TypeError, ValueError):
        raise StructureError(f"coordinates = {coordinates!r:.60} are no numbers") from None
    if not np.isfinite(points).all() or points.ndim != 2:
        raise StructureError("coordinates must be finite numbers of shape (nodes, 3)")
    size = 3 * len(points)
    for name, matrix in (("stiffness", stiffness), ("mass", mass)):
        if points.ndim != 2 or points.shape[1:] != (3,) or matrix.shape != (size, size):
            raise StructureError(
                f"the {name} matrix has shape {matrix.shape}, but coordinates of shape "
                f"{points.shape} need 3 rows for each node"
            )
    _require_usable("stiffness", stiffness.tocsr())
    _require_usable("mass", mass.tocsr())
    motions = rigid_fields(points - points.mean(axis=0))
    defects = _defects(stiffness.tocsr(), motions)
    gram = motions[:, :3].T @ (mass @ motions[:, :3])
    masses = np.diag(gram)
    if not masses.min() > 0 or np.ptp(masses) > SAME_MASS * masses.max():
        raise StructureError(
            f"the masses along x, y and z are {masses[0]:.6g}, {masses[1]:.6g}, {masses[2]:.6g}, "
            "but must be equal and above 0: entries of M are missing or damaged"
        )
    total = float(masses.mean())
    moments = mass @ points.reshape(-1, 1)
    centre = (motions[:, :3].T @ moments).ravel() / total
    check = MatrixCheck(
        nodes=len(points),
        mass=total,
        centre=(float(centre[0]), float(centre[1]), float(centre[2])),
        translation_defect=float(defects[:3].max()),
        rotation_defect=float(defects[3:].max()),
        wave_speed=_spacing(points) * float(np.sqrt(stiffness.trace() / mass.trace())),
        density=total / _hull_volume(points),
    )
    if not check.held and check.rotation_defect > RIGID_LIMIT:
        raise StructureError(
            f"a rotation of the part has elastic forces of {check.rotation_defect:.1e} of their "
            f"terms, above {RIGID_LIMIT:.0e}: coordinates and rows of K are not in the same order "
            "of nodes, or of x, y, z"
        )
    return check


def _require_usable(name: str, matrix: sparse.csr_matrix) -> None:
    """Refuse a matrix that is not that of an elastic part in any order of its nodes.

    Raises
    ------
    StructureError
        If a number is not finite, if the sum of the diagonal is not above 0, or if the matrix is
        not symmetric.
    """
    if not np.isfinite(matrix.data).all():
        raise StructureError(f"the {name} matrix has a number that is not finite")
    if not matrix.diagonal().sum() > 0:
        raise StructureError(
            f"the sum of the diagonal of the {name} matrix is {matrix.diagonal().sum():.3g}, "
            "but must be above 0"
        )
    defect = abs(matrix - matrix.T).max() / abs(matrix).max()
    if defect > SYMMETRY_LIMIT:
        raise StructureError(
            f"the {name} matrix differs from its transpose by {defect:.1e} of its largest entry, "
            f"above {SYMMETRY_LIMIT:.0e}"
        )


def _defects(stiffness: sparse.csr_matrix, motions: np.ndarray) -> np.ndarray:
    """Largest elastic force of each motion, relative to the terms that cancel in it."""
    terms = abs(stiffness) @ np.abs(motions)
    return np.abs(stiffness @ motions).max(axis=0) / terms.max(axis=0)


def _spacing(points: np.ndarray) -> float:
    """Mean distance of a node to the nearest other node [m]."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, k=2)
    return float(distances[:, 1].mean())


def _hull_volume(points: np.ndarray) -> float:
    """Volume of the convex hull of nodes [m^3].

    Raises
    ------
    StructureError
        If all nodes are in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        raise StructureError(f"the {len(points)} nodes of the part are in one plane") from None
