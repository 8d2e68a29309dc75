"""``fenics-ehd sweep``: its options, its progress, its table, its JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.interrupt import interrupt_between_steps
from fenics_ehd.cli.cases import case_bar, table_lines
from fenics_ehd.cli.options import json_option, output_option, workers_option

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.study.pool import ProcessPool
    from fenics_ehd.study.sweep import Sweep
    from fenics_ehd.study.sweep_table import SweepTable

#: Columns of the printed table: figure, heading, factor, format; those of a joint, and of the run.
JOINT_SHOWN = (
    ("max_pressure_Pa", "p [MPa]", 1e-6, ".3f"),
    ("min_film_thickness_m", "h [um]", 1e6, ".4f"),
)
SHOWN = (("steps", "steps", 1, "d"), ("wall_time_s", "time [s]", 1, ".2f"))


@click.command()
@click.argument("scene")
@click.option(
    "--set",
    "assignments",
    multiple=True,
    required=True,
    metavar="KEY=VALUES",
    help="Values of a key, section.key or only key: 1e-5,2e-5 or first:last:count or "
    "first:last:count:log, words as m1,m3, lists as '[20,5];[40,10]'. Repeatable.",
)
@output_option("directory", "Folder for sweep.csv [default: results/SCENE-sweep].")
@workers_option
@click.option("--keep", is_flag=True, help="Keep history and summary of each case, runs/0001 ...")
@click.option("--resume", is_flag=True, help="Insist on rows of a former attempt to go on from.")
@click.option("--overwrite", is_flag=True, help="Begin anew, whatever rows the folder holds.")
@json_option
def sweep(
    scene: str,
    assignments: tuple[str, ...],
    directory: str | None,
    workers: int | None,
    keep: bool,
    resume: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Run SCENE for the product of the given values, one row of DIR/sweep.csv for each case.

    Rows of a former attempt that are complete are not run again. A case that fails is a row as
    well and ends nothing.
    """
    from fenics_ehd.study.pool import open_pool
    from fenics_ehd.study.sweep import make_sweep
    from fenics_ehd.study.sweep_table import SweepTable

    if resume and overwrite:
        raise SettingsError("--resume and --overwrite exclude each other")
    target = Path(directory or Path("results") / f"{Path(scene).stem}-sweep")
    with open_pool(workers) as pool:
        plan = make_sweep(scene, assignments)
        with SweepTable(target, plan, resume=resume, overwrite=overwrite) as table:
            _run(table, pool, keep)
            rows = table.rows()
    _conclude(plan, table.path, rows, as_json)


def _run(table: SweepTable, pool: ProcessPool, keep: bool) -> None:
    """Run what is missing, with a bar; Ctrl-C ends it between two rows."""
    from fenics_ehd.study.sweep_run import run_sweep

    cases = table.sweep.cases
    done = sum(map(table.complete, cases))
    with case_bar(len(cases), done) as ended, interrupt_between_steps() as check:
        run_sweep(table, pool, keep=keep, check=check, progress=ended)


def _conclude(plan: Sweep, path: Path, rows: Sequence[Mapping[str, Any]], as_json: bool) -> None:
    """Print the table.

    Raises
    ------
    FailedCasesError
        Some cases are not complete.
    """
    from fenics_ehd.base.output import to_json
    from fenics_ehd.study.outcome import FailedCasesError

    failures = sum(row["status"] != "complete" for row in rows)
    if as_json:
        result = {"scene": plan.scene, "keys": plan.keys, "cases": len(rows), "failed": failures}
        click.echo(to_json(result | {"table": str(path), "rows": rows}))
    else:
        lines = table_lines(["case", *plan.keys], rows, [*_of_joints(plan), *SHOWN])
        click.echo("\n".join([*lines, f"rows in {path}"]))
    if failures:
        raise FailedCasesError(f"{failures} of {len(rows)} cases failed, see status in {path}")


def _of_joints(plan: Sweep) -> list[tuple[str, str, float, str]]:
    """Columns of lubricated joints, which bear their names if there are several."""
    from fenics_ehd.base.columns import joint_prefix

    prefixes = [joint_prefix(joint, plan.joints) for joint in plan.joints]
    return [
        (prefix + name, prefix.replace(".", " ") + heading, factor, form)
        for prefix in prefixes
        for name, heading, factor, form in JOINT_SHOWN
    ]
