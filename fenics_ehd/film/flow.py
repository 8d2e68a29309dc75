"""Flow of oil through the borders of a film, as the discrete equation balances it.

The weak form of (1) tested with the shape function of a node leaves zero in the
full film, the growth of the cavities at a cavitated node, and at a node of
given pressure the flow that enters there. The functions sum to one, so

    supply + cavities - lower - upper = squeeze

holds to round-off whatever the mesh. Flow from pressure slopes at the sides does not.
"""

from __future__ import annotations

from dataclasses import dataclass, field

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
        Into the film through all grooves and holes.
    cavities
        Growth of the cavities: oil that the condition (8) lets disappear where
        the film ruptures and makes anew where it forms.
    squeeze
        Growth of the gap, or of the oil that it holds.
    feeds
        Share of the supply of everything in `FilmParameters.feeds`, by name.
    """

    lower: float
    upper: float
    supply: float
    cavities: float
    squeeze: float
    feeds: dict[str, float] = field(default_factory=dict)

    @property
    def side(self) -> float:
        """Out of both sides together."""
        return self.lower + self.upper


def flow_balance(film: Film, state: FilmState) -> FlowBalance:
    """Flows of a solved film at steady pressure."""
    feeds = feed_flows(film, state) if film.parameters.feeds else {}
    if isinstance(state, OilState):
        return _oil_flows(film, state, feeds)
    defect, growth = _defects(film, state)
    grid = film.parameters.grid
    angle, height = grid.node_positions.T
    region = in_supply(film, angle, height)
    supply = float(defect[region].sum()) + sum(feeds.values())
    cavities = float(defect[film.free].sum())
    sides = {}
    for name, end in (("lower", grid.heights[0]), ("upper", grid.heights[-1])):
        ambient = getattr(film.parameters.sides, name)
        if ambient is None:
            sides[name] = 0.0
            continue
        inflow = _side_inflow(film, defect, region, end)
        # Where the sides are at the cavitation pressure nothing can flow in: what
        # appears to is the growth of cavities beside them. Told apart edge by edge,
        # for a corner of the 8-node element alone has the wrong sign.
        cavity = np.maximum(inflow, 0.0).sum() if ambient == 0.0 else 0.0
        cavities += float(cavity)
        sides[name] = float(cavity - inflow.sum())
    return FlowBalance(sides["lower"], sides["upper"], supply, cavities, growth, feeds)


def feed_flows(film: Film, state: FilmState) -> dict[str, float]:
    """Into the film through everything in `FilmParameters.feeds`, by name [m3/s]."""
    lumped = isinstance(state, OilState)
    p, feed = film.parameters, film.equation.fed(state.gap, lumped=lumped)
    assert feed is not None
    pressure = film.assembly.at_points(state.pressure / p.pressure_scale)[0]
    flows = np.sum(film.assembly.area * feed.inflow(pressure), axis=(1, 2))
    unit = p.clearance * p.grid.radius**2 * p.rate
    return {f.name: float(unit * flow) for f, flow in zip(p.feeds, flows, strict=True)}


def feed_power(film: Film, state: FilmState) -> float:
    """Power that the oil of all `FilmParameters.feeds` brings into the film [W]: ``int p dQ``."""
    lumped = isinstance(state, OilState)
    p, feed = film.parameters, film.equation.fed(state.gap, lumped=lumped)
    assert feed is not None
    nodal = state.pressure / p.pressure_scale
    if lumped:
        power = -nodal @ feed.lumped(film.assembly, nodal)
    else:
        pressure = film.assembly.at_points(nodal)[0]
        power = -np.sum(film.assembly.area * feed.outflow(pressure) * pressure)
    return float(p.clearance * p.grid.radius**2 * p.rate * p.pressure_scale * power)


def under_pressure(film: Film) -> bool:
    """Whether oil enters or leaves at a pressure above that of cavitation."""
    return bool(film.parameters.feeds) or bool(np.any(film.equation.given))


def oil_leaving(film: Film, state: FilmState) -> float:
    """Oil that leaves a film at one instant [m3/s]: the part of its flows that carries heat away.

    Counted are, each where it flows out,

    - through either side, edge by edge of the mesh. At a pressure above that of cavitation oil
      comes in over some edges and leaves over others, and what comes in takes nothing off that;
    - into a supply, as a whole: a groove that takes more than it gives. What is
      dragged into a groove at one edge and out of it at the other stays in the film. Under
      condition (8) cavities fill the gap with oil that nobody supplied, and drag it there: as much
      as they make is not counted.

    Not counted is what the gap's motion stores, nor what cavities take in and give back: over a
    cycle that comes to nothing, but for the oil that condition (8) makes where the film forms,
    which is fresh.
    """
    p = film.parameters
    angle, height = p.grid.node_positions.T
    inflow = _inflow(film, state)
    leaving, taken, supplied = 0.0, 0.0, np.zeros(len(angle), dtype=bool)
    for region in p.regions:
        own = region.contains(angle, height, p.grid.radius) & ~supplied
        supplied |= own
        taken += max(0.0, -float(inflow[own].sum()))
    if p.feeds:
        taken += sum(max(0.0, -flow) for flow in feed_flows(film, state).values())
    if taken:
        leaving += max(0.0, taken - max(0.0, flow_balance(film, state).cavities))
    for name, end in (("lower", p.grid.heights[0]), ("upper", p.grid.heights[-1])):
        if getattr(p.sides, name) is not None:
            side = _side_inflow(film, inflow, supplied, end)
            leaving += float(np.maximum(-side, 0.0).sum())
    return leaving


def _side_inflow(film: Film, defect: np.ndarray, region: np.ndarray, end: float) -> np.ndarray:
    """Flow into a film over the edges at the height of one side [m3/s], or at 4-node cells' nodes.

    Parameters
    ----------
    film
        The film.
    defect
        Flow in at every node [m3/s].
    region
        Whether a node lies in a supply region.
    end
        Height of the side [m].
    """
    grid = film.parameters.grid
    angle, height = grid.node_positions.T
    nodes = np.flatnonzero(np.abs(height - end) <= SLACK * grid.radius)
    inflow = np.where(region[nodes], 0.0, defect[nodes])[np.argsort(angle[nodes])]
    if grid.family == "bilinear":
        return inflow
    corner, middle = inflow[::2], inflow[1::2]
    return 0.5 * (corner + np.roll(corner, -1)) + middle


def flow_work(film: Film, state: FilmState) -> float:
    """Power of the oil that enters, less that of what leaves, at the film's pressures [W]."""
    work = _work_at_ends(film, state, _inflow(film, state))
    return work + feed_power(film, state) if film.parameters.feeds else work


