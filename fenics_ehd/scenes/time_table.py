"""Something over time, from a CSV file.

    # anything
    time_s,speed_rad_per_s
    0.0,0.0
    ...

Between the rows lies a cubic curve that never leaves their range (F. N. Fritsch and J. Butland,
SIAM J. Sci. Stat. Comput. 5, 1984); before the first and after the last row their values stay.
"""

from __future__ import annotations

from pathlib import Path

from scipy.interpolate import PchipInterpolator

from fenics_ehd.multibody.tabulated import Curve
from fenics_ehd.scenes.csv_table import Units, read_columns


def read_time_table(path: str | Path, key: str, column: Units) -> Curve:
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
    _, rows = read_columns(path, f"{key} {path}", {"time": {"s": 1.0}, **column}, 2)
    return Curve(PchipInterpolator(*rows.T), periodic=False)
