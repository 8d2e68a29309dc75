"""Supplies of a film: sides and axial grooves of given pressure, and regions that conduct oil.

Sides and axial grooves are boundaries of given pressure, (9) and (10). A region of the bore or of
the journal that conducts oil is described by its covered share at every point of the film: 1 within
the region, 0 outside. `fenics_ehd.film.parameters` computes the inflow from it. Angles are counted
from the x axis of the body with the bore, or of the one with the journal, positive from x to y.
Heights along the axis are counted from the middle of the bore.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import radians

import attrs
import numpy as np

from fenics_ehd.base.arguments import require_number
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import LARGEST_LENGTH, REQUIRED, choice, number, pair, text
from fenics_ehd.base.needs import NONE, not_with
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.kinematics import SurfacePoints

#: Tolerance for nodes on the edge of a region to count as inside, relative to the radius.
SLACK = 1e-9


def _pressure(name: str, value: float) -> None:
    if not require_number(name, value) >= 0:
        raise SettingsError(
            f"{name} = {value:g} Pa must be at least 0, the pressure at which the film cavitates"
        )


@dataclass(frozen=True)
class Sides(Described):
    """Pressure at the two ends of the bearing.

    Attributes
    ----------
    lower, upper
        Ambient pressure at ``z = -B/2`` and ``z = B/2``, relative to the cavitation pressure [Pa];
        None for a closed side, through which nothing flows.
    """

    lower: float | None = 0.0
    upper: float | None = 0.0

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            value = getattr(self, name)
            if value is not None:
                _pressure(f"the ambient pressure at the {name} side", value)


@dataclass(frozen=True)
class AxialGroove(Described):
    """Axial groove of given pressure, over the whole width of the bearing or a part of it.

    Attributes
    ----------
    angle, width
        Angle of the middle, and extent along the circumference [rad]; a groove of width zero is a
        line.
    pressure
        Supply pressure [Pa].
    length
        Extent along the axis, from the middle of the bore in both directions [m]; None for the
        whole width.
    """

    angle: float
    width: float
    pressure: float = 0.0
    length: float | None = None

    def __post_init__(self) -> None:
        _pressure("the pressure of a groove", self.pressure)
        require_number("the angle of a groove", self.angle)
        if self.length is not None:
            require_number("the length of a groove", self.length, above=0)
        require_number("the width of a groove", self.width)
        if not 0 <= self.width < 2 * np.pi:
            raise SettingsError(
                f"a groove is {np.degrees(self.width):g} degrees wide: its width must be at least "
                "0 and below 360 degrees"
            )

    @property
    def edges(self) -> tuple[float, ...]:
        """Angles of the groove's two edges [rad], or its one angle if it has no width.

        They should be cell boundaries of the film's mesh.
        """
        half = 0.5 * self.width
        return (self.angle - half, self.angle + half) if half else (self.angle,)

    def contains(self, angle: np.ndarray, height: np.ndarray, radius: float) -> np.ndarray:
        """Mask of the points, at angles [rad] and heights [m], that lie in the groove."""
        offset = np.abs(np.mod(angle - self.angle + np.pi, 2 * np.pi) - np.pi)
        inside = offset <= 0.5 * self.width + SLACK
        if self.length is not None:
            inside &= np.abs(height) <= 0.5 * self.length + SLACK * radius
        return inside


def in_regions(
    regions: Sequence[AxialGroove], angle: np.ndarray, height: np.ndarray, radius: float
) -> np.ndarray:
    """Mask of the points, at angles [rad] and heights [m], that lie in any of the grooves."""
    inside = np.zeros(np.shape(angle), dtype=bool)
    for region in regions:
        inside |= region.contains(angle, height, radius)
    return inside


def given_pressures(
    grid: FilmGrid, sides: Sides, regions: Sequence[AxialGroove]
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of a film mesh with given pressure, at its sides and in grooves.

    Returns
    -------
    fixed : numpy.ndarray of bool
        Mask of the nodes with given pressure, shape (nodes,).
    pressure : numpy.ndarray
        Pressure of these nodes [Pa], zero at other nodes, shape (nodes,).

    Raises
    ------
    SettingsError
        If a groove contains no node of the mesh, or every node has a given pressure.
    """
    angle, height = grid.node_positions.T
    fixed = np.zeros(len(angle), dtype=bool)
    pressure = np.zeros(len(angle))
    for end, value in ((grid.heights[0], sides.lower), (grid.heights[-1], sides.upper)):
        if value is not None:
            at_end = np.abs(height - end) <= SLACK * grid.radius
            fixed |= at_end
            pressure[at_end] = value
    for region in regions:
        inside = region.contains(angle, height, grid.radius)
        if not inside.any():
            raise SettingsError(f"{region} contains no node of the film mesh: use more cells")
        fixed |= inside
        pressure[inside] = region.pressure
    if fixed.all():
        raise SettingsError("every node of the film has a given pressure: use more cells")
    return fixed, pressure


