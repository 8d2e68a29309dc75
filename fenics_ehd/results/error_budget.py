"""A recorded run's error budget: estimated from its history, stored beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fenics_ehd.base.output import ERROR_BUDGET, to_json, write_whole
from fenics_ehd.multibody.course import Course, course_of
from fenics_ehd.multibody.error_budget import QUANTITIES, ErrorBudget, Estimator
from fenics_ehd.results.history_file import opened_history, read_fields
from fenics_ehd.results.load import load_results
from fenics_ehd.results.recorded_run import RecordedRun

#: Of a film, that a course is made of.
FIELDS = ("pressure", "gap", "fluid_fraction")


def recorded_course(recorded: RecordedRun, directory: Path) -> Course:
    """Of a run's last cycle, or all of it."""
    system, first = recorded.run.equations.system, recorded.first_row
    names = ["state/coordinates", "state/quasi_static"]
    for place in system.films:
        names += [f"joints/{place.name}/film/{name}" for name in FIELDS]
    with opened_history(directory) as file:
        there = [name for name in names if name in file]
    fields = read_fields(directory, tuple(there))
    columns = load_results(directory, films=False).columns
    columns = {name: values[first:] for name, values in columns.items()}
    return course_of(system, columns, {name: values[first:] for name, values in fields.items()})


def estimated(recorded: RecordedRun, directory: Path) -> dict[str, Any]:
    """Estimate the errors of a run that is complete, and leave them in its folder.

    Parameters
    ----------
    recorded, directory
        The run, its history there.

    Returns
    -------
    dict
        For ``summary.json``: processor time, Newton iterations, why what is not estimated is not.
        The tracker has the budgets.
    """
    estimator = Estimator(
        recorded.run,
        recorded.cycles,
        recorded.began,
        recorded_course(recorded, directory),
        recorded.tracker,
    )
    budget = estimator.budget()
    write_whole(directory / ERROR_BUDGET, to_json(curves(recorded, budget)) + "\n")
    recorded.tracker.worth = budget.joints
    return {
        "error_budget_notes": budget.notes,
        "error_budget_iterations": budget.iterations,
        "error_budget_processor_time_s": budget.seconds,
    }


def curves(recorded: RecordedRun, budget: ErrorBudget) -> dict[str, Any]:
    """Errors over time: what the exact solution is estimated to have more, by component."""
    films = recorded.run.equations.system.films
    start = 0.0 if recorded.cycles is None else recorded.cycles.start
    found: dict[str, Any] = {}
    for i, place in enumerate(films):
        own: dict[str, Any] = {}
        for component, change in budget.changes.items():
            values = {
                "time_s": change.times - start,
                f"{QUANTITIES[0]}_Pa": change.peaks[:, i],
                f"{QUANTITIES[1]}_m": change.films[:, i],
                f"more_{QUANTITIES[0]}_Pa": change.more_pressure[:, i],
                f"more_{QUANTITIES[1]}_m": change.more_film[:, i],
            }
            own[component] = {name: value.tolist() for name, value in values.items()}
        found[place.name] = own
    return found
