"""What ``fenics-ehd bearing`` answers: its table, its JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import attrs

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.bearing.operating_point import BearingResult
    from fenics_ehd.bearing.settings import BearingSettings


def summary(result: BearingResult) -> dict[str, Any]:
    """Figures of a bearing by their names in the JSON output."""
    values: dict[str, Any] = {
        "load_N": result.load,
        "attitude_angle_deg": _degrees(result.attitude),
        "max_pressure_Pa": result.max_pressure,
        "max_pressure_angle_deg": _degrees(result.max_pressure_angle),
        "min_film_thickness_m": result.min_film_thickness,
        "eccentricity_ratio": result.eccentricity_ratio,
        "sommerfeld_number": result.sommerfeld_number,
        "side_flow_m3_per_s": result.flow.side,
        "supply_flow_m3_per_s": result.flow.supply,
        "friction_torque_Nm": result.friction_torque,
        "power_loss_W": result.power_loss,
        "tilting_moment_Nm": result.tilting_moment.tolist(),
    }
    contact = result.contact
    if contact is not None:
        values |= {
            "contact_load_N": contact.load,
            "contact_share": contact.share,
            "max_contact_pressure_Pa": contact.max_pressure,
            "contact_power_W": contact.power,
            "friction_coefficient": result.friction_coefficient,
        }
    if result.settings.graded:
        lubricant = result.bearing.film.parameters.lubricant
        values |= {
            "temperature_C": lubricant.temperature,
            "viscosity_Pa_s": lubricant.viscosity,
            "density_kg_per_m3": lubricant.density,
        }
    heat = result.heat
    if heat is not None:
        values |= {
            "supply_temperature_C": heat.supply_temperature,
            "effective_temperature_C": heat.effective_temperature,
            "outlet_temperature_C": heat.outlet_temperature,
            "dissipated_power_W": heat.power,
            "leaving_flow_m3_per_s": heat.flow,
        }
    linear = result.coefficients
    if linear is not None:
        values |= {
            "stiffness_N_per_m": linear.stiffness.tolist(),
            "damping_Ns_per_m": linear.damping.tolist(),
            "stability_threshold": linear.threshold,
            "critical_mass_kg": linear.critical_mass,
            "whirl_frequency_ratio": linear.whirl_ratio,
        }
    return {**values, "settings": _plain(result.settings)}


def _plain(value: Any) -> Any:
    """Settings as JSON has them, a shape with its kind."""
    if attrs.has(type(value)):
        return {a.name: _plain(getattr(value, a.name)) for a in attrs.fields(type(value))}
    if is_dataclass(value):
        own = {f.name: _plain(getattr(value, f.name)) for f in fields(value) if f.init}
        return {"kind": type(value).__name__, **own}
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    return value.tolist() if hasattr(value, "tolist") else value


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else math.degrees(angle)


#: Rows of the table, where a bearing has the figure: label, key, factor, unit.
ROWS = (
    ("load", "load_N", 1, "N"),
    ("eccentricity ratio", "eccentricity_ratio", 1, ""),
    ("attitude angle", "attitude_angle_deg", 1, "degrees"),
    ("Sommerfeld number", "sommerfeld_number", 1, ""),
    ("maximum pressure", "max_pressure_Pa", 1e-6, "MPa"),
    ("  from the maximum film", "max_pressure_angle_deg", 1, "degrees"),
    ("minimum film thickness", "min_film_thickness_m", 1e6, "um"),
    ("side flow", "side_flow_m3_per_s", 1e6, "cm3/s"),
    ("friction torque", "friction_torque_Nm", 1, "N m"),
    ("power loss", "power_loss_W", 1, "W"),
    ("viscosity of the oil", "viscosity_Pa_s", 1, "Pa s"),
    ("supply temperature", "supply_temperature_C", 1, "C"),
    ("effective temperature", "effective_temperature_C", 1, "C"),
    ("outlet temperature", "outlet_temperature_C", 1, "C"),
    ("power dissipated", "dissipated_power_W", 1, "W"),
    ("oil that leaves", "leaving_flow_m3_per_s", 1e6, "cm3/s"),
)

#: Behind what only some bearings show.
MORE_ROWS = (
    ("load carried by contact", "contact_load_N", 1, "N"),
    ("maximum contact pressure", "max_contact_pressure_Pa", 1e-6, "MPa"),
    ("power lost in contact", "contact_power_W", 1, "W"),
    ("coefficient of friction", "friction_coefficient", 1, ""),
)


def report(result: BearingResult) -> str:
    """The figures in a table."""
    values, settings = summary(result), result.settings
    lines = [_given(settings), *_rows(ROWS, values)]
    if settings.grooves or settings.line_at_max_film:
        lines.append(_row("supply flow", values["supply_flow_m3_per_s"], 1e6, "cm3/s"))
    if any(settings.tilt):
        moment = "  ".join(f"{m:.5g}" for m in values["tilting_moment_Nm"])
        lines.append(f"{'tilting moment on shaft':<26}{moment} N m  about x, y")
    lines += _rows(MORE_ROWS, values)
    if result.coefficients is not None:
        lines += _linear_rows(values)
        if settings.line_at_max_film:
            how = "stays where it is" if settings.line_held else "turns with the eccentricity"
            lines.append(f"coefficients of a line at the maximum film that {how}")
    lines.append(
        f"{settings.cells_around} x {settings.cells_along} {settings.element} cells, shear in the "
        f"cavitated zone: {settings.shear_rule}"
    )
    return "\n".join(lines)


def _given(settings: BearingSettings) -> str:
    """The bearing in words."""
    oil = settings.grade if settings.graded else f"viscosity {settings.viscosity:g} Pa s"
    speeds = f"shaft at {settings.speed:g} rad/s"
    if settings.bore_speed:
        speeds += f", bore at {settings.bore_speed:g} rad/s"
    return (
        f"bearing of radius {settings.radius * 1e3:g} mm, width {settings.width * 1e3:g} mm, "
        f"clearance {settings.clearance * 1e6:g} um, {oil}, {speeds}"
    )


def _linear_rows(values: Mapping[str, Any]) -> list[str]:
    lines = []
    for label, key, unit in (
        ("stiffness", "stiffness_N_per_m", "N/m"),
        ("damping", "damping_Ns_per_m", "N s/m"),
    ):
        for name, row in zip("xy", values[key], strict=True):
            head = f"{label} {name}x, {name}y"
            lines.append(f"{head:<26}{row[0]:>12.5g} {row[1]:>12.5g} {unit}")
    if values["critical_mass_kg"] is None:
        lines.append(f"{'stability':<26}at every speed")
    else:
        lines.append(_row("critical mass", values["critical_mass_kg"], 1, "kg"))
        lines.append(_row("stability threshold", values["stability_threshold"], 1, ""))
    return lines


def _row(label: str, value: float | None, factor: float, unit: str) -> str:
    number = "undefined" if value is None else f"{factor * value:.5g}"
    return f"{label:<26}{number:>12} {unit}".rstrip()


def _rows(rows: tuple[tuple[str, str, float, str], ...], values: Mapping[str, Any]) -> list[str]:
    return [
        _row(label, values[key], factor, unit) for label, key, factor, unit in rows if key in values
    ]
