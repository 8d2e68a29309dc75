"""An accuracy that a run is to meet, asked for and printed."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import click

from fenics_ehd.cli.error_budget import COMPONENTS, aligned, share
from fenics_ehd.multibody.error_shares import NOT_ESTIMATED
from fenics_ehd.scenes.accuracy import Search
from fenics_ehd.scenes.given import changed
from fenics_ehd.scenes.scene import Scene


def with_accuracy(scene: Scene, written: str) -> Scene:
    """The scene with an accuracy, ``1%`` or ``0.01``.

    Raises
    ------
    SettingsError
        It is none.
    """
    value: float | str = written
    with suppress(ValueError):
        value = float(written)
    return changed(scene, {"output.accuracy": value})


def say_next(search: Search) -> None:
    """Say why there is another run."""
    run = search.runs[-1]
    changes = ", ".join(f"{key} = {shown(value)}" for key, value in search.wanted.items())
    click.echo(
        f"accuracy: {share(run['estimate'])} of {share(search.asked)} asked, next with {changes}",
        err=True,
    )


def shown(value: Any) -> str:
    """A value in a table."""
    if isinstance(value, list):
        return " x ".join(map(str, value))
    if isinstance(value, Mapping) and "method" in value:
        return f"{value['method']}, {value['vibration_modes']} modes"
    if isinstance(value, Mapping):
        around = [f"{cells:g}" for key, cells in value.items() if "cells_around" in key]
        return f"{' and '.join(around)} cells around"
    return f"{value:g}"


def accuracy_lines(summary: Mapping[str, Any]) -> list[str]:
    """What was chosen for an accuracy, run by run, and why."""
    if "accuracy" not in summary:
        return []
    found = summary["accuracy"]
    runs = found["runs"]
    columns = ["pilot", *(f"run {k}" for k in range(1, len(runs)))]
    rows = [[f"accuracy, {share(found['asked'])} asked", *columns]]
    for key in runs[0]["chosen"] | runs[-1]["chosen"]:
        values = [run["chosen"].get(key) for run in runs]
        rows.append([key, *("as given" if value is None else shown(value) for value in values)])
    for key, words in COMPONENTS.items():
        if key in runs[0]["errors"]:
            values = [share(run["errors"].get(key, NOT_ESTIMATED)) for run in runs]
            rows.append([f"largest by {words}", *values])
    rows.append(["largest total", *(share(run["estimate"]) for run in runs)])
    rows.append(["processor time", *(f"{run['processor_time_s']:.1f} s" for run in runs)])
    missed = [] if found["met"] else [f"  {summary['warnings'][-1]}"]
    lines = aligned(rows)
    return lines + [f"  kept as written: {', '.join(found['kept'])}"] * bool(found["kept"]) + missed
