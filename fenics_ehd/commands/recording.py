"""What the runs of all scenes have in common: progress, Ctrl-C, a summary whatever happens."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from fenics_ehd.errors import EhdError, OutputError
from fenics_ehd.interrupt import interrupt_between_steps
from fenics_ehd.output import HistoryWriter, keeping_failed_film, write_summary
from fenics_ehd.settings import unusual


class _Unwatched:
    """The error output; nobody has to be there, and a full disk may be behind it."""

    def write(self, text: str) -> None:
        """Write it, if possible."""
        with suppress(OSError):
            sys.stderr.write(text)

    def flush(self) -> None:
        """Likewise."""
        with suppress(OSError):
            sys.stderr.flush()


def progress_bar(end: float, *, ends_in: bool = True) -> tqdm:
    """Bar of the simulated time up to `end` [s]; seldom redrawn where nobody watches."""
    remaining = ", ends in {remaining}" if ends_in else ""
    return tqdm(
        total=1e3 * end,
        unit="ms",
        file=_Unwatched(),
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
        bar_format="{percentage:3.0f}% |{bar:24}| {n:.3f}/{total:.3f} ms {postfix} [{elapsed}"
        + remaining
        + "]",
    )


def warn(settings: Any) -> None:
    """Say which numbers are not usual ones: their unit may be another."""
    warn_of(unusual(settings))


def warn_of(lines: Iterable[str]) -> None:
    """One line each on the first rank's standard error."""
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        for line in lines:
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

    def leave(status: str) -> dict[str, object]:
        summary = summarise(status)
        if history.started:
            write_summary(directory, summary)
        return summary

    try:
        with keeping_failed_film(directory), bar, history, interrupt_between_steps() as check:
            status = simulate(check)
    except BaseException as error:
        with suppress(OutputError):  # the disk may be full
            leave(_how_it_ended(error, directory))
        raise
    return leave(status)


def _how_it_ended(error: BaseException, directory: Path) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if not isinstance(error, EhdError):
        return "failed"
    # Files of the run by their names: the folder they are in is about to change.
    return f"failed: {' '.join(str(error).replace(f'{directory}/', '').split())}"
