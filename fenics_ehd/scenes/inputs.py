"""Files and tables to which a scene refers, read and checked before any part is meshed.

One entry of a scene may become several forces or drives. A load over time becomes two forces,
along x and along y; a drive by a torque becomes a force.

Imports inside functions: `fenics_ehd.scenes.part` imports all reductions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path

import attrs
import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.needs import NONE
from fenics_ehd.film.kinematics import ShapeTable, is_shape
from fenics_ehd.film.supply import Head, Supply
from fenics_ehd.multibody.forces import (
    Force,
    PointForce,
    RotatingForce,
    SpringDamper,
    Table,
    Torque,
    Unbalance,
)
from fenics_ehd.multibody.joints import AngleOverTime, Speed
from fenics_ehd.multibody.tabulated import Curve
from fenics_ehd.reduction.body import ReducedBody, load_body
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.library import table_file
from fenics_ehd.scenes.scene import Scene, flexible, joint_lubricant
from fenics_ehd.scenes.shape_tables import read_shape_table
from fenics_ehd.scenes.tables import (
    PRESSURES,
    read_angle_table,
    read_load,
    read_time_table,
    require_closed,
)

#: Settings of a lubricated joint that hold the shapes of its surfaces.
SURFACES = ("bore_shape", "journal_shape")


@dataclass(frozen=True, eq=False)
class Inputs:
    """Contents of all files and tables of a scene.

    Attributes
    ----------
    drives
        Imposed angles over time, by the name of the driven body.
    forces
        Forces and torques by name, except gravity.
    supplies
        Oil supplies of every lubricated joint, by the joint's name.
    shapes
        Measured deviations of bores and journals, by the key of their table.
    bodies
        Reduced bodies that exist already, by body name; the other parts must be meshed.
    """

    drives: Mapping[str, AngleOverTime]
    forces: Mapping[str, Force]
    supplies: Mapping[str, tuple[Supply, ...]]
    shapes: Mapping[str, ShapeTable]
    bodies: Mapping[str, ReducedBody]

    @property
    def supply_curves(self) -> dict[str, Curve]:
        """Supply pressures over time [Pa], by key, of the supplies that have a table."""
        curves = {
            f"joints.{joint}.supply.{supply.name}": supply.curve
            for joint, supplies in self.supplies.items()
            for supply in supplies
        }
        return {key: curve for key, curve in curves.items() if isinstance(curve, Curve)}


def read_inputs(scene: Scene, bodies: Mapping[str, ReducedBody]) -> Inputs:
    """Read every file and table to which a scene refers.

    Parameters
    ----------
    scene
        The scene.
    bodies
        Reduced bodies by body name; they are used in place of the scene's models and files.

    Raises
    ------
    SettingsError, MeshError, BodyFileError
        A file or value cannot be used; the message names it.
    """
    drives = imposed_angles(scene)
    acting = forces(scene)
    supplies = {name: supplies_of(scene, name) for name in scene.films}
    return Inputs(drives, acting, supplies, _shapes(scene), _bodies(scene, bodies))


def imposed_angles(scene: Scene) -> dict[str, AngleOverTime]:
    """Drives that impose an angle over time, by the name of the driven body."""
    drives: dict[str, AngleOverTime] = {}
    for name, drive in scene.drives.items():
        if not isinstance(drive, Speed):
            continue
        if drive.speed and drive.table != NONE:
            raise SettingsError(f"drives.{name}: give either a speed or a table")
        start = radians(scene.bodies[name].angle)
        curve = _curve(read_time_table, drive.table, f"drives.{name}.table", "speed", "rad_per_s")
        drives[name] = attrs.evolve(drive, start=start, curve=curve)
    return drives


def forces(scene: Scene) -> dict[str, Force]:
    """Forces of a scene by name, including the torques of its drives, but without gravity."""
    acting: dict[str, Force] = {}
    for name, entry in scene.forces.items():
        key = f"forces.{name}"
        if isinstance(entry, RotatingForce | SpringDamper | Unbalance):
            acting[name] = entry
        elif isinstance(entry, schema.ConstantForceSettings):
            size = float(np.hypot(*entry.force))
            acting[name] = PointForce(entry.point, entry.force, _constant(size))
        elif isinstance(entry, schema.TimeTableSettings):
            file = table_file(entry.file, f"{key}.file")
            x, y = read_load(file, entry.scale, entry.interpolation, entry.period, key)
            acting[f"{name}.x"] = PointForce(entry.point, (1.0, 0.0), x)
            acting[f"{name}.y"] = PointForce(entry.point, (0.0, 1.0), y)
        elif isinstance(entry, schema.AngleTableSettings):
            file = table_file(entry.file, f"{key}.file")
            size_of = _force_over_angle(file, key, entry).scaled(entry.scale)
            acting[name] = PointForce(entry.point, entry.direction, size_of, entry.angle_of)
    for name, drive in scene.drives.items():
        if isinstance(drive, Torque):
            read = read_angle_table if drive.over == "angle" else read_time_table
            curve = _curve(read, drive.table, f"drives.{name}.table", "torque", "Nm")
            acting[f"drive of {name}"] = attrs.evolve(drive, body=name, curve=curve)
    return acting


def _force_over_angle(file: Path, key: str, entry: schema.AngleTableSettings) -> Curve:
    """Force over an angle [N], from a table of forces, or of pressures on a piston."""
    if not entry.piston_diameter:
        hint = f"; a table of pressures needs {key}.piston_diameter"
        return read_angle_table(file, f"{key}.file", {"force": {"N": 1.0, "kN": 1e3}}, hint=hint)
    hint = f"; a table of forces needs no {key}.piston_diameter"
    pressure = read_angle_table(
        file, f"{key}.file", {"pressure": PRESSURES}, less=entry.crankcase_pressure, hint=hint
    )
    highest = float(np.max(pressure.curve(pressure.curve.x)))
    if highest <= 0.0:
        raise SettingsError(
            f"{key}.file: no pressure of the table is above {key}.crankcase_pressure = "
            f"{entry.crankcase_pressure:g} Pa: check the unit in the heading, pressure_bar for "
            "instance"
        )
    return pressure.scaled(np.pi * entry.piston_diameter**2 / 4)


def _constant(size: float) -> Table:
    """Constant function of time, whose values are a force [N] and its derivative, 0 N/s."""
    return lambda _: (size, 0.0)


def _curve(read: Callable[..., Curve], file: str, key: str, column: str, unit: str) -> Curve | None:
    """Curve that `read` makes from the table file of a setting; None if the setting is "none"."""
    if file == NONE:
        return None
    return read(table_file(file, key), key, {column: {unit: 1.0}})


def gravity(scene: Scene) -> tuple[float, float]:
    """Sum of the accelerations of all gravity entries of a scene [m/s^2]."""
    settings = [g for g in scene.forces.values() if isinstance(g, schema.GravitySettings)]
    x, y = np.sum([(0.0, 0.0), *(g.acceleration for g in settings)], axis=0)
    return float(x), float(y)


def supplies_of(scene: Scene, name: str) -> tuple[Supply, ...]:
    """Oil supplies of a lubricated joint, with their names and pressure curves.

    Raises
    ------
    SettingsError
        A supply has both a pressure and a table, its table cannot be used, or the pressure in its
        drilling is unknown.
    """
    supplies = []
    for label, supply in scene.joints[name].supply.items():
        key = f"joints.{name}.supply.{label}"
        curve = _pressure_curve(supply, key, periodic=scene.time.periodic)
        complete = attrs.evolve(supply, name=label, curve=curve)
        if any(supply.head_radius):
            complete = attrs.evolve(complete, head=_head(scene, name, complete, key))
        supplies.append(complete)
    return tuple(supplies)


def _head(scene: Scene, name: str, supply: Supply, key: str) -> Head:
    """Pressure rise in the drilling of a supply, whose body a drive turns at a known speed.

    A drive imposes the speed over time: the rise does not depend on the unknowns of a step.

    Raises
    ------
    SettingsError
        A radius is negative, no drive imposes the speed of the body, or the pressure at the film
        would be below the cavitation pressure.
    """
    begin, end = supply.head_radius
    setting = f"{key}.head_radius = [{begin:g}, {end:g}] m"
    if begin < 0.0 or end < 0.0:
        raise SettingsError(f"{setting} must be two distances from the axis, at least 0")
    joint = scene.joints[name]
    body = (joint.journal if supply.on_journal else joint.bore).partition(".")[0]
    drive = imposed_angles(scene).get(body)
    if not isinstance(drive, Speed):
        raise SettingsError(
            f"{setting} needs the speed of {body}, the body with the {supply.on}: give "
            f"drives.{body} of kind speed, or on = the side with the drilling, journal or bore, "
            "or drop head_radius and add the rise to pressure"
        )
    rise = Head((begin, end), joint_lubricant(scene, joint).density, drive)
    supplied = attrs.evolve(supply, head=rise)
    curves = (curve for curve in (supply.curve, drive.curve) if isinstance(curve, Curve))
    times = np.concatenate([[0.0], *(curve.curve.x for curve in curves)])
    least = min(supplied.pressure_at(time) for time in times)
    if least < 0.0:
        raise SettingsError(
            f"{setting} gives {least:g} Pa at the film, below 0, the cavitation pressure: raise "
            f"{key}.pressure to {supply.pressure - least:.4g} or more"
        )
    return rise


def _pressure_curve(supply: Supply, key: str, *, periodic: bool) -> Curve | None:
    """Supply pressure over time, periodic in a periodic scene; None if the supply has no table."""
    if supply.table == NONE:
        return None
    if supply.pressure:
        raise SettingsError(f"{key}: give either a pressure or a table")
    path = table_file(supply.table, f"{key}.table")
    curve = read_time_table(path, f"{key}.table", {"pressure": {"Pa": 1.0, "bar": 1e5}})
    values = np.array([curve(row)[0] for row in curve.curve.x])
    if values.min() < 0.0:
        raise SettingsError(
            f"{key}.table {path} has a pressure of {values.min():g} Pa: pressures must be at least "
            "0, the cavitation pressure"
        )
    if periodic:
        ends = values[[0, -1]][:, None]
        require_closed(f"{key}.table {path}", ends, "make the table periodic, or the run not")
    return replace(curve, periodic=periodic)


def _shapes(scene: Scene) -> dict[str, ShapeTable]:
    """Measured deviations of bores and journals, by the key of their table."""
    deviations = {
        f"joints.{name}.{surface}.table": getattr(joint, surface)
        for name, joint in scene.films.items()
        for surface in SURFACES
    }
    files = {key: each.table for key, each in deviations.items() if not is_shape(each)}
    return {key: read_shape_table(file, key) for key, file in files.items() if file != NONE}


def _bodies(scene: Scene, given: Mapping[str, ReducedBody]) -> dict[str, ReducedBody]:
    """Reduced bodies of a scene that exist already, by name; other bodies need a model file."""
    bodies: dict[str, ReducedBody] = {}
    for name in flexible(scene):
        settings = scene.bodies[name]
        if name in given:
            bodies[name] = given[name]
        elif settings.model == NONE:
            bodies[name] = load_body(settings.body)
        else:
            from fenics_ehd.scenes.part import model_file, require_snapshots

            model_file(settings, f"bodies.{name}")
            require_snapshots(settings, f"bodies.{name}")
    return bodies
