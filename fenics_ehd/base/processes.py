"""Processes: calls in one of their own, signals, ranks that end together, silence.

- What a library leaves behind, or ends, in a process of its own stays there.
- Signals end a run between two steps, never in the middle of writing one.
- An error on one rank ends the others, which may wait for it.
- What libraries print that nobody asked for is kept off the stream of this program's answer.
"""

from __future__ import annotations

import ctypes
import io
import logging
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeVar

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import escaped

if TYPE_CHECKING:
    from mpi4py import MPI


T = TypeVar("T")

#: Threads of the BLAS, read when NumPy is first imported: one in each process.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")

#: Beginnings of the variables that launchers set (Open MPI, PMIx, MPICH, Slurm). A process that
#: inherits them takes itself for that rank.
LAUNCHER = ("OMPI_", "ORTE_", "PMIX_", "PRTE_", "PMI_", "HYDI_", "MPI_LOCAL", "SLURM_")

#: Those of them that are settings of the user, and are passed on.
SETTINGS = ("OMPI_MCA_", "OMPI_ALLOW_", "PMIX_MCA_", "PRTE_MCA_", "PRTE_ALLOW_")

#: Settings, by their beginnings, with which Open MPI 4 tells a rank how to reach its daemon.
RANK_SETTINGS = (
    "OMPI_MCA_ess_base_",
    "OMPI_MCA_initial_wdir",
    "OMPI_MCA_orte_app_num",
    "OMPI_MCA_orte_bound_at_launch",
    "OMPI_MCA_orte_ess_",
    "OMPI_MCA_orte_hnp_uri",
    "OMPI_MCA_orte_jobfam_session_dir",
    "OMPI_MCA_orte_launch",
    "OMPI_MCA_orte_local_daemon_uri",
    "OMPI_MCA_orte_num_nodes",
    "OMPI_MCA_orte_precondition_transports",
    "OMPI_MCA_orte_top_session_dir",
)

#: Values of settings that ranks alone have: they forbid what a process on its own needs.
RANK_VALUES = {
    "OMPI_MCA_ess": ("^singleton", "singleton"),  # the latter of a process on its own
    "OMPI_MCA_pmix": ("^s1,s2,cray,isolated",),
}

#: Ranks among the variables of launchers.
RANKS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID")

#: Numbers of ranks among them.
SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_STEP_NUM_TASKS")


def is_rank() -> bool:
    """True if a launcher has started this process."""
    return any(name in os.environ for name in RANKS)


def set_by_launcher(name: str, value: str) -> bool:
    """True of a variable by which a launcher makes a process a rank."""
    if name.startswith(RANK_SETTINGS) or value in RANK_VALUES.get(name, ()):
        return True
    return name.startswith(LAUNCHER) and not name.startswith(SETTINGS)


def without_launcher() -> dict[str, str]:
    """Environment of a child that is no rank: settings of the user are kept."""
    return {name: text for name, text in os.environ.items() if not set_by_launcher(name, text)}


def begin_worker() -> None:
    """Set up a process of a pool: no rank, one thread for the BLAS, gone when its parent is.

    It must come before anything that starts MPI, which would take itself for the parent's rank:
    so this module imports nothing that does.
    """
    from tqdm import tqdm

    for name, value in list(os.environ.items()):
        if set_by_launcher(name, value):
            del os.environ[name]
    # Open MPI 4 would start a daemon for each process, and two that start at once may fail.
    os.environ["OMPI_MCA_ess_singleton_isolated"] = "1"
    for name in THREADS:
        os.environ.setdefault(name, "1")
    logging.disable(logging.INFO)  # the build log of forms
    # Its usual one is shared by processes, and lost by one that is killed.
    tqdm.set_lock(threading.RLock())
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End when the parent is killed, for whose tasks a pool's processes wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


#: A folder that exists without a disk, and in which no user can create a file.
NEUTRAL = "/proc"


@contextmanager
def in_neutral_folder() -> Iterator[None]:
    """Have a current folder in which no library finds a file by a relative name.

    The former folder may have been removed, or be unreadable.
    """
    former = os.open(".", os.O_PATH)
    os.chdir(NEUTRAL if os.path.isdir(NEUTRAL) else os.sep)
    try:
        yield
    finally:
        os.fchdir(former)
        os.close(former)


#: What the other process does. Modules are found as here, and none in the current folder.
_CALL = """
import pathlib, pickle, sys
sys.path = pickle.load(sys.stdin.buffer)
try:
    function, arguments = pickle.load(sys.stdin.buffer)
    answer = True, function(*arguments)
except Exception as error:
    answer = False, error
pathlib.Path(sys.argv[1]).write_bytes(pickle.dumps(answer))
"""


