"""What the commands do, once the command line is understood."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import attrs
import click
from mpi4py import MPI

from fenics_ehd.errors import SettingsError
from fenics_ehd.output import (
    require_writable,
    to_json,
    versions,
)
from fenics_ehd.reduction import ReducedBody, load_body
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.settings import build, read_toml

if TYPE_CHECKING:  # slow to import, and not every command needs them
    from fenics_ehd.commands.machine_run import MachineRun
    from fenics_ehd.paraview import PartFields
    from fenics_ehd.scenes.part import ReducedPart


def read_scene(scene: str) -> tuple[SliderCrankSettings, dict]:
    """Settings of a scene given by name or TOML file, and the tables as written."""
    if scene == "slider-crank":
        return SliderCrankSettings(), {}
    if Path(scene).suffix != ".toml":
        raise SettingsError(
            f"scene {scene!r}: not slider-crank, rotor, loaded-journal or a .toml file"
        )
    tables = read_toml(scene)
    try:
        settings = build(SliderCrankSettings, tables)
    except SettingsError as error:
        raise SettingsError(f"{scene}: {error}") from None
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


def tables_of(scene: str, kind: str) -> dict | None:
    """Tables of a scene of this kind given by name or file, None for another kind of scene."""
    if scene == kind:
        return {}
    if Path(scene).suffix != ".toml":
        return None
    tables = read_toml(scene)
    return tables if tables.get("scene") == kind else None


def run_scene(
    scene: str,
    body_file: str | None,
    method: str | None,
    directory: str | None,
    plots: bool,
    frames: int | None,
    interval: float,
    as_json: bool,
) -> None:
    """``fenics-ehd run``; checkpoints every `interval` seconds."""
    target = Path(directory or Path("results") / Path(scene).stem)
    journal_tables = tables_of(scene, "loaded-journal")
    if journal_tables is not None:
        from fenics_ehd.commands.loaded_journal import read_settings, run_loaded_journal

        if body_file or method or frames:
            raise SettingsError("--body, --method, --vtk: not for loaded-journal, which is rigid")
        run_loaded_journal(read_settings(scene, journal_tables), target, plots, as_json)
        return
    rotor_tables = tables_of(scene, "rotor")
    if rotor_tables is not None:
        from fenics_ehd.commands.rotor import run_rotor

        run_rotor(scene, rotor_tables, target, body_file, method, plots, frames, interval, as_json)
        return
    settings, tables = read_scene(scene)
    if body_file and method:
        raise SettingsError("--body and --method exclude each other: the body has its method")
    if body_file and frames:
        raise SettingsError("--vtk needs the rod's mesh, which --body does not hold: drop --body")
    if method:
        settings = attrs.evolve(settings, reduction=attrs.evolve(settings.reduction, method=method))
    require_writable(target)
    part, seconds = None, 0.0
    if body_file:
        from fenics_ehd.scenes.rod import check_origin

        body = load_body(body_file)
        check_origin(body, settings, tables)
    else:
        rod = reduce_with_notice(settings)
        body, seconds = rod.body, rod.seconds
        part = _gather(rod) if frames else None
    # The time integration is serial: other ranks have done their share.
    if MPI.COMM_WORLD.rank == 0:
        from fenics_ehd.commands.machine_run import conclude, run_machine

        job = _job(settings, body, seconds, target)
        summary = run_machine(job, interval)
        if part is not None and frames is not None:
            from fenics_ehd.results import write_run_series

            write_run_series(settings, body, part, target, frames)
        conclude(job, summary, plots, as_json)


def reduce_with_notice(settings: SliderCrankSettings) -> ReducedPart:
    """Reduce the rod on all ranks and say so: the first time, forms are compiled."""
    from fenics_ehd.scenes.rod import reduce_rod

    if MPI.COMM_WORLD.rank == 0:
        click.echo("reducing the rod (forms are compiled once, in about half a minute)", err=True)
    return reduce_rod(settings)


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

    scene, body, checkpoint = former_run(directory)
    rotor_tables = tables_of(str(scene), "rotor")
    if rotor_tables is not None:
        from fenics_ehd.commands.rotor import resume_rotor

        folder = Path(directory)
        resume_rotor(scene, rotor_tables, body, checkpoint, folder, interval, plots, as_json)
        return
    settings, _ = read_scene(str(scene))
    job = _job(settings, body, float(checkpoint["reduction_seconds"]), Path(directory))
    conclude(job, run_machine(job, interval, checkpoint), plots, as_json)


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
