"""Child processes, signals, common end of all ranks, and suppressed output of libraries.

- A function can be called in a child process, so that a crash or a changed state of a library is
  limited to that process.
- Signals end a run between two steps, never while a step is being written.
- An error on one rank ends the other ranks, which may be waiting for it.
- Libraries do not write to the standard output, which has the results of commands.

Imports inside functions: the import of mpi4py starts MPI. A worker must start MPI after its
environment is set up, and a single process need not start MPI.
"""

from __future__ import annotations

import ctypes
import functools
import io
import logging
import multiprocessing
import os
import pickle
import shutil
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

#: Environment variables with the number of BLAS threads, which are read when NumPy is imported.
#: Their default is one thread per process.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")

#: Beginnings of the variables that launchers set (Open MPI, PMIx, MPICH, Slurm). A process that
#: inherits them acts as the rank for which they were set.
LAUNCHER = ("OMPI_", "ORTE_", "PMIX_", "PRTE_", "PMI_", "HYDI_", "MPI_LOCAL", "SLURM_")

#: Beginnings of variables among these that are settings of the user and are passed on.
SETTINGS = ("OMPI_MCA_", "OMPI_ALLOW_", "PMIX_MCA_", "PRTE_MCA_", "PRTE_ALLOW_")

#: Beginnings of settings through which a rank of Open MPI 4 contacts its daemon; not passed on.
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

#: Values of settings that ranks have and that exclude components which a single process needs.
RANK_VALUES = {
    "OMPI_MCA_ess": ("^singleton", "singleton"),  # the second in a single process
    "OMPI_MCA_pmix": ("^s1,s2,cray,isolated",),
}

#: Variables of launchers with the rank of the process.
RANKS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID")

#: Variables of launchers with the number of ranks.
SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_STEP_NUM_TASKS")


def is_rank() -> bool:
    """Whether a launcher has started this process as a rank."""
    return any(name in os.environ for name in RANKS)


def set_by_launcher(name: str, value: str) -> bool:
    """Whether an environment variable is one that a launcher sets to make a process a rank."""
    if name.startswith(RANK_SETTINGS) or value in RANK_VALUES.get(name, ()):
        return True
    return name.startswith(LAUNCHER) and not name.startswith(SETTINGS)


def without_launcher() -> dict[str, str]:
    """Environment for a child process that is not a rank; settings of the user are kept."""
    return {name: text for name, text in os.environ.items() if not set_by_launcher(name, text)}


#: Settings of MPI in a process that is no rank: Open MPI starts no daemon, and MPICH opens neither
#: network cards nor shared memory.
ALONE = {"OMPI_MCA_ess_singleton_isolated": "1", "UCX_TLS": "self"}

#: Settings of Open MPI 4 and 5: more ranks than cores are accepted, and so is the root user of a
#: container. MPICH accepts both and has no switches for them, so that there are settings only.
ANY_RANKS = {
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
}


def mpirun() -> str | None:
    """Path of ``mpirun``, or None if there is none.

    If MPI is installed by pip, its ``mpirun`` is in the folder of the interpreter, which need not
    be on the search path. The ``mpirun`` of another MPI would start ranks of which each is alone.
    """
    return shutil.which("mpirun", path=str(Path(sys.executable).parent)) or shutil.which("mpirun")


def for_mpirun() -> dict[str, str]:
    """Environment in which ``mpirun`` starts any number of ranks; settings of the user are kept.

    ``mpirun`` or its ranks would fail with the variables of the launcher that has started this
    process, and with the settings of a process that is no rank.
    """
    passed_on = without_launcher()
    for name, value in ALONE.items():
        if passed_on.get(name) == value:
            del passed_on[name]
    return ANY_RANKS | passed_on


def begin_worker() -> None:
    """Set up a worker process of a pool on this machine, which ends with its parent."""
    set_up_worker()
    threading.Thread(target=_end_with_parent, daemon=True).start()


@functools.cache
def set_up_worker() -> None:
    """Set up a process that runs cases: it is no rank of MPI, and has one BLAS thread.

    The function has no effect in a process that has started MPI: a process that inherits the
    variables of a launcher would otherwise act as the rank of its parent.
    """
    if "mpi4py.MPI" in sys.modules:
        return
    for name, value in list(os.environ.items()):
        if set_by_launcher(name, value):
            del os.environ[name]
    # Open MPI 4 would start a daemon for each process, and two that start at once may fail.
    for name, value in {**ALONE, **dict.fromkeys(THREADS, "1")}.items():
        os.environ.setdefault(name, value)
    logging.disable(logging.INFO)  # the build log of forms


def letter_of(function: Callable[[Any], Any], argument: Any) -> bytes:
    """Pickle a call of a function of a module, for `call_of_letter` in another process."""
    return pickle.dumps((function, argument), pickle.HIGHEST_PROTOCOL)


