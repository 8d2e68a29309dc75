"""What a run answers over its last cycle, from the columns of its history.

A search for a periodic solution: its last whole cycle, see `last_whole_cycle`. Another run: its
last full one, the turn of the crank before its end, or the two turns of a load over 720 degrees, or
the period of loads over time if that is longer; else all of it. Which one it was is told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.multibody.forces import RotatingForce
from fenics_ehd.multibody.integrals import Integrals
from fenics_ehd.multibody.result import last_whole_cycle
from fenics_ehd.multibody.system import System
from fenics_ehd.multibody.tabulated import Curve

#: Share of a cycle that may be missing at its start, whose first step has a length.
WHOLE = 1e-4

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Extreme:
    """What is told of a column: its extreme, by `name`, and others at that step."""

    name: str
    column: str
    sign: int
    before: str
    places: tuple[str, ...]


EXTREMES = (
    Extreme(
        "max_pressure",
        "max_pressure_Pa",
        +1,
        "",
        ("max_pressure_angle_deg", "max_pressure_height_m"),
    ),
    Extreme(
        "min_film", "min_film_thickness_m", -1, "", ("min_film_angle_deg", "min_film_height_m")
    ),
    Extreme("max_force", "force_N", +1, "max_", ("force_angle_deg",)),
    Extreme("max_eccentricity", "eccentricity_ratio", +1, "max_", ()),
)


@dataclass(frozen=True)
class UsedCycle:
    """Part of a run.

    Attributes
    ----------
    start, end
        [s].
    told
        Which one, in words.
    rows
        Steps after its start, and up to its end.
    """

    start: float
    end: float
    told: str
    rows: slice


def cycle_length(system: System) -> tuple[float, float]:
    """Angle of the crank [degrees] and time [s] after which the loads repeat; time 0: no matter."""
    degrees, seconds = 360.0, 0.0
    for force in system.mechanism.forces.values():
        table, body = force.table or (None, "")
        if isinstance(table, Curve) and table.periodic and body:
            degrees = max(degrees, float(np.degrees(table.period)))
        elif isinstance(table, Curve) and table.periodic:
            seconds = max(seconds, table.period)
        if isinstance(force, RotatingForce) and force.speed:
            seconds = max(seconds, 2 * np.pi / abs(force.speed))
    return degrees, seconds


def last_cycle(system: System, columns: Columns) -> UsedCycle:
    """The last full cycle of a run from time zero that is no search for a periodic solution."""
    time, angle = columns["time_s"], columns["crank_angle_deg"]
    degrees, seconds = cycle_length(system)
    end, ahead = float(time[-1]), np.abs(angle[-1] - angle)
    counts, starts = [], []
    if seconds:
        counts.append(end / seconds)
        starts.append(end - seconds)
    if ahead[0] > 0.0:
        counts.append(float(ahead[0]) / degrees)
        # A crank may swing back: the last time that it was a cycle behind.
        before = int(np.flatnonzero(ahead >= min(degrees, ahead[0]))[-1])
        pair = slice(before, before + 2)
        starts.append(float(np.interp(-degrees, -ahead[pair], time[pair])))
    full = int(min(counts, default=0.0) + WHOLE)
    if not full:
        return UsedCycle(0.0, end, "whole run: no full cycle", slice(0, None))
    start = min(starts)
    start = start if start > WHOLE * end else 0.0
    first = int(np.searchsorted(time, start + 1e-9 * (end - start), side="right"))
    return UsedCycle(start, end, f"last of {full}", slice(min(first, len(time) - 1), None))


def searched_cycle(columns: Columns) -> UsedCycle:
    """That of a search, from its columns: of the last cycle at least."""
    rows, time = last_whole_cycle(columns["cycle"], columns["cycle_time_s"]), columns["time_s"]
    end, number = float(time[rows][-1]), int(columns["cycle"][rows][-1])
    start = float(time[rows][0] - columns["cycle_time_s"][rows][0])
    told = f"last of {number}" if columns["cycle"][-1] > 1 else "first cycle: films build up"
    return UsedCycle(start, end, told, rows)


@dataclass(frozen=True, eq=False)
class CycleAnswer:
    """Places, extremes and means over a cycle.

    Attributes
    ----------
    columns
        Of the run's history, of a search those of its last cycle at least.
    used
        Which cycle.
    rates
        Columns of the joints' models.
    """

    columns: Columns
    used: UsedCycle
    rates: Sequence[str]

    @classmethod
    def of(cls, system: System, columns: Columns, rates: Sequence[str]) -> CycleAnswer:
        """Of a run, or of a search so far."""
        search = "cycle" in columns
        used = searched_cycle(columns) if search else last_cycle(system, columns)
        # Means of the models are those of the cycle under way, or the run, already.
        known = used.rows.stop is None if search else not used.start
        return cls(columns, used, () if known else rates)

    def figures(self) -> dict[str, object]:
        """What the summary says of the cycle itself."""
        used = self.used
        return {
            "cycle_used": used.told,
            "cycle_start_s": used.start,
            "cycle_end_s": used.end,
        }

    def joint(self, prefix: str) -> dict[str, float]:
        """What it says of a joint, whose columns begin with a prefix."""
        found: dict[str, float] = {}
        for extreme in EXTREMES:
            found |= self._extreme(prefix, extreme)
        found["cycle_mean_force_N"] = self._means[f"{prefix}force_N"]
        for name in self.rates:
            if name.startswith(prefix):
                found[f"cycle_mean_{name.removeprefix(prefix)}"] = self._means[name]
        return found

    def _extreme(self, prefix: str, extreme: Extreme) -> dict[str, float]:
        """The largest or smallest value of a column, with what was true at that step."""
        values = extreme.sign * self.columns[prefix + extreme.column][self.used.rows]
        row = self.used.rows.start + int(np.argmax(values))
        found = {
            f"cycle_{extreme.before}{name}": float(self.columns[prefix + name][row])
            for name in (extreme.column, *extreme.places)
        }
        crank_angle = float(self.columns["crank_angle_deg"][row])
        return found | {f"cycle_{extreme.name}_crank_angle_deg": crank_angle}

    @cached_property
    def _means(self) -> dict[str, float]:
        """Of forces, and of the models where another part of the run is theirs."""
        time = self.columns["time_s"]
        names = [name for name in self.columns if name.split(".")[-1] == "force_N"]
        names += self.rates
        begin = {
            name: float(np.interp(self.used.start, time, self.columns[name])) for name in names
        }
        integrals = Integrals(self.used.start, begin)
        for row in range(*self.used.rows.indices(len(time))):
            integrals.add(time[row], {name: self.columns[name][row] for name in names})
        return integrals.means
