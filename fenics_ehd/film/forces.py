"""Shear of the oil in a solved film, also in its cavitated zone, and flows through its borders.

Shear: with the parabolic velocity profile of lubrication theory, U the sliding velocity
``v_1 - v_2`` and y along the circumference, the shear stresses of the oil are

    bore    tau_2 =  theta eta U / h - (h / 2) dp/dy
    shaft   tau_1 = -theta eta U / h - (h / 2) dp/dy

``theta`` is the sheared fraction of the width: 1 in the full film, 0 in grooves and supply holes,
which are deep. In the cavitated zone it follows one of three rules:

``streamers``
    The oil that leaves the full film crosses the zone in streamers that fill the
    gap from wall to wall. Their flow at the mean velocity equals the flow at the rupture of
    the film, so that ``theta = h_rupture / h`` at the same height z, at most 1. The rupture lies
    upstream: the oil moves relative to the cavity at the velocity ``(v_1 + v_2) / 2 - Omega R``.
    Omega is the speed at which the gap turns: the one that minimises ``dh/dt + Omega dh/dphi``.
    Between round surfaces Omega is the speed of the line of centres, ``(e x e') / e^2``; theta is
    the same in every frame. At low relative velocities oil flows in from both sides (`SLOW`). A
    height z without a full film counts as filled.
``full``
    The oil fills the gap in the cavitated zone, too.
``none``
    The cavitated zone contains no oil.

If the cavitation condition determines the fluid fraction, ``streamers`` uses this fraction.

Forces on both bodies: on the bore the oil presses with ``p n`` (n = e_r, outward) and pulls
with ``tau_2 t`` (t along the circumference). The shaft lies ``h`` further in: its surface ``(R_2 -
h) e_r + z e_z`` has the area element ``[(R_2 - h) e_r + dh/dphi e_phi] dphi dz`` in the plane,
smaller than that of the bore and inclined. Pressure on it gives, integrated by parts around the
bore (``d e_phi / dphi = -e_r``),

    -int p [(R_2 - h) e_r + dh/dphi e_phi] dphi dz = -int p n dA + int h dp/dy t dA

exactly, for the film is periodic. With ``tau_1 + tau_2 = -h dp/dy`` the two bodies then receive
opposite forces, and opposite moments about any one point. By the same integration the torque on the
shaft about its own axis is ``R_1 int tau_1 dA`` up to a relative error c / R, with the radial
clearance c.

Flow through the borders of a film is evaluated from the discrete equation. The weak form of
(1) tested with the shape function of a node is zero in the full film, the growth of the cavities at
a cavitated node, and the inflow at a node of given pressure. The shape functions sum to one, so
that

    supply + cavities - lower - upper = squeeze

holds to round-off on every mesh. Flow computed from pressure slopes at the sides does not fulfil
this balance.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import SHEAR_RULES
from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.parameters import FeedTerm
from fenics_ehd.film.supply import SLACK

#: Velocity of the oil relative to a cavity, over the sliding velocity, below which oil flows in
#: from both sides. The limit makes friction continuous when the relative velocity changes its sign.
#: Under a load of constant direction the ratio is 0.5.
SLOW = 0.1

#: A pressure below this share of the largest pressure is the round-off of a cavitated node.
PRESSURE_FLOOR = 1e-12


@dataclass(frozen=True, eq=False)
class FilmFields:
    """Fields at the Gauss points that determine the shear stress of a film, each (cells, points).

    Attributes
    ----------
    slope_around
        Derivative of the pressure along the circumference [Pa/m].
    viscosity
        Dynamic viscosity of the oil [Pa s].
    sheared_fraction
        Fraction theta of the width in which oil is sheared [-].
    """

    slope_around: np.ndarray
    viscosity: np.ndarray
    sheared_fraction: np.ndarray


def film_fields(film: Film, state: FilmState, rule: str = "streamers") -> FilmFields:
    """Fields that determine the shear stress of a solved film, by one of the `SHEAR_RULES`.

    Raises
    ------
    SettingsError
        If `rule` is not one of `SHEAR_RULES`.
    """
    if rule not in SHEAR_RULES:
        raise SettingsError(f"shear rule {rule!r} is not one of {', '.join(SHEAR_RULES)}")
    p = film.parameters
    pressure, around, _ = film.assembly.at_points(state.pressure)
    return FilmFields(
        around / p.grid.radius,
        p.lubricant.viscosity * np.broadcast_to(film.flow(state).viscosity, pressure.shape),
        _sheared_fraction(film, state, pressure, rule),
    )


def _sheared_fraction(film: Film, state: FilmState, pressure: np.ndarray, rule: str) -> np.ndarray:
    """Fraction theta of the width in which oil is sheared, shape (cells, points)."""
    full = pressure > PRESSURE_FLOOR * pressure.max()
    groove = film.supplied_points
    if rule == "streamers" and state.fluid_fraction is not None:
        share = np.clip(film.assembly.at_points(state.fluid_fraction)[0], 0.0, 1.0)
    elif rule == "streamers":
        # An axial groove of width zero contains nodes, but no Gauss point.
        beside_lines = film.assembly.at_points(film.supplied_nodes.astype(float))[0] > 0.5
        share = _streamers(film, state, full | groove | beside_lines)
    else:
        share = np.full(full.shape, float(rule == "full"))
    share[full] = 1.0
    share[groove] = 0.0
    if film.equation.feeds is not None:
        share *= 1.0 - np.minimum(film.equation.feeds.shares(state.gap.turn)[0].sum(axis=0), 1.0)
    return share


def _streamers(film: Film, state: FilmState, source: np.ndarray) -> np.ndarray:
    """Sheared fraction ``h_rupture / h`` of the gap h at the Gauss points, shape (cells, points).

    h_rupture is the gap at the rupture of the film: at the nearest point upstream at which the mask
    `source` is True.
    """
    angle = film.points.angle.ravel()
    radius = film.parameters.grid.radius
    order = film.points_around
    thickness = film.equation.flow(state.gap).thickness.ravel()[order]
    fed = source.ravel()[order]
    forward = _forward(state.gap, angle[order], order, radius)
    share = np.zeros(fed.shape)
    for part, sense in ((forward, 1), (1.0 - forward, -1)):
        if part > 0.0:
            share += part * _behind(thickness[:, ::sense], fed[:, ::sense])[:, ::sense]
    result = np.empty(source.size)
    result[order] = share
    return result.reshape(source.shape)


def _behind(thickness: np.ndarray, fed: np.ndarray) -> np.ndarray:
    """Sheared fraction ``h_rupture / h`` at rows of points, shape (heights, points).

    The points of a row are in the order in which oil passes them. `thickness` is the gap h. `fed`
    is True at points that feed oil to those downstream of them; h_rupture is the gap at the last
    point that feeds oil.
    """
    # Two turns, so that the points upstream of the first one are the last ones of the row.
    count = fed.shape[1]
    sources = np.where(np.tile(fed, 2), np.arange(2 * count), -1)
    last = np.maximum.accumulate(sources, axis=1)[:, count:]
    rupture = np.take_along_axis(thickness, np.maximum(last, 0) % count, axis=1)
    return np.where(last < 0, 1.0, np.minimum(rupture / thickness, 1.0))


def _forward(gap: Gap, angle: np.ndarray, order: np.ndarray, radius: float) -> float:
    """Share of the oil that flows into cavities from the side of smaller angles, 0 to 1.

    `angle` [rad] and `order`, the indices of the Gauss points in the gap's arrays, have a row for
    every height.
    """
    thickness = gap.thickness.ravel()[order]
    rate = gap.thickness_rate.ravel()[order]
    rise = np.roll(thickness, -1, axis=1) - thickness
    spacing = np.mod(np.roll(angle, -1, axis=1) - angle, 2 * np.pi)
    # The speed Omega at which the gap turns is -turned / slopes, from differences around. The
    # relative velocity is multiplied by `slopes`, which is zero for a gap that does not turn.
    turned = 0.5 * np.sum((rate + np.roll(rate, -1, axis=1)) * rise)
    slopes = np.sum(rise**2 / spacing)
    relative = np.mean(gap.mean_velocity) * slopes + radius * turned
    both = SLOW * slopes * np.mean(np.abs(gap.sliding_velocity))
    return float(np.clip(0.5 + 0.5 * relative / max(both, np.finfo(float).tiny), 0.0, 1.0))


@dataclass(frozen=True)
class FlowBalance(Described):
    """Volume flows of a film, at the density of the oil at ambient pressure [m3/s].

    Attributes
    ----------
    lower, upper
        Flow out of the film at ``z = -B/2`` and ``z = B/2``.
    supply
        Flow into the film through all grooves and holes.
    cavities
        Growth of the cavities: oil that vanishes under condition (8) where the film ruptures, less
        the oil that appears where the film forms again.
    squeeze
        Rate of the volume of the gap; with mass-conserving cavitation, rate of its oil content.
    feeds
        Flow into the film through every supply in `FilmParameters.feeds`, by name.
    """

    lower: float
    upper: float
    supply: float
    cavities: float
    squeeze: float
    feeds: dict[str, float] = field(default_factory=dict)

    @property
    def side(self) -> float:
        """Flow out of the film at both sides together [m3/s]."""
        return self.lower + self.upper


class FilmFlows(Described):
    """Oil flows of a solved film, and the powers of these flows, each computed on access.

    Without mass-conserving cavitation, the rate of the density is neglected, as if the pressure
    were steady.

    Parameters
    ----------
    film, state
        A film and its solution.
    """

    def __init__(self, film: Film, state: FilmState):
        self._film = film
        self._state = state
        # With mass-conserving cavitation, flows of supplies are lumped at the nodes.
        self._lumped = state.outflow is not None

    @cached_property
    def balance(self) -> FlowBalance:
        """Volume flows through all borders of the film, and growth of its cavities [m3/s].

        With mass-conserving cavitation the growth of cavities is part of the term `squeeze`.
        """
        film = self._film
        inflow = self._inflow
        feeds = self._feeds
        grid = film.parameters.grid
        conserved = self._lumped
        supply = float(inflow[film.supplied_nodes].sum()) + sum(feeds.values())
        cavities = 0.0 if conserved else float(inflow[film.free].sum())
        sides = {}
        for name, end in (("lower", grid.heights[0]), ("upper", grid.heights[-1])):
            entering = _side_inflow(film, inflow, film.supplied_nodes, end)
            ambient = getattr(film.parameters.sides, name)
            if ambient is None:
                entering = np.zeros_like(entering)
            # A side at the cavitation pressure has no inflow: an apparent inflow is the growth of
            # adjacent cavities. They are distinguished for each edge of the mesh: at a single
            # corner node of the 8-node element the flow has the wrong sign.
            cavity = 0.0
            if ambient == 0.0 and not conserved:
                cavity = float(np.maximum(entering, 0.0).sum())
            cavities += cavity
            sides[name] = cavity - float(entering.sum())
        lower = sides["lower"]
        upper = sides["upper"]
        squeeze = supply - lower - upper if conserved else self._defects[1]
        return FlowBalance(lower, upper, supply, cavities, squeeze, feeds)

    @cached_property
    def leaving(self) -> float:
        """Flow of the oil that leaves the film at one instant and carries heat away [m3/s].

        Two outflows count:

        - through the sides, summed over those edges of the mesh over which oil leaves. At an
          ambient pressure above the cavitation pressure oil enters over other edges; this inflow
          is not subtracted;
        - net flow out of the film into each groove or supply, if positive. Oil that is dragged
          into a groove at one edge and out of it at the other stays in the film. Under condition
          (8) cavities fill the gap with oil that no supply delivered, which is dragged to grooves:
          the growth of the cavities is subtracted.

        Oil stored by the motion of the gap does not count, nor does oil exchanged with cavities:
        both are zero over a cycle, except for the oil that condition (8) creates where the film
        forms again. This oil counts as fresh.
        """
        p = self._film.parameters
        inflow = self._inflow
        angle, height = p.grid.node_positions.T
        leaving = 0.0
        taken = 0.0
        supplied = np.zeros(len(angle), dtype=bool)
        for region in p.regions:
            nodes = region.contains(angle, height, p.grid.radius) & ~supplied
            supplied |= nodes
            taken += max(0.0, -float(inflow[nodes].sum()))
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
        """Power that oil brings into the film less the power it takes out [W]: ``int p dQ``."""
        return self._work_at_ends + (self.feed_power if self._fed is not None else 0.0)

    @cached_property
    def feed_power(self) -> float:
        """Power that oil from `FilmParameters.feeds` brings into the film [W]: ``int p dQ``."""
        film = self._film
        p = self._film.parameters
        feed = self._fed
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
        """Power of the pressure on oil that fills voids where the film forms again [W].

        The energy balance is the weak form with the pressure of the film as test function; it
        closes only if it contains this power. The power arises in cells that contain the edge of
        the full film, vanishes as the mesh is refined, and is zero without voids.
        """
        if not self._lumped:
            return 0.0
        return float(self._state.pressure @ self._defects[0]) - self._work_at_ends

    @cached_property
    def _fed(self) -> FeedTerm | None:
        return self._film.equation.fed(self._state.gap, lumped=self._lumped)

    @cached_property
    def _feeds(self) -> dict[str, float]:
        """Flow into the film through every supply in `FilmParameters.feeds`, by name [m3/s]."""
        film = self._film
        p = self._film.parameters
        feed = self._fed
        if feed is None:
            return {}
        pressure = film.assembly.at_points(self._state.pressure / p.pressure_scale)[0]
        flows = -np.sum(film.assembly.area * feed.outflow(pressure), axis=(1, 2))
        unit = p.clearance * p.grid.radius**2 * p.rate
        return {f.name: float(unit * flow) for f, flow in zip(p.feeds, flows, strict=True)}

    @cached_property
    def _inflow(self) -> np.ndarray:
        """Flow into the film at nodes of given pressure, shape (nodes,) [m3/s].

        At the other nodes the entries are the growth of the cavities; with mass-conserving
        cavitation they are zero.
        """
        outflow = self._state.outflow
        return self._defects[0] if outflow is None else -outflow

    @cached_property
    def _work_at_ends(self) -> float:
        """Power of the oil that flows in at nodes of given pressure, ``sum p Q`` [W]."""
        fixed = np.ones(self._film.assembly.size, dtype=bool)
        fixed[self._film.free] = False
        return float(self._state.pressure[fixed] @ self._inflow[fixed])

    @cached_property
    def _defects(self) -> tuple[np.ndarray, float]:
        """Residual of the flow balance at every node, and rate of the gap's volume [m3/s]."""
        film = self._film
        p = self._film.parameters
        feed = self._fed
        gap = self._state.gap
        nodal = self._state.pressure / p.pressure_scale
        inputs = film.equation.inputs(gap, supplied=not self._lumped)
        defect = film.equation.balance(inputs, nodal)
        if feed is not None and self._lumped:
            defect += feed.lumped(film.assembly, nodal)
        flow = film.flow(self._state)
        unit = p.grid.radius**2
        growth = np.sum(film.assembly.area * flow.density * flow.slope * gap.thickness_rate)
        return p.clearance * p.rate * unit * defect, float(unit * growth)


def under_pressure(film: Film) -> bool:
    """Whether a film has supplies, or nodes with a given pressure above the cavitation pressure."""
    return bool(film.parameters.feeds) or bool(np.any(film.equation.given))


def _side_inflow(film: Film, defect: np.ndarray, region: np.ndarray, end: float) -> np.ndarray:
    """Flow into a film through one side, for each edge of a cell on this side [m3/s].

    The edges are in their order around the bore. With 4-node cells there is one entry for every
    node of the side instead.

    Parameters
    ----------
    film
        The film.
    defect
        Flow into the film at every node, shape (nodes,) [m3/s].
    region
        Mask of the nodes in supply regions, whose flow does not count, shape (nodes,).
    end
        Height z of the side [m].
    """
    grid = film.parameters.grid
    angle, height = grid.node_positions.T
    nodes = np.flatnonzero(np.abs(height - end) <= SLACK * grid.radius)
    inflow = np.where(region[nodes], 0.0, defect[nodes])[np.argsort(angle[nodes])]
    if grid.family == "bilinear":
        return inflow
    corner = inflow[::2]
    middle = inflow[1::2]
    return 0.5 * (corner + np.roll(corner, -1)) + middle
