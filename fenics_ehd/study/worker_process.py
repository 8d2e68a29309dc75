"""Beginning and end of a process of the pool. Nothing here starts MPI, for which it prepares."""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading

from tqdm import tqdm

#: What mpirun, or MPI itself in a process on its own, puts into the environment. A process that
#: inherits it takes itself for that rank.
LAUNCHER = ("OMPI_", "PMIX_", "PMI_", "ORTE_")


def begin_worker() -> None:
    """Set up a process of the pool: alone for MPI, one thread for the BLAS, no longer-lived."""
    for name in list(os.environ):
        if name.startswith(LAUNCHER):
            del os.environ[name]
    # Open MPI 4 would start a daemon for each process, and two that start at once may fail.
    os.environ["OMPI_MCA_ess_singleton_isolated"] = "1"
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
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
