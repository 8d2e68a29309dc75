"""Many runs: their folder, a pool of processes, bodies made once, then the runs.

Errors come back from a process as text in one line: they may not survive the way themselves, and a
film that failed carries its arrays. A process that dies costs its own task only.

What a body took is in its provenance: of a part's first body mesh and matrices are included, a
later one adds little where it finds factors, modes and responses of those before it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from math import inf
from pathlib import Path
from time import perf_counter, process_time, sleep
from typing import Any, ClassVar, TypeVar

from mpi4py import MPI
from tqdm import tqdm

from fenics_ehd.base.errors import BodyFileError, EhdError, InputError, SettingsError
from fenics_ehd.base.files import (
    OUTCOME,
    claim,
    clear,
    locked,
    made_by,
    new_part,
    read_json,
    require_writable,
    to_json,
    write_whole,
)
from fenics_ehd.base.processes import begin_worker, interrupt_between_steps
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.reduction.body import ReducedBody, load_body, save_body
from fenics_ehd.reduction.reductor import Reductor
from fenics_ehd.reduction.structure import Structure
from fenics_ehd.results.recorded_run import BODY_FILE, RunFolder
from fenics_ehd.scenes.build import build
from fenics_ehd.scenes.needed_bodies import NeededBody
from fenics_ehd.scenes.part import elastic_part
from fenics_ehd.scenes.run import run_scene
from fenics_ehd.scenes.scene import flexible
from fenics_ehd.study.cases import Case

T = TypeVar("T")
R = TypeVar("R")

#: Time after which Ctrl-C is noticed [s].
POLL = 0.2


class WorkerDiedError(EhdError):
    """The process of a worker ended in the middle of its work."""


#: Status of a run whose figures can be trusted.
COMPLETE = "complete"


class FailedCasesError(EhdError):
    """Some cases failed; the rows of all others are complete."""


@dataclass(frozen=True)
class Outcome:
    """``"complete"`` or what went wrong, and the figures of a run that came to its end."""

    status: str
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """True where its figures can be trusted."""
        return self.status == COMPLETE


def failed(error: BaseException) -> Outcome:
    """Outcome of an error: its name and message."""
    return Outcome("failed: " + " ".join(f"{type(error).__name__}: {error}".rstrip(": ").split()))


def open_pool(workers: int | None) -> ProcessPool:
    """Processes, as many as cores where no number is given; a context.

    Raises
    ------
    SettingsError
        Several ranks were started.
    """
    if MPI.COMM_WORLD.size > 1:
        raise SettingsError(
            f"{MPI.COMM_WORLD.size} ranks: cases run in processes, --workers of them: leave mpirun"
        )
    return ProcessPool(workers or len(os.sched_getaffinity(0)))


def outcomes(
    pool: ProcessPool,
    function: Callable[[T], R],
    tasks: Iterable[T],
    check: Callable[[], None],
) -> Iterator[tuple[T, R | Outcome]]:
    """Results of tasks as they end; of one whose process died, for want of memory say, why.

    Parameters
    ----------
    pool
        The workers.
    function
        Called with every task.
    tasks
        What to do.
    check
        Called a few times a second; may raise `KeyboardInterrupt`.
    """
    waiting = {pool.submit(function, task): task for task in tasks}
    while waiting:
        ended, _ = wait(waiting, POLL, FIRST_COMPLETED)
        check()
        for future in ended:
            yield waiting.pop(future), future.result()


class ProcessPool(AbstractContextManager["ProcessPool"]):
    """Processes of this machine, for each a thread that waits for it, and an executor of its own.

    An executor takes all of its processes with it when one dies. They are spawned: MPI and PETSc
    do not survive a fork. They end with this process, even if it is killed.
    """

    def __init__(self, width: int):
        self.width = width
        self._threads = ThreadPoolExecutor(width, initializer=_block_interrupts)
        self._executors: dict[int, ProcessPoolExecutor] = {}
        self._futures: list[Future[Any]] = []
        self._others = set(multiprocessing.active_children())

    def submit(self, function: Callable[[T], R], task: T) -> Future[R | Outcome]:
        """Have a task done by the next process that is free."""
        future = self._threads.submit(self._answer, function, task)
        self._futures.append(future)
        return future

    def _answer(self, function: Callable[[T], R], task: T) -> R | Outcome:
        """Answer of this thread's process, or that it died."""
        thread = threading.get_ident()
        try:
            future = self._executors[thread].submit(function, task)
        except (KeyError, BrokenExecutor):
            self._executors[thread] = ProcessPoolExecutor(
                1, multiprocessing.get_context("spawn"), initializer=begin_worker
            )
            future = self._executors[thread].submit(function, task)
        if isinstance(future.exception(), BrokenExecutor):
            return failed(WorkerDiedError("its process ended, for want of memory perhaps"))
        return future.result()

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        while not all(future.done() for future in self._futures):
            # PETSc answers a mere termination with a page of advice.
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
            sleep(POLL)
        for executor in self._executors.values():
            executor.shutdown()


