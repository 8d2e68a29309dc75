"""Drives and forces of a scene, their tables read."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.forces import (
    Force,
    PointForce,
    RotatingForce,
    SpringDamper,
    Table,
    Torque,
)
from fenics_ehd.multibody.joints import AngleOverTime, Speed, SpeedTable
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.scene import Scene


def table_file(name: str, key: str) -> Path:
    """Path of a table, shipped or a file of its own.

    Raises
    ------
    SettingsError
        There is no shipped one of that name.
    """
    if Path(name).suffix:
        return Path(name)
    tables = resources.files("fenics_ehd.scenes") / "tables"
    path = Path(str(tables / f"{name}.csv"))
    if not path.is_file():
        known = ", ".join(sorted(p.name.removesuffix(".csv") for p in tables.iterdir()))
        raise SettingsError(f"{key} = {name!r}: neither a .csv file nor a shipped table: {known}")
    return path


def imposed_angles(scene: Scene) -> dict[str, AngleOverTime]:
    """Given angles over time by body."""
    found: dict[str, AngleOverTime] = {}
    for name, drive in scene.drives.items():
        if isinstance(drive, schema.SpeedSettings):
            start = float(np.radians(scene.bodies[name].angle))
            found[name] = _motion(drive, start, f"drives.{name}")
    return found


def _motion(drive: schema.SpeedSettings, start: float, key: str) -> AngleOverTime:
    if drive.table == NONE:
        return Speed(drive.speed, start)
    if drive.speed:
        raise SettingsError(f"{key}: give a speed or a table, one of them")
    # SciPy's splines are for mechanisms that have a table.
    from fenics_ehd.scenes.time_table import read_time_table

    path = table_file(drive.table, f"{key}.table")
    return SpeedTable(read_time_table(path, f"{key}.table", {"speed": {"rad_per_s": 1.0}}), start)


def torques(scene: Scene) -> dict[str, Force]:
    """Torques of drives by name."""
    return {
        f"drive of {name}": Torque(
            name,
            _torque(drive, f"drives.{name}.table"),
            drive.over == "angle",
            drive.damping,
            drive.speed,
        )
        for name, drive in scene.drives.items()
        if isinstance(drive, schema.TorqueSettings)
    }


def _torque(drive: schema.TorqueSettings, key: str) -> Table:
    constant = drive.torque
    if drive.table == NONE:
        return lambda _: (constant, 0.0)
    from fenics_ehd.scenes.angle_table import read_angle_table
    from fenics_ehd.scenes.time_table import read_time_table

    read = read_angle_table if drive.over == "angle" else read_time_table
    return read(table_file(drive.table, key), key, {"torque": {"Nm": 1.0}}).scaled(1.0, constant)


def forces(scene: Scene) -> dict[str, Force]:
    """Forces by name, gravity left out."""
    found: dict[str, Force] = {}
    for name, settings in scene.forces.items():
        found |= _forces(name, settings)
    return found


def gravity(scene: Scene) -> tuple[float, float]:
    """Sum of all gravities [m/s^2]."""
    given = [g.acceleration for g in scene.forces.values() if isinstance(g, schema.GravitySettings)]
    x, y = np.sum([(0.0, 0.0), *given], axis=0)
    return float(x), float(y)


def _forces(name: str, settings: Any) -> dict[str, Force]:
    """What one entry of a scene stands for."""
    key = f"forces.{name}"
    if isinstance(settings, schema.RotatingSettings):
        turning = (settings.amplitude, settings.speed, settings.ramp)
        return {name: RotatingForce(settings.point, *turning)}
    if isinstance(settings, schema.SpringDamperSettings):
        first, second = settings.between
        return {name: SpringDamper(first, second, settings.stiffness, settings.damping)}
    if isinstance(settings, schema.ConstantForceSettings):
        size = float(np.hypot(*settings.force))
        if not size:
            raise SettingsError(f"{key}.force = [0, 0] does nothing: take the table out")
        return {name: PointForce(settings.point, settings.force, lambda _: (size, 0.0))}
    if isinstance(settings, schema.TimeTableSettings):
        return _over_time(name, settings, key)
    if isinstance(settings, schema.AngleTableSettings):
        return {name: _over_angle(settings, key)}
    return {}


def _over_time(name: str, settings: schema.TimeTableSettings, key: str) -> dict[str, Force]:
    from fenics_ehd.scenes.load_history import read_load

    curves = read_load(
        table_file(settings.file, f"{key}.file"),
        scale=settings.scale,
        interpolation=settings.interpolation,
        period=settings.period,
        section=key,
    )
    along = {"x": (1.0, 0.0), "y": (0.0, 1.0)}
    return {
        f"{name}.{axis}": PointForce(settings.point, direction, curve)
        for (axis, direction), curve in zip(along.items(), curves, strict=True)
    }


def _over_angle(settings: schema.AngleTableSettings, key: str) -> Force:
    from fenics_ehd.scenes.angle_table import read_angle_table

    path = table_file(settings.file, f"{key}.file")
    table = read_angle_table(path, f"{key}.file", {"force": {"N": 1.0}}).scaled(settings.scale)
    return PointForce(settings.point, settings.direction, table, settings.angle_of)
