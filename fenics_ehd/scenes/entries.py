"""Bodies and ideal joints that single entries of a scene stand for."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.beam import Disk, beam_plane
from fenics_ehd.multibody.beam import Shaft as BeamShaft
from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.flexible_body import FlexibleBody
from fenics_ehd.multibody.joints import Fixed, Joint, Revolute, Slider
from fenics_ehd.multibody.rigid_body import RigidBody, ground
from fenics_ehd.multibody.rotor import ModalRotor
from fenics_ehd.multibody.shaft_body import ShaftBody
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes import schema


def rough_pose(settings: schema.MovingSettings) -> dict[str, Any]:
    """Rough pose of a planar body."""
    return {
        "position": settings.position,
        "orientation": float(np.radians(settings.angle)),
        "velocity": settings.velocity,
        "speed": settings.speed,
    }


def stiff_body(key: str, settings: Any) -> Body:
    """A body without elasticity, or a shaft."""
    if isinstance(settings, schema.GroundSettings):
        return ground(settings.points)
    if isinstance(settings, schema.ShaftSettings):
        return _shaft(key, settings)
    mass, inertia, centre = 0.0, 0.0, (0.0, 0.0)
    if isinstance(settings, schema.RigidSettings):
        mass, inertia, centre = settings.mass, settings.inertia, settings.centre
    return RigidBody(mass, inertia, settings.points, centre, **rough_pose(settings))


def flexible_body(
    settings: schema.FlexibleSettings, reduced: ReducedBody, ideal: Body
) -> FlexibleBody:
    """A flexible body that starts where its rigid stand-in is."""
    assert isinstance(ideal, RigidBody)
    return FlexibleBody(
        reduced,
        settings.damping_time,
        ideal.position,
        ideal.orientation,
        ideal.velocity,
        ideal.speed,
        settings.mass or None,
        settings.inertia or None,
        settings.centre if any(settings.centre) else None,
    )


def _shaft(key: str, settings: schema.ShaftSettings) -> ShaftBody:
    available = 4 * (settings.elements + 1)
    if settings.modes % 2 or settings.modes > available:
        raise SettingsError(
            f"{key}.modes = {settings.modes} must be even, half of them for either plane, and at "
            f"most {available}, the degrees of freedom of elements = {settings.elements}"
        )
    for name, share in settings.points.items():
        if not 0.0 <= share <= 1.0:
            raise SettingsError(
                f"{key}.points.{name} = {share:g} must be a share of the length, 0 to 1"
            )
    shaft = BeamShaft(
        settings.length,
        settings.diameter,
        settings.youngs_modulus,
        settings.density,
        settings.support_stiffness,
        settings.elements,
    )
    disks = [Disk(*disk) for disk in settings.disks]
    for disk in disks:
        inertias = (disk.mass, disk.polar_inertia, disk.diametral_inertia)
        if not (0.0 <= disk.position <= 1.0 and min(inertias) >= 0.0):
            raise SettingsError(
                f"{key}.disks: position = {disk.position:g} must be a share of the length, 0 to "
                f"1, and masses and inertias at least 0, not {min(inertias):g}"
            )
    polar = shaft.polar_inertia + sum(disk.polar_inertia for disk in disks)
    return ShaftBody(
        ModalRotor.of(beam_plane(shaft, disks), settings.modes // 2),
        polar,
        settings.damping_ratio,
        settings.points,
        settings.position,
        float(np.radians(settings.angle)),
        settings.speed,
    )


def ideal_joint(settings: Any) -> Joint:
    """An ideal joint."""
    if isinstance(settings, schema.SliderSettings):
        return Slider(
            settings.line,
            settings.point,
            settings.direction,
            settings.hold_rotation,
            float(np.radians(settings.angle)),
        )
    first, second = settings.between
    if isinstance(settings, schema.FixedSettings):
        return Fixed(first, second, float(np.radians(settings.angle)))
    return Revolute(first, second)
