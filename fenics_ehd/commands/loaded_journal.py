"""``fenics-ehd run loaded-journal``: what the command does, and the files it writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import attrs
import click
from mpi4py import MPI

from fenics_ehd.checkpoint import Checkpoints
from fenics_ehd.commands.machine_run import fingerprints, leave_scene, require_same_scene
from fenics_ehd.commands.recording import progress_bar, record, warn
from fenics_ehd.errors import SettingsError, VerificationError
from fenics_ehd.multibody.massless_journal import MasslessJournal
from fenics_ehd.output import (
    HistoryWriter,
    read_history,
    require_writable,
    to_json,
    versions,
)
from fenics_ehd.run_folder import RunFolder
from fenics_ehd.scenes.load_history import LoadHistory
from fenics_ehd.scenes.loaded_journal import BUILT_IN_LOAD, build_journal, build_load
from fenics_ehd.scenes.loaded_journal_run import OrbitTotals, simulate, verdict
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.settings import build, unusual


def read_settings(scene: str, tables: Mapping[str, Any]) -> LoadedJournalSettings:
    """Settings from the tables of a scene file; a load is named relative to that file."""
    try:
        settings = build(LoadedJournalSettings, tables)
    except SettingsError as error:
        raise SettingsError(f"{scene}: {error}") from None
    file = Path(settings.load.file)
    if settings.load.file == BUILT_IN_LOAD or file.is_absolute():
        return settings
    return attrs.evolve(
        settings, load=attrs.evolve(settings.load, file=str((Path(scene).parent / file).absolute()))
    )


def run_loaded_journal(
    settings: LoadedJournalSettings,
    directory: Path,
    plots: bool,
    interval: float,
    as_json: bool,
    overwrite: bool,
) -> None:
    """``fenics-ehd run`` for this scene; serial, so that other ranks have nothing to do."""
    require_writable(directory)
    warn(settings)
    if MPI.COMM_WORLD.rank:
        return
    load = build_load(settings)
    journal = build_journal(settings, load)
    with RunFolder(directory, overwrite=overwrite) as folder:
        summary = _simulate(settings, load, journal, folder.path, interval)
        _conclude(settings, summary, folder, plots, as_json)


def resume_loaded_journal(
    scene: str,
    tables: Mapping[str, Any],
    former: Mapping[str, Any],
    folder: RunFolder,
    plots: bool,
    interval: float,
    as_json: bool,
) -> None:
    """``fenics-ehd run --resume`` for this scene."""
    settings = read_settings(scene, tables)
    load = build_load(settings)
    journal = build_journal(settings, load)
    summary = _simulate(settings, load, journal, folder.path, interval, former)
    _conclude(settings, summary, folder, plots, as_json)


def _conclude(
    settings: LoadedJournalSettings,
    summary: Mapping[str, Any],
    folder: RunFolder,
    plots: bool,
    as_json: bool,
) -> None:
    """Picture of the orbit, what the command prints, and whether it succeeded."""
    if plots:
        from fenics_ehd.plotting.orbit import plot_orbits

        plot_orbits({Path(settings.load.file).stem: read_history(folder.path)}, folder.path)
    click.echo(to_json(summary) if as_json else _report(summary, folder.directory))
    if summary["status"] != "complete":
        raise VerificationError(str(summary["status"]))


def _simulate(
    settings: LoadedJournalSettings,
    load: LoadHistory,
    journal: MasslessJournal,
    directory: Path,
    interval: float,
    former: Mapping[str, Any] | None = None,
) -> dict[str, object]:
    totals = OrbitTotals()
    bar = progress_bar(load.period, ends_in=False)
    rows = None if former is None else int(former["rows"])
    grid = journal.film.parameters.grid
    history = HistoryWriter(directory, {"pressure_nodes_m": grid.nodes}, resumed=rows)
    scene = fingerprints(settings)
    if former is not None:
        require_same_scene(former, scene, directory)
    checkpoints = Checkpoints(history, interval, {"reduction_seconds": 0.0, "scene": scene})

    def run(check: Callable[[], None]) -> str:
        def progress(totals: OrbitTotals) -> None:
            bar.set_postfix_str(
                f"cycle {totals.cycle}, step {totals.cycle_steps}, "
                f"p {totals.max_pressure * 1e-6:.1f} MPa, "
                f"eccentricity {totals.max_eccentricity_ratio:.3f} at most",
                refresh=False,
            )
            if 1e3 * totals.cycle_time < bar.n:
                bar.reset()
            bar.update(1e3 * totals.cycle_time - bar.n)
            check()

        leave_scene(settings, directory)
        memory = None if former is None else former["memory"]
        with checkpoints:
            simulate(
                settings,
                totals,
                history.add,
                progress,
                journal,
                load,
                checkpoint=checkpoints.follow,
                memory=memory,
            )
        return verdict(settings, totals)

    return record(directory, history, bar, run, lambda status: summarise(settings, totals, status))


def summarise(
    settings: LoadedJournalSettings, totals: OrbitTotals, status: str
) -> dict[str, object]:
    """Figures of ``summary.json``; extremes and means are those of the last cycle."""
    bearing, (friction, power, _) = settings.bearing, totals.means
    pumped = bearing.ambient_pressure or any(groove[2] for groove in bearing.grooves)
    return {
        "status": status,
        "warnings": unusual(settings),
        "scene": settings.scene,
        "method": "rigid",
        "modes": 0,
        "max_pressure_Pa": float(totals.max_pressure),
        "max_pressure_time_s": totals.max_pressure_time,
        "min_film_thickness_m": float(totals.min_film_thickness),
        "min_film_thickness_time_s": totals.min_film_thickness_time,
        "max_eccentricity_ratio": totals.max_eccentricity_ratio,
        "period_s": totals.period,
        "cycles": totals.cycle,
        "shooting_updates": totals.shooting_updates,
        "periodicity_defect": totals.periodicity_defect,
        "largest_multiplier": totals.largest_multiplier,
        "force_balance_error": totals.force_balance_error,
        "steps": totals.steps,
        "cycle_steps": totals.cycle_steps,
        "rejected_steps": totals.rejected_steps,
        "newton_iterations": totals.newton_iterations,
        "film_solves": totals.film_solves,
        "mean_friction_torque_Nm": float(friction),
        "mean_power_loss_W": float(power),
        # Oil under pressure brings its own power, which is not counted.
        "energy_balance_error": None if pumped else totals.energy_error,
        **(totals.oil.summary() if settings.film.cavitation == "mass-conserving" else {}),
        "basis_error_estimate_m": None,  # no basis
        "reduction_time_s": 0.0,
        "wall_time_s": totals.wall_time,
        "versions": versions(),
    }


def _report(summary: Mapping[str, Any], directory: Path) -> str:
    """The run in a few lines."""
    lines = [
        f"{summary['scene']}: periodic after {summary['cycles']} cycles of "
        f"{summary['period_s'] * 1e3:.3f} ms, {summary['cycle_steps']} steps in the last",
        f"  maximum pressure        {summary['max_pressure_Pa'] * 1e-6:9.3f} MPa "
        f"at {summary['max_pressure_time_s'] * 1e3:.3f} ms",
        f"  minimum film thickness  {summary['min_film_thickness_m'] * 1e6:9.4f} um  "
        f"at {summary['min_film_thickness_time_s'] * 1e3:.3f} ms",
        f"  maximum eccentricity    {summary['max_eccentricity_ratio']:9.4f} of the clearance",
        f"  change over the cycle   {summary['periodicity_defect']:9.1e} of the film, "
        f"largest Floquet multiplier {summary['largest_multiplier']:.2g}",
        f"  mean power loss         {summary['mean_power_loss_W']:9.2f} W",
        f"  force balance error     {summary['force_balance_error']:9.1e} of the largest load",
        *_oil_lines(summary),
        f"  time: integration {summary['wall_time_s']:.2f} s, {summary['film_solves']} film solves",
        f"  results in {directory}",
    ]
    return "\n".join(lines)


def _oil_lines(summary: Mapping[str, Any]) -> list[str]:
    """Oil of a film that keeps account of it."""
    if "oil_content_m3" not in summary:
        return []
    return [
        f"  fluid fraction          {summary['mean_fluid_fraction']:9.4f} in the mean, "
        f"{summary['min_fluid_fraction']:.4f} at least",
        f"  mean side flow          {summary['mean_side_flow_m3_per_s'] * 1e9:9.1f} mm3/s, "
        f"oil balance error {summary['oil_balance_error']:.1e} of the content",
    ]
