"""Run a study: bodies first, then the runs, the reference before the others; then compare."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fenics_ehd.study.case import Case
from fenics_ehd.study.compare import Comparison
from fenics_ehd.study.folder import StudyFolder
from fenics_ehd.study.outcome import Outcome
from fenics_ehd.study.plan import REFERENCE
from fenics_ehd.study.pool import ProcessPool
from fenics_ehd.study.provenance import call, describe_study, former_calls
from fenics_ehd.study.reference import describe_reference
from fenics_ehd.study.table import table_row, write_table
from fenics_ehd.study.work import CaseTask, run_cases


def run_study(
    folder: StudyFolder,
    pool: ProcessPool,
    *,
    check: Callable[[], None] = lambda: None,
    progress: Callable[[str], None] = lambda status: None,
) -> list[dict[str, Any]]:
    """Run what is missing and write ``study.json``, ``reference.json`` and ``table.csv``.

    A run that fails is a row with its reason and ends nothing; so does one whose files cannot be
    compared. The table has a row for every run from the beginning, and is written again whenever
    one ends.

    Parameters
    ----------
    folder
        Of the study.
    pool
        Workers.
    check
        Called a few times a second; may raise `KeyboardInterrupt`.
    progress
        Called with the status of every run that ends, first of those that had ended before.

    Returns
    -------
    list of dict
        Rows of the table.
    """
    study = folder.study
    folder.forget_errors()
    comparison = Comparison(study, folder)
    tasks = []
    for name, case in study.cases.items():
        outcome = folder.outcome(name)
        if outcome is not None and outcome.complete:
            comparison.add(name, outcome)
            progress(outcome.status)
        else:
            tasks.append(CaseTask(case, folder.bodies, folder.run(name)))
    # Those with the shortest steps take longest.
    tasks.sort(key=lambda task: (task.case.name != REFERENCE, task.case.scene.time.tolerance))
    comparison.compare(check)
    calls = former_calls(folder.path / "study.json")
    if tasks:
        calls.append(call(pool.width, len(tasks)))
    folder.write("study.json", describe_study(study) | {"calls": calls})
    _write(folder, comparison)

    def ended(case: Case, outcome: Outcome) -> None:
        folder.store(case.name, outcome)
        comparison.add(case.name, outcome)
        _write(folder, comparison)
        progress(outcome.status)

    run_cases(tasks, folder.bodies, pool, ended, check)
    return _write(folder, comparison)


def _write(folder: StudyFolder, comparison: Comparison) -> list[dict[str, Any]]:
    """Tables of all runs, as far as they ended."""
    study = folder.study
    # First, for a run that turns out damaged may be one of any row.
    comparison.compare()
    found = [
        table_row(row, joint, study.cases[row.run], comparison)
        for row in study.rows
        for joint in study.joints
    ]
    write_table(folder.path / "table.csv", found)
    folder.write("reference.json", describe_reference(study, comparison))
    return found
