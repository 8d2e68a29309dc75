"""Slider-crank with the paper's lengths: frames, angles, gas force."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

import fenics_ehd as ehd
from fenics_ehd.multibody.mechanism import System, assemble

from .sketch import BORE, FILM, LOAD, SHAFT, arrow, dot, frame, label, paper, point, turn

CRANK = ehd.read_scene("slider-crank-paper").bodies["crank"].points["pin"][0]
ROD = 0.16

#: Crank angle of the drawing [degrees].
PHI = 52.0


def rod_motion() -> float:
    """Angle of the rod as the program has it, shaft and bore centred [degrees]."""
    start = np.radians(PHI)
    mechanism = ehd.Mechanism(
        {
            "crank": ehd.RigidBody(1.0, 1.0, {"pin": (CRANK, 0.0)}, angle=np.degrees(start)),
            "rod": ehd.RigidBody(1.0, 1.0, {"pin": (ROD, 0.0)}),
            "piston": ehd.RigidBody(1.0, 1.0, position=(CRANK + ROD, 0.0)),
        },
        {
            "main": ehd.Revolute(("ground", "crank")),
            "big_end": ehd.Revolute(("crank.pin", "rod")),
            "gudgeon": ehd.Revolute(("rod.pin", "piston")),
            "cylinder": ehd.Slider("ground", "piston"),
        },
        {"crank": ehd.Speed(1.0, start)},
    )
    system = System(mechanism)
    return float(np.degrees(assemble(system)[0][system.bodies["rod"]][2]))


def draw_rod() -> Figure:
    """Crank and rod, lengths in metres."""
    theta, c1 = rod_motion(), point(CRANK, PHI)
    # The shaft's centre sits off the bore's, not to scale.
    c2 = c1 - point(0.009, theta + 38.0)
    pin = point(ROD, theta, c1)
    figure, axes = paper(9.4, 4.4)
    _parts(axes, c1, c2, pin, theta)
    frame(axes, np.zeros(2), 0.0, 0.067, ("$x$", "$y$"))
    turn(axes, (0, 0), 0.022, 0, PHI)
    label(axes, point(0.03, 0.4 * PHI), r"$\varphi$", fontsize=15)
    turn(axes, (0, 0), 0.027, 195, 285, SHAFT)
    label(axes, point(0.035, 235), r"$\omega_1$", SHAFT, fontsize=15)
    frame(axes, c2, theta, 0.06, (r"$x_R$", r"$y_R$"), colour=BORE)
    arrow(axes, c2, c1, FILM, 2.4)
    label(axes, c2 + (-0.001, 0.011), "$e$", FILM, fontsize=15)
    label(axes, c2 + (-0.0085, -0.003), "$C_2$")
    label(axes, c1 + (0.0085, -0.0035), "$C_1$")
    along = np.array([c2, c2 + (0.085, 0.0)])
    axes.plot(*along.T, color="0.5", lw=1, ls="--")
    turn(axes, c2, 0.072, 0, theta)
    label(axes, point(0.084, 0.55 * theta, c2), r"$\theta < 0$")
    arrow(axes, pin + (0.062, 0), pin + (0.022, 0), LOAD, 2.6)
    label(axes, pin + (0.05, 0.009), "gas force $> 0$", LOAD, fontsize=12)
    axes.set(xlim=(-0.06, 0.272), ylim=(-0.052, 0.1))
    return figure


def _parts(axes: Axes, c1: np.ndarray, c2: np.ndarray, pin: np.ndarray, theta: float) -> None:
    """Crank, rod with its bore, pin and piston."""
    axes.plot([-0.055, 0.262], [0, 0], color="0.75", lw=1, ls="-.")
    axes.plot(
        *np.stack([np.zeros(2), c1]).T,
        color=SHAFT,
        lw=6,
        alpha=0.6,
        solid_capstyle="round",
        zorder=4,
    )
    side = point(0.0075, theta + 90)
    start, end = point(0.03, theta, c2), point(-0.015, theta, pin)
    shank = np.array([start + side, end + side, end - side, start - side])
    axes.add_patch(Polygon(shank, facecolor="#dfe6ee", edgecolor=BORE, lw=1.4))
    axes.add_patch(Circle(c2, 0.034, facecolor="#dfe6ee", edgecolor=BORE, lw=1.4))
    axes.add_patch(Circle(c2, 0.0255, facecolor="white", edgecolor=BORE, lw=2))
    axes.add_patch(Circle(c1, 0.0155, facecolor="#eceef0", edgecolor=SHAFT, lw=2))
    box = Rectangle(pin - (0.02, 0.021), 0.04, 0.042, facecolor="white", edgecolor=SHAFT, lw=1.6)
    axes.add_patch(box)
    axes.add_patch(Circle(pin, 0.0125, facecolor="#dfe6ee", edgecolor=BORE, lw=1.4))
    for place in (np.zeros(2), c1, c2, pin):
        dot(axes, place, 0.0012)
    label(axes, pin + (0, -0.0065), "$A$")
    label(axes, np.array([0.008, -0.008]), "$O$")
