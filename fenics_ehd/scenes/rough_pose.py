"""Assembly of a scene with its elastic parts rigid, to refuse at once what cannot move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import linalg

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.assembly import assemble
from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.joints import AngleOverTime
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.planar_body import PlanarBody
from fenics_ehd.multibody.shaft_body import ShaftBody
from fenics_ehd.multibody.system import System

#: A motion that meets less than this share of any inertia, spring or film meets none.
NOTHING = 1e-10


def assembled_bodies(mechanism: Mechanism, turning: Mapping[str, AngleOverTime]) -> dict[str, Body]:
    """Bodies of a rigid mechanism with positions and velocities that satisfy every joint.

    Parameters
    ----------
    mechanism
        Without elasticity.
    turning
        Angles that torques drive, with what they are at the start: they are kept where joints
        leave them free.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, or something moves freely without inertia.
    """
    system = System(mechanism)
    z, rates = assemble(system)
    _check_inertia(system, z)
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


def _check_inertia(system: System, z: np.ndarray) -> None:
    """Refuse a motion that no constraint, inertia, spring, damper or film resists."""
    rest, instant = np.zeros(system.n), system.at(0.0, z)
    forces = instant.motion(rest, rest, np.zeros(system.m)).derivatives()
    blocks = [instant.jacobian, forces.acceleration, forces.rate, forces.position]
    for film in system.films:
        own = np.zeros((film.film.own + 1, system.n))
        own[np.arange(film.film.own), film.xi[: film.film.own]] = 1.0
        if film.joint.friction:
            for angle in (film.journal_angle, film.bore_angle):
                if angle is not None:
                    own[-1, angle] = 1.0 if angle == film.journal_angle else -1.0
        blocks.append(own)
    rows = np.vstack([_directions(block) for block in blocks])
    _, sizes, motions = linalg.svd(rows)
    if system.n and (len(sizes) < system.n or sizes[-1] < NOTHING * sizes[0]):
        free = np.abs(motions[-1])
        name = max(system.bodies, key=lambda n: free[system.bodies[n]].max(initial=0.0))
        raise SettingsError(
            f"body {name} can move or turn freely without inertia: give it mass and inertia, or a "
            "joint or drive that holds it"
        )


def _directions(rows: np.ndarray) -> np.ndarray:
    """Rows of length 1, without those that are nothing but round-off."""
    lengths = np.linalg.norm(rows, axis=1)
    kept = lengths > 1e-14 * lengths.max(initial=0.0)
    return rows[kept] / lengths[kept, None]
