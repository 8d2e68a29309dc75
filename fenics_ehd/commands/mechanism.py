"""Run a scene of bodies and joints: history, checkpoints, a summary whatever happens."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from mpi4py import MPI

from fenics_ehd.checkpoint import CHECKPOINT, Checkpoints, load_progress
from fenics_ehd.commands.machine_run import require_same_scene
from fenics_ehd.commands.recording import progress_bar, record, warn_of
from fenics_ehd.errors import PeriodicityError, VerificationError
from fenics_ehd.history_file import HistoryWriter, keep_last_rows
from fenics_ehd.output import require_writable, to_json, versions, write_whole
from fenics_ehd.reduction import body_digest, load_body, save_body
from fenics_ehd.run_folder import SCENE_NAME, RunFolder, first_rank_folder

if TYPE_CHECKING:  # slow to import, and not every command needs them
    from fenics_ehd.multibody.bdf import Step
    from fenics_ehd.multibody.simulation import Run
    from fenics_ehd.multibody.tracking import Tracker
    from fenics_ehd.scenes.build import Built
    from fenics_ehd.scenes.scene_file import Scene

#: File of a flexible body beside the history of its run.
BODY_FILE = "body-{}.h5"


@dataclass
class Journey:
    """A run with all that it carries from step to step: `fenics_ehd.checkpoint.Stored`.

    Attributes
    ----------
    run, tracker
        The integration and what it has shown.
    cycle, first_row, defect
        Of a periodic run: the cycle under way, the row of the history it begins with, and the
        change of the films over the last one.
    wall_time, processor_time
        So far [s].
    """

    run: Run
    tracker: Tracker
    cycle: int = 1
    first_row: int = 0
    defect: float = float("nan")
    wall_time: float = 0.0
    processor_time: float = 0.0

    @property
    def integrator(self) -> Any:
        """State of the integration."""
        return self.run.state

    def memory(self) -> dict[str, Any]:
        """As nested dictionaries of arrays and numbers, for `restore`."""
        own = {
            name: getattr(self, name)
            for name in ("cycle", "first_row", "defect", "wall_time", "processor_time")
        }
        return {**self.run.memory(), **self.tracker.memory(), "journey": own}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on where another one was."""
        self.run.restore(memory)
        self.tracker.restore(memory)
        for name, value in memory["journey"].items():
            setattr(self, name, value)


def run_mechanism(
    name: str,
    method: str | None,
    directory: Path,
    plots: bool,
    interval: float,
    as_json: bool,
    overwrite: bool,
) -> None:
    """``fenics-ehd run`` of a scene of bodies and joints; collective until it is built."""
    from fenics_ehd.scenes.build import build_mechanism
    from fenics_ehd.scenes.scene_text import as_stored

    scene = as_stored(name)
    warn_of(scene.warnings)
    require_writable(directory)
    with first_rank_folder(directory, overwrite) as folder:
        built = build_mechanism(scene, MPI.COMM_WORLD, method)
        # The time integration is serial: other ranks have done their share.
        if folder is not None:
            _leave_scene(scene, built, folder.path)
            _finish(scene, built, folder, interval, plots, as_json, None)


def resume_mechanism(folder: RunFolder, plots: bool, interval: float, as_json: bool) -> None:
    """``fenics-ehd run --resume`` of such a scene; serial."""
    from fenics_ehd.scenes.build import build_mechanism
    from fenics_ehd.scenes.scene_text import as_stored

    former = load_progress(folder.path)
    scene = as_stored(folder.path / SCENE_NAME)
    bodies = {
        path.stem.removeprefix(BODY_FILE.split("{")[0]): load_body(path)
        for path in folder.path.glob(BODY_FILE.format("*"))
    }
    built = build_mechanism(scene, MPI.COMM_SELF, bodies=bodies)
    _finish(scene, built, folder, interval, plots, as_json, former)


def _leave_scene(scene: Scene, built: Built, directory: Path) -> None:
    """Scene and bodies beside the results of a run, to go on with."""
    from fenics_ehd.scenes.scene_text import scene_text

    write_whole(directory / SCENE_NAME, scene_text(scene))
    for name, body in built.parts.items():
        save_body(body, directory / BODY_FILE.format(name))


