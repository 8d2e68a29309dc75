"""Measured deviations of a bore or journal from a circular cylinder, in a CSV file.

    # anything
    angle_deg,height_m,deviation_m
    0,-0.01,1.2e-6
    0,0.01,1.0e-6
    15,-0.01,...

Every angle is listed with every height, in any order. Angles lie within one turn; a last angle may
be the first one again, with the same deviations.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.kinematics import FEWEST_ANGLES, ShapeTable
from fenics_ehd.scenes.tables import Units, read_columns

#: Units of a table's columns.
_LENGTH: Mapping[str, float] = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
UNITS: Units = {"angle": {"deg": 1.0}, "height": _LENGTH, "deviation": _LENGTH}

#: Share of the bearing's width that heights of a table need not cover at each end: rounding.
UNCOVERED = 1e-3

#: Most widths that heights of a table may span: in another unit they are 1000 times as large.
WIDEST = 10.0

#: Most clearances that a deviation of a table may have, for the same reason.
HIGHEST = 30.0

#: Digits of an angle [degrees], and of a height over the largest, in which rows of a table agree.
DIGITS = 6


def read_shape_table(path: str | Path, key: str) -> ShapeTable:
    """Shape of a CSV file.

    Parameters
    ----------
    path
        The file; lines that start with ``#`` are comments.
    key
        Setting that names the file, for messages.

    Raises
    ------
    SettingsError
        Naming setting, file and the row or column that cannot be used.
    """
    where = f"{key} {path}"
    _, rows = read_columns(path, where, UNITS, FEWEST_ANGLES, ascending=False)
    degrees = rows[:, 0].round(DIGITS)
    first = float(rows[:, 0].min())
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
        angles = angles[:-1]
        values = values[:-1]
    elif span > 360.0:
        raise SettingsError(f"{where}: the angles span {span:g} deg, at most 360 are a turn")
    try:
        return ShapeTable(np.radians(angles), levels * largest, values)
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from None


def require_covering(table: ShapeTable, where: str, width: float, clearance: float) -> None:
    """Refuse measured heights that do not cover a bearing, and values in another unit.

    Parameters
    ----------
    table
        Measured shape; one height holds for the whole width.
    where
        Setting and file, for messages.
    width, clearance
        Width and radial clearance of the bearing [m].

    Raises
    ------
    SettingsError
        Naming the heights or deviations, and their limit.
    """
    levels = table.heights
    extent = (0.5 - UNCOVERED) * width
    if len(levels) > 1 and not (levels[0] <= -extent and levels[-1] >= extent):
        raise SettingsError(
            f"{where}: heights from {levels[0]:g} to {levels[-1]:g} m must cover the bearing's "
            f"width, {-0.5 * width:g} to {0.5 * width:g} m; a table of one height holds for all"
        )
    for name, size, limit in (
        ("height", 2 * float(np.abs(levels).max()), WIDEST * width),
        ("deviation", float(np.abs(table.deviations).max()), HIGHEST * clearance),
    ):
        if size > limit:
            raise SettingsError(
                f"{where}: {name}s of {size:g} m, more than {limit:g} m: name the column by its "
                f"unit, {name}_m, {name}_mm or {name}_um"
            )
