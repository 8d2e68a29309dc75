"""``fenics-ehd study``: its options, its progress, its table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.interrupt import interrupt_between_steps
from fenics_ehd.cli.cases import case_bar, table_lines
from fenics_ehd.cli.options import json_option, output_option, workers_option

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.study.folder import StudyFolder
    from fenics_ehd.study.plan import Study
    from fenics_ehd.study.pool import ProcessPool

#: Columns of the printed table: column, heading, factor, format.
SHOWN = (
    ("coordinates", "modes", 1, "d"),
    ("pressure_error_max", "p err [%]", 100, ".3g"),
    ("film_error_max", "h err [%]", 100, ".3g"),
    ("online_s", "time [s]", 1, ".1f"),
    ("steps", "steps", 1, "d"),
)


@click.command()
@click.argument("scene")
@output_option("directory", "Folder for tables, runs and report [default: results/SCENE-study].")
@click.option("--quick", is_flag=True, help="A small selection, a few minutes on two cores.")
@click.option(
    "--start",
    type=click.FloatRange(min=0),
    help="Time from which on errors count [s] [default: 2 % of the simulated time, 0 of a cycle].",
)
@workers_option
@click.option("--report/--no-report", default=True, show_default=True, help="Write the report.")
@click.option("--overwrite", is_flag=True, help="Run everything anew.")
@json_option
def study(
    scene: str,
    directory: str | None,
    quick: bool,
    start: float | None,
    workers: int | None,
    report: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Compare all reduction methods on SCENE, any scene with a flexible body and a film in it.

    Error against run time, over numbers of modes, step tolerances and film meshes, relative to
    the full interface. Runs that are complete are not run again.
    """
    from fenics_ehd.study.folder import StudyFolder
    from fenics_ehd.study.plan import make_study
    from fenics_ehd.study.pool import open_pool

    with open_pool(workers) as pool:
        plan = make_study(scene, quick=quick, start=start)
        target = Path(directory or Path("results") / f"{Path(scene).stem}-study")
        with StudyFolder(target, plan, overwrite=overwrite) as folder:
            rows = _run(folder, pool)
    _conclude(plan, target, rows, report, as_json)


def _run(folder: StudyFolder, pool: ProcessPool) -> list[dict[str, Any]]:
    """Run what is missing, with a bar; Ctrl-C ends it between two runs."""
    from fenics_ehd.study.run import run_study

    with case_bar(len(folder.study.cases)) as ended, interrupt_between_steps() as check:
        return run_study(folder, pool, check=check, progress=ended)


def _conclude(
    plan: Study, directory: Path, rows: Sequence[Mapping[str, Any]], report: bool, as_json: bool
) -> None:
    """Write the report, print the table.

    Raises
    ------
    FailedCasesError
        The reference is not complete: nothing could be compared.
    """
    from fenics_ehd.base.output import to_json
    from fenics_ehd.study.outcome import COMPLETE, FailedCasesError
    from fenics_ehd.study.plan import REFERENCE

    status = next(row["status"] for row in rows if row["run"] == REFERENCE)
    written = _report(directory) if report and status == COMPLETE else None
    if as_json:
        found = {"scene": plan.scene.name, "directory": str(directory)}
        click.echo(to_json(found | {"rows": rows}))
    else:
        names = ["group", "run", *(["joint"] if len(plan.joints) > 1 else [])]
        click.echo("\n".join(table_lines(names, rows, SHOWN)))
        click.echo(f"rows in {directory / 'table.csv'}, runs in {directory / 'runs'}")
        if written:
            click.echo(f"report in {written}")
    if status != COMPLETE:
        raise FailedCasesError(f"the reference is not complete, nothing was compared: {status}")


def _report(directory: Path) -> Path:
    from fenics_ehd.study.report import write_report

    return write_report(directory)
