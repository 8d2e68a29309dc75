"""Discretisation error of the bores' flexibility, estimated with another mesh of the same part.

Both meshes are loaded with the same smooth pressures, which are products of waves around a bore
and Legendre polynomials along it, and with unit forces on the boundary points. The forces are
needed for pressures that are balanced by forces on the points rather than by inertia: without them,
the estimated error has a wrong shape for a rod with a heavy piston. For each mesh, one static solve
per load gives the displacement of the bores and the compliance ``C_ij``, which is the work of
pressure i on the displacement under load j. With n and n' degrees of freedom of the two meshes and
compliances C and C', the difference of the exact compliance from C is estimated as

    (C' - C) / (1 - (n / n')^(p / 3)),   p = 2.

Differences of displacements are estimated likewise. They are evaluated between the nodes of both
meshes too, because a thin film is more sensitive to shapes shorter than the cells than to smooth
ones. The order of errors is 1.09 at re-entrant edges (Williams' exponent is 0.5445 at a right
angle), and 4 for smooth solutions with quadratic cells. If the cells of the other mesh are two
thirds as large, the estimate is within a factor of 1.6 of the error, for both orders. With cells
1.5 times as large, it would be within a factor of 3. The other mesh is therefore finer, unless its
solution would take too long.

`mesh_verdict` accepts or rejects a mesh by this error and by its worst cell.

Imports inside functions: runs only read stored errors, and need no PETSc for this purpose.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ive

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import HEIGHTS, SMOOTH, WAVES, BoreSurface, all_outward

if TYPE_CHECKING:
    from fenics_ehd.reduction.static import StaticSolver

#: Order p of the error of the compliance in the cell size.
ORDER = 2.0

#: Cell size of a mesh over that of the finer mesh with which it is compared.
FINER = 1.5

#: Largest number of degrees of freedom of a mesh that is compared with a finer one. The finer mesh
#: has three times as many; its factorisation takes 1.2 s at 33 000, 29 s at 223 000.
MOST_REFINED = 60_000

#: Order of the interpolation error between the nodes of quadratic cells.
BETWEEN_NODES = 3.0

#: Smallest ratio of the larger to the smaller number of degrees of freedom of two compared meshes.
ANOTHER = 1.3


#: Largest mesh errors of good and of coarse meshes. The minimum film of a drawn rod differed by
#: 0.2 % from that on a finer mesh at an error of 1.8 %, by 1.9 % at 7 to 9 % (`docs/own-part.md`).
GOOD_ERROR = 0.02
COARSE_ERROR = 0.10

#: Smallest normalised corner volumes of good and of coarse meshes. Moved nodes that lowered the
#: worst cells of a drawn rod from 0.12 to 0.02 changed the flexibility of its bore by 0.1 %; at
#: 0.001, curved edges turned a cell inside out.
GOOD_CELL = 0.02
COARSE_CELL = 0.005

#: Largest ratio of the numbers of cells around a bore of two successive meshes: the mesh of the
#: larger number has ten times as many unknowns.
LARGEST_RATIO = 2.2


@dataclass(frozen=True)
class MeshVerdict:
    """Verdict on the mesh of a part.

    Attributes
    ----------
    word
        ``"good"``, ``"coarse"`` or ``"refuse"``; ``"not judged"`` if the mesh error is unknown and
        the worst cell is good.
    reason
        Mesh error and worst cell, with their limits.
    ratio
        Number of cells around a bore of the mesh to try next, over that of this mesh.
    next_error
        Mesh error that is expected of that mesh [-]; None if the error of this mesh is unknown.
    """

    word: str
    reason: str
    ratio: float
    next_error: float | None


def mesh_verdict(worst_cell: float, error: float | None) -> MeshVerdict:
    """Verdict on a mesh by its worst cell and by the estimated error of its bores' flexibility.

    Parameters
    ----------
    worst_cell
        Smallest normalised volume at a corner of a cell, see `fenics_ehd.fem.solid.corner_volumes`.
    error
        Relative mesh error of the bores' flexibility; None if it was not estimated.
    """
    words = ("good", "coarse", "refuse")
    of_cell = int(worst_cell < GOOD_CELL) + int(worst_cell < COARSE_CELL)
    cell = f"worst cell {worst_cell:.2g}, good from {GOOD_CELL:g}, refused below {COARSE_CELL:g}"
    if error is None:
        word = words[of_cell] if of_cell else "not judged"
        return MeshVerdict(word, f"mesh error not estimated; {cell}", FINER, None)
    of_error = int(error > GOOD_ERROR) + int(error > COARSE_ERROR)
    wanted = (error / GOOD_ERROR) ** (1.0 / ORDER) if of_error else FINER
    ratio = min(max(wanted, FINER), LARGEST_RATIO)
    reason = (
        f"mesh error {100 * error:.2g} %, good up to {100 * GOOD_ERROR:g} %, refused above "
        f"{100 * COARSE_ERROR:g} %; {cell}"
    )
    return MeshVerdict(words[max(of_cell, of_error)], reason, ratio, error / ratio**ORDER)


def smooth_fields(positions: np.ndarray, width: float) -> np.ndarray:
    """Values of the smooth functions of a bore at positions relative to its centre.

    Positions have the shape (k, 3) [m], values the shape (k, `SMOOTH`).
    """
    angle = np.arctan2(positions[:, 1], positions[:, 0])
    height = 2.0 * positions[:, 2] / width
    waves = [wave(k * angle) for k in range(WAVES + 1) for wave in (np.cos, np.sin)]
    del waves[1]  # sin 0
    along = np.polynomial.legendre.legvander(height, HEIGHTS - 1)
    return np.einsum("kh,wk->khw", along, waves).reshape(len(positions), -1)


def _summit() -> np.ndarray:
    """Amplitudes of the smooth functions that sum up to ``exp(4 cos phi - 4)``, shape (`SMOOTH`,).

    The amplitudes are values of modified Bessel functions at 4.
    """
    amplitudes = np.zeros(SMOOTH)
    amplitudes[0] = ive(0, 4)
    amplitudes[1 : 2 * WAVES : 2] = 2 * ive(np.arange(1, WAVES + 1), 4)
    return amplitudes


#: Amplitudes of each single smooth function, one per row.
_SINGLE = np.eye(SMOOTH)

#: Amplitudes of the pressures for which errors are reported: harmonics that bend a bore, and a
#: narrower peak.
PATTERNS = {
    "cos 2 phi": _SINGLE[3],
    "sin 2 phi": _SINGLE[4],
    "cos 3 phi": _SINGLE[5],
    "sin 3 phi": _SINGLE[6],
    "exp(4 cos phi)": _summit(),
}


class SmoothResponses(NamedTuple):
    """Static responses of a mesh to smooth pressures and to unit forces.

    The loads are s smooth pressures, `SMOOTH` in each bore, then forces along x and y on each of b
    boundary points, in the order of their names.

    Attributes
    ----------
    compliance
        Work of each smooth pressure (rows) on the displacement under each load (columns), shape
        (s, s + 2 b) [J/Pa^2], [J/(Pa N)].
    outward
        Outward displacement of the nodes of all bores (rows) under each load (columns), shape
        (m, s + 2 b) [m/Pa], [m/N].
    """

    compliance: np.ndarray
    outward: np.ndarray


def smooth_responses(solver: StaticSolver) -> SmoothResponses:
    """Compute the responses of a mesh to smooth pressures and unit forces; collective."""
    from fenics_ehd.reduction.matrices import inner, load_columns
    from fenics_ehd.reduction.static import bore_rows

    part = solver.structure
    bores = solver.structure.every_bore()
    pressures = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores]
    loads = load_columns(part.load, block_diag(*pressures))
    points = (part.attachments[name][:2] for name in sorted(part.attachments))
    forces = [force.array for point in points for force in point]
    with solver.work.progress.stage(f"{loads.shape[1] + len(forces)} static solves"):
        moved = solver.solve(np.column_stack([loads, *forces]))
    work = inner(solver.equilibrate(loads), moved, part.comm)
    return SmoothResponses(work, all_outward(part.bores, bore_rows(part, moved)))


def point_columns(points: Collection[str], wanted: Collection[str], smooth: int) -> list[int]:
    """Indices of the columns of `SmoothResponses` for all pressures and for some boundary points.

    Parameters
    ----------
    points, wanted
        Names of all boundary points, and names of the points whose columns are wanted.
    smooth
        Number of smooth pressures.

    Raises
    ------
    ValueError
        If a wanted point is not among the points.
    """
    known = sorted(points)
    first = [smooth + 2 * known.index(name) for name in sorted(wanted)]
    return [*range(smooth), *(column + k for column in first for k in (0, 1))]


def excess(size: int, other: int, order: float = ORDER) -> float:
    """Factor that extrapolates the difference between two meshes to the error of the first mesh.

    The factor is ``(exact - first) / (other - first)``, for values of both meshes.

    Parameters
    ----------
    size, other
        Numbers of degrees of freedom of the first mesh and of the other one.
    order
        Order of the error in the cell size.

    Raises
    ------
    StructureError
        If the ratio of the larger to the smaller size is not above `ANOTHER`.
    """
    if not max(size / other, other / size) > ANOTHER:
        raise StructureError(
            f"meshes of {size} and {other} unknowns are too similar to estimate an error: "
            f"the ratio must be above {ANOTHER:g}"
        )
    return 1.0 / (1.0 - (size / other) ** (order / 3.0))


def compliance_errors(missing: np.ndarray, compliance: np.ndarray) -> dict[str, float]:
    """Largest relative error of the compliance of a bore, for each pressure of `PATTERNS`.

    Parameters
    ----------
    missing
        Estimated exact compliance minus that of the mesh, shape (s, s) [J/Pa^2].
    compliance
        Compliance of the mesh, shape (s, s) [J/Pa^2].
    """
    parts = [slice(start, start + SMOOTH) for start in range(0, len(compliance), SMOOTH)]

    def error(c: np.ndarray, bore: slice) -> float:
        """Relative error of the compliance of one bore for amplitudes c of smooth pressures."""
        return float(abs(c @ missing[bore, bore] @ c) / (c @ compliance[bore, bore] @ c))

    return {name: max(error(c, bore) for bore in parts) for name, c in PATTERNS.items()}


def smooth_part(bores: Mapping[str, BoreSurface]) -> np.ndarray:
    """Matrix that fits smooth pressures to nodal pressures by least squares, shape (s, k).

    The amplitudes of the s smooth pressures are the product of the matrix and the k nodal pressures
    on all bores.
    """
    fields = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores.values()]
    return np.asarray(block_diag(*map(np.linalg.pinv, fields)))
