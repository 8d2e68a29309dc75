"""Start of a mechanism: positions and velocities of its bodies that satisfy every joint.

Elastic parts are replaced by rigid bodies. A mechanism is refused here, before a part is reduced,
if it cannot be assembled, jams during its first revolution, or can move without inertia.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import degrees, radians

import attrs
import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.body import Body, PlanarBody
from fenics_ehd.multibody.joints import AngleOverTime
from fenics_ehd.multibody.mechanism import Mechanism, System, assemble, check_inertia
from fenics_ehd.multibody.shaft import ShaftBody

#: Least number of instants after the start at which a driven mechanism is assembled.
FEWEST_INSTANTS = 4

#: Rotation of the fastest drive between two such instants [rad].
ANGLE_BETWEEN = radians(10.0)

#: Limit below which assembled coordinates and rates are set to 0, because they are round-off.
ROUND_OFF = 1e-20


def assembled_bodies(
    mechanism: Mechanism, turning: Mapping[str, AngleOverTime], span: float
) -> dict[str, Body]:
    """Bodies of a mechanism with positions and velocities that satisfy every joint.

    Parameters
    ----------
    mechanism
        Mechanism whose elastic parts are replaced by rigid bodies.
    turning
        Angle over time of each body that a torque drives, by body name. The body starts at this
        angle with its speed, unless joints or other drives determine its angle.
    span
        End time of the run, or its period [s].

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, at the start or at a later angle of its drives, or a
        body can move without inertia.
    """
    system = System(mechanism)
    z, rates = assemble(system)
    check_inertia(system, z)
    _require_passage(system, z, span)
    if turning:
        pinned = System(replace(mechanism, drives={**mechanism.drives, **turning}))
        try:
            z, rates = assemble(pinned)
        except SettingsError:
            pass  # joints or other drives determine these angles
    z = np.where(np.abs(z) < ROUND_OFF, 0.0, z)
    rates = np.where(np.abs(rates) < ROUND_OFF, 0.0, rates)
    return {
        name: _with_start(body, z[system.bodies[name]], rates[system.bodies[name]])
        for name, body in mechanism.bodies.items()
    }


def _require_passage(system: System, z: np.ndarray, span: float) -> None:
    """Refuse a mechanism that jams within the first revolution of its fastest drive."""
    drives = system.mechanism.drives
    speed = max((abs(drive(0.0)[1]) for drive in drives.values()), default=0.0)
    if not speed:
        return
    within = min(span, 2 * np.pi / speed)
    instants = max(FEWEST_INSTANTS, round(speed * within / ANGLE_BETWEEN)) + 1
    for time in np.linspace(0.0, within, instants):
        try:
            z, _ = assemble(system, time, z)
        except SettingsError as error:
            angles = ", ".join(f"{n} {np.degrees(d(time)[0]):.0f}" for n, d in drives.items())
            raise SettingsError(f"at drive angles {angles} degrees: {error}") from None


def _with_start(body: Body, z: np.ndarray, rates: np.ndarray) -> Body:
    """Copy of a body with the given coordinates and rates as its state at the start."""
    if isinstance(body, ShaftBody):
        return attrs.evolve(body, angle=degrees(z[0]), speed=float(rates[0]))
    if not isinstance(body, PlanarBody) or not body.size:
        return body
    x, y, angle = z[:3].tolist()
    *velocity, speed = rates[:3].tolist()
    return attrs.evolve(
        body, position=(x, y), angle=degrees(angle), velocity=tuple(velocity), speed=speed
    )
