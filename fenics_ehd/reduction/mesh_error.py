"""Discretisation error of the bores' flexibility, by another mesh of the same part.

Both meshes are loaded with the same smooth pressures, waves around times Legendre polynomials
along every bore, and with unit forces on the boundary points, which hold against the pressure what
inertia does not: without them the bore of a rod with a heavy piston is said to lack another shape.
Of both each mesh has the compliance ``C_ij``, the work of pressure i on what load j displaces, and
the displacement of its bore. It needs a solve for each. With n and n' degrees of freedom the exact
part is estimated to have

    (C' - C) / (1 - (n / n')^(p / 3)),   p = 2,

more than the first mesh, and of displacements likewise: read between the nodes of both, as a thin
film feels what is shorter than their cells more than what is smooth. Re-entrant edges leave errors
of order 1.09 (Williams' exponent is 0.5445 at a right angle), smooth solutions of quadratic cells
order 4: from cells two thirds as large the estimate is within 1.6 of either. From larger cells it
would be within 3, which is why the other mesh is a finer one wherever that can be paid.
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

#: Order of the compliance's error, size of a mesh's cells over that of the other's, and largest
#: mesh that is compared with a finer one [degrees of freedom]: that has three times as many, the
#: factors of which take 1.2 s for 33 000, 29 s for 223 000.
ORDER = 2.0
FINER = 1.5
MOST_REFINED = 60_000

#: Order of what lies between the nodes of quadratic cells.
BETWEEN_NODES = 3.0

#: Least change of the number of degrees of freedom that tells one mesh from another.
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
    found = np.zeros(SMOOTH)
    found[0] = ive(0, 4)
    found[1 : 2 * WAVES : 2] = 2 * ive(np.arange(1, WAVES + 1), 4)
    return found


_SINGLE = np.eye(SMOOTH)

#: Pressures that errors are told of: the harmonics that bend a bore, and a sharper one.
PATTERNS = {
    "cos 2 phi": _SINGLE[3],
    "sin 2 phi": _SINGLE[4],
    "cos 3 phi": _SINGLE[5],
    "sin 3 phi": _SINGLE[6],
    "exp(4 cos phi)": _summit(),
}


class Answers(NamedTuple):
    """Responses to the smooth pressures in all s / `SMOOTH` bores, then to forces.

    These are along x and y on each of a boundary points, in the order of their names.

    Attributes
    ----------
    compliance
        C, shape (s, s + 2 a) [J/Pa^2], [J/(Pa N)].
    outward
        Displacement of all bores' nodes, shape (m, s + 2 a) [m/Pa], [m/N].
    """

    compliance: np.ndarray
    outward: np.ndarray


def smooth_answers(solver: StaticSolver) -> Answers:
    """Responses of a mesh to the smooth pressures and unit forces; collective."""
    # Runs read what was left of these, and solve nothing.
    from fenics_ehd.reduction.matrices import inner, load_columns
    from fenics_ehd.reduction.reductor import bore_rows

    part = solver.structure
    bores = solver.structure.every_bore()
    pressures = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores]
    loads = load_columns(part.load, block_diag(*pressures))
    points = (part.attachments[name][:2] for name in sorted(part.attachments))
    forces = [force.array for point in points for force in point]
    moved = solver.solve(np.column_stack([loads, *forces]))
    work = inner(solver.equilibrate(loads), moved, part.comm)
    return Answers(work, all_outward(part.bores, bore_rows(part, moved)))


def point_columns(points: Collection[str], wanted: Collection[str], smooth: int) -> list[int]:
    """Columns of `Answers` of some boundary points alone, behind the smooth pressures.

    Raises
    ------
    ValueError
        One is not among the points.
    """
    known = sorted(points)
    first = [smooth + 2 * known.index(name) for name in sorted(wanted)]
    return [*range(smooth), *(column + k for column in first for k in (0, 1))]


def excess(size: int, other: int, order: float = ORDER) -> float:
    """Excess of the exact part over a mesh, relative to that of another mesh, by their sizes.

    Parameters
    ----------
    size, other
        Degrees of freedom.
    order
        Of the error.

    Raises
    ------
    StructureError
        Their numbers of degrees of freedom are too much alike.
    """
    if not max(size / other, other / size) > ANOTHER:
        raise StructureError(f"meshes of {size} and {other} unknowns tell nothing of either")
    return 1.0 / (1.0 - (size / other) ** (order / 3.0))


def compliance_errors(missing: np.ndarray, own: np.ndarray) -> dict[str, float]:
    """Relative error of the work of each of `PATTERNS`, the largest of all bores."""
    starts = range(0, len(own), SMOOTH)
    blocks = [[m[i : i + SMOOTH, i : i + SMOOTH] for m in (missing, own)] for i in starts]
    return {
        name: max(float(abs(c @ lacks @ c) / (c @ has @ c)) for lacks, has in blocks)
        for name, c in PATTERNS.items()
    }


def smooth_part(bores: Mapping[str, BoreSurface]) -> np.ndarray:
    """Amplitudes of the smooth pressures in nodal ones on all bores, shape (s, k)."""
    found = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores.values()]
    return np.asarray(block_diag(*map(np.linalg.pinv, found)))
