"""The mechanism of a scene: files, meshes, joints, reductions and bodies, in this order.

1. Files and tables are read (`fenics_ehd.scenes.inputs`), and the period of the loads is checked.
2. Elastic parts are meshed, unless their reduced bodies are kept (`fenics_ehd.scenes.kept_bodies`).
3. Joints and films are made in the bores of the parts.
4. The mechanism is assembled with rigid parts (`fenics_ehd.scenes.start`).
5. Parts are reduced, which takes longest.
6. Bodies and the mechanism are made.

A scene that cannot be used is refused as early as possible: only errors of reductions occur in or
after the fifth step.

Imports inside functions: `fenics_ehd.scenes.part` imports all reductions, which rigid scenes do
not need.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import radians
from time import perf_counter
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np
from mpi4py import MPI

from fenics_ehd.base.arguments import copied, require_class
from fenics_ehd.base.described import Described, Named, unknown_name
from fenics_ehd.base.progress import Progress, chosen_progress
from fenics_ehd.film.grid import MeshMaker
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.body import Body, FlexibleBody, Pose, RigidBody, ground
from fenics_ehd.multibody.joints import Joint, Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.periodic import check_period
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.films import lubricated_joint, reference_rate, shut_supplies
from fenics_ehd.scenes.inputs import Inputs, gravity, read_inputs
from fenics_ehd.scenes.scene import Scene, flexible
from fenics_ehd.scenes.start import assembled_bodies

if TYPE_CHECKING:
    from fenics_ehd.scenes.part import Announce, ElasticPart, ReducedPart


@dataclass(frozen=True, eq=False)
class Machine(Described):
    """The mechanism of a scene, with the arguments of its simulation.

    Attributes
    ----------
    mechanism
        Bodies, joints, drives and forces.
    bodies
        Reduced bodies by body name, from reductions, from the cache or from files.
    reduced
        Parts that were meshed for this scene, by body name, with meshes and bases.
    seconds
        Time spent on meshes, reductions and the cache [s].
    end, period
        End time of a run that is not periodic, else None; period of a periodic run, else None [s].
    steps
        Options of the time integration.
    options
        Keyword arguments of `simulate`: end or period, and the options of the time integration.
    warnings
        Notices on bodies from files and on supplies of oil, one line each.
    """

    mechanism: Mechanism
    bodies: Mapping[str, ReducedBody]
    reduced: Mapping[str, ReducedPart]
    seconds: float
    end: float | None
    period: float | None
    steps: IntegratorOptions
    options: Mapping[str, Any]
    warnings: tuple[str, ...] = ()

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield the duration, the lines of the mechanism, reduced bodies and warnings."""
        if self.period is None:
            yield "Machine", f"end {self.end:.6g} s, tolerance {self.steps.tolerance:.4g}"
        else:
            yield "Machine", f"period {self.period:.6g} s, tolerance {self.steps.tolerance:.4g}"
        for name, text in self.mechanism.described():
            yield name.lower(), text
        for name, body in self.bodies.items():
            yield f"body {name}", f"{body.method}, {body.modes} elastic coordinates"
        for line in self.warnings:
            yield "warning", line


