"""Oil that leaves a film at one instant, the part of its flows that carries heat away.

Counted are, each where it flows out:

- through either side, edge by edge of the mesh. Where the sides are at the cavitation pressure
  nothing flows in (`flow`); at a higher one oil comes in over some edges and leaves over others,
  and what comes in takes nothing off what leaves;
- into every supply region, all its nodes together: a groove that takes more than it gives. Oil that
  is dragged into a groove at one edge and out of it at the other stays in the film.

Not counted is what cavities take in and give back, nor what the gap's motion stores: over a cycle
they come to nothing, but that the condition (8) makes oil anew where the film forms. That is fresh.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.flow import film_defects, side_inflow
from fenics_ehd.film.oil_state import OilState
from fenics_ehd.film.supply import SLACK


def oil_leaving(film: Film, state: FilmState) -> float:
    """Volume flow out of a film at the density of the oil at ambient pressure [m3/s]."""
    p = film.parameters
    angle, height = p.grid.node_positions.T
    keeps_account = isinstance(state, OilState)
    inflow = -state.outflow if isinstance(state, OilState) else film_defects(film, state)[0]
    leaving, supplied = 0.0, np.zeros(len(angle), dtype=bool)
    for region in p.regions:
        own = region.contains(angle, height, p.grid.radius) & ~supplied
        supplied |= own
        leaving += max(0.0, -float(inflow[own].sum()))
    for name, end in (("lower", p.grid.heights[0]), ("upper", p.grid.heights[-1])):
        if getattr(p.sides, name) is None:
            continue
        if keeps_account:
            side = inflow[(np.abs(height - end) <= SLACK * p.grid.radius) & ~supplied]
        else:
            side = side_inflow(film, inflow, supplied, end)
        leaving += float(np.maximum(-side, 0.0).sum())
    return leaving
