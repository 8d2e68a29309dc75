"""Where the pressure is given: sides, axial grooves and supply holes, (9) and (10)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.grid import FilmGrid

#: Slack in deciding whether a node lies in a region, relative to the radius.
SLACK = 1e-9


def _pressure(name: str, value: float) -> None:
    if not (np.isfinite(value) and value >= 0):
        raise SettingsError(
            f"{name} = {value:g} Pa must be at least 0, the pressure at which the film cavitates"
        )


@dataclass(frozen=True)
class Sides:
    """Pressure at the two ends of the bearing.

    Attributes
    ----------
    lower, upper
        Ambient pressure at ``z = -B/2`` and ``z = B/2`` [Pa], above the
        cavitation pressure; None for a closed side, through which nothing flows.
    """

    lower: float | None = 0.0
    upper: float | None = 0.0

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            value = getattr(self, name)
            if value is not None:
                _pressure(f"the ambient pressure at the {name} side", value)


class Region(Protocol):
    """Part of the bore with a given pressure."""

    @property
    def pressure(self) -> float:
        """Given pressure [Pa]."""

    def contains(self, angle: np.ndarray, height: np.ndarray, radius: float) -> np.ndarray:
        """Whether points, at angles [rad] and heights [m], lie in the region."""


@dataclass(frozen=True)
class AxialGroove:
    """Axial groove over the whole width, or part of it.

    Attributes
    ----------
    angle, width
        Middle and extent along the circumference [rad]; a width of zero is a line.
    pressure
        Supply pressure [Pa].
    length
        Extent along the axis, centred [m]; None: the whole width.
    """

    angle: float
    width: float
    pressure: float = 0.0
    length: float | None = None

    def __post_init__(self) -> None:
        _pressure("the pressure of a groove", self.pressure)
        if not 0 <= self.width < 2 * np.pi:
            raise SettingsError(
                f"a groove {np.degrees(self.width):g} degrees wide: it must lie in 0..360"
            )

    @property
    def edges(self) -> tuple[float, ...]:
        """Angles that should be cell boundaries [rad]."""
        half = 0.5 * self.width
        return (self.angle - half, self.angle + half) if half else (self.angle,)

    def contains(self, angle: np.ndarray, height: np.ndarray, radius: float) -> np.ndarray:
        """See `Region`."""
        offset = np.abs(np.mod(angle - self.angle + np.pi, 2 * np.pi) - np.pi)
        inside = offset <= 0.5 * self.width + SLACK
        if self.length is not None:
            inside &= np.abs(height) <= 0.5 * self.length + SLACK * radius
        return inside


@dataclass(frozen=True)
class SupplyHole:
    """Round hole of given pressure: centre at an angle [rad] and a height [m], radius [m]."""

    angle: float
    height: float
    hole_radius: float
    pressure: float = 0.0

    def __post_init__(self) -> None:
        _pressure("the pressure of a supply hole", self.pressure)
        if not self.hole_radius > 0:
            raise SettingsError(f"the radius of a supply hole is {self.hole_radius:g} m")

    def contains(self, angle: np.ndarray, height: np.ndarray, radius: float) -> np.ndarray:
        """See `Region`."""
        arc = radius * (np.mod(angle - self.angle + np.pi, 2 * np.pi) - np.pi)
        return np.hypot(arc, height - self.height) <= self.hole_radius + SLACK * radius


def in_regions(
    regions: Sequence[Region], angle: np.ndarray, height: np.ndarray, radius: float
) -> np.ndarray:
    """Whether points, at angles [rad] and heights [m], lie in any of the regions."""
    inside = np.zeros(np.shape(angle), dtype=bool)
    for region in regions:
        inside |= region.contains(angle, height, radius)
    return inside


def given_pressures(
    grid: FilmGrid, sides: Sides, regions: Sequence[Region]
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes with given pressure.

    Returns
    -------
    fixed : numpy.ndarray of bool
        shape (nodes,).
    pressure : numpy.ndarray
        Their pressure [Pa], zero elsewhere, shape (nodes,).

    Raises
    ------
    SettingsError
        A region holds no node of the mesh, or no node is left.
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
            raise SettingsError(f"no node of the film mesh lies in {region}: use more cells")
        fixed |= inside
        pressure[inside] = region.pressure
    if fixed.all():
        raise SettingsError("every node of the film has a given pressure: use more cells")
    return fixed, pressure
