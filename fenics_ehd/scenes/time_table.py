"""Something over time, from a CSV file.

    # anything
    time_s,speed_rad_per_s
    0.0,0.0
    ...

Between the rows lies a cubic curve that never leaves their range (F. N. Fritsch and J. Butland,
SIAM J. Sci. Stat. Comput. 5, 1984); before the first and after the last row their values stay.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from fenics_ehd.errors import SettingsError
from fenics_ehd.scenes.csv_rows import finite_number, numbered_rows


@dataclass(frozen=True, eq=False)
class TimeTable:
    """Function of time.

    Attributes
    ----------
    times
        Ascending, shape (n,) [s].
    values
        shape (n,).
    """

    times: np.ndarray
    values: np.ndarray

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.times, self.values)

    def __call__(self, time: float) -> tuple[float, float]:
        """Value and derivative at a time [s]."""
        inside = min(max(time, self.times[0]), self.times[-1])
        return float(self._curve(inside)), float(self._curve(inside, 1)) if inside == time else 0.0

    def integral(self, time: float) -> float:
        """From time zero."""
        return self._integral(time) - self._integral(0.0)

    def _integral(self, time: float) -> float:
        """From the first row."""
        inside = min(max(time, self.times[0]), self.times[-1])
        value, _ = self(time)
        return float(self._curve.integrate(self.times[0], inside)) + (time - inside) * value


def read_time_table(path: str | Path, key: str, column: str) -> TimeTable:
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
    where, wanted = f"{key} {path}", ["time_s", column]
    numbered = numbered_rows(path, where)
    if not numbered or numbered[0][1] != wanted:
        raise SettingsError(f"{where}: the header must be {','.join(wanted)}")
    rows = []
    for number, entries in numbered[1:]:
        line = f"{where}, line {number}"
        if len(entries) != 2:
            raise SettingsError(f"{line}: {len(entries)} values for 2 columns")
        rows.append(
            [finite_number(f"{line}: {n}", e) for n, e in zip(wanted, entries, strict=True)]
        )
        if len(rows) > 1 and not rows[-1][0] > rows[-2][0]:
            raise SettingsError(
                f"{line}: the time {rows[-1][0]:g} s must be above {rows[-2][0]:g} s, that of the "
                "row before"
            )
    if len(rows) < 2:
        raise SettingsError(f"{where}: {len(rows)} rows of numbers, at least 2 are needed")
    times, values = np.array(rows).T
    return TimeTable(times, values)
