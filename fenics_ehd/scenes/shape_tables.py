"""Measured deviations of a bore or journal from a circular cylinder, read from a CSV file.

    # comment
    angle_deg,height_m,deviation_m
    0,-0.01,1.2e-6
    0,0.01,1.0e-6
    15,-0.01,...

The file has a row for every combination of an angle and a height, in any order. The angles lie
within one turn. The last angle may be the first one plus 360 degrees, with the same deviations.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.kinematics import FEWEST_ANGLES, ShapeTable
from fenics_ehd.scenes.tables import Units, read_columns

#: Factors to SI units of the units that a column may have, by column.
_LENGTH: Mapping[str, float] = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
UNITS: Units = {"angle": {"deg": 1.0}, "height": _LENGTH, "deviation": _LENGTH}

#: Part of the width at each end that the heights need not cover, because they may be rounded.
UNCOVERED = 1e-3

#: Largest range of the heights over the width: a height in a wrong unit is 1000 times too large.
WIDEST = 10.0

#: Largest deviation over the clearance: a deviation in a wrong unit is 1000 times too large.
HIGHEST = 30.0

#: Digits to which angles [degrees], and heights over the largest height, are rounded.
DIGITS = 6


def read_shape_table(path: str | Path, key: str) -> ShapeTable:
    """Measured shape of a surface, read from a CSV file.

    Parameters
    ----------
    path
        The file; lines that start with ``#`` are comments.
    key
        Setting with the path of the file, for messages.

    Raises
    ------
    SettingsError
        A row or column cannot be used; the message names it, the setting and the file.
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
            f"{where}: {len(rows)} rows for {len(angles)} angles and {len(levels)} heights: give "
            "one row for every angle and height"
        )
    span = float(angles[-1] - angles[0])
    if abs(span - 360.0) < 10.0**-DIGITS:
        if not np.array_equal(values[-1], values[0]):
            raise SettingsError(f"{where}: deviations at {first + 360:g} and {first:g} deg differ")
        angles = angles[:-1]
        values = values[:-1]
    elif span > 360.0:
        raise SettingsError(f"{where}: the angles span {span:g} deg, but at most 360 deg are valid")
    try:
        return ShapeTable(np.radians(angles), levels * largest, values)
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from None


def require_covering(table: ShapeTable, where: str, width: float, clearance: float) -> None:
    """Refuse measured heights that do not cover a bearing, and values in a wrong unit.

    Parameters
    ----------
    table
        Measured shape; with a single height it holds for the full width.
    where
        Setting and path of the file, for messages.
    width, clearance
        Width and radial clearance of the bearing [m].

    Raises
    ------
    SettingsError
        Heights or deviations are outside their limits; the message has both.
    """
    levels = table.heights
    extent = (0.5 - UNCOVERED) * width
    if len(levels) > 1 and not (levels[0] <= -extent and levels[-1] >= extent):
        raise SettingsError(
            f"{where}: heights from {levels[0]:g} to {levels[-1]:g} m must cover the bearing's "
            f"width, {-0.5 * width:g} to {0.5 * width:g} m, or be one height for the full width"
        )
    for name, size, limit in (
        ("height", 2 * float(np.abs(levels).max()), WIDEST * width),
        ("deviation", float(np.abs(table.deviations).max()), HIGHEST * clearance),
    ):
        if size > limit:
            raise SettingsError(
                f"{where}: {name}s of {size:g} m are above the limit of {limit:g} m: give the "
                f"column the unit of its values, {name}_m, {name}_mm or {name}_um"
            )
