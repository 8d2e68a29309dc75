"""Numbers of film cells that mean something and fit into memory."""

from __future__ import annotations

from typing import Any

from fenics_ehd.settings import counts

#: Fewest film cells around and along. With 3 around the largest pressure is 12 % too low.
FEWEST_CELLS = (8, 2)

#: Film cells around times along that still fit into the memory of a usual machine.
MOST_CELLS = 200_000


def film_cells(default: tuple[int, ...], help_text: str, *, optional: bool = False) -> Any:
    """Cells of a film mesh around and along."""
    return counts(default, help_text, least=FEWEST_CELLS, most=MOST_CELLS, optional=optional)
