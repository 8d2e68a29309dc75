"""``errors-AGAINST.npz``: how a run's errors change over time, for pictures of them."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.base.columns import joint_prefix
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.folder import claim
from fenics_ehd.base.whole_file import write_whole

if TYPE_CHECKING:  # slow to import, and workers do without
    from fenics_ehd.study.curves import Differences

#: Names of the arrays, one value for each step of the run while errors count; those of errors
#: bear the joint's name before them, ``big_end.film_error``, if there are several.
TIME, PRESSURE, FILM = "time_s", "pressure_error", "film_error"


def errors_path(directory: Path, against: str) -> Path:
    """File beside a run's history with its errors relative to another run."""
    return directory / f"errors-{against}.npz"


def write_errors(path: Path, times: np.ndarray, found: Mapping[str, Differences]) -> None:
    """Write errors at the run's own steps, whole or not at all; the same ones, the same file."""
    arrays = {TIME: times}
    for joint, differences in found.items():
        prefix = joint_prefix(joint, found)
        arrays |= {prefix + PRESSURE: differences.pressure, prefix + FILM: differences.film}
    content = io.BytesIO()
    np.savez(content, **arrays)
    claim(path.parent, [path.name])
    write_whole(path, content.getbuffer())


def read_errors(path: Path) -> dict[str, np.ndarray]:
    """Times [s], and relative errors of peak pressure and minimum film thickness then, signed.

    Raises
    ------
    InputError
        There is no such file, or it cannot be read.
    """
    try:
        with np.load(path) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:  # a damaged archive raises what its parts happen to meet
        raise InputError(f"{path}: not the errors of a run ({error})") from None
