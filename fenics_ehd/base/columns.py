"""Arrays with a unit, and names of columns, which end with their unit."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np

#: Units at the end of column names, ``force_N``. Several units are a product, ``Pa_m``; units after
#: ``per`` are divisors, ``rad_per_s``. A name without a unit is dimensionless.
UNITS = ("Pa", "N", "Nm", "W", "J", "m", "m2", "m3", "s", "kg", "rad", "deg", "C", "K", "Hz")

#: Written forms of units that differ from their form in names.
_WRITTEN = {"Nm": "N m"}

#: Unit of a dimensionless quantity.
DIMENSIONLESS = "1"


class Quantity(np.ndarray):
    """An array with its unit; slices keep the unit, results of arithmetic are plain arrays.

    Attributes
    ----------
    units
        Unit, for instance ``"Pa"``, ``"m3/s"`` or ``"1"``.
    """

    units: str

    def __new__(cls, values: Any, units: str) -> Quantity:
        """View of an array, which is not copied."""
        quantity = np.asarray(values).view(cls)
        quantity.units = units
        return quantity

    def __array_finalize__(self, source: Any) -> None:
        self.units = getattr(source, "units", DIMENSIONLESS)

    def __array_wrap__(self, array: np.ndarray, *_: Any) -> Any:
        # A product or a count has another unit than its factor.
        return np.asarray(array)[()]

    def __repr__(self) -> str:
        return f"{np.asarray(self)!r} {self.units}"

    def __reduce__(self) -> tuple[Any, ...]:
        return Quantity, (np.asarray(self), self.units)


def split_unit(column: str) -> tuple[str, str]:
    """Name and unit of a column: ``side_flow_m3_per_s`` is ``side_flow`` in ``m3/s``."""
    words = column.split("_")
    first = len(words)
    while first > 1 and (words[first - 1] in UNITS or words[first - 1] == "per"):
        first -= 1
    if words[first : first + 1] == ["per"]:
        first += 1
    unit = " ".join(_WRITTEN.get(word, word) for word in words[first:]).replace(" per ", "/")
    return "_".join(words[:first]), unit or DIMENSIONLESS


def with_unit(name: str, unit: str) -> str:
    """The column of a quantity: the inverse of `split_unit`."""
    if unit == DIMENSIONLESS:
        return name
    for short, written in _WRITTEN.items():
        unit = unit.replace(written, short)
    return f"{name}_{unit.replace('/', '_per_').replace(' ', '_')}"


#: Column of the time.
TIME = "time_s"


def csv_line(values: Sequence[str]) -> bytes:
    """One row of a file of comma-separated values."""
    buffer = io.StringIO()
    csv.writer(buffer).writerow(values)
    return buffer.getvalue().encode()
