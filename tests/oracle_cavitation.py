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

import numpy as np
from scipy import sparse

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
    # Pivoting leaves round-off where an equation says p = 0.
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
