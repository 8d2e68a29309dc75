"""Something periodic over an angle, from a CSV file.

    # anything
    angle_deg,force_N
    0,120
    ...
    720,120

Angles ascend from any first one and span one period, 360 or 720 degrees; the last value is the
first. In between lies a periodic cubic spline whose slopes are limited (F. N. Fritsch and R. E.
Carlson, SIAM J. Numer. Anal. 17, 1980), so that it never leaves the range of the rows beside it:
the spline itself swings below zero beside an ignition that a few rows describe. Close rows of
something smooth leave all slopes but those at extremes as they are. The slope is continuous, as
Newton's method wants it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.tabulated import Curve
from fenics_ehd.scenes.csv_table import Units, read_columns, require_closed

#: Degrees after which a machine repeats itself, with two or with four strokes.
PERIODS = (360.0, 720.0)

#: Rounding of the angles in the file [degrees].
ANGLE_TOLERANCE = 1e-3


def angle_table(angles: np.ndarray, values: np.ndarray) -> Curve:
    """Periodic function of an angle.

    Parameters
    ----------
    angles
        Ascending over one period, shape (n,) [rad].
    values
        The last one that of the first, shape (n,).
    """
    closed = np.append(values[:-1], values[0])  # SciPy forgives no round-off
    slopes = CubicSpline(angles, closed, bc_type="periodic")(angles, 1)
    curve = CubicHermiteSpline(angles, closed, limited(slopes, np.diff(closed) / np.diff(angles)))
    return Curve(curve, periodic=True)


def limited(slopes: np.ndarray, chords: np.ndarray) -> np.ndarray:
    """Slopes at the rows of a closed table with which a cubic curve stays between them.

    Parameters
    ----------
    slopes
        Wanted, the last one that of the first, shape (n,).
    chords
        Between one row and the next, shape (n - 1,).
    """
    before, after = np.append(chords[-1], chords), np.append(chords, chords[0])
    largest = 3.0 * np.minimum(np.abs(before), np.abs(after))
    # At an extreme, and where the spline falls although the rows rise.
    turns = (before * after <= 0) | (slopes * after <= 0)
    return np.where(turns, 0.0, np.clip(slopes, -largest, largest))


def read_angle_table(path: str | Path, key: str, column: Units) -> Curve:
    """Table of a CSV file; lines that start with ``#`` are comments.

    Parameters
    ----------
    path
        The file.
    key
        Setting that names it, for messages.
    column
        Name and unit of the values, see `read_columns`.

    Raises
    ------
    SettingsError
        Naming setting, file, line and value.
    """
    where = f"{key} {path}"
    lines, rows = read_columns(path, where, {"angle": {"deg": 1.0}, **column})
    angles, values = rows.T
    span = float(angles[-1] - angles[0])
    period = min(PERIODS, key=lambda p: abs(p - span))
    if not abs(span - period) <= ANGLE_TOLERANCE:
        raise SettingsError(
            f"{where}: the angles span {span:g} deg, from {angles[0]:g} to {angles[-1]:g}, they "
            "must span 360 or 720"
        )
    require_closed(f"{where}, line {lines[-1]}", rows[:, 1:], "close the period")
    # To the very period, or many revolutions would shift the table.
    return angle_table(np.radians(np.append(angles[:-1], angles[0] + period)), values)
