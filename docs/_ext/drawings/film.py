"""The film unwrapped, with the pressure of a tilted shaft on it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import fenics_ehd as ehd

from .sketch import BORE, FILM, arrow, label, paper

#: Width of the drawing's film where its circumference is 2 pi.
WIDTH = 1.7


def draw_film() -> Figure:
    """Pressure over circumference and width, boundaries and directions."""
    result = ehd.solve_bearing(ehd.BearingSettings(), eccentricity=0.7)
    grid = result.film.parameters.grid
    angle = np.linspace(0, 2 * np.pi, 361)
    height = np.linspace(grid.heights[0], grid.heights[-1], 61)
    a, z = np.meshgrid(angle, height)
    at = grid.interpolation((a - result.angle).ravel(), z.ravel())
    pressure = np.maximum(at @ result.state.pressure, 0).reshape(a.shape)
    figure, axes = paper(9.0, 3.9)
    scaled = height / (height[-1] - height[0]) * WIDTH
    levels = np.linspace(0.001, 1, 9) * pressure.max()
    axes.contourf(angle, scaled, pressure, levels, cmap="YlOrRd")
    axes.contour(angle, scaled, pressure, levels[:1], colors=[FILM], linewidths=1.4)
    axes.add_patch(
        Rectangle((0, -WIDTH / 2), 2 * np.pi, WIDTH, facecolor="none", edgecolor=BORE, lw=2)
    )
    _names(axes)
    axes.set(xlim=(-1.0, 8.0), ylim=(-1.62, 1.42))
    return figure


def _names(axes: Axes) -> None:
    """Directions, boundaries and the two zones."""
    half = WIDTH / 2
    arrow(axes, np.array([0, 0]), np.array([7.3, 0]))
    label(axes, np.array([7.6, 0]), r"$y = R\varphi$")
    arrow(axes, np.array([0, -half]), np.array([0, half + 0.4]))
    label(axes, np.array([-0.2, half + 0.35]), "$z$")
    label(axes, np.array([np.pi, half + 0.19]), "$p = 0$ at the side", BORE, fontsize=12)
    label(axes, np.array([np.pi, -half - 0.19]), "$p = 0$ at the side", BORE, fontsize=12)
    label(axes, np.array([-0.42, -0.25]), "periodic", BORE, fontsize=11, rotation=90)
    label(axes, np.array([2 * np.pi + 0.3, -0.5]), "periodic", BORE, fontsize=11, rotation=90)
    label(axes, np.array([2.3, 0.4]), "cavitated: $p = 0$,\nflux defect $> 0$", fontsize=12)
    label(axes, np.array([4.75, -0.45]), "full: $p > 0$,\nflux defect $= 0$", fontsize=12)
    arrow(axes, np.array([2.2, -1.35]), np.array([4.0, -1.35]), "0.4", 2.4)
    label(axes, np.array([5.5, -1.35]), r"oil is carried along, $(v_1 + v_2)/2$", fontsize=12)