def refill_work(film: Film, state: OilState) -> float:
    """Power of the pressure on oil that fills voids, at the edges where the film forms anew [W].

    With it the weak form tested with its own pressure balances. A front within a cell has it; it
    shrinks with the mesh.
    """
    tested = float(state.pressure @ _defects(film, state)[0])
    return tested - _work_at_ends(film, state, _inflow(film, state))


def _inflow(film: Film, state: FilmState) -> np.ndarray:
    """Flow into the film at nodes of given pressure, shape (nodes,) [m3/s]."""
    return -state.outflow if isinstance(state, OilState) else _defects(film, state)[0]


def _work_at_ends(film: Film, state: FilmState, inflow: np.ndarray) -> float:
    """Power of what flows in at nodes of given pressure [W]."""
    given = np.ones(film.assembly.size, dtype=bool)
    given[film.free] = False
    return float(state.pressure[given] @ inflow[given])


def _oil_flows(film: Film, state: OilState, feeds: dict[str, float]) -> FlowBalance:
    """Flows of a film that keeps account of its oil: no cavity makes any."""
    grid = film.parameters.grid
    angle, height = grid.node_positions.T
    region = in_supply(film, angle, height)
    lower, upper = (
        float(state.outflow[(np.abs(height - end) <= SLACK * grid.radius) & ~region].sum())
        for end in (grid.heights[0], grid.heights[-1])
    )
    supply = sum(feeds.values()) - float(state.outflow[region].sum())
    squeeze = supply - lower - upper
    return FlowBalance(lower, upper, supply, cavities=0.0, squeeze=squeeze, feeds=feeds)


def _defects(film: Film, state: FilmState) -> tuple[np.ndarray, float]:
    """Weak form tested with every node [m3/s], shape (nodes,), and the growth of the gap."""
    p = film.parameters
    thickness, rate, velocity = film.equation.dimensionless(state.gap)
    oil = film.oil(state)
    defect = balance(film.assembly, oil, thickness, velocity, rate)
    lumped = isinstance(state, OilState)
    feed, nodal = film.equation.fed(state.gap, lumped=lumped), state.pressure / p.pressure_scale
    if feed is not None and lumped:
        defect += feed.lumped(film.assembly, nodal)
    elif feed is not None:
        defect += film.assembly.source(feed.outflow(film.assembly.at_points(nodal)[0]))
    unit = p.clearance * p.grid.radius**2 * p.rate
    stored = oil.density * rate
    if state.density_rate is not None:
        stored = stored + thickness * oil.expansion
    return unit * defect, float(unit * np.sum(film.assembly.area * stored))
