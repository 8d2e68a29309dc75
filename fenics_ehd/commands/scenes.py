"""What the commands do, once the command line is understood."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import attrs
import click
from mpi4py import MPI

from fenics_ehd.commands.scene_kinds import (
    LOADED_JOURNAL,
    ROTOR,
    SCENE_KEY,
    SLIDER_CRANK,
    is_mechanism,
    read_tables,
    scene_tables,
)
from fenics_ehd.errors import SettingsError
from fenics_ehd.output import require_writable, to_json, versions
from fenics_ehd.reduction import ReducedBody, Structure, load_body
from fenics_ehd.run_folder import BODY_NAME, SCENE_NAME, RunFolder, first_rank_folder
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.settings import build
from fenics_ehd.whole_file import naming

if TYPE_CHECKING:  # slow to import, and not every command needs them
    from fenics_ehd.commands.machine_run import MachineRun
    from fenics_ehd.paraview import PartFields
    from fenics_ehd.scenes.part import ReducedPart


def read_scene(scene: str) -> tuple[SliderCrankSettings, dict]:
    """Settings of a slider-crank given by name or TOML file, and the tables as written.

    The file may leave out which scene it is: who calls this has a slider-crank in mind.

    Raises
    ------
    SettingsError
        The file cannot be read, is another scene, or holds a key or value that cannot be used.
    """
    if scene == SLIDER_CRANK:
        return SliderCrankSettings(), {}
    tables = read_tables(scene)
    kind = tables.get(SCENE_KEY, SLIDER_CRANK)
    if kind != SLIDER_CRANK:
        raise SettingsError(f"{scene}: scene = {kind!r} must be {SLIDER_CRANK} here")
    try:
        settings = build(SliderCrankSettings, tables)
    except SettingsError as error:
        assumed = "" if SCENE_KEY in tables else f" (scene is missing, {SLIDER_CRANK} assumed)"
        raise SettingsError(f"{scene}: {error}{assumed}") from None
    return _beside(settings, Path(scene).parent), tables


def _beside(settings: SliderCrankSettings, folder: Path) -> SliderCrankSettings:
    """Files that a scene names relative to itself, by their own paths."""
    rod, mechanism = settings.rod, settings.mechanism
    if Path(rod.model).suffix:
        rod = attrs.evolve(rod, model=str((folder / rod.model).absolute()))
    mechanism = attrs.evolve(
        mechanism,
        gas_force=_table_beside(mechanism.gas_force, folder),
        drive_torque_table=_table_beside(mechanism.drive_torque_table, folder),
    )
    return attrs.evolve(settings, rod=rod, mechanism=mechanism)


def _table_beside(name: str, folder: Path) -> str:
    return name if name == "none" else str((folder / name).absolute())


def run_scene(
    scene: str,
    body_file: str | None,
    method: str | None,
    directory: str | None,
    plots: bool,
    frames: int | None,
    interval: float,
    as_json: bool,
    overwrite: bool,
) -> None:
    """``fenics-ehd run``; checkpoints every `interval` seconds."""
    target = Path(directory or Path("results") / Path(scene).stem)
    if is_mechanism(scene):
        from fenics_ehd.commands.mechanism import run_mechanism

        if body_file or frames:
            raise SettingsError(
                "--body, --vtk: not for a scene of bodies; give [bodies.NAME] body = FILE"
            )
        run_mechanism(scene, method, target, plots, interval, as_json, overwrite)
        return
    kind, tables = scene_tables(scene)
    if kind == LOADED_JOURNAL:
        from fenics_ehd.commands.loaded_journal import read_settings, run_loaded_journal

        if body_file or method or frames:
            raise SettingsError("--body, --method, --vtk: not for loaded-journal, which is rigid")
        run_loaded_journal(
            read_settings(scene, tables), target, plots, interval, as_json, overwrite
        )
        return
    if kind == ROTOR:
        from fenics_ehd.commands.rotor import run_rotor

        run = run_rotor
    else:
        run = _run_slider_crank
    run(scene, tables, target, body_file, method, plots, frames, interval, as_json, overwrite)


def _run_slider_crank(
    scene: str,
    tables: Mapping[str, Any],
    directory: Path,
    body_file: str | None,
    method: str | None,
    plots: bool,
    frames: int | None,
    interval: float,
    as_json: bool,
    overwrite: bool,
) -> None:
    """``fenics-ehd run`` for this scene."""
    from fenics_ehd.commands.machine_run import conclude, run_machine, with_method
    from fenics_ehd.commands.recording import warn
    from fenics_ehd.scenes.rod import check_origin
    from fenics_ehd.scenes.run import check_before_reduction, check_structure

    settings = with_method(read_scene(scene)[0], method, body_file)
    if body_file and frames:
        raise SettingsError("--vtk needs the rod's mesh, which --body does not hold: drop --body")
    require_writable(directory)
    check_before_reduction(settings)
    warn(settings)
    with first_rank_folder(directory, overwrite) as folder:
        part, seconds = None, 0.0
        if body_file:
            body = load_body(body_file)
            check_origin(body, settings, tables)
        else:
            rod = reduce_with_notice(settings, partial(check_structure, settings))
            body, seconds = rod.body, rod.seconds
            part = _gather(rod) if frames else None
        # The time integration is serial: other ranks have done their share.
        if folder is not None:
            job = _job(settings, body, seconds, folder.path)
            summary = run_machine(job, interval)
            if part is not None and frames is not None:
                from fenics_ehd.results import write_run_series

                with naming(folder.path / "vtk"):
                    write_run_series(settings, body, part, folder.path, frames)
            conclude(job, summary, folder, plots, as_json)


def reduce_with_notice(
    settings: SliderCrankSettings, check: Callable[[Structure], None] | None = None
) -> ReducedPart:
    """Reduce the rod on all ranks and say so: the first time, forms are compiled."""
    from fenics_ehd.scenes.rod import reduce_rod

    if MPI.COMM_WORLD.rank == 0:
        click.echo("reducing the rod (forms are compiled once, in about half a minute)", err=True)
    return reduce_rod(settings, check=check)


def _gather(rod: ReducedPart) -> PartFields | None:
    """Collect what ParaView files need on the first rank; None elsewhere."""
    from fenics_ehd.paraview import gather_part

    return gather_part(rod.structure, rod.body, rod.columns)


def _job(
    settings: SliderCrankSettings, body: ReducedBody, seconds: float, directory: Path
) -> MachineRun:
    from fenics_ehd.commands.machine_run import MachineRun
    from fenics_ehd.results import summarise
    from fenics_ehd.scenes.run import simulate, simulated_time

    return MachineRun(
        settings,
        body,
        seconds,
        directory,
        simulated_time(settings),
        simulate,
        summarise,
    )


def resume_scene(directory: str, plots: bool, interval: float, as_json: bool) -> None:
    """``fenics-ehd run --resume``; serial."""
    from fenics_ehd.commands.machine_run import conclude, former_run, run_machine

    with RunFolder(directory, resume=True) as folder:
        if is_mechanism(str(folder.path / SCENE_NAME)):
            from fenics_ehd.commands.mechanism import resume_mechanism

            resume_mechanism(folder, plots, interval, as_json)
            return
        scene, checkpoint = former_run(folder.path)
        kind, tables = scene_tables(str(scene))
        if kind == LOADED_JOURNAL:
            from fenics_ehd.commands.loaded_journal import resume_loaded_journal

            resume_loaded_journal(str(scene), tables, checkpoint, folder, plots, interval, as_json)
            return
        body = load_body(folder.path / BODY_NAME)
        if kind == ROTOR:
            from fenics_ehd.commands.rotor import resume_rotor

            resume_rotor(scene, tables, body, checkpoint, folder, interval, plots, as_json)
            return
        settings, _ = read_scene(str(scene))
        job = _job(settings, body, float(checkpoint["reduction_seconds"]), folder.path)
        conclude(job, run_machine(job, interval, checkpoint), folder, plots, as_json)


def show_info(as_json: bool) -> None:
    """``fenics-ehd info``."""
    from fenics_ehd.models import model_path

    found: dict[str, object] = dict(versions(installed=True))
    found["package"] = str(resources.files("fenics_ehd"))
    for part in ("conrod", "housing"):
        found[f"{part}_model"] = str(model_path(part))
    if as_json:
        click.echo(to_json(found))
    else:
        click.echo("\n".join(f"{name:14s} {value}" for name, value in found.items()))
