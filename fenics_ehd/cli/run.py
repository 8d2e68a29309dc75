"""``fenics-ehd run``: run a scene or resume a run, and print a report of its results.

The report has the results of every joint over the cycle or run, the error budget, and, if an
accuracy was required, the search for settings that meet it.

Imports inside functions: pictures, ParaView and reductions are imported only by runs that need
them.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import SettingsError, VerificationError
from fenics_ehd.base.files import complete_result, require_kept, require_writable
from fenics_ehd.base.processes import require_alike
from fenics_ehd.base.progress import Progress, shown_progress
from fenics_ehd.base.settings import read_toml
from fenics_ehd.cli.options import aligned, answer, echo, say_reducing, warn_of
from fenics_ehd.multibody.cycle import CRANK, Cycle
from fenics_ehd.multibody.figures import figures_of
from fenics_ehd.multibody.trust import NOT_APPLICABLE, NOT_ESTIMATED
from fenics_ehd.results.recorded_run import (
    Checkpoint,
    RunFolder,
    first_rank_folder,
    load_run_state,
    written_by_run,
)
from fenics_ehd.scenes.accuracy import Search, search_of, start_search
from fenics_ehd.scenes.build import Machine, build
from fenics_ehd.scenes.run import run_accurately, stored_scene
from fenics_ehd.scenes.scene import (
    Scene,
    as_stored,
    changed,
    flexible,
    meshed,
    scene_text,
)

if TYPE_CHECKING:
    from fenics_ehd.results.paraview import PartFields


#: Printed names of the error components, by key.
COMPONENTS = {
    "basis": "basis",
    "film_mesh": "film mesh",
    "part_mesh": "part mesh",
    "step_size": "step size",
    "start": "start",
}
ROWS = {"max_pressure": "peak pressure", "min_film_thickness": "thinnest film"}

#: Explanation below the table of an error budget.
MEANING = (
    "  +-: estimated error of the value; over the {}: largest error of the curve, in per cent of\n"
    "  the peak pressure, or of the film thickness at that instant"
)


def share(value: float | str) -> str:
    """Text of a relative error in per cent; a word in place of an error is returned unchanged."""
    if isinstance(value, str):
        return "-" if value == NOT_APPLICABLE else value
    return f"{100 * value:.2g} %"


def total(errors: Mapping[str, Any]) -> str:
    """Text of the sum of the estimated error components, ``1.9 %``.

    If a component is not estimated, the text has the form ``> 0.5 %``.
    """
    lacking = isinstance(errors["total"], str) and not isinstance(errors["known"], str)
    return "> " * lacking + share(errors["known"])


def error_text(joint: Mapping[str, Any], quantity: str, value: float, unit: str) -> str:
    """Estimated error of a result as text; empty if the joint has no error budget.

    If the sign of most of the error is known, the text is ``+- 28 %, too high by about 13 MPa``.
    If components were not estimated, the text names them.
    """
    budget = joint.get("error_budget")
    if budget is None:
        return ""
    errors = budget[quantity]
    words = [f"+- {share(errors['known'])}"]
    lacking = [COMPONENTS[key] for key in COMPONENTS if errors[key] == NOT_ESTIMATED]
    if lacking and not isinstance(errors["known"], str):
        words.append(f"{' and '.join(lacking)} not included")
    elif not lacking and abs(errors["bias"]) > 0.5 * errors["known"]:
        way = "high" if errors["bias"] > 0 else "low"
        words.append(f"too {way} by about {abs(errors['bias']) * value:.2g} {unit}")
    return ", ".join([*words, ""]) if words[1:] else f"{words[0]} "


def budget_table(joints: Mapping[str, Mapping[str, Any]], summary: Mapping[str, Any]) -> list[str]:
    """Lines of all joints' error budgets: errors of extremes, and largest errors over the cycle."""
    known = {
        name: joint["error_budget"] for name, joint in joints.items() if "error_budget" in joint
    }
    if not known:
        return []
    header = ["estimated errors", *COMPONENTS.values(), "total"]
    rows = []
    for name, budget in known.items():
        largest = budget["largest_over_cycle"]
        for where, errors in (("", budget), (f", over the {_span(summary)}", largest)):
            for quantity, words in ROWS.items():
                values = [share(errors[quantity][key]) for key in COMPONENTS]
                rows.append([f"{name}: {words}{where}", *values, total(errors[quantity])])
    lines = [*aligned([header, *rows], indent="  "), MEANING.format(_span(summary))]
    lines += [
        f"  {keys} not estimated: {why}"
        for why, keys in _by_value(summary.get("error_budget_notes", {}))
    ]
    lines += [
        f"  {keys}: excludes {share(part)} of the time, where no step near the run's converged"
        for part, keys in _by_value(summary.get("error_budget_left_out", {}))
    ]
    return lines + list(_flexibility_lines(summary))


