"""The cavitation problem without fenics_ehd: every active set tried, and finite volumes.

``0 <= p`` complementary to ``A p - b >= 0``. The finite volumes are the 5-point
scheme on a uniform grid of an unwrapped rigid bearing, whose gap ``H`` depends on
the circumference x alone: the matrix is then a sum of two Kronecker products.
Lengths in radii, gap in clearances; divided by ``6 eta omega (R / c)^2`` the pressure
solves ``-div(H^3 grad p) = -dH/dx`` where it is positive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

#: Block exchanges without fewer wrong signs before single pivots, and most pivots or sweeps.
PATIENCE, MOST_PIVOTS, MOST_SWEEPS = 10, 1000, 50_000

#: Active sets are tried all at once: 2^14 systems of 14 equations take 26 MB.
LARGEST_ENUMERATION = 14


def enumerate_active_sets(matrix: np.ndarray, rhs: np.ndarray) -> np.ndarray:
    """Pressure (n,) of the active set whose worst sign is the least wrong.

    Solves with every one of the ``2^n`` principal blocks of ``matrix`` (n, n), the
    equations of the other nodes replaced by ``p = 0``.
    """
    n = len(rhs)
    if n > LARGEST_ENUMERATION:
        raise ValueError(f"{n} nodes, no more than {LARGEST_ENUMERATION} can be enumerated")
    film = (np.arange(2**n)[:, None] >> np.arange(n)) % 2 == 1
    systems = np.where(film[:, :, None], matrix, np.eye(n))
    pressures = np.linalg.solve(systems, np.where(film, rhs, 0.0)[:, :, None])[:, :, 0]
    fluxes = pressures @ matrix.T - rhs
    # The side that should vanish does so to round-off: only the other one can have a wrong sign.
    signs = np.where(film, pressures * np.diag(matrix), fluxes)
    best = signs.min(axis=1).argmax()
    # Pivoting leaves round-off where an equation is p = 0.
    return np.where(film[best], np.maximum(pressures[best], 0.0), 0.0)


@dataclass(frozen=True, eq=False)
class FiniteVolumes:
    """5-point scheme of one bearing.

    Attributes
    ----------
    matrix, rhs
        ``A`` (n, n) and ``b`` (n,) on the free nodes, x slow, z fast.
    x
        Circumferential position of the free nodes, shape (n,).
    area
        Area of a cell.
    """

    matrix: sparse.csr_matrix
    rhs: np.ndarray
    x: np.ndarray
    area: float


def _second_difference(conductance: np.ndarray, periodic: bool) -> sparse.csr_matrix:
    """``-d(c du/dx)`` from the conductances of the faces: (n,) when periodic, else (n + 1,)."""
    if not periodic:
        inner = conductance[1:-1]
        return sparse.diags(
            [-inner, conductance[:-1] + conductance[1:], -inner], [-1, 0, 1], format="csr"
        )
    # Face i lies between node i and the one before it.
    node = np.arange(len(conductance))
    before = sparse.csr_matrix((conductance, (node, np.roll(node, 1))))
    return (sparse.diags(conductance + np.roll(conductance, -1)) - before - before.T).tocsr()


def finite_volumes(
    gap: Callable[[np.ndarray], np.ndarray], width: float, cells: tuple[int, int], periodic: bool
) -> FiniteVolumes:
    """Assemble the scheme on ``(0, 2 pi) x (0, width)``.

    Parameters
    ----------
    gap
        ``H`` at positions x.
    width
        In radii; the pressure is zero at both sides.
    cells
        Intervals along x and z.
    periodic
        In x; otherwise the pressure is zero at both ends.
    """
    dx, dz = 2 * np.pi / cells[0], width / cells[1]
    nodes = np.arange(0 if periodic else 1, cells[0]) * dx
    faces = gap(nodes - dx / 2) if periodic else gap(np.append(nodes, nodes[-1] + dx) - dx / 2)
    after = np.roll(faces, -1) if periodic else faces[1:]
    before = faces if periodic else faces[:-1]
    rows = cells[1] - 1
    around = _second_difference(faces**3 / dx, periodic)
    along = _second_difference(np.full(cells[1], 1 / dz), periodic=False)
    matrix = sparse.kron(around, dz * sparse.identity(rows)) + sparse.kron(
        sparse.diags(gap(nodes) ** 3 * dx), along
    )
    rhs = np.repeat((before - after) * dz, rows)
    return FiniteVolumes(matrix.tocsr(), rhs, np.repeat(nodes, rows), dx * dz)


def journal_load(volumes: FiniteVolumes, pressure: np.ndarray) -> complex:
    """Load along the line of centres and across it, over ``6 eta omega (R / c)^2 R L``, L = 2 R.

    As a complex number: modulus the load, argument the attitude angle. The gap is
    ``1 + e cos x``, the largest at x = 0.
    """
    return -0.5 * volumes.area * np.sum(pressure * np.exp(-1j * volumes.x))


def block_pivot(matrix: sparse.csr_matrix, rhs: np.ndarray) -> np.ndarray:
    """Pressure (n,) by exchange of whole zones, made finite by single pivots.

    Each pivot solves on the nodes taken as full film and exchanges those with a wrong sign.
    Where that cycles, one node at a time changes place until fewer signs are wrong: Murty's rule,
    with the safeguard of Judice and Pires (Computers & Operations Research 21, 1994).
    """
    film, fewest, trials = np.ones(len(rhs), dtype=bool), len(rhs) + 1, PATIENCE
    for _ in range(MOST_PIVOTS):
        pressure = np.zeros(len(rhs))
        if film.any():
            pressure[film] = spsolve(matrix[film][:, film].tocsc(), rhs[film])
        flux = matrix @ pressure - rhs
        lowest = -1e-13 * np.abs(pressure).max(), -1e-13 * np.abs(flux).max()
        wrong = np.flatnonzero(np.where(film, pressure < lowest[0], flux < lowest[1]))
        if not len(wrong):
            return np.maximum(pressure, 0.0)
        if len(wrong) < fewest:
            fewest, trials = len(wrong), PATIENCE
        else:
            trials -= 1
            wrong = wrong if trials >= 0 else wrong[-1:]
        film[wrong] = ~film[wrong]
    raise ArithmeticError("no active set found")


def coloured(matrix: sparse.csr_matrix) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in the order of their colours, and where each colour begins: none are coupled."""
    indptr, indices = matrix.indptr.tolist(), matrix.indices.tolist()
    colours = [-1] * matrix.shape[0]
    for node in range(matrix.shape[0]):
        taken = {colours[k] for k in indices[indptr[node] : indptr[node + 1]]}
        colours[node] = next(free for free in range(len(taken) + 1) if free not in taken)
    return np.argsort(colours, kind="stable"), np.cumsum([0, *np.bincount(colours)])


