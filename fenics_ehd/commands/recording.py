"""What the runs of all scenes have in common: progress, Ctrl-C, a summary whatever happens."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from fenics_ehd.errors import EhdError
from fenics_ehd.interrupt import interrupt_between_steps
from fenics_ehd.output import HistoryWriter, keeping_failed_film, write_summary
from fenics_ehd.settings import unusual


def progress_bar(end: float, *, ends_in: bool = True) -> tqdm:
    """Bar of the simulated time up to `end` [s]; seldom redrawn where nobody watches."""
    remaining = ", ends in {remaining}" if ends_in else ""
    return tqdm(
        total=1e3 * end,
        unit="ms",
        file=sys.stderr,
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
        bar_format="{percentage:3.0f}% |{bar:24}| {n:.3f}/{total:.3f} ms {postfix} [{elapsed}"
        + remaining
        + "]",
    )


def warn(settings: Any) -> None:
    """Say on the first rank which numbers are not usual ones: their unit may be another."""
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        for line in unusual(settings):
            click.echo(f"fenics-ehd: warning: {line}", err=True)


def record(
    directory: Path,
    history: HistoryWriter,
    bar: AbstractContextManager[Any],
    simulate: Callable[[Callable[[], None]], str],
    summarise: Callable[[str], dict[str, object]],
) -> dict[str, object]:
    """Run a simulation and write its summary, complete, failed or interrupted.

    Parameters
    ----------
    directory
        Folder of the results.
    history, bar
        Open during the simulation.
    simulate
        Called with what it must call after every step, for Ctrl-C to end it there;
        returns the verdict on its figures.
    summarise
        Figures of the run, called with its status.
    """
    status = "failed"
    try:
        with keeping_failed_film(directory), bar, history, interrupt_between_steps() as check:
            status = simulate(check)
    except KeyboardInterrupt:
        status = "interrupted"
        raise
    except EhdError as error:
        status = f"failed: {' '.join(str(error).split())}"
        raise
    finally:
        summary = summarise(status)
        if history.started:
            write_summary(directory, summary)
    return summary