def build(
    scene: Scene,
    comm: MPI.Comm = MPI.COMM_SELF,
    *,
    bodies: Mapping[str, ReducedBody] | None = None,
    announce: Announce | None = None,
    cache: bool = True,
    progress: Progress | bool = True,
) -> Machine:
    """Make the mechanism of a scene; its elastic parts are meshed and reduced; collective.

    A part whose reduced body is in the user's cache is neither meshed nor reduced, unless the scene
    has ``output.paraview``, which needs the mesh.

    Parameters
    ----------
    scene
        Scene as read.
    comm
        Ranks that share the reductions, by default this process alone; the result is the same on
        every rank.
    bodies
        Reduced bodies by body name that are used in place of models and files, for instance the
        bodies of a run that is resumed.
    announce
        Function that is called after all checks that need no mesh, with two lists: names of the
        bodies to mesh and reduce, and names of the bodies read from the cache.
    cache
        Whether the cache is used. The environment variable ``FENICS_EHD_CACHE=off`` excludes it.
    progress
        Whether progress of meshes and reductions is shown in a terminal or notebook; or the
        progress in which they open their stages.

    Raises
    ------
    SettingsError
        A value cannot be used; it is refused before any reduction, and the message names it.
    MeshError, BodyFileError, InterfaceMismatchError, SolverError
        A mesh, file, bore or reduction cannot be used or failed.
    """
    require_class("scene", scene, Scene)
    known = copied(
        "bodies", bodies or {}, lambda name, body: require_class(name, body, ReducedBody)
    )
    for name in known:
        if name not in scene.bodies:
            raise unknown_name("bodies", name, scene.bodies)
    shown = chosen_progress(progress)
    inputs = read_inputs(scene, known)
    _require_period(scene, inputs)
    start = perf_counter()
    parts = _parts(scene, inputs, comm, announce, shown, cache=cache)
    seconds = perf_counter() - start
    joints = _joints(scene, inputs, parts, {})
    assembled = _assembled(scene, inputs, parts, joints)
    start = perf_counter()
    with_mesh_error = _with_mesh_error(scene)
    reduced = {}
    elastic: dict[str, ReducedBody] = {}
    for name, part in parts.items():
        if isinstance(part.source, ReducedBody):
            elastic[name] = part.source
        else:
            with shown.stage(name):
                reduced[name] = part.reduce(mesh_error=with_mesh_error)
            elastic[name] = reduced[name].body
    seconds += perf_counter() - start
    if reduced:
        # Points of a mesh and of its reduced body differ in the last digit. The start must be that
        # of a run with the body's file.
        parts = {name: replace(part, source=elastic[name]) for name, part in parts.items()}
        assembled = _assembled(scene, inputs, parts, joints)
    moving = {
        name: _flexible_body(scene.bodies[name], elastic[name], body) if name in elastic else body
        for name, body in assembled.items()
    }
    steps = _steps(scene)
    duration = _duration(scene)
    return Machine(
        Mechanism(moving, joints, inputs.drives, inputs.forces, gravity(scene)),
        Named(elastic, "machine.bodies"),
        Named(reduced, "machine.reduced"),
        seconds if parts.keys() - inputs.bodies.keys() else 0.0,
        duration.get("end"),
        duration.get("period"),
        steps,
        duration | vars(steps),
        _notices(parts, joints),
    )


def _notices(
    parts: Mapping[str, ElasticPart], joints: Mapping[str, Joint | LubricatedJoint]
) -> tuple[str, ...]:
    """Notices, one line each, on reduced bodies and on supplies of oil of a machine."""
    lines = [line for name, part in parts.items() for line in _lacking_edges(name, part)]
    for name, joint in joints.items():
        if isinstance(joint, LubricatedJoint):
            lines += shut_supplies(name, joint.film)
    return tuple(lines)


def _lacking_edges(name: str, part: ElasticPart) -> Iterator[str]:
    """Notices, one line each, on film edges that the pressures of a body's reduction lack.

    A part is reduced for pressures that change abruptly at the heights `Scene.film_edges`. A body
    from a file may have been reduced without some of these heights.
    """
    from fenics_ehd.reduction.pressure_family import missing_edges

    assert isinstance(part.source, ReducedBody)
    for point, heights in missing_edges(part.source.provenance, part.film_edges).items():
        listed = ", ".join(f"{1e3 * height:.4g}" for height in heights if np.isfinite(height))
        edges = [f"edges at z = {listed} mm"] if listed else []
        edges += ["contact at its ends"] if np.isinf(heights).any() else []
        yield (
            f"bodies.{name}: it was reduced for films without {' and '.join(edges)} in {point}: "
            "the bore's displacement there may be off by 1 %: reduce the part again with this scene"
        )


def unassembled(scene: Scene, film_meshes: Mapping[str, MeshMaker]) -> Mechanism:
    """Mechanism of a scene without elastic parts, with its bodies at the positions in the scene.

    These positions need not satisfy the joints, because the equilibrium solver assembles the
    mechanism.

    Parameters
    ----------
    scene
        The scene.
    film_meshes
        Functions that make the meshes of films, by the name of the joint. Other films have the
        cells in the scene.

    Raises
    ------
    SettingsError
        A value cannot be used; the message names it.
    """
    inputs = read_inputs(scene, {})
    return _rigid(scene, inputs, {}, _joints(scene, inputs, {}, film_meshes))


def _require_period(scene: Scene, inputs: Inputs) -> None:
    """Refuse a period at whose end a load, drive or supply differs from its value at the start."""
    if scene.time.periodic:
        loaded = Mechanism(_stiff(scene), {}, inputs.drives, inputs.forces)
        check_period(loaded, scene.span, scene.time.periodicity, inputs.supply_curves)


def _stiff(scene: Scene) -> dict[str, Body]:
    """Bodies of a scene, by name, except its elastic parts."""
    return {
        name: ground(settings.points) if isinstance(settings, schema.GroundSettings) else settings
        for name, settings in scene.bodies.items()
        if not isinstance(settings, schema.FlexibleSettings)
    }


def _with_mesh_error(scene: Scene) -> bool:
    """Whether a run of a scene needs estimates of the mesh errors of its parts."""
    return scene.output.error_budget and scene.output.part_mesh_error


