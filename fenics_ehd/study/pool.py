"""Folder of many runs, their worker processes, and the order of reductions and runs.

Cases are run by any `concurrent.futures.Executor`. Worker processes on this machine are the
default, and do all reductions. If a process dies, only its task is lost.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import ExitStack, suppress
from functools import partial
from itertools import chain
from pathlib import Path
from time import sleep
from typing import Any, ClassVar, TypeVar

from mpi4py import MPI
from tqdm import tqdm

from fenics_ehd.base.errors import BodyFileError, EhdError, InputError, SettingsError
from fenics_ehd.base.files import (
    OUTCOME,
    claim,
    clear,
    locked,
    new_part,
    read_json,
    require_writable,
    to_json,
    write_whole,
)
from fenics_ehd.base.processes import begin_worker, interrupt_between_steps
from fenics_ehd.reduction.body import load_body
from fenics_ehd.results.recorded_run import BODY_FILE
from fenics_ehd.scenes.needed_bodies import NeededBody
from fenics_ehd.study.cases import Case, difference
from fenics_ehd.study.worker import (
    CaseResult,
    CaseTask,
    Outcome,
    StoredBody,
    body_path,
    failed,
    reduce_part,
    run_case,
)

T = TypeVar("T")
R = TypeVar("R")

#: Interval at which Ctrl-C is checked [s].
POLL = 0.2


class WorkerDiedError(EhdError):
    """The process of a worker ended during a task."""


class FailedCasesError(EhdError):
    """Some cases failed; the results of all others are stored."""


def open_pool(workers: int | None) -> ProcessPool:
    """Context with worker processes on this machine, one for each core by default.

    Raises
    ------
    SettingsError
        The program runs on several ranks of MPI.
    """
    if MPI.COMM_WORLD.size > 1:
        raise SettingsError(
            f"the command runs on {MPI.COMM_WORLD.size} ranks, but its cases are run by worker "
            "processes: use --workers in place of mpirun"
        )
    return ProcessPool(workers or len(os.sched_getaffinity(0)))


def outcomes(
    executor: Executor,
    function: Callable[[T], R],
    tasks: Iterable[T],
    check: Callable[[], None],
) -> Iterator[tuple[T, R | Outcome]]:
    """Run tasks, and yield each task with its result, in the order in which the tasks end.

    The result of a task that raises an exception is a failed `Outcome`.

    Parameters
    ----------
    executor
        Executor that runs the tasks.
    function
        Function that is called with every task; a module's function, so that it can be pickled.
    tasks
        Arguments of the function.
    check
        Function that is called several times a second, and may raise `KeyboardInterrupt`.
    """
    waiting: dict[Future[R], T] = {}
    try:
        for task in tasks:
            try:
                waiting[executor.submit(function, task)] = task
            except Exception as error:  # the executor is broken or was shut down
                yield task, failed(error)
        while waiting:
            ended, _ = wait(waiting, POLL, FIRST_COMPLETED)
            check()
            for future in ended:
                result = _result(future)
                yield waiting.pop(future), result
    finally:
        for future in waiting:
            future.cancel()


def _result(future: Future[R]) -> R | Outcome:
    """Result of a task that has ended; a failed `Outcome` if the task raised an exception."""
    try:
        return future.result()
    except BrokenExecutor:
        return failed(WorkerDiedError("the worker process ended: the machine may lack memory"))
    except Exception as error:
        return failed(error)


class ProcessPool(Executor):
    """Executor with worker processes on this machine, which survives the death of a process.

    If a process of a `ProcessPoolExecutor` dies, all of its processes are lost. Each process here
    therefore has its own executor, and a thread that waits for it. Processes are spawned, because
    MPI and PETSc do not survive a fork. They end with this process, even if it is killed.

    Attributes
    ----------
    width
        Number of worker processes.
    """

    def __init__(self, width: int):
        self.width = width
        self._threads = ThreadPoolExecutor(width, initializer=_block_interrupts)
        self._executors: dict[int, ProcessPoolExecutor] = {}
        self._futures: list[Future[Any]] = []
        self._others = set(multiprocessing.active_children())

    def submit(self, function: Callable[..., R], /, *arguments: Any, **keywords: Any) -> Future[R]:
        """Call a function in the next free process; return a `Future` of its result."""
        future = self._threads.submit(self._call, function, *arguments, **keywords)
        self._futures.append(future)
        return future

    def _call(self, function: Callable[..., R], *arguments: Any, **keywords: Any) -> R:
        """Call a function in the process of this thread, which is started if necessary."""
        thread = threading.get_ident()
        try:
            future = self._executors[thread].submit(function, *arguments, **keywords)
        except (KeyError, BrokenExecutor):
            self._executors[thread] = ProcessPoolExecutor(
                1, multiprocessing.get_context("spawn"), initializer=begin_worker
            )
            future = self._executors[thread].submit(function, *arguments, **keywords)
        return future.result()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after their tasks; with `cancel_futures`, end them at once."""
        self._threads.shutdown(wait=wait and not cancel_futures, cancel_futures=cancel_futures)
        while cancel_futures and not all(future.done() for future in self._futures):
            # PETSc prints a page of advice if it is only terminated, so the process is killed.
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
            sleep(POLL)
        for executor in self._executors.values():
            executor.shutdown()

    def __exit__(self, *_: object) -> None:
        self.shutdown(cancel_futures=True)


