"""Histories of runs as other programs read and change them."""

from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from fenics_ehd.base.sealed_file import seal


@contextmanager
def edited(directory):
    """A run's history.h5, to be changed, sealed again."""
    path = Path(directory) / "history.h5"
    with h5py.File(path, "r+") as file:
        yield file
    seal(path, path)


def read_history(directory):
    """Columns of history.csv by name; a row that a killed run left unfinished is dropped."""
    header, *lines = (Path(directory) / "history.csv").read_text().splitlines(keepends=True)
    rows = [line.split(",") for line in lines if line.endswith("\n")]
    return dict(zip(header.strip().split(","), np.array(rows, dtype=float).T, strict=True))
