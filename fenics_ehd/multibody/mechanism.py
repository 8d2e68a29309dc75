"""A mechanism is what it lists: bodies, joints, drives and forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.forces import Force
from fenics_ehd.multibody.joints import AngleOverTime, Joint
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies and what connects and moves them.

    Attributes
    ----------
    bodies
        By name; ``ground`` is there without being listed.
    joints
        Ideal and lubricated ones by name; their markers are ``"body.point"``, or ``"body"``
        for its origin.
    drives
        By the body whose angle they give.
    forces
        By name.
    gravity
        [m/s^2].
    """

    bodies: Mapping[str, Body]
    joints: Mapping[str, Joint | LubricatedJoint]
    drives: Mapping[str, AngleOverTime] = field(default_factory=dict)
    forces: Mapping[str, Force] = field(default_factory=dict)
    gravity: tuple[float, float] = (0.0, 0.0)