def _fingerprints(scene: Scene, built: Built) -> dict[str, str]:
    """Digests of scene, tables and bodies: a run goes on only with those it began with."""
    from fenics_ehd.scenes.scene_text import files_of, scene_text

    found = {SCENE_NAME: hashlib.sha256(scene_text(scene).encode()).hexdigest()}
    for path in files_of(scene.tables):
        # A name in HDF5 has no slash.
        found[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found | {BODY_FILE.format(name): body_digest(body) for name, body in built.parts.items()}


def _finish(
    scene: Scene,
    built: Built,
    folder: RunFolder,
    interval: float,
    plots: bool,
    as_json: bool,
    former: Mapping[str, Any] | None,
) -> None:
    """Integrate, draw, print.

    Raises
    ------
    VerificationError
        The run is not complete.
    """
    summary = _integrate(scene, built, folder.path, interval, former)
    if plots:
        from fenics_ehd.plotting.history import plot_joints

        plot_joints(scene.name, folder.path)
    click.echo(to_json(summary) if as_json else report(summary, folder.directory))
    if summary["status"] != "complete":
        raise VerificationError(str(summary["status"]))


def _integrate(
    scene: Scene,
    built: Built,
    directory: Path,
    interval: float,
    former: Mapping[str, Any] | None,
) -> dict[str, object]:
    """The summary of a run, or of one that goes on from a checkpoint."""
    from fenics_ehd.multibody.simulation import Run
    from fenics_ehd.multibody.tracking import Tracker

    prints = _fingerprints(scene, built)
    if former is not None:
        require_same_scene(former, prints, directory)
    run = Run(built.mechanism, built.steps, scene.span)
    journey = Journey(run, Tracker(run.equations, run.norm))
    if former is not None:
        journey.restore(former["memory"])
    rows = None if former is None else int(former["rows"])
    seconds = built.seconds if former is None else float(former["reduction_seconds"])
    history = HistoryWriter(directory, _constants(run), resumed=rows)
    checkpoints = Checkpoints(history, interval, {"reduction_seconds": seconds, "scene": prints})
    bar = progress_bar(scene.span)

    def go(check: Callable[[], None]) -> str:
        with checkpoints:
            for step in _steps(scene, journey, history):
                checkpoints.follow(journey)
                pressure = max((f.pressure.max() for f in step.auxiliary.films), default=0.0)
                bar.set_postfix_str(
                    f"cycle {journey.cycle}, step {journey.tracker.counts['steps']}, "
                    f"p {pressure * 1e-6:.1f} MPa",
                    refresh=False,
                )
                into = 1e3 * (step.time - (journey.cycle - 1) * scene.span)
                bar.update(min(into, bar.total) - bar.n)
                check()
        return journey.tracker.verdict()

    def summarise(status: str) -> dict[str, object]:
        cycles = {"cycles": journey.cycle, "periodicity_defect": journey.defect}
        return {
            "status": status,
            "warnings": list(scene.warnings),
            "scene": scene.name,
            "bodies": {
                name: {"method": body.method, "modes": body.modes}
                for name, body in built.parts.items()
            },
            **journey.tracker.figures(),
            **(cycles if scene.time.periodic else {}),
            "reduction_time_s": seconds,
            "wall_time_s": journey.wall_time,
            "processor_time_s": journey.processor_time,
            "versions": versions(),
        }

    summary = record(directory, history, bar, go, summarise)
    if scene.time.periodic:
        # What is left is no run to go on with.
        (directory / CHECKPOINT).unlink()
        keep_last_rows(directory, journey.first_row)
    return summary


def _steps(scene: Scene, journey: Journey, history: HistoryWriter) -> Iterator[Step]:
    """Integrate to the end, or until the films repeat, and record every step.

    Raises
    ------
    PeriodicityError
        They do not within the cycles allowed.
    """
    run, tracker = journey.run, journey.tracker
    began, busy = perf_counter() - journey.wall_time, process_time() - journey.processor_time
    while True:
        for step in run.until(journey.cycle * scene.span):
            row, fields = tracker.add(step)
            if scene.time.periodic:
                into = step.time - (journey.cycle - 1) * scene.span
                row |= {"cycle": journey.cycle, "cycle_time_s": into}
            history.add(row, fields)
            journey.wall_time, journey.processor_time = (
                perf_counter() - began,
                process_time() - busy,
            )
            yield step
        if not scene.time.periodic:
            return
        journey.defect = tracker.change_over_cycle(run.state.watched[0])
        if journey.defect <= scene.time.periodicity:
            return
        if journey.cycle >= scene.time.cycles:
            raise PeriodicityError(
                f"after time.cycles = {journey.cycle} the films still change by "
                f"{journey.defect:.2e} from cycle to cycle, above time.periodicity = "
                f"{scene.time.periodicity:g}: allow more cycles or check the loads"
            )
        journey.cycle, journey.first_row = journey.cycle + 1, history.rows
        tracker.begin_cycle()


def _constants(run: Run) -> dict[str, np.ndarray]:
    """What a history holds once: nodes of every film, angle [rad] and height [m]."""
    films = run.equations.system.films
    return {
        f"{place.name}.film_nodes" if len(films) > 1 else "film_nodes": (
            place.film.film.parameters.grid.node_positions
        )
        for place in films
    }


def report(summary: Mapping[str, Any], directory: Path) -> str:
    """The run in a few lines."""
    joints = summary.get("joints") or {summary["joint"]: summary}
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
            f"at {joint['max_pressure_time_s'] * 1e3:.3f} ms"
        )
        lines.append(
            f"    minimum film thickness  {joint['min_film_thickness_m'] * 1e6:9.4f} um  "
            f"at {joint['min_film_thickness_time_s'] * 1e3:.3f} ms"
        )
        estimate = joint["basis_error_estimate_m"]
        if np.isfinite(estimate):
            lines.append(f"    basis error estimate    {estimate * 1e6:9.4f} um  of gap")
    if "cycles" in summary:
        lines.append(
            f"  periodic after {summary['cycles']} cycles: the films change by "
            f"{summary['periodicity_defect']:.1e}"
        )
    lines += [
        f"  energy balance error    {summary['energy_balance_error']:9.1e}",
        f"  time: reduction {summary['reduction_time_s']:.2f} s, "
        f"integration {summary['wall_time_s']:.2f} s",
        f"  results in {directory}",
    ]
    return "\n".join(lines)
