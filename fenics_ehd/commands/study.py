"""``fenics-ehd study``: its options, its progress, its table."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.study.folder import StudyFolder
    from fenics_ehd.study.plan import Study
    from fenics_ehd.sweeps.pool import Pool

#: Columns of the printed table: column, heading, factor, format.
SHOWN = (
    ("coordinates", "modes", 1, "d"),
    ("pressure_error_max", "p err [%]", 100, ".3g"),
    ("film_error_max", "h err [%]", 100, ".3g"),
    ("offline_s", "offline [s]", 1, ".1f"),
    ("online_s", "online [s]", 1, ".1f"),
    ("steps", "steps", 1, "d"),
)

#: Characters of a status in the printed table.
STATUS_WIDTH = 60


@click.command()
@click.argument("scene")
@click.option(
    "-o",
    "--output",
    "directory",
    type=click.Path(file_okay=False),
    help="Folder for tables, runs and report [default: results/SCENE-study].",
)
@click.option("--quick", is_flag=True, help="A small selection, a few minutes on two cores.")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes [default: the cores this one may use]; with 1 no run disturbs another. "
    "Under mpirun the ranks work.",
)
@click.option("--report/--no-report", default=True, show_default=True, help="Write the report.")
@click.option("--overwrite", is_flag=True, help="Run everything anew.")
@click.option(
    "--json", "as_json", is_flag=True, help="Print the table as JSON on stdout, nothing else there."
)
def study(
    scene: str,
    directory: str | None,
    quick: bool,
    workers: int | None,
    report: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Compare all reduction methods on SCENE: slider-crank, rotor, or a scene file of their kind.

    Error against run time, over numbers of modes, step tolerances and film meshes, relative to
    the full interface. Runs that are complete are not run again.
    """
    from mpi4py import MPI

    from fenics_ehd.study.folder import StudyFolder
    from fenics_ehd.study.plan import make_study
    from fenics_ehd.sweeps.pool import open_pool

    with open_pool(MPI.COMM_WORLD, workers) as pool:
        if pool is None:
            return
        plan = make_study(scene, quick=quick)
        target = Path(directory or Path("results") / f"{Path(scene).stem}-study")
        with StudyFolder(target, plan, overwrite=overwrite) as folder:
            rows = _run(plan, folder, pool)
    _conclude(plan, target, rows, report, as_json)


def _run(plan: Study, folder: StudyFolder, pool: Pool) -> list[dict[str, Any]]:
    """Run what is missing, with a bar; Ctrl-C ends it between two runs."""
    from fenics_ehd.interrupt import interrupt_between_steps
    from fenics_ehd.study.run import run_study, work_left

    work = work_left(plan, folder)
    with _bar(work.cost) as ended, interrupt_between_steps() as check:
        return run_study(plan, folder, pool, check=check, progress=ended, work=work)


@contextmanager
def _bar(cost: float) -> Iterator[Any]:
    """Bar of the work, whose tasks have different lengths, with the time left."""
    from tqdm import tqdm

    done = failed = 0
    with tqdm(
        total=cost,
        file=sys.stderr,
        smoothing=0.0,
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
        bar_format="{percentage:3.0f}% |{bar:24}| {desc} [{elapsed}, ends in {remaining}]",
    ) as bar:

        def ended(cost: float, status: str) -> None:
            nonlocal done, failed
            done, failed = done + 1, failed + (status != "complete")
            bar.set_description_str(f"{done} tasks done, {failed} failed", refresh=False)
            bar.update(cost)

        yield ended


def _conclude(
    plan: Study, directory: Path, rows: Sequence[Mapping[str, Any]], report: bool, as_json: bool
) -> None:
    """Write the report, print the table.

    Raises
    ------
    FailedCasesError
        The reference is not complete: nothing could be compared.
    """
    from fenics_ehd.output import to_json
    from fenics_ehd.study.plan import REFERENCE
    from fenics_ehd.sweeps.errors import FailedCasesError

    status = next(row["status"] for row in rows if row["run"] == REFERENCE)
    written = _report(directory) if report and status == "complete" else None
    if as_json:
        click.echo(to_json({"scene": plan.scene, "directory": str(directory), "rows": rows}))
    else:
        lines = [*_lines(rows), f"rows in {directory / 'table.csv'}, runs in {directory / 'runs'}"]
        click.echo("\n".join([*lines, *([f"report in {written}"] if written else [])]))
    if status != "complete":
        raise FailedCasesError(f"the reference is not complete, nothing was compared: {status}")


def _report(directory: Path) -> Path:
    from fenics_ehd.report import write_report

    return write_report(directory)


def _lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The rows for a reader: aligned, with the units of an engineer."""
    heads = ["group", "run", *(heading for _, heading, _, _ in SHOWN)]
    cells = [[row["group"], row["run"], *_figures(row)] for row in rows]
    widths = [max(map(len, column)) for column in zip(heads, *cells, strict=True)]
    ends = ["status", *(_shortened(row["status"]) for row in rows)]
    return [
        "  ".join([*_aligned(line, widths), end])
        for line, end in zip([heads, *cells], ends, strict=True)
    ]


def _aligned(line: Sequence[str], widths: Sequence[int]) -> list[str]:
    """Words to the left, numbers to the right."""
    cells = list(zip(line, widths, strict=True))
    return [c.ljust(w) for c, w in cells[:2]] + [c.rjust(w) for c, w in cells[2:]]


def _figures(row: Mapping[str, Any]) -> list[str]:
    return [
        "-" if row[name] is None else format(row[name] * factor, form)
        for name, _, factor, form in SHOWN
    ]


def _shortened(status: str) -> str:
    return status if len(status) <= STATUS_WIDTH else f"{status[: STATUS_WIDTH - 3]}..."
