"""Results of a run on disk beside its history: a summary, the film of a failed solve."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module, metadata
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from fenics_ehd import __version__
from fenics_ehd.base.errors import CavitationError, EhdError, InputError
from fenics_ehd.base.text_file import read_json
from fenics_ehd.base.whole_file import naming, whole_hdf5, write_whole

__all__ = [
    "ACCURACY",
    "ERROR_BUDGET",
    "FAILED_FILM",
    "SCENE_NAME",
    "SUMMARY",
    "complete_result",
    "keeping_failed_film",
    "require_complete",
    "require_writable",
    "to_json",
    "versions",
    "write_summary",
    "write_whole",
]

#: Where the film of a failed solve is kept.
FAILED_FILM = "failed_film.h5"

#: Errors of a run over time, by component.
ERROR_BUDGET = "error_budget.json"

#: How settings were chosen that meet an accuracy.
ACCURACY = "accuracy.json"

#: Figures of a run and how it ended, written last.
SUMMARY = "summary.json"

#: Scene of a run, beside its history.
SCENE_NAME = "scene.toml"


def require_writable(path: str | Path) -> None:
    """Refuse an output path early, before any work is done for it.

    Raises
    ------
    InputError
        Neither the path nor the nearest folder above it can be written to, or the path is a
        device or a pipe.
    """
    existing = Path(path).absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if existing != Path(path).absolute() and not existing.is_dir():
        raise InputError(f"output {path}: {existing} is not a folder")
    if not (existing.is_dir() or existing.is_file()):
        raise InputError(f"output {path}: {existing} is neither a file nor a folder")
    if not os.access(existing, os.W_OK):
        raise InputError(
            f"output {path}: no permission to write to {existing}; with Docker, mkdir -p results "
            'and give docker run --user "$(id -u):$(id -g)"'
        )
    if existing.is_dir():
        try:
            # Permission is not all: a file system may be read-only, full or no real one.
            with TemporaryFile(dir=existing):
                pass
        except OSError as error:
            raise InputError(f"output {path}: {existing}: {error.strerror}") from None


def complete_result(directory: Path) -> dict[str, Any] | None:
    """Summary of the complete result in a folder, None where there is none."""
    summary = _summary(directory)
    return summary if summary and summary["status"] == "complete" else None


def require_complete(directory: Path) -> dict[str, Any]:
    """Summary of the complete result in a folder.

    Raises
    ------
    InputError
        There is no such folder, no result in it, or one that is not complete.
    """
    summary = _summary(directory)
    if summary is None:
        missing = f"no run that came to an end, it has no {SUMMARY} of one"
        raise InputError(f"{directory}: {missing if directory.is_dir() else 'no such folder'}")
    if summary["status"] != "complete":
        raise InputError(f"{directory}: its run is not complete: {summary['status']}")
    return summary


def _summary(directory: Path) -> dict[str, Any] | None:
    """What a summary says that has a status."""
    try:
        summary = read_json(directory / SUMMARY)
        return summary if isinstance(summary["status"], str) else None
    except (OSError, LookupError, ValueError, TypeError):
        return None


def write_summary(directory: str | Path, summary: Mapping[str, object]) -> None:
    """Write ``summary.json``, whole or not at all."""
    write_whole(Path(directory) / SUMMARY, to_json(summary) + "\n")


@contextmanager
def keeping_failed_film(directory: str | Path) -> Iterator[None]:
    """Save the film of a `CavitationError` that ends a command, itself or as the cause.

    Raises
    ------
    EhdError
        The error, its message naming the file.
    """
    try:
        yield
    except EhdError as error:
        cause: BaseException | None = error
        while cause is not None and not (isinstance(cause, CavitationError) and cause.state):
            cause = cause.__cause__
        if cause is None:
            raise
        path = Path(directory) / FAILED_FILM
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        with whole_hdf5(path) as file:
            for name, values in cause.state.items():
                file[name] = np.asarray(values)
        raise type(error)(f"{error}; the film is kept in {path}") from error


def to_json(values: Mapping[str, object]) -> str:
    """JSON text; a number that is not finite becomes null, which JSON has."""
    return json.dumps(_plain(values), indent=2, allow_nan=False)


def _plain(value: object) -> object:
    """A value with null in the place of numbers that are not finite, at any depth."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def versions(*, installed: bool = False) -> dict[str, str]:
    """Versions of everything that takes part in a result, or of everything that could."""
    names = ("numpy", "scipy", "h5py", "petsc4py", "slepc4py", "dolfinx", "gmsh", "matplotlib")
    return {
        "fenics_ehd": __version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in names if installed or name in sys.modules},
    }


def _version(name: str) -> str:
    """Version of a package; Debian ships some without the metadata that pip leaves."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        pass
    try:
        return str(getattr(import_module(name), "__version__", "unknown"))
    except ImportError:
        return "missing"
