"""Tables of a scene from CSV files: over an angle, over time, and of periodic loads.

A header line gives columns and units, followed by rows of numbers. Lines that start with ``#`` are
comments.

**Over an angle, periodic:**

    # comment
    angle_deg,force_N
    0,120
    ...
    720,120

Angles ascend from any first angle and span one period, 360 or 720 degrees. The last value must be
the first value. A table without its last row is closed if the spacing of its rows shows that only
this row is missing: angles from 0 to 719 in steps of 1. The curve between the rows is a periodic
cubic spline with limited slopes (F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal. 17, 1980).
It never leaves the range of two neighbouring rows, whereas the spline without limits falls below
zero next to an ignition of a few rows. If the rows of a smooth curve are close, the limits change
slopes at extremes only. The slope is continuous, as Newton's method needs.

**Over time:**

    # comment
    time_s,speed_rad_per_s
    0.0,0.0
    ...

The curve between the rows is cubic and never leaves the range of two neighbouring rows (F. N.
Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5, 1984). Before the first row and after the
last row it is constant.

**A periodic load over time:**

    # comment
    time_s,Fx_N,Fy_N
    0.0,120.0,-3400.0
    ...

Times start at zero and ascend. The load of the last row must be that of the first row, unless a
longer period is given.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import scipy  # scipy.interpolate, which is slow to import, is imported when it is used

from fenics_ehd.base.arguments import require_class, require_number, require_word
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import INTERPOLATIONS
from fenics_ehd.base.files import read_text
from fenics_ehd.base.units import parse_number
from fenics_ehd.multibody.tabulated import Curve

#: Limit of a number in a table; squares and sums of smaller numbers stay finite.
LARGEST = 1e15

#: Pattern of a column's title: ``time_s``, ``time [s]`` or ``time (s)``.
HEADER = re.compile(r"\s*([A-Za-z]+)\s*(?:_\s*|\[\s*|\(\s*)([A-Za-z_]+)\s*[\])]?\s*")

#: Type for units of columns: factor to SI units by column and unit; messages name the first unit.
Units = Mapping[str, Mapping[str, float]]

#: Factors to Pa of the units that a column of gas pressures may have.
PRESSURES = {"bar": 1e5, "Pa": 1.0, "kPa": 1e3, "MPa": 1e6}

#: Largest difference of the first and last row of a periodic table, over the largest row; rounding.
CLOSING_TOLERANCE = 1e-3

#: Least number of rows of a periodic table.
FEWEST_ROWS = 3


def _entries(path: str | Path, where: str) -> list[tuple[str, list[str]]]:
    """Texts between the commas of each line with data, and a name of the line for messages.

    Raises
    ------
    SettingsError
        The file cannot be read, or its entries are not separated by commas.
    """
    try:
        text = read_text(path)
    except OSError as error:
        raise SettingsError(f"{where}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SettingsError(f"{where}: not a text file in UTF-8: save it as CSV UTF-8") from None
    lines = []
    for number, line in enumerate(text.splitlines(), 1):
        line_name = f"{where}, line {number}"
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if ";" in line or "\t" in line:
            raise SettingsError(
                f"{line_name}: {line.strip()[:40]!r}: separate entries by commas, and use decimal "
                "points"
            )
        lines.append((line_name, [entry.strip(' "') for entry in line.split(",")]))
    return lines


def _finite(where: str, entry: str) -> float:
    """Convert an entry to a number; refuse a text, or a magnitude of `LARGEST` or more.

    Raises
    ------
    SettingsError
        The entry is not such a number; the message has the entry.
    """
    try:
        value = parse_number(entry)
    except ValueError:
        value = float("nan")
    if not abs(value) < LARGEST:
        raise SettingsError(f"{where} = {entry[:40]!r} must be a finite number below {LARGEST:g}")
    return value


def read_columns(
    path: str | Path,
    where: str,
    units: Units,
    fewest: int = FEWEST_ROWS,
    *,
    ascending: bool = True,
    hint: str = "",
) -> tuple[list[str], np.ndarray]:
    """Read a CSV file; return a name of each row for messages, and the numbers in SI units.

    The numbers have the shape (rows, columns); the columns have the order of `units`.

    Parameters
    ----------
    path
        The file; lines that start with ``#`` are comments.
    where
        Name of the setting and file, for messages.
    units
        Required columns, with the units that each may have.
    fewest
        Least number of rows.
    ascending
        Whether the numbers of the first column must ascend.
    hint
        Text at the end of the message about columns with other names.

    Raises
    ------
    SettingsError
        The file cannot be used; the message names setting, file, line and value.
    """
    lines = _entries(path, where)
    wanted = ",".join(f"{name}_{next(iter(known))}" for name, known in units.items())
    if not lines:
        raise SettingsError(f"{where}: the file is empty: it must begin with the header {wanted}")
    (header_name, header), *body = lines
    columns = _columns(header_name, header, units, wanted + hint)
    values = np.empty((len(body), len(columns)))
    for row, (line_name, entries) in enumerate(body):
        if len(entries) != len(header):
            raise SettingsError(f"{line_name}: {len(entries)} values for {len(header)} columns")
        values[row] = [f * _finite(f"{line_name}: {header[i]}", entries[i]) for i, f in columns]
        former = values[max(row - 1, 0), 0]
        here = values[row, 0]
        if ascending and row and not here > former:
            name, unit = wanted.partition(",")[0].split("_", 1)
            raise SettingsError(
                f"{line_name}: the {name} {here:g} {unit} must be above {former:g} {unit}, that of "
                "the previous row"
            )
    if len(body) < fewest:
        raise SettingsError(f"{where}: {len(body)} rows of numbers, at least {fewest} are needed")
    return [line_name for line_name, _ in body], values


def _columns(
    line_name: str, header: list[str], units: Units, wanted: str
) -> list[tuple[int, float]]:
    """Index of each required column in the file, and its factor to SI units."""
    columns: dict[str, tuple[int, float]] = {}
    for index, title in enumerate(header):
        match = HEADER.fullmatch(title)
        name, unit = match.groups() if match else (title, "")
        if name not in units or name in columns:
            reason = "appears twice" if name in columns else f"is not one of {', '.join(units)}"
            raise SettingsError(f"{line_name}: column {title!r} {reason}: give columns {wanted}")
        if unit not in units[name]:
            known = " or ".join(f"{name}_{known}" for known in units[name])
            raise SettingsError(f"{line_name}: column {title!r} needs a unit: give {known}")
        columns[name] = index, units[name][unit]
    if missing := [name for name in units if name not in columns]:
        raise SettingsError(f"{line_name}: no column {', '.join(missing)}; needed: {wanted}")
    return [columns[name] for name in units]


def require_closed(where: str, values: np.ndarray, remedy: str) -> None:
    """Refuse a periodic table whose last row differs from the first; `values` has shape (n, k).

    Raises
    ------
    SettingsError
        The rows differ; the message has both of them and ends with `remedy`.
    """
    first = values[0]
    last = values[-1]
    gap = np.linalg.norm(last - first)
    largest = np.linalg.norm(values, axis=1).max()
    if not gap <= CLOSING_TOLERANCE * largest:
        closing, opening = (", ".join(f"{value:g}" for value in row) for row in (last, first))
        raise SettingsError(
            f"{where}: the last row ({closing}) differs from the first ({opening}) by "
            f"{gap:.3g}, above {CLOSING_TOLERANCE:g} of the largest row: {remedy}"
        )


#: Periods of two-stroke and four-stroke machines [degrees].
PERIODS = (360.0, 720.0)

#: Tolerance on the period of the angles in a file, which may be rounded [degrees].
ANGLE_TOLERANCE = 1e-3


def angle_table(angles: np.ndarray, values: np.ndarray) -> Curve:
    """Periodic cubic curve over an angle, whose slopes `limited` keeps within limits.

    Parameters
    ----------
    angles
        Angles in ascending order over one period, shape (n,) [rad].
    values
        Values at the angles, the last one equal to the first, shape (n,).
    """
    closed = np.append(values[:-1], values[0])  # SciPy requires equal bits
    slopes = scipy.interpolate.CubicSpline(angles, closed, bc_type="periodic")(angles, 1)
    curve = scipy.interpolate.CubicHermiteSpline(
        angles, closed, limited(slopes, np.diff(closed) / np.diff(angles))
    )
    return Curve(curve, periodic=True)


def limited(slopes: np.ndarray, chords: np.ndarray) -> np.ndarray:
    """Limit the slopes of a cubic curve, so that it stays between neighbouring rows of a table.

    Parameters
    ----------
    slopes
        Slopes of a spline at the rows of a periodic table, the last one equal to the first,
        shape (n,).
    chords
        Slopes of the straight lines between neighbouring rows, shape (n - 1,).
    """
    before = np.append(chords[-1], chords)
    after = np.append(chords, chords[0])
    largest = 3.0 * np.minimum(np.abs(before), np.abs(after))
    # Zero at an extreme, and if the spline falls although the rows rise.
    turns = (before * after <= 0) | (slopes * after <= 0)
    return np.where(turns, 0.0, np.clip(slopes, -largest, largest))


def _with_last_row(rows: np.ndarray) -> np.ndarray:
    """Append the first row as last row of the period if the spacing shows that one is missing."""
    angles = rows[:, 0]
    for period in PERIODS:
        missing = period - (angles[-1] - angles[0])
        spacings = np.diff(angles)[[0, -1]]
        if missing > ANGLE_TOLERANCE and np.abs(spacings - missing).max() <= ANGLE_TOLERANCE:
            return np.vstack([rows, [angles[0] + period, *rows[0, 1:]]])
    return rows


def read_angle_table(
    path: Path, key: str, column: Units, *, less: float = 0.0, hint: str = ""
) -> Curve:
    """Read a periodic curve over an angle from a CSV file.

    Parameters
    ----------
    path
        Path of the file; lines that start with ``#`` are comments.
    key
        Setting with the path of the file, for messages.
    column
        Name and units of the values, see `read_columns`.
    less
        Constant to subtract from the values, in SI units.
    hint
        Text at the end of the message about columns with other names.

    Raises
    ------
    SettingsError
        The file cannot be used; the message names setting, file, line and value.
    """
    where = f"{key} {path}"
    row_names, rows = read_columns(path, where, {"angle": {"deg": 1.0}, **column}, hint=hint)
    rows = _with_last_row(rows)
    angles, values = rows.T
    span = float(angles[-1] - angles[0])
    period = min(PERIODS, key=lambda p: abs(p - span))
    if not abs(span - period) <= ANGLE_TOLERANCE:
        raise SettingsError(
            f"{where}: the angles span {span:g} deg, from {angles[0]:g} to {angles[-1]:g}: they "
            "must span 360 or 720 deg"
        )
    require_closed(row_names[-1], rows[:, 1:], "make the last value equal to the first")
    # The exact period is used: a rounded one would shift the curve over many revolutions.
    return angle_table(np.radians(np.append(angles[:-1], angles[0] + period)), values - less)


def read_time_table(path: Path, key: str, column: Units) -> Curve:
    """Read a curve over time from a CSV file.

    Parameters
    ----------
    path
        Path of the file; lines that start with ``#`` are comments.
    key
        Setting with the path of the file, for messages.
    column
        Name and units of the values, see `read_columns`.

    Raises
    ------
    SettingsError
        The file cannot be used; the message names setting, file, line and value.
    """
    _, rows = read_columns(path, f"{key} {path}", {"time": {"s": 1.0}, **column}, 2)
    return Curve(scipy.interpolate.PchipInterpolator(*rows.T), periodic=False)


#: Factors to SI units of the units that a column of a load table may have, by column.
UNITS = {
    "time": {"s": 1.0, "ms": 1e-3},
    "Fx": {"N": 1.0, "kN": 1e3},
    "Fy": {"N": 1.0, "kN": 1e3},
}


def load_curves(
    times: np.ndarray, forces: np.ndarray, interpolation: str = "cubic"
) -> tuple[Curve, Curve]:
    """Components along x and y of a periodic load [N], as curves over time.

    Parameters
    ----------
    times
        Times from zero to the period, in ascending order, shape (n,) [s].
    forces
        Forces, the last row equal to the first, shape (n, 2) [N].
    interpolation
        ``"cubic"`` for a periodic cubic spline, or ``"linear"``.

    Raises
    ------
    SettingsError
        The interpolation is unknown.
    """
    require_word("interpolation", interpolation, INTERPOLATIONS)
    closed = np.vstack([forces[:-1], forces[:1]])  # SciPy requires equal bits
    largest = float(np.hypot(*forces.T).max())

    def curve(values: np.ndarray) -> scipy.interpolate.PPoly:
        if interpolation == "cubic":
            return scipy.interpolate.CubicSpline(times, values, bc_type="periodic")
        return scipy.interpolate.PPoly(
            np.stack([np.diff(values) / np.diff(times), values[:-1]]), times
        )

    x, y = (Curve(curve(values), periodic=True, scale=largest) for values in closed.T)
    return x, y


def read_load(
    path: str | Path,
    scale: float = 1.0,
    interpolation: str = "cubic",
    period: float = 0.0,
    section: str = "load",
) -> tuple[Curve, Curve]:
    """Read the components along x and y of a periodic load [N] from a CSV file.

    Parameters
    ----------
    path
        Path of the file; lines that start with ``#`` are comments.
    scale
        Factor on the forces.
    interpolation
        ``"cubic"`` or ``"linear"``, see `load_curves`.
    period
        Period [s], above the last time in the file; at the end of the period, the load is the first
        load of the file. With 0, the period is the last time in the file.
    section
        Section of the scene with the path of the file, for messages.

    Raises
    ------
    SettingsError
        The file cannot be used; the message names file, line and value.
    """
    require_class("path", path, str, Path)
    scale = require_number("scale", scale)
    period = require_number("period", period, least=0)
    where = f"{section}.file {path}"
    row_names, values = read_columns(path, where, UNITS)
    times = values[:, 0]
    forces = scale * values[:, 1:]
    if times[0] != 0.0:
        raise SettingsError(f"{row_names[0]}: the first time is {times[0]:g} s: it must be 0")
    if not forces.any():
        raise SettingsError(f"{where}: the load is 0 in all rows: at least one row needs a force")
    if period:
        if not period > times[-1]:
            raise SettingsError(
                f"{section}.period = {period:g} s must be above {times[-1]:g} s, the time of "
                f"{row_names[-1]}"
            )
        times = np.append(times, period)
        forces = np.vstack([forces, forces[:1]])
    require_closed(
        row_names[-1], forces, f"make the last load equal to the first, or set {section}.period"
    )
    return load_curves(times, forces, interpolation)
