"""Lines on the first rank's standard error."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import click
from mpi4py import MPI


def warn_of(lines: Iterable[str]) -> None:
    """Say which numbers are not usual ones: their unit may be another."""
    _say(f"fenics-ehd: warning: {line}" for line in lines)


def say_reducing(names: Iterable[str]) -> None:
    """Say which bodies are reduced: the first time ever, this takes long."""
    found = ", ".join(names)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fenics"
    compiled = any(cache.glob("libffcx_forms_*.so"))
    once = "" if compiled else " (forms are compiled once, in about half a minute)"
    _say([f"reducing {found}{once}"] if found else [])


def _say(lines: Iterable[str]) -> None:
    if MPI.COMM_WORLD.rank == 0:
        for line in lines:
            click.echo(line, err=True)
