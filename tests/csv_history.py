"""Histories and summaries of runs as other programs read and change them."""

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


def only_joint(summary):
    """Entries of the only lubricated joint of a summary."""
    (entries,) = summary["joints"].values()
    return entries


def read_history(directory, joint=""):
    """Columns of history.csv by name; a row that a killed run left unfinished is dropped.

    Names of columns of `joint` are without its name.
    """
    header, *lines = (Path(directory) / "history.csv").read_text().splitlines(keepends=True)
    rows = [line.split(",") for line in lines if line.endswith("\n")]
    names = [name.removeprefix(f"{joint}.") for name in header.strip().split(",")]
    return dict(zip(names, np.array(rows, dtype=float).T, strict=True))