TURN = 2 * np.pi


def step(distance: np.ndarray, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Covered share at a distance from the edge of a region, and its derivative [1/m].

    `distance` is positive outside the region [m]. The share falls from 1 inside to 0 outside by a
    cubic over the width `blur` [m], half of which lies on either side of the edge.
    """
    t = np.clip(0.5 - distance / blur, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t), -6.0 * t * (1.0 - t) / blur


#: What surrounds sides at cavitation pressure: with oil, they are reservoirs.
AMBIENTS = ("air", "oil")

#: Surfaces in which a supply may be.
SURFACES = ("bore", "journal")


@dataclass(frozen=True)
class Head:
    """Pressure rise of oil in a drilling of a turning body: ``rho (r2^2 - r1^2) w^2 / 2``.

    Attributes
    ----------
    radii
        Distances r1 and r2 of the drilling's begin and end from the axis of rotation [m].
    density
        Density rho of the oil [kg/m3].
    motion
        Function of time [s]: angle [rad] and angular speed w [rad/s] of the body.
    """

    radii: tuple[float, float]
    density: float
    motion: Callable[[float], tuple[float, float]]

    def __call__(self, time: float) -> float:
        """Pressure rise at a time [s], negative if the drilling leads inward [Pa]."""
        begin, end = self.radii
        _, speed = self.motion(time)
        return 0.5 * self.density * (end**2 - begin**2) * speed**2


@attrs.frozen(kw_only=True)
class Supply(Described):
    """Region of the bore or of the journal through which oil is supplied under pressure."""

    on: str = choice("bore", SURFACES, "the surface that has the supply, which turns with it")
    pressure: float = number(
        0.0,
        "of the supply, above the cavitation pressure [Pa]",
        least=0,
        usual=(1e3, 1e9),
        example="3e5 for 3 bar",
    )
    table: str = text(NONE, "in place of pressure: CSV file time_s,pressure_Pa, or none")
    resistance: float = number(
        0.0,
        "of the passage to the region, pressure over flow [Pa s/m3], 0: none",
        least=0,
        usual=(1e6, 1e16),
        example="3e11 for 1 cm3/s at 3 bar",
    )
    angle: float = not_with(
        number(0.0, "of the middle, from the body's x axis [degrees]"),
        "closed",
        words="a groove all around, extent = 360",
    )
    height: float = number(
        0.0,
        "of the middle, from that of the bore [m]",
        above=-LARGEST_LENGTH,
        below=LARGEST_LENGTH,
    )
    head_radius: tuple[float, float] = pair(
        "distances of the begin and the end of a drilling from the axis about which its body turns "
        "[m]: centrifugal pressure is added; [0, 0]: none",
        below=LARGEST_LENGTH,
    )
    #: Name of the supply and of its flow.
    name: str = ""
    #: Function of time [s] from the table: pressure [Pa] and its derivative [Pa/s]; None without
    #: one.
    curve: Callable[[float], tuple[float, float]] | None = None
    #: Function of time [s] from `head_radius`: pressure rise in the drilling [Pa]; None without it.
    head: Callable[[float], float] | None = None

    @property
    def middle(self) -> float:
        """Angle of the middle of the region [rad]."""
        return radians(self.angle)

    @property
    def on_journal(self) -> bool:
        """Whether the supply turns with the journal."""
        return self.on == "journal"

    def pressure_at(self, time: float) -> float:
        """Supply pressure at the film [Pa] at a time [s], with the pressure rise in a drilling."""
        pressure = self.pressure if self.curve is None else self.curve(time)[0]
        return pressure if self.head is None else pressure + self.head(time)

    def sizes(self, radius: float) -> tuple[float, float]:
        """Smallest lengths of the region, around and along the axis, that cells must resolve [m].

        A length is infinite if the region has no edges in its direction. `radius` is the bore
        radius [m].
        """
        raise NotImplementedError

    @property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest z of the region [m]."""
        _, along = self.sizes(1.0)
        return self.height - 0.5 * along, self.height + 0.5 * along

    def share(
        self, offset: np.ndarray, height: np.ndarray, radius: float, blur: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Share to which the region covers points, and its derivative along `offset` [1/rad].

        The share is 1 within the region and 0 outside.

        Parameters
        ----------
        offset
            Angles of the points from the middle of the region, within half a turn [rad].
        height
            Heights of the points [m].
        radius, blur
            Bore radius, and width of the blurred edge [m].
        """
        raise NotImplementedError


@attrs.frozen(kw_only=True)
class HoleSupply(Supply):
    """Round hole through which oil is supplied."""

    diameter: float = number(
        0.0, "[m]; 0: position and size of the hole in the mesh of a flexible bore, nearest to "
        "angle and height", least=0, below=LARGEST_LENGTH,
    )  # fmt: skip

    def sizes(self, radius: float) -> tuple[float, float]:
        """Diameter of the hole, both around and along the axis [m]."""
        return self.diameter, self.diameter

    def share(
        self, offset: np.ndarray, height: np.ndarray, radius: float, blur: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Share to which the hole covers points, and its derivative, see `Supply.share`."""
        arc = radius * offset
        distance = np.hypot(arc, height - self.height)
        value, slope = step(distance - 0.5 * self.diameter, blur)
        return value, slope * radius * arc / np.maximum(distance, np.finfo(float).tiny)


class GrooveSupply(Supply):
    """Groove with edges along axis and circumference.

    Attributes
    ----------
    extent
        Extent along the circumference [degrees].
    width
        Extent along the axis [m].
    """

    extent: float
    width: float

    @property
    def closed(self) -> bool:
        """Whether the groove extends all around."""
        return self.extent >= 360.0 - 1e-7

    def sizes(self, radius: float) -> tuple[float, float]:
        """Smallest lengths of a groove, around and along the axis, that cells must resolve [m].

        Around, it is the length of the groove or of the land between its ends, if that is shorter.
        It is infinite if the groove is closed.
        """
        if self.closed:
            return np.inf, self.width
        return radius * radians(min(self.extent, 360.0 - self.extent)), self.width

    def share(
        self, offset: np.ndarray, height: np.ndarray, radius: float, blur: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Share to which the groove covers points, and its derivative, see `Supply.share`."""
        along, _ = step(np.abs(height - self.height) - 0.5 * self.width, blur)
        if self.closed:
            return along, np.zeros_like(along)
        around, slope = step(radius * (np.abs(offset) - 0.5 * radians(self.extent)), blur)
        return along * around, along * slope * radius * np.sign(offset)


@attrs.frozen(kw_only=True)
class AxialGrooveSupply(GrooveSupply):
    """Groove along the axis through which oil is supplied."""

    length: float = number(REQUIRED, "along the axis [m]", above=0, below=LARGEST_LENGTH)
    extent: float = number(REQUIRED, "along the circumference [degrees]", above=0, below=360)

    @property
    def width(self) -> float:  # type: ignore[override]
        """Extent along the axis [m]."""
        return self.length


@attrs.frozen(kw_only=True)
class CircumferentialGrooveSupply(GrooveSupply):
    """Groove along the circumference through which oil is supplied."""

    width: float = number(REQUIRED, "along the axis [m]", above=0, below=LARGEST_LENGTH)
    extent: float = number(
        360.0, "along the circumference [degrees], 360: all around", above=0, below=360.0001
    )


#: Width over which the edge of a region is blurred, over the larger side of a cell. Measured with a
#: groove of 36 degrees at an eccentricity of 0.6 (9-node cells, 40 x 10), for widths of 1, 1.5 and
#: 2 cells: turning the groove by one cell changes the load by 0.6, 0.37 and 0.19 % (without groove
#: 0.19 %), and the error of the load is 0.4, 0.9 and 1.5 %.
BLUR = 1.5


def covered(
    region: Supply, grid: FilmGrid, points: SurfacePoints, turn: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Share to which a region covers points, and its derivative with respect to `turn` [1/rad].

    The share is 1 within the region and 0 outside; `turn` is the angle by which the region is
    turned [rad].
    """
    offset = np.mod(points.angle - region.middle - turn + np.pi, TURN) - np.pi
    share, slope = region.share(offset, points.height, grid.radius, blur_of(region, grid))
    return share, -slope


def blur_of(region: Supply, grid: FilmGrid) -> float:
    """Width over which the edge of a region is blurred [m].

    It is `BLUR` cells, but at most the size of the region, and at most twice its distance from a
    side of the bearing.
    """
    sizes = region.sizes(grid.radius)
    cell = max(c for c, size in zip(_cells(grid), sizes, strict=True) if np.isfinite(size))
    return min(BLUR * cell, 2 * _land(region, grid), *sizes)


def _cells(grid: FilmGrid) -> tuple[float, float]:
    """Largest size of the cells around and along the axis [m]."""
    around, along = grid.cell_sizes
    return float(around.max()) * grid.radius, float(along.max()) * grid.radius


def _land(region: Supply, grid: FilmGrid) -> float:
    """Smallest distance of a region from a side of the bearing [m]."""
    bottom, top = region.reach
    return float(min(bottom - grid.heights[0], grid.heights[-1] - top))


def check_supply(name: str, region: Supply, grid: FilmGrid) -> None:
    """Refuse a supply that reaches a side of the bearing, or that the film mesh does not resolve.

    Raises
    ------
    SettingsError
        If the region does not fit; the message starts with `name` and has value and limit.
    """
    low = grid.heights[0]
    high = grid.heights[-1]
    bottom, top = region.reach
    land = _land(region, grid)
    if not land > 0.0:
        raise SettingsError(
            f"{name} reaches from z = {1e3 * bottom:.4g} to {1e3 * top:.4g} mm, the bearing from "
            f"{1e3 * low:.4g} to {1e3 * high:.4g} mm: make {name} smaller or move it, so that land "
            "remains at both sides"
        )
    around, along = region.sizes(grid.radius)
    counts = list(grid.cells)
    breach = ""
    for direction, what, value in (
        (0, "a size", around),
        (1, "a size", along),
        (1, "a land", land),
    ):
        cell = _cells(grid)[direction]
        if value < cell * (1 - 1e-9):
            needed = int(np.ceil(grid.cells[direction] * cell / value - 1e-9))
            counts[direction] = max(counts[direction], needed)
            breach = (
                breach
                or f"{what} of {1e3 * value:.4g} mm, below the cell size of {1e3 * cell:.4g} mm"
            )
    if breach:
        raise SettingsError(f"{name} has {breach}: use cells = {counts} or more")
