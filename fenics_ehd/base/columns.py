"""Arrays with a unit, and names of columns of results, which end with a unit."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np

#: Units that may end the name of a column, such as ``force_N``. Several units mean their product,
#: ``Pa_m``; units after ``per`` are divisors, ``rad_per_s``. Without a unit, the quantity is
#: dimensionless.
UNITS = ("Pa", "N", "Nm", "W", "J", "m", "m2", "m3", "s", "kg", "rad", "deg", "C", "K", "Hz")

#: Spelling in texts of units that are spelled differently in names.
_WRITTEN = {"Nm": "N m"}

#: Unit of a dimensionless quantity.
DIMENSIONLESS = "1"


class Quantity(np.ndarray):
    """Array with a unit; slices keep the unit, results of arithmetic are plain arrays.

    Attributes
    ----------
    units
        Unit of the values, for instance ``"Pa"``, ``"m3/s"`` or ``"1"``.
    """

    units: str

    def __new__(cls, values: Any, units: str) -> Quantity:
        """View an array as a quantity; its values are not copied."""
        quantity = np.asarray(values).view(cls)
        quantity.units = units
        return quantity

    def __array_finalize__(self, source: Any) -> None:
        self.units = getattr(source, "units", DIMENSIONLESS)

    def __array_wrap__(self, array: np.ndarray, *_: Any) -> Any:
        # The result of arithmetic has no unit here: a product has another one than its factors.
        return np.asarray(array)[()]

    def __repr__(self) -> str:
        return f"{np.asarray(self)!r} {self.units}"

    def __reduce__(self) -> tuple[Any, ...]:
        return Quantity, (np.asarray(self), self.units)


def split_unit(column: str) -> tuple[str, str]:
    """Split a column's name into quantity and unit: ``side_flow_m3_per_s`` has ``m3/s``."""
    words = column.split("_")
    first = len(words)
    while first > 1 and (words[first - 1] in UNITS or words[first - 1] == "per"):
        first -= 1
    if words[first : first + 1] == ["per"]:
        first += 1
    unit = " ".join(_WRITTEN.get(word, word) for word in words[first:]).replace(" per ", "/")
    return "_".join(words[:first]), unit or DIMENSIONLESS


def with_unit(name: str, unit: str) -> str:
    """Name of the column for a quantity and its unit: the inverse of `split_unit`."""
    if unit == DIMENSIONLESS:
        return name
    for short, written in _WRITTEN.items():
        unit = unit.replace(written, short)
    return f"{name}_{unit.replace('/', '_per_').replace(' ', '_')}"


#: Name of the column of the time.
TIME = "time_s"


def csv_line(values: Sequence[str]) -> bytes:
    """Encode one row of a CSV file."""
    buffer = io.StringIO()
    csv.writer(buffer).writerow(values)
    return buffer.getvalue().encode()