def call_of_letter(letter: bytes) -> Any:
    """Call the function in a letter from `letter_of`, in a worker of any executor.

    The process is set up first: the modules of the function may start MPI.
    """
    set_up_worker()
    function, argument = pickle.loads(letter)
    return function(argument)


#: Names of the functions of OpenBLAS that set and return its number of threads. In wheels they have
#: a prefix, and a suffix if indices have 64 bits; in Debian neither.
THREAD_FUNCTIONS = tuple(
    (f"{prefix}openblas_set_num_threads{suffix}", f"{prefix}openblas_get_num_threads{suffix}")
    for prefix in ("", "scipy_")
    for suffix in ("", "64_")
)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit every OpenBLAS in this process to one thread, as results depend on this number."""
    former = [(write, read()) for write, read in _thread_functions()]
    try:
        for write, _ in former:
            write(1)
        yield
    finally:
        for write, threads in former:
            write(threads)


def _thread_functions() -> list[tuple[Callable[[int], None], Callable[[], int]]]:
    """Functions of every loaded OpenBLAS that set and return its number of threads."""
    return _functions_of_libraries(len(sys.modules))


@functools.lru_cache(maxsize=1)
def _functions_of_libraries(
    _modules: int,
) -> list[tuple[Callable[[int], None], Callable[[], int]]]:
    """Result of `_thread_functions`, which takes 3 ms; an import may load another library."""
    functions = []
    for library in map(ctypes.CDLL, _loaded("blas")):
        for write, read in THREAD_FUNCTIONS:
            if hasattr(library, write):
                functions.append((getattr(library, write), getattr(library, read)))
    return functions


def _loaded(*words: str) -> list[str]:
    """Sorted paths of loaded libraries whose names contain at least one of the `words`."""
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return []
    paths = {f"/{line.partition('/')[2]}" for line in lines if "/" in line}
    return sorted(path for path in paths if any(word in Path(path).name for word in words))


#: Parts of the names of libraries of linear algebra that this program always loads.
LINEAR_ALGEBRA = ("blas", "lapack", "mkl_", "dmumps", "petsc", "slepc")


def blas_kernels() -> list[str]:
    """Names of loaded libraries of linear algebra, then configurations of loaded OpenBLAS.

    A configuration has version, kernel and number of threads; the last bits of all results depend
    on them.
    """
    paths = [path for path in _loaded(*LINEAR_ALGEBRA) if Path(path).name.startswith("lib")]
    kernels = {text for path in paths for text in _kernels(ctypes.CDLL(path))}
    return [*sorted({Path(path).name for path in paths}), *sorted(kernels)]


def _kernels(library: ctypes.CDLL) -> Iterator[str]:
    """Version, kernel and number of threads of OpenBLAS, if a library is or depends on OpenBLAS."""
    for _, read in THREAD_FUNCTIONS:
        configuration = read.replace("get_num_threads", "get_config")
        if hasattr(library, configuration):
            describe = getattr(library, configuration)
            describe.restype = ctypes.c_char_p
            yield f"{describe().decode()} threads={getattr(library, read)()}"


def _end_with_parent() -> None:
    """End this process when its parent ends, as it would otherwise wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


#: Folder that always exists and in which no user can create a file.
NEUTRAL = "/proc"


@contextmanager
def in_neutral_folder() -> Iterator[None]:
    """Work in a folder without files that libraries could read by relative names.

    The former folder is restored afterwards, even if it was removed or is unreadable.
    """
    former = os.open(".", os.O_PATH)
    os.chdir(NEUTRAL if os.path.isdir(NEUTRAL) else os.sep)
    try:
        yield
    finally:
        os.fchdir(former)
        os.close(former)


