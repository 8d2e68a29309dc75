"""Workers: the processes of a pool, or under mpirun all ranks but the first."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from typing import Protocol, TypeVar

from mpi4py import MPI

from fenics_ehd.errors import EhdError, SettingsError
from fenics_ehd.sweeps.worker_process import begin_worker

T = TypeVar("T")
R = TypeVar("R")

#: Time after which Ctrl-C is noticed [s].
POLL = 0.2


class WorkerDiedError(EhdError):
    """The process of a worker ended in the middle of its work."""


class Pool(Protocol):
    """Workers that take one task each."""

    width: int

    def submit(self, function: Callable[[T], R], task: T) -> Future[R]:
        """Start a task."""

    def restart(self) -> None:
        """Replace workers, all of which are gone."""


@contextmanager
def open_pool(comm: MPI.Intracomm, workers: int | None) -> Iterator[Pool | None]:
    """Ranks of `comm`, or processes where it has only one.

    Yields
    ------
    Pool or None
        None on ranks that have worked, once all work is done.

    Raises
    ------
    SettingsError
        A number of processes is given although ranks do the work.
    """
    if comm.size == 1:
        with ProcessPool(workers or len(os.sched_getaffinity(0))) as pool:
            yield pool
        return
    if workers is not None:
        raise SettingsError(f"--workers {workers}: under mpirun the ranks are the workers")
    from mpi4py.futures import MPICommExecutor

    with MPICommExecutor(comm, root=0) as executor:
        try:
            yield RankPool(executor, comm.size - 1) if executor is not None else None
        except KeyboardInterrupt:
            # Leaving in order would mean to wait until all ranks are done with their cases.
            print("fenics-ehd: interrupted", file=sys.stderr, flush=True)
            comm.Abort(130)


def outcomes(
    pool: Pool,
    function: Callable[[T], R],
    tasks: Iterable[T],
    check: Callable[[], None],
) -> Iterator[tuple[T, R | WorkerDiedError]]:
    """Results of tasks as they end, no more of them under way than there are workers.

    A process that dies, for want of memory say, takes the pool with it. The tasks that
    were under way are then run again one after the other, which shows whose fault it was.

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
    waiting, suspects = deque(tasks), deque[T]()
    running: dict[Future[R], T] = {}
    while waiting or running or suspects:
        while waiting and not suspects and len(running) < pool.width:
            task = waiting.popleft()
            running[_submit(pool, function, task)] = task
        for future in _ended(running, check):
            task = running.pop(future)
            if isinstance(future.exception(), BrokenExecutor):
                suspects.append(task)
            else:
                yield task, future.result()
        if suspects and not running:
            pool.restart()
            for task in suspects:
                yield task, _alone(pool, function, task, check)
            suspects.clear()


def _ended(running: Iterable[Future[R]], check: Callable[[], None]) -> set[Future[R]]:
    ended, _ = wait(running, POLL, FIRST_COMPLETED)
    check()
    return ended


def _alone(
    pool: Pool, function: Callable[[T], R], task: T, check: Callable[[], None]
) -> R | WorkerDiedError:
    """Result of a task while no other is under way."""
    future = _submit(pool, function, task)
    while not _ended([future], check):
        pass
    if isinstance(future.exception(), BrokenExecutor):
        pool.restart()
        return WorkerDiedError("the process that ran it ended, for want of memory perhaps")
    return future.result()


def _submit(pool: Pool, function: Callable[[T], R], task: T) -> Future[R]:
    try:
        return pool.submit(function, task)
    except BrokenExecutor as error:  # found out before the task was under way
        future: Future[R] = Future()
        future.set_exception(error)
        return future


class RankPool:
    """Ranks of a communicator."""

    def __init__(self, executor: Executor, width: int):
        self.width = width
        self._executor = executor

    def submit(self, function: Callable[[T], R], task: T) -> Future[R]:
        """Start a task on a free rank."""
        return self._executor.submit(function, task)

    def restart(self) -> None:
        """Ranks cannot be replaced: mpirun ends them all when one dies."""
        raise WorkerDiedError("a rank ended in the middle of its work")


class ProcessPool:
    """Processes of this machine, started with the first task.

    They are spawned: MPI and PETSc do not survive a fork. They end with this process,
    even if it is killed.
    """

    def __init__(self, width: int):
        self.width = width
        self._executor: ProcessPoolExecutor | None = None
        self._processes: set[multiprocessing.process.BaseProcess] = set()

    def submit(self, function: Callable[[T], R], task: T) -> Future[R]:
        """Start a task."""
        if self._executor is None:
            self._executor = self._start()
        return self._executor.submit(function, task)

    def _start(self) -> ProcessPoolExecutor:
        executor = ProcessPoolExecutor(
            self.width, multiprocessing.get_context("spawn"), initializer=begin_worker
        )
        former = set(multiprocessing.active_children())
        with _interrupt_blocked():
            for _ in range(self.width):  # each task starts a process as long as none is idle
                executor.submit(os.getpid)
        self._processes = set(multiprocessing.active_children()) - former
        return executor

    def restart(self) -> None:
        """Begin with new processes."""
        self._end(kill=True)

    def _end(self, *, kill: bool) -> None:
        if self._executor is None:
            return
        if kill:
            # PETSc answers a mere termination with a page of advice.
            for process in self._processes:
                process.kill()
        self._executor.shutdown(cancel_futures=True)
        self._executor, self._processes = None, set()

    def __enter__(self) -> ProcessPool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end(kill=kind is not None)


@contextmanager
def _interrupt_blocked() -> Iterator[None]:
    """Processes started here do not see Ctrl-C, nor the end of the terminal.

    It tells all of them, and it is for the first one to end the others.
    """
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)