def relaxation_factor(matrix: sparse.csr_matrix) -> float:
    """Young's best factor, ``2 / (1 + sqrt(1 - rho^2))``.

    ``rho`` is the spectral radius of Jacobi's iteration, 1 less the smallest eigenvalue of
    ``D^-1 A``.
    """
    root = 1 / np.sqrt(matrix.diagonal())
    scaled = root[:, None] * matrix.toarray() * root
    smallest = min(float(np.linalg.eigvalsh(scaled)[0]), 1.0)
    return 2 / (1 + np.sqrt(smallest * (2 - smallest)))


def projected_sor(matrix: sparse.csr_matrix, rhs: np.ndarray, tolerance: float) -> np.ndarray:
    """Pressure (n,) by over-relaxation, projected on ``p >= 0``, one colour of nodes at a time."""
    order, starts = coloured(matrix)
    permuted, b = matrix[order][:, order], rhs[order]
    step = relaxation_factor(matrix) / permuted.diagonal()
    zones = [(slice(*ends), permuted[slice(*ends)]) for ends in pairwise(starts)]
    p = np.zeros(len(b))
    for sweep in range(MOST_SWEEPS):
        for zone, rows in zones:
            p[zone] = np.maximum(p[zone] + step[zone] * (b[zone] - rows @ p), 0.0)
        if sweep % 20 == 0 and complementarity_residual(permuted, b, p) <= tolerance:
            pressure = np.empty_like(p)
            pressure[order] = p
            return pressure
    raise ArithmeticError("relaxation does not end")


def complementarity_residual(
    matrix: sparse.csr_matrix, rhs: np.ndarray, pressure: np.ndarray
) -> float:
    """``|min(D p, A p - b)| / |b|`` in the 2-norm, D the diagonal of A: zero at a solution."""
    defect = np.minimum(matrix.diagonal() * pressure, matrix @ pressure - rhs)
    smallest = np.finfo(float).tiny  # without a source no pressure is the exact solution
    return float(np.linalg.norm(defect) / max(np.linalg.norm(rhs), smallest))
