"""Last complete cycle of a run, from which its results, plots and stresses are computed.

A search for a periodic solution numbers its cycles. Its last complete cycle is the last one that
reached its end. The first cycle, in which the films build up, is used only if there is no other.

Other runs do not number cycles. Their last complete cycle ends with the run, and begins one cycle
of the reference angle before the end, or one period of the loads over time, whichever is earlier
(`Recurrence`). A shorter run has no complete cycle: results are those of the complete run.

The constructors `Cycle.of_search` and `Cycle.of_run` decide the cycle once. Its times are stored
with the history and in the summary. `Cycle.rows` finds its steps by these times, also in a history
of a part of the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from fenics_ehd.base.described import Described
from fenics_ehd.base.layout import Group, Value

#: Share of a period by which the last step of a complete cycle may end early, by rounding of times.
END_ROUNDING = 1e-6

#: Share of a cycle that may be missing at the start of a run, because of the length of its first
#: step.
FIRST_STEP = 1e-4

#: Share of a cycle by which a step at its start or end may differ from it, by rounding of times.
TIME_ROUNDING = 1e-9

#: Difference in turns up to which two angles count as equal, because of rounding.
TURN_ROUNDING = 1e-6

#: Name of the body whose reference angle is called the crank angle.
CRANK = "crank"

#: Labels for runs without a complete cycle.
BUILDS_UP = "first cycle: films build up"
TOO_SHORT = "whole run: no full cycle"
UNKNOWN = "whole run"


def first_of_last(numbers: Sequence[float] | np.ndarray) -> int:
    """Index of the first step of the last cycle; 0 if there are no steps.

    `numbers` has the number of the cycle of every step, shape (steps,).
    """
    return int(np.searchsorted(numbers, numbers[-1])) if len(numbers) else 0


def angle_name(body: str) -> str:
    """Words for the angle of a body, ``"crank angle"`` or ``"angle of the shaft"``."""
    return "crank angle" if body == CRANK else f"angle of the {body}"


def angle_before(angles: np.ndarray) -> float:
    """Angle of the whole cycles before a cycle [degrees], which pictures and summaries subtract.

    Revolutions of a cycle of two are subtracted in pairs: one alone would lead to another stroke.

    Parameters
    ----------
    angles
        Reference angles over the cycle, from its start, shape (k,) [degrees].
    """
    turn = 360.0 * max(1.0, float(np.round(np.ptp(angles) / 360.0)))
    return float(turn * np.floor(angles[0] / turn + TURN_ROUNDING))


@dataclass(frozen=True)
class Recurrence:
    """Angle and time after which the loads of a mechanism recur.

    Attributes
    ----------
    angle
        Change of the reference angle, 360 or 720 [degrees].
    time
        Longest period of loads over time [s]; 0 without such loads.
    """

    angle: float = 360.0
    time: float = 0.0


@dataclass(frozen=True)
class Cycle(Described):
    """Last complete cycle of a run, or the complete run if it has none.

    Attributes
    ----------
    start, end
        Times of the start and the end of the cycle since the start of the run [s].
    label
        Description of the cycle for the user, ``"last of 3"``.
    complete
        Whether the run has a complete cycle; the first cycle of a search counts as incomplete.
    periodic
        Whether the run was a search for a periodic solution.
    """

    start: float
    end: float
    label: str
    complete: bool
    periodic: bool

    #: Layout of a cycle in ``history.h5``.
    layout: ClassVar = Group(
        {
            "start": Value("float", attribute=True),
            "end": Value("float", attribute=True),
            "label": Value("text", attribute=True),
            "complete": Value("truth", attribute=True),
            "periodic": Value("truth", attribute=True),
        },
        required=False,
    )

    @property
    def period(self) -> float:
        """Length of the cycle [s]."""
        return self.end - self.start

    @classmethod
    def of_search(cls, times: np.ndarray, numbers: np.ndarray, clock: np.ndarray) -> Self:
        """Last complete cycle of a search for a periodic solution.

        Parameters
        ----------
        times, numbers, clock
            Time [s], number of the cycle and time since its start [s] of every step, shape
            (steps,).
        """
        first = first_of_last(numbers)
        rows = slice(first, None)
        if first and clock[-1] < (1.0 - END_ROUNDING) * clock[first - 1]:
            rows = slice(int(np.searchsorted(numbers, numbers[-1] - 1)), first)
        start = float(times[rows][0] - clock[rows][0])
        complete = bool(numbers[-1] > 1)
        label = f"last of {numbers[rows][-1]:.0f}" if complete else BUILDS_UP
        return cls(start, float(times[rows][-1]), label, complete, periodic=True)

    @classmethod
    def of_run(cls, times: np.ndarray, angles: np.ndarray, recurrence: Recurrence) -> Self:
        """Last complete cycle of a run that is no search for a periodic solution.

        The run began at time 0.

        Parameters
        ----------
        times, angles
            Time [s] and reference angle [degrees] of every step, shape (steps,).
        recurrence
            Angle and time after which the loads recur.
        """
        end = float(times[-1])
        turned = np.abs(angles[-1] - angles)
        counts: list[float] = []  # numbers of cycles, by time and by angle
        starts: list[float] = []
        if recurrence.time:
            counts.append(end / recurrence.time)
            starts.append(end - recurrence.time)
        if turned[0] > 0.0:
            counts.append(float(turned[0]) / recurrence.angle)
            # A crank may swing back: the cycle starts when the angle was last a cycle behind.
            before = int(np.flatnonzero(turned >= min(recurrence.angle, turned[0]))[-1])
            pair = slice(before, before + 2)
            starts.append(float(np.interp(-recurrence.angle, -turned[pair], times[pair])))
        number = int(min(counts, default=0.0) + FIRST_STEP)
        if not number:
            return cls(0.0, end, TOO_SHORT, complete=False, periodic=False)
        start = min(starts)
        if start <= FIRST_STEP * end:
            start = 0.0
        return cls(start, end, f"last of {number}", complete=True, periodic=False)

    @classmethod
    def of_columns(cls, columns: Mapping[str, np.ndarray], recurrence: Recurrence) -> Self:
        """Last complete cycle of any run, from its recorded columns.

        Parameters
        ----------
        columns
            Columns by path with unit, shape (steps,) each; for a search, those of its last two
            cycles at least.
        recurrence
            Angle and time after which the loads recur.
        """
        times = columns["time_s"]
        if "run/cycle" in columns:
            return cls.of_search(times, columns["run/cycle"], columns["run/cycle_time_s"])
        return cls.of_run(times, columns["run/crank_angle_deg"], recurrence)

    @classmethod
    def of_stored_columns(
        cls, times: np.ndarray, numbers: np.ndarray | None, clock: np.ndarray | None
    ) -> Self:
        """Last complete cycle of a history that was stored without it.

        If the run was no search, the period of its loads is unknown, and the complete run is used.

        Parameters
        ----------
        times, numbers, clock
            Arguments of `of_search`; numbers and clock are None if the run was no search.
        """
        if numbers is not None and clock is not None and len(times):
            return cls.of_search(times, numbers, clock)
        end = float(times[-1]) if len(times) else 0.0
        return cls(0.0, end, UNKNOWN, complete=False, periodic=False)

    @classmethod
    def of_summary(cls, summary: Mapping[str, Any]) -> Self | None:
        """Last complete cycle from a summary of any version; None if the summary has no cycle."""
        names = ("cycle_start_s", "cycle_end_s", "cycle_used")
        if not summary.keys() >= set(names):
            return None
        start, end, label = (summary[name] for name in names)
        complete = label not in (BUILDS_UP, TOO_SHORT, UNKNOWN)
        periodic = "cycles" in summary or label == BUILDS_UP
        return cls(float(start), float(end), label, complete, periodic)

    def entries(self) -> dict[str, Any]:
        """Entries of ``summary.json`` about the cycle."""
        return {"cycle_used": self.label, "cycle_start_s": self.start, "cycle_end_s": self.end}

    def rows(self, times: np.ndarray) -> slice:
        """Indices of the steps after the start of the cycle and up to its end.

        Parameters
        ----------
        times
            Times of the steps of a history since the start of the run, ascending, (steps,) [s].
        """
        rounding = TIME_ROUNDING * self.period
        first = int(np.searchsorted(times, self.start + rounding, side="right"))
        stop = int(np.searchsorted(times, self.end + rounding, side="right"))
        return slice(min(first, max(stop - 1, 0)), stop)

    def rows_from_start(self, times: np.ndarray, numbers: np.ndarray | None = None) -> slice:
        """Indices of the steps of the cycle, with the step at its start if the history has it.

        Parameters
        ----------
        times
            Times of the steps since the start of the run, ascending, shape (steps,) [s].
        numbers
            Number of the cycle at every step of a search, shape (steps,). With it, the last step of
            the previous cycle is not used as the step at the start.
        """
        rows = self.rows(times)
        before = rows.start - 1
        if before < 0 or times[before] < self.start - TIME_ROUNDING * self.period:
            return rows
        alike = numbers is None or numbers[before] == numbers[rows.start]
        return slice(before, rows.stop) if alike else rows
