"""Runs of a scene that are stored in a folder, with everything that is needed to resume them.

A scene that requires an accuracy is run again with other settings until a run meets the accuracy.

Imports inside functions: rigid scenes do not need the modules of static responses.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from fenics_ehd.analysis.flexibility_check import EXACT, PartInMemory
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
from fenics_ehd.base.progress import SILENT, Progress, chosen_progress
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
    summarised_run,
    written_by_run,
)
from fenics_ehd.scenes.accuracy import Search, account, search_of, start_search
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

if TYPE_CHECKING:
    from fenics_ehd.reduction.structure import Structure


def run(
    scene: Scene,
    folder: str | Path,
    *,
    resume: bool = False,
    overwrite: bool = False,
    cache: bool = True,
    progress: Progress | bool = True,
) -> History:
    """Run a scene and store it in a folder, as ``fenics-ehd run`` does without pictures; one rank.

    Parameters
    ----------
    scene
        Scene as read. To resume a run, give the scene with which it was started.
    folder
        Folder of the results; it is created if it does not exist.
    resume
        Whether the interrupted run in the folder is resumed.
    overwrite
        Whether a complete result in the folder may be replaced.
    cache
        Whether reduced bodies are read from the user's cache and kept there, see `build`.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the parts of
        the work open their stages.

    Returns
    -------
    History
        History as `load_history` reads it from the folder; its summary has the status of the run.

    Raises
    ------
    InputError, InUseError
        The folder cannot be used, or another process uses it.
    SettingsError, MeshError, BodyFileError, SolverError
        The scene or a part of it cannot be used, or the run failed.
    """
    require_class("scene", scene, Scene)
    require_class("folder", folder, str, Path)
    shown = chosen_progress(progress)
    directory = Path(folder)
    require_writable(directory / SUMMARY)
    if resume:
        with RunFolder(directory, resume=True) as held:
            _require_same(scene, held.path)
            # A folder with a complete periodic solution has its last cycle, but no checkpoint.
            if "cycles" not in (complete_result(held.path) or {}):
                stored_run = stored_scene(held.path)
                former = load_run_state(held.path)
                run_accurately(
                    *stored_run,
                    held.path,
                    search_of(held.path),
                    former=former,
                    cache=cache,
                    progress=shown,
                )
        return load_history(directory)
    scene, search = start_search(stored(scene))
    require_kept(directory, input_files("", scene), written_by_run(flexible(scene)))
    with RunFolder(directory, flexible(scene), overwrite=overwrite) as held:
        built = build(scene, cache=cache, progress=shown)
        run_accurately(scene, built, held.path, search, cache=cache, progress=shown)
    return load_history(directory)


def _require_same(scene: Scene, directory: Path) -> None:
    """Refuse to resume a run of another scene, except for settings that a search changes.

    Raises
    ------
    SettingsError
        A setting differs from that of the run; the message names its key.
    """
    if scene.output.accuracy:
        return
    asked = dict(by_key(stored(scene).tables))
    recorded = dict(by_key(as_stored(directory / SCENE_NAME).tables))
    for key in {**asked, **recorded}:
        if asked.get(key) != recorded.get(key):
            raise SettingsError(
                f"{key} = {asked.get(key)!r}, but the run in {directory} has "
                f"{recorded.get(key)!r}: resume the run with the scene in its {SCENE_NAME}, or "
                "choose another folder"
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
    progress: Progress = SILENT,
    between: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Integrate a scene and write its results into a folder; on one rank.

    Parameters
    ----------
    scene, built
        Scene as read by `as_stored`, and the machine built from it.
    directory
        Existing folder for the results.
    interval
        Time between two checkpoints [s].
    former
        Checkpoint in this folder from which the run is resumed; None for a new run.
    alone
        Whether an error budget is estimated if the scene requires it. This is false for runs of a
        study, because these runs are compared with one another.
    multiplier
        Whether the largest Floquet multiplier of a periodic solution is computed.
    search
        Search for settings that meet an accuracy, to which the run is added; None without a search.
    progress
        Progress in which the run and the estimates open their stages.
    between
        Function that is called between two steps; it may raise an error, which ends the run.

    Returns
    -------
    dict
        Summary, as in ``summary.json``.

    Raises
    ------
    InputError, SolverError
        Raised by `record_run`.
    """
    if former is None:
        clear(directory)
        if search is not None:
            search.store(directory)
        write_whole(directory / SCENE_NAME, scene_text(scene))
        for name, body in built.bodies.items():
            save_body(body, directory / BODY_FILE.format(name))
    judge = None
    if alone and scene.output.error_budget and scene.films:
        judge = partial(
            _judged,
            scene=scene,
            search=search,
            parts=_parts_in_memory(scene, built, progress),
            verified=_verified_errors(built),
            progress=progress,
        )
    files = _file_digests(scene)
    return record_run(
        _recorder(scene, built),
        directory,
        _about(scene, built) | {"versions": versions(), "inputs": files},
        files | _body_digests(built),
        interval=interval,
        progress=progress,
        former=former,
        multiplier=multiplier,
        judge=judge,
        between=between,
    )


