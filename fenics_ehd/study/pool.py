"""Folder of many runs, their worker processes, and the order of reductions and runs.

Reductions and cases are run by any `concurrent.futures.Executor`; worker processes on this machine,
`ProcessPool`, are the default. If a process dies, its task is tried once more. Outcomes of runs are
gathered, and written once a second.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep
from typing import Any, ClassVar, Generic, TypeVar

from mpi4py import MPI

from fenics_ehd.base.errors import BodyFileError, EhdError, InputError, SettingsError
from fenics_ehd.base.files import (
    claim,
    clear,
    locked,
    naming,
    new_part,
    require_writable,
    to_json,
    write_whole,
)
from fenics_ehd.base.processes import (
    begin_worker,
    call_of_letter,
    interrupt_between_steps,
    letter_of,
)
from fenics_ehd.base.progress import SILENT, Progress, Stage, read_progress
from fenics_ehd.reduction.body import load_body
from fenics_ehd.results.recorded_run import BODY_FILE
from fenics_ehd.scenes.needed_bodies import NeededBody
from fenics_ehd.study.cases import Case, difference
from fenics_ehd.study.worker import (
    CaseResult,
    CaseTask,
    MissingBodies,
    Outcome,
    PartTask,
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

#: Interval at which outcomes and tables are written [s], and the largest share of the time that
#: this may take.
WRITE_EVERY = 1.0
WRITING_SHARE = 0.1

#: Interval at which the number of workers of an executor is counted [s].
RECOUNT = 1.0

#: File with the outcomes of all runs of a folder, one JSON object a line. The last line of a case
#: is valid; a killed process may leave an incomplete line.
OUTCOMES = "outcomes.jsonl"


def read_records(path: Path) -> dict[str, dict[str, Any]]:
    """Read a file of outcomes, by name of the case; incomplete lines are ignored."""
    records = {}
    try:
        lines = path.read_bytes().splitlines()
    except FileNotFoundError:
        return {}
    for line in lines:
        with suppress(ValueError, KeyError, TypeError):
            record = json.loads(line)
            records[str(record["case"])] = record
    return records


class WorkerDiedError(EhdError):
    """The process of a worker ended during a task."""


class FailedCasesError(EhdError):
    """Some cases failed; the results of all others are stored."""


#: Outcome of a task whose worker process died twice.
DIED = failed(WorkerDiedError("the worker process ended twice: the machine may lack memory"))


def open_pool(workers: int | None) -> ProcessPool:
    """Context with worker processes on this machine, one for each core by default.

    Raises
    ------
    SettingsError
        The program runs on several ranks of MPI.
    """
    if MPI.COMM_WORLD.size > 1:
        raise SettingsError(
            f"this program runs on {MPI.COMM_WORLD.size} ranks, but cases are run by worker "
            "processes: use --workers (workers= in Python) in place of mpirun"
        )
    return ProcessPool(workers or len(os.sched_getaffinity(0)))


def require_importable_main(pool: ProcessPool) -> None:
    """Refuse a script that would call itself in the processes of a pool, which import the script.

    Raises
    ------
    SettingsError
        The first process ended while it imported the script.
    """
    try:
        pool.submit(call_of_letter, letter_of(bool, 0)).result()
    except BrokenExecutor:
        raise SettingsError(
            "a worker process ended at its start: a script must call ehd.sweep under "
            "if __name__ == '__main__':, because the processes import the script; a script from "
            "standard input must be written to a file"
        ) from None


#: Number of tasks that an executor has at the same time, for each of its workers. Tasks beyond them
#: wait here, so that a task that is sent again need not wait for all others.
TASKS_PER_WORKER = 2

#: Number of workers that is assumed if an executor has no attribute with this number.
UNKNOWN_WIDTH = 32


def width_of(executor: Executor) -> int:
    """Number of workers of an executor; `UNKNOWN_WIDTH` if the executor does not have it."""
    client: Any = getattr(executor, "_client", None)  # of Dask, whose number of workers may change
    if hasattr(client, "ncores"):
        try:
            return max(1, sum(client.ncores().values()))
        except OSError as error:
            raise WorkerDiedError(
                f"the scheduler no longer answers ({error}): start it, and repeat the command"
            ) from None
    names = "width", "num_workers", "_max_workers"
    numbers = (getattr(executor, name, None) for name in names)
    return next((number for number in numbers if isinstance(number, int)), UNKNOWN_WIDTH)


@dataclass
class Tasks(Generic[T, R]):
    """Tasks that an executor runs.

    Attributes
    ----------
    executor
        Executor that runs the tasks.
    function
        Function that is called with every task; a module's function, so that it can be pickled.
    check
        Function that is called several times a second, and may raise `KeyboardInterrupt`.
    completed
        Function of a task and its result that returns the task with further data if the result is
        not final, else None.
    watch
        Function that is called as often as `check`, with the tasks that are running.
    """

    executor: Executor
    function: Callable[[T], R]
    check: Callable[[], None]
    completed: Callable[[T, R], T | None] = lambda task, result: None
    watch: Callable[[Sequence[T]], None] = lambda running: None
    _waiting: dict[Future[R], tuple[T, bool]] = field(default_factory=dict)

    def outcomes(self, tasks: Iterable[T]) -> Iterator[tuple[T, R | Outcome]]:
        """Run tasks, and yield each task with its result, in the order in which the tasks end.

        The result of a task that raises an exception is a failed `Outcome`. A task whose worker
        dies is tried once more. If the tasks are interrupted, those that have ended are yielded
        before the exception.
        """
        queue = iter(tasks)
        remaining = True
        width = 0
        counted = -inf
        try:
            while True:
                if monotonic() > counted + RECOUNT:
                    width = width_of(self.executor)
                    counted = monotonic()
                while remaining and len(self._waiting) < TASKS_PER_WORKER * width:
                    task = next(queue, None)
                    remaining = task is not None
                    if task is not None:
                        yield from self._submit(task, False)
                if not self._waiting:
                    return
                wait(self._waiting, POLL, FIRST_COMPLETED)
                yield from self._ended()
                self.check()
                each = self._waiting.items()
                self.watch([task for future, (task, _) in each if future.running()])
        except KeyboardInterrupt:
            yield from self._ended(final=True)
            raise
        finally:
            for future in self._waiting:
                future.cancel()

    def _submit(self, task: T, is_retry: bool) -> Iterator[tuple[T, Outcome]]:
        """Submit a task; yield it with a failed outcome if the executor does not accept it."""
        try:
            future = self.executor.submit(call_of_letter, letter_of(self.function, task))
            self._waiting[future] = task, is_retry
        except BrokenExecutor:
            yield task, DIED
        except Exception as error:  # the executor was shut down, or the task cannot be pickled
            yield task, failed(error)

    def _ended(self, final: bool = False) -> Iterator[tuple[T, R | Outcome]]:
        """Yield the tasks that have ended; unless `final`, submit those that are tried again."""
        for future in [future for future in self._waiting if future.done()]:
            task, is_retry = self._waiting.pop(future)
            try:
                result = future.result()
            except Exception as error:
                is_lost = isinstance(error, (BrokenExecutor, CancelledError))
                # Dask has tried the task again on other workers.
                is_killed = type(error).__name__ == "KilledWorker"
                if final and is_lost:
                    continue
                if is_lost and not is_retry:
                    yield from self._submit(task, True)
                else:
                    yield task, DIED if is_lost or is_killed else failed(error)
                continue
            again = self.completed(task, result)
            if again is None:
                yield task, result
            elif not final:
                yield from self._submit(again, is_retry)


class Watch:
    """Progress of many tasks, which shows the first running task and how far it is.

    Parameters
    ----------
    stage
        Stage of the progress, in cases.
    folder
        Folder of the files to which workers on this machine write their progress; None for workers
        that may be on other machines.
    """

    def __init__(self, stage: Stage, folder: Path | None):
        self.stage = stage
        self.failed = 0
        self._folder = folder

    def file(self, name: str) -> Path | None:
        """Path of the file for the progress of a task, if workers are on this machine."""
        return None if self._folder is None else self._folder / name

    def __call__(self, running: Sequence[CaseTask | PartTask]) -> None:
        """Show how far the first of the running tasks is."""
        notes = [f"{self.failed} failed"] if self.failed else []
        if running:
            file = running[0].progress
            reported = "" if file is None else read_progress(file).partition(": ")[2]
            notes.append(": ".join(filter(None, [running[0].name, reported])))
        self.stage.to(self.stage.done, ", ".join(notes))


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
        self._futures: set[Future[Any]] = set()
        self._others = set(multiprocessing.active_children())

    def submit(self, function: Callable[..., R], /, *arguments: Any, **keywords: Any) -> Future[R]:
        """Call a function in the next free process; return a `Future` of its result."""
        future = self._threads.submit(self._call, function, *arguments, **keywords)
        self._futures.add(future)
        future.add_done_callback(self._futures.discard)  # a result may hold the files of a run
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
        while cancel_futures and self._futures:
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
    cases: Iterable[Case],
    directory: Path,
    executor: Executor,
    check: Callable[[], None],
    watch: Watch,
    progress: Progress = SILENT,
) -> Mapping[str, Outcome]:
    """Reduce bodies whose files are missing or damaged, and write their files.

    Returns the outcomes of reductions that failed, by the checksum that names the body's file. The
    numbers of bodies are printed by `progress`.
    """
    needed = {body.name: body for case in cases for body in case.bodies.values()}
    parts: dict[str, list[NeededBody]] = {}
    for body in needed.values():
        if not _is_usable(body_path(directory, body)):
            parts.setdefault(body.part, []).append(body)
    if not parts:
        return {}
    directory.mkdir(exist_ok=True)
    failures: dict[str, Outcome] = {}
    reduced = read = 0
    tasks = [PartTask(in_turn(bodies)) for bodies in parts.values()]
    tasks = [replace(task, progress=watch.file(task.bodies[0].name)) for task in tasks]
    reductions = Tasks(executor, reduce_part, check, watch=watch)
    for task, answer in reductions.outcomes(tasks):
        if isinstance(answer, Outcome):
            failures |= {body.name: answer for body in task.bodies}
            continue
        for body in task.bodies:
            if body.name in answer.files:
                write_whole(body_path(directory, body), answer.files[body.name])
        failures |= answer.failures
        reduced += answer.reduced
        read += answer.read
    progress.say(f"fenics-ehd: reduced bodies: {reduced} made, {read} read from the cache")
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
            "--overwrite (overwrite=True in Python)"
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
        self._gathered: list[dict[str, Any]] = []
        require_writable(self.path)
        self.path.mkdir(parents=True, exist_ok=True)
        with ExitStack() as held:
            held.enter_context(locked(self.path))
            claim(self.path, (*made, OUTCOMES, "bodies/"), self.command)
            if overwrite:
                clear(self.path, (*made, OUTCOMES))
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

    def _stored(self, name: str, record: Mapping[str, Any]) -> Outcome | None:
        """Outcome in a record of a former run; None if the run had other settings or versions."""
        try:
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
        path = self.path / OUTCOMES
        records = {name: r for name, r in read_records(path).items() if name in self.cases}
        stored = {name: self._stored(name, record) for name, record in records.items()}
        self.outcomes = {
            name: outcome for name in self.cases if (outcome := stored.get(name)) is not None
        }
        kept = [to_json(records[name], indent=None) for name in self.outcomes]
        write_whole(path, "".join(f"{line}\n" for line in kept))
        complete = {name for name, outcome in self.outcomes.items() if outcome.complete}
        return [case for name, case in self.cases.items() if name not in complete]

    def tasks(self, cases: Iterable[Case], keep: bool) -> Iterator[CaseTask]:
        """Make the tasks of cases."""
        stored: dict[Path, StoredBody] = {}
        for case in cases:
            paths = {name: body_path(self.bodies, body) for name, body in case.bodies.items()}
            for path in paths.values():
                if path not in stored:
                    stored[path] = StoredBody.of(path)
            bodies = {name: stored[path] for name, path in paths.items()}
            yield CaseTask(case, bodies, self.command, keep)

    def add(self, case: Case, result: CaseResult) -> None:
        """Store the files of a run that has ended, and gather its outcome until `flush`.

        If the files of the run cannot be read, its outcome is stored as failed.
        """
        outcome = result.outcome
        try:
            self._write_run(case, result.files)
            if outcome.complete:
                self.read(case.name)
        except (*DAMAGE, OSError) as error:
            outcome = failed(error)
        self.outcomes[case.name] = outcome
        self._gathered.append(
            {
                "case": case.name,
                "identity": case.identity,
                "status": outcome.status,
                "figures": outcome.figures,
            }
        )

    def flush(self) -> None:
        """Append the gathered outcomes to the file of outcomes, and write the tables."""
        if not self._gathered:
            return
        lines = [to_json(record, indent=None) for record in self._gathered]
        path = self.path / OUTCOMES
        with naming(path), open(path, "a", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in lines)
            file.flush()
            os.fsync(file.fileno())
        self._gathered.clear()
        self.write_tables()

    def claim_runs(self, cases: Iterable[Case]) -> None:
        """Claim the names of the folders of runs, before the first of them is written."""
        claim(self.path / "runs", [f"{case.name}/" for case in cases], self.command)

    def _write_run(self, case: Case, files: Mapping[str, bytes]) -> None:
        """Replace the files of a run, and add its reduced bodies; the summary is written last."""
        directory = self.run(case.name)
        if directory.exists():
            clear(directory)
        if not files:
            return
        bodies = {BODY_FILE.format(name): body for name, body in case.bodies.items()}
        claim(directory, [*files, *bodies], self.command)
        for name, body in bodies.items():
            share(body_path(self.bodies, body), directory / name)
        for name, content in files.items():
            write_whole(directory / name, content)


def run_cases(
    folder: RunsFolder,
    cases: Sequence[Case],
    executor: Executor,
    *,
    keep: bool = True,
    progress: Progress = SILENT,
) -> None:
    """Run cases as ``fenics-ehd run`` does.

    Bodies are reduced first. A case whose body could not be reduced has failed. Ctrl-C takes effect
    between two cases. Outcomes are written once a second, and at the end.

    Parameters
    ----------
    folder
        Folder of all cases, which stores each case that ends.
    cases
        Cases in the order in which they are started.
    executor
        Executor that does the reductions and runs the cases.
    keep
        Whether the files of each run are kept in its folder.
    progress
        Progress in which the cases are a stage.
    """
    if keep:
        folder.claim_runs(cases)
    complete = sum(outcome.complete for outcome in folder.outcomes.values())
    total = complete + len(cases)
    with (
        TemporaryDirectory(prefix="fenics-ehd-", ignore_cleanup_errors=True) as files,
        progress.stage(folder.command, total, "cases", done=complete) as stage,
        interrupt_between_steps() as interrupted,
        _flushing(folder) as flush_in_time,
    ):

        def check() -> None:
            flush_in_time()
            interrupted()

        watch = Watch(stage, Path(files) if isinstance(executor, ProcessPool) else None)
        failures = reduce_missing(cases, folder.bodies, executor, check, watch, progress)
        needed = ((case, body.name) for case in cases for body in case.bodies.values())
        lost = {case: failures[name] for case, name in needed if name in failures}
        ready = (case for case in cases if case not in lost)
        tasks = folder.tasks(ready, keep)
        followed = (replace(task, progress=watch.file(task.name)) for task in tasks)
        runs = Tasks[CaseTask, Any](executor, run_case, check, BodySender(), watch)
        ended = ((task.case, result) for task, result in runs.outcomes(followed))
        for case, result in chain(lost.items(), ended):
            folder.add(case, CaseResult(result) if isinstance(result, Outcome) else result)
            watch.failed += not folder.outcomes[case.name].complete
            stage.add()


@contextmanager
def _flushing(folder: RunsFolder) -> Iterator[Callable[[], None]]:
    """Yield a function that writes gathered outcomes once a second; write the last at the end.

    If the tables take long to write, they are written less often, see `WRITING_SHARE`.
    """
    due = monotonic()

    def flush_in_time() -> None:
        nonlocal due
        began = monotonic()
        if began >= due:
            folder.flush()
            due = began + max(WRITE_EVERY, (monotonic() - began) / WRITING_SHARE)

    try:
        yield flush_in_time
    finally:
        folder.flush()


class BodySender:
    """Function that adds the bytes of bodies to the tasks of workers that do not have the bodies.

    A worker that has several tasks at the same time may report a missing body several times before
    it receives the bytes. Only every second task of such a worker therefore has the bytes.
    """

    def __init__(self) -> None:
        self._reports = Counter[tuple[str, StoredBody]]()

    def __call__(self, task: CaseTask, answer: CaseResult | MissingBodies) -> CaseTask | None:
        """Return the task with the bytes of its missing bodies; None if the case has ended."""
        if isinstance(answer, CaseResult):
            return None
        bodies = dict(task.bodies)
        for name in answer.names:
            self._reports[answer.worker, bodies[name]] += 1
            if self._reports[answer.worker, bodies[name]] % 2:
                bodies[name] = bodies[name].with_content()
        return replace(task, bodies=bodies)


def share(file: Path, copy: Path) -> None:
    """Link a file into another folder: runs share bodies, and a merged sweep files of its parts.

    If the file system has no links, the file is copied.
    """
    link = new_part(copy)
    link.unlink()
    try:
        os.link(file, link)
    except OSError:  # the file system has no links
        shutil.copyfile(file, link)
    link.replace(copy)
