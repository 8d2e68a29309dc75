"""A mechanism from its start to an end time, or to a cycle that repeats itself, and its history.

Four classes and functions share the task: `Run` steps, `Recorder` makes a row of every step,
`RunSummary` computes figures of the rows, and `verdict` judges the figures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import attrs

from fenics_ehd.base.arguments import (
    require_callable,
    require_class,
    require_count,
    require_names,
    require_number,
)
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.heat import require_cycle
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.verdict import verdict


def summarised_history(recorder: Recorder) -> History:
    """History of a run that has ended, with its verdict, its summary and the run itself."""
    summary = RunSummary(recorder)
    entries = {"status": verdict(summary), **summary.entries()}
    return replace(recorder.final_history(), entries=entries, solved=recorder)


def simulate(
    mechanism: Mechanism,
    end: float | None = None,
    *,
    period: float | None = None,
    periodicity: float = 1e-4,
    cycles: int = 20,
    progress: Callable[[MechanismStep], None] = lambda step: None,
    **steps: Any,
) -> History:
    """Simulate a mechanism from its start to an end time, or until its motion is periodic.

    Parameters
    ----------
    mechanism
        Assembled from its rough pose.
    end
        End time of an initial value problem [s]; or
    period, periodicity, cycles
        Period of the loads and drives [s], and when the search for a periodic solution ends, see
        `PeriodicSolver`.
    progress
        Called after every accepted step: ``lambda step: print(step.time)``.
    steps
        Fields of `IntegratorOptions`: ``tolerance=1e-6``.

    Returns
    -------
    History
        Of all steps; of a periodic solution, of its last cycle with times from 0 to the period.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, neither or both of end and period are given, or the end
        is not after the start; a joint has `heat` and no period; there is no film to repeat.
    StepSizeError
        No step is short enough.
    FilmTooThinError
        A film became thinner than its joint's `smallest_film`.
    PeriodicityError
        The films still change after so many cycles.
    """
    require_class("mechanism", mechanism, Mechanism)
    require_names("simulate", steps, attrs.fields_dict(IntegratorOptions))
    if (end is None) == (period is None):
        raise SettingsError(
            "simulate needs one of end, the time to simulate, and period, the period of the loads"
        )
    duration = ("end", end) if period is None else ("period", period)
    span = require_number(*duration, above=0)
    require_number("periodicity", periodicity, above=0)
    require_count("cycles", cycles, least=1)
    require_callable("progress", progress)
    run = Run(mechanism, IntegratorOptions(**steps), span)
    for name, joint in mechanism.joints.items():
        if getattr(joint, "heat", None) is not None:
            require_cycle(period is not None, f"joints.{name}.heat")
    search = None if period is None else PeriodicSolver(run, span, periodicity, cycles)
    recorder = Recorder(run, span, search)
    for step, _ in recorder.steps():
        progress(step)
    return summarised_history(recorder)
