"""Flow of oil through the borders of a film, as the discrete equation balances it.

The weak form of (1) tested with the shape function of a node leaves zero in the
full film, the growth of the cavities at a cavitated node, and at a node of
given pressure the flow that enters there. The functions sum to one, so

    supply + cavities - lower - upper = squeeze

holds to round-off whatever the mesh. Flow from pressure slopes at the sides does not.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fenics_ehd.film.film import Film, FilmState, OilState
from fenics_ehd.film.forces import in_supply
from fenics_ehd.film.parameters import FeedTerm
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


class FilmFlows:
    """Flows of a solved film at steady pressure, and their powers, each evaluated when asked for.

    Parameters
    ----------
    film, state
        A film and its solution.
    """

    def __init__(self, film: Film, state: FilmState):
        self._film, self._state = film, state

    @cached_property
    def balance(self) -> FlowBalance:
        """All flows; of a film that keeps account of its oil no cavity makes any."""
        film, inflow, feeds = self._film, self._inflow, self._feeds
        grid, conserved = film.parameters.grid, self._lumped
        supply = float(inflow[self._region].sum()) + sum(feeds.values())
        cavities = 0.0 if conserved else float(inflow[film.free].sum())
        sides = {}
        for name, end in (("lower", grid.heights[0]), ("upper", grid.heights[-1])):
            entering = _side_inflow(film, inflow, self._region, end)
            ambient = getattr(film.parameters.sides, name)
            if ambient is None:
                entering = np.zeros_like(entering)
            # Where the sides are at the cavitation pressure nothing can flow in: what
            # appears to is the growth of cavities beside them. Told apart edge by edge,
            # for a corner of the 8-node element alone has the wrong sign.
            cavity = 0.0
            if ambient == 0.0 and not conserved:
                cavity = float(np.maximum(entering, 0.0).sum())
            cavities += cavity
            sides[name] = cavity - float(entering.sum())
        lower, upper = sides["lower"], sides["upper"]
        squeeze = supply - lower - upper if conserved else self._defects[1]
        return FlowBalance(lower, upper, supply, cavities, squeeze, feeds)

    @cached_property
    def leaving(self) -> float:
        """Oil that leaves at one instant [m3/s]: the part of the flows that carries heat away.

        Counted are, each where it flows out,

        - through either side, edge by edge of the mesh. At a pressure above that of cavitation oil
          comes in over some edges and leaves over others, and what comes in takes nothing off that;
        - into a supply, as a whole: a groove that takes more than it gives. What is
          dragged into a groove at one edge and out of it at the other stays in the film. Under
          condition (8) cavities fill the gap with oil that nobody supplied, and drag it there: as
          much as they make is not counted.

        Not counted is what the gap's motion stores, nor what cavities take in and give back: over a
        cycle that comes to nothing, but for the oil that condition (8) makes where the film forms,
        which is fresh.
        """
        p, inflow = self._film.parameters, self._inflow
        angle, height = p.grid.node_positions.T
        leaving, taken, supplied = 0.0, 0.0, np.zeros(len(angle), dtype=bool)
        for region in p.regions:
            own = region.contains(angle, height, p.grid.radius) & ~supplied
            supplied |= own
            taken += max(0.0, -float(inflow[own].sum()))
        taken += sum(max(0.0, -flow) for flow in self._feeds.values())
        if taken:
            leaving += max(0.0, taken - max(0.0, self.balance.cavities))
        for name, end in (("lower", p.grid.heights[0]), ("upper", p.grid.heights[-1])):
            if getattr(p.sides, name) is not None:
                side = _side_inflow(self._film, inflow, supplied, end)
                leaving += float(np.maximum(-side, 0.0).sum())
        return leaving

    @cached_property
    def work(self) -> float:
        """Power of the oil that enters, less that of what leaves, at the film's pressures [W]."""
        return self._work_at_ends + (self.feed_power if self._fed is not None else 0.0)

    @cached_property
    def feed_power(self) -> float:
        """Power that the oil of `FilmParameters.feeds` brings into the film [W]: ``int p dQ``."""
        film, p, feed = self._film, self._film.parameters, self._fed
        assert feed is not None
        nodal = self._state.pressure / p.pressure_scale
        if self._lumped:
            power = -nodal @ feed.lumped(film.assembly, nodal)
        else:
            pressure = film.assembly.at_points(nodal)[0]
            power = -np.sum(film.assembly.area * feed.outflow(pressure) * pressure)
        return float(p.clearance * p.grid.radius**2 * p.rate * p.pressure_scale * power)

    @property
    def refill_work(self) -> float:
        """Power of the pressure on oil that fills voids, where the film forms anew [W].

        With it the weak form tested with its own pressure balances. A front within a cell has it;
        it shrinks with the mesh. Without voids it is zero.
        """
        if not self._lumped:
            return 0.0
        return float(self._state.pressure @ self._defects[0]) - self._work_at_ends

    @property
    def _lumped(self) -> bool:
        return isinstance(self._state, OilState)

    @cached_property
    def _fed(self) -> FeedTerm | None:
        return self._film.equation.fed(self._state.gap, lumped=self._lumped)

    @cached_property
    def _region(self) -> np.ndarray:
        """Mask of nodes in a supply region, shape (nodes,)."""
        return in_supply(self._film, *self._film.parameters.grid.node_positions.T)

    @cached_property
    def _feeds(self) -> dict[str, float]:
        """Into the film through everything in `FilmParameters.feeds`, by name [m3/s]."""
        film, p, feed = self._film, self._film.parameters, self._fed
        if feed is None:
            return {}
        pressure = film.assembly.at_points(self._state.pressure / p.pressure_scale)[0]
        flows = -np.sum(film.assembly.area * feed.outflow(pressure), axis=(1, 2))
        unit = p.clearance * p.grid.radius**2 * p.rate
        return {f.name: float(unit * flow) for f, flow in zip(p.feeds, flows, strict=True)}

    @cached_property
    def _inflow(self) -> np.ndarray:
        """Flow into the film at nodes of given pressure, shape (nodes,) [m3/s]."""
        return -self._state.outflow if isinstance(self._state, OilState) else self._defects[0]

    @cached_property
    def _work_at_ends(self) -> float:
        """Power of what flows in at nodes of given pressure [W]."""
        given = np.ones(self._film.assembly.size, dtype=bool)
        given[self._film.free] = False
        return float(self._state.pressure[given] @ self._inflow[given])

    @cached_property
    def _defects(self) -> tuple[np.ndarray, float]:
        """Weak form tested with every node [m3/s], shape (nodes,), and the growth of the gap."""
        film, p, feed = self._film, self._film.parameters, self._fed
        gap, nodal = self._state.gap, self._state.pressure / p.pressure_scale
        inputs = film.equation.inputs(gap, supplied=not self._lumped)
        defect = film.equation.balance(inputs, nodal)
        if feed is not None and self._lumped:
            defect += feed.lumped(film.assembly, nodal)
        flow, unit = film.flow(self._state), p.grid.radius**2
        growth = np.sum(film.assembly.area * flow.density * flow.slope * gap.thickness_rate)
        return p.clearance * p.rate * unit * defect, float(unit * growth)


def under_pressure(film: Film) -> bool:
    """True of a film that oil enters or leaves at a pressure above that of cavitation."""
    return bool(film.parameters.feeds) or bool(np.any(film.equation.given))


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
