"""Workers: processes that take one task each."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from typing import Any, TypeVar

from mpi4py import MPI

from fenics_ehd.base.errors import EhdError, SettingsError
from fenics_ehd.study.worker_process import begin_worker

T = TypeVar("T")
R = TypeVar("R")

#: Time after which Ctrl-C is noticed [s].
POLL = 0.2


class WorkerDiedError(EhdError):
    """The process of a worker ended in the middle of its work."""


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
) -> Iterator[tuple[T, R | WorkerDiedError]]:
    """Results of tasks as they end.

    A process that dies, for want of memory say, costs its own task only.

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
    waiting = deque(tasks)
    running: dict[Future[R], T] = {}
    while waiting or running:
        while waiting and len(running) < pool.width:
            task = waiting.popleft()
            running[pool.submit(function, task)] = task
        ended, _ = wait(running, POLL, FIRST_COMPLETED)
        check()
        for future in ended:
            task = running.pop(future)
            if isinstance(future.exception(), BrokenExecutor):
                yield task, WorkerDiedError("its process ended, for want of memory perhaps")
            else:
                yield task, future.result()


class ProcessPool:
    """Processes of this machine, each started with its first task in an executor of its own.

    An executor takes all of its processes with it when one dies. They are spawned: MPI and PETSc
    do not survive a fork. They end with this process, even if it is killed.
    """

    def __init__(self, width: int):
        self.width = width
        self._executors: dict[int, ProcessPoolExecutor] = {}
        self._last: dict[int, Future[Any]] = {}
        self._others = set(multiprocessing.active_children())

    def submit(self, function: Callable[[T], R], task: T) -> Future[R]:
        """Start a task; no more of them may be under way than there are processes."""
        free = (n for n in range(self.width) if n not in self._last or self._last[n].done())
        place = next(free)
        with _interrupt_blocked():
            try:
                future = self._executors[place].submit(function, task)
            except (KeyError, BrokenExecutor):
                self._executors[place] = ProcessPoolExecutor(
                    1, multiprocessing.get_context("spawn"), initializer=begin_worker
                )
                future = self._executors[place].submit(function, task)
        self._last[place] = future
        return future

    def __enter__(self) -> ProcessPool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            # PETSc answers a mere termination with a page of advice.
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
        for executor in self._executors.values():
            executor.shutdown(cancel_futures=True)


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
