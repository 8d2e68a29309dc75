"""Run a machine from the command line: history, checkpoints, a summary whatever happens."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import attrs
import click
import numpy as np

from fenics_ehd.checkpoint import Checkpoints, load_progress
from fenics_ehd.commands.recording import progress_bar, record
from fenics_ehd.errors import InputError, SettingsError, VerificationError
from fenics_ehd.history_file import HistoryWriter
from fenics_ehd.output import to_json, write_whole
from fenics_ehd.reduction import ReducedBody, body_digest, save_body
from fenics_ehd.run_folder import BODY_NAME, SCENE_NAME, RunFolder
from fenics_ehd.settings import to_toml

if TYPE_CHECKING:  # slow to import, and not every command needs them
    from fenics_ehd.multibody.bdf import Step
    from fenics_ehd.scenes.transient import Progress, Totals

#: Seconds between two checkpoints, unless told otherwise.
CHECKPOINT_EVERY = 10.0


@dataclass(frozen=True, eq=False)
class MachineRun:
    """One run of one machine.

    Attributes
    ----------
    settings, body
        The scene, to be stored with the run, and the reduced part.
    reduction_seconds
        What the reduction took.
    directory
        Where it writes, see `fenics_ehd.run_folder`.
    end
        Simulated time [s].
    simulate
        ``simulate(settings, body, totals, record, progress, checkpoint=, memory=)`` of the scene.
    summarise
        Figures of the summary from settings, body, totals, status and reduction seconds.
    """

    settings: Any
    body: ReducedBody
    reduction_seconds: float
    directory: Path
    end: float
    simulate: Callable[..., Totals]
    summarise: Callable[..., dict[str, object]]


def run_machine(
    job: MachineRun,
    interval: float = CHECKPOINT_EVERY,
    former: Mapping[str, Any] | None = None,
) -> dict[str, object]:
    """Run, or go on from a former run's checkpoint, and return the summary.

    Parameters
    ----------
    job
        What to run.
    interval
        Seconds between checkpoints.
    former
        Checkpoint to go on from.

    Raises
    ------
    InputError
        Scene or tables are not those of the former run.
    """
    from fenics_ehd.results import bore_constants
    from fenics_ehd.scenes.transient import Totals, verdict

    scene = fingerprints(_recorded(job)) | {BODY_NAME: body_digest(job.body)}
    if former is not None:
        require_same_scene(former, scene, job.directory)
    totals = Totals()
    bar = progress_bar(job.end)
    rows = None if former is None else int(former["rows"])
    history = HistoryWriter(job.directory, bore_constants(job.body), resumed=rows)
    figures = {"reduction_seconds": job.reduction_seconds, "scene": scene}
    checkpoints = Checkpoints(history, interval, figures)

    def store(run: Progress) -> None:
        if history.rows == 1:
            store_scene(job)
        checkpoints.follow(run)

    def run(check: Callable[[], None]) -> str:
        def progress(totals: Totals, step: Step) -> None:
            bar.set_postfix_str(
                f"step {totals.steps}, {totals.newton_iterations} iterations, "
                f"p {step.auxiliary.film.pressure.max() * 1e-6:.1f} MPa",
                refresh=False,
            )
            bar.update(1e3 * totals.time - bar.n)
            check()

        memory = None if former is None else former["memory"]
        with checkpoints:
            job.simulate(
                job.settings,
                job.body,
                totals,
                history.add,
                progress,
                checkpoint=store,
                memory=memory,
            )
        return verdict(totals)

    def summarise(status: str) -> dict[str, object]:
        return job.summarise(job.settings, job.body, totals, status, job.reduction_seconds)

    return record(job.directory, history, bar, run, summarise)


def fingerprints(settings: Any) -> dict[str, str]:
    """What a run depends on beside its body: a digest of the scene and of each table it names."""
    found = {SCENE_NAME: _digest(to_toml(settings).encode())}
    for path in _files(attrs.asdict(settings)):
        # A name in HDF5 has no slash.
        found[path.name] = _digest(path.read_bytes())
    return found


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _files(tables: Mapping[str, Any]) -> Iterator[Path]:
    for value in tables.values():
        if isinstance(value, Mapping):
            yield from _files(value)
        elif isinstance(value, str) and value.endswith(".csv") and Path(value).is_file():
            yield Path(value)


def require_same_scene(
    former: Mapping[str, Any], scene: Mapping[str, str], directory: Path
) -> None:
    """Refuse to go on with a run that began with other `fingerprints`.

    Raises
    ------
    InputError
        Naming the file.
    """
    stored = former["scene"]
    changed = [name for name in {**stored, **scene} if stored.get(name) != scene.get(name)]
    if changed:
        raise InputError(
            f"{directory}: {', '.join(sorted(changed))} changed since the run began: put back what "
            "it was, or run the scene anew"
        )


def leave_scene(settings: Any, directory: Path) -> None:
    """Leave the scene beside the results of its run."""
    directory.mkdir(parents=True, exist_ok=True)
    write_whole(directory / SCENE_NAME, to_toml(settings))


def store_scene(job: MachineRun) -> None:
    """Scene and body of a run, for `former_run`."""
    leave_scene(_recorded(job), job.directory)
    save_body(job.body, job.directory / BODY_NAME)


def _recorded(job: MachineRun) -> Any:
    """The scene as it is run: a body from a file has a part and a reduction of its own."""
    from fenics_ehd.scenes.part import as_made

    return as_made(job.settings, job.body)


def former_run(directory: Path) -> tuple[Path, dict[str, Any]]:
    """Scene file and checkpoint of a run that may go on.

    Raises
    ------
    InputError
        The folder holds no such run.
    """
    checkpoint = load_progress(directory)
    scene = directory / SCENE_NAME
    if not scene.is_file():
        raise InputError(f"{scene}: missing, the run cannot go on")
    return scene, checkpoint


def with_method(settings: Any, method: str | None, body_file: str | None) -> Any:
    """Settings of a scene with the method of ``--method``.

    Raises
    ------
    SettingsError
        A body is given, too.
    """
    if body_file and method:
        raise SettingsError("--body and --method exclude each other: the body has its method")
    if not method:
        return settings
    return attrs.evolve(settings, reduction=attrs.evolve(settings.reduction, method=method))


def conclude(
    job: MachineRun, summary: Mapping[str, Any], folder: RunFolder, plots: bool, as_json: bool
) -> None:
    """Pictures, what the command prints, and whether it succeeded.

    Raises
    ------
    VerificationError
        The run is not complete.
    """
    if plots:
        from fenics_ehd.plotting.history import plot_machine

        plot_machine(f"{job.body.method.upper()}, {job.body.modes} modes", job.directory)
    text = to_json(summary) if as_json else report(summary, folder.directory)
    shown = ", in pictures min_film_thickness.png, max_pressure.png and others"
    click.echo(text + (shown if plots and not as_json else ""))
    if summary["status"] != "complete":
        raise VerificationError(str(summary["status"]))


def _estimate_line(estimate: float, film: float, modes: int) -> str:
    """What a basis misses [m], compared with the thinnest film [m]."""
    if not np.isfinite(estimate):
        return "  basis error estimate    not computed"
    line = f"  basis error estimate    {estimate * 1e6:9.4f} um  of gap"
    if estimate <= 0.2 * film:
        return line
    more = "take more modes" if modes else "the part bends, take a method with modes"
    return f"{line}, not small against the film: {more}"


def report(summary: Mapping[str, Any], directory: Path) -> str:
    """The run in a few lines."""
    reduced = f"{summary['method']} with {summary['modes']} modes"
    if "shaft_modes" in summary:
        reduced = (
            f"{summary['shaft_modes']} modes of the shaft, {summary['method']} with "
            f"{summary['modes']} of the housing"
        )
    lines = [
        f"{summary['scene']}, {reduced}: "
        f"{summary['steps']} steps, {summary['newton_iterations']} Newton iterations",
        f"  maximum pressure        {summary['max_pressure_Pa'] * 1e-6:9.3f} MPa "
        f"at {summary['max_pressure_time_s'] * 1e3:.3f} ms",
        f"  minimum film thickness  {summary['min_film_thickness_m'] * 1e6:9.4f} um  "
        f"at {summary['min_film_thickness_time_s'] * 1e3:.3f} ms",
        _estimate_line(
            summary["basis_error_estimate_m"], summary["min_film_thickness_m"], summary["modes"]
        ),
        f"  energy balance error    {summary['energy_balance_error']:9.1e}     of the energy "
        f"exchanged, {summary['net_energy_balance_error']:.1e} of that put in for good",
        f"  time: reduction {summary['reduction_time_s']:.2f} s, "
        f"integration {summary['wall_time_s']:.2f} s",
        f"  results in {directory}",
    ]
    return "\n".join(lines)
