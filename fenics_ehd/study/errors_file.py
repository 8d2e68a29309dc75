"""``errors-AGAINST.npz``: how a run's errors change over time, for pictures of them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.errors import InputError

if TYPE_CHECKING:  # slow to import, and workers do without
    from fenics_ehd.study.curves import Differences

#: Names of the arrays, one value for each step of the run while errors count.
TIME, PRESSURE, FILM = "time_s", "pressure_error", "film_error"


def errors_path(directory: Path, against: str) -> Path:
    """File beside a run's history with its errors relative to another run."""
    return directory / f"errors-{against}.npz"


def write_errors(path: Path, found: Differences) -> None:
    """Write errors at the run's own steps, whole or not at all; the same ones, the same file."""
    content = io.BytesIO()
    np.savez(content, **{TIME: found.time, PRESSURE: found.pressure, FILM: found.film})
    partial = path.with_suffix(".part")
    partial.write_bytes(content.getvalue())
    partial.replace(path)


def read_errors(path: Path) -> dict[str, np.ndarray]:
    """Times [s], and relative errors of peak pressure and minimum film thickness then, signed.

    Raises
    ------
    InputError
        There is no such file, or it cannot be read.
    """
    try:
        with np.load(path) as file:
            return {name: file[name] for name in (TIME, PRESSURE, FILM)}
    except Exception as error:  # a damaged archive raises what its parts happen to meet
        raise InputError(f"{path}: not the errors of a run ({error})") from None
