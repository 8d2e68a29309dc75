"""Assembly of a scene with its elastic parts rigid, to refuse at once what cannot move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.assembly import assemble, check_inertia
from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.joints import AngleOverTime
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.planar_body import PlanarBody
from fenics_ehd.multibody.shaft_body import ShaftBody
from fenics_ehd.multibody.system import System

#: Places at which a driven mechanism is assembled between its start and its end, at least, and
#: angle of the fastest drive between two [rad].
PLACES, APART = 4, np.radians(10.0)


def assembled_bodies(
    mechanism: Mechanism, turning: Mapping[str, AngleOverTime], span: float
) -> dict[str, Body]:
    """Bodies of a rigid mechanism with positions and velocities that satisfy every joint.

    Parameters
    ----------
    mechanism
        Without elasticity.
    turning
        Angles that torques drive, with what they are at the start: they are kept where joints
        leave them free.
    span
        End or period [s].

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, at the start or where its drives bring it, or something
        moves freely without inertia.
    """
    system = System(mechanism)
    z, rates = assemble(system)
    check_inertia(system, z)
    _check_way(system, z, span)
    if turning:
        pinned = System(replace(mechanism, drives={**mechanism.drives, **turning}))
        try:
            z, rates = assemble(pinned)
        except SettingsError:
            pass  # Joints or other drives hold them already.
    found = {}
    for name, body in mechanism.bodies.items():
        places = system.bodies[name]
        found[name] = _placed(body, z[places], rates[places])
    return found


def _check_way(system: System, z: np.ndarray, span: float) -> None:
    """Refuse a mechanism that jams where its drives bring it, within a revolution."""
    drives = system.mechanism.drives
    speed = max((abs(drive(0.0)[1]) for drive in drives.values()), default=0.0)
    if not speed:
        return
    within = min(span, 2 * np.pi / speed)
    for time in np.linspace(0.0, within, max(PLACES, round(speed * within / APART)) + 1):
        try:
            z, _ = assemble(system, time, z)
        except SettingsError as error:
            turned = ", ".join(f"{n} {np.degrees(d(time)[0]):.0f}" for n, d in drives.items())
            raise SettingsError(f"at angles of {turned} degrees: {error}") from None


def _placed(body: Body, z: np.ndarray, rates: np.ndarray) -> Body:
    """A body whose start is the given one."""
    if isinstance(body, ShaftBody):
        return replace(body, orientation=float(z[0]), speed=float(rates[0]))
    if not isinstance(body, PlanarBody) or not body.size:
        return body
    (x, y, angle), (vx, vy, speed) = z[:3].tolist(), rates[:3].tolist()
    return replace(  # type: ignore[type-var]
        body, position=(x, y), orientation=angle, velocity=(vx, vy), speed=speed
    )
