"""Rotor on its springs, and the sense of a tilt in the bearing."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from .sketch import BORE, FILM, LOAD, SHAFT, arrow, dot, label, paper, point, turn

#: Half thickness of the shaft, ends of the bearing along z.
HALF, BEARING = 0.16, (2.35, 3.65)


def draw_rotor() -> Figure:
    """Plane of x and z; y points out of the paper."""
    figure, axes = paper(9.0, 3.4)
    z = np.linspace(0, 6, 200)
    x = 0.32 * np.sin(np.pi * z / 6) + 0.16 * np.sin(2 * np.pi * z / 6 + 2.6) - 0.08
    axes.plot([-0.6, 6.9], [0, 0], color="0.7", lw=1, ls="-.")
    outline = np.concatenate([np.stack([z, x + HALF]), np.stack([z, x - HALF])[:, ::-1]], axis=1)
    axes.add_patch(Polygon(outline.T, facecolor="#eceef0", edgecolor=SHAFT, lw=1.8, zorder=2))
    for end, height in ((0.0, x[0]), (6.0, x[-1])):
        _spring(axes, end, height - HALF)
    for bottom in (0.42, -0.78):
        wall = Rectangle((BEARING[0], bottom), BEARING[1] - BEARING[0], 0.36)
        wall.set(facecolor="#dfe6ee", edgecolor=BORE, lw=1.6)
        axes.add_patch(wall)
    _tilt(axes, z, x)
    place = 4.5
    at = np.interp(place, z, x)
    arrow(axes, np.array([place, at]), np.array([place, at + 1.15]), LOAD, 2.6)
    label(
        axes, np.array([place + 1.15, at + 0.95]), r"$F_r$ turns with the shaft", LOAD, fontsize=12
    )
    arrow(axes, np.array([-0.6, 0]), np.array([7.0, 0]))
    label(axes, np.array([7.15, 0]), "$z$")
    arrow(axes, np.array([-0.6, 0]), np.array([-0.6, 1.3]))
    label(axes, np.array([-0.6, 1.45]), "$x$, deflection $u$", ha="left")
    axes.add_patch(Rectangle((-0.66, -0.06), 0.12, 0.12, facecolor="white", edgecolor="0.25"))
    dot(axes, np.array([-0.6, 0]), 0.02)
    label(axes, np.array([-0.86, -0.33]), "$y$ out of\nthe paper", fontsize=11)
    label(axes, np.array([3.0, -0.96]), "bearing in its housing", BORE, fontsize=12)
    axes.set(xlim=(-1.35, 7.45), ylim=(-1.4, 1.7))
    return figure


def _spring(axes: Axes, place: float, top: float) -> None:
    """Zigzag from the shaft's underside to the ground."""
    levels = np.linspace(top, -1.2, 12)
    sides = np.where(np.arange(12) % 2, 0.1, -0.1) * (np.arange(12) % 11 > 0)
    axes.plot(place + sides, levels, color="0.35", lw=1.3)
    axes.plot([place - 0.25, place + 0.25], [-1.2, -1.2], color="0.35", lw=2.2)


def _tilt(axes: Axes, z: np.ndarray, x: np.ndarray) -> None:
    """Slope of the shaft at mid-width, exaggerated as its deflection is."""
    middle = np.array([3.0, np.interp(3.0, z, x)])
    slope = float(np.degrees(np.arctan(np.gradient(x, z)[np.argmin(abs(z - 3.0))])))
    ends = np.stack([point(s, slope, middle) for s in (-1.5, 1.5)])
    axes.plot(*ends.T, color=FILM, lw=1.5, ls="--", zorder=5)
    turn(axes, middle, 1.35, 0, slope, FILM)
    label(axes, middle + (1.02, -0.32), r"$\psi_y = u'$", FILM)
    dot(axes, middle, 0.03)
