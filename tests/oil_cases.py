"""Mechanisms whose films keep account of their oil."""

from dataclasses import replace

import numpy as np
from mechanism_cases import SPEED, rigid_rod, slider_crank

import fenics_ehd as ehd

RADIUS, ETA = 0.0225, 0.01
CLOSED = ehd.Sides(None, None)


def oil_film(
    cells, *, clearance=17e-6, width=0.022, sides=None, family="bilinear", oil=None, **parameters
):
    """A film on a uniform mesh."""
    grid = ehd.uniform_grid(RADIUS, width, cells, family)
    sides = ehd.Sides() if sides is None else sides
    oil = oil or ehd.Lubricant(ETA)
    return ehd.Film(ehd.FilmParameters(grid, clearance, oil, SPEED, sides, **parameters))


def conserved(**oil):
    """Arguments of a lubricated joint with a mass-conserving film."""
    return {"cavitation": "mass-conserving", **oil}


def whirling(film, eccentricity, whirl, **oil):
    """A turning journal whose centre goes round at a given distance, share of the clearance."""
    arm = eccentricity * film.parameters.clearance
    return ehd.Mechanism(
        bodies={
            "arm": ehd.RigidBody(1.0, 1.0, {"tip": (arm, 0.0)}),
            "journal": ehd.RigidBody(1.0, 1.0),
        },
        joints={
            "centre": ehd.Revolute(("ground", "arm")),
            "tip": ehd.Revolute(("arm.tip", "journal")),
            "film": ehd.LubricatedJoint(
                "journal", "ground", film, eccentricity=(arm, 0.0), **conserved(**oil)
            ),
        },
        drives={"arm": ehd.Speed(whirl), "journal": ehd.Speed(SPEED)},
    )


def oscillating(film, eccentricity, speed):
    """A journal that does not turn, at ``eccentricity c cos(speed t)`` along x to 1e-5 of it."""
    arm = eccentricity * film.parameters.clearance
    return ehd.Mechanism(
        bodies={
            "ground": ehd.ground({"bore": (1.0, 0.0)}),
            "crank": ehd.RigidBody(1.0, 1.0, {"tip": (arm, 0.0)}),
            "rod": ehd.RigidBody(1.0, 1.0, {"tip": (1.0, 0.0)}, position=(arm, 0.0)),
            "journal": ehd.RigidBody(1.0, 1.0, position=(1.0 + arm, 0.0)),
        },
        joints={
            "main": ehd.Revolute(("ground", "crank")),
            "big_end": ehd.Revolute(("crank.tip", "rod")),
            "gudgeon": ehd.Revolute(("rod.tip", "journal")),
            "line": ehd.Slider("ground", "journal"),
            "film": ehd.LubricatedJoint(
                "journal", "ground.bore", film, eccentricity=(arm, 0.0), **conserved()
            ),
        },
        drives={"crank": ehd.Speed(speed)},
    )


def rigid_slider_crank(film, **oil):
    """The paper's machine with a rigid rod; no oil: under Reynolds' condition."""
    return slider_crank(rigid_rod(), film, **(conserved(**oil) if oil else {}))


def with_oil(mechanism, film=None, **oil):
    """A mechanism whose lubricated joints keep account of their oil, on another film if given."""
    joints = dict(mechanism.joints)
    for name, joint in joints.items():
        if isinstance(joint, ehd.LubricatedJoint):
            joints[name] = replace(joint, film=film or joint.film, **conserved(**oil))
    return replace(mechanism, joints=joints)


def heights(film):
    """Angles of the nodes of one height, and every how many nodes they come [rad]."""
    nodes = film.parameters.grid.node_positions
    every = len(np.unique(nodes[:, 1].round(9)))
    return nodes[::every, 0], every
