"""``fenics-ehd run``: a scene's results, or those of a run that goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import attrs
import click
import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import SettingsError, VerificationError
from fenics_ehd.base.output import complete_result, require_writable, to_json
from fenics_ehd.base.ranks import require_alike
from fenics_ehd.base.settings import read_toml
from fenics_ehd.cli.accuracy import accuracy_lines, say_next, with_accuracy
from fenics_ehd.cli.cycle_lines import cycle_line, multiplier_line, place_lines
from fenics_ehd.cli.error_budget import beside, budget_table
from fenics_ehd.cli.notices import say_reducing, warn_of
from fenics_ehd.results.checkpoint import CHECKPOINT, load_run_state
from fenics_ehd.results.progress import progress_bar
from fenics_ehd.results.run_folder import RunFolder, first_rank_folder
from fenics_ehd.scenes.accuracy import Search, begun, keeping, search_of
from fenics_ehd.scenes.accurate_run import run_accurately
from fenics_ehd.scenes.build import Built, build_mechanism
from fenics_ehd.scenes.given import with_body, with_method
from fenics_ehd.scenes.run import stored_scene
from fenics_ehd.scenes.scene import Scene, flexible, meshed
from fenics_ehd.scenes.scene_text import as_stored, scene_text

if TYPE_CHECKING:  # slow to import, for ParaView series only
    from fenics_ehd.results.part_fields import PartFields


#: Basis error estimate over the thinnest film above which it is said to be large.
LARGEST_ESTIMATE = 0.2


@dataclass(frozen=True)
class Wishes:
    """What the command line wants of a run, new or gone on with, beside its scene."""

    plots: bool
    #: Between two checkpoints [s].
    interval: float
    as_json: bool
    #: Whether the largest multiplier of a periodic solution is found, too.
    multiplier: bool
    #: When the command began [s].
    began: float = field(default_factory=perf_counter)


def run(scene: Scene, directory: Path, overwrite: bool, wishes: Wishes) -> None:
    """Run a scene; collective until it is built."""
    if wishes.multiplier and not scene.time.periodic:
        raise SettingsError(
            f"--multiplier: scene {scene.name} is no periodic solution: set time.periodic = true"
        )
    warn_of(scene.warnings)
    require_writable(directory)
    scene, search = begun(scene)
    require_alike("scene", scene_text(scene))
    with first_rank_folder(directory, overwrite, flexible(scene)) as folder:
        built = build_mechanism(scene, MPI.COMM_WORLD, announce=say_reducing)
        parts = _whole_parts(built) if scene.output.paraview else {}
        # The time integration is serial: other ranks have done their share.
        if folder is not None:
            _finish(scene, built, folder, wishes, search, parts=parts)


def changed_scene(
    name: str,
    *,
    body: str | None,
    method: str | None,
    frames: int | None,
    error_budget: bool | None,
    accuracy: str | None,
) -> Scene:
    """A scene with what the command line says in place of it.

    Parameters
    ----------
    name
        Of a shipped scene, or its file.
    body
        File of a reduced body.
    method
        Of its parts; kept whatever an accuracy chooses.
    frames
        Of a ParaView series; None: as the scene says.
    error_budget, accuracy
        As under ``[output]``; None: as the scene says.

    Raises
    ------
    SettingsError
        Body and method exclude each other.
    """
    scene = as_stored(name)
    if body is not None:
        if method is not None:
            raise SettingsError("--body and --method exclude each other: the body has its method")
        scene = with_body(scene, body, read_toml(name) if Path(name).suffix == ".toml" else {})
    if method is not None:
        scene = with_method(scene, method)
    if accuracy is not None:
        scene = with_accuracy(scene, accuracy)
    if method is not None and scene.output.accuracy:
        scene = keeping(scene, [f"bodies.{part}.reduction" for part in meshed(scene)])
    output = scene.output
    if frames is not None:
        output = attrs.evolve(output, paraview=True, frames=frames)
    if error_budget is not None:
        output = attrs.evolve(output, error_budget=error_budget)
    return replace(scene, output=output)


def _whole_parts(built: Built) -> dict[str, PartFields]:
    """Bodies reduced here, for a ParaView series; collective."""
    from fenics_ehd.results.part_fields import gather_part

    parts = {
        name: gather_part(part.structure, part.body, part.columns)
        for name, part in built.reduced.items()
    }
    return {name: part for name, part in parts.items() if part is not None}


def resume(directory: Path, wishes: Wishes) -> None:
    """Go on with a run; serial."""
    with RunFolder(directory, resume=True) as folder:
        done = complete_result(folder.path)
        if done is not None and not (folder.path / CHECKPOINT).exists():
            # A periodic solution keeps its last cycle, and nothing to go on with.
            click.echo(to_json(done) if wishes.as_json else report(done, folder.directory))
            return
        former = load_run_state(folder.path)
        scene, built = stored_scene(folder.path)
        _finish(scene, built, folder, wishes, search_of(folder.path), former)


def _finish(
    scene: Scene,
    built: Built,
    folder: RunFolder,
    wishes: Wishes,
    search: Search | None,
    former: Mapping[str, Any] | None = None,
    parts: Mapping[str, PartFields] | None = None,
) -> None:
    """Integrate, draw, print; `parts` go into a ParaView series.

    Raises
    ------
    VerificationError
        The run is not complete.
    """
    first = built
    scene, built, summary = run_accurately(
        scene,
        built,
        folder.path,
        lambda own: progress_bar(own.span),
        search,
        interval=wishes.interval,
        former=former,
        multiplier=wishes.multiplier,
        told=say_next,
    )
    if wishes.plots and scene.output.plots:
        from fenics_ehd.plotting.pictures import plot_run

        plot_run(folder.path)
    if scene.output.paraview:
        if built is not first:
            parts = {**(parts or {}), **_whole_parts(built)}
        _write_series(scene, built, folder.path, parts or {})
    warn_of(summary["notices"])
    seconds = perf_counter() - wishes.began if former is None else None
    told = report(summary, folder.directory, seconds)
    click.echo(to_json(summary) if wishes.as_json else told)
    if summary["status"] != "complete":
        raise VerificationError(str(summary["status"]))


def _write_series(
    scene: Scene, built: Built, directory: Path, parts: Mapping[str, PartFields]
) -> None:
    """The run for ParaView; bodies from files, and all of a run that goes on, have no mesh."""
    from fenics_ehd.results.load import load_results
    from fenics_ehd.results.paraview import write_run

    if without := sorted(built.parts.keys() - parts.keys()):
        named = ", ".join(without)
        warn_of([f"{named}: no mesh is in a reduced body's file, ParaView has lines and films"])
    frames = scene.output.frames
    write_run(built.mechanism, load_results(directory), parts, directory / "vtk", frames)


def report(summary: Mapping[str, Any], directory: Path, seconds: float | None = None) -> str:
    """The run in a few lines; `seconds` is what all of it took, if it was one process."""
    joints = summary["joints"] if "joints" in summary else {summary["joint"]: summary}
    lines = [
        f"{summary['scene']}: {summary['steps']} steps, "
        f"{summary['newton_iterations']} Newton iterations"
    ]
    for name, body in summary["bodies"].items():
        lines.append(f"  {name}: {body['method']} with {body['modes']} modes")
    for name, joint in joints.items():
        lines.append(f"  {name}")
        lines.append(
            f"    maximum pressure        {joint['max_pressure_Pa'] * 1e-6:9.3f} MPa "
            f"{beside(joint, 'max_pressure', joint['max_pressure_Pa'] * 1e-6, 'MPa')}"
            f"at {joint['max_pressure_time_s'] * 1e3:.3f} ms"
        )
        lines.append(
            f"    minimum film thickness  {joint['min_film_thickness_m'] * 1e6:9.4f} um  "
            f"{beside(joint, 'min_film_thickness', joint['min_film_thickness_m'] * 1e6, 'um')}"
            f"at {joint['min_film_thickness_time_s'] * 1e3:.3f} ms"
        )
        estimate, thinnest = joint["basis_error_estimate_m"], joint["min_film_thickness_m"]
        if estimate is not None and np.isfinite(estimate):
            more = ", not small against the film: take more modes"
            lines.append(
                f"    basis error estimate    {estimate * 1e6:9.4f} um  of gap"
                + more * bool(estimate > LARGEST_ESTIMATE * thinnest)
            )
        if "mean_friction_power_W" in joint:
            lines.append(
                f"    mean friction power     {joint['mean_friction_power_W']:9.3f} W   "
                f"{joint['mean_friction_torque_Nm']:.4g} N m on the journal, "
                f"{joint['mean_bore_friction_torque_Nm']:.4g} N m on the bore"
            )
        lines += place_lines(joint) + real_film(joint)
    lines += budget_table(joints, summary) + accuracy_lines(summary)
    lines += cycle_line(summary)
    if "cycles" in summary:
        lines.append(
            f"  periodic after {summary['cycles']} cycles: the films change by "
            f"{summary['periodicity_defect']:.1e}"
        )
    lines += multiplier_line(summary)
    # Without a film nothing is put in for good.
    net = f", {summary['net_energy_balance_error']:.1e} of that put in for good" if joints else ""
    lines += [
        f"  energy balance error    {summary['energy_balance_error']:9.1e}     of the energy "
        f"exchanged{net}",
        f"  time: reduction {summary['reduction_time_s']:.2f} s, "
        f"integration {summary['wall_time_s']:.2f} s" + _rest(summary, seconds),
        f"  results in {directory}",
    ]
    return "\n".join(lines)


def _rest(summary: Mapping[str, Any], seconds: float | None) -> str:
    """What is left of the time that a command took."""
    if seconds is None:
        return ""
    rest = seconds - summary["reduction_time_s"] - summary["wall_time_s"]
    return f", error estimates, pictures and files {rest:.2f} s: {seconds:.2f} s in all"


def real_film(joint: Mapping[str, Any]) -> list[str]:
    """Lines of what the models of a joint add to its figures."""
    lines = []
    if "effective_temperature_C" in joint:
        lines.append(
            f"    effective temperature   {joint['effective_temperature_C']:9.2f} C   from "
            f"{joint['supply_temperature_C']:.2f} C, {joint['outlet_temperature_C']:.2f} C with "
            f"{joint['mean_leaving_flow_m3_per_s'] * 1e6:.3f} cm3/s that leave"
        )
    for key, flow in joint.items():
        # Of a run once through the mean over its last cycle, where it has one.
        if key.endswith("flow_m3_per_s") and f"cycle_{key}" not in joint and "leaving" not in key:
            name = key.rpartition("mean_")[2].removesuffix("flow_m3_per_s").strip("._")
            lines.append(f"    {f'mean flow, {name}':23} {flow * 1e6:9.4f} cm3/s")
    if "mean_contact_force_N" in joint:
        lines.append(
            f"    mean contact force      {joint['mean_contact_force_N']:9.3g} N   of contact "
            f"pressure up to {joint['max_contact_pressure_Pa'] * 1e-6:.3g} MPa"
        )
    return lines
