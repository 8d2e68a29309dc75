"""From a scene to its mechanism: everything is refused that can be, then parts are reduced."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from mpi4py import MPI

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.forces import Force
from fenics_ehd.multibody.joints import AngleOverTime, Speed
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.planar_body import RigidBody
from fenics_ehd.multibody.simulation import Steps
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes import loads, schema
from fenics_ehd.scenes.elastic_part import ElasticPart, elastic_part
from fenics_ehd.scenes.entries import flexible_body, ideal_joint, rough_pose, stiff_body
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
from fenics_ehd.scenes.scene import BORE, Scene


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
        From meshes, files, bores and reductions.
    """
    start = perf_counter()
    if method is not None and not any(
        isinstance(body, schema.Flexible) and body.model != NONE for body in scene.bodies.values()
    ):
        raise SettingsError(f"method {method}: scene {scene.name} has no model to reduce")
    loads_of = loads.imposed_angles(scene), loads.forces(scene) | loads.torques(scene)
    parts = _parts(scene, comm, bodies or {})
    ideal = _ideal(scene, parts, *loads_of)
    placed, reduced, found = dict(ideal.bodies), {}, {}
    for name, part in parts.items():
        made = part.reduce(method)
        if isinstance(made, ReducedPart):
            reduced[name] = made
        found[name] = made.body if isinstance(made, ReducedPart) else made
        placed[name] = flexible_body(part.settings, found[name], ideal.bodies[name])
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


def _parts(
    scene: Scene, comm: MPI.Comm, reduced: Mapping[str, ReducedBody]
) -> dict[str, ElasticPart]:
    """Elastic parts, not yet reduced; every journal fits its bore."""
    bores = {}
    for name, joint in scene.joints_of(schema.Lubricated):
        elastic = _elastic_bore(scene, joint)
        if elastic:
            bores[elastic] = name
        else:
            check_fit(scene, name)
    found = {}
    for name, settings in scene.bodies.items():
        if isinstance(settings, schema.Flexible):
            element = scene.joints[bores[name]].element if name in bores else "lagrange"
            if name in reduced:
                part = ElasticPart(settings, reduced[name], element)
            else:
                part = elastic_part(settings, f"bodies.{name}", element, comm)
            found[name] = part
            if name in bores:
                check_fit(scene, bores[name], (part.radius, part.width))
                if not scene.joints[bores[name]].cells:
                    part.check_cells()
    return found


def _ideal(
    scene: Scene,
    parts: Mapping[str, ElasticPart],
    drives: Mapping[str, AngleOverTime],
    forces: Mapping[str, Force],
) -> Mechanism:
    """The mechanism with its elastic parts rigid, assembled."""
    bodies: dict[str, Body] = {}
    for name, settings in scene.bodies.items():
        if name in parts:
            start = rough_pose(settings)
            bodies[name] = RigidBody(1.0, 1.0, parts[name].points(), held=parts[name].held, **start)
        else:
            bodies[name] = stiff_body(f"bodies.{name}", settings)
    joints = {
        name: lubricated(joint, stand_in_film(joint))
        if isinstance(joint, schema.Lubricated)
        else ideal_joint(joint)
        for name, joint in scene.joints.items()
    }
    turning = {
        name: Speed(scene.bodies[name].speed, float(np.radians(scene.bodies[name].angle)))
        for name in scene.drives
        if name not in drives
    }
    ideal = Mechanism(bodies, joints, drives, forces, loads.gravity(scene))
    return replace(ideal, bodies=assembled_bodies(ideal, turning, scene.span))
