"""Shapes of supply regions: the share of the surface that they cover, point by point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.grid import FilmGrid

TURN = 2 * np.pi


def step(distance: np.ndarray, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """1 well within, 0 well outside of an edge at a distance [m]; and the derivative.

    The cubic between them is blurred over `blur` [m], half of it on either side.
    """
    t = np.clip(0.5 - distance / blur, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t), -6.0 * t * (1.0 - t) / blur


class FeedRegion(Protocol):
    """Part of a bore's or a journal's surface."""

    @property
    def angle(self) -> float:
        """Of its middle, from the x axis of the surface's body [rad]."""

    def sizes(self, radius: float) -> tuple[float, float]:
        """Lengths around and along that film cells must resolve [m]; infinite: none."""

    @property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest z [m]."""

    def share(
        self, offset: np.ndarray, height: np.ndarray, radius: float, blur: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Covered share, and its derivative along the offset.

        Points by their angle from the region's middle, within half a turn [rad], and their
        height [m].
        """


@dataclass(frozen=True)
class FeedHole:
    """Round hole: angle [rad] and height [m] of its middle, diameter [m]."""

    angle: float
    height: float
    diameter: float

    def sizes(self, radius: float) -> tuple[float, float]:
        """See `FeedRegion`."""
        return self.diameter, self.diameter

    @property
    def reach(self) -> tuple[float, float]:
        """See `FeedRegion`."""
        return self.height - 0.5 * self.diameter, self.height + 0.5 * self.diameter

    def share(
        self, offset: np.ndarray, height: np.ndarray, radius: float, blur: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `FeedRegion`."""
        arc = radius * offset
        distance = np.hypot(arc, height - self.height)
        value, slope = step(distance - 0.5 * self.diameter, blur)
        return value, slope * radius * arc / np.maximum(distance, np.finfo(float).tiny)


@dataclass(frozen=True)
class FeedGroove:
    """Groove with edges along axis and circumference: angle [rad] and height [m] of its middle.

    Attributes
    ----------
    extent
        Along the circumference [rad]; a whole turn: all around.
    width
        Along the axis [m].
    """

    angle: float
    height: float
    extent: float
    width: float

    @property
    def closed(self) -> bool:
        """Whether it goes all around."""
        return self.extent >= TURN - 1e-9

    def sizes(self, radius: float) -> tuple[float, float]:
        """See `FeedRegion`: what it leaves free around, too."""
        around = np.inf if self.closed else radius * min(self.extent, TURN - self.extent)
        return around, self.width

    @property
    def reach(self) -> tuple[float, float]:
        """See `FeedRegion`."""
        return self.height - 0.5 * self.width, self.height + 0.5 * self.width

    def share(
        self, offset: np.ndarray, height: np.ndarray, radius: float, blur: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `FeedRegion`."""
        along, _ = step(np.abs(height - self.height) - 0.5 * self.width, blur)
        if self.closed:
            return along, np.zeros_like(along)
        around, slope = step(radius * (np.abs(offset) - 0.5 * self.extent), blur)
        return along * around, along * slope * radius * np.sign(offset)


def blur_of(region: FeedRegion, grid: FilmGrid, cells: float) -> float:
    """Width of a region's blurred edge [m]: so many cells, at most its size, twice its land."""
    sizes = region.sizes(grid.radius)
    cell = max(c for c, size in zip(_cells(grid), sizes, strict=True) if np.isfinite(size))
    return min(cells * cell, 2 * _land(region, grid), *sizes)


def _cells(grid: FilmGrid) -> tuple[float, float]:
    """Largest extents of cells around and along [m]."""
    around, along = grid.cell_sizes
    return float(around.max()) * grid.radius, float(along.max()) * grid.radius


def _land(region: FeedRegion, grid: FilmGrid) -> float:
    """Least distance from a side of the bearing [m]."""
    bottom, top = region.reach
    return float(min(bottom - grid.heights[0], grid.heights[-1] - top))


def check_region(name: str, region: FeedRegion, grid: FilmGrid) -> None:
    """Refuse a region that the bearing or its mesh cannot hold.

    Raises
    ------
    SettingsError
        Naming value and limit.
    """
    low, high = grid.heights[0], grid.heights[-1]
    bottom, top = region.reach
    land = _land(region, grid)
    if not land > 0.0:
        raise SettingsError(
            f"{name} reaches from z = {1e3 * bottom:.4g} to {1e3 * top:.4g} mm, the bearing from "
            f"{1e3 * low:.4g} to {1e3 * high:.4g} mm: a region must leave land at both sides, else "
            "its oil runs out there and no film says how much"
        )
    around, along = region.sizes(grid.radius)
    counts, told = list(grid.cells), ""
    for direction, what, value in (
        (0, "a size", around),
        (1, "a size", along),
        (1, "a land", land),
    ):
        cell = _cells(grid)[direction]
        if value < cell * (1 - 1e-9):
            needed = int(np.ceil(grid.cells[direction] * cell / value - 1e-9))
            counts[direction] = max(counts[direction], needed)
            told = (
                told or f"{what} of {1e3 * value:.4g} mm, less than a film cell's {1e3 * cell:.4g}"
            )
    if told:
        raise SettingsError(f"{name} has {told}: use cells = {counts} or more")
