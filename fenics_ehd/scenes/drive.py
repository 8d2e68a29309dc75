"""What turns the crank and what pushes the piston, from the settings of a slider-crank."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.crank import AngleFunction, ConstantSpeedCrank, DrivenCrank
from fenics_ehd.scenes.slider_crank_settings import Mechanism

if TYPE_CHECKING:
    from fenics_ehd.scenes.angle_table import AngleTable

#: Path that stands for no file.
NO_FILE = "none"


def build_crank(settings: Mechanism) -> ConstantSpeedCrank | DrivenCrank:
    """The crank, at constant speed or under its torque.

    A crank whose centre of mass lies off its axis has the inertia ``I + m r^2`` about it; gravity
    is left out, as everywhere in this scene.

    Raises
    ------
    SettingsError
        A torque is given for a crank at constant speed, or from `read_angle_table`.
    """
    if settings.drive == "speed":
        for key, idle in (
            ("drive_torque", 0.0),
            ("drive_torque_table", NO_FILE),
            ("drive_damping", 0.0),
        ):
            value = getattr(settings, key)
            if value != idle:
                raise SettingsError(
                    f'mechanism.{key} = {value} does nothing at mechanism.drive = "speed": '
                    'set mechanism.drive = "torque"'
                )
        return ConstantSpeedCrank(settings.crank_length, settings.crank_speed)
    return DrivenCrank(
        settings.crank_length,
        settings.crank_speed,
        settings.crank_inertia + settings.crank_mass * settings.crank_centre**2,
        _torque(settings),
        settings.drive_damping,
    )


def _torque(settings: Mechanism) -> AngleFunction:
    """Torque over the crank angle [N m]."""
    constant = settings.drive_torque
    if settings.drive_torque_table == NO_FILE:
        return lambda angle: (constant, 0.0)
    key = "mechanism.drive_torque_table"
    table = _table(settings.drive_torque_table, key, "torque_Nm")
    return replace(table, values=constant + table.values)


def build_gas_force(settings: Mechanism) -> AngleTable | None:
    """Force of the gas on the piston [N], None without."""
    if settings.gas_force == NO_FILE:
        return None
    return _table(settings.gas_force, "mechanism.gas_force", "force_N")


def _table(path: str, key: str, column: str) -> AngleTable:
    # SciPy's splines are for machines that have a table.
    from fenics_ehd.scenes.angle_table import read_angle_table

    return read_angle_table(path, key, column)