def _flexibility_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Lines on the flexibility error of each body that M4 reduced, and on the pressures used."""
    checked = summary.get("flexibility_errors", {})
    for name, verified in summary.get("verified_flexibility_errors", {}).items():
        start = f"  basis of {name}: its bores' displacement has an error of"
        if name in checked:
            yield f"{start} {share(checked[name])}, checked with pressures of this run"
        else:
            yield (
                f"{start} {share(verified)}, verified at its reduction; pressures of this run were "
                "not checked, because the complete part is not in memory"
            )


def _by_value(by_component: Mapping[str, Any]) -> list[tuple[Any, str]]:
    """Distinct values of a dictionary, each with the names of the error components that have it."""
    names: dict[Any, list[str]] = {}
    for key, value in by_component.items():
        names.setdefault(value, []).append(COMPONENTS[key])
    return [(value, " and ".join(keys)) for value, keys in names.items()]


def _span(summary: Mapping[str, Any]) -> str:
    """Word for the time span of the results: ``cycle``, or ``run`` if no cycle is complete."""
    cycle = Cycle.of_summary(summary)
    return "cycle" if cycle is None or cycle.complete or cycle.periodic else "run"


def _clock(summary: Mapping[str, Any]) -> str:
    """Word for the span from whose start times of extremes are counted: ``cycle`` or ``run``."""
    cycle = Cycle.of_summary(summary)
    return "cycle" if cycle is not None and cycle.periodic else "run"


def say_next(search: Search) -> None:
    """Print the largest error of the last run, and the settings that change for the next run.

    `search` is the search for settings that meet a required accuracy.
    """
    run = search.runs[-1]
    changes = ", ".join(f"{key} = {choice_text(value)}" for key, value in search.wanted.items())
    echo(
        f"accuracy: error {share(run['estimate'])}, {share(search.asked)} requested; "
        f"next run: {changes}",
        err=True,
    )


def choice_text(value: Any) -> str:
    """Text of a value that the search for an accuracy chose for a setting.

    The value is a pair of numbers of cells, a reduction, the parameters of a model, or a number.
    """
    if isinstance(value, list):
        return " x ".join(map(str, value))
    if isinstance(value, Mapping) and "method" in value:
        return f"{value['method']}, {value['vibration_modes']} modes"
    if isinstance(value, Mapping):
        around = [f"{cells:g}" for key, cells in value.items() if "cells_around" in key]
        return f"{' and '.join(around)} cells around"
    return f"{value:g}"


def accuracy_lines(summary: Mapping[str, Any]) -> list[str]:
    """Lines on the search for a required accuracy: settings and errors of each of its runs."""
    if "accuracy" not in summary:
        return []
    search = summary["accuracy"]
    runs = search["runs"]
    columns = ["pilot", *(f"run {k}" for k in range(1, len(runs)))]
    rows = [[f"accuracy, {share(search['asked'])} requested", *columns]]
    for key in runs[0]["chosen"] | runs[-1]["chosen"]:
        values = [run["chosen"].get(key) for run in runs]
        texts = ("as in scene" if value is None else choice_text(value) for value in values)
        rows.append([key, *texts])
    for key, words in COMPONENTS.items():
        if key in runs[0]["errors"]:
            values = [share(run["errors"].get(key, NOT_ESTIMATED)) for run in runs]
            rows.append([f"largest by {words}", *values])
    rows.append(["largest total", *(share(run["estimate"]) for run in runs)])
    rows.append(["processor time", *(f"{run['processor_time_s']:.1f} s" for run in runs)])
    lines = aligned(rows, indent="  ")
    if search["kept"]:
        lines.append(f"  not changed by the search: {', '.join(search['kept'])}")
    if not search["met"]:
        lines.append(f"  {summary['warnings'][-1]}")
    return lines


#: Basis error estimate over minimum film thickness; above it the estimate is reported as large.
LARGEST_ESTIMATE = 0.2


@dataclass(frozen=True)
class RunOptions:
    """Options of the command line for a new or resumed run.

    Attributes
    ----------
    plots
        Whether pictures are drawn.
    interval
        Time between two checkpoints [s].
    as_json
        Whether the summary is printed as JSON.
    multiplier
        Whether the largest Floquet multiplier of a periodic solution is computed.
    began
        Time at which the command began, by `perf_counter` [s].
    progress
        Progress of the command.
    """

    plots: bool
    interval: float
    as_json: bool
    multiplier: bool
    began: float = field(default_factory=perf_counter)
    progress: Progress = field(default_factory=partial(shown_progress, logs=True))


def run(
    scene: Scene,
    directory: Path,
    overwrite: bool,
    options: RunOptions,
    inputs: Collection[Path] = (),
) -> None:
    """Run a scene that was read from the files `inputs`.

    All ranks build the mechanism; the first rank alone integrates its motion.
    """
    if options.multiplier and not scene.time.periodic:
        raise SettingsError(
            f"--multiplier: scene {scene.name} has no periodic solution: set time.periodic = true"
        )
    warn_of(scene.warnings)
    require_writable(directory)
    require_kept(directory, inputs, written_by_run(flexible(scene)))
    scene, search = start_search(scene)
    require_alike("scene", scene_text(scene))
    with first_rank_folder(directory, overwrite, flexible(scene)) as folder:
        built = build(scene, MPI.COMM_WORLD, announce=say_reducing, progress=options.progress)
        warn_of(built.warnings)
        parts = _gathered_parts(built) if scene.output.paraview else {}
        # The time integration runs on the first rank only.
        if folder is not None:
            _finish(scene, built, folder, options, search, parts=parts)


def changed_scene(
    name: str, body: str | None, method: str | None, output: Mapping[str, Any]
) -> Scene:
    """Read a scene, and change it by options of the command line.

    Parameters
    ----------
    name
        Name of a shipped scene, or path of a scene file.
    body
        Path of a reduced body that replaces the scene's flexible body, or None.
    method
        Reduction method for all parts of the scene, or None. A search for an accuracy does not
        change it.
    output
        Values of settings in ``[output]`` by key.

    Raises
    ------
    SettingsError
        Both `body` and `method` are given.
    """
    scene = as_stored(name)
    if body is not None:
        if method is not None:
            raise SettingsError(
                "--body and --method exclude each other: the body is already reduced"
            )
        # The module imports all reductions, which is slow.
        from fenics_ehd.scenes.part_changes import with_body

        scene = with_body(scene, body, read_toml(name) if Path(name).suffix == ".toml" else {})
    if method is not None:
        from fenics_ehd.scenes.part_changes import with_method

        scene = with_method(scene, method)
    scene = changed(scene, {f"output.{key}": value for key, value in output.items()})
    if method is not None and scene.output.accuracy:
        kept = (f"bodies.{part}.reduction" for part in meshed(scene))
        scene = changed(scene, {"output.accuracy_keeps": [*scene.output.accuracy_keeps, *kept]})
    return scene


def _gathered_parts(built: Machine) -> dict[str, PartFields]:
    """Meshes and bases of parts reduced in this run, gathered on the first rank; collective."""
    from fenics_ehd.results.paraview import gather_part

    parts = {
        name: gather_part(part.structure, part.body, part.columns)
        for name, part in built.reduced.items()
    }
    return {name: part for name, part in parts.items() if part is not None}


def resume(directory: Path, options: RunOptions) -> None:
    """Resume the run in a folder; on one rank only."""
    with RunFolder(directory, resume=True) as folder:
        done = complete_result(folder.path)
        if done is not None and "cycles" in done:
            # A complete periodic solution has no checkpoint to resume from.
            answer(done, report(done, folder.directory), options.as_json)
            return
        former = load_run_state(folder.path)
        scene, built = stored_scene(folder.path)
        _finish(scene, built, folder, options, search_of(folder.path), former)


def _finish(
    scene: Scene,
    built: Machine,
    folder: RunFolder,
    options: RunOptions,
    search: Search | None,
    former: Checkpoint | None = None,
    parts: Mapping[str, PartFields] = MappingProxyType({}),
) -> None:
    """Integrate the motion of a scene, draw pictures, write a ParaView series, print the report.

    `parts` are the meshes and bases of the parts that were reduced in this run, for ParaView.

    Raises
    ------
    VerificationError
        The run stopped before its end; the message is its status.
    """
    first = built
    scene, built, summary = run_accurately(
        scene,
        built,
        folder.path,
        search,
        interval=options.interval,
        former=former,
        multiplier=options.multiplier,
        announce=say_next,
        progress=options.progress,
    )
    if options.plots and scene.output.plots:
        with options.progress.stage("pictures"):
            from fenics_ehd.plotting.pictures import plot_run

            plot_run(folder.path)
    if scene.output.paraview:
        if built is not first:
            parts = {**parts, **_gathered_parts(built)}
        with options.progress.stage("ParaView series"):
            _write_series(scene, built, folder.path, parts)
    warn_of(summary["notices"])
    seconds = perf_counter() - options.began if former is None else None
    answer(summary, report(summary, folder.directory, seconds), options.as_json)
    if summary["status"] != "complete":
        raise VerificationError(str(summary["status"]))


def _write_series(
    scene: Scene, built: Machine, directory: Path, parts: Mapping[str, PartFields]
) -> None:
    """Write a ParaView series of a run; bodies without a mesh in `parts` are drawn as lines."""
    from fenics_ehd.multibody.history import load_history
    from fenics_ehd.results.paraview import write_run

    if without := sorted(built.bodies.keys() - parts.keys()):
        named = ", ".join(without)
        warn_of([f"{named}: has no mesh in this run, ParaView shows it by lines and films"])
    frames = scene.output.frames
    write_run(built.mechanism, load_history(directory), parts, directory / "vtk", frames)


#: Factors to printed units, by endings of the names of results; the first matching ending is used.
FACTORS = {"m3_per_s": 1e6, "_time_s": 1e3, "_height_m": 1e3, "_Pa": 1e-6, "_m": 1e6}

#: Printed lines of a joint by the result that a line requires; values are in printed units. The
#: text of a value's error, `bound`, follows its unit (`VALUE`).
JOINT_LINES = {
    "max_pressure_Pa": "    peak pressure (POFP)    {max_pressure_Pa:9.3f} MPa {pressure_error}at "
    "{max_pressure_time_s:.3f} ms of the {clock}",
    "min_film_thickness_m": "    minimum film (MOFT)     {min_film_thickness_m:9.4f} um  "
    "{film_error}at {min_film_thickness_time_s:.3f} ms of the {clock}",
    "basis_error_estimate_m": "    basis error estimate    {basis_error_estimate_m:9.4f} um  of gap"
    "{large}",
    "mean_friction_power_W": "    friction power loss     {mean_friction_power_W:9.3f} W   "
    "mean; friction torque {mean_friction_torque_Nm:.4g} N m on the journal, "
    "{mean_bore_friction_torque_Nm:.4g} N m on the bore{on_bodies}",
    "cycle_mean_force_N": "    peak of the {span:12}{cycle_max_pressure_Pa:9.3f} MPa "
    "at {cycle_max_pressure_angle_deg:.1f} deg of the bore, {cycle_max_pressure_height_m:+.2f} mm, "
    "{body} {cycle_max_pressure_crank_angle_deg:.1f} deg\n"
    "    thinnest of the {span:8}{cycle_min_film_thickness_m:9.4f} um  "
    "at {cycle_min_film_angle_deg:.1f} deg of the bore, {cycle_min_film_height_m:+.2f} mm, "
    "{body} {cycle_min_film_crank_angle_deg:.1f} deg\n"
    "    force                   {cycle_mean_force_N:9.4g} N   mean, {cycle_max_force_N:.4g} N at "
    "{cycle_max_force_angle_deg:.1f} deg, {body} {cycle_max_force_crank_angle_deg:.1f} deg\n"
    "    eccentricity            {cycle_max_eccentricity_ratio:9.3f} c   at most in the deformed "
    "bore, {body} {cycle_max_eccentricity_crank_angle_deg:.1f} deg",
    "cycle_mean_specific_load_Pa": "    specific load F / (2RB) "
    "{cycle_mean_specific_load_Pa:9.3f} MPa mean, {cycle_max_specific_load_Pa:.4g} MPa at most",
    "cycle_min_lambda_ratio": "    lambda ratio            {cycle_min_lambda_ratio:9.3f}"
    "{bound[cycle_min_lambda_ratio]}     thinnest film over combined roughness, "
    "{body} {cycle_min_lambda_ratio_crank_angle_deg:.1f} deg",
    "effective_temperature_C": "    effective temperature   {effective_temperature_C:9.2f} C   "
    "from {supply_temperature_C:.2f} C, {outlet_temperature_C:.2f} C with "
    "{mean_leaving_flow_m3_per_s:.3f} cm3/s that leave",
    "mean_contact_force_N": "    mean contact force      {mean_contact_force_N:9.3g} N   of "
    "contact pressure up to {max_contact_pressure_Pa:.3g} MPa",
    "cycle_max_contact_share": "    load on asperities      {mean_contact_share:9.3g}"
    "{bound[mean_contact_share]}     share, mean, {cycle_max_contact_share:.3g}"
    "{bound[cycle_max_contact_share]} at most, {body} "
    "{cycle_max_contact_share_crank_angle_deg:.1f} deg",
}

#: Printed lines of a run by the key of the summary that a line requires; values are in SI units.
RUN_LINES = {
    "cycles": "  periodic after {cycles} cycles: the films change by {periodicity_defect:.1e}",
    "multiplier_failure": "  largest multiplier: not found, {multiplier_failure}",
    "largest_multiplier": "  largest multiplier      {largest_multiplier:9.3g}     of a "
    "perturbation remains after a cycle, +- {largest_multiplier_residual:.1g}",
    "energy_balance_error": "  energy balance error    {energy_balance_error:9.1e}     of the "
    "energy exchanged",
}


#: Printed value of a line with its unit; positions, in degrees, mm or ms, have no error.
VALUE = re.compile(r"\{(\w+):[^}]*\} (?:MPa|N m|N|W|um|C|c|cm3/s)(?=[ ,\n]|$)")


def bound_texts(joint: Mapping[str, Any]) -> Mapping[str, str]:
    """Texts of the errors of a joint's figures by name, `` +- 0.5 %`` or `` (not estimated)``.

    They are empty if the run has no error budget, and for figures without an error by their nature.
    """
    texts: dict[str, str] = defaultdict(str)
    if "errors" in joint:
        for figure in figures_of({"joints": {"": joint}}):
            if figure.known:
                texts[figure.name] = f" {figure.bound}"
            elif figure.reason == NOT_ESTIMATED:
                texts[figure.name] = f" ({NOT_ESTIMATED})"
    # Lines of these figures have the text of `error_text`.
    texts |= dict.fromkeys(("max_pressure_Pa", "min_film_thickness_m"), "")
    return texts


def joint_lines(
    joint: Mapping[str, Any], span: str = "cycle", body: str = CRANK, clock: str = "cycle"
) -> list[str]:
    """Printed lines of the results of a joint, the flows last.

    Parameters
    ----------
    joint
        Entries of the joint in ``summary.json``.
    span
        Word for the time span of the results: ``cycle`` or ``run``.
    body
        Name of the body whose angle is the reference angle.
    clock
        Word for the span from whose start times are counted: ``cycle`` in a search for a periodic
        solution, else ``run``.
    """
    figures = {}
    for key, value in joint.items():
        if isinstance(value, int | float):
            factors = (factor for end, factor in FACTORS.items() if key.endswith(end))
            figures[key] = value * next(factors, 1.0)
    pressure = figures["max_pressure_Pa"]
    film = figures["min_film_thickness_m"]
    large = figures.get("basis_error_estimate_m", 0.0) > LARGEST_ESTIMATE * film
    bounds = bound_texts(joint)
    words: dict[str, Any] = {
        "bound": bounds,
        "span": span,
        "clock": clock,
        "body": body,
        "pressure_error": error_text(joint, "max_pressure", pressure, "MPa"),
        "film_error": error_text(joint, "min_film_thickness", film, "um"),
        "on_bodies": "" if "mean_film_power_W" in joint else ", not applied to the bodies",
        "large": ", not small compared with the film: use more modes" * large,
    }
    values = figures | words
    lines = [
        VALUE.sub(r"\g<0>{bound[\1]}", text).format_map(values)
        for key, text in JOINT_LINES.items()
        if np.isfinite(figures.get(key, np.nan))
    ]
    for key, flow in figures.items():
        # The mean over the last cycle is printed in place of the mean over the run.
        if key.endswith("flow_m3_per_s") and f"cycle_{key}" not in joint and "leaving" not in key:
            name = key.rpartition("mean_")[2].removesuffix("flow_m3_per_s").strip("._")
            lines.append(f"    {f'mean flow, {name}':23} {flow:9.4f} cm3/s{bounds[key]}")
    return lines


def report(summary: Mapping[str, Any], directory: Path, seconds: float | None = None) -> str:
    """Printed report of a run; `seconds` is the duration of the command [s], None if unknown."""
    joints = summary["joints"]
    lines = [
        f"{summary['scene']}: {summary['steps']} steps, "
        f"{summary['newton_iterations']} Newton iterations"
    ]
    for name, body in summary["bodies"].items():
        lines.append(f"  {name}: {body['method']} with {body['modes']} modes")
    for name, joint in joints.items():
        lines += [
            f"  {name}",
            *joint_lines(
                joint, _span(summary), summary.get("reference_body") or CRANK, _clock(summary)
            ),
        ]
    lines += budget_table(joints, summary) + accuracy_lines(summary)
    prefix = "the cycle: " if _span(summary) == "cycle" else ""
    lines.append(
        f"  {prefix}{summary['cycle_used']}, from {summary['cycle_start_s'] * 1e3:.3f} to "
        f"{summary['cycle_end_s'] * 1e3:.3f} ms"
    )
    lines += [text.format_map(summary) for key, text in RUN_LINES.items() if key in summary]
    lines += [
        f"  time: reduction {summary['reduction_time_s']:.2f} s, "
        f"integration {summary['wall_time_s']:.2f} s" + _rest(summary, seconds),
        f"  results in {directory}",
    ]
    return "\n".join(lines)


def _rest(summary: Mapping[str, Any], seconds: float | None) -> str:
    """Text with the time that neither reduction nor integration took, and with the total time."""
    if seconds is None:
        return ""
    rest = seconds - summary["reduction_time_s"] - summary["wall_time_s"]
    return f", error estimates, pictures and files {rest:.2f} s: {seconds:.2f} s in all"
