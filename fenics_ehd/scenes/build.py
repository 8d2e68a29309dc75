"""From a scene to its mechanism: everything is refused that can be, then parts are reduced."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.beam import Disk, beam_plane
from fenics_ehd.multibody.beam import Shaft as BeamShaft
from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.joints import Fixed, Joint, Revolute, Slider, Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.planar_body import FlexibleBody, RigidBody, ground
from fenics_ehd.multibody.rotor import ModalRotor
from fenics_ehd.multibody.shaft_body import ShaftBody
from fenics_ehd.multibody.simulation import Steps
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes import loads, schema
from fenics_ehd.scenes.elastic_part import ElasticPart, elastic_part
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.films import (
    build_film,
    check_fit,
    lubricated,
    reference_rate,
    stand_in_film,
)
from fenics_ehd.scenes.part import ReducedPart
from fenics_ehd.scenes.rough_pose import assembled_bodies
from fenics_ehd.scenes.scene_file import BORE, Scene


@dataclass(frozen=True, eq=False)
class Built:
    """What a scene stands for.

    Attributes
    ----------
    mechanism
        What moves.
    parts
        Reduced bodies by body name, those of files too.
    reduced
        Those that were reduced here, with what displacement fields need.
    seconds
        Time to mesh and reduce them [s].
    end, period
        One of them, the other None [s].
    steps
        How to step.
    """

    mechanism: Mechanism
    parts: Mapping[str, ReducedBody]
    reduced: Mapping[str, ReducedPart]
    seconds: float
    end: float | None
    period: float | None
    steps: Steps


def build_mechanism(
    scene: Scene,
    comm: MPI.Comm,
    method: str | None = None,
    bodies: Mapping[str, ReducedBody] | None = None,
) -> Built:
    """Put a scene together; collective.

    Parameters
    ----------
    scene
        As read.
    comm
        Ranks that share the reductions; all of them get the mechanism.
    method
        Of every reduction, in place of the scene's; None: that.
    bodies
        Reduced bodies by body name that are there already: those of a run that goes on.

    Raises
    ------
    SettingsError
        Naming what cannot be put together, before anything is reduced; or the method has
        nothing to reduce.
    MeshError, BodyFileError, InterfaceMismatchError, SolverError
        From meshes, files, films and reductions.
    """
    start = perf_counter()
    if method is not None and not any(
        isinstance(body, schema.Flexible) and body.model != NONE for body in scene.bodies.values()
    ):
        raise SettingsError(f"method {method}: scene {scene.name} has no model to reduce")
    ideal, parts = _ideal(scene, comm, bodies or {})
    placed, reduced, found = dict(ideal.bodies), {}, {}
    for name, part in parts.items():
        made = part.reduce(method)
        if isinstance(made, ReducedPart):
            reduced[name] = made
        found[name] = made.body if isinstance(made, ReducedPart) else made
        placed[name] = _flexible(part.settings, found[name], ideal.bodies[name])
    seconds = perf_counter() - start if reduced else 0.0
    joints, rate = dict(ideal.joints), reference_rate(scene)
    for name, joint in scene.joints_of(schema.Lubricated):
        part_of = _elastic_bore(scene, joint)
        film = build_film(scene, name, found[part_of] if part_of else None, rate)
        joints[name] = lubricated(joint, film)
    return Built(
        Mechanism(placed, joints, ideal.drives, ideal.forces, ideal.gravity),
        found,
        reduced,
        seconds,
        None if scene.time.periodic else scene.span,
        scene.span if scene.time.periodic else None,
        _steps(scene),
    )


def _steps(scene: Scene) -> Steps:
    time = scene.time
    largest = time.largest_step / (time.revolutions or 1.0)
    return Steps(time.tolerance, time.order, time.first_step, time.smallest_step, largest)


def _elastic_bore(scene: Scene, joint: schema.Lubricated) -> str:
    """Name of the flexible body whose bore a joint has, empty for a rigid bore."""
    body, _, point = joint.bore.partition(".")
    elastic = isinstance(scene.bodies.get(body), schema.Flexible) and point == BORE
    return body if elastic else ""


def _ideal(
    scene: Scene, comm: MPI.Comm, reduced: Mapping[str, ReducedBody]
) -> tuple[Mechanism, dict[str, ElasticPart]]:
    """The mechanism with rigid parts, assembled, and its elastic parts not yet reduced."""
    films = dict(scene.joints_of(schema.Lubricated))
    bores = {_elastic_bore(scene, joint): name for name, joint in films.items()}
    for name, joint in films.items():
        if not _elastic_bore(scene, joint):
            check_fit(scene, name)
    drives, forces = loads.imposed_angles(scene), loads.forces(scene) | loads.torques(scene)
    turning = {
        name: Speed(scene.bodies[name].speed, float(np.radians(scene.bodies[name].angle)))
        for name in scene.drives
        if name not in drives
    }
    bodies = {
        name: _body(f"bodies.{name}", settings)
        for name, settings in scene.bodies.items()
        if not isinstance(settings, schema.Flexible)
    }
    joints: dict[str, Joint | LubricatedJoint] = {
        name: _joint(settings) for name, settings in scene.joints.items() if name not in films
    }
    joints |= {name: lubricated(joint, stand_in_film(joint)) for name, joint in films.items()}
    parts = {}
    for name, settings in scene.bodies.items():
        if isinstance(settings, schema.Flexible):
            element = films[bores[name]].element if name in bores else "lagrange"
            if name in reduced:
                part = ElasticPart(settings, reduced[name], element, 0.0)
            else:
                part = elastic_part(name, settings, element, comm)
            parts[name] = part
            if name in bores:
                check_fit(scene, bores[name], (part.radius, part.width))
            bodies[name] = RigidBody(
                1.0, 1.0, part.points(), held=part.held, **_start(settings)
            )  # fmt: skip
    ideal = Mechanism(bodies, joints, drives, forces, loads.gravity(scene))  # type: ignore[arg-type]
    placed = assembled_bodies(ideal, turning, scene.span)
    return Mechanism(placed, joints, drives, forces, ideal.gravity), parts  # type: ignore[arg-type]


def _start(settings: schema.Moving) -> dict[str, Any]:
    """Rough pose of a planar body."""
    return {
        "position": settings.position,
        "orientation": float(np.radians(settings.angle)),
        "velocity": settings.velocity,
        "speed": settings.speed,
    }


def _body(key: str, settings: Any) -> Body:
    """A body without elasticity, or a shaft."""
    if isinstance(settings, schema.Ground):
        return ground(settings.points)
    if isinstance(settings, schema.Shaft):
        return _shaft(key, settings)
    mass, inertia, centre = 0.0, 0.0, (0.0, 0.0)
    if isinstance(settings, schema.Rigid):
        mass, inertia, centre = settings.mass, settings.inertia, settings.centre
    return RigidBody(mass, inertia, settings.points, centre, **_start(settings))


def _flexible(settings: schema.Flexible, reduced: ReducedBody, ideal: Body) -> FlexibleBody:
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


def _shaft(key: str, settings: schema.Shaft) -> ShaftBody:
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


def _joint(settings: Any) -> Joint:
    """An ideal joint."""
    if isinstance(settings, schema.Slider):
        return Slider(
            settings.line,
            settings.point,
            settings.direction,
            settings.hold_rotation,
            float(np.radians(settings.angle)),
        )
    first, second = settings.between
    if isinstance(settings, schema.Fixed):
        return Fixed(first, second, float(np.radians(settings.angle)))
    return Revolute(first, second)
