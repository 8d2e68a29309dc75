"""One call of the program after the other, each in a process forked from one that has imported it.

A hang ends by SIGALRM, a crash by its own signal, and neither ends the driver.
"""

import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import fenics_ehd as ehd

#: Memory that a call may take beyond what it begins with [bytes].
ROOM = 4 * 2**30


@dataclass(frozen=True)
class Outcome:
    """How a call ended: its exit status, or minus the signal that killed it."""

    status: int
    stdout: str
    stderr: str
    seconds: float


def launch(call: Callable[[], object], folder: Path, limit: int, *, largest_file: int = 0) -> int:
    """Begin a call in a folder; its process id.

    Parameters
    ----------
    call
        What to call.
    folder
        Its working directory, where ``stdout`` and ``stderr`` are written.
    limit
        Seconds until SIGALRM.
    largest_file
        Bytes that a file may have, a disk that is full; 0: any number.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sys.stdout.flush()
    process = os.fork()
    if process:
        return process
    status = 1
    try:
        os.chdir(folder)
        for number, name in ((0, os.devnull), (1, "stdout"), (2, "stderr")):
            os.dup2(os.open(name, os.O_CREAT | (os.O_RDWR | os.O_TRUNC)), number)
        signal.alarm(limit)
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + ROOM
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        if largest_file:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
        call()
        status = 0
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 0
    except ehd.errors.EhdError as error:
        print(f"fenics-ehd: {type(error).__name__}: {error}", file=sys.stderr)
        status = error.exit_status
    except BaseException:
        traceback.print_exc()
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(status)


def finish(process: int, folder: Path, began: float) -> Outcome:
    """Wait for a call."""
    status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    out, err = (
        (folder / name).read_text(errors="replace") if (folder / name).exists() else ""
        for name in ("stdout", "stderr")
    )
    return Outcome(status, out, err, time.monotonic() - began)


def attempt(call: Callable[[], object], folder: Path, limit: int = 60, **more: int) -> Outcome:
    """One call from beginning to end."""
    began = time.monotonic()
    return finish(launch(call, folder, limit, **more), folder, began)


def side_by_side(
    cases: Iterable, begin: Callable[[object], tuple[int, Path]], jobs: int, deadline: float
) -> Iterator[tuple]:
    """Cases with their outcomes as they end, so many at a time, none begun after the deadline."""
    waiting, running = iter(cases), {}
    while True:
        while len(running) < jobs and time.monotonic() < deadline:
            case = next(waiting, None)
            if case is None:
                break
            began = time.monotonic()
            process, folder = begin(case)
            running[process] = case, folder, began
        if not running:
            return
        process = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOWAIT).si_pid
        case, folder, began = running.pop(process)
        yield case, folder, finish(process, folder, began)
