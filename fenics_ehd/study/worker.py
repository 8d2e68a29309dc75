"""Tasks of the workers of a study or sweep: reduce the bodies of one part, or run one case.

A case is run by a function of plain values that returns plain values, so that any
`concurrent.futures.Executor` can call it. Files are returned as bytes, which the caller writes. A
case runs on one process (``MPI.COMM_SELF``) with one BLAS thread, and a process runs one case at a
time. Files to which a scene refers, such as tables, are read on the machine that runs the case.

A task names its bodies by the checksums of their files. A worker keeps the last bodies in memory. A
body that it does not have is read from the file of the caller, if the worker can read that file. If
it cannot, it returns the task, and the caller sends the task again with the bytes of the body.

Errors are returned as one line of text, because exceptions may not survive pickling, and the error
of a film holds arrays.

The time that a reduction took is stored in the body's provenance. The time of a part's first body
includes mesh and matrices; later bodies of the part reuse factors, modes and responses. If all
bodies of a part are in the cache, they are read from the cache.
"""

from __future__ import annotations

import os
import platform
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from hashlib import sha256
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import EhdError
from fenics_ehd.base.files import SUMMARY, listed
from fenics_ehd.base.processes import one_blas_thread
from fenics_ehd.base.progress import written_progress
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.verdict import COMPLETE
from fenics_ehd.reduction.body import ReducedBody, load_body, save_body
from fenics_ehd.results.recorded_run import BODY_FILE, RunFolder
from fenics_ehd.scenes.build import Machine, build
from fenics_ehd.scenes.kept_bodies import Entry
from fenics_ehd.scenes.needed_bodies import NeededBody
from fenics_ehd.scenes.part import PROCESSOR_SECONDS, SECONDS, elastic_part, kept_entry
from fenics_ehd.scenes.run import run_scene, summarise_scene
from fenics_ehd.scenes.scene import Scene, flexible
from fenics_ehd.study.cases import Case
from fenics_ehd.study.scheduler import require_wanted


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run: its status, and its results.

    Attributes
    ----------
    status
        ``"complete"``, or the reason why the run has failed.
    figures
        Results of a run that reached its end, by name.
    """

    status: str
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """True if the run has reached its end and its results are valid."""
        return self.status == COMPLETE


def failed(error: BaseException) -> Outcome:
    """Outcome of a run that ended with an exception; the status has its class and message."""
    return Outcome("failed: " + " ".join(f"{type(error).__name__}: {error}".rstrip(": ").split()))


def body_path(directory: Path, body: NeededBody) -> Path:
    """Path of a body's file in the folder of all reduced bodies."""
    return directory / f"{body.name}.h5"


@dataclass(frozen=True)
class Reductions:
    """Bodies of one part that were reduced or read from the cache.

    Attributes
    ----------
    reduced, read
        Number of bodies that were reduced, and number of bodies that were read from the cache.
    files
        Contents of the files of all bodies, by the checksum that names the file.
    failures
        Outcomes of the bodies whose reduction failed, by the checksum that names their file.
    """

    reduced: int
    read: int
    files: Mapping[str, bytes]
    failures: Mapping[str, Outcome]


@dataclass(frozen=True)
class PartTask:
    """Bodies of one part that are reduced in one process.

    Attributes
    ----------
    bodies
        Bodies of the same part, in the order in which they are reduced.
    progress
        Path of the file to which the worker writes its progress; None if the worker may be on
        another machine.
    """

    bodies: Sequence[NeededBody]
    progress: Path | None = None

    @property
    def name(self) -> str:
        """Name of the task in a progress."""
        return f"reduction of {self.bodies[0].key.rpartition('.')[2]}"


#: Lock so that a process runs one task at a time: PETSc, Gmsh, form cache and working folder are
#: shared.
_ALONE = threading.Lock()


def reduce_part(task: PartTask) -> Reductions:
    """Reduce bodies of one part in this process, or read all from the cache."""
    with _ALONE, one_blas_thread():
        return _reduced_part(task)


