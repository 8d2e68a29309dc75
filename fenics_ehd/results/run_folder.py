"""The folder of one run: one process at a time, and no result given up before a better one.

A run works in ``.run-ID`` inside its folder. Where it ends, complete or not, its files take the
place of a former run's, unless that one is complete and it is not. Killed in between, the folder
is put in order by whoever opens it next: it holds nothing, or a run to go on with, or results.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from secrets import token_hex
from types import TracebackType

import click
from mpi4py import MPI

from fenics_ehd.base.errors import EhdError, InputError, OutputError
from fenics_ehd.base.lock import locked
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

#: Held by the process that works in the folder.
LOCK = ".lock"

#: What is made of a run that came to an end, stale as soon as it goes on. The summary, which says
#: that all else is there, goes first and comes last.
MADE = (
    SUMMARY,
    FAILED_FILM,
    ERROR_BUDGET,
    "animation.*",
    "vtk/*.pvd",
    "vtk/*_[0-9][0-9][0-9][0-9].vtm",
    "vtk/*_[0-9][0-9][0-9][0-9].vtu",
    STRESS,
    "vtk/*_stress.vtu",
    *(f"{name}{more}.{ending}" for name in PICTURES for more in ("", "-*") for ending in FORMATS),
)

#: All that a run leaves, stale as soon as there is another one.
RESULTS = (
    *MADE,
    CSV_NAME,
    FIELDS_NAME,
    CHECKPOINT,
    SCENE_NAME,
    ACCURACY,
    "body-*.h5",
    "coarser-*.h5",
)


def clear(directory: Path, patterns: Sequence[str] = MADE) -> None:
    """Remove files of a run; what a link leads to is nobody's."""
    if (directory / "vtk").is_symlink():
        (directory / "vtk").unlink()
    for pattern in patterns:
        for stale in directory.glob(pattern):
            stale.unlink()


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


def first_rank_folder(directory: Path, overwrite: bool) -> RunFolder | AbstractContextManager[None]:
    """`RunFolder` on the first rank, which writes; the others only refuse what it refuses.

    Collective: a rank that failed before leaves no folder behind.
    """
    MPI.COMM_WORLD.Barrier()
    if MPI.COMM_WORLD.rank == 0:
        return RunFolder(directory, overwrite=overwrite)
    if not overwrite:
        require_no_result(directory)
    return nullcontext()


class RunFolder:
    """Holds the folder of one run while it works there.

    Parameters
    ----------
    directory
        Created when missing.
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
        The folder cannot be written to, holds a complete result, or nothing to go on with.
    InUseError
        Another process works in it.
    """

    def __init__(self, directory: str | Path, *, overwrite: bool = False, resume: bool = False):
        self.directory = Path(directory)
        if resume and not self.directory.is_dir():
            raise InputError(f"{directory}: no checkpoint to go on from, no such folder")
        require_writable(self.directory)
        self._made = not self.directory.exists()
        self.directory.mkdir(parents=True, exist_ok=True)
        self._lock = locked(self.directory / LOCK)
        try:
            for ended in self.directory.glob(".ended-*"):
                self._replace(ended)
            for moving in self.directory.glob(".moving-*"):
                self._move(moving)
            for killed in self.directory.glob(".run-*"):
                if not (killed / CHECKPOINT).exists():
                    shutil.rmtree(killed)
            if not (overwrite or resume):
                require_no_result(self.directory)
            self.path = self._work = self._former() if resume else self._new()
        except BaseException:
            self._release()
            raise

    def _former(self) -> Path:
        """The run that was killed last, or what one left that ended."""
        killed = [path.parent for path in self.directory.glob(f".run-*/{CHECKPOINT}")]
        return max(
            killed, key=lambda run: (run / CHECKPOINT).stat().st_mtime, default=self.directory
        )

    def _new(self) -> Path:
        path = self.directory / f".run-{token_hex(4)}"
        path.mkdir()
        return path

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if self.path != self.directory:
                self._leave()
        except OSError as failure:
            where = failure.filename2 or failure.filename or self.directory
            raise OutputError(f"{where}: {failure.strerror}; results in {self.path}") from error
        finally:
            self._release()
        self._explain(error)

    def _leave(self) -> None:
        """Have the run's files take their place."""
        if not any((self.path / name).exists() for name in (CHECKPOINT, SUMMARY)):
            film = self.path / FAILED_FILM
            if film.exists():
                film.replace(self.directory / FAILED_FILM)
            shutil.rmtree(self.path)
            return
        for other in self.directory.glob(".run-*"):
            if other != self.path:
                shutil.rmtree(other)
        if complete_result(self.directory) and not complete_result(self.path):
            return
        # From here on nothing is left to decide: whoever comes next can end it.
        self._replace(_renamed(self.path, "ended"))
        self.path = self.directory

    def _replace(self, ended: Path) -> None:
        """Put the files of a run in the place of a former one's."""
        clear(self.directory, RESULTS)
        self._move(_renamed(ended, "moving"))

    def _move(self, moving: Path) -> None:
        """File by file, as a mounted folder cannot be renamed."""
        files = [path for path in moving.rglob("*") if path.is_symlink() or not path.is_dir()]
        for path in sorted(files, key=lambda path: path.name == SUMMARY):
            target = self.directory / path.relative_to(moving)
            target.parent.mkdir(exist_ok=True)
            path.replace(target)
        shutil.rmtree(moving)

    def _release(self) -> None:
        (self.directory / LOCK).unlink(missing_ok=True)
        self._lock.close()
        if self._made:
            with suppress(OSError):  # there is something in it
                self.directory.rmdir()

    def _explain(self, error: BaseException | None) -> None:
        """Say where the files of a run are that ended early, and how to go on with it."""
        if isinstance(error, EhdError) and not self._work.exists():
            error.args = (str(error).replace(str(self._work), str(self.directory)),)
        lines = []
        if self.path != self.directory and self.path.exists():
            lines.append(f"{self.directory}: its complete result stays, this run is in {self.path}")
        if isinstance(error, KeyboardInterrupt | OutputError) and (self.path / CHECKPOINT).exists():
            lines.append(f"go on with: fenics-ehd run --resume {self.directory}")
        with suppress(OSError):  # whoever was reading may be gone
            for line in lines:
                click.echo(line, err=True)


def _renamed(path: Path, stage: str) -> Path:
    """A folder in the next stage of its life."""
    return path.rename(path.with_name(f".{stage}-{path.name.split('-')[1]}"))
