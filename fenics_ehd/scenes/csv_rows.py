"""Rows of a CSV file that a user wrote, with their line numbers for messages."""

from __future__ import annotations

import csv
from pathlib import Path

from fenics_ehd.errors import SettingsError
from fenics_ehd.text_file import read_text

#: Beyond any force [N], torque, time or angle; squares and sums of such numbers stay finite.
LARGEST = 1e15


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
