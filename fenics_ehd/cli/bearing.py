"""``fenics-ehd bearing``: options, solution, printed table and JSON of one rigid bearing.

Imports inside functions: ``--help`` must work without NumPy and films, and quickly.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import attrs
import click

from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import FILM_ELEMENTS
from fenics_ehd.base.files import keeping_failed_film
from fenics_ehd.base.needs import NO_TEMPERATURE, NONE
from fenics_ehd.base.printed import scatter_text
from fenics_ehd.base.settings import build, require_effects, setting_names
from fenics_ehd.base.shared_settings import Deviations
from fenics_ehd.cli.options import (
    FILE,
    Measured,
    MeasuredRange,
    answer,
    flag,
    json_option,
    question,
    setting_options,
    warn_of,
)

if TYPE_CHECKING:
    import numpy as np

    from fenics_ehd.analysis.bearing import BearingResult
    from fenics_ehd.film.kinematics import Shape


DRAWING = r"""  maximum film    . . . . .
              .               .             O    centre of the bore
           .                     .          S    centre of the shaft
         .           o o o o       .        x    load line: W acts on the shaft
       .         o             o     .      y    a quarter turn on
      .        o                 o    .          in direction of rotation
      .       o                   o   .
      .       o      O------------------> y      The shaft turns from x to y,
      .       o      | \          o   .          here counter-clockwise.
       .       o     |   S       o   .
         .       o   |         o   .        phi    attitude angle, from x to the
           .       o | o o o o   .                 line of centres OS
              .      |        .             theta  from the maximum film, in
                  . .|. . .   minimum film         direction of rotation
                     v
                     x"""

DESCRIPTION = f"""Operating point of one rigid bearing, at a given eccentricity or load, or a map
of several.

\b
{DRAWING}

The load acts on the shaft along x; the pressure of the film on the shaft balances it. The axis y
is a quarter turn from x in direction of rotation. The axis z is that of the shaft, in the sense in
which the shaft turns positively. With a negative speed this frame turns over, so that
the figures of a bearing do not depend on the sense of rotation. All angles on the
command line and in the results are in degrees, tilts in radians.

The oil cavitates where its pressure would fall below zero (Reynolds condition: p and dp/dn
vanish at the edge of the film). load_N is the resultant of the pressure alone: the shear force,
smaller by clearance / radius, enters only friction and power. The gap leaves out the curvature
term e_t^2 / 2R, as classical tables do; this changes the load by up to clearance / radius.
The friction torque acts on the shaft and is positive if it brakes the shaft. In the cavitated zone
the oil fills h_rupture / h of the width (--shear-rule streamers), the full width (full) or
nothing (none). Grooves are deep and have no friction. The power loss is the power that shaft and
bore transfer to the film. The side flow leaves through both sides. With a groove under pressure
it grows slowly with the number of cells, because the pressure jumps where the groove meets the
side.

A bore that is not round (--ovality and the options after it) does not rotate in this frame, nor
do grooves. Its deviations are positive outward, where they widen the gap. For a misaligned bore,
give the shaft the opposite tilt.

