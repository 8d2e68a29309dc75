"""Lengths and numbers of cells that the scenes share, with limits that catch a slip.

A length written in millimetres or micrometres is a thousand times too large or more: the limits
are generous, and still below that.
"""

from __future__ import annotations

from typing import Any

from fenics_ehd.settings import counts, number

#: Largest bearing radius, bearing width or crank radius [m].
LARGEST_LENGTH = 5.0

#: Largest radial clearance [m].
LARGEST_CLEARANCE = 5e-3

#: Fewest film cells around and along. With 3 around the largest pressure is 12 % too low.
FEWEST_CELLS = (8, 2)

#: Film cells around times along that still fit into the memory of a usual machine.
MOST_CELLS = 200_000


def metres(default: float, help_text: str, *, below: float = LARGEST_LENGTH) -> Any:
    """Length of a machine [m]."""
    return number(default, help_text, above=0, below=below, example="0.025 for 25 mm")


def radial_clearance(default: float) -> Any:
    """Radial clearance of a bearing [m]."""
    return number(
        default, "radial clearance [m]", above=0, below=LARGEST_CLEARANCE, example="30e-6 for 30 um"
    )


def film_cells(default: tuple[int, ...], help_text: str, *, optional: bool = False) -> Any:
    """Cells of a film mesh around and along."""
    return counts(default, help_text, least=FEWEST_CELLS, most=MOST_CELLS, optional=optional)
