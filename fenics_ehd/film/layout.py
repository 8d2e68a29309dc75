"""Recognise the film mesh that a set of bore nodes belongs to."""

from __future__ import annotations

import numpy as np

from fenics_ehd.errors import InterfaceMismatchError


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
