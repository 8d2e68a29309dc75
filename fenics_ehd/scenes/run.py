"""A scene's run into a folder, with all that it takes to go on with it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI
from tqdm import tqdm

from fenics_ehd.base.folder import clear
from fenics_ehd.base.output import versions, write_whole
from fenics_ehd.multibody.orbit import Orbit
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.reduction import ReducedBody, body_digest, load_body, save_body
from fenics_ehd.results.error_budget import estimated
from fenics_ehd.results.recorded_run import CHECKPOINT_EVERY, RecordedRun, record_run
from fenics_ehd.results.run_folder import BODY_FILE, SCENE_NAME
from fenics_ehd.scenes.accuracy import Search
from fenics_ehd.scenes.accuracy_step import account
from fenics_ehd.scenes.build import Built, build_mechanism
from fenics_ehd.scenes.scene import Scene, flexible, lubricated_joints
from fenics_ehd.scenes.scene_text import as_stored, csv_files, scene_text


def run_scene(
    scene: Scene,
    built: Built,
    directory: Path,
    bar: tqdm,
    *,
    interval: float = CHECKPOINT_EVERY,
    former: Mapping[str, Any] | None = None,
    judged: bool = True,
    multiplier: bool = False,
    search: Search | None = None,
    orbits: list[Orbit] | None = None,
) -> dict[str, Any]:
    """Integrate a scene, serially, and leave its results in a folder.

    Parameters
    ----------
    scene, built
        As read with `as_stored`, and what it stands for.
    directory
        Made by the caller.
    bar
        Shows the progress.
    interval
        Between two checkpoints [s].
    former
        Checkpoint of a run in this folder to go on from.
    judged
        Whether it says what its figures are worth, if the scene wants that.
    multiplier
        Whether the largest multiplier of a periodic solution is found, too.
    search
        For settings that meet an accuracy, which takes account of the run.
    orbits
        Of runs before it, of which it begins on the last; its own is added, if it is periodic.

    Returns
    -------
    dict
        The summary, as in ``summary.json``.

    Raises
    ------
    InputError, SolverError
        See `record_run`.
    """
    if former is None:
        clear(directory)
        if search is not None:
            search.leave(directory)
        write_whole(directory / SCENE_NAME, scene_text(scene))
        for name, body in built.parts.items():
            save_body(body, directory / BODY_FILE.format(name))
    judge = None
    if judged and scene.output.error_budget and lubricated_joints(scene):
        judge = partial(_worth, scene=scene, search=search)
    run, time = Run(built.mechanism, built.steps, scene.span), scene.time
    last = orbits[-1] if orbits else None
    entered = last.entered(run, built.parts) if last else None
    cycles = Cycles(run, scene.span, time.periodicity, time.cycles) if time.periodic else None
    recorded = RecordedRun(run, Tracker(run.equations, run.norm), scene.span, cycles, multiplier)
    if cycles and last and entered is not None:
        cycles.follow(last.cycles)
        step, recorded.processor_time = entered
        recorded.wall_time = recorded.processor_time
        recorded.tracker.enter(step)
    if cycles and orbits is not None:
        orbits.append(Orbit(run, cycles, built.parts))
    return record_run(
        recorded,
        directory,
        {
            "warnings": list(scene.warnings),
            "scene": scene.name,
            **_reductions(built),
            "reduction_time_s": built.seconds,
            "versions": versions(),
        },
        _fingerprints(scene, built),
        interval=interval,
        bar=bar,
        former=former,
        judge=judge,
    )


def _worth(
    recorded: RecordedRun,
    directory: Path,
    scene: Scene,
    search: Search | None,
) -> dict[str, Any]:
    """What the summary has of a run's budget, and of the search for an accuracy."""
    found = estimated(recorded, directory)
    if search is not None:
        return found | account(search, scene, recorded, found)
    return found | {"status": recorded.tracker.verdict(scene.output.error_limit)}


def _reductions(built: Built) -> dict[str, Any]:
    """Method and number of modes of every flexible body; alone where there is one or none."""
    found = {
        name: {"method": body.method, "modes": body.modes} for name, body in built.parts.items()
    }
    alone = next(iter(found.values()), {"method": "rigid", "modes": 0})
    if len(found) > 1:
        alone = {}
    return {**alone, "bodies": found}


def stored_scene(directory: Path) -> tuple[Scene, Built]:
    """Scene and mechanism of a run from its folder; nothing is meshed or reduced.

    Raises
    ------
    SettingsError, BodyFileError
        Of its files.
    """
    scene = as_stored(directory / SCENE_NAME)
    return scene, build_mechanism(scene, MPI.COMM_SELF, bodies=stored_bodies(scene, directory))


def stored_bodies(scene: Scene, directory: Path) -> dict[str, ReducedBody]:
    """Flexible bodies of a run from its folder; a model, which is a program, is not run again.

    Raises
    ------
    BodyFileError
        A file is missing or cannot be read.
    """
    return {name: load_body(directory / BODY_FILE.format(name)) for name in flexible(scene)}


def _fingerprints(scene: Scene, built: Built) -> dict[str, str]:
    """Digests of scene, tables and bodies: a run goes on only with those it began with."""
    found = {SCENE_NAME: hashlib.sha256(scene_text(scene).encode())}
    for path in dict.fromkeys(csv_files(scene.tables)):
        # A name in HDF5 has no slash, and files of several folders may have the same one.
        found.setdefault(path.name, hashlib.sha256()).update(path.read_bytes())
    digests = {name: digest.hexdigest() for name, digest in found.items()}
    return digests | {
        BODY_FILE.format(name): body_digest(body) for name, body in built.parts.items()
    }
