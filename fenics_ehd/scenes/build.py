"""From a scene to its mechanism: everything is refused that can be, then parts are reduced."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import attrs
import numpy as np
from mpi4py import MPI

from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.forces import Force
from fenics_ehd.multibody.joints import AngleOverTime, Speed
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.periodic import check_period
from fenics_ehd.multibody.rigid_body import RigidBody
from fenics_ehd.multibody.run import Steps
from fenics_ehd.reduction import ReducedBody, load_body
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
from fenics_ehd.scenes.part import ReducedPart, model_file
from fenics_ehd.scenes.rough_pose import assembled_bodies
from fenics_ehd.scenes.scene import Scene, flexible, meshed
from fenics_ehd.scenes.shapes import joint_shapes


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
    bodies: Mapping[str, ReducedBody] | None = None,
    announce: Callable[[Iterable[str]], None] | None = None,
) -> Built:
    """Put a scene together; collective.

    Parameters
    ----------
    scene
        As read.
    comm
        Ranks that share the reductions; all of them get the mechanism.
    bodies
        Reduced bodies by body name that are there already: those of a run that goes on.
    announce
        Called with the names of the bodies to mesh and reduce, when all is checked that needs none
        of them.

    Raises
    ------
    SettingsError
        Naming what cannot be put together, before anything is reduced.
    MeshError, BodyFileError, InterfaceMismatchError, SolverError
        From meshes, files, bores and reductions.
    """
    start = perf_counter()
    loads_of = loads.imposed_angles(scene), loads.forces(scene) | loads.torques(scene)
    stiff = {
        name: stiff_body(f"bodies.{name}", settings)
        for name, settings in scene.bodies.items()
        if not isinstance(settings, schema.FlexibleSettings)
    }
    if scene.time.periodic:
        check_period(Mechanism(stiff, {}, *loads_of), scene.span, scene.time.periodicity)
    if announce is not None:
        announce(name for name in meshed(scene) if name not in (bodies or {}))
    parts = _parts(scene, comm, bodies or {})
    ideal = _ideal(scene, parts, stiff, *loads_of)
    reduced, found = {}, {}
    for name, part in parts.items():
        made = part.reduce(mesh_error=scene.output.error_budget and scene.output.part_mesh_error)
        if isinstance(made, ReducedPart):
            reduced[name] = made
        found[name] = made.body if isinstance(made, ReducedPart) else made
    if reduced:
        # To the last bit where a body read from its file starts: points of a mesh are rounded.
        parts = {name: replace(part, source=found[name]) for name, part in parts.items()}
        ideal = _ideal(scene, parts, stiff, *loads_of)
    placed = dict(ideal.bodies)
    for name, part in parts.items():
        placed[name] = flexible_body(part.settings, found[name], ideal.bodies[name])
    seconds = perf_counter() - start if reduced else 0.0
    joints, rate = dict(ideal.joints), reference_rate(scene)
    for name, joint in scene.joints_of(schema.LubricatedSettings):
        elastic = scene.elastic_bore(joint)
        part_of = found[elastic[0]].at_bore(elastic[1]) if elastic else None
        film = build_film(scene, name, part_of, rate)
        shapes = joint_shapes(joint, name, film.parameters.grid.width)
        joints[name] = lubricated(joint, film, shapes)
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


def _parts(
    scene: Scene, comm: MPI.Comm, reduced: Mapping[str, ReducedBody]
) -> dict[str, ElasticPart]:
    """Elastic parts, not yet reduced; every journal fits its bore."""
    found = {}
    for name in flexible(scene):  # all files are there before the first part is meshed
        settings = scene.bodies[name]
        if name not in reduced and settings.model != NONE:
            model_file(settings, f"bodies.{name}")
        elif name not in reduced and not Path(settings.body).is_file():
            load_body(settings.body)
    for name, settings in scene.bodies.items():
        if isinstance(settings, schema.FlexibleSettings):
            element = scene.film_element(name)
            if name in reduced:
                found[name] = ElasticPart(settings, reduced[name], element)
            else:
                found[name] = elastic_part(settings, f"bodies.{name}", element, comm)
    for name, joint in scene.joints_of(schema.LubricatedSettings):
        elastic = scene.elastic_bore(joint)
        if elastic is None:
            check_fit(scene, name)
            continue
        part, bore = found[elastic[0]], elastic[1]
        surface = part.bore(bore, f"joints.{name}.bore")
        check_fit(scene, name, surface)
        if not joint.cells:
            part.check_cells(bore)
    return found


def _ideal(
    scene: Scene,
    parts: Mapping[str, ElasticPart],
    stiff: Mapping[str, Body],
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
            bodies[name] = stiff[name]
    joints = {
        name: lubricated(attrs.evolve(joint, heat=None), stand_in_film(joint))
        if isinstance(joint, schema.LubricatedSettings)
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