def _block_interrupts() -> None:
    """Block the signals of Ctrl-C and of a closed terminal in processes that this thread starts.

    A terminal sends these signals to workers as well, but the parent process must end its workers.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})


def reduce_missing(
    cases: Iterable[Case], directory: Path, pool: Executor, check: Callable[[], None]
) -> Mapping[str, Outcome]:
    """Reduce bodies whose files are missing or damaged.

    Returns the outcomes of reductions that failed, by the checksum that names the body's file.
    """
    needed = {body.name: body for case in cases for body in case.bodies.values()}
    parts: dict[str, list[NeededBody]] = {}
    for body in needed.values():
        if not _is_usable(body_path(directory, body)):
            parts.setdefault(body.part, []).append(body)
    reduce = partial(reduce_part, directory=directory)
    failures: dict[str, Outcome] = {}
    reduced = read = 0
    for bodies, answer in outcomes(pool, reduce, map(in_turn, parts.values()), check):
        if isinstance(answer, Outcome):
            lost = (body for body in bodies if not _is_usable(body_path(directory, body)))
            failures |= {body.name: answer for body in lost}
        else:
            failures |= answer.failures
            reduced += answer.reduced
            read += answer.read
    if parts:
        words = f"reduced bodies: {reduced} made, {read} read from the cache"
        with suppress(OSError):  # the standard error output is closed
            tqdm.write(f"fenics-ehd: {words}", file=sys.stderr)
    return failures


def in_turn(bodies: Iterable[NeededBody]) -> Sequence[NeededBody]:
    """Sort bodies of a part so that neighbours share most intermediate results, see `Reductor`."""

    def order(body: NeededBody) -> Any:
        r = body.settings.reduction
        return r.method, r.pressure_set, -r.vibration_modes, -r.modes, -r.residual_modes

    return sorted(bodies, key=order)


def _is_usable(path: Path) -> bool:
    try:
        load_body(path)
    except BodyFileError:
        return False
    return True


class OtherFolderError(InputError):
    """The folder has another study or sweep, or files that this program did not write."""

    def __init__(self, path: Path, reason: str):
        super().__init__(
            f"{path} belongs to another study or sweep ({reason}): choose another folder or use "
            "--overwrite"
        )


#: Exceptions caused by damaged files; KeyError for a missing key, ValueError for wrong numbers.
DAMAGE = (EhdError, KeyError, ValueError)


class RunsFolder(ExitStack):
    """Folder of many runs and their reduced bodies; each run has a folder ``runs/NAME``.

    One process at a time can use the folder. A complete run with the same settings and version is
    not repeated.

    Parameters
    ----------
    directory
        Path of the folder; it is created if it does not exist.
    cases
        Cases that are run in the folder.
    made
        Names of the files and folders that the study or sweep makes, except reduced bodies. The
        first is a JSON file that describes the study or sweep.
    about
        Entries that this JSON file must have if it exists.
    overwrite
        Whether the files of a former study or sweep are removed; reduced bodies are kept.

    Attributes
    ----------
    command
        Name of the command to which the folder belongs, ``"study"`` or ``"sweep"``.
    cases, outcomes
        Cases by name, and outcomes of the runs that have ended.

    Raises
    ------
    OtherFolderError
        The folder belongs to another study or sweep.
    InputError
        The folder cannot be written to, or has foreign files with these names.
    InUseError
        Another process uses the folder.
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
        """Write the tables of the runs that have ended; subclasses define the method."""

    def _require_same(self, path: Path, about: Mapping[str, Any]) -> None:
        """Refuse the folder if its JSON file describes another study or sweep."""
        reason = difference(path, about)
        if reason:
            raise OtherFolderError(path, reason)

    @property
    def bodies(self) -> Path:
        """Path of the folder of reduced bodies."""
        return self.path / "bodies"

    def run(self, name: str) -> Path:
        """Path of the folder of a run."""
        return self.path / "runs" / name

    def write(self, name: str, values: Mapping[str, Any]) -> None:
        """Write values to a JSON file, which is complete or absent."""
        write_whole(self.path / name, to_json(values) + "\n")

    def read(self, name: str) -> None:
        """Read the files of a complete run that the tables need; subclasses define the method."""

    def stored(self, name: str) -> Outcome | None:
        """Outcome of a former run with the same settings and version; None without such a run."""
        try:
            record = read_json(self.run(name) / OUTCOME)
            if record["identity"] != self.cases[name].identity:
                return None
            outcome = Outcome(record["status"], record["figures"])
            if outcome.complete:
                self.read(name)
        except (*DAMAGE, OSError, TypeError):
            return None
        return outcome

    def take_stock(self) -> list[Case]:
        """Read the outcomes of former runs; return the cases still to be run."""
        stored = {name: self.stored(name) for name in self.cases}
        self.outcomes = {name: outcome for name, outcome in stored.items() if outcome is not None}
        complete = {name for name, outcome in self.outcomes.items() if outcome.complete}
        return [case for name, case in self.cases.items() if name not in complete]

    def tasks(self, cases: Iterable[Case], keep: bool, *, travel: bool) -> Iterator[CaseTask]:
        """Make the tasks of cases; with `travel`, they contain the bytes of their reduced bodies.

        The file of each body is read once.
        """
        contents: dict[Path, bytes] = {}
        for case in cases:
            bodies = {}
            for name, body in case.bodies.items():
                path = body_path(self.bodies, body)
                if travel and path not in contents:
                    contents[path] = path.read_bytes()
                bodies[name] = StoredBody(path, contents.get(path))
            yield CaseTask(case, bodies, self.command, keep)

    def add(self, case: Case, result: CaseResult) -> None:
        """Store the result of a run that has ended.

        If the files of the run cannot be read, its outcome is stored as failed.
        """
        outcome = result.outcome
        try:
            self._write_run(case, result.files)
            if outcome.complete:
                self.read(case.name)
        except (*DAMAGE, OSError) as error:
            outcome = failed(error)
        claim(self.run(case.name), [OUTCOME])
        contents = {
            "identity": case.identity,
            "status": outcome.status,
            "figures": outcome.figures,
        }
        self.write(f"runs/{case.name}/{OUTCOME}", contents)
        self.outcomes[case.name] = outcome
        self.write_tables()

    def _write_run(self, case: Case, files: Mapping[str, bytes]) -> None:
        """Replace the files of a run, and add its reduced bodies; the summary is written last."""
        directory = self.run(case.name)
        clear(directory)
        if not files:
            return
        bodies = {BODY_FILE.format(name): body for name, body in case.bodies.items()}
        claim(directory, [*files, *bodies], self.command)
        for name, body in bodies.items():
            _share(body_path(self.bodies, body), directory / name)
        for name, content in files.items():
            write_whole(directory / name, content)


