"""``fenics-ehd sweep``: its options, its progress, its table, its JSON."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:  # slow to import, and --help does without
    from tqdm import tqdm

    from fenics_ehd.sweeps.plan import Plan
    from fenics_ehd.sweeps.pool import Pool
    from fenics_ehd.sweeps.table import SweepTable

#: Characters of a status in the printed table.
STATUS_WIDTH = 60

#: Columns of the printed table: figure, heading, factor, format.
SHOWN = (
    ("max_pressure_Pa", "p [MPa]", 1e-6, ".3f"),
    ("min_film_thickness_m", "h [um]", 1e6, ".4f"),
    ("steps", "steps", 1, "d"),
    ("wall_time_s", "time [s]", 1, ".2f"),
)


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
@click.option(
    "-o",
    "--output",
    "directory",
    type=click.Path(file_okay=False),
    help="Folder for sweep.csv [default: results/SCENE-sweep].",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes [default: the cores this one may use]; under mpirun the ranks work.",
)
@click.option("--keep", is_flag=True, help="Keep history and summary of each case, runs/0001 ...")
@click.option("--resume", is_flag=True, help="Insist on rows of a former attempt to go on from.")
@click.option("--overwrite", is_flag=True, help="Begin anew, whatever rows the folder holds.")
@click.option(
    "--json", "as_json", is_flag=True, help="Print results as JSON on stdout, nothing else there."
)
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
    from mpi4py import MPI

    from fenics_ehd.errors import SettingsError
    from fenics_ehd.sweeps.plan import make_plan
    from fenics_ehd.sweeps.pool import open_pool
    from fenics_ehd.sweeps.table import SweepTable

    if resume and overwrite:
        raise SettingsError("--resume and --overwrite exclude each other")
    target = Path(directory or Path("results") / f"{Path(scene).stem}-sweep")
    with open_pool(MPI.COMM_WORLD, workers) as pool:
        if pool is None:
            return
        plan = make_plan(scene, assignments)
        with SweepTable(target, plan, resume=resume, overwrite=overwrite) as table:
            _run(plan, table, pool, keep)
            rows = table.rows()
    _conclude(plan, table.path, rows, as_json)


def _run(plan: Plan, table: SweepTable, pool: Pool, keep: bool) -> None:
    """Run what is missing, with a bar; Ctrl-C ends it between two rows."""
    from fenics_ehd.interrupt import interrupt_between_steps
    from fenics_ehd.sweeps.sweep import run_sweep

    failures = 0
    with _bar(plan, table) as bar, interrupt_between_steps() as check:

        def progress(status: str) -> None:
            nonlocal failures
            failures += status != "complete"
            bar.set_postfix_str(f"{failures} failed", refresh=False)
            bar.update()

        run_sweep(plan, table, pool, keep=keep, check=check, progress=progress)


def _bar(plan: Plan, table: SweepTable) -> tqdm:
    from tqdm import tqdm

    return tqdm(
        total=len(plan.cases),
        initial=sum(map(table.complete, plan.cases)),
        unit="case",
        file=sys.stderr,
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
    )


def _conclude(plan: Plan, path: Path, rows: Sequence[Mapping[str, Any]], as_json: bool) -> None:
    """Print the table.

    Raises
    ------
    FailedCasesError
        Some cases are not complete.
    """
    from fenics_ehd.output import to_json
    from fenics_ehd.sweeps.errors import FailedCasesError

    failures = sum(row["status"] != "complete" for row in rows)
    if as_json:
        result = {"scene": plan.scene, "keys": plan.keys, "cases": len(rows), "failed": failures}
        click.echo(to_json(result | {"table": str(path), "rows": rows}))
    else:
        click.echo("\n".join([*_lines(plan.keys, rows), f"rows in {path}"]))
    if failures:
        raise FailedCasesError(f"{failures} of {len(rows)} cases failed, see status in {path}")


def _lines(keys: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The rows for a reader: aligned, with the units of an engineer."""
    heads = ["case", *keys, *(heading for _, heading, _, _ in SHOWN)]
    cells = [
        [str(row["case"]), *(_value(row[key]) for key in keys), *_figures(row)] for row in rows
    ]
    widths = [max(map(len, column)) for column in zip(heads, *cells, strict=True)]
    ends = ["status", *(_shortened(row["status"]) for row in rows)]
    return [
        "  ".join([*(cell.rjust(width) for cell, width in zip(line, widths, strict=True)), end])
        for line, end in zip([heads, *cells], ends, strict=True)
    ]


def _figures(row: Mapping[str, Any]) -> list[str]:
    return [
        "-" if row[name] is None else format(row[name] * factor, form)
        for name, _, factor, form in SHOWN
    ]


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _shortened(status: str) -> str:
    return status if len(status) <= STATUS_WIDTH else f"{status[: STATUS_WIDTH - 3]}..."