def summarise_scene(
    scene: Scene,
    built: Machine,
    between: Callable[[], None] = lambda: None,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Integrate a scene without files; return its summary, which is that of `run_scene`.

    The summary has no versions. The parameters are those of `run_scene`.

    Raises
    ------
    SolverError
        Raised by `Run.until` and `PeriodicSolver`.
    """
    return summarised_run(_recorder(scene, built), _about(scene, built), between, progress)


def _recorder(scene: Scene, built: Machine) -> Recorder:
    """Recorder of the run of a scene at its start."""
    run = Run(built.mechanism, built.steps, scene.span)
    time = scene.time
    cycles = (
        PeriodicSolver(run, scene.span, time.periodicity, time.cycles) if time.periodic else None
    )
    return Recorder(run, scene.span, cycles)


def _about(scene: Scene, built: Machine) -> dict[str, Any]:
    """Entries of the summary about the scene and its bodies."""
    return {
        "warnings": [*scene.warnings, *built.warnings],
        "scene": scene.name,
        **_reductions(built),
        "reduction_time_s": built.seconds,
    }


def _judged(
    recorded: Recorder,
    directory: Path,
    scene: Scene,
    search: Search | None,
    parts: Mapping[str, PartInMemory],
    verified: Mapping[str, float],
    progress: Progress,
) -> tuple[Budgets, dict[str, Any]]:
    """Estimate the errors of a run; return budgets by joint, and entries of the summary.

    The entries are about the errors, the status of the run, and the search for an accuracy.
    """
    budgets, entries = estimate_errors(recorded, directory, parts, progress)
    entries["verified_flexibility_errors"] = verified
    limit = scene.output.error_limit
    if search is not None:
        limit = max(limit, search.asked)
    entries["status"] = verdict(RunSummary(recorded, budgets), limit)
    if search is not None:
        entries |= account(search, scene, recorded, budgets, entries)
    return budgets, entries


def _verified_errors(built: Machine) -> dict[str, float]:
    """Verified errors of the flexibility by body, for bodies of M4 that are not exact."""
    each = {name: body.flexibility_error for name, body in built.bodies.items()}
    return {name: error for name, error in each.items() if error > EXACT}  # others have nan


def _parts_in_memory(scene: Scene, built: Machine, progress: Progress) -> dict[str, PartInMemory]:
    """Parts that were reduced by this process alone, by the name of their body."""
    if not built.reduced:
        return {}
    from fenics_ehd.reduction.family_responses import Responses, respond
    from fenics_ehd.reduction.static import StaticSolver, Work

    def responding(structure: Structure, solver: str) -> Callable[[np.ndarray], Responses]:
        def responses(pressures: np.ndarray) -> Responses:
            work = Work(progress=progress)
            return respond(StaticSolver(structure, solver=solver, work=work), pressures)

        return responses

    return {
        name: PartInMemory(
            built.bodies[name],
            responding(part.structure, scene.bodies[name].reduction.solver),
        )
        for name, part in built.reduced.items()
        if part.structure.comm.size == 1
    }


def _reductions(built: Machine) -> dict[str, Any]:
    """Summary entries with method and number of modes of every flexible body.

    A scene with at most one flexible body has the two entries also outside the entry ``bodies``.
    """
    by_body = {
        name: {"method": body.method, "modes": body.modes} for name, body in built.bodies.items()
    }
    if len(by_body) > 1:
        return {"bodies": by_body}
    single = next(iter(by_body.values()), {"method": "rigid", "modes": 0})
    return {**single, "bodies": by_body}


def stored_scene(directory: Path, *, forces: bool = True) -> tuple[Scene, Machine]:
    """Read scene and mechanism of a run from its folder, with loads only if `forces` is true.

    Nothing is meshed or reduced, so that a model, which is a program, is not executed.

    Raises
    ------
    SettingsError, BodyFileError
        The scene or a body in the folder cannot be used.
    """
    scene = as_stored(directory / SCENE_NAME)
    if not forces:
        scene = attrs.evolve(scene, forces={})
    return scene, build(scene, bodies=stored_bodies(scene, directory))


def stored_bodies(scene: Scene, directory: Path) -> dict[str, ReducedBody]:
    """Read the flexible bodies of a run from its folder, by name.

    Raises
    ------
    BodyFileError
        A file is missing or cannot be read.
    """
    return {name: load_body(directory / BODY_FILE.format(name)) for name in flexible(scene)}


def _file_digests(scene: Scene) -> dict[str, str]:
    """Checksums of scene and tables, by file name.

    A run is resumed only if these checksums, and those of its bodies, equal those at its start.
    """
    hashes = {SCENE_NAME: hashlib.sha256(scene_text(scene).encode())}
    for path in dict.fromkeys(csv_files(scene.tables)):
        # Names in HDF5 have no slash, and files in several folders may have the same name.
        hashes.setdefault(path.name, hashlib.sha256()).update(path.read_bytes())
    return {name: digest.hexdigest() for name, digest in hashes.items()}


def _body_digests(built: Machine) -> dict[str, str]:
    """Checksums of reduced bodies, which include the times of their reductions, by file name."""
    return {BODY_FILE.format(name): body_digest(body) for name, body in built.bodies.items()}


def run_accurately(
    scene: Scene,
    built: Machine,
    directory: Path,
    search: Search | None,
    *,
    interval: float = CHECKPOINT_EVERY,
    former: Checkpoint | None = None,
    multiplier: bool = False,
    announce: Callable[[Search], None] = lambda search: None,
    cache: bool = True,
    progress: Progress = SILENT,
) -> tuple[Scene, Machine, dict[str, Any]]:
    """Run a scene as `run_scene` does, and repeat it while the search proposes new settings.

    The function runs on one rank.

    Parameters
    ----------
    scene, built
        Scene and machine of the first run, see `fenics_ehd.scenes.accuracy.start_search`.
    directory, interval, former, multiplier, progress
        Passed to `run_scene`. At the end, the folder has the last run only.
    search
        Search for settings that meet an accuracy; None for a single run.
    announce
        Function that is called with the search before every further run.
    cache
        See `build`.

    Returns
    -------
    scene, built, summary
        Scene, machine and summary of the last run.
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
            progress=progress,
        )
        if search is None:
            return scene, built, summary
        if not search.wanted:
            search.store(directory)
            return scene, built, summary
        announce(search)
        # The folder must not hold results of a scene other than the one stored in it.
        for name in (SUMMARY, FIELDS_NAME):
            (directory / name).unlink(missing_ok=True)
        former = None
        last = scene
        scene = search.continue_search(scene)
        bodies = {
            name: body
            for name, body in built.bodies.items()
            if scene.bodies[name] == last.bodies[name]
        }
        built = build(scene, bodies=bodies, cache=cache, progress=progress)
