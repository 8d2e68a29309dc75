"""A mechanism from its start to an end time, or to the cycle that repeats itself."""

from __future__ import annotations

from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.result import Result
from fenics_ehd.multibody.run import Run, Steps


def simulate(mechanism: Mechanism, end: float, **steps: Any) -> Result:
    """Solve the initial value problem.

    Parameters
    ----------
    mechanism
        What moves; it is assembled from its rough pose.
    end
        End time [s].
    steps
        Fields of `Steps`: ``tolerance=1e-6``.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, the end is not after the start, or a joint has `heat`.
    StepSizeError
        No step is short enough.
    FilmTooThinError
        A film became thinner than its joint's `smallest_film`.
    """
    run = Run(mechanism, Steps(**steps), end)
    if run.equations.system.heated:
        raise SettingsError(
            "a joint's heat is balanced over a cycle, and an initial value problem has none: take "
            "simulate_periodic, or leave `heat` out, the oil at the lubricant's temperature"
        )
    record = Recorder(run)
    for step in run.until(end):
        record.add(step)
    return record.result()


def simulate_periodic(
    mechanism: Mechanism,
    period: float,
    *,
    periodicity: float = 1e-4,
    cycles: int = 20,
    **steps: Any,
) -> Result:
    """The cycle that repeats itself, of a mechanism whose forcing repeats.

    Parameters
    ----------
    mechanism, steps
        As for `simulate`.
    period, periodicity, cycles
        See `Cycles`.

    Returns
    -------
    Result
        Of the last cycle, its time from 0 to the period.

    Raises
    ------
    PeriodicityError
        The films still change after so many cycles.
    SettingsError, StepSizeError, FilmTooThinError
        As `simulate`; there is no film to repeat.
    """
    run = Run(mechanism, Steps(**steps), period)
    search = Cycles(run, period, periodicity, cycles)
    record = Recorder(run)
    for step in search:
        record.add(step, search)
    return record.result(search)
