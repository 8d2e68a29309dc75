"""A periodic load, from a CSV file of times and forces.

    # anything
    time_s,Fx_N,Fy_N
    0.0,120.0,-3400.0
    ...

The header names the columns and their units; times begin at zero and ascend.
The load of the last row is that of the first, unless a longer period is given.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.tabulated import TabulatedLoad
from fenics_ehd.scenes.csv_rows import finite_number, numbered_rows

#: Factors to SI of the units a header may name.
UNITS = {
    "time": {"s": 1.0, "ms": 1e-3},
    "Fx": {"N": 1.0, "kN": 1e3},
    "Fy": {"N": 1.0, "kN": 1e3},
}

#: ``time_s``, ``time [s]`` or ``time (s)``.
HEADER = re.compile(r"\s*([A-Za-z]+)\s*(?:_\s*|\[\s*|\(\s*)([A-Za-z]+)\s*[\])]?\s*")

FEWEST_ROWS = 3

#: The last load may differ from the first by this share of the largest: rounding in the file.
CLOSING_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class LoadHistory:
    """Load on the shaft over one period.

    Attributes
    ----------
    times
        From zero to the period, ascending, shape (n,) [s].
    forces
        x and y components, the last row that of the first, shape (n, 2) [N].
    interpolation
        ``"cubic"``: periodic spline, or ``"linear"``.
    """

    times: np.ndarray
    forces: np.ndarray
    interpolation: str = "cubic"

    @property
    def period(self) -> float:
        """[s]."""
        return float(self.times[-1])

    @property
    def largest(self) -> float:
        """Largest force of the rows [N]."""
        return float(np.hypot(*self.forces.T).max())

    @cached_property
    def _spline(self) -> CubicSpline:
        closed = np.vstack([self.forces[:-1], self.forces[:1]])  # SciPy forgives no round-off
        return CubicSpline(self.times, closed, bc_type="periodic")

    @property
    def tabulated(self) -> TabulatedLoad:
        """Its rows, read at the time."""
        return TabulatedLoad(self.times, self.forces, self, lambda time, x: time)

    def __call__(self, time: float) -> np.ndarray:
        """Force at any time, shape (2,) [N]."""
        if self.interpolation == "cubic":
            return np.asarray(self._spline(time))
        phase = time % self.period if time != self.period else time
        return np.array([np.interp(phase, self.times, column) for column in self.forces.T])


def read_load(
    path: str | Path,
    *,
    scale: float = 1.0,
    interpolation: str = "cubic",
    period: float = 0.0,
    section: str = "load",
) -> LoadHistory:
    """Load history of a CSV file.

    Parameters
    ----------
    path
        The file; lines that start with ``#`` are comments.
    scale
        Factor on the forces.
    interpolation
        See `LoadHistory`.
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
    lines, values = _rows(path, where)
    if len(values) < FEWEST_ROWS:
        raise SettingsError(
            f"{where}: {len(values)} rows of numbers, at least {FEWEST_ROWS} are needed"
        )
    times, forces = values[:, 0], scale * values[:, 1:]
    _check_times(where, lines, times)
    largest = float(np.hypot(*forces.T).max())
    if not largest > 0:
        raise SettingsError(f"{where}: the load is 0 throughout")
    if period:
        if not period > times[-1]:
            raise SettingsError(
                f"{section}.period = {period:g} s must be above {times[-1]:g} s, the last time of "
                f"{path}, line {lines[-1]}"
            )
        times, forces = np.append(times, period), np.vstack([forces, forces[:1]])
    gap = float(np.hypot(*(forces[-1] - forces[0])))
    if not gap <= CLOSING_TOLERANCE * largest:
        raise SettingsError(
            f"{where}, line {lines[-1]}: the last load ({forces[-1, 0]:g}, "
            f"{forces[-1, 1]:g}) N differs from the first by {gap:.3g} N, above "
            f"{CLOSING_TOLERANCE:g} of the largest: close the cycle or set {section}.period"
        )
    return LoadHistory(times, np.vstack([forces[:-1], forces[:1]]), interpolation)


def _check_times(where: str, lines: list[int], times: np.ndarray) -> None:
    if times[0] != 0.0:
        raise SettingsError(
            f"{where}, line {lines[0]}: the first time is {times[0]:g} s, it must be 0"
        )
    for line, before, time in zip(lines[1:], times[:-1], times[1:], strict=True):
        if not time > before:
            raise SettingsError(
                f"{where}, line {line}: the time {time:g} s must be above {before:g} s, "
                "that of the row before"
            )


def _rows(path: str | Path, where: str) -> tuple[list[int], np.ndarray]:
    """Line numbers, and numbers in SI units in the order time, Fx, Fy."""
    numbered = numbered_rows(path, where)
    if not numbered:
        raise SettingsError(f"{where}: no header time_s,Fx_N,Fy_N")
    (first, header), body = numbered[0], numbered[1:]
    order, factors = _columns(f"{where}, line {first}", header)
    values = np.empty((len(body), 3))
    for row, (number, entries) in enumerate(body):
        line = f"{where}, line {number}"
        if len(entries) != len(header):
            raise SettingsError(f"{line}: {len(entries)} values for {len(header)} columns")
        values[row] = [finite_number(f"{line}: {header[i]}", entries[i]) for i in order]
    return [number for number, _ in body], values * factors


def _columns(where: str, header: list[str]) -> tuple[list[int], np.ndarray]:
    """Which column holds time, Fx and Fy, and their factors to SI."""
    found: dict[str, tuple[int, float]] = {}
    for index, title in enumerate(header):
        match = HEADER.fullmatch(title)
        name = match[1] if match else title
        if name not in UNITS or name in found:
            reason = "appears twice" if name in found else "is not one of time, Fx and Fy"
            raise SettingsError(
                f"{where}: column {title!r} {reason}, with a unit: time_s,Fx_N,Fy_N"
            )
        units = UNITS[name]
        if match is None or match[2] not in units:
            known = " or ".join(f"{name}_{unit}" for unit in units)
            raise SettingsError(f"{where}: column {title!r} needs a unit: {known}")
        found[name] = (index, units[match[2]])
    missing = [name for name in UNITS if name not in found]
    if missing:
        raise SettingsError(f"{where}: no column {', '.join(missing)}; needed: time_s,Fx_N,Fy_N")
    ordered = [found[name] for name in UNITS]
    return [index for index, _ in ordered], np.array([factor for _, factor in ordered])
