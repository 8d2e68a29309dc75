"""Arrows, angles and frames, the vocabulary of the drawings."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

BORE, SHAFT, FILM, LOAD, AXIS = "#1f3a5f", "#8a8f98", "#c0392b", "#1b7f3b", "0.25"

STYLE = {
    "font.size": 12,
    "mathtext.fontset": "cm",
    "svg.hashsalt": "fenics_ehd",
    "figure.facecolor": "white",
}


def paper(width: float, height: float) -> tuple[Figure, Axes]:
    """Empty drawing with equal axes, size in inches."""
    with plt.rc_context(STYLE):
        figure = plt.figure(figsize=(width, height))
        axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_aspect("equal")
    axes.axis("off")
    return figure, axes


def save(figure: Figure, path: Path) -> None:
    """The same bytes at every build."""
    with plt.rc_context(STYLE):
        figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def point(length: float, angle: float, origin: np.ndarray | tuple = (0.0, 0.0)) -> np.ndarray:
    """Polar coordinates, angle in degrees."""
    a = np.radians(angle)
    return np.asarray(origin) + length * np.array([np.cos(a), np.sin(a)])


def arrow(
    axes: Axes, start: np.ndarray, end: np.ndarray, colour: str = AXIS, width: float = 1.6
) -> None:
    """Straight arrow."""
    style = {"arrowstyle": "-|>", "color": colour, "lw": width, "mutation_scale": 14}
    axes.annotate("", end, start, arrowprops=style | {"shrinkA": 0, "shrinkB": 0}, zorder=6)


def double_arrow(axes: Axes, start: np.ndarray, end: np.ndarray, colour: str = AXIS) -> None:
    """Length between two points."""
    style = {"arrowstyle": "<|-|>", "color": colour, "lw": 1.4, "mutation_scale": 11}
    axes.annotate("", end, start, arrowprops=style | {"shrinkA": 0, "shrinkB": 0}, zorder=6)


def turn(
    axes: Axes,
    centre: np.ndarray | tuple,
    radius: float,
    start: float,
    end: float,
    colour: str = AXIS,
) -> None:
    """Arc with an arrow head at its end, angles in degrees."""
    angles = np.linspace(start, end, 80)
    path = np.array([point(radius, a, centre) for a in angles])
    axes.plot(*path[:-3].T, color=colour, lw=1.4, zorder=5)
    arrow(axes, path[-6], path[-1], colour, 1.4)


def label(axes: Axes, place: np.ndarray, text: str, colour: str = "black", **options) -> None:
    """Text on a white ground."""
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85}
    options = {"ha": "center", "va": "center", "fontsize": 13, "zorder": 8} | options
    axes.text(*place, text, color=colour, bbox=box, **options)


def frame(
    axes: Axes, origin: np.ndarray, angle: float, length: float, names: tuple[str, str], **options
) -> None:
    """Right-handed pair of axes, the first one at `angle` [degrees]."""
    for turned, name in zip((angle, angle + 90.0), names, strict=True):
        arrow(axes, np.asarray(origin), point(length, turned, origin), **options)
        label(axes, point(1.07 * length, turned, origin), name, options.get("colour", AXIS))


def dot(axes: Axes, place: np.ndarray, size: float, colour: str = "black") -> None:
    """Marked point."""
    axes.add_patch(Circle(place, size, color=colour, zorder=7))
