"""``fenics-ehd study``, ``sweep``, ``report`` and ``sensitivity``: many runs of one scene.

Imports inside functions: ``--help`` must work without runs and pictures, and quickly.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import require_kept, require_made_by
from fenics_ehd.base.renamed import renamed_message
from fenics_ehd.cli.options import (
    FOLDER,
    Real,
    aligned,
    answer,
    echo,
    flag,
    json_option,
    output_option,
    warn_of,
    workers_option,
)

if TYPE_CHECKING:  # the import is slow, and --help must be fast
    from fenics_ehd.analysis.sensitivity import Objective
    from fenics_ehd.study.sensitivity import ParameterPath, SceneSensitivity

#: Largest number of characters of a status in a printed table.
STATUS_WIDTH = 60

#: Columns of a printed table: column, heading, factor, format.
Shown = Sequence[tuple[str, str, float, str]]


def table_lines(names: Sequence[str], rows: Sequence[Mapping[str, Any]], shown: Shown) -> list[str]:
    """Rows of a printed table: names of the case, figures in printed units, status."""
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


@click.command()
@click.argument("directory", type=FOLDER)
def report(directory: str) -> None:
    """Write report.html, report.md and figures/ of the study in DIRECTORY.

    'study' does so at its end; this also reports a study that still runs or was stopped.
    """
    from fenics_ehd.study.report.write import write_report

    echo(write_report(directory))


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
@flag("--quick", "A small selection, a few minutes on two cores.")
@click.option(
    "--start",
    type=Real(min=0),
    help="Time from which on errors count [s] [default: 2 % of the simulated time, 0 of a cycle].",
)
@workers_option
@click.option("--report/--no-report", default=True, show_default=True, help="Write the report.")
@flag("--overwrite", "Run everything anew.")
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
    from fenics_ehd.scenes.scene import as_stored, input_files
    from fenics_ehd.study.compare import MADE, StudyFolder, run_study
    from fenics_ehd.study.plan import REFERENCE, make_study
    from fenics_ehd.study.pool import FailedCasesError, open_pool
    from fenics_ehd.study.report.write import write_report
    from fenics_ehd.study.worker import COMPLETE

    target = Path(directory or Path("results") / f"{Path(scene).stem}-study")
    require_made_by(target, StudyFolder.command)
    require_kept(target, input_files(scene, as_stored(scene)), MADE)
    with open_pool(workers) as pool:
        plan = make_study(scene, quick=quick, start=start)
        with StudyFolder(target, plan, overwrite=overwrite) as folder:
            rows = run_study(folder, pool)
    status = next(row["status"] for row in rows if row["run"] == REFERENCE)
    lines = table_lines(["group", "run", "joint"], rows, SHOWN)
    lines.append(f"rows in {target / 'table.csv'}, runs in {target / 'runs'}")
    if report and status == COMPLETE:
        lines.append(f"report in {write_report(target)}")
    summary = {"scene": plan.scene.name, "directory": str(target), "rows": rows}
    answer(summary, "\n".join(lines), as_json)
    if status != COMPLETE:
        raise FailedCasesError(f"the reference is not complete, nothing was compared: {status}")


#: Columns of the printed table, of a joint and of the run: figure, heading, factor, format.
JOINT_SHOWN = (
    ("max_pressure_Pa", "p [MPa]", 1e-6, ".3f"),
    ("min_film_thickness_m", "h [um]", 1e6, ".4f"),
)
SWEEP_SHOWN = (("steps", "steps", 1, "d"), ("wall_time_s", "time [s]", 1, ".2f"))


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
@flag("--keep", "Keep history and summary of each case, runs/0001 ...")
@flag("--resume", "Insist on rows of a former attempt to go on from.")
@flag("--overwrite", "Begin anew, and replace the rows of the folder.")
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
    from fenics_ehd.scenes.scene import as_stored, input_files
    from fenics_ehd.study.pool import FailedCasesError, open_pool
    from fenics_ehd.study.sweep import OWN, SweepFolder, make_sweep, run_sweep
    from fenics_ehd.study.worker import COMPLETE

    if resume and overwrite:
        raise SettingsError("--resume and --overwrite exclude each other")
    target = Path(directory or Path("results") / f"{Path(scene).stem}-sweep")
    require_made_by(target, SweepFolder.command)
    require_kept(target, input_files(scene, as_stored(scene)), OWN)
    with open_pool(workers) as pool:
        plan = make_sweep(scene, assignments)
        with SweepFolder(target, plan, resume=resume, overwrite=overwrite) as folder:
            rows = run_sweep(folder, pool, keep=keep)
    failures = sum(row["status"] != COMPLETE for row in rows)
    of_joints = [
        (f"{joint}.{name}", f"{joint} {heading}", factor, form)
        for joint in plan.joints
        for name, heading, factor, form in JOINT_SHOWN
    ]
    lines = table_lines(["case", *plan.keys], rows, [*of_joints, *SWEEP_SHOWN])
    lines.append(f"rows in {folder.table}")
    summary = {"scene": plan.scene, "keys": plan.keys, "cases": len(rows), "failed": failures}
    summary |= {"table": str(folder.table), "rows": rows}
    answer(summary, "\n".join(lines), as_json)
    if failures:
        raise FailedCasesError(
            f"{failures} of {len(rows)} cases failed, see status in {folder.table}"
        )


#: Methods of a derivative: with the reduced bodies of the run, or with a body reduced again.
METHODS = "differences in the same steps", "differences in the same steps, reduced anew"


@click.command()
@click.argument("scene")
@click.option(
    "--of",
    "quantities",
    multiple=True,
    required=True,
    metavar="JOINT.QUANTITY",
    help="Extreme or mean over the cycle: big_end.min_film_thickness, big_end.max_pressure, "
    "big_end.mean_friction_power, big_end.max_force_x. Repeatable.",
)
@click.option(
    "--to",
    "keys",
    multiple=True,
    required=True,
    metavar="KEY",
    help="Number of the scene, joints.big_end.clearance or its end; of a pair, "
    "forces.load.force.x. Repeatable.",
)
@click.option(
    "--finer-film/--no-finer-film",
    "finer",
    default=True,
    help="Whether each is found on finer films, too, and its change printed: most of the time.",
)
@json_option
def sensitivity(
    scene: str, quantities: tuple[str, ...], keys: tuple[str, ...], finer: bool, as_json: bool
) -> None:
    """Run SCENE, and print derivatives of its results along its parameters.

    By differences of the run with each number changed by 1 % to either side, in the same steps.
    """
    from fenics_ehd.scenes.scene import as_stored
    from fenics_ehd.study.sensitivity import scene_sensitivity

    settings = as_stored(scene)
    names = [_with_joint(name, tuple(settings.films)) for name in quantities]
    result = scene_sensitivity(settings, names, keys, finer=finer)
    answer(_document(scene, result), _table(scene, result), as_json)


def _with_joint(name: str, joints: Sequence[str]) -> str:
    """A quantity with the name of its joint; of the only joint a bare name is accepted."""
    if len(joints) != 1 or name.partition(".")[0] in joints:
        return name
    full = f"{joints[0]}.{name}"
    warn_of([renamed_message(f"--of {name}", f"--of {full}")])
    return full


def _document(scene: str, found: SceneSensitivity) -> dict[str, Any]:
    return {
        "scene": scene,
        "quantities": {
            f"{objective.joint}.{objective.name}": {
                "value": found.values[objective],
                "along": {
                    parameter.key: {
                        "at": parameter.value,
                        "derivative": found.derivatives[objective, parameter.key],
                        "units": _units(objective, parameter),
                        "elasticity": found.elasticity(objective, parameter),
                        "on_finer_film": found.finer.get((objective, parameter.key)),
                        "method": METHODS[parameter.key in found.reduced],
                    }
                    for parameter in found.parameters
                },
            }
            for objective in found.objectives
        },
        "processor_time_s": dict(found.seconds),
    }


def _units(objective: Objective, parameter: ParameterPath) -> str:
    """Unit of a derivative, ``Pa/(rad/s)``."""
    from fenics_ehd.base.columns import split_unit

    unit = split_unit(objective.column)[1]
    along = parameter.unit or "1"
    return f"{unit}/({along})" if re.search("[ /]", along) else f"{unit}/{along}"


def _finer(found: SceneSensitivity, objective: Objective, parameter: ParameterPath) -> str:
    """Change of a derivative on a finer film as text; empty if it is unknown."""
    slope = found.derivatives.get((objective, parameter.key))
    fine = found.finer.get((objective, parameter.key))
    return f"{100 * (fine / slope - 1):+.2g} % on a finer film, " if fine and slope else ""


def _table(scene: str, found: SceneSensitivity) -> str:
    width = max(len(parameter.key) for parameter in found.parameters)
    lines = [f"{scene}: derivatives d q / d p, elasticities d ln q / d ln p"]
    for objective in found.objectives:
        lines.append(f"  {objective.joint}.{objective.name} = {found.values[objective]:.6g}")
        for parameter in found.parameters:
            elasticity = found.elasticity(objective, parameter)
            relative = "        -" if elasticity is None else f"{elasticity:9.4f}"
            lines.append(
                f"    {parameter.key:{width}} = {parameter.value:<12.6g} "
                f"{found.derivatives[objective, parameter.key]:12.5g} "
                f"{_units(objective, parameter):12} "
                f"{relative}  {_finer(found, objective, parameter)}"
                f"{METHODS[parameter.key in found.reduced]}"
            )
    seconds = ", ".join(f"{name} {value:.1f} s" for name, value in found.seconds.items() if value)
    return "\n".join([*lines, f"  time: {seconds}"])
