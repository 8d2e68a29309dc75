"""Tasks of the workers of a study or sweep: reduce the bodies of one part, or run one case.

A case is run by a function of plain values that returns plain values, so that any
`concurrent.futures.Executor` can call it. Bodies are passed as paths of files or as their bytes;
files of the run are returned as bytes, which the caller writes. A case runs on one process
(``MPI.COMM_SELF``) with one BLAS thread, and a process runs one case at a time. Files to which a
scene refers, such as tables, are read on the machine that runs the case.

Errors are returned as one line of text, because exceptions may not survive pickling, and the error
of a film holds arrays.

The time that a reduction took is stored in the body's provenance. The time of a part's first body
includes mesh and matrices; later bodies of the part reuse factors, modes and responses. If all
bodies of a part are in the cache, they are read from the cache.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.files import SUMMARY, listed
from fenics_ehd.base.processes import one_blas_thread
from fenics_ehd.base.progress import written_progress
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.reduction.body import ReducedBody, load_body, save_body
from fenics_ehd.results.recorded_run import BODY_FILE, RunFolder
from fenics_ehd.scenes.build import build
from fenics_ehd.scenes.kept_bodies import Entry
from fenics_ehd.scenes.needed_bodies import NeededBody
from fenics_ehd.scenes.part import PROCESSOR_SECONDS, SECONDS, elastic_part, kept_entry
from fenics_ehd.scenes.run import run_scene
from fenics_ehd.scenes.scene import flexible
from fenics_ehd.study.cases import Case

#: Status of a run whose results can be trusted.
COMPLETE = "complete"


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
    failures
        Outcomes of the bodies whose reduction failed, by the checksum that names their file.
    """

    reduced: int
    read: int
    failures: Mapping[str, Outcome]


@dataclass(frozen=True)
class PartTask:
    """Bodies of one part that are reduced in one process.

    Attributes
    ----------
    bodies
        Bodies in the order in which they are reduced.
    progress
        Path of the file to which the process writes its progress.
    """

    bodies: Sequence[NeededBody]
    progress: Path | None = None

    @property
    def name(self) -> str:
        """Name of the part in a progress."""
        return f"reduction of {self.bodies[0].key.rpartition('.')[2]}"


def reduce_part(task: PartTask, directory: Path) -> Reductions:
    """Reduce bodies of one part in this process, or read all from the cache; save each to a file.

    Parameters
    ----------
    task
        Bodies of the part.
    directory
        Folder of all reduced bodies; a body is saved as soon as it is reduced.
    """
    comm = MPI.COMM_SELF
    bodies = task.bodies
    progress = written_progress(task.progress)
    directory.mkdir(parents=True, exist_ok=True)
    entries: list[Entry] = []
    for body in bodies:
        settings = body.settings, body.key, body.film_element, body.film_edges
        # Only the intermediate results of the same bodies before give the same bits.
        entries.append(kept_entry(*settings, comm, after=[entry.name for entry in entries]))
    kept = [entry.body() for entry in entries]
    read = [body for body in kept if body is not None]
    if len(read) == len(bodies):
        for body, known in zip(bodies, read, strict=True):
            save_body(known, body_path(directory, body))
        return Reductions(0, len(read), {})
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
        return Reductions(0, 0, {body.name: failed(error) for body in bodies})
    failures = {}
    with progress.stage("bodies", len(bodies)) as stage:
        for body, entry in zip(bodies, entries, strict=True):
            try:
                part = replace(part, settings=body.settings, entry=entry)
                save_body(part.reduce(reductor=reductor).body, body_path(directory, body))
                part = replace(part, spent=np.zeros(2))
            except Exception as error:
                failures[body.name] = failed(error)
            stage.add()
    return Reductions(len(bodies) - len(failures), 0, failures)


@dataclass(frozen=True)
class StoredBody:
    """File of a reduced body, as a path or as its bytes.

    Attributes
    ----------
    path
        Path of the file on the caller's machine.
    content
        Bytes of the file; None if the worker can read the path.
    """

    path: Path
    content: bytes | None = None

    def load(self, directory: Path) -> ReducedBody:
        """Load the body; bytes are first written to a file in the folder `directory`.

        Raises
        ------
        BodyFileError
            The file cannot be read, see `load_body`.
        """
        if self.content is None:
            return load_body(self.path)
        copy = directory / self.path.name
        copy.write_bytes(self.content)
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
        Path of the file to which the process writes its progress; None if the process may be on
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


#: Lock so that a process runs one case at a time: PETSc, form cache and working folder are shared.
_ALONE = threading.Lock()


def run_case(task: CaseTask) -> CaseResult:
    """Run a case as ``fenics-ehd run`` does; an error becomes the status of the outcome."""
    with (
        _ALONE,
        one_blas_thread(),
        TemporaryDirectory(prefix="fenics-ehd-", ignore_cleanup_errors=True) as scratch,
    ):
        directory = Path(scratch, task.case.name)
        try:
            summary = _summary(task, directory)
            outcome = Outcome(str(summary["status"]), summary)
        except Exception as error:
            outcome = Outcome(failed(error).status.replace(f"{directory}/", ""))
        return CaseResult(outcome, _files(directory) if task.keep else {})


def _summary(task: CaseTask, directory: Path) -> dict[str, Any]:
    """Run a case; return its summary with results about its bodies and film meshes.

    `directory` is the folder of the run.
    """
    scene = task.case.scene
    bodies = {name: body.load(directory.parent) for name, body in task.bodies.items()}
    built = build(scene, bodies=bodies)
    seconds = sum(float(body.provenance[SECONDS]) for body in bodies.values())
    timed = replace(built, seconds=seconds)
    with RunFolder(directory, flexible(scene), command=task.command) as folder:
        summary = run_scene(
            scene,
            timed,
            folder.path,
            interval=inf,
            alone=False,
            progress=written_progress(task.progress),
        )
    return summary | part_figures(bodies.values()) | {"film_cells": _film_cells(built.mechanism)}


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
