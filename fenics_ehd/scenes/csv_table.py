"""Tables that a user wrote as CSV files: a header that names columns and units, rows of numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.text_file import read_text

#: Beyond any force [N], torque, time or angle; squares and sums of such numbers stay finite.
LARGEST = 1e15

#: ``time_s``, ``time [s]`` or ``time (s)``.
HEADER = re.compile(r"\s*([A-Za-z]+)\s*(?:_\s*|\[\s*|\(\s*)([A-Za-z_]+)\s*[\])]?\s*")

#: Factors of the units that a header may name, by column; the first unit is that of messages.
Units = Mapping[str, Mapping[str, float]]

#: The last row of a closed table may differ from the first by this share of the largest: rounding.
CLOSING_TOLERANCE = 1e-3

#: Rows that a periodic table needs.
FEWEST_ROWS = 3


def numbered_rows(path: str | Path, where: str) -> list[tuple[int, list[str]]]:
    """Line numbers and entries of all lines but empty ones and comments, which start with ``#``.

    `where` names file and setting in messages.

    Raises
    ------
    SettingsError
        The file cannot be read, or separates its entries by something else than commas.
    """
    try:
        text = read_text(path)
    except OSError as error:
        raise SettingsError(f"{where}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SettingsError(f"{where}: not a text file") from None
    rows = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if ";" in line or "\t" in line:
            raise SettingsError(
                f"{where}, line {number}, has {line.strip()[:40]!r}: separate by commas, "
                "decimals with a point"
            )
        try:
            entries = next(csv.reader([line]))
        except csv.Error as error:
            raise SettingsError(f"{where}, line {number}: {error}") from None
        rows.append((number, [entry.strip() for entry in entries]))
    return rows


def finite_number(where: str, entry: str) -> float:
    """An entry as a number.

    Raises
    ------
    SettingsError
        It is none, or beyond `LARGEST`; the message begins with `where`.
    """
    try:
        value = float(entry)
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
) -> tuple[list[int], np.ndarray]:
    """Line numbers, and numbers in the order of `units` times their factors.

    Parameters
    ----------
    path
        The file; lines that start with ``#`` are comments.
    where
        Names file and setting in messages.
    units
        Columns that must be there.
    fewest
        Rows that are needed.
    ascending
        Whether the first column must.

    Raises
    ------
    SettingsError
        Naming setting, file, line and value.
    """
    numbered = numbered_rows(path, where)
    wanted = ",".join(f"{name}_{next(iter(known))}" for name, known in units.items())
    if not numbered:
        raise SettingsError(f"{where}: no header {wanted}")
    (first, header), body = numbered[0], numbered[1:]
    order, factors = _columns(f"{where}, line {first}", header, units, wanted)
    values = np.empty((len(body), len(order)))
    for row, (number, entries) in enumerate(body):
        line = f"{where}, line {number}"
        if len(entries) != len(header):
            raise SettingsError(f"{line}: {len(entries)} values for {len(header)} columns")
        found = [finite_number(f"{line}: {header[i]}", entries[i]) for i in order]
        values[row] = factors * found
        place, before = values[row, 0], values[row - 1, 0]
        if ascending and row and not place > before:
            name, known = next(iter(units.items()))
            unit = next(iter(known))
            raise SettingsError(
                f"{line}: the {name} {place:g} {unit} must be above {before:g} {unit}, that of the "
                "row before"
            )
    if len(body) < fewest:
        raise SettingsError(f"{where}: {len(body)} rows of numbers, at least {fewest} are needed")
    return [number for number, _ in body], values


def _columns(
    where: str, header: list[str], units: Units, wanted: str
) -> tuple[list[int], np.ndarray]:
    """Which column holds what, in the order of `units`, and their factors."""
    found: dict[str, tuple[int, float]] = {}
    for index, title in enumerate(header):
        match = HEADER.fullmatch(title)
        name = match[1] if match else title
        if name not in units or name in found:
            known = ", ".join(units)
            reason = "appears twice" if name in found else f"is not one of {known}"
            raise SettingsError(f"{where}: column {title!r} {reason}, with a unit: {wanted}")
        if match is None or match[2] not in units[name]:
            known = " or ".join(f"{name}_{unit}" for unit in units[name])
            raise SettingsError(f"{where}: column {title!r} needs a unit: {known}")
        found[name] = (index, units[name][match[2]])
    missing = [name for name in units if name not in found]
    if missing:
        raise SettingsError(f"{where}: no column {', '.join(missing)}; needed: {wanted}")
    ordered = [found[name] for name in units]
    return [index for index, _ in ordered], np.array([factor for _, factor in ordered])


def require_closed(where: str, values: np.ndarray, remedy: str) -> None:
    """Refuse a periodic table whose last row (n, k) is not the first.

    Raises
    ------
    SettingsError
        Naming both rows and what to do.
    """
    first, last = values[0], values[-1]
    gap, largest = np.linalg.norm(last - first), np.linalg.norm(values, axis=1).max()
    if not gap <= CLOSING_TOLERANCE * largest:
        told = (", ".join(f"{value:g}" for value in row) for row in (last, first))
        raise SettingsError(
            f"{where}: the last row ({next(told)}) differs from the first ({next(told)}) by "
            f"{gap:.3g}, above {CLOSING_TOLERANCE:g} of the largest: {remedy}"
        )