def _block_interrupts() -> None:
    """Processes that this thread starts do not see Ctrl-C, nor the end of the terminal.

    It tells all of them, and it is for the first one to end the others.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})


#: Entries of a body's provenance: what it took, by the clock and of the processor.
SECONDS = "reduction_time_s"
PROCESSOR_SECONDS = "reduction_processor_time_s"


def body_path(directory: Path, body: NeededBody) -> Path:
    """File of a reduced body in the folder of all of them."""
    return directory / f"{body.name}.h5"


def reduce_missing(
    cases: Iterable[Case], directory: Path, pool: ProcessPool, check: Callable[[], None]
) -> Mapping[str, Outcome]:
    """Reduce what cases need and is not there, or cannot be read; those that failed, by name."""
    needed = {body.name: body for case in cases for body in case.bodies.values()}
    parts: dict[str, list[NeededBody]] = {}
    for body in needed.values():
        if not _there(body_path(directory, body)):
            parts.setdefault(body.part, []).append(body)
    reduce = partial(reduce_part, directory=directory)
    failures: dict[str, Outcome] = {}
    for bodies, answer in outcomes(pool, reduce, map(in_turn, parts.values()), check):
        if isinstance(answer, Outcome):
            lost = (body for body in bodies if not _there(body_path(directory, body)))
            failures |= {body.name: answer for body in lost}
        else:
            failures |= answer
    return failures


def in_turn(bodies: Iterable[NeededBody]) -> Sequence[NeededBody]:
    """Reductions that share most beside each other, the largest first: see `Reductor`."""

    def order(body: NeededBody) -> Any:
        r = body.settings.reduction
        return r.method, r.pressure_set, -r.vibration_modes, -r.modes, -r.residual_modes

    return sorted(bodies, key=order)


def _there(path: Path) -> bool:
    try:
        load_body(path)
    except BodyFileError:
        return False
    return True


def reduce_part(bodies: Sequence[NeededBody], directory: Path) -> dict[str, Outcome]:
    """Reduce bodies of one part on this process alone and save them; those that failed."""
    clocks = perf_counter(), process_time()
    first = bodies[0]
    try:
        part = elastic_part(first.settings, first.key, first.film_element, MPI.COMM_SELF)
        assert isinstance(part.source, Structure)
        reductor = Reductor(part.source, solver=first.settings.reduction.solver)
    except Exception as error:
        return {body.name: failed(error) for body in bodies}
    failures = {}
    directory.mkdir(parents=True, exist_ok=True)
    for body in bodies:
        try:
            made = replace(part, settings=body.settings).reduce(reductor=reductor)
            seconds = perf_counter() - clocks[0], process_time() - clocks[1]
            taken = dict(zip((SECONDS, PROCESSOR_SECONDS), map(repr, seconds), strict=True))
            kept = replace(made.body, provenance={**made.body.provenance, **taken})
            save_body(kept, body_path(directory, body))
        except Exception as error:
            failures[body.name] = failed(error)
        clocks = perf_counter(), process_time()
    return failures


def part_figures(bodies: Collection[ReducedBody]) -> dict[str, float]:
    """Figures of the bodies of a run, all together.

    Returns
    -------
    dict
        ``coordinates``, ``highest_frequency_Hz``, ``offline_s`` (processor time that they added),
        ``pressure_columns`` and ``dropped_columns`` of what depends on the others.
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