#: Program of the child process; its module path is that of this process.
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
    """Call a function in a child process of Python, and return its result.

    The child process is not a rank, even if this process is one. Its output is discarded.

    Parameters
    ----------
    function
        Function at the top level of a module that does not start MPI.
    arguments
        Arguments of the function; they and the result must be picklable.
    lost
        Error that is raised if the child process ends without a result.
    """
    request = pickle.dumps(sys.path) + pickle.dumps((function, arguments))
    with TemporaryDirectory() as folder:
        answer = Path(folder, "answer")
        subprocess.run(
            [sys.executable, "-P", "-c", _CALL, str(answer)],
            input=request,
            env=without_launcher(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        if not answer.is_file():
            raise lost
        successful, result = pickle.loads(answer.read_bytes())
    if not successful:
        raise result
    return result


#: Signals that end a run as Ctrl-C does.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE)

#: Exit status of a command that a signal has ended.
INTERRUPTED = 130


@contextmanager
def ending_signals_raise() -> Iterator[None]:
    """Make SIGTERM and SIGHUP raise `KeyboardInterrupt`, as SIGINT does.

    A signal during an import ends the process, as the import would turn the exception into another
    error. Signals that are ignored remain so, for instance SIGINT in background jobs of a shell.
    SIGPIPE does not end a process, because writing to a closed pipe raises an error. In a run,
    SIGPIPE is an interruption between two steps, see `interrupt_between_steps`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = {number: signal.getsignal(number) for number in ENDING}
    for number, handler in former.items():
        if handler in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _raise)
    if former[signal.SIGPIPE] is signal.SIG_IGN:  # Python ignores it at its start
        signal.signal(signal.SIGPIPE, _pass_over)
    try:
        yield
    finally:
        _restore(former)


def _raise(_number: int, frame: FrameType | None) -> None:
    """Handle a signal: raise `KeyboardInterrupt`, or end the process during an import."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            with suppress(OSError):
                os.write(2, b"fenics-ehd: interrupted\n")
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt


def _pass_over(_number: int, _frame: FrameType | None) -> None:
    """Handle a signal: do nothing."""
    pass


def _restore(handlers: dict[signal.Signals, Any]) -> None:
    """Set signal handlers."""
    for number, handler in handlers.items():
        if handler is not None:  # None: the handler was not set from Python
            signal.signal(number, handler)


@contextmanager
def interrupt_between_steps() -> Iterator[Callable[[], None]]:
    """Yield a function that raises `KeyboardInterrupt` if a signal has arrived in the block.

    The first signal has no other effect; a second signal has its usual effect at once. This holds
    for signals that have a Python handler, see `ending_signals_raise`. In threads other than the
    main thread, handlers of signals are not changed.
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
    """Keep the signal handlers in the block, as Gmsh would replace the handler of SIGINT."""

    def keep(number: int, _handler: Any) -> Any:
        return signal.getsignal(number)

    original = signal.signal
    signal.signal = keep  # type: ignore[assignment]
    try:
        yield
    finally:
        signal.signal = original


#: Time that a failed rank waits for the end of the other ranks [s]; after this time, it assumes
#: that the other ranks wait for it.
PATIENCE = 3.0

#: Time between the message of a rank and its abort of the job [s], so that mpirun can print it.
PASSING_ON = 0.3

#: Time between two checks of the other ranks [s].
POLL = 0.01


@contextmanager
def all_ranks() -> Iterator[MPI.Comm | None]:
    """Yield a communicator of all ranks, for `agreed` only; None for a single process."""
    if all(os.environ.get(name, "1") == "1" for name in SIZES):
        yield None
        return
    from mpi4py import MPI

    comm = MPI.COMM_WORLD.Dup()
    yield comm
    comm.Free()


def require_alike(name: str, value: str) -> None:
    """Refuse a value that differs between ranks; all ranks must call this function.

    Ranks with different values would wait for each other.

    Raises
    ------
    SettingsError
        If the value differs; the error is raised on all ranks.
    """
    from mpi4py import MPI

    values = MPI.COMM_WORLD.allgather(value)
    other = next((rank for rank, text in enumerate(values) if text != values[0]), 0)
    if other:
        raise SettingsError(
            f"rank {other} has another {name} than rank 0: all ranks must have the same"
        )


def agreed(comm: MPI.Comm | None, status: int, message: str) -> tuple[int, str]:
    """Agree on the end of all ranks: return the exit status and the message of this rank.

    Every rank calls this function at its end. The returned status is that of the first failed rank;
    the returned message is empty on all other ranks. No exception can interrupt ranks that wait for
    a failed rank in a collective call: the failed rank then prints its message and aborts all.

    Parameters
    ----------
    comm
        Communicator from `all_ranks`.
    status, message
        Exit status and message of this rank; 0 and an empty text if the rank has not failed.
    """
    if comm is None:
        return status, message
    arrived = comm.Ibarrier()
    begin = time.monotonic()
    while not arrived.Test():
        if status and time.monotonic() > begin + PATIENCE:
            with suppress(OSError):  # the standard error output is closed
                print(
                    f"{escaped(message)} (rank {comm.rank}, which ends the others)", file=sys.stderr
                )
                sys.stdout.flush()
            time.sleep(PASSING_ON)
            comm.Abort(status)
        time.sleep(POLL)
    statuses = comm.allgather(status)
    first = next((rank for rank, failed in enumerate(statuses) if failed), 0)
    return statuses[first], message if comm.rank == first else ""


@contextmanager
def printing_kept() -> Iterator[io.StringIO]:
    """Collect the output of Python code, and discard the standard output of compiled code.

    Yields
    ------
    io.StringIO
        Collected standard output and standard error of Python code.
    """
    output = io.StringIO()
    _flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        with redirect_stdout(output), redirect_stderr(output):
            yield output
    finally:
        _flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _flush() -> None:
    """Flush the standard output of Python and the output of the C library."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)