The Sommerfeld number is eta N / p (R / c)^2 with p = W / (2 R B). N is the sum of the speeds of
shaft and bore, in revolutions per second, because this sum draws the oil in. The coefficients are
k_ij = -dF_i / dx_j and b_ij = -dF_i / dv_j of the film force F on the shaft. They are means over
--meshes film meshes, because the coefficients of one mesh jump when the edge of the film meets
another row of nodes; their scatter is half the range over these meshes. The critical mass M is the
mass of a rigid rotor, per bearing, at the threshold of oil whirl; the whirl ratio is its whirl
frequency at the threshold over the speed. stability_threshold is omega sqrt(c M / W). This equals
omega_th sqrt(c / g) for a rotor whose weight is the load. Both are null if the rotor is stable at
every speed. With several speeds or loads the coefficients are computed at all combinations; a point
without a result is named, the others are kept, and the command exits with 1.
With --line-at-max-film the line of zero pressure keeps its position when the shaft
moves, like a groove.
"""


def bore_shape(width: float, clearance: float, deviations: Mapping[str, Any]) -> Shape | None:
    """Shape of a bore from the options for its deviations; None for a round bore.

    Raises
    ------
    SettingsError
        An option, or the table of the bore's shape, is faulty; the message names the option or the
        fault of the table.
    """
    settings = build(Deviations, deviations)
    require_effects(settings)
    if settings == Deviations():
        return None
    from fenics_ehd.multibody.notices import stepped_shape
    from fenics_ehd.scenes.films import surface_shape
    from fenics_ehd.scenes.shape_tables import read_shape_table

    measured = None if settings.table == NONE else read_shape_table(settings.table, "table")
    shape = surface_shape(settings, "", width, clearance, measured)
    warn_of(stepped_shape("bore_shape", shape))
    return shape


def summary(result: BearingResult) -> dict[str, Any]:
    """Content of the JSON output: results and settings of a bearing, by name."""
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
        lubricant = result.film.parameters.lubricant
        values |= {
            "temperature_C": lubricant.temperature,
            "viscosity_Pa_s": lubricant.viscosity,
            "density_kg_per_m3": lubricant.density,
        }
    heat = result.heat
    if heat is not None:
        values |= {
            "supply_temperature_C": result.settings.supply_temperature,
            "effective_temperature_C": heat.effective_temperature,
            "outlet_temperature_C": heat.outlet_temperature,
            "dissipated_power_W": result.dissipation,
            "leaving_flow_m3_per_s": heat.flow,
        }
    linear = result.coefficients
    if linear is not None:
        values |= {
            "stiffness_N_per_m": linear.stiffness.tolist(),
            "damping_Ns_per_m": linear.damping.tolist(),
            "stiffness_scatter_N_per_m": _listed(linear.stiffness_scatter),
            "damping_scatter_Ns_per_m": _listed(linear.damping_scatter),
            "stability_threshold": linear.threshold,
            "critical_mass_kg": linear.critical_mass,
            "whirl_frequency_ratio": linear.whirl_ratio,
            "stability_threshold_scatter": linear.threshold_scatter,
            "critical_mass_scatter_kg": linear.critical_mass_scatter,
            "whirl_frequency_ratio_scatter": linear.whirl_ratio_scatter,
        }
    return values | {"settings": attrs.asdict(result.settings, value_serializer=_plain)}


def _plain(_: Any, __: Any, value: Any) -> Any:
    """Convert a value of the settings for JSON; `attrs.asdict` calls this function.

    A groove or shape becomes a dictionary with its kind, an array becomes a list.
    """
    if is_dataclass(value):
        entries = {f.name: getattr(value, f.name) for f in fields(value) if f.init}
        return {"kind": type(value).__name__, **entries}
    return value.tolist() if hasattr(value, "tolist") else value


def _listed(matrix: np.ndarray | None) -> list[list[float]] | None:
    """Convert a matrix to a list of its rows, for JSON; None if there is no matrix."""
    return None if matrix is None else matrix.tolist()


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else math.degrees(angle)


#: Labels of the rows of the printed table by key; a result that a bearing lacks has no row.
ROWS = {
    "load_N": "load",
    "eccentricity_ratio": "eccentricity ratio",
    "attitude_angle_deg": "attitude angle",
    "sommerfeld_number": "Sommerfeld number",
    "max_pressure_Pa": "maximum pressure",
    "max_pressure_angle_deg": "  from the maximum film",
    "min_film_thickness_m": "minimum film thickness",
    "side_flow_m3_per_s": "side flow",
    "friction_torque_Nm": "friction torque",
    "power_loss_W": "power loss",
    "viscosity_Pa_s": "viscosity of the oil",
    "supply_temperature_C": "supply temperature",
    "effective_temperature_C": "effective temperature",
    "outlet_temperature_C": "outlet temperature",
    "dissipated_power_W": "power dissipated",
    "leaving_flow_m3_per_s": "oil that leaves",
    "supply_flow_m3_per_s": "supply flow",
    "contact_load_N": "load carried by contact",
    "max_contact_pressure_Pa": "maximum contact pressure",
    "contact_power_W": "power lost in contact",
    "friction_coefficient": "coefficient of friction",
}

#: Printed units by SI unit: factor from the SI unit, and name.
SHOWN = {
    "Pa": (1e-6, "MPa"),
    "m": (1e6, "um"),
    "m3/s": (1e6, "cm3/s"),
    "deg": (1.0, "degrees"),
    "1": (1.0, ""),
}


def report(result: BearingResult) -> str:
    """Printed table of the settings and results of a bearing."""
    values = summary(result)
    settings = result.settings
    if not (settings.grooves or settings.line_at_max_film):
        del values["supply_flow_m3_per_s"]
    lines = [_settings_line(settings, result.film.parameters.lubricant.viscosity)]
    lines += [_row(label, key, values[key]) for key, label in ROWS.items() if key in values]
    if any(settings.tilt):
        moment = "  ".join(f"{m:.5g}" for m in values["tilting_moment_Nm"])
        lines.append(f"{'tilting moment on shaft':<26}{moment} N m  about x, y")
    if result.coefficients is not None:
        lines += _linear_rows(values)
    lines.append(
        f"{settings.cells_around} x {settings.cells_along} {settings.element} cells, shear in the "
        f"cavitated zone: {settings.shear_rule}"
    )
    return "\n".join(lines)


def _settings_line(settings: BearingSettings, viscosity: float) -> str:
    """First line of the printed table: size, clearance, oil and speeds of a bearing."""
    oil = f"viscosity {viscosity:.4g} Pa s" if settings.grade == NONE else settings.grade
    speeds = f"shaft at {settings.speed:g} rad/s"
    if settings.bore_speed:
        speeds += f", bore at {settings.bore_speed:g} rad/s"
    return (
        f"bearing of radius {settings.radius * 1e3:g} mm, width {settings.width * 1e3:g} mm, "
        f"clearance {settings.clearance * 1e6:g} um, {oil}, {speeds}"
    )


def _linear_rows(values: Mapping[str, Any]) -> list[str]:
    """Printed rows of stiffness, damping and stability, with their scatter over film meshes."""
    lines = []
    for label, key, scatter_key, unit in (
        ("stiffness", "stiffness_N_per_m", "stiffness_scatter_N_per_m", "N/m"),
        ("damping", "damping_Ns_per_m", "damping_scatter_Ns_per_m", "N s/m"),
    ):
        scatters = values[scatter_key] or [[None, None]] * 2
        for name, row, bounds in zip("xy", values[key], scatters, strict=True):
            head = f"{label} {name}x, {name}y"
            entries = (
                f"{entry:>12.5g}{scatter_text(bound):<12}"
                for entry, bound in zip(row, bounds, strict=True)
            )
            lines.append(f"{head:<26}{' '.join(entries).rstrip()} {unit}")
    if values["critical_mass_kg"] is None:
        lines.append(f"{'stability':<26}at every speed")
    else:
        for label, key, scatter_key in (
            ("critical mass per bearing", "critical_mass_kg", "critical_mass_scatter_kg"),
            ("stability threshold", "stability_threshold", "stability_threshold_scatter"),
            ("whirl ratio", "whirl_frequency_ratio", "whirl_frequency_ratio_scatter"),
        ):
            lines.append(_row(label, key, values[key], values[scatter_key]))
    if values["stiffness_scatter_N_per_m"] is not None:
        lines.append(f"{'':<26}+-: half the range over {values['settings']['meshes']} film meshes")
    return lines


def _row(label: str, key: str, value: float | None, scatter: float | None = None) -> str:
    from fenics_ehd.base.columns import split_unit

    si_unit = split_unit(key)[1]
    factor, unit = SHOWN.get(si_unit, (1.0, si_unit))
    number = "undefined" if value is None else f"{factor * value:.5g}"
    bound = scatter_text(None if scatter is None else factor * scatter)
    return f"{label:<26}{number:>12}{bound} {unit}".rstrip()


def _groove(numbers: tuple[float, float, float]) -> Any:
    """Axial groove from the numbers of ``--groove``: angle and width [degrees], pressure [Pa]."""
    from fenics_ehd.film.supply import AxialGroove

    angle, width, pressure = numbers
    try:
        return AxialGroove(math.radians(angle), math.radians(width), pressure)
    except SettingsError as error:
        raise SettingsError(f"--groove: {error}") from None


def _cells(text: str) -> tuple[int, int]:
    """Numbers of cells around and along the bore, from a text such as ``64x12``."""
    match = re.fullmatch(r"([0-9]{1,9})x([0-9]{1,9})", text.strip().lower())
    if not match:
        raise SettingsError(
            f"--cells {text!r} must be two whole numbers, the cells around and along the bore, for "
            "instance 64x12"
        )
    return int(match[1]), int(match[2])


@question("What load, friction and damping has a journal bearing?")
@click.command(help=DESCRIPTION)
@click.option(
    "--eccentricity", type=Measured(""), metavar="E", help="Eccentricity over clearance, 0..1."
)
@click.option(
    "--load",
    type=MeasuredRange("[N]"),
    metavar="W",
    help="Load on the shaft [N]; several make a map, as for --speed.",
)
@click.option(
    "--speed",
    type=MeasuredRange("[rad/s]"),
    default=attrs.fields(BearingSettings).speed.default,
    show_default=True,
    metavar="SPEED",
    help="Angular speed of the shaft [rad/s]. Several speeds, 1000rpm:10000rpm:19 for 19 speeds "
    "or 300,400,500, make a map: coefficients at each of them.",
)
@click.option(
    "--groove",
    "grooves",
    type=(Measured("[degrees]"), Measured("[degrees]"), Measured("[Pa]")),
    multiple=True,
    metavar="ANGLE WIDTH PRESSURE",
    help="Axial groove over the full width, at rest: angle of its middle from the load line in "
    "direction of rotation [degrees], its width [degrees], its pressure [Pa]. Repeatable.",
)
@setting_options(BearingSettings, "speed", "cells_around", "cells_along", "element")
@setting_options(Deviations, "misalignment", "table")
@click.option(
    "--shape-table",
    "table",
    type=FILE,
    callback=lambda _context, _option, path: path or NONE,  # a folder may have that name
    metavar="FILE",
    help="Measured deviation of the bore, added to the other deviations: CSV file with the columns "
    "angle_deg,height_m,deviation_m; angles from the load line in direction of rotation, heights "
    "from mid-width.",
)
@click.option(
    "--cells",
    default="64x12",
    show_default=True,
    metavar="NxM",
    help="Numbers of cells around and along; cells are smaller where the film is thin. The default "
    "gives the load to 0.1 % for eccentricities from 0.1 to 0.999 and widths from R/2 to 8R.",
)
@click.option(
    "--element",
    type=click.Choice(FILM_ELEMENTS),
    help="Film element: 9-node (lagrange), 8-node (that of the paper) or 4-node (bilinear).  "
    "[default: lagrange; bilinear with mass-conserving cavitation]",
)
@flag("--coefficients", "Also compute stiffness, damping and stability threshold.")
@click.option(
    "--plot",
    type=FILE,
    help="Draw pressure, film thickness and forces to this file; of a map coefficients, whirl "
    "ratio and critical mass.",
)
@click.option(
    "--table",
    "table_file",
    type=FILE,
    help="Write the rows of a map to this CSV file; the first columns, frequency [rad/s], kxx to "
    "kyy [N/m], cxx to cyy [N s/m], have the names that ROSS reads.",
)
@json_option
def bearing(
    eccentricity: float | None,
    load: float | tuple[float, ...] | None,
    speed: float | tuple[float, ...],
    grooves: tuple[tuple[float, float, float], ...],
    cells: str,
    element: str | None,
    coefficients: bool,
    plot: str | None,
    table_file: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Solve for the operating point of one rigid bearing, or for a map, and print it."""
    if (eccentricity is None) == (load is None):
        raise SettingsError("give either --eccentricity or --load")
    is_map = isinstance(speed, tuple) or isinstance(load, tuple)
    if table_file and not is_map:
        raise SettingsError(
            "--table: a table has a row for each value of --speed or --load: give several values"
        )
    if options["cavitation"] == "mass-conserving" and (coefficients or is_map):
        raise SettingsError(
            "--coefficients: with --cavitation mass-conserving they would depend on the frequency; "
            "use --cavitation reynolds"
        )
    inputs = [table for table in [options["table"]] if table != NONE]
    speeds = _several(speed)
    settings = _bearing_settings(options | {"speed": speeds[0]}, cells, element, grooves)
    if is_map:
        from fenics_ehd.cli.bearing_map import answer_map

        answer_map(
            settings, speeds, _several(load), eccentricity,
            table=table_file, plot=plot, inputs=inputs, as_json=as_json,
        )  # fmt: skip
        return
    from fenics_ehd.scenes.bearing import solve_bearing

    if plot:
        from fenics_ehd.plotting.maps import plot_bearing
        from fenics_ehd.plotting.picture import ENDINGS, require_format

        require_format("--plot", plot, ENDINGS, inputs)
    with keeping_failed_film("."):
        result = solve_bearing(
            settings,
            eccentricity=eccentricity,
            load=next(iter(_several(load)), None),
            with_coefficients=coefficients,
        )
    if plot:
        plot_bearing(result, plot)
    answer(summary(result), report(result), as_json)


