"""A periodic load, from a CSV file of times and forces.

    # anything
    time_s,Fx_N,Fy_N
    0.0,120.0,-3400.0
    ...

The header names the columns and their units; times begin at zero and ascend.
The load of the last row is that of the first, unless a longer period is given.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.tabulated import Curve
from fenics_ehd.scenes.csv_table import read_columns, require_closed

#: Factors to SI of the units a header may name.
UNITS = {
    "time": {"s": 1.0, "ms": 1e-3},
    "Fx": {"N": 1.0, "kN": 1e3},
    "Fy": {"N": 1.0, "kN": 1e3},
}


def load_curves(
    times: np.ndarray, forces: np.ndarray, interpolation: str = "cubic"
) -> tuple[Curve, Curve]:
    """Components along x and y of a periodic load.

    Parameters
    ----------
    times
        From zero to the period, ascending, shape (n,) [s].
    forces
        The last row that of the first, shape (n, 2) [N].
    interpolation
        ``"cubic"``: periodic spline, or ``"linear"``.
    """
    closed = np.vstack([forces[:-1], forces[:1]])  # SciPy forgives no round-off
    largest = float(np.hypot(*forces.T).max())

    def curve(values: np.ndarray) -> PPoly:
        if interpolation == "cubic":
            return CubicSpline(times, values, bc_type="periodic")
        return PPoly(np.stack([np.diff(values) / np.diff(times), values[:-1]]), times)

    x, y = (Curve(curve(values), periodic=True, scale=largest) for values in closed.T)
    return x, y


def read_load(
    path: str | Path,
    *,
    scale: float = 1.0,
    interpolation: str = "cubic",
    period: float = 0.0,
    section: str = "load",
) -> tuple[Curve, Curve]:
    """Components along x and y of the load of a CSV file.

    Parameters
    ----------
    path
        The file; lines that start with ``#`` are comments.
    scale
        Factor on the forces.
    interpolation
        See `load_curves`.
    period
        Period [s], beyond the last time; zero: the last time, with the load of
        the first.
    section
        Of the scene that names the file, for messages.

    Raises
    ------
    SettingsError
        Naming file, line and value.
    """
    where = f"{section}.file {path}"
    lines, values = read_columns(path, where, UNITS)
    times, forces = values[:, 0], scale * values[:, 1:]
    if times[0] != 0.0:
        raise SettingsError(
            f"{where}, line {lines[0]}: the first time is {times[0]:g} s, it must be 0"
        )
    if not forces.any():
        raise SettingsError(f"{where}: the load is 0 throughout")
    if period:
        if not period > times[-1]:
            raise SettingsError(
                f"{section}.period = {period:g} s must be above {times[-1]:g} s, the last time of "
                f"{path}, line {lines[-1]}"
            )
        times, forces = np.append(times, period), np.vstack([forces, forces[:1]])
    remedy = f"close the cycle or set {section}.period"
    require_closed(f"{where}, line {lines[-1]}", forces, remedy)
    return load_curves(times, forces, interpolation)