def _reduced_part(task: PartTask) -> Reductions:
    comm = MPI.COMM_SELF
    bodies = task.bodies
    progress = written_progress(task.progress)
    entries: list[Entry] = []
    for body in bodies:
        settings = body.settings, body.key, body.film_element, body.film_edges
        # Only the intermediate results of the same bodies before give the same bits.
        entries.append(kept_entry(*settings, comm, after=[entry.name for entry in entries]))
    kept = [entry.body() for entry in entries]
    read = [body for body in kept if body is not None]
    if len(read) == len(bodies):
        files = {body.name: _content(known) for body, known in zip(bodies, read, strict=True)}
        return Reductions(0, len(read), files, {})
    first = bodies[0]
    try:
        part = elastic_part(
            first.settings,
            first.key,
            first.film_element,
            comm,
            first.film_edges,
            progress=progress,
        )
        reductor = part.reductor() if len(bodies) > 1 else None
    except Exception as error:
        return Reductions(0, 0, {}, {body.name: failed(error) for body in bodies})
    files = {}
    failures = {}
    with progress.stage("bodies", len(bodies)) as stage:
        for body, entry in zip(bodies, entries, strict=True):
            try:
                part = replace(part, settings=body.settings, entry=entry)
                files[body.name] = _content(part.reduce(reductor=reductor).body)
                part = replace(part, spent=np.zeros(2))
            except Exception as error:
                failures[body.name] = failed(error)
            stage.add()
    return Reductions(len(files), 0, files, failures)


def _content(body: ReducedBody) -> bytes:
    """Content of the file of a reduced body."""
    with TemporaryDirectory(prefix="fenics-ehd-") as folder:
        path = Path(folder, "body.h5")
        save_body(body, path)
        return path.read_bytes()


#: Number of reduced bodies that a worker keeps in memory; a body has 1 to 40 MB.
KEPT_BODIES = 8


class MissingBodyError(EhdError):
    """A worker does not have the file of a body."""


@dataclass(frozen=True)
class StoredBody:
    """File of a reduced body; two objects with equal checksums are equal.

    Attributes
    ----------
    checksum
        SHA-256 checksum of the content of the file.
    path
        Path of the file on the caller's machine.
    content
        Bytes of the file; None if the worker may have the body, or may be able to read the file.
    """

    checksum: str
    path: Path = field(compare=False)
    content: bytes | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(cls, path: Path) -> StoredBody:
        """Make the object of a file, without the bytes of the file."""
        return cls(sha256(path.read_bytes()).hexdigest(), path)

    def with_content(self) -> StoredBody:
        """Return a copy with the bytes of the file."""
        return replace(self, content=self.path.read_bytes())


@lru_cache(maxsize=KEPT_BODIES)
def _body(stored: StoredBody) -> ReducedBody:
    """Load a body from its bytes, or from its file if the file is that of the caller.

    Raises
    ------
    MissingBodyError
        There are no bytes, and the worker cannot read the file.
    BodyFileError
        The file is damaged, see `load_body`.
    """
    content = stored.content
    if content is None:
        try:
            content = stored.path.read_bytes()
        except OSError as error:
            raise MissingBodyError(str(error)) from None
    if sha256(content).hexdigest() != stored.checksum:
        raise MissingBodyError(f"{stored.path} has another checksum than the body of the case")
    with TemporaryDirectory(prefix="fenics-ehd-") as folder:
        copy = Path(folder, stored.path.name)
        copy.write_bytes(content)
        return load_body(copy)


@dataclass(frozen=True)
class CaseTask:
    """A case together with all data that its run needs.

    Attributes
    ----------
    case
        Case to run.
    bodies
        Files of its reduced bodies, by their names in the scene.
    command
        Command that owns the run's folder, ``"study"`` or ``"sweep"``.
    keep
        Whether the files of the run are returned.
    progress
        Path of the file to which the worker writes its progress; None if the worker may be on
        another machine.
    """

    case: Case
    bodies: Mapping[str, StoredBody]
    command: str
    keep: bool
    progress: Path | None = None

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.case.name


@dataclass(frozen=True)
class CaseResult:
    """Result of running a case.

    Attributes
    ----------
    outcome
        Outcome, with the run's summary, the results of `part_figures`, and ``film_cells`` by joint.
    files
        Contents of the run's files by name, summary last, without bodies; empty if not kept.
    """

    outcome: Outcome
    files: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class MissingBodies:
    """Answer of a worker that does not have the bodies of a case.

    Attributes
    ----------
    names
        Names of these bodies in the scene.
    worker
        Name of the worker: host and number of the process.
    """

    names: tuple[str, ...]
    worker: str


