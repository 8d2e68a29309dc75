"""Imports matplotlib, before anything else does, without options of the current folder.

Matplotlib would open ``matplotlibrc`` there before any other file of options. Commands have none
(`command_start`); a program that imports the package keeps its own.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryDirectory

from fenics_ehd.base.command_start import MATPLOTLIB_OPTIONS


@contextmanager
def _in_empty_folder() -> Iterator[None]:
    """Have an empty current folder; the former one may have been removed, or be unreadable."""
    former = os.open(".", os.O_PATH)
    try:
        with TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                yield
            finally:
                os.fchdir(former)
    finally:
        os.close(former)


if os.environ.get(MATPLOTLIB_OPTIONS) == os.devnull:
    with _in_empty_folder():
        import matplotlib
else:
    import matplotlib  # noqa: F401
