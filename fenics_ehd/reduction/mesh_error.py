"""Discretisation error of the bores' flexibility, estimated with another mesh of the same part.

Both meshes are loaded with the same smooth pressures, waves around times Legendre polynomials
along every bore, and with unit forces on the boundary points, which balance pressures that inertia
does not: without them the estimated shape of the error is wrong for a rod with a heavy piston. Each
mesh has the compliance ``C_ij``, the work of pressure i on the displacement under load j, and the
displacement of its bore; it needs a solve for each load. With n and n' degrees of freedom the
excess of the exact compliance over that of the first mesh is estimated as

    (C' - C) / (1 - (n / n')^(p / 3)),   p = 2,

and that of displacements likewise. These are evaluated between the nodes of both meshes, too: a
thin film responds to shapes shorter than their cells more than to smooth ones. Re-entrant edges
have errors of order 1.09 (Williams' exponent is 0.5445 at a right angle), smooth solutions with
quadratic cells of order 4. With cells two thirds as large the estimate is within a factor of 1.6 of
either; with larger cells it would be within 3, hence the other mesh is a finer one if affordable.

Imports inside functions: runs only read stored errors, and need no PETSc for this purpose.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ive

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import HEIGHTS, SMOOTH, WAVES, BoreSurface, all_outward

if TYPE_CHECKING:
    from fenics_ehd.reduction.static import StaticSolver

#: Order of the error of the compliance.
ORDER = 2.0

#: Ratio of the cell sizes of a mesh and of the finer one.
FINER = 1.5

#: Largest mesh that is compared with a finer one [degrees of freedom]. The finer one has three
#: times as many; its factorisation takes 1.2 s for 33 000, 29 s for 223 000.
MOST_REFINED = 60_000

#: Order of the interpolation error between the nodes of quadratic cells.
BETWEEN_NODES = 3.0

#: Smallest ratio of the numbers of degrees of freedom of two meshes that can be compared.
ANOTHER = 1.3


def smooth_fields(positions: np.ndarray, width: float) -> np.ndarray:
    """Smooth functions at positions from a bore's centre, shape (k, 3), as (k, `SMOOTH`)."""
    angle = np.arctan2(positions[:, 1], positions[:, 0])
    height = 2.0 * positions[:, 2] / width
    waves = [wave(k * angle) for k in range(WAVES + 1) for wave in (np.cos, np.sin)]
    del waves[1]  # sin 0
    along = np.polynomial.legendre.legvander(height, HEIGHTS - 1)
    return np.einsum("kh,wk->khw", along, waves).reshape(len(positions), -1)


def _summit() -> np.ndarray:
    """Waves of ``exp(4 cos phi - 4)``, which are modified Bessel functions of 4."""
    amplitudes = np.zeros(SMOOTH)
    amplitudes[0] = ive(0, 4)
    amplitudes[1 : 2 * WAVES : 2] = 2 * ive(np.arange(1, WAVES + 1), 4)
    return amplitudes


_SINGLE = np.eye(SMOOTH)

#: Pressures whose errors are reported: the harmonics that bend a bore, and a sharper one.
PATTERNS = {
    "cos 2 phi": _SINGLE[3],
    "sin 2 phi": _SINGLE[4],
    "cos 3 phi": _SINGLE[5],
    "sin 3 phi": _SINGLE[6],
    "exp(4 cos phi)": _summit(),
}


class SmoothResponses(NamedTuple):
    """Responses to the smooth pressures in all s / `SMOOTH` bores, then to unit forces.

    The forces are along x and y on each of a boundary points, in the order of their names.

    Attributes
    ----------
    compliance
        C, shape (s, s + 2 a) [J/Pa^2], [J/(Pa N)].
    outward
        Displacement of all bores' nodes, shape (m, s + 2 a) [m/Pa], [m/N].
    """

    compliance: np.ndarray
    outward: np.ndarray


def smooth_responses(solver: StaticSolver) -> SmoothResponses:
    """Responses of a mesh to the smooth pressures and unit forces; collective."""
    from fenics_ehd.reduction.matrices import inner, load_columns
    from fenics_ehd.reduction.structure import bore_rows

    part = solver.structure
    bores = solver.structure.every_bore()
    pressures = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores]
    loads = load_columns(part.load, block_diag(*pressures))
    points = (part.attachments[name][:2] for name in sorted(part.attachments))
    forces = [force.array for point in points for force in point]
    moved = solver.solve(np.column_stack([loads, *forces]))
    work = inner(solver.equilibrate(loads), moved, part.comm)
    return SmoothResponses(work, all_outward(part.bores, bore_rows(part, moved)))


def point_columns(points: Collection[str], wanted: Collection[str], smooth: int) -> list[int]:
    """Columns of `SmoothResponses` of the smooth pressures and of some boundary points.

    Raises
    ------
    ValueError
        One of `wanted` is not among the points.
    """
    known = sorted(points)
    first = [smooth + 2 * known.index(name) for name in sorted(wanted)]
    return [*range(smooth), *(column + k for column in first for k in (0, 1))]


def excess(size: int, other: int, order: float = ORDER) -> float:
    """Excess of the exact part over a mesh, divided by that of another mesh over it.

    Parameters
    ----------
    size, other
        Degrees of freedom of the mesh and of the other one.
    order
        Order of the error.

    Raises
    ------
    StructureError
        The sizes are too similar.
    """
    if not max(size / other, other / size) > ANOTHER:
        raise StructureError(
            f"meshes of {size} and {other} unknowns are too similar to estimate an error: their "
            f"ratio must be above {ANOTHER:g}"
        )
    return 1.0 / (1.0 - (size / other) ** (order / 3.0))


def compliance_errors(missing: np.ndarray, compliance: np.ndarray) -> dict[str, float]:
    """Relative error of the work of each of `PATTERNS`, the largest of all bores.

    Parameters
    ----------
    missing, compliance
        Excess of the exact compliance, and the compliance of the mesh, shape (s, s).
    """
    parts = [slice(start, start + SMOOTH) for start in range(0, len(compliance), SMOOTH)]

    def error(c: np.ndarray, bore: slice) -> float:
        return float(abs(c @ missing[bore, bore] @ c) / (c @ compliance[bore, bore] @ c))

    return {name: max(error(c, bore) for bore in parts) for name, c in PATTERNS.items()}


def smooth_part(bores: Mapping[str, BoreSurface]) -> np.ndarray:
    """Amplitudes of the smooth pressures in nodal ones on all bores, shape (s, k)."""
    fields = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores.values()]
    return np.asarray(block_diag(*map(np.linalg.pinv, fields)))