def run_case(task: CaseTask) -> CaseResult | MissingBodies:
    """Run a case as ``fenics-ehd run`` does; an error becomes the status of the outcome."""
    with _ALONE, one_blas_thread():
        bodies = {}
        missing = []
        try:
            for name, stored in task.bodies.items():
                try:
                    bodies[name] = _body(stored)
                except MissingBodyError:
                    missing.append(name)
            if missing:
                return MissingBodies(tuple(missing), f"{platform.node()} {os.getpid()}")
            if not task.keep:
                summarise = partial(summarise_scene, progress=written_progress(task.progress))
                return CaseResult(_outcome(task.case.scene, bodies, summarise))
        except Exception as error:
            return CaseResult(failed(error))
        return _stored_run(task, bodies)


def _stored_run(task: CaseTask, bodies: Mapping[str, ReducedBody]) -> CaseResult:
    """Run a case in a temporary folder, and return its result with the files of the run."""
    scene = task.case.scene
    with TemporaryDirectory(prefix="fenics-ehd-", ignore_cleanup_errors=True) as scratch:
        directory = Path(scratch, task.case.name)

        def run(scene: Scene, built: Machine, between: Callable[[], None]) -> dict[str, Any]:
            with RunFolder(directory, flexible(scene), command=task.command) as folder:
                return run_scene(
                    scene,
                    built,
                    folder.path,
                    interval=inf,
                    alone=False,
                    between=between,
                    progress=written_progress(task.progress),
                )

        try:
            outcome = _outcome(scene, bodies, run)
        except Exception as error:
            outcome = Outcome(failed(error).status.replace(f"{directory}/", ""))
        return CaseResult(outcome, _files(directory))


def _outcome(
    scene: Scene,
    bodies: Mapping[str, ReducedBody],
    run: Callable[[Scene, Machine, Callable[[], None]], dict[str, Any]],
) -> Outcome:
    """Build and run a scene; add the results about its bodies and film meshes to its summary.

    `run` is a function of the scene, its machine, and a function that is called between two steps.
    """
    built = build(scene, bodies=bodies)
    seconds = sum(float(body.provenance[SECONDS]) for body in bodies.values())
    summary = run(scene, replace(built, seconds=seconds), require_wanted)
    summary |= part_figures(bodies.values()) | {"film_cells": _film_cells(built.mechanism)}
    return Outcome(str(summary["status"]), summary)


def _files(directory: Path) -> dict[str, bytes]:
    """Contents of the files in a run's folder by name, summary last, without reduced bodies."""
    bodies = BODY_FILE.partition("{")[0]
    names = [
        name
        for name in listed(directory)
        if not name.startswith(bodies) and (directory / name).is_file()
    ]
    names.sort(key=lambda name: name == SUMMARY)
    return {name: (directory / name).read_bytes() for name in names}


def part_figures(bodies: Collection[ReducedBody]) -> dict[str, float]:
    """Sums and extremes over the reduced bodies of a run.

    Returns
    -------
    dict
        ``coordinates``: number of modes; ``highest_frequency_Hz``; ``offline_s``: processor time of
        the reductions; ``pressure_columns``: number of nodal pressures in all bores;
        ``dropped_columns``: number of static modes that were dropped as linearly dependent.
    """
    return {
        "coordinates": sum(body.modes for body in bodies),
        "highest_frequency_Hz": max(
            (float(body.frequencies.max(initial=0.0)) for body in bodies), default=0.0
        ),
        "offline_s": sum(float(body.provenance[PROCESSOR_SECONDS]) for body in bodies),
        "pressure_columns": sum(
            len(bore.pressure_coordinates) for body in bodies for bore in body.bores.values()
        ),
        "dropped_columns": sum(int(body.accuracy.get("static_dropped", 0)) for body in bodies),
    }


def _film_cells(mechanism: Mechanism) -> dict[str, str]:
    """Numbers of film cells around and along by lubricated joint, as text ``"20x5"``."""
    grids = {
        name: joint.film.parameters.grid
        for name, joint in mechanism.joints.items()
        if isinstance(joint, LubricatedJoint)
    }
    return {name: f"{len(grid.angles) - 1}x{len(grid.heights) - 1}" for name, grid in grids.items()}
