"""``fenics-ehd run rotor``: what the command does, and the files it writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import attrs
import click
from mpi4py import MPI

from fenics_ehd.errors import SettingsError
from fenics_ehd.output import require_writable, versions
from fenics_ehd.reduction import ReducedBody, Structure, load_body
from fenics_ehd.run_folder import RunFolder, first_rank_folder
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.settings import build, unusual
from fenics_ehd.whole_file import naming

if TYPE_CHECKING:  # slow to import, and not every command needs them
    from fenics_ehd.commands.machine_run import MachineRun
    from fenics_ehd.scenes.part import ReducedPart
    from fenics_ehd.scenes.transient import Totals


def read_settings(scene: str, tables: Mapping[str, Any]) -> RotorSettings:
    """Settings from the tables of a scene file; a model is named relative to that file."""
    try:
        settings = build(RotorSettings, tables)
    except SettingsError as error:
        raise SettingsError(f"{scene}: {error}") from None
    model = Path(settings.housing.model)
    if not model.suffix or model.is_absolute():
        return settings
    path = (Path(scene).parent / model).absolute()
    housing = attrs.evolve(settings.housing, model=str(path))
    return attrs.evolve(settings, housing=housing)


def run_rotor(
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
    """``fenics-ehd run`` for this scene; checkpoints every `interval` seconds."""
    from fenics_ehd.commands.machine_run import conclude, run_machine, with_method
    from fenics_ehd.commands.recording import warn
    from fenics_ehd.scenes.housing import check_origin
    from fenics_ehd.scenes.rotor_run import check_before_reduction, check_structure

    settings = with_method(read_settings(scene, tables), method, body_file)
    if body_file and frames:
        raise SettingsError("--vtk needs the housing's mesh, not in --body: drop --body")
    require_writable(directory)
    check_before_reduction(settings)
    warn(settings)
    with first_rank_folder(directory, overwrite) as folder:
        part, seconds = None, 0.0
        if body_file:
            body = load_body(body_file)
            check_origin(body, settings, tables)
        else:
            housing = reduce_with_notice(settings, partial(check_structure, settings))
            body, seconds = housing.body, housing.seconds
            if frames:
                from fenics_ehd.paraview import gather_part

                part = gather_part(housing.structure, body, housing.columns)
        # The time integration is serial: other ranks have done their share.
        if folder is not None:
            job = _job(settings, body, seconds, folder.path)
            summary = run_machine(job, interval)
            if part is not None and frames is not None:
                from fenics_ehd.results import write_housing_series

                with naming(folder.path / "vtk"):
                    write_housing_series(body, part, folder.path, frames)
            conclude(job, summary, folder, plots, as_json)


def reduce_with_notice(
    settings: RotorSettings, check: Callable[[Structure], None] | None = None
) -> ReducedPart:
    """Reduce the housing on all ranks and say so: the first time, forms are compiled."""
    from fenics_ehd.scenes.housing import reduce_housing

    if MPI.COMM_WORLD.rank == 0:
        click.echo(
            "reducing the housing (forms are compiled once, in about half a minute)", err=True
        )
    return reduce_housing(settings, check=check)


def resume_rotor(
    scene: Path,
    tables: Mapping[str, Any],
    body: ReducedBody,
    checkpoint: Mapping[str, Any],
    folder: RunFolder,
    interval: float,
    plots: bool,
    as_json: bool,
) -> None:
    """``fenics-ehd run --resume`` for this scene."""
    from fenics_ehd.commands.machine_run import conclude, run_machine

    settings = read_settings(str(scene), tables)
    job = _job(settings, body, float(checkpoint["reduction_seconds"]), folder.path)
    conclude(job, run_machine(job, interval, checkpoint), folder, plots, as_json)


def _job(settings: RotorSettings, body: ReducedBody, seconds: float, directory: Path) -> MachineRun:
    from fenics_ehd.commands.machine_run import MachineRun
    from fenics_ehd.scenes.rotor_run import simulate, simulated_time

    end = simulated_time(settings)
    return MachineRun(settings, body, seconds, directory, end, simulate, summarise)


def summarise(
    settings: RotorSettings,
    body: ReducedBody,
    totals: Totals,
    status: str,
    reduction_seconds: float,
) -> dict[str, object]:
    """Figures of ``summary.json``; `modes` are those of the housing."""
    from fenics_ehd.scenes.rotor_run import build_rotor

    rotor = build_rotor(settings)
    shaft = rotor.beam.shaft
    return {
        "status": status,
        "warnings": unusual(settings),
        "scene": settings.scene,
        "method": body.method,
        "modes": body.modes,
        "shaft_modes": settings.shaft.modes,
        **totals.figures(),
        "rotor_mass_kg": shaft.mass + settings.disk.mass,
        "rotor_polar_inertia_kg_m2": shaft.polar_inertia + settings.disk.polar_inertia,
        "shaft_frequencies_Hz": [float(f) for f in rotor.frequencies],
        "housing_mass_kg": body.inertia.total_mass,
        "frequencies_Hz": [float(f) for f in body.frequencies],
        "reduction_time_s": reduction_seconds,
        "wall_time_s": totals.wall_time,
        "versions": versions(),
    }
