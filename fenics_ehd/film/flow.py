"""Flow of oil through the borders of a film, as the discrete equation balances it.

The weak form of (1) tested with the shape function of a node leaves zero in the
full film, the growth of the cavities at a cavitated node, and at a node of
given pressure the flow that enters there. The functions sum to one, so

    supply + cavities - lower - upper = squeeze

holds to round-off whatever the mesh. Flow from pressure slopes at the sides does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.film.balance import balance
from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.oil_state import OilState
from fenics_ehd.film.shear import in_supply
from fenics_ehd.film.supply import SLACK


@dataclass(frozen=True)
class FlowBalance:
    """Volume flows at the density of the oil at ambient pressure [m3/s].

    Attributes
    ----------
    lower, upper
        Out of the film at ``z = -B/2`` and ``z = B/2``.
    supply
        Into the film through grooves and holes.
    cavities
        Growth of the cavities: oil that the condition (8) lets disappear where
        the film ruptures and makes anew where it forms.
    squeeze
        Growth of the gap, or of the oil that it holds.
    """

    lower: float
    upper: float
    supply: float
    cavities: float
    squeeze: float

    @property
    def side(self) -> float:
        """Out of both sides together."""
        return self.lower + self.upper


def flow_balance(film: Film, state: FilmState) -> FlowBalance:
    """Flows of a solved film at steady pressure."""
    if isinstance(state, OilState):
        return _oil_flows(film, state)
    defect, growth = _defects(film, state)
    grid = film.parameters.grid
    angle, height = grid.node_positions.T
    region = in_supply(film, angle, height)
    supply = float(defect[region].sum())
    cavities = float(defect[film.free].sum())
    sides = {}
    for name, end in (("lower", grid.heights[0]), ("upper", grid.heights[-1])):
        ambient = getattr(film.parameters.sides, name)
        if ambient is None:
            sides[name] = 0.0
            continue
        nodes = np.flatnonzero(np.abs(height - end) <= SLACK * grid.radius)
        inflow = np.where(region[nodes], 0.0, defect[nodes])[np.argsort(angle[nodes])]
        if grid.family != "bilinear":
            corner, middle = inflow[::2], inflow[1::2]
            inflow = 0.5 * (corner + np.roll(corner, -1)) + middle
        # Where the sides are at the cavitation pressure nothing can flow in: what
        # appears to is the growth of cavities beside them. Told apart edge by edge,
        # for a corner of the 8-node element alone has the wrong sign.
        cavity = np.maximum(inflow, 0.0).sum() if ambient == 0.0 else 0.0
        cavities += float(cavity)
        sides[name] = float(cavity - inflow.sum())
    return FlowBalance(sides["lower"], sides["upper"], supply, cavities, growth)


def flow_work(film: Film, state: FilmState) -> float:
    """Power of the oil that enters, less that of what leaves, at given pressures [W]."""
    given = np.ones(film.assembly.size, dtype=bool)
    given[film.free] = False
    inflow = -state.outflow if isinstance(state, OilState) else _defects(film, state)[0]
    return float(state.pressure[given] @ inflow[given])


def refill_work(film: Film, state: OilState) -> float:
    """Power of the pressure on oil that fills voids, at the edges where the film forms anew [W].

    With it the weak form tested with its own pressure balances. A front within a cell has it; it
    shrinks with the mesh.
    """
    return float(state.pressure @ _defects(film, state)[0]) - flow_work(film, state)


def _oil_flows(film: Film, state: OilState) -> FlowBalance:
    """Flows of a film that keeps account of its oil: no cavity makes any."""
    grid = film.parameters.grid
    angle, height = grid.node_positions.T
    region = in_supply(film, angle, height)
    lower, upper = (
        float(state.outflow[(np.abs(height - end) <= SLACK * grid.radius) & ~region].sum())
        for end in (grid.heights[0], grid.heights[-1])
    )
    supply = 0.0 - float(state.outflow[region].sum())
    return FlowBalance(lower, upper, supply, cavities=0.0, squeeze=supply - lower - upper)


def _defects(film: Film, state: FilmState) -> tuple[np.ndarray, float]:
    """Weak form tested with every node [m3/s], shape (nodes,), and the growth of the gap."""
    p = film.parameters
    thickness, rate, velocity = film.equation.dimensionless(state.gap)
    oil = film.oil(state)
    defect = balance(film.assembly, oil, thickness, velocity, rate)
    unit = p.clearance * p.grid.radius**2 * p.rate
    return unit * defect, float(unit * np.sum(film.assembly.area * oil.density * rate))
