"""Attitude angle and pressure of a loaded bearing, as the program computes them."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

import fenics_ehd as ehd
from fenics_ehd.analysis.bearing import BearingResult

from .sketch import BORE, FILM, LOAD, SHAFT, arrow, dot, label, paper, point, turn

#: Clearance of the drawing over the bore's radius, and height of the largest pressure.
CLEARANCE, HEIGHT = 0.3, 0.42


def seen(angle: float) -> float:
    """Degrees on paper of an angle from the load line [degrees]: x points down."""
    return angle - 90.0


def draw_attitude() -> Figure:
    """Load line down, as on the command line's own drawing."""
    result = ehd.solve_bearing(ehd.BearingSettings(), eccentricity=0.6)
    figure, axes = paper(7.0, 6.4)
    axes.add_patch(Circle((0, 0), 1, facecolor="white", edgecolor=BORE, lw=2.4))
    attitude = float(np.degrees(result.attitude))
    centre = point(0.6 * CLEARANCE, seen(attitude))
    shaft = Circle(centre, 1 - CLEARANCE, facecolor="#eceef0", edgecolor=SHAFT, lw=2.2)
    axes.add_patch(shaft)
    _pressure(axes, result)
    line = np.array([point(1.0, seen(attitude + 180)), point(1.0, seen(attitude))])
    axes.plot(*line.T, color="0.45", lw=1.2, ls="--")
    label(axes, point(1.17, seen(attitude)), "minimum film", fontsize=11, rotation=0)
    label(axes, point(1.14, seen(attitude + 180)), "maximum film", fontsize=11)
    for angle, name in ((0.0, "$x$"), (90.0, "$y$")):
        arrow(axes, np.zeros(2), point(1.62 if name == "$x$" else 1.5, seen(angle)))
        label(axes, point(1.69 if name == "$x$" else 1.57, seen(angle)), name)
    arrow(axes, centre, centre + (0, -0.62), LOAD, 2.6)
    label(axes, centre + (0.09, -0.55), "$W$", LOAD, fontsize=15)
    turn(axes, (0, 0), 0.46, seen(0), seen(attitude))
    label(axes, point(0.53, seen(0.5 * attitude)), r"$\phi$", fontsize=15)
    turn(axes, (0, 0), 0.86, seen(attitude + 180), seen(attitude + 180 + 65), FILM)
    label(axes, point(0.86, seen(attitude + 180 + 80)), r"$\theta$", FILM, fontsize=15)
    turn(axes, centre, 0.5, 100, 190, SHAFT)
    label(axes, point(0.42, 145, centre), r"$\omega$", SHAFT, fontsize=15)
    dot(axes, np.zeros(2), 0.016)
    dot(axes, centre, 0.016)
    label(axes, (-0.08, 0.06), "$O$")
    label(axes, centre + (0.09, 0.05), "$S$")
    axes.set(xlim=(-1.6, 1.85), ylim=(-1.78, 1.35))
    return figure


def _pressure(axes: Axes, result: BearingResult) -> None:
    """Mid-width pressure as arrows' envelope outside the bore."""
    angle = np.linspace(-np.pi, np.pi, 721)
    grid = result.film.parameters.grid
    at = grid.interpolation(angle - result.angle, 0 * angle)
    pressure = np.maximum(at @ result.state.pressure, 0.0)
    outside = 1 + HEIGHT * pressure / pressure.max()
    places = np.radians(seen(np.degrees(angle)))
    direction = np.stack([np.cos(places), np.sin(places)])
    axes.fill(
        *np.concatenate([outside * direction, direction[:, ::-1]], axis=1), color=FILM, alpha=0.25
    )
    axes.plot(*(outside * direction)[:, pressure > 0], color=FILM, lw=1.6)
    top = int(np.argmax(pressure))
    label(axes, (outside[top] + 0.1) * direction[:, top], "$p$", FILM, fontsize=15)
