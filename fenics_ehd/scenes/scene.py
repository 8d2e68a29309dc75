"""A scene: what a scene file says, by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE

#: The frame at rest.
GROUND = "ground"


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene as written and checked.

    Attributes
    ----------
    name
        File or shipped scene it was read from.
    tables
        As written.
    bodies, joints, drives, forces, lubricants
        Settings by name, classes of `fenics_ehd.scenes.schema`; drives by the body they turn.
    time, output
        See there.
    warnings
        Values that may be in another unit, one line each.
    """

    name: str
    tables: Mapping[str, Any]
    bodies: Mapping[str, Any]
    joints: Mapping[str, Any]
    drives: Mapping[str, Any]
    forces: Mapping[str, Any]
    lubricants: Mapping[str, Any]
    time: schema.TimeSettings
    output: schema.OutputSettings
    warnings: tuple[str, ...]

    def joints_of(self, kind: type) -> Iterator[tuple[str, Any]]:
        """Names and settings of all joints of a class."""
        return ((name, j) for name, j in self.joints.items() if isinstance(j, kind))

    def elastic_bore(self, joint: schema.LubricatedSettings) -> tuple[str, str] | None:
        """Flexible body and bore of a joint, None for a rigid bore."""
        name, _, point = joint.bore.partition(".")
        body = self.bodies.get(name)
        elastic = isinstance(body, schema.FlexibleSettings) and point in body.bores
        return (name, point) if elastic else None

    def films_of(self, body: str) -> dict[str, schema.LubricatedSettings]:
        """Joints in the elastic bores of a flexible body by bore, in the order of its bores."""
        found = {
            self.elastic_bore(joint): joint
            for _, joint in self.joints_of(schema.LubricatedSettings)
        }
        bores = self.bodies[body].bores
        return {bore: found[body, bore] for bore in bores if (body, bore) in found}

    def film_element(self, body: str) -> str:
        """Element of a flexible body's films; others than the first's reach it by a transfer."""
        return next((film.element for film in self.films_of(body).values()), "lagrange")

    @property
    def span(self) -> float:
        """End or period [s]."""
        time = self.time
        given = time.period if time.periodic else time.end
        return given or time.revolutions * 2 * np.pi / abs(self.speed_of(time.of))

    def speed_of(self, body: str) -> float:
        """Angular speed of a body at the start as written [rad/s]."""
        drive = self.drives.get(body)
        if isinstance(drive, schema.SpeedSettings):
            return drive.speed
        return getattr(self.bodies.get(body), "speed", 0.0)


def flexible(scene: Scene) -> tuple[str, ...]:
    """Names of the flexible bodies."""
    bodies = scene.bodies.items()
    return tuple(name for name, body in bodies if isinstance(body, schema.FlexibleSettings))


def meshed(scene: Scene) -> tuple[str, ...]:
    """Names of the flexible bodies that are meshed and reduced, not read."""
    return tuple(name for name in flexible(scene) if scene.bodies[name].model != NONE)


def lubricated_joints(scene: Scene) -> tuple[str, ...]:
    """Names of the lubricated joints."""
    return tuple(name for name, _ in scene.joints_of(schema.LubricatedSettings))