class OtherFolderError(InputError):
    """A folder holds another study or sweep, or what this program did not write."""

    def __init__(self, path: Path, reason: str):
        super().__init__(
            f"{path}: of another study or sweep ({reason}): choose another folder or --overwrite"
        )


#: What damaged files lead to: the last two where something is missing, or numbers do not fit.
DAMAGE = (EhdError, KeyError, ValueError)


class RunsFolder(ExitStack):
    """Folder of many runs, ``runs/NAME`` each, and their bodies, held by one process at a time.

    A run that is complete, of the same settings and version, is not made again.

    Parameters
    ----------
    directory
        Created when missing.
    cases
        Runs of the folder.
    made
        What is kept there beside reduced bodies, which are named by what they are and stay. The
        first of it is a JSON file that says what the runs are of.
    about
        Its entries that must be these where it is there.
    overwrite
        Begin anew, whatever was made there.

    Attributes
    ----------
    command
        That makes such folders.
    cases, outcomes
        Runs by name, and what came of those that ended.

    Raises
    ------
    OtherFolderError
        It is that of something else.
    InputError
        It cannot be written to, or holds files of others under these names.
    InUseError
        Another process works in it.
    """

    command: ClassVar[str]

    def __init__(
        self,
        directory: str | Path,
        cases: Iterable[Case],
        made: Sequence[str],
        about: Mapping[str, Any],
        *,
        overwrite: bool = False,
    ):
        super().__init__()
        self.path = Path(directory)
        self.cases = {case.name: case for case in cases}
        self.outcomes: dict[str, Outcome] = {}
        require_writable(self.path)
        self.path.mkdir(parents=True, exist_ok=True)
        with ExitStack() as held:
            held.enter_context(locked(self.path))
            claim(self.path, (*made, "bodies/"), self.command)
            if overwrite:
                clear(self.path, made)
            claim(self.path / "runs", [f"{name}/" for name in self.cases], self.command)
            self._require_same(self.path / made[0], about)
            self.push(held.pop_all())

    def write_tables(self) -> None:
        """Write tables of the runs that ended."""

    def _require_same(self, path: Path, about: Mapping[str, Any]) -> None:
        """Refuse what was made of something else."""
        if not path.exists():
            return
        try:
            theirs = dict(read_json(path))
        except (OSError, ValueError, TypeError):
            raise OtherFolderError(path, "it is unreadable") from None
        for key, ours in about.items():
            if theirs.get(key) != ours:
                raise OtherFolderError(path, f"{key} = {theirs.get(key)} there, {ours} here")

    @property
    def bodies(self) -> Path:
        """Folder of the reduced bodies."""
        return self.path / "bodies"

    def run(self, name: str) -> Path:
        """Folder of a run."""
        return self.path / "runs" / name

    def write(self, name: str, values: Mapping[str, Any]) -> None:
        """Write a JSON file, whole or not at all."""
        write_whole(self.path / name, to_json(values) + "\n")

    def read(self, name: str) -> None:
        """Read the files of a complete run, as far as something is made of them."""

    def stored(self, name: str) -> Outcome | None:
        """Outcome of a run; None: it did not run, with other settings or version, or is damaged."""
        try:
            found = read_json(self.run(name) / OUTCOME)
            if found["identity"] != self.cases[name].identity:
                return None
            outcome = Outcome(found["status"], found["figures"])
            if outcome.complete:
                self.read(name)
        except (*DAMAGE, OSError, TypeError):
            return None
        return outcome

    def take_stock(self) -> list[Case]:
        """Account for what is there; cases that are not complete."""
        found = {name: self.stored(name) for name in self.cases}
        self.outcomes = {name: outcome for name, outcome in found.items() if outcome is not None}
        complete = {name for name, outcome in self.outcomes.items() if outcome.complete}
        return [case for name, case in self.cases.items() if name not in complete]

    def add(self, name: str, outcome: Outcome) -> None:
        """Account for a run that ended, on the disk too; with unusable files it has failed."""
        try:
            if outcome.complete:
                self.read(name)
        except DAMAGE as error:
            outcome = failed(error)
        claim(self.run(name), [OUTCOME])
        contents = {
            "identity": self.cases[name].identity,
            "status": outcome.status,
            "figures": outcome.figures,
        }
        self.write(f"runs/{name}/{OUTCOME}", contents)
        self.outcomes[name] = outcome
        self.write_tables()


