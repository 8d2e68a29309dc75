"""Maps over the unwrapped bore of what a cycle did at every place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fenics_ehd.plotting.curves import Rows
from fenics_ehd.plotting.picture import WIDTH, plt, with_unit
from fenics_ehd.plotting.shown import TIME, ShownJoint

#: Colours at most.
LEVELS = 12

#: Height of a map [inches].
HEIGHT = 2.5


class Raster(NamedTuple):
    """Values over angle [degrees] and height [mm], shape (b, a), (a,), (b,); what is marked."""

    values: np.ndarray
    angle: np.ndarray
    height: np.ndarray
    title: str
    mark: tuple[float, float, float]


@dataclass(frozen=True)
class Map:
    """A field over bore angle and width, a panel for every joint and run.

    Attributes
    ----------
    label
        Of the colours, its unit in brackets.
    nodal
        Values at the film's nodes of all steps and times, shape (t, k), to one for the cycle.
    fields
        Which of a film's.
    factor
        To that unit.
    colours
        Their name.
    marked
        Columns of the extreme that is marked, of its angle [degrees] and height [m]: what is seen
        between the nodes counts too. Empty: the largest value at them.
    """

    label: str
    fields: str
    nodal: Callable[[np.ndarray, np.ndarray], np.ndarray]
    factor: float
    colours: str
    marked: tuple[str, ...] = ()

    def has(self, joint: ShownJoint) -> bool:
        """Whether there is anything to draw."""
        return getattr(joint.film, self.fields) is not None

    def draw(self, rows: Rows) -> Figure:
        """The figure, all runs of a joint in the same colours."""
        panels = []
        for title, joints in rows.items():
            found = [self.raster(j, _title(title, j, len(joints))) for j in joints]
            low = min(r.values.min() for r in found) if self.fields == "gap" else 0.0
            levels = _levels(low, max(r.values.max() for r in found))
            panels += [(raster, levels) for raster in found]
        return self._figure(panels, self.colours)

    def raster(self, joint: ShownJoint, title: str) -> Raster:
        """Of one joint, at the lines of its mesh."""
        film = joint.film
        values = getattr(film, self.fields)
        nodal = self.factor * self.nodal(values, joint.columns[TIME][: len(values)])
        angle, height = (np.unique(x.round(9)) for x in film.grid.node_positions.T)
        angle = np.unique(np.append((np.degrees(angle) + 180.0) % 360.0 - 180.0, [-180.0, 180.0]))
        height = 1e3 * height
        around, along = (x.ravel() for x in np.meshgrid(np.radians(angle), 1e-3 * height))
        found = (film.grid.interpolation(around, along) @ nodal).reshape(len(height), len(angle))
        return Raster(found, angle, height, title, self._mark(joint, found, angle, height))

    def _mark(
        self, joint: ShownJoint, values: np.ndarray, angle: np.ndarray, height: np.ndarray
    ) -> tuple[float, float, float]:
        """Value, angle and height of what is marked."""
        if not self.marked:
            return _largest(values, angle, height)
        column, *place = (joint.columns[name] for name in self.marked)
        step = column.argmin() if self.fields == "gap" else column.argmax()
        return self.factor * column[step], place[0][step], 1e3 * place[1][step]

    def _figure(self, panels: list[tuple[Raster, np.ndarray]], colours: str) -> Figure:
        figure, places = plt.subplots(
            len(panels), figsize=(WIDTH, HEIGHT * len(panels) + 0.5), layout="constrained",
            sharex=True, squeeze=False,
        )  # fmt: skip
        for axes, (raster, levels) in zip(places.flat, panels, strict=True):
            values, angle, height, title, (value, where, z) = raster
            image = axes.contourf(angle, height, values, levels, cmap=colours)
            axes.contour(angle, height, values, levels, colors="0.2", linewidths=0.4)
            axes.plot(where, z, "o", markerfacecolor="white", markeredgecolor="black",
                      clip_on=False)  # fmt: skip
            place = f"at {where:.0f}°, z = {z + 0.0:.3g} mm"
            axes.set_title(f"{with_unit(value, self.label)} {place}", loc="right")
            axes.set_title(title, loc="left", fontweight="bold")
            axes.set(ylabel="z [mm]", xticks=np.arange(-180, 181, 45))
            axes.grid(False)
            figure.colorbar(image, ax=axes, label=self.label, pad=0.02)
        axes.set_xlabel("angle on the bore from its body's x axis, from x to y [°]")
        return figure


def _levels(low: float, high: float) -> np.ndarray:
    """Values between two colours."""
    return MaxNLocator(LEVELS).tick_values(low, high if high > low else low + 1.0)


def _largest(
    values: np.ndarray, angle: np.ndarray, height: np.ndarray
) -> tuple[float, float, float]:
    row, column = np.unravel_index(np.argmax(np.abs(values)), values.shape)
    return values[row, column], angle[column], height[row]


def _title(title: str, joint: ShownJoint, runs: int) -> str:
    return ", ".join(filter(None, (title, joint.run.name if runs > 1 else "")))


def least(values: np.ndarray, _: np.ndarray) -> np.ndarray:
    """Of all instants at every node."""
    return values.min(axis=0)


def most(values: np.ndarray, _: np.ndarray) -> np.ndarray:
    """Of all instants at every node."""
    return values.max(axis=0)
