"""What a part's mesh misses of its bores' flexibility, by another mesh of the same part.

Both meshes are loaded with the same smooth pressures, waves around times Legendre polynomials
along every bore, of which each mesh has the compliance ``C_ij``, the work of pressure i on what
pressure j displaces. It needs a solve for each, and nothing is read from one mesh onto the other.
With n and n' degrees of freedom the exact part is estimated to have

    (C' - C) / (1 - (n / n')^(p / 3)),   p = 2,

more than the first mesh. Re-entrant edges leave errors of order 1.09 (Williams' exponent is 0.5445
at a right angle), smooth solutions of quadratic cells order 4: from cells two thirds as large the
estimate is within 1.6 of either. From larger cells it would be within 3, which is why the other
mesh is a finer one wherever that can be paid.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import block_diag

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import BoreSurface
from fenics_ehd.reduction.distributed import inner, load_columns
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


def compliance(solver: StaticSolver) -> np.ndarray:
    """``C``, of all bores one after the other, shape (bores x SMOOTH,) * 2 [J/Pa^2]; collective."""
    bores = solver.structure.every_bore()
    pressures = [smooth_fields(bore.pressure_coordinates, bore.width) for bore in bores]
    loads = solver.equilibrate(load_columns(solver.structure.load, block_diag(*pressures)))
    found = inner(loads, solver.solve(loads), solver.structure.comm)
    return 0.5 * (found + found.T)


def missing_compliance(
    own: np.ndarray, size: int, other: np.ndarray, other_size: int
) -> np.ndarray:
    """What the exact part is estimated to have more than the `compliance` of a mesh.

    Parameters
    ----------
    own, size
        Of a mesh, and its number of degrees of freedom.
    other, other_size
        Of another one of the same part.

    Raises
    ------
    StructureError
        Their numbers of degrees of freedom are too much alike.
    """
    if not max(size / other_size, other_size / size) > ANOTHER:
        raise StructureError(f"meshes of {size} and {other_size} unknowns tell nothing of either")
    return (other - own) / (1.0 - (size / other_size) ** (ORDER / 3.0))


def compliance_errors(missing: np.ndarray, own: np.ndarray) -> dict[str, float]:
    """Relative error of the work of each of `PATTERNS`, the largest of all bores."""
    starts = range(0, len(own), SMOOTH)
    blocks = [[m[i : i + SMOOTH, i : i + SMOOTH] for m in (missing, own)] for i in starts]
    return {
        name: max(float(abs(c @ lacks @ c) / (c @ has @ c)) for lacks, has in blocks)
        for name, c in PATTERNS.items()
    }


def missing_outward(missing: np.ndarray, bores: Mapping[str, BoreSurface]) -> np.ndarray:
    """Outward displacement of bores' nodes per nodal pressure by a `missing_compliance`.

    Returns
    -------
    numpy.ndarray
        At the nodes of all bores, shape (m, k) [m/Pa].
    """
    shapes, fits = [], []
    for bore in bores.values():
        area = np.full((HEIGHTS, 2 * WAVES + 1), np.pi * bore.radius * bore.width)
        area[:, 0] *= 2.0
        area /= 2.0 * np.arange(HEIGHTS)[:, None] + 1.0
        shapes.append(smooth_fields(bore.coordinates, bore.width) / area.ravel())
        fits.append(np.linalg.pinv(smooth_fields(bore.pressure_coordinates, bore.width)))
    return np.asarray(block_diag(*shapes) @ missing @ block_diag(*fits))
