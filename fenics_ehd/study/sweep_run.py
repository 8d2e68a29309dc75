"""Run a sweep: every case that has no complete row yet."""

from __future__ import annotations

from collections.abc import Callable

from fenics_ehd.base.folder import let_go
from fenics_ehd.study.case import Case
from fenics_ehd.study.outcome import Outcome
from fenics_ehd.study.pool import ProcessPool
from fenics_ehd.study.sweep_table import SweepTable, folder_of
from fenics_ehd.study.work import CaseTask, run_cases


def run_sweep(
    table: SweepTable,
    pool: ProcessPool,
    *,
    keep: bool = False,
    check: Callable[[], None] = lambda: None,
    progress: Callable[[str], None] = lambda status: None,
) -> None:
    """Run every case that has no complete row, and add its row.

    Parameters
    ----------
    table
        The sweep's rows.
    pool
        Workers.
    keep
        Keep the results of every case in ``runs/0001`` and so on.
    check
        Called a few times a second; may raise `KeyboardInterrupt`.
    progress
        Called with the status of every case that ends.
    """

    def ended(case: Case, outcome: Outcome) -> None:
        table.add(case, outcome.status, outcome.figures)
        progress(outcome.status)

    folder = table.directory
    tasks = [
        CaseTask(case, folder / "bodies", folder / "runs" / folder_of(case), keep)
        for case in table.sweep.cases
        if not table.complete(case)
    ]
    run_cases(tasks, folder / "bodies", pool, ended, check)
    let_go(folder / "runs")