def _parts(
    scene: Scene,
    inputs: Inputs,
    comm: MPI.Comm,
    announce: Announce | None,
    progress: Progress,
    *,
    cache: bool,
) -> dict[str, ElasticPart]:
    """Elastic parts of a scene by name, each with its mesh or with a reduced body.

    The parameters are those of `build`.
    """
    if not flexible(scene):
        return {}
    from fenics_ehd.scenes.part import ElasticPart, elastic_part, kept_entry

    with_mesh_error = _with_mesh_error(scene)
    elements = {name: scene.film_element(name) for name in flexible(scene)}
    edges = {name: scene.film_edges(name) for name in elements}
    entries = {
        name: kept_entry(
            scene.bodies[name],
            f"bodies.{name}",
            element,
            edges[name],
            comm,
            mesh_error=with_mesh_error,
            cache=cache,
        )
        for name, element in elements.items()
        if name not in inputs.bodies
    }
    kept = {name: body for name, entry in entries.items() if (body := entry.body()) is not None}
    if announce is not None:
        announce([name for name in entries if name not in kept], list(kept))
    ready = {**inputs.bodies, **({} if scene.output.paraview else kept)}
    parts = {}
    for name, element in elements.items():
        settings = scene.bodies[name]
        if name in ready:
            parts[name] = ElasticPart(settings, ready[name], element, edges[name])
        else:
            with progress.stage(name):
                parts[name] = elastic_part(
                    settings, f"bodies.{name}", element, comm, edges[name], entries[name], progress
                )
    return parts


def _joints(
    scene: Scene,
    inputs: Inputs,
    parts: Mapping[str, ElasticPart],
    film_meshes: Mapping[str, MeshMaker],
) -> dict[str, Joint | LubricatedJoint]:
    """Joints of a scene by name; lubricated joints have their films."""
    joints = dict(scene.joints)
    rate = reference_rate(scene)
    for name, joint in scene.films.items():
        meshes = [
            parts[surface.body].bore(surface.point, f"joints.{name}.{surface.side}")
            for surface in scene.elastic_surfaces(joint)
        ]
        joints[name] = lubricated_joint(
            scene, name, meshes[0] if meshes else None, rate, inputs, film_meshes.get(name)
        )
    return joints


def _rigid(
    scene: Scene,
    inputs: Inputs,
    parts: Mapping[str, ElasticPart],
    joints: Mapping[str, Joint | LubricatedJoint],
) -> Mechanism:
    """Mechanism with a rigid body in place of each elastic part, at the positions in the scene."""
    stiff = _stiff(scene)
    bodies: dict[str, Body] = {}
    for name, settings in scene.bodies.items():
        if name in parts:
            points = dict(parts[name].points())
            bodies[name] = RigidBody(1.0, 1.0, points, held=parts[name].held, **_pose(settings))
        else:
            bodies[name] = stiff[name]
    return Mechanism(bodies, joints, inputs.drives, inputs.forces, gravity(scene))


def _assembled(
    scene: Scene,
    inputs: Inputs,
    parts: Mapping[str, ElasticPart],
    joints: Mapping[str, Joint | LubricatedJoint],
) -> dict[str, Body]:
    """Bodies in a state that satisfies all joints, with rigid bodies in place of elastic parts."""
    turning = {
        name: Speed(scene.bodies[name].speed, radians(scene.bodies[name].angle))
        for name in scene.drives
        if name not in inputs.drives
    }
    rigid = _rigid(scene, inputs, parts, joints)
    return assembled_bodies(rigid, turning, scene.span)


def _flexible_body(
    settings: schema.FlexibleSettings, reduced: ReducedBody, start: Body
) -> FlexibleBody:
    """Flexible body of a reduced part, with the position and rates of the rigid body `start`."""
    assert isinstance(start, RigidBody)
    return FlexibleBody(
        reduced,
        settings.damping_time,
        settings.mass or None,
        settings.inertia or None,
        settings.centre if any(settings.centre) else None,
        **_pose(start),
    )


def _pose(body: Pose) -> dict[str, Any]:
    """Position, angle and their rates of a body at the start, as keyword arguments of a body."""
    return {field.name: getattr(body, field.name) for field in attrs.fields(Pose)}


def _duration(scene: Scene) -> dict[str, Any]:
    """Keyword arguments of `simulate` for the end time, or for the period and its search."""
    time = scene.time
    if not time.periodic:
        return {"end": scene.span}
    return {"period": scene.span, "periodicity": time.periodicity, "cycles": time.cycles}


def _steps(scene: Scene) -> IntegratorOptions:
    """Options of the time integration from the settings of a scene."""
    time = scene.time
    largest = time.largest_step / (time.revolutions or 1.0)
    return IntegratorOptions(
        time.tolerance, time.order, time.first_step, time.smallest_step, largest
    )
