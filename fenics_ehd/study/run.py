"""Run a study: bodies first, then the runs, the longest before the others; then compare."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fenics_ehd.study.compare import Comparison
from fenics_ehd.study.cost import reduction_cost, run_cost
from fenics_ehd.study.folder import StudyFolder, store_outcome
from fenics_ehd.study.plan import REFERENCE, Study, StudyRun
from fenics_ehd.study.provenance import call, describe_study, former_calls
from fenics_ehd.study.reference import describe_reference
from fenics_ehd.study.table import TableRows, write_table
from fenics_ehd.study.work import RunTask, run_study_case
from fenics_ehd.sweeps.pool import Pool, outcomes
from fenics_ehd.sweeps.sweep import body_tasks, recorded
from fenics_ehd.sweeps.work import BodyTask, Outcome, reduce_body

#: Told of every task that ended: its cost, and its status.
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Work:
    """What a study has left to do: bodies to reduce, runs to make."""

    bodies: Mapping[str, BodyTask]
    runs: tuple[StudyRun, ...]

    @property
    def cost(self) -> float:
        """Of all of it, see `fenics_ehd.study.cost`."""
        return sum(reduction_cost(task.settings) for task in self.bodies.values()) + sum(
            run_cost(run.case.settings) for run in self.runs
        )


def work_left(study: Study, folder: StudyFolder) -> Work:
    """Runs that are not complete, the reference and the longest first, and bodies they need.

    A body that complete runs lack is among them, or whose file is damaged: errors need it.
    """
    runs = [run for run in study.runs.values() if not _complete(folder.outcome(run))]
    runs.sort(key=lambda run: (run.name != REFERENCE, -run_cost(run.case.settings)))
    there = {name for name in {r.body for r in study.runs.values()} if folder.has_body(name)}
    lacking = [run for run in study.runs.values() if run.body not in there]
    tasks = body_tasks((run.case for run in [*runs, *lacking]), folder.path / "bodies")
    return Work(tasks, tuple(runs))


def _complete(outcome: Outcome | None) -> bool:
    return outcome is not None and outcome.status == "complete"


def run_study(
    study: Study,
    folder: StudyFolder,
    pool: Pool,
    *,
    check: Callable[[], None] = lambda: None,
    progress: Progress = lambda cost, status: None,
    work: Work | None = None,
) -> list[dict[str, Any]]:
    """Run what is missing and write ``study.json``, ``reference.json`` and ``table.csv``.

    A run that fails is a row with its reason and ends nothing; so does one whose files cannot be
    compared. The table has a row for every run from the beginning, and is written again whenever
    one ends.

    Parameters
    ----------
    study, folder
        What to run, and where.
    pool
        Workers.
    check
        Called a few times a second; may raise `KeyboardInterrupt`.
    progress
        Told of every task that ended.
    work
        What `work_left` said, where it was asked already.

    Returns
    -------
    list of dict
        Rows of the table.
    """
    work = work or work_left(study, folder)
    folder.forget_errors()
    comparison = Comparison(study, folder)
    rows = TableRows(comparison)
    pending = {run.name for run in work.runs}
    kept = [run for run in study.runs.values() if run.name not in pending]
    # Runs whose body is still to be reduced cannot be compared before that.
    for run in kept:
        if run.body not in work.bodies:
            comparison.add(run.name, folder.outcome(run))
    comparison.compare(check)
    _write_study(study, folder, pool, work)
    _write(study, folder, comparison, rows)
    failures = _reduce(work, pool, check, progress)
    for run in kept:
        if run.body in work.bodies:
            comparison.add(run.name, folder.outcome(run))
    for run, outcome in _outcomes(work, failures, folder, pool, check):
        comparison.add(run.name, outcome)
        progress(run_cost(run.case.settings), outcome.status)
        _write(study, folder, comparison, rows)
    return _write(study, folder, comparison, rows)


def _write_study(study: Study, folder: StudyFolder, pool: Pool, work: Work) -> None:
    """``study.json``, with this call of the program if it has runs to make."""
    calls = former_calls(folder.path / "study.json")
    if work.runs:
        calls.append(call(pool.width, len(work.runs)))
    folder.write("study.json", describe_study(study) | {"calls": calls})


def _reduce(
    work: Work, pool: Pool, check: Callable[[], None], progress: Progress
) -> dict[str, Outcome]:
    """Reduce bodies; those that failed by name."""
    failures = {}
    for body, answer in outcomes(pool, reduce_body, _longest_first(work.bodies.values()), check):
        outcome = recorded(answer)
        progress(reduction_cost(body.settings), outcome.status)
        if outcome.status != "complete":
            failures[body.name] = outcome
    return failures


def _outcomes(
    work: Work,
    failures: Mapping[str, Outcome],
    folder: StudyFolder,
    pool: Pool,
    check: Callable[[], None],
) -> Iterator[tuple[StudyRun, Outcome]]:
    """Runs as they end; those whose body failed first."""
    for run in work.runs:
        if run.body in failures:
            store_outcome(folder.run(run.name), run.identity, failures[run.body])
            yield run, failures[run.body]
    tasks = [
        RunTask(run, folder.body(run.body), folder.run(run.name))
        for run in work.runs
        if run.body not in failures
    ]
    for task, answer in outcomes(pool, run_study_case, tasks, check):
        yield task.run, recorded(answer)


def _longest_first(tasks: Iterable[BodyTask]) -> list[BodyTask]:
    return sorted(tasks, key=lambda task: -reduction_cost(task.settings))


def _write(
    study: Study, folder: StudyFolder, comparison: Comparison, rows: TableRows
) -> list[dict[str, Any]]:
    """Tables of all runs, as far as they ended."""
    # First, for a run that turns out damaged may be one of any row.
    comparison.compare()
    found = [rows.row(row, study.runs[row.run]) for row in study.rows]
    write_table(Path(folder.path, "table.csv"), found)
    folder.write("reference.json", describe_reference(study, comparison))
    return found
