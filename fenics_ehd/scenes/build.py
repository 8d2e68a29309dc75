"""From a scene to its mechanism: what can be refused is, then parts are reduced.

Single entries of a scene stand for bodies, drives and forces, whose tables are read. The mechanism
is assembled with its elastic parts rigid first, to refuse at once what cannot move.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from math import degrees, radians
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np
from mpi4py import MPI

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.needs import NONE
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.body import Body, FlexibleBody, PlanarBody, Pose, RigidBody, ground
from fenics_ehd.multibody.forces import (
    Force,
    PointForce,
    RotatingForce,
    SpringDamper,
    Table,
    Torque,
)
from fenics_ehd.multibody.joints import AngleOverTime, Joint, Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism, System, assemble, check_inertia
from fenics_ehd.multibody.periodic import check_period
from fenics_ehd.multibody.shaft import ShaftBody
from fenics_ehd.multibody.tabulated import Curve
from fenics_ehd.reduction.body import ReducedBody, load_body
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.films import (
    lubricated_joint,
    reference_rate,
    supply_tables,
)
from fenics_ehd.scenes.library import table_file
from fenics_ehd.scenes.scene import Scene, flexible, meshed
from fenics_ehd.scenes.tables import read_angle_table, read_load, read_time_table

if TYPE_CHECKING:
    from fenics_ehd.scenes.part import ElasticPart, ReducedPart


def _pose(body: Pose) -> dict[str, Any]:
    """Origin and angle of a body at the start, and their rates."""
    return {field.name: getattr(body, field.name) for field in attrs.fields(Pose)}


def _curve(read: Callable[..., Curve], file: str, key: str, column: str, unit: str) -> Curve | None:
    """The curve of a table that a key names, None where it names none."""
    if file == NONE:
        return None
    return read(table_file(file, key), key, {column: {unit: 1.0}})


def imposed_angles(scene: Scene) -> dict[str, AngleOverTime]:
    """Given angles over time by body."""
    found: dict[str, AngleOverTime] = {}
    for name, drive in scene.drives.items():
        if not isinstance(drive, Speed):
            continue
        if drive.speed and drive.table != NONE:
            raise SettingsError(f"drives.{name}: give a speed or a table, one of them")
        key, start = f"drives.{name}.table", radians(scene.bodies[name].angle)
        curve = _curve(read_time_table, drive.table, key, "speed", "rad_per_s")
        found[name] = attrs.evolve(drive, start=start, curve=curve)
    return found


def forces(scene: Scene) -> dict[str, Force]:
    """Forces by name, gravity left out, and torques of drives."""
    found: dict[str, Force] = {}
    for name, entry in scene.forces.items():
        key = f"forces.{name}"
        if isinstance(entry, RotatingForce | SpringDamper):
            found[name] = entry
        elif isinstance(entry, schema.ConstantForceSettings):
            size = float(np.hypot(*entry.force))
            found[name] = PointForce(entry.point, entry.force, _constant(size))
        elif isinstance(entry, schema.TimeTableSettings):
            file = table_file(entry.file, f"{key}.file")
            x, y = read_load(file, entry.scale, entry.interpolation, entry.period, key)
            found[f"{name}.x"] = PointForce(entry.point, (1.0, 0.0), x)
            found[f"{name}.y"] = PointForce(entry.point, (0.0, 1.0), y)
        elif isinstance(entry, schema.AngleTableSettings):
            file = table_file(entry.file, f"{key}.file")
            size_of = read_angle_table(file, f"{key}.file", {"force": {"N": 1.0}})
            size_of = size_of.scaled(entry.scale)
            found[name] = PointForce(entry.point, entry.direction, size_of, entry.angle_of)
    for name, drive in scene.drives.items():
        if isinstance(drive, Torque):
            read = read_angle_table if drive.over == "angle" else read_time_table
            curve = _curve(read, drive.table, f"drives.{name}.table", "torque", "Nm")
            found[f"drive of {name}"] = attrs.evolve(drive, body=name, curve=curve)
    return found


def _constant(size: float) -> Table:
    return lambda _: (size, 0.0)


def gravity(scene: Scene) -> tuple[float, float]:
    """Sum of all gravities [m/s^2]."""
    given = [g.acceleration for g in scene.forces.values() if isinstance(g, schema.GravitySettings)]
    x, y = np.sum([(0.0, 0.0), *given], axis=0)
    return float(x), float(y)


#: Places at which a driven mechanism is assembled between its start and its end, at least, and
#: angle of the fastest drive between two [rad].
PLACES, APART = 4, radians(10.0)


#: Size below which assembled coordinates and rates are round-off of zero; keys have none so small.
NOTHING = 1e-20


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
    z, rates = (np.where(np.abs(found) < NOTHING, 0.0, found) for found in (z, rates))
    places = system.bodies
    return {n: _placed(b, z[places[n]], rates[places[n]]) for n, b in mechanism.bodies.items()}


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
        return attrs.evolve(body, angle=degrees(z[0]), speed=float(rates[0]))
    if not isinstance(body, PlanarBody) or not body.size:
        return body
    (x, y, angle), (vx, vy, speed) = z[:3].tolist(), rates[:3].tolist()
    return attrs.evolve(body, position=(x, y), angle=degrees(angle), velocity=(vx, vy), speed=speed)


@dataclass(frozen=True, eq=False)
class Machine:
    """A machine that a scene stands for.

    Attributes
    ----------
    mechanism
        What moves.
    bodies
        Reduced bodies by body name, those of files too.
    reduced
        Those that were reduced here, with what displacement fields need.
    seconds
        Time to mesh and reduce them [s].
    end, period
        One of them, the other None [s].
    steps
        How to step.
    options
        Keywords of `simulate`: all of this.
    """

    mechanism: Mechanism
    bodies: Mapping[str, ReducedBody]
    reduced: Mapping[str, ReducedPart]
    seconds: float
    end: float | None
    period: float | None
    steps: IntegratorOptions
    options: Mapping[str, Any]


def build(
    scene: Scene,
    comm: MPI.Comm = MPI.COMM_SELF,
    *,
    bodies: Mapping[str, ReducedBody] | None = None,
    announce: Callable[[Iterable[str]], None] | None = None,
) -> Machine:
    """Machine that a scene stands for, its parts meshed and reduced; collective.

    Parameters
    ----------
    scene
        As read.
    comm
        Ranks that share the reductions, or this process alone; all of them get the mechanism.
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
    require_class("scene", scene, Scene)
    loads_of = imposed_angles(scene), forces(scene)
    stiff = {
        name: ground(settings.points) if isinstance(settings, schema.GroundSettings) else settings
        for name, settings in scene.bodies.items()
        if not isinstance(settings, schema.FlexibleSettings)
    }
    if scene.time.periodic:
        rigid, periodicity = Mechanism(stiff, {}, *loads_of), scene.time.periodicity
        check_period(rigid, scene.span, periodicity, supply_tables(scene))
    if announce is not None:
        announce(name for name in meshed(scene) if name not in (bodies or {}))
    start = perf_counter()
    parts = _parts(scene, comm, bodies or {})
    seconds = perf_counter() - start
    joints = _joints(scene, parts)
    ideal = _ideal(scene, parts, stiff, joints, *loads_of)
    start = perf_counter()
    wanted = scene.output.error_budget and scene.output.part_mesh_error
    reduced, found = {}, {}
    for name, part in parts.items():
        if isinstance(part.source, ReducedBody):
            found[name] = part.source
        else:
            reduced[name] = part.reduce(mesh_error=wanted)
            found[name] = reduced[name].body
    seconds += perf_counter() - start
    if reduced:
        # To the last bit where a body read from its file starts: points of a mesh are rounded.
        parts = {name: replace(part, source=found[name]) for name, part in parts.items()}
        ideal = _ideal(scene, parts, stiff, joints, *loads_of)
    placed = dict(ideal.bodies)
    for name, part in parts.items():
        stand_in, own = ideal.bodies[name], part.settings
        assert isinstance(stand_in, RigidBody)
        total = own.mass or None, own.inertia or None, own.centre if any(own.centre) else None
        placed[name] = FlexibleBody(found[name], own.damping_time, *total, **_pose(stand_in))
    steps = _steps(scene)
    span: dict[str, Any] = {"end": scene.span}
    if scene.time.periodic:
        span = {
            "period": scene.span,
            "periodicity": scene.time.periodicity,
            "cycles": scene.time.cycles,
        }
    return Machine(
        replace(ideal, bodies=placed),
        found,
        reduced,
        seconds if reduced else 0.0,
        span.get("end"),
        span.get("period"),
        steps,
        span | vars(steps),
    )


