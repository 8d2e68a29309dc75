"""A scene: what a scene file says, by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.scenes import schema

#: The frame at rest.
GROUND = "ground"

#: Point of a flexible body that is its lubricated bore.
BORE = "bore"


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
    time: schema.Time
    output: schema.Output
    warnings: tuple[str, ...]

    def joints_of(self, kind: type) -> Iterator[tuple[str, Any]]:
        """Names and settings of all joints of a class."""
        return ((name, j) for name, j in self.joints.items() if isinstance(j, kind))

    @property
    def span(self) -> float:
        """End or period [s]."""
        time = self.time
        given = time.period if time.periodic else time.end
        return given or time.revolutions * 2 * np.pi / abs(self.speed_of(time.of))

    def speed_of(self, body: str) -> float:
        """Angular speed of a body at the start as written [rad/s]."""
        drive = self.drives.get(body)
        if isinstance(drive, schema.Speed):
            return drive.speed
        return getattr(self.bodies.get(body), "speed", 0.0)