def run_cases(
    folder: RunsFolder,
    cases: Sequence[Case],
    pool: Executor,
    *,
    executor: Executor | None = None,
    keep: bool = True,
) -> None:
    """Run cases as ``fenics-ehd run`` does.

    Bodies are reduced first. A case whose body could not be reduced has failed. Ctrl-C takes effect
    between two cases.

    Parameters
    ----------
    folder
        Folder of all cases, which stores each case that ends.
    cases
        Cases in the order in which they are started.
    pool
        Worker processes on this machine; they do the reductions, and run the cases by default.
    executor
        Executor that runs the cases instead; bodies are sent to it as bytes.
    keep
        Whether the files of each run are kept in its folder.
    """
    complete = sum(outcome.complete for outcome in folder.outcomes.values())
    with (
        tqdm(
            total=complete + len(cases),
            initial=complete,
            unit="case",
            file=sys.stderr,
            mininterval=0.2 if sys.stderr.isatty() else 10.0,
        ) as bar,
        interrupt_between_steps() as check,
    ):
        failures = reduce_missing(cases, folder.bodies, pool, check)
        needed = ((case, body.name) for case in cases for body in case.bodies.values())
        lost = {case: failures[name] for case, name in needed if name in failures}
        ready = (case for case in cases if case not in lost)
        tasks = folder.tasks(ready, keep, travel=executor is not None)
        results = outcomes(executor or pool, run_case, tasks, check)
        ended = ((task.case, result) for task, result in results)
        incomplete = 0
        for case, result in chain(lost.items(), ended):
            folder.add(case, result if isinstance(result, CaseResult) else CaseResult(result))
            incomplete += not folder.outcomes[case.name].complete
            bar.set_postfix_str(f"{incomplete} failed", refresh=False)
            bar.update()


def _share(file: Path, copy: Path) -> None:
    """Link a body's file into the folder of a run, because many runs share a body.

    If the file system has no links, the file is copied.
    """
    link = new_part(copy)
    link.unlink()
    try:
        os.link(file, link)
    except OSError:  # the file system has no links
        shutil.copyfile(file, link)
    link.replace(copy)
