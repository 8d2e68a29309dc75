"""Shapes of the bores and journals of a scene, and of a measured one from a CSV file.

    # anything
    angle_deg,height_m,deviation_m
    0,-0.01,1.2e-6
    0,0.01,1.0e-6
    15,-0.01,...

Every angle with every height, in any order; angles within one turn, perhaps a last one that is the
first again.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.shape import FEWEST_ANGLES, Lobes, Shape, ShapeTable, shape_of
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.csv_table import Units, read_columns
from fenics_ehd.scenes.fields import NONE

#: Shapes of a bore and a journal that have none.
ROUND: tuple[Shape | None, Shape | None] = (None, None)

#: Units of a table's columns.
_LENGTH: Mapping[str, float] = MappingProxyType({"m": 1.0, "mm": 1e-3, "um": 1e-6})
UNITS: Units = MappingProxyType(
    {"angle": MappingProxyType({"deg": 1.0}), "height": _LENGTH, "deviation": _LENGTH}
)

#: Part of the bearing's width that heights of a table may leave out at each end: its own rounding.
UNCOVERED = 1e-3

#: Widths that heights of a table may span, and clearances that a deviation may have: in another
#: unit they are a thousand times as large.
WIDEST, HIGHEST = 10.0, 30.0

#: Digits of an angle [degrees], and of a height over the largest, in which rows of a table agree.
DIGITS = 6


def joint_shapes(
    joint: schema.LubricatedSettings, name: str, width: float
) -> tuple[Shape | None, Shape | None]:
    """Shapes of bore and journal of a joint, None for a round one.

    Parameters
    ----------
    joint, name
        Which joint.
    width
        Of the bearing [m].

    Raises
    ------
    SettingsError
        Naming a key, or what is wrong with a table.
    """
    found = []
    for key in ("bore_shape", "journal_shape"):
        settings: schema.ShapeSettings = getattr(joint, key)
        path = f"joints.{name}.{key}"
        # Two lobes or more close the gap somewhere, wherever the journal is.
        if settings.lobes > 1 and abs(settings.ovality) >= joint.clearance:
            raise SettingsError(
                f"{path}.ovality = {settings.ovality:g} m closes the gap: its size must be below "
                f"the clearance of {joint.clearance:g} m"
            )
        found.append(_shape(settings, path, width, joint.clearance))
    return found[0], found[1]


def _shape(
    settings: schema.ShapeSettings, path: str, width: float, clearance: float
) -> Shape | None:
    table = None
    if settings.table != NONE:
        table = read_shape_table(settings.table, f"{path}.table", width, clearance)
    angle = float(np.radians(settings.ovality_angle))
    return shape_of(
        0.5 * width,
        lobes=Lobes(settings.ovality, angle, settings.lobes),
        barrel=settings.barrel,
        taper=settings.taper,
        misalignment=settings.misalignment,
        table=table,
    )


def read_shape_table(path: str | Path, key: str, width: float, clearance: float) -> ShapeTable:
    """Shape of a CSV file.

    Parameters
    ----------
    path
        The file; lines that start with ``#`` are comments.
    key
        Setting that names it, for messages.
    width
        Of the bearing [m], which the heights must cover; one height stands for all.
    clearance
        Of the bearing [m].

    Raises
    ------
    SettingsError
        Naming setting, file and what is wrong.
    """
    where = f"{key} {path}"
    _, rows = read_columns(path, where, UNITS, FEWEST_ANGLES, ascending=False)
    degrees, first = rows[:, 0].round(DIGITS), float(rows[:, 0].min())
    largest = float(np.abs(rows[:, 1]).max()) or 1.0
    heights = (rows[:, 1] / largest).round(DIGITS)
    angles, i = np.unique(degrees, return_inverse=True)
    levels, k = np.unique(heights, return_inverse=True)
    values = np.full((len(angles), len(levels)), np.nan)
    values[i, k] = rows[:, 2]
    if len(rows) != values.size or np.isnan(values).any():
        raise SettingsError(
            f"{where}: {len(rows)} rows for {len(angles)} angles and {len(levels)} heights: every "
            "angle needs every height, once"
        )
    span = float(angles[-1] - angles[0])
    if abs(span - 360.0) < 10.0**-DIGITS:
        if not np.array_equal(values[-1], values[0]):
            raise SettingsError(f"{where}: deviations at {first + 360:g} and {first:g} deg differ")
        angles, values = angles[:-1], values[:-1]
    elif span > 360.0:
        raise SettingsError(f"{where}: the angles span {span:g} deg, at most 360 are a turn")
    levels = levels * largest
    reach = (0.5 - UNCOVERED) * width
    if len(levels) > 1 and not (levels[0] <= -reach and levels[-1] >= reach):
        raise SettingsError(
            f"{where}: heights from {levels[0]:g} to {levels[-1]:g} m must cover the bearing's "
            f"width, {-0.5 * width:g} to {0.5 * width:g} m; one height alone stands for all"
        )
    for name, size, limit in (
        ("height", 2 * float(np.abs(levels).max()), WIDEST * width),
        ("deviation", float(np.abs(values).max()), HIGHEST * clearance),
    ):
        if size > limit:
            raise SettingsError(
                f"{where}: {name}s of {size:g} m, more than {limit:g} m: name the column by its "
                f"unit, {name}_m, {name}_mm or {name}_um"
            )
    try:
        return ShapeTable(np.radians(angles), levels, values)
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from None