def _steps(scene: Scene) -> IntegratorOptions:
    time = scene.time
    largest = time.largest_step / (time.revolutions or 1.0)
    return IntegratorOptions(
        time.tolerance, time.order, time.first_step, time.smallest_step, largest
    )


def _parts(
    scene: Scene, comm: MPI.Comm, reduced: Mapping[str, ReducedBody]
) -> dict[str, ElasticPart]:
    """Elastic parts, not yet reduced."""
    if not flexible(scene):
        return {}
    # Imports all reductions.
    from fenics_ehd.scenes.part import ElasticPart, elastic_part, model_file, require_snapshots

    for name in flexible(scene):  # all files are there before the first part is meshed
        settings = scene.bodies[name]
        if name not in reduced and settings.model != NONE:
            model_file(settings, f"bodies.{name}")
            require_snapshots(settings, f"bodies.{name}")
        elif name not in reduced and not Path(settings.body).is_file():
            load_body(settings.body)
    found = {}
    for name in flexible(scene):
        settings, element = scene.bodies[name], scene.film_element(name)
        if name in reduced:
            found[name] = ElasticPart(settings, reduced[name], element)
        else:
            found[name] = elastic_part(settings, f"bodies.{name}", element, comm)
    return found


def _joints(scene: Scene, parts: Mapping[str, ElasticPart]) -> dict[str, Joint | LubricatedJoint]:
    """Joints with their films, every journal in a bore that it fits."""
    joints, rate = dict(scene.joints), reference_rate(scene)
    for name, joint in scene.films.items():
        elastic = scene.elastic_bore(joint)
        bore = parts[elastic[0]].bore(elastic[1], f"joints.{name}.bore") if elastic else None
        joints[name] = lubricated_joint(scene, name, bore, rate)
    return joints


def _ideal(
    scene: Scene,
    parts: Mapping[str, ElasticPart],
    stiff: Mapping[str, Body],
    joints: Mapping[str, Joint | LubricatedJoint],
    drives: Mapping[str, AngleOverTime],
    forces: Mapping[str, Force],
) -> Mechanism:
    """The mechanism with its elastic parts rigid, assembled."""
    bodies: dict[str, Body] = {}
    for name, settings in scene.bodies.items():
        if name in parts:
            points, held = dict(parts[name].points()), parts[name].held
            bodies[name] = RigidBody(1.0, 1.0, points, held=held, **_pose(settings))
        else:
            bodies[name] = stiff[name]
    turning = {
        name: Speed(scene.bodies[name].speed, radians(scene.bodies[name].angle))
        for name in scene.drives
        if name not in drives
    }
    ideal = Mechanism(bodies, joints, drives, forces, gravity(scene))
    return replace(ideal, bodies=assembled_bodies(ideal, turning, scene.span))
