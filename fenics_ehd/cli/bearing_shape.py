"""Options of ``fenics-ehd bearing`` for a bore that is not round."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.cli.options import Measured

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.film.shape import Shape

#: Option, metavar, help.
NUMBERS = (
    ("ovality", "A", "Amplitude of the bore's ovality, deviation A cos(2 (phi - ANGLE)) [m]."),
    ("ovality-angle", "ANGLE", "Where it is widest, from the load line [degrees]."),
    ("barrel", "A", "Deviation of the bore at both ends, a parabola from 0 at mid-width [m]."),
    ("taper", "A", "Deviation at the upper end, minus that at the lower one [m]."),
)


def shape_options(command: Callable) -> Callable:
    """Add the options to a command."""
    options = [
        click.option(f"--{name}", type=Measured(text), default=0.0, metavar=metavar, help=text)
        for name, metavar, text in NUMBERS
    ]
    table = click.option(
        "--shape-table",
        type=click.Path(dir_okay=False),
        metavar="FILE",
        help="More of it: CSV file angle_deg,height_m,deviation_m, angles from the load line in "
        "direction of rotation, heights from mid-width.",
    )
    return reduce(lambda found, option: option(found), reversed([*options, table]), command)


def bore_shape(options: dict[str, Any]) -> Shape | None:
    """Shape of these options, which are taken out of all; None: round.

    Raises
    ------
    SettingsError
        Naming an option, or what is wrong with the table.
    """
    found = {name: options.pop(name) for name in ("ovality", "ovality_angle", "barrel", "taper")}
    file = options.pop("shape_table")
    for name, value in found.items():
        if not math.isfinite(value):
            raise SettingsError(f"--{name.replace('_', '-')} {value} must be a finite number")
    if not (found["ovality"] or found["barrel"] or found["taper"] or file):
        return None
    if abs(found["ovality"]) >= options["clearance"]:
        raise SettingsError(
            f"--ovality {found['ovality']:g} m closes the gap: its size must be below the "
            f"clearance of {options['clearance']:g} m"
        )
    from fenics_ehd.film.shape import Lobes, shape_of
    from fenics_ehd.scenes.shapes import read_shape_table

    table = None
    if file:
        table = read_shape_table(file, "--shape-table", options["width"], options["clearance"])
    return shape_of(
        0.5 * options["width"],
        lobes=Lobes(found["ovality"], math.radians(found["ovality_angle"])),
        barrel=found["barrel"],
        taper=found["taper"],
        table=table,
    )