def _several(value: float | tuple[float, ...] | None) -> tuple[float, ...]:
    """Tuple of the one or more values of an option; empty if the option is not given."""
    if value is None:
        return ()
    return value if isinstance(value, tuple) else (value,)


def _bearing_settings(
    options: Mapping[str, Any],
    cells: str,
    element: str | None,
    grooves: Sequence[tuple[float, float, float]],
) -> BearingSettings:
    """Settings of a bearing from the options of the command.

    Raises
    ------
    SettingsError
        A value cannot be used; the message names its option.
    """
    around, along = _cells(cells)
    conserving = options["cavitation"] == "mass-conserving"
    names = {*setting_names(Deviations)} & {*options}
    shape = bore_shape(
        options["width"], options["clearance"], {name: options[name] for name in names}
    )
    settings = BearingSettings(
        bore_shape=shape,
        cells_around=around,
        cells_along=along,
        element=element or ("bilinear" if conserving else "lagrange"),
        grooves=tuple(map(_groove, grooves)),
        **{name: value for name, value in options.items() if name not in names},
    )
    if settings.heated and settings.temperature > NO_TEMPERATURE:
        raise SettingsError(
            "--temperature and --supply-temperature exclude each other: give the effective "
            "temperature of the film, or the supply temperature from which it is computed"
        )
    return settings