def in_child(function: Callable[..., T], *arguments: Any, lost: Exception) -> T:
    """Result of a module's function, called in another Python; what it prints goes nowhere.

    The other process is no rank, even if this one is.

    Parameters
    ----------
    function
        Of a module that does not start MPI.
    arguments
        Like its result, of types that pickle knows.
    lost
        Raised if the other process ends without an answer.
    """
    asked = pickle.dumps(sys.path) + pickle.dumps((function, arguments))
    with TemporaryDirectory() as folder:
        answer = Path(folder, "answer")
        subprocess.run(
            [sys.executable, "-P", "-c", _CALL, str(answer)],
            input=asked,
            env=without_launcher(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        if not answer.is_file():
            raise lost
        good, found = pickle.loads(answer.read_bytes())
    if not good:
        raise found
    return found


#: They all end a run as Ctrl-C does.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE)

#: Exit status of a command that they ended.
INTERRUPTED = 130


@contextmanager
def ending_signals_raise() -> Iterator[None]:
    """Have SIGTERM and SIGHUP raise `KeyboardInterrupt` as SIGINT does.

    In the middle of an import, which would make another error of it, they end the process.
    What is ignored, SIGINT in a shell's background jobs say, stays ignored. So does SIGPIPE,
    except between the steps of a run: whoever writes to a closed pipe is told by an error.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = {number: signal.getsignal(number) for number in ENDING}
    for number, handler in former.items():
        if handler in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _raise)
    if former[signal.SIGPIPE] is signal.SIG_IGN:  # by Python
        signal.signal(signal.SIGPIPE, _pass_over)
    try:
        yield
    finally:
        _restore(former)


def _raise(_number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            with suppress(OSError):
                os.write(2, b"fenics-ehd: interrupted\n")
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt


def _pass_over(_number: int, _frame: FrameType | None) -> None:
    pass


def _restore(handlers: dict[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        if handler is not None:  # else not one of Python's
            signal.signal(number, handler)


@contextmanager
def interrupt_between_steps() -> Iterator[Callable[[], None]]:
    """Hold back the first signal until the function yielded here is called.

    It then raises `KeyboardInterrupt`. A second signal acts at once. Only signals that would
    raise something are held back, see `ending_signals_raise`; in a thread of its own a run has
    none.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    former = {n: handler for n in ENDING if callable(handler := signal.getsignal(n))}
    asked = False

    def remember(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        _restore(former)

    def check() -> None:
        if asked:
            raise KeyboardInterrupt

    for number in former:
        signal.signal(number, remember)
    try:
        yield check
    finally:
        _restore(former)


@contextmanager
def interrupt_kept() -> Iterator[None]:
    """Leave signals as they are: Gmsh takes SIGINT away from import to end."""

    def keep(number: int, _handler: Any) -> Any:
        return signal.getsignal(number)

    original = signal.signal
    signal.signal = keep  # type: ignore[assignment]
    try:
        yield
    finally:
        signal.signal = original


#: Time in which other ranks must meet an error as well [s], or else they wait for this one.
PATIENCE = 3.0

#: Time that mpirun needs to pass on what a rank has said, before that rank ends the job [s].
PASSING_ON = 0.3

#: Seconds between two looks at the other ranks.
POLL = 0.01


@contextmanager
def all_ranks() -> Iterator[MPI.Comm | None]:
    """Communicator that nothing else uses, for `agreed`; None where this process is alone."""
    if all(os.environ.get(name, "1") == "1" for name in SIZES):
        yield None
        return
    from mpi4py import MPI

    comm = MPI.COMM_WORLD.Dup()
    yield comm
    comm.Free()


def require_alike(name: str, value: str) -> None:
    """Refuse a value that is not the same on all ranks, or they wait for each other; collective.

    Raises
    ------
    SettingsError
        On all of them.
    """
    from mpi4py import MPI

    found = MPI.COMM_WORLD.allgather(value)
    other = next((rank for rank, theirs in enumerate(found) if theirs != found[0]), 0)
    if other:
        raise SettingsError(f"rank {other} has another {name} than rank 0: call all ranks alike")


def agreed(comm: MPI.Comm | None, status: int, message: str) -> tuple[int, str]:
    """Exit status of all ranks, and what this one says: the first that failed speaks for all.

    Called by every rank at its end. One that fails while others wait for it in something
    collective, where no exception reaches them, says so and aborts them all.

    Parameters
    ----------
    comm
        From `all_ranks`.
    status, message
        Of this rank, 0 and empty where all is well.
    """
    if comm is None:
        return status, message
    arrived = comm.Ibarrier()
    begin = time.monotonic()
    while not arrived.Test():
        if status and time.monotonic() > begin + PATIENCE:
            with suppress(OSError):  # nobody is listening
                print(
                    f"{escaped(message)} (rank {comm.rank}, which ends the others)", file=sys.stderr
                )
                sys.stdout.flush()
            time.sleep(PASSING_ON)
            comm.Abort(status)
        time.sleep(POLL)
    statuses = comm.allgather(status)
    first = next((rank for rank, found in enumerate(statuses) if found), 0)
    return statuses[first], message if comm.rank == first else ""


@contextmanager
def printing_kept() -> Iterator[io.StringIO]:
    """Keep what Python code prints, and drop what compiled code writes to file descriptor 1.

    Yields
    ------
    io.StringIO
        What Python code has printed, to its standard or its error output.
    """
    said = io.StringIO()
    _flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        with redirect_stdout(said), redirect_stderr(said):
            yield said
    finally:
        _flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _flush() -> None:
    """Have out what Python and the C library hold back: it goes where it was meant to."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)
