"""Run a planned sweep: bodies first, each of them once, then the cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from fenics_ehd.sweeps.plan import Case, Plan
from fenics_ehd.sweeps.pool import Pool, WorkerDiedError, outcomes
from fenics_ehd.sweeps.table import SweepTable
from fenics_ehd.sweeps.work import BodyTask, CaseTask, Outcome, failed, reduce_body, run_case


def run_sweep(
    plan: Plan,
    table: SweepTable,
    pool: Pool,
    *,
    keep: bool = False,
    check: Callable[[], None] = lambda: None,
    progress: Callable[[str], None] = lambda status: None,
) -> None:
    """Run every case that has no complete row, and add its row.

    Parameters
    ----------
    plan
        The sweep.
    table
        Its rows.
    pool
        Workers.
    keep
        Keep the history of every case in ``runs/0001`` and so on.
    check
        Called a few times a second; may raise `KeyboardInterrupt`.
    progress
        Called with the status of every case that ends.
    """

    def end(case: Case, outcome: Outcome) -> None:
        table.add(case, outcome.status, outcome.figures)
        progress(outcome.status)

    pending = [case for case in plan.cases if not table.complete(case)]
    bodies = body_tasks(pending, table.directory / "bodies")
    failures = {
        task.name: outcome
        for task, answer in outcomes(pool, reduce_body, bodies.values(), check)
        if (outcome := recorded(answer)).status != "complete"
    }
    tasks = []
    for case in pending:
        if case.body in failures:
            end(case, failures[case.body])
        else:
            body = bodies[case.body].path if case.body else None
            folder = table.directory / "runs" / f"{case.number:04d}" if keep else None
            tasks.append(CaseTask(case, body, folder))
    for task, answer in outcomes(pool, run_case, tasks, check):
        end(task.case, recorded(answer))


def body_tasks(cases: Iterable[Case], directory: Path) -> dict[str, BodyTask]:
    """One task for each distinct body, by its name."""
    tasks: dict[str, BodyTask] = {}
    for case in cases:
        if case.body and case.body not in tasks:
            tasks[case.body] = BodyTask(case.body, case.settings, directory / f"{case.body}.h5")
    return tasks


def recorded(answer: Outcome | WorkerDiedError) -> Outcome:
    """Outcome of a task whose worker may have died."""
    return failed(answer) if isinstance(answer, WorkerDiedError) else answer
