"""A scene's run into a folder, and runs until one meets the accuracy asked for.

A scene's run into a folder, with all that it takes to go on with it.

Runs of a scene, one after another, until one meets the accuracy that is asked for.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import attrs

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import (
    SUMMARY,
    clear,
    complete_result,
    require_kept,
    require_writable,
    versions,
    write_whole,
)
from fenics_ehd.multibody.history import FIELDS_NAME, History, load_history
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.verdict import verdict
from fenics_ehd.reduction.body import ReducedBody, body_digest, load_body, save_body
from fenics_ehd.results.recorded_run import (
    BODY_FILE,
    CHECKPOINT_EVERY,
    SCENE_NAME,
    Budgets,
    Checkpoint,
    RunFolder,
    estimate_errors,
    load_run_state,
    record_run,
    written_by_run,
)
from fenics_ehd.scenes.accuracy import Search, account, begun, search_of
from fenics_ehd.scenes.build import Machine, build
from fenics_ehd.scenes.scene import (
    Scene,
    as_stored,
    by_key,
    csv_files,
    flexible,
    input_files,
    scene_text,
    stored,
)


def run(
    scene: Scene, folder: str | Path, *, resume: bool = False, overwrite: bool = False
) -> History:
    """Run a scene into a folder as ``fenics-ehd run`` does, without pictures; serial.

    Parameters
    ----------
    scene
        As read; that of a run that goes on must be the one it began with.
    folder
        Made where it is missing.
    resume
        Go on with the run that was stopped there.
    overwrite
        A complete result there may be replaced.

    Returns
    -------
    History
        As `load_history` reads it from the folder; its summary has the status.

    Raises
    ------
    InputError, InUseError
        The folder cannot be used.
    SettingsError, MeshError, BodyFileError, SolverError
        Of the scene, its parts and the run.
    """
    require_class("scene", scene, Scene)
    require_class("folder", folder, str, Path)
    directory = Path(folder)
    require_writable(directory / SUMMARY)
    if resume:
        with RunFolder(directory, resume=True) as held:
            _require_same(scene, held.path)
            # A periodic solution keeps its last cycle, and nothing to go on with.
            if "cycles" not in (complete_result(held.path) or {}):
                found, former = stored_scene(held.path), load_run_state(held.path)
                run_accurately(*found, held.path, search_of(held.path), former=former)
        return load_history(directory)
    scene, search = begun(stored(scene))
    require_kept(directory, input_files("", scene), written_by_run(flexible(scene)))
    with RunFolder(directory, flexible(scene), overwrite=overwrite) as held:
        run_accurately(scene, build(scene), held.path, search)
    return load_history(directory)


def _require_same(scene: Scene, directory: Path) -> None:
    """Refuse to go on with a run of another scene; that of an accuracy chooses some of its own."""
    ours = dict(by_key(stored(scene).tables))
    theirs = dict(by_key(as_stored(directory / SCENE_NAME).tables))
    for key in {} if scene.output.accuracy else {**ours, **theirs}:
        if ours.get(key) != theirs.get(key):
            raise SettingsError(
                f"{key} = {ours.get(key)!r}: the run in {directory} has {theirs.get(key)!r}: go on "
                f"with read_scene of its {SCENE_NAME}, or choose another folder"
            )


def run_scene(
    scene: Scene,
    built: Machine,
    directory: Path,
    *,
    interval: float = CHECKPOINT_EVERY,
    former: Checkpoint | None = None,
    alone: bool = True,
    multiplier: bool = False,
    search: Search | None = None,
) -> dict[str, Any]:
    """Integrate a scene, serially, and leave its results in a folder.

    Parameters
    ----------
    scene, built
        As read with `as_stored`, and what it stands for.
    directory
        Made by the caller.
    interval
        Between two checkpoints [s].
    former
        Checkpoint of a run in this folder to go on from.
    alone
        Whether it shows its progress, and says what its figures are worth if the scene wants that;
        runs of a study are compared with one another.
    multiplier
        Whether the largest multiplier of a periodic solution is found, too.
    search
        For settings that meet an accuracy, which takes account of the run.

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
        for name, body in built.bodies.items():
            save_body(body, directory / BODY_FILE.format(name))
    judge = None
    if alone and scene.output.error_budget and scene.films:
        judge = partial(_worth, scene=scene, search=search)
    run, time = Run(built.mechanism, built.steps, scene.span), scene.time
    cycles = (
        PeriodicSolver(run, scene.span, time.periodicity, time.cycles) if time.periodic else None
    )
    return record_run(
        Recorder(run, scene.span, cycles),
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
        shown=alone,
        former=former,
        multiplier=multiplier,
        judge=judge,
    )


