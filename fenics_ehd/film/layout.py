"""Recognise the film mesh that a set of bore nodes belongs to."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.base.errors import InterfaceMismatchError
from fenics_ehd.film.grid import FilmGrid, uniform_grid

#: Largest distance between a film node and the bore node it belongs to, relative to the radius.
MATCH_TOLERANCE = 1e-6


def _positions(values: np.ndarray, tolerance: float) -> int:
    """Number of distinct values."""
    ordered = np.sort(values)
    return 1 + int(np.sum(np.diff(ordered) > tolerance))


def film_layout(nodes: np.ndarray) -> tuple[tuple[int, int], str]:
    """Cells and element family of nodes on a bore.

    Parameters
    ----------
    nodes
        Positions of all bore nodes of a quadratic mesh, shape (m, 3) [m].

    Returns
    -------
    cells : tuple of int
        Cells along the circumference and along the axis.
    family : str
        ``"serendipity"`` (8-node) or ``"lagrange"`` (9-node).

    Raises
    ------
    InterfaceMismatchError
        The nodes are not those of a structured quadratic mesh.
    """
    angle = np.mod(np.arctan2(nodes[:, 1], nodes[:, 0]) + 1e-6, 2 * np.pi)
    around = _positions(angle, 1e-5) // 2
    radius = np.linalg.norm(nodes[:, :2], axis=1).mean()
    along = (_positions(nodes[:, 2], 1e-5 * radius) - 1) // 2
    full = 2 * around * (2 * along + 1)
    counts = {full: "lagrange", full - around * along: "serendipity"}
    if around < 2 or along < 1 or len(nodes) not in counts:
        raise InterfaceMismatchError(
            f"{len(nodes)} bore nodes are not those of a structured quadratic mesh "
            f"({around} x {along} cells would have {' or '.join(map(str, sorted(counts)))})"
        )
    return (around, along), counts[len(nodes)]


def film_grid(nodes: np.ndarray) -> FilmGrid:
    """Film mesh with the cells and the family of a structured set of bore nodes.

    Raises
    ------
    InterfaceMismatchError
        The nodes are not those of a structured quadratic mesh of equal cells.
    """
    cells, family = film_layout(nodes)
    radius = float(np.linalg.norm(nodes[:, :2], axis=1).mean())
    angle = np.mod(np.arctan2(nodes[:, 1], nodes[:, 0]), 2 * np.pi / cells[0])
    # Corner columns lie at whole multiples of the cell from here, mid columns half way.
    first = nodes[:, 2] <= nodes[:, 2].min() + MATCH_TOLERANCE * radius
    half = angle[first] % (np.pi / cells[0])
    starts = half[np.unique(np.round(half, 6), return_index=True)[1]]
    for start in (0.0, *starts, *(starts + np.pi / cells[0])):
        grid = uniform_grid(radius, float(np.ptp(nodes[:, 2])), cells, family, start=start)
        if match(grid.nodes, nodes) is not None:
            return grid
    raise InterfaceMismatchError(
        f"{len(nodes)} bore nodes are not those of {cells[0]} x {cells[1]} equal cells (largest "
        f"distance {cKDTree(nodes).query(grid.nodes)[0].max():.2e} m): give the film cells of its "
        f"own, cells = [{cells[0]}, {cells[1]}] say"
    )


def match(own: np.ndarray, given: np.ndarray) -> np.ndarray | None:
    """Position in `given` of each of the nodes `own`, None when they are not the same nodes."""
    if len(own) != len(given):
        return None
    distance, index = cKDTree(given).query(own)
    radius = np.linalg.norm(given[:, :2], axis=1).max()
    return index if distance.max() <= MATCH_TOLERANCE * radius else None
