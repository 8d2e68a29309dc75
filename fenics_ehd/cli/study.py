"""``fenics-ehd study``, ``sweep``, ``report`` and ``sensitivity``: many runs of one scene.

Imports inside functions: ``--help`` must work without runs and pictures, and quickly.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import made_by, require_kept, require_made_by
from fenics_ehd.base.needs import no_effect
from fenics_ehd.base.progress import shown_progress
from fenics_ehd.base.renamed import renamed_message
from fenics_ehd.cli.options import (
    FOLDER,
    Real,
    aligned,
    answer,
    echo,
    flag,
    json_option,
    no_cache_option,
    output_option,
    question,
    say_reducing,
    warn_of,
    workers_option,
)

if TYPE_CHECKING:  # the import is slow, and --help must be fast
    from fenics_ehd.analysis.sensitivity import Objective
    from fenics_ehd.study.sensitivity import ParameterPath, SceneSensitivity

#: Largest number of characters of a status in a printed table; longer ones are cut.
STATUS_WIDTH = 60

#: Type for columns of a printed table: each has key, heading, factor to the printed unit, format.
Shown = Sequence[tuple[str, str, float, str]]


def table_lines(names: Sequence[str], rows: Sequence[Mapping[str, Any]], shown: Shown) -> list[str]:
    """Lines of a printed table of cases: swept keys `names`, results in printed units, status."""
    heads = [*names, *(heading for _, heading, _, _ in shown), "status"]
    cells = [
        [*(_value(row[name]) for name in names), *_figures(row, shown), _shortened(row["status"])]
        for row in rows
    ]
    return aligned([heads, *cells], words=(len(heads) - 1,))


def _figures(row: Mapping[str, Any], shown: Shown) -> list[str]:
    return [
        "-" if row[name] is None else format(row[name] * factor, form)
        for name, _, factor, form in shown
    ]


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _shortened(status: str) -> str:
    return status if len(status) <= STATUS_WIDTH else f"{status[: STATUS_WIDTH - 3]}..."


@question("Which page do I hand on, from a run or a study?")
@click.command()
@click.argument("directory", type=FOLDER)
def report(directory: str) -> None:
    """Write the report of the run or study, or of the paper's figures, in DIRECTORY.

    The report of a run is one page, report.html, which prints on two sheets: all figures with their
    estimated errors, warnings, the scene in words, the pictures that decide, and how to repeat the
    run. That of a study is report.html, report.md and figures/; 'study' writes it at its end. A run
    or study that is in progress or was stopped is reported as far as it is complete. In the folder
    of 'paper', all figures whose runs have ended are drawn again, with the page report.html.
    """
    from fenics_ehd.multibody.history import FIELDS_NAME

    if (Path(directory) / FIELDS_NAME).is_file():
        from fenics_ehd.study.report.run_page import write_run_page

        echo(write_run_page(directory))
    elif made_by(Path(directory)) == "paper":
        from fenics_ehd.study.report.paper_page import PAGE_NAME, write_paper_page

        write_paper_page(directory)
        echo(Path(directory) / PAGE_NAME)
    else:
        from fenics_ehd.study.report.study_data import require_study

        # Before Matplotlib is imported, which may print a line of its own.
        require_study(directory)
        from fenics_ehd.study.report.write import write_report

        echo(write_report(directory))


#: Printed columns of a study: key, heading, factor to the printed unit, format.
SHOWN = (
    ("coordinates", "modes", 1, "d"),
    ("pressure_error_max", "p err [%]", 100, ".3g"),
    ("film_error_max", "h err [%]", 100, ".3g"),
    ("online_s", "time [s]", 1, ".1f"),
    ("steps", "steps", 1, "d"),
)


@question("Which reduction method has which error, at which cost?")
@click.command()
@click.argument("scene")
@output_option("directory", "Folder for tables, runs and report [default: results/SCENE-study].")
@flag("--quick", "Run a small selection of cases: a few minutes on two cores.")
@click.option(
    "--start",
    type=Real(min=0),
    help="Time after which errors are evaluated [s] [default: 2 % of the simulated time; for a "
    "periodic solution 0].",
)
@workers_option
@click.option(
    "--report/--no-report", default=True, show_default=True, help="Write the report at the end."
)
@flag("--overwrite", "Discard former results, and run all cases.")
@no_cache_option
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
    """Compare all reduction methods on SCENE, which needs a flexible body with a lubricated joint.

    The study gives errors and run times for several numbers of modes, step tolerances and film
    meshes. Errors are differences from a reduction with the full interface, which has a static mode
    for every pressure node. Cases that are complete are not run again.
    """
    from fenics_ehd.multibody.verdict import COMPLETE
    from fenics_ehd.scenes.scene import as_stored, input_files
    from fenics_ehd.study.compare import MADE, StudyFolder, run_study
    from fenics_ehd.study.plan import REFERENCE, make_study
    from fenics_ehd.study.pool import FailedCasesError, open_pool
    from fenics_ehd.study.report.write import write_report

    target = Path(directory or Path("results") / f"{Path(scene).stem}-study")
    require_made_by(target, StudyFolder.command)
    require_kept(target, input_files(scene, as_stored(scene)), MADE)
    with open_pool(workers) as pool:
        plan = make_study(scene, quick=quick, start=start)
        with StudyFolder(target, plan, overwrite=overwrite) as folder:
            rows = run_study(folder, pool, progress=shown_progress(logs=True))
    status = next(row["status"] for row in rows if row["run"] == REFERENCE)
    lines = table_lines(["group", "run", "joint"], rows, SHOWN)
    lines.append(f"rows in {target / 'table.csv'}, runs in {target / 'runs'}")
    if report and status == COMPLETE:
        lines.append(f"report in {write_report(target)}")
    summary = {"scene": plan.scene.name, "directory": str(target), "rows": rows}
    answer(summary, "\n".join(lines), as_json)
    if status != COMPLETE:
        raise FailedCasesError(f"the reference run is not complete, nothing is compared: {status}")


#: Printed columns of a sweep, for each joint and for the run: key, heading, factor, format.
JOINT_SHOWN = (
    ("max_pressure_Pa", "p [MPa]", 1e-6, ".3f"),
    ("min_film_thickness_m", "h [um]", 1e6, ".4f"),
)
SWEEP_SHOWN = (("steps", "steps", 1, "d"), ("wall_time_s", "time [s]", 1, ".2f"))


@question("How does a result depend on one or several settings?")
@click.command()
@click.argument("sources", nargs=-1, metavar="SCENE")
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="KEY=VALUES",
    help="Values of a setting; KEY is section.key, or key if this is unique. VALUES are "
    "1e-5,2e-5, or first:last:count, or first:last:count:log, or words, m1,m3, or lists, "
    "'[20,5];[40,10]'. Repeatable.",
)
@flag("--zip", "Use the lists together, value by value, instead of all combinations.")
@click.option(
    "--cases",
    "table",
    metavar="FILE.csv",
    help="Table of cases: a column for each key, a line for each case. Values are written as for "
    "--set; a heading may have a unit, 'clearance [um]'.",
)
@output_option("directory", "Folder for sweep.csv [default: results/SCENE-sweep].")
@workers_option
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run the cases on the workers of a Dask scheduler, tcp://HOST:8786, or start one with "
    "workers on this machine, local:4.",
)
@click.option(
    "--part",
    metavar="K/N",
    help="Run only part K of N of the cases, for a job array. --merge joins the parts.",
)
@flag("--merge", "Join the folders of parts, sweep --merge A B ... -o DIR, and run nothing.")
@flag("--keep", "Keep the history and summary of each case in the folders runs/0001 ...")
@flag("--resume", "Continue the sweep in the folder; fail if the folder has no sweep.")
@flag("--overwrite", "Discard the rows in the folder, and run all cases.")
@no_cache_option
@json_option
def sweep(
    sources: tuple[str, ...],
    directory: str | None,
    merge: bool,
    as_json: bool,
    overwrite: bool,
    **options: Any,
) -> None:
    """Run SCENE for many combinations of values, and write a row of sweep.csv for each.

    Rows that are already complete are not computed again. If a case fails, its row has the reason,
    and the other cases are run.
    """
    if merge:
        _merge(sources, directory, options, overwrite=overwrite, as_json=as_json)
        return
    if len(sources) != 1:
        named = f" ({', '.join(sources)})" if sources else ""
        raise SettingsError(
            f"sweep runs one SCENE, but there are {len(sources)}{named}: give the name of a "
            "shipped scene or the path of a scene file; --merge joins folders"
        )
    _sweep(sources[0], directory, as_json=as_json, overwrite=overwrite, **options)


def _sweep(
    scene: str,
    directory: str | None,
    *,
    assignments: tuple[str, ...],
    zip: bool,
    table: str | None,
    workers: int | None,
    scheduler: str | None,
    part: str | None,
    keep: bool,
    resume: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Run a sweep, and print its table; the parameters are the options of the command."""
    from fenics_ehd.scenes.scene import as_stored, input_files
    from fenics_ehd.study.pool import open_pool
    from fenics_ehd.study.scheduler import scheduled
    from fenics_ehd.study.sweep import OWN, Part, SweepFolder, make_sweep, run_sweep

    if resume and overwrite:
        raise SettingsError("--resume and --overwrite exclude each other")
    if scheduler is not None and workers is not None:
        raise SettingsError(
            "--scheduler and --workers exclude each other: the workers are those of the scheduler"
        )
    if not assignments and table is None:
        raise SettingsError(
            "no values to run: give --set KEY=VALUES, for instance --set clearance=1e-5,2e-5, or "
            "--cases FILE.csv"
        )
    wanted = Part() if part is None else Part.read(part)
    target = Path(directory or Path("results") / f"{Path(scene).stem}-sweep")
    require_made_by(target, SweepFolder.command)
    inputs = input_files(scene, as_stored(scene)) + ([] if table is None else [Path(table)])
    require_kept(target, inputs, OWN)
    plan = make_sweep(scene, assignments, zipped=zip, table=table, part=wanted)
    pool = open_pool(workers) if scheduler is None else scheduled(scheduler)
    with pool as executor, SweepFolder(target, plan, resume=resume, overwrite=overwrite) as folder:
        rows = run_sweep(folder, executor, keep=keep, progress=shown_progress(logs=True))
    note = ""
    if plan.part.of > 1:
        note = (
            f"this is part {plan.part}; when all parts have ended, join their folders: fenics-ehd "
            f"sweep --merge {shlex.quote(str(target))} ... -o DIR"
        )
    _answer_sweep(plan.scene, plan.keys, plan.joints, rows, folder.table, as_json, note=note)


