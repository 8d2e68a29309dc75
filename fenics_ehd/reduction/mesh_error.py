"""What a part's mesh misses of its bores' flexibility, by another mesh of the same part.

Both meshes are loaded with the same smooth pressures, waves around times Legendre polynomials
along every bore, of which each mesh has the compliance ``C_ij``, the work of pressure i on what
pressure j displaces, and the displacement of its bore. It needs a solve for each. With n and n'
degrees of freedom the exact part is estimated to have

    (C' - C) / (1 - (n / n')^(p / 3)),   p = 2,

more than the first mesh, and of displacements likewise: read at the nodes of the first, as a thin
film feels what is as short as its cells more than what is smooth. Re-entrant edges leave errors of
order 1.09 (Williams' exponent is 0.5445 at a right angle), smooth solutions of quadratic cells
order 4: from cells two thirds as large the estimate is within 1.6 of either. From larger cells it
would be within 3, which is why the other mesh is a finer one wherever that can be paid.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import BoreSurface, all_outward
from fenics_ehd.reduction.distributed import inner, load_columns
from fenics_ehd.reduction.projection import bore_rows
from fenics_ehd.reduction.static import StaticSolver

#: Waves around a bore and Legendre polynomials along it; their products are the smooth pressures.
WAVES, HEIGHTS = 6, 3
SMOOTH = (2 * WAVES + 1) * HEIGHTS

#: Order of the compliance's error, size of a mesh's cells over that of the other's, and largest
#: mesh that is compared with a finer one [degrees of freedom]: that has three times as many, the
#: factors of which take 1.2 s for 33 000, 29 s for 223 000.
ORDER, FINER, MOST_REFINED = 2.0, 1.5, 60_000

#: Least change of the number of degrees of freedom that tells one mesh from another.
ANOTHER = 1.3


def smooth_fields(positions: np.ndarray, width: float) -> np.ndarray:
    """Smooth functions at positions from a bore's centre, shape (k, 3), as (k, `SMOOTH`)."""
    angle, height = np.arctan2(positions[:, 1], positions[:, 0]), 2.0 * positions[:, 2] / width
    waves = [wave(k * angle) for k in range(WAVES + 1) for wave in (np.cos, np.sin)]
    del waves[1]  # sin 0
    along = np.polynomial.legendre.legvander(height, HEIGHTS - 1)
    return np.einsum("kh,wk->khw", along, waves).reshape(len(positions), -1)


def _single(number: int) -> np.ndarray:
    return np.eye(SMOOTH)[number]


def _summit() -> np.ndarray:
    angle = 2 * np.pi * np.arange(64) / 64
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(64)])
    around = smooth_fields(circle, 1.0)[:, : 2 * WAVES + 1]
    found = np.linalg.lstsq(around, np.exp(4 * np.cos(angle) - 4), rcond=None)[0]
    return np.append(found, np.zeros(SMOOTH - len(found)))


#: Pressures that errors are told of: the harmonics that bend a bore, and a sharper one.
PATTERNS = {
    "cos 2 phi": _single(3),
    "sin 2 phi": _single(4),
    "cos 3 phi": _single(5),
    "sin 3 phi": _single(6),
    "exp(4 cos phi)": _summit(),
}


class Answers(NamedTuple):
    """To the smooth pressures in all s / `SMOOTH` bores, one after the other.

    Attributes
    ----------
    compliance
        C, shape (s, s) [J/Pa^2].
    outward
        Displacement of all bores' nodes, shape (m, s) [m/Pa].
    """

    compliance: np.ndarray
    outward: np.ndarray


def smooth_answers(solver: StaticSolver) -> Answers:
    """Of a mesh; collective."""
    part, bores = solver.structure, solver.structure.every_bore()
    pressures = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores]
    loads = solver.equilibrate(load_columns(part.load, block_diag(*pressures)))
    moved = solver.solve(loads)
    found = inner(loads, moved, part.comm)
    return Answers(0.5 * (found + found.T), all_outward(part.bores, bore_rows(part, moved)))


def excess(size: int, other: int) -> float:
    """What the exact part has more than a mesh, over what another mesh has, by their sizes.

    Raises
    ------
    StructureError
        Their numbers of degrees of freedom are too much alike.
    """
    if not max(size / other, other / size) > ANOTHER:
        raise StructureError(f"meshes of {size} and {other} unknowns tell nothing of either")
    return 1.0 / (1.0 - (size / other) ** (ORDER / 3.0))


def compliance_errors(missing: np.ndarray, own: np.ndarray) -> dict[str, float]:
    """Relative error of the work of each of `PATTERNS`, the largest of all bores."""
    starts = range(0, len(own), SMOOTH)
    blocks = [[m[i : i + SMOOTH, i : i + SMOOTH] for m in (missing, own)] for i in starts]
    return {
        name: max(float(abs(c @ lacks @ c) / (c @ has @ c)) for lacks, has in blocks)
        for name, c in PATTERNS.items()
    }


def outward_of(missing: np.ndarray, bores: Mapping[str, BoreSurface]) -> np.ndarray:
    """Outward displacement of bores' nodes, as `Answers` have it, that goes with a compliance."""
    shapes = []
    for bore in bores.values():
        area = np.full((HEIGHTS, 2 * WAVES + 1), np.pi * bore.radius * bore.width)
        area[:, 0] *= 2.0
        area /= 2.0 * np.arange(HEIGHTS)[:, None] + 1.0
        shapes.append(smooth_fields(bore.coordinates, bore.width) / area.ravel())
    return np.asarray(block_diag(*shapes) @ missing)


def smooth_part(bores: Mapping[str, BoreSurface]) -> np.ndarray:
    """Amplitudes of the smooth pressures in nodal ones on all bores, shape (s, k)."""
    found = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores.values()]
    return np.asarray(block_diag(*map(np.linalg.pinv, found)))
