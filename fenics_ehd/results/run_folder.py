"""The folder of one run: one process at a time, and no complete result given up before another one.

A run works in its folder, in place of a former one that is not complete. Beside a complete result
it works in ``replacement`` there, whose files take the place of the others as soon as it is
complete, too. Killed at any instant, the folder holds a run to go on with, or results, or both.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from types import TracebackType

import click
from mpi4py import MPI

from fenics_ehd.base.errors import InputError, OutputError
from fenics_ehd.base.folder import claim, clear, let_go, listed, locked
from fenics_ehd.base.output import (
    ACCURACY,
    ERROR_BUDGET,
    FAILED_FILM,
    SCENE_NAME,
    SUMMARY,
    complete_result,
    require_writable,
)
from fenics_ehd.base.pictures import FORMATS, PICTURES
from fenics_ehd.results.checkpoint import CHECKPOINT
from fenics_ehd.results.csv_file import CSV_NAME
from fenics_ehd.results.history_file import FIELDS_NAME

#: Stresses over the cycle, made of a run's result.
STRESS = "stress.json"

#: File of a flexible body beside the history of its run.
BODY_FILE = "body-{}.h5"

#: Series for ParaView; and a run that is to replace the complete result beside it.
SERIES, REPLACEMENT = "vtk/", "replacement/"

#: What a run consists of, beside its bodies. The history is there as soon as there is a step.
RUN = (FIELDS_NAME, CSV_NAME, CHECKPOINT, SCENE_NAME, ACCURACY)

#: What is made of a run that came to an end. The summary says that all else is there: it is the
#: first to go and the last to come.
MADE = (
    SUMMARY,
    ERROR_BUDGET,
    FAILED_FILM,
    SERIES,
    *(f"{name}.{ending}" for name in PICTURES for ending in FORMATS),
)


def clear_made(directory: Path) -> None:
    """Remove what was made of a run, stale as soon as it goes on."""
    clear(directory, [name for name in listed(directory) if not _of_run(name)])


def _of_run(name: str) -> bool:
    """Whether a run cannot go on without this file."""
    return name in RUN or name.startswith("body-")


def require_no_result(directory: Path) -> None:
    """Refuse a folder that holds a complete result.

    Raises
    ------
    InputError
        Naming it.
    """
    if complete_result(directory):
        raise InputError(
            f"{directory}: holds a complete result, choose another folder or --overwrite"
        )


def first_rank_folder(
    directory: Path, overwrite: bool, bodies: Iterable[str]
) -> RunFolder | AbstractContextManager[None]:
    """`RunFolder` on the first rank, which writes; the others only refuse what it refuses."""
    if MPI.COMM_WORLD.rank == 0:
        return RunFolder(directory, bodies, overwrite=overwrite)
    if not overwrite:
        require_no_result(directory)
    return nullcontext()


class RunFolder:
    """Holds the folder of one run while it works there.

    Parameters
    ----------
    directory
        Created when missing.
    bodies
        Names of flexible ones, whose files are to be there.
    overwrite
        A complete result there may be replaced, by another one.
    resume
        Go on with the run that was stopped there.

    Attributes
    ----------
    path
        Where the run works.

    Raises
    ------
    InputError
        The folder cannot be written to, holds a complete result, nothing to go on with, or what is
        not of a run.
    InUseError
        Another process works in it.
    """

    def __init__(
        self,
        directory: str | Path,
        bodies: Iterable[str] = (),
        *,
        overwrite: bool = False,
        resume: bool = False,
    ):
        self.directory = self.path = Path(directory)
        if resume and not self.directory.is_dir():
            raise InputError(f"{directory}: no checkpoint to go on from, no such folder")
        require_writable(self.directory)
        self._made = not self.directory.exists()
        self.directory.mkdir(parents=True, exist_ok=True)
        files = [BODY_FILE.format(name) for name in bodies]
        replacement = self.directory / REPLACEMENT
        self._lock = locked(self.directory)
        try:
            if complete_result(replacement):
                self._replace(replacement)
            if not (overwrite or resume):
                require_no_result(self.directory)
            claim(self.directory, (*MADE, *RUN, *files, REPLACEMENT))
            if (replacement / CHECKPOINT).exists() if resume else complete_result(self.directory):
                self.path = replacement
                claim(self.path, (*MADE, *RUN, *files))
        except BaseException:
            self._release()
            raise

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if self.path != self.directory and complete_result(self.path):
                self._replace(self.path)
                self.path = self.directory
        except OSError as failure:
            where = failure.filename2 or failure.filename or self.directory
            raise OutputError(f"{where}: {failure.strerror}; results in {self.path}") from error
        finally:
            self._release()
        self._explain(error)

    def _replace(self, complete: Path) -> None:
        """Have the files of a complete run take the place of a former one's, one by one."""
        names = listed(complete)
        claim(self.directory, (*names, REPLACEMENT))
        claim(complete, names)
        if (complete / FIELDS_NAME).exists():  # the first to move: none has
            clear(self.directory, set(listed(self.directory)) - {REPLACEMENT})
        for name in sorted(names, key=lambda name: (name == SUMMARY) - (name == FIELDS_NAME)):
            if (complete / name).exists():
                (complete / name).replace(self.directory / name)
        clear(self.directory, [REPLACEMENT])

    def _release(self) -> None:
        """Leave nothing behind of a run that has no step, but the film that failed."""

        def holds(name: str, *more: str) -> bool:
            there = (CHECKPOINT, SUMMARY, *more)
            return any((self.directory / name / file).exists() for file in there)

        with suppress(OSError, InputError):
            if not holds(REPLACEMENT, FAILED_FILM):
                clear(self.directory, [REPLACEMENT])
            if not holds("."):
                clear(self.directory, [name for name in listed(self.directory) if _of_run(name)])
            let_go(self.directory, folder=self._made)
        self._lock.close()

    def _explain(self, error: BaseException | None) -> None:
        """Say where the files of a run are that ended early, and how to go on with it."""
        lines = []
        if self.path != self.directory and self.path.exists():
            lines.append(f"{self.directory}: its complete result stays, this run is in {self.path}")
        if isinstance(error, KeyboardInterrupt | OutputError) and (self.path / CHECKPOINT).exists():
            lines.append(f"go on with: fenics-ehd run --resume {self.directory}")
        with suppress(OSError):  # whoever was reading may be gone
            for line in lines:
                click.echo(line, err=True)
