"""Eccentricity, normal, gap and rotation in the bore's frame, (3)-(5)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

import fenics_ehd as ehd
from fenics_ehd.film.kinematics import SurfacePoints

from .sketch import (
    BORE,
    FILM,
    SHAFT,
    arrow,
    dot,
    double_arrow,
    frame,
    label,
    paper,
    point,
    turn,
)

#: Clearance of the drawing over the bore's radius, place of the shaft's centre in it.
CLEARANCE, RATIO, DIRECTION = 0.34, 0.55, -35.0

#: Angle at which gap and normal are shown [degrees].
SHOWN = 52.0


def bent(phi: np.ndarray) -> np.ndarray:
    """Radial displacement of the bore, exaggerated."""
    return 0.06 * np.cos(2 * phi - 0.8) + 0.05


def draw_gap() -> Figure:
    """Shaft in a bent bore."""
    figure, axes = paper(7.4, 6.4)
    phi = np.linspace(0, 2 * np.pi, 361)
    circle = np.stack([np.cos(phi), np.sin(phi)])
    axes.plot(*circle, color=BORE, lw=1.2, ls=(0, (6, 4)))
    wall = (1 + bent(phi)) * circle
    ground = np.concatenate([wall, 1.26 * circle[:, ::-1]], axis=1)
    axes.add_patch(Polygon(ground.T, facecolor="#dfe6ee", edgecolor="none"))
    axes.plot(*wall, color=BORE, lw=2.2)
    e = point(CLEARANCE * RATIO, DIRECTION)
    axes.add_patch(Circle(e, 1 - CLEARANCE, facecolor="#eceef0", edgecolor=SHAFT, lw=2.2))
    _vectors(axes, e)
    _gap(axes, e)
    turn(axes, e, 0.44, 150, 232, SHAFT)
    label(axes, point(0.53, 192, e), r"$\omega_1$", SHAFT)
    axes.set(xlim=(-1.75, 1.7), ylim=(-1.32, 1.62))
    return figure


def _vectors(axes: Axes, e: np.ndarray) -> None:
    """Frame, eccentricity, its components along the shown normal."""
    origin = np.zeros(2)
    frame(axes, origin, 0.0, 1.42, ("$x$", "$y$"))
    arrow(axes, origin, e, FILM, 2.4)
    label(axes, 0.5 * e + (-0.02, -0.085), r"$e$", FILM, fontsize=15)
    dot(axes, origin, 0.016)
    dot(axes, e, 0.016)
    label(axes, (-0.085, -0.07), r"$C_2$")
    label(axes, e + (0.1, -0.06), r"$C_1$")
    turn(axes, origin, 0.3, 0.0, SHOWN)
    label(axes, point(0.37, SHOWN / 2), r"$\varphi$")


def ends_of_gap(e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points on shaft and bore at the shown angle, a gap apart that the program computes."""
    angle = np.radians([SHOWN])
    at, motion = SurfacePoints(angle, np.zeros(1)), ehd.ShaftMotion(e, shaft_speed=1.0)
    gap = ehd.shaft_gap(at, 1.0, CLEARANCE, motion).thickness + bent(angle)
    outer = 1 + bent(angle)
    return point(float(outer[0] - gap[0]), SHOWN), point(float(outer[0]), SHOWN)


def _gap(axes: Axes, e: np.ndarray) -> None:
    """Normal, gap and bore displacement at the shown angle."""
    inner, outer = ends_of_gap(e)
    normal = point(1.0, SHOWN)
    axes.plot(*np.stack([0 * inner, inner]).T, color="0.6", lw=1, ls=":")
    double_arrow(axes, inner, outer, FILM)
    label(axes, 0.5 * (inner + outer) + (0.11, -0.09), r"$h$", FILM, fontsize=15)
    arrow(axes, outer, outer + 0.34 * normal, BORE, 2.0)
    label(axes, outer + 0.42 * normal, r"$n$", BORE, fontsize=15)
    other = 203.0
    edge = point(1.0, other)
    arrow(axes, edge, point(1 + bent(np.radians(other)), other), BORE, 2.0)
    label(axes, point(1.34, other), r"$\delta_r = u \cdot n$", BORE)
