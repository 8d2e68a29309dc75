"""Mechanisms whose films keep account of their oil."""

from dataclasses import replace

import numpy as np
from mechanism_cases import CRANK, ROD, SPEED, rigid_rod

from fenics_ehd.film import Film, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.film.supply import Sides
from fenics_ehd.multibody.joints import Revolute, Slider, Speed
from fenics_ehd.multibody.lubricated_joint import ConservedContent, LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.rigid_body import RigidBody, ground

RADIUS, ETA = 0.0225, 0.01
CLOSED = Sides(None, None)


def oil_film(
    cells,
    *,
    clearance=17e-6,
    width=0.022,
    sides=None,
    family="bilinear",
    oil=None,
    **parameters,
):
    """A film on a uniform mesh."""
    grid = uniform_grid(RADIUS, width, cells, family)
    sides = Sides() if sides is None else sides
    oil = oil or Lubricant(ETA)
    return Film(FilmParameters(grid, clearance, oil, SPEED, sides, **parameters))


def whirling(film, eccentricity, whirl, **oil):
    """A turning journal whose centre goes round at a given distance, share of the clearance."""
    arm = eccentricity * film.parameters.clearance
    return Mechanism(
        bodies={"arm": RigidBody(1.0, 1.0, {"tip": (arm, 0.0)}), "journal": RigidBody(1.0, 1.0)},
        joints={
            "centre": Revolute("ground", "arm"),
            "tip": Revolute("arm.tip", "journal"),
            "film": LubricatedJoint(
                "journal", "ground", film, eccentricity=(arm, 0.0), oil=ConservedContent(**oil)
            ),
        },
        drives={"arm": Speed(whirl), "journal": Speed(SPEED)},
    )


def oscillating(film, eccentricity, speed):
    """A journal that does not turn, at ``eccentricity c cos(speed t)`` along x to 1e-5 of it."""
    arm = eccentricity * film.parameters.clearance
    return Mechanism(
        bodies={
            "ground": ground({"bore": (1.0, 0.0)}),
            "crank": RigidBody(1.0, 1.0, {"tip": (arm, 0.0)}),
            "rod": RigidBody(1.0, 1.0, {"tip": (1.0, 0.0)}, position=(arm, 0.0)),
            "journal": RigidBody(1.0, 1.0, position=(1.0 + arm, 0.0)),
        },
        joints={
            "main": Revolute("ground", "crank"),
            "big_end": Revolute("crank.tip", "rod"),
            "gudgeon": Revolute("rod.tip", "journal"),
            "line": Slider("ground", "journal"),
            "film": LubricatedJoint(
                "journal", "ground.bore", film, eccentricity=(arm, 0.0), oil=ConservedContent()
            ),
        },
        drives={"crank": Speed(speed)},
    )


def rigid_slider_crank(film, **oil):
    """The paper's machine with a rigid rod; no oil: under Reynolds' condition."""
    content = ConservedContent(**oil) if oil else None
    return Mechanism(
        bodies={
            "crank": RigidBody(1.0, 1e-3, {"pin": (CRANK, 0.0)}),
            "rod": rigid_rod(),
            "piston": RigidBody(0.5, 1e-3, position=(CRANK + ROD, 0.0)),
        },
        joints={
            "main": Revolute("ground", "crank"),
            "big_end": LubricatedJoint("crank.pin", "rod", film, oil=content),
            "gudgeon": Revolute("rod.pin", "piston"),
            "cylinder": Slider("ground", "piston"),
        },
        drives={"crank": Speed(SPEED)},
    )


def with_oil(mechanism, film=None, **oil):
    """A mechanism whose lubricated joints keep account of their oil, on another film if given."""
    joints = dict(mechanism.joints)
    for name, joint in joints.items():
        if isinstance(joint, LubricatedJoint):
            joints[name] = replace(joint, film=film or joint.film, oil=ConservedContent(**oil))
    return replace(mechanism, joints=joints)


def heights(film):
    """Angles of the nodes of one height, and every how many nodes they come [rad]."""
    nodes = film.parameters.grid.node_positions
    every = len(np.unique(nodes[:, 1].round(9)))
    return nodes[::every, 0], every
