"""One end for all ranks: an error on one of them ends the others, which may wait for it."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import click

from fenics_ehd.base.errors import SettingsError

if TYPE_CHECKING:
    from mpi4py import MPI

#: What launchers put into the environment of several processes: how many there are.
SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_STEP_NUM_TASKS")

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
    arrived, begin = comm.Ibarrier(), time.monotonic()
    while not arrived.Test():
        if status and time.monotonic() > begin + PATIENCE:
            with suppress(OSError):  # nobody is listening
                click.echo(f"{message} (rank {comm.rank}, which ends the others)", err=True)
                sys.stdout.flush()
            time.sleep(PASSING_ON)
            comm.Abort(status)
        time.sleep(POLL)
    statuses = comm.allgather(status)
    first = next((rank for rank, found in enumerate(statuses) if found), 0)
    return statuses[first], message if comm.rank == first else ""
