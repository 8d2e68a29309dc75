"""Parameters of a film, and supplies that conduct oil into it.

A film is made of a mesh, a clearance, an oil and given pressures. A supply conducts oil into the
film through a region of the bore, or of the journal, with which it turns. The flow into the film
per area is

    w kappa (p_s - p)

with the supply pressure p_s and the share w to which the region covers a point: 1 within the region
and 0 outside. The edge of the region is blurred over a width d of `BLUR` cells by the cubic
``t^2 (3 - 2 t)``, so that w is continuously differentiable with respect to the journal's angle. No
pressure is imposed at nodes: load and flow are continuous functions of the position of a moving
region.

Without a resistance, kappa is the film's own conductance on the scale of the blur, ``kappa = C rho
h^3 / (12 eta d^2)``. C is such that the pressure next to a straight edge is that of a region with p
= p_s up to the edge itself (`EDGES`). With a hydraulic resistance of the passage that leads to the
region, kappa is uniform and ``int w kappa dA = 1 / resistance``: the flow is ``(p_s - mean p) /
resistance`` to round-off, with the mean weighted by w. Viscosity and density in kappa are those at
ambient pressure.

`fenics_ehd.film.supply` imposes pressures at nodes of the bore instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from fenics_ehd.base.arguments import require_class, require_number
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.assembly import Assembly, with_weights
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.kinematics import Gap, SurfacePoints, require_read
from fenics_ehd.film.lubricant import Lubricant
from fenics_ehd.film.rough_surfaces import RoughSurfaces
from fenics_ehd.film.supply import AxialGroove, Sides, Supply, blur_of, check_supply, covered


@dataclass(frozen=True, eq=False)
class FilmParameters(Described):
    """Parameters of the film of one bearing.

    Attributes
    ----------
    grid
        Film mesh: bore radius, width, cells and element family.
    clearance
        Radial clearance c [m].
    lubricant
        The oil.
    rate
        Reference angular speed Omega > 0 [rad/s] that makes the equation dimensionless; it changes
        results by round-off only.
    sides, regions
        Pressures at the two ends of the bearing, and axial grooves of given pressure.
    feeds
        Supplies that conduct oil into the film.
    recesses
        Deep recesses of the bore without supply: their pressure is uniform, and inflow equals
        outflow.
    surfaces
        Rough surfaces of journal and bore; None for smooth surfaces, which never touch.
    """

    grid: FilmGrid
    clearance: float
    lubricant: Lubricant
    rate: float
    sides: Sides = field(default_factory=Sides)
    regions: tuple[AxialGroove, ...] = ()
    feeds: tuple[Supply, ...] = ()
    recesses: tuple[Supply, ...] = ()
    surfaces: RoughSurfaces | None = None

    def __post_init__(self) -> None:
        require_class("grid", self.grid, FilmGrid)
        require_class("lubricant", self.lubricant, Lubricant)
        require_class("sides", self.sides, Sides)
        require_class("surfaces", self.surfaces, RoughSurfaces, optional=True)
        for name, cls in (("regions", AxialGroove), ("feeds", Supply), ("recesses", Supply)):
            require_class(name, getattr(self, name), tuple, list)
            for i, entry in enumerate(getattr(self, name)):
                require_class(f"{name}[{i}]", entry, cls)
        for name in ("clearance", "rate"):
            require_number(name, getattr(self, name), above=0)
        if not np.finfo(float).tiny < self.pressure_scale < np.inf:
            raise SettingsError(
                f"viscosity = {self.lubricant.viscosity:g} Pa s at {self.rate:g} rad/s gives "
                f"pressures of the order of {self.pressure_scale:g} Pa, which cannot be computed: "
                "check the units"
            )
        if not self.clearance < self.grid.radius:
            raise SettingsError(
                f"clearance = {self.clearance:g} m must be below the radius {self.grid.radius:g} m"
            )

    @property
    def pressure_scale(self) -> float:
        """Unit of the dimensionless pressure, ``p_s = 12 eta Omega (R / c)^2`` [Pa].

        eta is the viscosity at ambient pressure, Omega the reference angular speed, R the bore
        radius and c the clearance.
        """
        ratio = self.grid.radius / self.clearance
        return 12 * self.lubricant.viscosity * self.rate * ratio**2


#: Constant ``C = kappa d^2`` over the film's mobility, for each element family. With it the
#: pressure outside a region extrapolates to p_s at the given edge. The solution of ``q'' = C w q``,
#: with ``q = p_s - p``, decays into the region, and its tangent outside is zero at the edge for C =
#: 33.1. A quarter of this value moves the effective edge by 0.24 d inward, four times the value by
#: 0.15 d outward. The load error for the groove of `BLUR` on 40 x 10, 80 x 20, 160 x 40 and 320 x
#: 80 cells is 0.9, 0.27, 0.08 and 0.02 %; with C = 1000 it is 9.3, 4.6, 2.3 and 1.2 %. Bilinear
#: cells resolve the decay less: their value was measured next to a groove all around. There the
#: error of the edge is 0.012 d with 9 nodes, 0.012 d with 4 nodes, and 0.035 d with lumped flows;
#: with 33.1 it would be 0.05 d with 4 nodes, and 0.18 d with lumped flows.
EDGES = {"lagrange": 33.119152, "serendipity": 33.119152, "bilinear": 24.0}

#: Factor on the constant of `EDGES` if flows are lumped at the nodes.
LUMPED = 2.0 / 3.0


@dataclass(frozen=True, eq=False)
class FeedTerm:
    """Term of n oil supplies in the Reynolds equation of a film, dimensionless.

    Attributes
    ----------
    conductance
        Flow per area and pressure difference from every supply into the film at the Gauss points,
        ``kappa w``, shape (n, cells, points).
    along_thickness, along_turn
        Derivatives of the conductance with respect to the film thickness H and to the angle of the
        journal [1/rad], shape (n, cells, points) each.
    pressure
        Dimensionless pressure P_s of every supply, shape (n,).
    """

    conductance: np.ndarray
    along_thickness: np.ndarray
    along_turn: np.ndarray
    pressure: np.ndarray

    def outflow(self, pressure: np.ndarray, conductance: np.ndarray | None = None) -> np.ndarray:
        """Flow per area out of the film into each of n supplies, shape (n, cells, points).

        It is ``kappa w (P - P_s)``, with the conductance ``kappa w``, the film pressure P at the
        Gauss points (`pressure`) and the supply pressure P_s. If `conductance` is given, it
        replaces ``kappa w``; a derivative of the conductance gives that of the flow.
        """
        conductance = self.conductance if conductance is None else conductance
        return conductance * (pressure - self.pressure[:, None, None])

    def _supplied(self, conductance: np.ndarray) -> np.ndarray:
        """Flow per area from all supplies into a film without pressure, shape (cells, points)."""
        flow = self.pressure @ conductance.reshape(len(conductance), -1)
        return flow.reshape(conductance.shape[1:])

    def lumped(
        self, assembly: Assembly, nodal: np.ndarray, conductance: np.ndarray | None = None
    ) -> np.ndarray:
        """Flow out of the film into all supplies together, lumped at the nodes, shape (nodes,).

        The flow is integrated with the shape function of every node. The pressure at that node
        replaces the pressures at the Gauss points, so that the film's matrix remains an M-matrix.
        If `conductance` is given, it replaces the conductance ``kappa w`` of the supplies; a
        derivative of the conductance gives that of the flow.
        """
        conductance = self.conductance if conductance is None else conductance
        supplied = self._supplied(conductance)
        return assembly.source(conductance.sum(axis=0)) * nodal - assembly.source(supplied)

    def lumped_change(
        self, assembly: Assembly, slope: np.ndarray, nodal: np.ndarray
    ) -> sparse.csc_matrix:
        """Derivative of the flow `lumped` with respect to a quantity, such as the thickness.

        The quantity has a value at each of the q Gauss points of c cells: the derivative has the
        shape (nodes, c * q). `slope` is the derivative of the conductances with respect to it.
        """
        at_nodes = slope.sum(axis=0)[:, :, None] * assembly.by_nodes(nodal)
        supplied = self._supplied(slope)
        return with_weights(assembly.tested, at_nodes - supplied[:, :, None])


def _require_head(feed: Supply) -> None:
    """Refuse a `head_radius` without the function `head`, which scenes make from it."""
    if any(feed.head_radius) and feed.head is None:
        raise SettingsError(
            f"{feed.name}: head_radius = {list(feed.head_radius)} has no effect here: give head, a "
            "function of time [s] that returns the pressure rise [Pa]"
        )


class Feeds:
    """All oil supplies of one film, with their conductances.

    Parameters
    ----------
    parameters
        Parameters of the film, with its `feeds`.
    points, area
        Gauss points of the film mesh, and their areas over R^2.
    mobility
        Dimensionless density over viscosity at ambient pressure: a number, or an array at the Gauss
        points.

    Raises
    ------
    SettingsError
        If a region does not fit into the bearing or its mesh, two supplies have the same name, or
        the table of a supply was not read.
    """

    def __init__(
        self,
        parameters: FilmParameters,
        points: SurfacePoints,
        area: np.ndarray,
        mobility: np.ndarray | float,
    ):
        self.parameters = parameters
        self._points = points
        self._area = area
        grid = parameters.grid
        feeds = parameters.feeds
        names = [feed.name for feed in feeds]
        if len(set(names)) < len(names):
            raise SettingsError(
                f"supplies have the names {', '.join(map(repr, sorted(names)))}: give each a "
                "different name"
            )
        for feed in feeds:
            require_read(feed.table, feed.curve, f"{feed.name}: table")
            _require_head(feed)
        # A supply has either the film's own conductance, stored over w H^3, or that of its passage,
        # the pressure scale over the resistance, in units of the flow c Omega R^2.
        self._film = np.zeros((len(feeds), *area.shape))
        self._passage = np.zeros((len(feeds), 1, 1))
        flow = parameters.clearance * parameters.rate * grid.radius**2
        for i, feed in enumerate(feeds):
            check_supply(feed.name, feed, grid)
            if feed.resistance:
                self._passage[i] = parameters.pressure_scale / (feed.resistance * flow)
            else:
                scale = grid.radius / blur_of(feed, grid)
                self._film[i] = EDGES[grid.family] * scale**2 * mobility
        self._turn = np.nan

    @property
    def turning(self) -> bool:
        """Whether at least one supply turns with the journal."""
        return any(feed.on_journal for feed in self.parameters.feeds)

    def shares(self, turn: float) -> tuple[np.ndarray, np.ndarray]:
        """Shares w to which n supplies cover the Gauss points, and their derivatives [1/rad].

        Both arrays have the shape (n, cells, points); w is 1 within a supply and 0 outside. The
        derivatives are those with respect to `turn`, the angle of the journal relative to the bore
        [rad].
        """
        grid = self.parameters.grid
        values = []
        slopes = []
        for feed in self.parameters.feeds:
            value, slope = covered(feed, grid, self._points, turn * feed.on_journal)
            values.append(value)
            slopes.append(slope * feed.on_journal)
        return np.array(values), np.array(slopes)

    def _at(self, turn: float) -> tuple[np.ndarray, ...]:
        """Conductances of all n supplies at an angle of the journal [rad], cached for one angle.

        Four arrays, shape (n, cells, points): conductances of the supplies without a resistance,
        over the cubed thickness; conductances of the supplies with a resistance; and the
        derivatives of both with respect to the angle [1/rad].
        """
        if turn != self._turn:
            share, slope = self.shares(turn)
            area, change = (
                np.sum(self._area * values, axis=(1, 2), keepdims=True) for values in (share, slope)
            )
            passage = self._passage * share / area
            passage_slope = self._passage * slope / area - passage * change / area
            self._kept = self._film * share, passage, self._film * slope, passage_slope
            self._turn = turn
        return self._kept

    def _pressure(self, time: float) -> np.ndarray:
        """Dimensionless supply pressures at a time [s], shape (n,)."""
        pressure = np.array([feed.pressure_at(time) for feed in self.parameters.feeds])
        return pressure / self.parameters.pressure_scale

    def term(self, gap: Gap, thickness: np.ndarray, *, lumped: bool = False) -> FeedTerm:
        """Term of the supplies in the Reynolds equation for a gap.

        The gap has the angle of the journal and the time. `thickness` is the dimensionless
        thickness H at the Gauss points. `lumped` adapts conductances to flows that are lumped at
        the nodes (`FeedTerm.lumped`).
        """
        film, passage, film_slope, passage_slope = self._at(gap.turn)
        cube = (LUMPED if lumped else 1.0) * thickness**3
        of_film = film * cube
        return FeedTerm(
            of_film + passage,
            3.0 * of_film / thickness,
            film_slope * cube + passage_slope,
            self._pressure(gap.time),
        )

    def values(self, gap: Gap) -> np.ndarray:
        """Conductances of the supplies for the weak form, summed, shape (4, cells, points).

        The first two fields are sums over the supplies without a resistance: conductance over H^3,
        and conductance over H^3 times supply pressure, with the thickness H. The last two are sums
        over the supplies with a resistance: conductance, and conductance times supply pressure.
        """
        film, passage, *_ = self._at(gap.turn)
        weights = np.array([np.ones(len(film)), self._pressure(gap.time)])
        return np.concatenate([np.tensordot(weights, kind, 1) for kind in (film, passage)])


#: Conductance of a recess over that of the film: with 1e3, pressure slopes in a recess are a
#: thousandth of those in the film.
DEEP = 1e3


def recess_viscosity(parameters: FilmParameters, points: SurfacePoints) -> np.ndarray:
    """Factor on the viscosity at the Gauss points that models `FilmParameters.recesses`.

    The factor falls linearly with the covered share, from 1 to `1 / DEEP` within a recess.

    Raises
    ------
    SettingsError
        If a recess does not fit into the bearing or its mesh.
    """
    factor = np.ones(points.angle.shape)
    for region in parameters.recesses:
        check_supply("a hole of the bore without supply", region, parameters.grid)
        share, _ = covered(region, parameters.grid, points)
        factor *= 1.0 - (1.0 - 1.0 / DEEP) * share
    return factor