def run_cases(
    folder: RunsFolder, cases: Sequence[Case], pool: ProcessPool, *, keep: bool = True
) -> None:
    """Run cases as ``fenics-ehd run`` does, those whose body fails first; Ctrl-C between two.

    Parameters
    ----------
    folder
        Of all cases, which accounts for each that ended.
    cases
        In the order in which they begin.
    pool
        Workers.
    keep
        Whether results of each stay in its folder.
    """
    with (
        tqdm(
            total=len(folder.cases),
            initial=len(folder.cases) - len(cases),
            unit="case",
            file=sys.stderr,
            mininterval=0.2 if sys.stderr.isatty() else 10.0,
        ) as bar,
        interrupt_between_steps() as check,
    ):
        failures = reduce_missing(cases, folder.bodies, pool, check)
        lost = {
            case: failures[body.name]
            for case in cases
            for body in case.bodies.values()
            if body.name in failures
        }
        ready = [case for case in cases if case not in lost]
        run = partial(run_case, bodies=folder.bodies, runs=folder.path / "runs", keep=keep)
        incomplete = 0
        for case, outcome in chain(lost.items(), outcomes(pool, run, ready, check)):
            folder.add(case.name, outcome)
            incomplete += not outcome.complete
            bar.set_postfix_str(f"{incomplete} failed", refresh=False)
            bar.update()


def run_case(case: Case, bodies: Path, runs: Path, keep: bool) -> Outcome:
    """Run a case anew into its folder; what ends it early is its status.

    Parameters
    ----------
    case
        What is run.
    bodies, runs
        Folders of all reduced bodies and of all runs.
    keep
        Whether the results stay.

    Returns
    -------
    Outcome
        Its figures are those of its summary, of its bodies, and the cells of its films by joint.
    """
    directory = runs / case.name
    clear(directory)
    try:
        summary = _run(case, bodies, directory)
    except Exception as error:
        return failed(error)
    finally:
        if not keep:
            clear(directory)
    return Outcome(str(summary["status"]), summary)


def _run(case: Case, bodies: Path, directory: Path) -> dict[str, Any]:
    files = {name: body_path(bodies, body) for name, body in case.bodies.items()}
    loaded = {name: load_body(path) for name, path in files.items()}
    built = build(case.scene, bodies=loaded)
    seconds = sum(float(body.provenance[SECONDS]) for body in loaded.values())
    with RunFolder(directory, flexible(case.scene), command=made_by(directory.parent)) as folder:
        try:
            own = replace(built, seconds=seconds)
            summary = run_scene(case.scene, own, folder.path, interval=inf, alone=False)
        finally:
            for name, path in files.items():
                _share(path, folder.path / BODY_FILE.format(name))
    return summary | part_figures(loaded.values()) | {"film_cells": _film_cells(built.mechanism)}


def _film_cells(mechanism: Mechanism) -> dict[str, str]:
    """Cells around and along of the film in every lubricated joint, ``"20x5"``."""
    films = {n: j.film for n, j in mechanism.joints.items() if isinstance(j, LubricatedJoint)}
    grids = {name: film.parameters.grid for name, film in films.items()}
    return {n: f"{len(grid.angles) - 1}x{len(grid.heights) - 1}" for n, grid in grids.items()}


def _share(file: Path, copy: Path) -> None:
    """Have a copy share the file's place on the disk: many runs have a body in common."""
    with suppress(OSError):  # a file system without links: the copy stays
        link = new_part(copy)
        link.unlink()
        os.link(file, link)
        link.replace(copy)
