"""What the mesh of a part is worth: flexibility of its bores beside that of a coarser mesh."""

from __future__ import annotations

import numpy as np

from fenics_ehd.base.errors import InterfaceMismatchError
from fenics_ehd.film.layout import film_grid, match
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.reduction.bore import BoreSurface

#: Cells of a part in one of the coarser mesh, and the order of the flexibility's error. Of a rod's
#: under eight pressures, from 10 to 20 cells around it changes 5 to 17 times as much as from 20 to
#: 30, in the mean 13; order 3 makes that 10, order 4 19.
COARSER, PART_ORDER = 2.0, 3.0


def flexibility_error(own: ReducedBody, coarser: ReducedBody) -> np.ndarray:
    """Outward displacement per nodal pressure that the exact part is estimated to have more.

    Parameters
    ----------
    own
        With its missing flexibility.
    coarser
        Of a coarser mesh of the same part, with its missing flexibility.

    Returns
    -------
    numpy.ndarray
        At the nodes of all bores, shape (m, k) [m/Pa].

    Raises
    ------
    InterfaceMismatchError
        A bore's mesh is not structured, or a flexibility is not known.
    """
    if not (own.missing_flexibility.size and coarser.missing_flexibility.size):
        raise InterfaceMismatchError("reduction.estimate_error is off: no flexibility to compare")
    whole = own.missing_flexibility + own.basis_flexibility()
    other = coarser.missing_flexibility + coarser.basis_flexibility()
    moved = np.zeros((len(whole), other.shape[1]))
    pressed = np.zeros((other.shape[1], whole.shape[1]))
    for name in own.bores:
        rows, others = own.rows_of(name), coarser.rows_of(name)
        mine, theirs = own.bores[name], coarser.bores[name]
        moved[rows.nodes] = (
            _reading(theirs.coordinates, mine.coordinates, theirs, mine) @ other[others.nodes]
        )
        pressed[others.pressures, rows.pressures] = _reading(
            mine.pressure_coordinates, theirs.pressure_coordinates, mine, theirs
        )
    return (whole - moved @ pressed) / (COARSER**PART_ORDER - 1.0)


def _reading(
    given: np.ndarray, wanted: np.ndarray, source: BoreSurface, target: BoreSurface
) -> np.ndarray:
    """From values at given nodes of one mesh of a bore to those at wanted ones of another."""
    given = given - np.append(source.centre[:2], 0.0)
    wanted = wanted - np.append(target.centre[:2], 0.0)
    grid = film_grid(given)
    order = match(grid.nodes, given)
    assert order is not None
    angle = np.arctan2(wanted[:, 1], wanted[:, 0])
    values = grid.interpolation(angle, wanted[:, 2]).toarray()
    found = np.zeros_like(values)
    found[:, order] = values
    return found
