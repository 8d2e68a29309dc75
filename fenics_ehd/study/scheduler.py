"""Workers of Dask distributed: a scheduler that is running, or one that is started here.

A scheduler accepts workers on any machine (`WORKER`), and its
client has an executor for `fenics_ehd.study.pool.run_cases`. The library is not required.

Imports inside functions: Dask is imported only by commands that use it.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from importlib import metadata
from typing import Any

from fenics_ehd.base.errors import EhdError, InputError, SettingsError

#: Word of ``--scheduler`` for a scheduler on this machine: ``local:4`` has four workers.
LOCAL = "local"

#: Time that a scheduler has to answer [s].
PATIENCE = 10.0


class CancelledCaseError(EhdError):
    """The caller no longer waits for the case."""


def require_wanted() -> None:
    """End a case in a worker of Dask if the caller has cancelled it, by Ctrl-C for example.

    Workers of other executors end with their processes.

    Raises
    ------
    CancelledCaseError
        The case was cancelled.
    """
    module: Any = sys.modules.get("distributed.worker")
    state = getattr(module, "thread_state", None)
    key = getattr(state, "key", None)
    if key is None:
        return
    task = module.get_worker().state.tasks.get(key)
    if task is None or task.state == "cancelled":
        raise CancelledCaseError("the sweep was interrupted")


@contextmanager
def scheduled(address: str) -> Iterator[Executor]:
    """Yield the executor of a scheduler, which is started if the address is ``local:WORKERS``.

    Parameters
    ----------
    address
        Address of a running scheduler, ``tcp://HOST:8786``, or ``local:4``.

    Raises
    ------
    SettingsError
        The address is malformed, or the library is missing.
    InputError
        No scheduler answers at the address, or it has no worker.
    """
    kind, _, count = address.partition(":")
    is_local = kind == LOCAL
    if is_local and not (count.isascii() and count.isdecimal() and 1 <= int(count[:9]) <= 1024):
        raise SettingsError(
            f"--scheduler {address}: the number of workers must be from 1 to 1024, local:4 for "
            "instance"
        )
    if not is_local and "://" not in address:
        raise SettingsError(
            f"--scheduler {address}: give the address of a scheduler, tcp://HOST:8786, or local:4"
        )
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise SettingsError(
            f"--scheduler {address} needs Dask distributed ({error}): apt install "
            "python3-distributed, or pip install distributed"
        ) from None
    for name in ("distributed", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    settings = {"distributed.comm.timeouts.connect": PATIENCE}
    if is_local:
        # A worker that dies costs its case one retry.
        settings["distributed.scheduler.allowed-failures"] = 1
    with ExitStack() as held:
        held.enter_context(dask.config.set(settings))
        if is_local:
            cluster = LocalCluster(
                n_workers=int(count),
                threads_per_worker=1,
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
            address = held.enter_context(cluster).scheduler_address
        try:
            client = held.enter_context(Client(address, timeout=PATIENCE))
        except (OSError, ValueError, ImportError) as error:
            raise InputError(
                f"--scheduler {address}: no scheduler answers ({' '.join(str(error).split())}): "
                "start one with 'python -m distributed.cli.dask_scheduler', and workers with "
                f"'{WORKER.format(address)}'"
            ) from None
        _require_workers(client, address)
        yield client.get_executor()


#: Command that starts a worker, with the Python of this package.
WORKER = "python -m distributed.cli.dask_worker {} --nthreads 1"


def _require_workers(client: Any, address: str) -> None:
    """Refuse a scheduler without workers, or whose workers cannot run cases.

    Raises
    ------
    InputError
        There is no worker, a worker has several threads, or it has another version of the package.
    """
    threads = client.ncores()
    command = WORKER.format(address)
    if not threads:
        raise InputError(
            f"--scheduler {address}: the scheduler has no workers: start them with '{command}'"
        )
    several = [worker for worker, number in threads.items() if number > 1]
    if several:
        raise InputError(
            f"--scheduler {address}: worker {several[0]} has {threads[several[0]]} threads, but a "
            f"process runs one case at a time: start workers with '{command}'"
        )
    try:
        versions = client.run(metadata.version, "fenics_ehd")
    except metadata.PackageNotFoundError:
        raise InputError(
            f"--scheduler {address}: a worker has no fenics_ehd: start it with the Python in which "
            f"fenics_ehd is installed, '{command}'"
        ) from None
    here = metadata.version("fenics_ehd")
    other = next((worker for worker, version in versions.items() if version != here), None)
    if other is not None:
        raise InputError(
            f"--scheduler {address}: worker {other} has version {versions[other]} of fenics_ehd, "
            f"but this is {here}: install the same version"
        )
