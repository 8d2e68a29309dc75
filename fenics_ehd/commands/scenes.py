"""What the commands do, once the command line is understood."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import attrs
import click
import numpy as np
from mpi4py import MPI

from fenics_ehd.commands.recording import progress_bar, record
from fenics_ehd.errors import SettingsError, VerificationError
from fenics_ehd.output import (
    read_history,
    require_writable,
    to_json,
    versions,
)
from fenics_ehd.reduction import ReducedBody, load_body
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.settings import build, read_toml

if TYPE_CHECKING:  # slow to import, and not every command needs them
    from fenics_ehd.multibody.bdf import Step
    from fenics_ehd.paraview import PartFields
    from fenics_ehd.scenes.rod import ReducedRod
    from fenics_ehd.scenes.run import Totals


def read_scene(scene: str) -> tuple[SliderCrankSettings, dict]:
    """Settings of a scene given by name or TOML file, and the tables as written."""
    if scene == "slider-crank":
        return SliderCrankSettings(), {}
    if Path(scene).suffix != ".toml":
        raise SettingsError(f"scene {scene!r}: not slider-crank, loaded-journal or a .toml file")
    tables = read_toml(scene)
    try:
        settings = build(SliderCrankSettings, tables)
    except SettingsError as error:
        raise SettingsError(f"{scene}: {error}") from None
    model = Path(settings.rod.model)
    if model.suffix and not model.is_absolute():
        # A model is named relative to the file that names it.
        rod = attrs.evolve(settings.rod, model=str(Path(scene).parent / model))
        settings = attrs.evolve(settings, rod=rod)
    return settings, tables


def _journal_tables(scene: str) -> dict | None:
    """Tables of a loaded-journal scene given by name or file, None for another kind of scene."""
    if scene == "loaded-journal":
        return {}
    if Path(scene).suffix != ".toml":
        return None
    tables = read_toml(scene)
    return tables if tables.get("scene") == "loaded-journal" else None


def run_scene(
    scene: str,
    body_file: str | None,
    method: str | None,
    directory: str | None,
    plots: bool,
    frames: int | None,
    as_json: bool,
) -> None:
    """``fenics-ehd run``."""
    target = Path(directory or Path("results") / Path(scene).stem)
    journal_tables = _journal_tables(scene)
    if journal_tables is not None:
        from fenics_ehd.commands.loaded_journal import read_settings, run_loaded_journal

        if body_file or method or frames:
            raise SettingsError("--body, --method, --vtk: not for loaded-journal, which is rigid")
        run_loaded_journal(read_settings(scene, journal_tables), target, plots, as_json)
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
        summary = _simulate(settings, body, seconds, target)
        _finish(settings, body, target, plots, part, frames)
        click.echo(to_json(summary) if as_json else _report(summary, target))
        if summary["status"] != "complete":
            raise VerificationError(str(summary["status"]))


def reduce_with_notice(settings: SliderCrankSettings) -> ReducedRod:
    """Reduce the rod on all ranks and say so: the first time, forms are compiled."""
    from fenics_ehd.scenes.rod import reduce_rod

    if MPI.COMM_WORLD.rank == 0:
        click.echo("reducing the rod (forms are compiled once, in about half a minute)", err=True)
    return reduce_rod(settings)


def _gather(rod: ReducedRod) -> PartFields | None:
    """Collect what ParaView files need on the first rank; None elsewhere."""
    from fenics_ehd.paraview import gather_part

    return gather_part(rod.structure, rod.columns)


def _simulate(
    settings: SliderCrankSettings, body: ReducedBody, seconds: float, directory: Path
) -> dict[str, object]:
    from fenics_ehd.results import open_history, summarise
    from fenics_ehd.scenes.run import Totals, simulate, verdict

    totals = Totals()
    bar = progress_bar(settings.mechanism.revolutions * 2 * np.pi / settings.mechanism.crank_speed)
    history = open_history(directory, body)

    def run(check: Callable[[], None]) -> str:
        def progress(totals: Totals, step: Step) -> None:
            bar.set_postfix_str(
                f"step {totals.steps}, {totals.newton_iterations} iterations, "
                f"p {step.auxiliary.film.pressure.max() * 1e-6:.1f} MPa",
                refresh=False,
            )
            bar.update(1e3 * totals.time - bar.n)
            check()

        simulate(settings, body, totals, history.add, progress)
        return verdict(totals)

    return record(
        directory,
        history,
        bar,
        run,
        lambda status: summarise(settings, body, totals, status, seconds),
    )


def _finish(
    settings: SliderCrankSettings,
    body: ReducedBody,
    directory: Path,
    plots: bool,
    part: PartFields | None,
    frames: int | None,
) -> None:
    """Pictures and ParaView files, only when asked for."""
    if plots:
        from fenics_ehd.plotting.history import plot_history

        label = f"{body.method.upper()}, {body.modes} modes"
        plot_history({label: read_history(directory)}, directory)
    if part is not None and frames is not None:
        from fenics_ehd.results import write_run_series

        write_run_series(settings, body, part, directory, frames)


def _estimate_line(estimate: float, film: float) -> str:
    if not np.isfinite(estimate):
        return "  basis error estimate    not computed"
    line = f"  basis error estimate    {estimate * 1e6:9.4f} um  of gap"
    return f"{line}, not small against the film: take more modes" if estimate > 0.2 * film else line


def _report(summary: Mapping[str, Any], directory: Path) -> str:
    """The run in a few lines."""
    estimate = summary["basis_error_estimate_m"]
    lines = [
        f"{summary['scene']}, {summary['method']} with {summary['modes']} modes: "
        f"{summary['steps']} steps, {summary['newton_iterations']} Newton iterations",
        f"  maximum pressure        {summary['max_pressure_Pa'] * 1e-6:9.3f} MPa "
        f"at {summary['max_pressure_time_s'] * 1e3:.3f} ms",
        f"  minimum film thickness  {summary['min_film_thickness_m'] * 1e6:9.4f} um  "
        f"at {summary['min_film_thickness_time_s'] * 1e3:.3f} ms",
        _estimate_line(estimate, summary["min_film_thickness_m"]),
        f"  energy balance error    {summary['energy_balance_error']:9.1e}",
        f"  time: reduction {summary['reduction_time_s']:.2f} s, "
        f"integration {summary['wall_time_s']:.2f} s",
        f"  results in {directory}",
    ]
    return "\n".join(lines)


def show_info(as_json: bool) -> None:
    """``fenics-ehd info``."""
    from fenics_ehd.geometry import model_path

    found: dict[str, object] = dict(versions())
    found["package"] = str(resources.files("fenics_ehd"))
    found["conrod_model"] = str(model_path("conrod"))
    if as_json:
        click.echo(to_json(found))
    else:
        click.echo("\n".join(f"{name:14s} {value}" for name, value in found.items()))