def _worth(
    recorded: Recorder,
    directory: Path,
    scene: Scene,
    search: Search | None,
) -> tuple[Budgets, dict[str, Any]]:
    """Error budgets of a run, and entries of its summary on them and on the search."""
    budgets, entries = estimate_errors(recorded, directory)
    limit = scene.output.error_limit
    if search is not None:
        limit = max(limit, search.asked)
    entries["status"] = verdict(RunSummary(recorded, budgets), limit)
    if search is not None:
        entries |= account(search, scene, recorded, budgets, entries)
    return budgets, entries


def _reductions(built: Machine) -> dict[str, Any]:
    """Method and number of modes of every flexible body; alone where there is one or none."""
    found = {
        name: {"method": body.method, "modes": body.modes} for name, body in built.bodies.items()
    }
    alone = next(iter(found.values()), {"method": "rigid", "modes": 0})
    if len(found) > 1:
        alone = {}
    return {**alone, "bodies": found}


def stored_scene(directory: Path, *, forces: bool = True) -> tuple[Scene, Machine]:
    """Scene and mechanism of a run from its folder, perhaps without what acts on it.

    Nothing is meshed or reduced: a model, which is a program, is not run again.

    Raises
    ------
    SettingsError, BodyFileError
        Of its files.
    """
    scene = as_stored(directory / SCENE_NAME)
    if not forces:
        scene = attrs.evolve(scene, forces={})
    return scene, build(scene, bodies=stored_bodies(scene, directory))


def stored_bodies(scene: Scene, directory: Path) -> dict[str, ReducedBody]:
    """Flexible bodies of a run from its folder.

    Raises
    ------
    BodyFileError
        A file is missing or cannot be read.
    """
    return {name: load_body(directory / BODY_FILE.format(name)) for name in flexible(scene)}


def _fingerprints(scene: Scene, built: Machine) -> dict[str, str]:
    """Digests of scene, tables and bodies: a run goes on only with those it began with."""
    found = {SCENE_NAME: hashlib.sha256(scene_text(scene).encode())}
    for path in dict.fromkeys(csv_files(scene.tables)):
        # A name in HDF5 has no slash, and files of several folders may have the same one.
        found.setdefault(path.name, hashlib.sha256()).update(path.read_bytes())
    digests = {name: digest.hexdigest() for name, digest in found.items()}
    return digests | {
        BODY_FILE.format(name): body_digest(body) for name, body in built.bodies.items()
    }


def run_accurately(
    scene: Scene,
    built: Machine,
    directory: Path,
    search: Search | None,
    *,
    interval: float = CHECKPOINT_EVERY,
    former: Checkpoint | None = None,
    multiplier: bool = False,
    told: Callable[[Search], None] = lambda search: None,
) -> tuple[Scene, Machine, dict[str, Any]]:
    """Run a scene as `run_scene` does, and then others while its search wants them; serial.

    Parameters
    ----------
    scene, built
        Of the first run, see `fenics_ehd.scenes.accuracy.begun`.
    directory, interval, former, multiplier
        See `run_scene`; the folder has the last run.
    search
        None: there is one run.
    told
        Of a search that goes on.

    Returns
    -------
    scene, built, summary
        Of the last run.
    """
    while True:
        summary = run_scene(
            scene,
            built,
            directory,
            interval=interval,
            former=former,
            multiplier=multiplier,
            search=search,
        )
        if search is None:
            return scene, built, summary
        if not search.wanted:
            search.leave(directory)
            return scene, built, summary
        told(search)
        # Whoever finds the folder so, finds no result that is not that of its scene.
        for name in (SUMMARY, FIELDS_NAME):
            (directory / name).unlink(missing_ok=True)
        former, last = None, scene
        scene = search.go_on(scene)
        bodies = {
            name: body
            for name, body in built.bodies.items()
            if scene.bodies[name] == last.bodies[name]
        }
        built = build(scene, bodies=bodies)
