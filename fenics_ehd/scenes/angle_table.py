"""Something periodic over the crank angle, from a CSV file.

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

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.tabulated import TabulatedLoad
from fenics_ehd.scenes.csv_rows import finite_number, numbered_rows
from fenics_ehd.scenes.load_history import CLOSING_TOLERANCE, FEWEST_ROWS

#: Degrees after which a machine repeats itself, with two or with four strokes.
PERIODS = (360.0, 720.0)

#: Rounding of the angles in the file [degrees].
ANGLE_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class AngleTable:
    """Periodic function of the crank angle, an `AngleFunction`.

    Attributes
    ----------
    angles
        Ascending over one period, shape (n,) [rad].
    values
        The last one that of the first, shape (n,).
    """

    angles: np.ndarray
    values: np.ndarray

    @property
    def period(self) -> float:
        """[rad]."""
        return float(self.angles[-1] - self.angles[0])

    @cached_property
    def _curve(self) -> CubicHermiteSpline:
        closed = np.append(self.values[:-1], self.values[0])  # SciPy forgives no round-off
        slopes = CubicSpline(self.angles, closed, bc_type="periodic")(self.angles, 1)
        return CubicHermiteSpline(
            self.angles, closed, limited(slopes, np.diff(closed) / np.diff(self.angles))
        )

    def tabulated(self, angle: Callable[[float, np.ndarray], float]) -> TabulatedLoad:
        """The rows, read at an angle that a mechanism has at a time and in a state."""
        return TabulatedLoad(self.angles, self.values, lambda place: self(place)[0], angle)

    def __call__(self, angle: float) -> tuple[float, float]:
        """Value and derivative at any angle [rad], the latter per rad."""
        phase = self.angles[0] + (angle - self.angles[0]) % self.period
        return float(self._curve(phase)), float(self._curve(phase, 1))


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


def read_angle_table(path: str | Path, key: str, column: str) -> AngleTable:
    """Table of a CSV file; lines that start with ``#`` are comments.

    Parameters
    ----------
    path
        The file.
    key
        Setting that names it, for messages.
    column
        Header of the values, with their unit.

    Raises
    ------
    SettingsError
        Naming setting, file, line and value.
    """
    where = f"{key} {path}"
    lines, angles, values = _rows(path, where, column)
    if len(values) < FEWEST_ROWS:
        raise SettingsError(
            f"{where}: {len(values)} rows of numbers, at least {FEWEST_ROWS} are needed"
        )
    for line, before, angle in zip(lines[1:], angles[:-1], angles[1:], strict=True):
        if not angle > before:
            raise SettingsError(
                f"{where}, line {line}: the angle {angle:g} deg must be above {before:g} deg, "
                "that of the row before"
            )
    span = float(angles[-1] - angles[0])
    period = min(PERIODS, key=lambda p: abs(p - span))
    if not abs(span - period) <= ANGLE_TOLERANCE:
        raise SettingsError(
            f"{where}: the angles span {span:g} deg, from {angles[0]:g} to {angles[-1]:g}, they "
            "must span 360 or 720"
        )
    gap, largest = abs(values[-1] - values[0]), np.abs(values).max()
    if not gap <= CLOSING_TOLERANCE * largest:
        raise SettingsError(
            f"{where}, line {lines[-1]}: the last value {values[-1]:g} differs from the first, "
            f"{values[0]:g}, by {gap:.3g}, above {CLOSING_TOLERANCE:g} of the largest: close the "
            "period"
        )
    # To the very period, or many revolutions would shift the table.
    return AngleTable(np.radians(np.append(angles[:-1], angles[0] + period)), values)


def _rows(path: str | Path, where: str, column: str) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Line numbers, angles [degrees] and values."""
    numbered = numbered_rows(path, where)
    wanted = ["angle_deg", column]
    header = numbered[0][1] if numbered else []
    if header != wanted:
        found = f"line {numbered[0][0]}, has {','.join(header)!r}" if numbered else "is empty"
        raise SettingsError(f"{where}: the header must be {','.join(wanted)}, the file {found}")
    values = np.empty((len(numbered) - 1, 2))
    for row, (number, entries) in enumerate(numbered[1:]):
        if len(entries) != 2:
            raise SettingsError(f"{where}, line {number}: {len(entries)} values for 2 columns")
        values[row] = [
            finite_number(f"{where}, line {number}: {name}", entry)
            for name, entry in zip(wanted, entries, strict=True)
        ]
    return [number for number, _ in numbered[1:]], values[:, 0], values[:, 1]
