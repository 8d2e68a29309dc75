"""Paths in a plane over a cycle: the journal in its clearance circle, the polar load diagram."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fenics_ehd.plotting.curves import Curves, Panel, Rows, common_axis, over_cycle, span
from fenics_ehd.plotting.picture import PANEL, legend, plt, style
from fenics_ehd.plotting.shown import ShownJoint

#: Panels in a row.
ACROSS = 3

#: Circles of a diagram at most, and instants that are marked on a path over time.
RINGS, INSTANTS = 5, 8

#: Smallest distance of two labels, over the radius of the diagram.
APART = 0.16

#: Distance of a label from its dot; beyond the second share of that radius it lies inwards.
BESIDE, INWARDS = 0.07, 0.8


@dataclass(frozen=True)
class Paths:
    """A vector over a cycle as a curve, a panel for every joint.

    Attributes
    ----------
    label
        Of the vector's size, its unit in brackets.
    vector
        Of columns, in that unit, in the frame of the bore, shape (t,), y the imaginary part.
    needed
        Columns that it takes.
    bound
        What the circle of size one is called, empty without any.
    """

    label: str
    vector: Callable[[Mapping[str, np.ndarray]], np.ndarray]
    needed: tuple[str, ...]
    bound: str = ""

    def has(self, joint: ShownJoint) -> bool:
        """Whether there is anything to draw."""
        return all(column in joint.columns for column in self.needed)

    def draw(self, rows: Rows) -> Figure:
        """The figure."""
        across = min(len(rows), ACROSS)
        down = -(-len(rows) // across)
        figure, axes = plt.subplots(
            down, across, figsize=(PANEL * across, (PANEL + 0.6) * down),
            layout="constrained", squeeze=False, subplot_kw={"projection": "polar"},
        )  # fmt: skip
        for place in axes.flat[len(rows) :]:
            place.remove()
        for place, (title, joints) in zip(axes.flat, rows.items(), strict=False):
            self._draw(place, joints)
            place.set_title(title, loc="left", fontweight="bold")
        return figure

    def difference(self, rows: Rows) -> Figure:
        """The figure of the second run's components less the first's, over the cycle."""
        panel = Panel(self.label, {"vector_x": "x", "vector_y": "y"})
        components = {
            title: [replace(j, columns={**j.columns, **self._components(j)}) for j in joints]
            for title, joints in rows.items()
        }
        return Curves((panel,)).difference(components)

    def _components(self, joint: ShownJoint) -> dict[str, np.ndarray]:
        vector = self.vector(joint.columns)
        return {"vector_x": vector.real, "vector_y": vector.imag}

    def _draw(self, axes: Axes, joints: Sequence[ShownJoint]) -> None:
        over, largest = common_axis(joints), float(bool(self.bound))
        found = [over_cycle(joint, self.vector(joint.columns), over) for joint in joints]
        largest = max([largest, *(np.abs(vector).max() for _, vector in found)])
        taken = [vector for _, vector in found]
        for number, (joint, (x, vector)) in enumerate(zip(joints, found, strict=True)):
            label = joint.run.name if len(joints) > 1 else None
            axes.plot(np.unwrap(np.angle(vector)), np.abs(vector), label=label, **style(number))
            taken.append(_mark(axes, x, vector, number, span(over, joints), largest))
        if self.bound:
            around = np.linspace(0, 2 * np.pi, 361)
            axes.plot(around, np.ones(361), color="0.2", linewidth=1.6, label=self.bound)
        axes.set_ylim(0, largest * (1.03 if largest > 1.0 or not self.bound else 1.0))
        axes.set_xticks(np.radians(np.arange(0, 360, 45)))
        axes.yaxis.set_major_locator(MaxNLocator(RINGS, steps=[1, 2, 2.5, 5, 10], prune="lower"))
        axes.set_rlabel_position(_free_direction(taken, axes.get_yticks()))
        axes.tick_params(axis="y", labelsize=8, labelcolor="0.3")
        axes.set_xlabel(f"{self.label},\nangles from the x axis of the bore's body")
        legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=2, frameon=False)


def orbit(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Place of the journal in the bore as it is, over the clearance."""
    x, y = (columns[f"eccentricity_in_bore_{axis}_m"] for axis in "xy")
    return columns["eccentricity_ratio"] * np.exp(1j * np.arctan2(y, x))


def load(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Load of the journal on the bore [kN]."""
    return 1e-3 * columns["force_N"] * np.exp(1j * np.radians(columns["force_angle_deg"]))


def _mark(
    axes: Axes, x: np.ndarray, vector: np.ndarray, number: int, apart: float, largest: float
) -> np.ndarray:
    """Dots at some instants, those of the first curve labelled where there is room.

    Returns
    -------
    numpy.ndarray
        Places of the labels.
    """
    instants = np.arange(np.ceil(x[0] / apart - 1e-6), np.floor(x[-1] / apart + 1e-6) + 1) * apart
    places = np.interp(instants, x, vector.real) + 1j * np.interp(instants, x, vector.imag)
    colour = style(number)["color"]
    axes.plot(np.angle(places), np.abs(places), "o", color=colour, markersize=3.5)
    told: list[complex] = []
    labels: list[complex] = []
    for instant, place in zip(instants, places, strict=True):
        if number or any(abs(place - other) < APART * largest for other in told):
            continue
        told.append(place)
        away = np.exp(1j * np.angle(place)) * (-1 if abs(place) > INWARDS * largest else 1)
        labels.append(place + BESIDE * largest * away)
        axes.annotate(
            f"{instant + 0.0:g}", (np.angle(place), abs(place)), (9 * away.real, 8 * away.imag),
            textcoords="offset points", ha="center", va="center", fontsize=7.5, color=colour,
        )  # fmt: skip
    return np.array(labels)


def _free_direction(taken: Sequence[np.ndarray], rings: np.ndarray) -> float:
    """Direction in which the figures of the circles hide least [degrees]."""
    directions = np.setdiff1d(np.arange(0.0, 360.0, 7.5), np.arange(0.0, 361.0, 45.0))
    figures = np.exp(1j * np.radians(directions))[:, None] * rings
    near = [np.abs(figures[..., None] - own).min(axis=-1) for own in taken if len(own)]
    return float(directions[np.argmax(np.min(near, axis=0).min(axis=1))])


def clearance_circle(axes: Axes) -> None:
    """Where the journal's centre is, over the clearance, in the frame of the bore."""
    for radius in (0.25, 0.5, 0.75, 1.0):
        ring = {"color": "0.2", "lw": 1.6} if radius == 1.0 else {"color": "0.85", "lw": 0.8}
        axes.add_patch(plt.Circle((0, 0), radius, fill=False, **ring))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="eccentricity x / c", ylabel="eccentricity y / c")