def _merge(
    sources: tuple[str, ...],
    directory: str | None,
    options: Mapping[str, Any],
    *,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Merge the folders of the parts of a sweep, and print the table of all cases.

    `options` are the options that have no effect.
    """
    from fenics_ehd.study.merged_sweep import merge_sweeps
    from fenics_ehd.study.pool import FailedCasesError

    names = {"assignments": "set", "table": "cases"}
    idle = [f"--{names.get(name, name)}" for name, value in options.items() if value]
    if idle:
        raise no_effect(idle[0], True, "with --merge")
    if not sources:
        raise SettingsError(
            "--merge needs the folders of the parts: sweep --merge parts/1 parts/2 -o DIR"
        )
    if directory is None:
        raise SettingsError("--merge needs -o DIR, the folder of the merged sweep")
    merged = merge_sweeps(sources, directory, overwrite=overwrite)
    scene = str(merged.table.parent)
    _answer_sweep(
        scene, merged.keys, merged.joints, merged.rows, merged.table, as_json, merged.missing
    )
    if merged.missing:
        raise FailedCasesError(
            f"{len(merged.missing)} of {len(merged.missing) + len(merged.rows)} cases have no row, "
            f"the first is case {merged.missing[0]}: the sweep without --part, with -o "
            f"{directory}, runs them"
        )


def _answer_sweep(
    scene: str,
    keys: Sequence[str],
    joints: Sequence[str],
    rows: Sequence[Mapping[str, Any]],
    table: Path,
    as_json: bool,
    missing: Sequence[int] = (),
    note: str = "",
) -> None:
    """Print the rows of a sweep, and a note at the end.

    Raises
    ------
    FailedCasesError
        Some cases failed.
    """
    from fenics_ehd.multibody.verdict import COMPLETE
    from fenics_ehd.study.pool import FailedCasesError

    failures = sum(row["status"] != COMPLETE for row in rows)
    of_joints = [
        (f"{joint}.{name}", f"{joint} {heading}", factor, form)
        for joint in joints
        for name, heading, factor, form in JOINT_SHOWN
    ]
    lines = table_lines(["case", *keys], rows, [*of_joints, *SWEEP_SHOWN])
    lines.append(f"rows in {table}")
    lines += [note] if note else []
    summary = {"scene": scene, "keys": keys, "cases": len(rows), "failed": failures}
    summary |= {"missing": list(missing)} if missing else {}
    summary |= {"table": str(table), "rows": rows}
    answer(summary, "\n".join(lines), as_json)
    if failures:
        raise FailedCasesError(
            f"{failures} of {len(rows)} cases failed: see the column status of {table}"
        )


#: Texts of the method of a derivative: with the bodies of the run, or with bodies reduced anew.
METHODS = "differences in the same steps", "differences in the same steps, reduced anew"


@question("Which setting changes a result, and by how much?")
@click.command()
@click.argument("scene")
@click.option(
    "--of",
    "quantities",
    multiple=True,
    required=True,
    metavar="JOINT.QUANTITY",
    help="Result of a joint: extreme or mean over the cycle, big_end.min_film_thickness, "
    "big_end.max_pressure, big_end.mean_friction_power, big_end.max_force_x. Repeatable.",
)
@click.option(
    "--to",
    "keys",
    multiple=True,
    required=True,
    metavar="KEY",
    help="Numeric setting of the scene, joints.big_end.clearance or its unique end, clearance; for "
    "a pair of numbers with its axis, forces.load.force.x. Repeatable.",
)
@click.option(
    "--finer-film/--no-finer-film",
    "finer",
    default=True,
    help="Whether derivatives are also computed on finer films, to print how much they change; "
    "this takes most of the time.",
)
@no_cache_option
@json_option
def sensitivity(
    scene: str, quantities: tuple[str, ...], keys: tuple[str, ...], finer: bool, as_json: bool
) -> None:
    """Run SCENE, and print derivatives of its results with respect to its settings.

    The derivatives are differences of runs in which a setting is larger or smaller by 1 %, with the
    time steps of the first run.
    """
    from fenics_ehd.scenes.scene import as_stored
    from fenics_ehd.study.sensitivity import scene_sensitivity

    settings = as_stored(scene)
    names = [_with_joint(name, tuple(settings.films)) for name in quantities]
    result = scene_sensitivity(settings, names, keys, finer=finer, announce=say_reducing)
    answer(_document(scene, result), _table(scene, result), as_json)


def _with_joint(name: str, joints: Sequence[str]) -> str:
    """Full name of a quantity, ``JOINT.QUANTITY``; the joint is added if the scene has only one."""
    if len(joints) != 1 or name.partition(".")[0] in joints:
        return name
    full = f"{joints[0]}.{name}"
    warn_of([renamed_message(f"--of {name}", f"--of {full}")])
    return full


def _document(scene: str, result: SceneSensitivity) -> dict[str, Any]:
    return {
        "scene": scene,
        "quantities": {
            f"{objective.joint}.{objective.name}": {
                "value": result.values[objective],
                "along": {
                    parameter.key: {
                        "at": parameter.value,
                        "derivative": result.derivatives[objective, parameter.key],
                        "units": _units(objective, parameter),
                        "elasticity": result.elasticity(objective, parameter),
                        "on_finer_film": result.finer.get((objective, parameter.key)),
                        "method": METHODS[parameter.key in result.reduced],
                    }
                    for parameter in result.parameters
                },
            }
            for objective in result.objectives
        },
        "processor_time_s": dict(result.seconds),
    }


def _units(objective: Objective, parameter: ParameterPath) -> str:
    """Unit of a derivative as text, ``Pa/(rad/s)``."""
    from fenics_ehd.base.columns import split_unit

    unit = split_unit(objective.column)[1]
    along = parameter.unit or "1"
    return f"{unit}/({along})" if re.search("[ /]", along) else f"{unit}/{along}"


def _finer(result: SceneSensitivity, objective: Objective, parameter: ParameterPath) -> str:
    """Relative change of a derivative on a finer film as text; empty if it is unknown."""
    slope = result.derivatives.get((objective, parameter.key))
    fine = result.finer.get((objective, parameter.key))
    return f"{100 * (fine / slope - 1):+.2g} % on a finer film, " if fine and slope else ""


def _table(scene: str, result: SceneSensitivity) -> str:
    width = max(len(parameter.key) for parameter in result.parameters)
    lines = [f"{scene}: derivatives d q / d p, elasticities d ln q / d ln p"]
    for objective in result.objectives:
        lines.append(f"  {objective.joint}.{objective.name} = {result.values[objective]:.6g}")
        for parameter in result.parameters:
            elasticity = result.elasticity(objective, parameter)
            relative = "        -" if elasticity is None else f"{elasticity:9.4f}"
            lines.append(
                f"    {parameter.key:{width}} = {parameter.value:<12.6g} "
                f"{result.derivatives[objective, parameter.key]:12.5g} "
                f"{_units(objective, parameter):12} "
                f"{relative}  {_finer(result, objective, parameter)}"
                f"{METHODS[parameter.key in result.reduced]}"
            )
    seconds = ", ".join(f"{name} {value:.1f} s" for name, value in result.seconds.items() if value)
    return "\n".join([*lines, f"  time: {seconds}"])
