"""Simulation of a mechanism to an end time, or until its motion is periodic.

Three classes and a function share the task: `Run` takes the steps, `Recorder` stores a row for
every step, `RunSummary` computes results from the rows, and `verdict` accepts or rejects them.
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
from fenics_ehd.base.progress import Progress, chosen_progress
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
    """Make the history of a run that has ended, with verdict, summary and the recorder."""
    recorder.add_reported()
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
    progress: Progress | bool | Callable[[MechanismStep], None] = True,
    **steps: Any,
) -> History:
    """Simulate a mechanism from its start to an end time, or until its motion is periodic.

    Parameters
    ----------
    mechanism
        Mechanism in its rough pose, from which it is assembled.
    end
        End time of the simulation [s], unless `period` is given.
    period, periodicity, cycles
        Period of the loads and drives [s] for the search for a periodic solution; largest relative
        change of the films over a cycle, and largest number of cycles, see `PeriodicSolver`.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the run is a
        stage; or a function that is called with every accepted step, and shows nothing:
        ``lambda step: print(step.time)``.
    steps
        Options of the time integration, see `IntegratorOptions`: ``tolerance=1e-6``.

    Returns
    -------
    History
        History of all steps. For a periodic solution, that of its last cycle, with times from 0 to
        the period.

    Raises
    ------
    SettingsError
        If the mechanism cannot be assembled, not exactly one of end and period is given, or the end
        is not after the start; if a joint has `heat` without a period, or a search has no film.
    StepSizeError
        If no step is short enough.
    FilmTooThinError
        If a film becomes thinner than its joint's `smallest_film`.
    PeriodicityError
        If the films still change after the largest number of cycles.
    """
    require_class("mechanism", mechanism, Mechanism)
    require_names("simulate", steps, attrs.fields_dict(IntegratorOptions))
    if (end is None) == (period is None):
        raise SettingsError(
            "simulate needs either end, the time to simulate, or period, the period of the loads"
        )
    duration = ("end", end) if period is None else ("period", period)
    span = require_number(*duration, above=0)
    require_number("periodicity", periodicity, above=0)
    require_count("cycles", cycles, least=1)
    if not isinstance(progress, bool | Progress):
        require_callable("progress", progress)
    run = Run(mechanism, IntegratorOptions(**steps), span)
    for name, joint in mechanism.joints.items():
        if getattr(joint, "heat", None) is not None:
            require_cycle(period is not None, f"joints.{name}.heat")
    search = None if period is None else PeriodicSolver(run, span, periodicity, cycles)
    recorder = Recorder(run, span, search)
    if not isinstance(progress, bool | Progress):
        for step, _ in recorder.steps():
            progress(step)
        return summarised_history(recorder)
    with recorder.shown(chosen_progress(progress), "simulation") as show:
        for step, _ in recorder.steps():
            show(step)
    return summarised_history(recorder)
