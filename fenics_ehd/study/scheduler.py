"""Workers of Dask distributed: a scheduler that is running, or one that is started here.

A scheduler accepts workers on any machine (``dask worker tcp://HOST:8786 --nthreads 1``), and its
client has an executor for `fenics_ehd.study.pool.run_cases`. The library is not required.

Imports inside functions: Dask is imported only by commands that use it.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
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
                "start one with 'dask scheduler', and workers with 'dask worker "
                f"{address} --nthreads 1'"
            ) from None
        if not client.ncores():
            raise InputError(
                f"--scheduler {address}: the scheduler has no workers: start them with "
                f"'dask worker {address} --nthreads 1'"
            )
        yield client.get_executor()
