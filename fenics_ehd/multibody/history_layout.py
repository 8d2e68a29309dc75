"""What a history holds, by path and unit, and the result that it makes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fenics_ehd.base.columns import DIMENSIONLESS, Quantity, split_unit
from fenics_ehd.multibody.result import BodyResult, FilmResult, JointResult, Quantities, Result

#: Column of the time, and its path.
TIME = "time_s"

#: Units of fields by the last part of their path; the state has one for each coordinate.
FIELD_UNITS = {
    "pressure": "Pa",
    "gap": "m",
    "fluid_fraction": DIMENSIONLESS,
    "quasi_static": "Pa",
    "angle": "rad",
    "height": "m",
    "cells": DIMENSIONLESS,
}


def field_unit(path: str) -> str:
    """Unit of a field by its path."""
    return FIELD_UNITS.get(path.rpartition("/")[2], DIMENSIONLESS)


def path_of(column: str, groups: Mapping[str, str]) -> tuple[str, str]:
    """Path and unit of a column of a history: ``joints/big_end/force_x``, ``N``.

    Parameters
    ----------
    column
        With its unit, ``big_end.force_x_N``.
    groups
        Group and name of columns that are not the whole run's, ``joints/big_end/force_x_N``.
    """
    return split_unit(groups.get(column, TIME if column == TIME else f"run/{column}"))


def beginning(rows: Mapping[str, np.ndarray], names: Sequence[str]) -> dict[str, np.ndarray]:
    """A cycle that repeats itself at its start: as it ends, a period and whole turns before.

    Parameters
    ----------
    rows
        What it holds of its steps, by path.
    names
        Of the mechanism's coordinates.

    Returns
    -------
    dict
        What a row before the first one holds, by path.
    """
    found = {path: np.array(values[-1]) for path, values in rows.items()}
    turning = np.array([name.endswith("/angle") for name in names], bool)
    turns = {path: 2 * np.pi for path in rows if re.fullmatch("bodies/.*/angle", path)}
    for path, turn in ({"run/crank_angle": 360.0, "state/coordinates": 2 * np.pi} | turns).items():
        whole = turn * np.round((rows[path][-1] - rows[path][0]) / turn)
        found[path] -= whole * turning if path == "state/coordinates" else whole
    for path in rows:
        if path.endswith("_work") or path == "run/energy_defect":
            found[path][...] = 0.0
    found["time"] -= found["run/cycle_time"]
    found["run/cycle_time"][...] = 0.0
    return found


def assemble_result(
    values: Mapping[str, Quantity],
    names: Sequence[str],
    films: Mapping[str, Mapping[str, Any]],
    summary: Mapping[str, Any],
    scene: Mapping[str, Any] | None = None,
) -> Result:
    """A result of what a run records, in memory or on disk.

    Parameters
    ----------
    values
        Arrays by path: ``time``, ``run/*``, ``bodies/NAME/*``, ``joints/NAME/*``,
        ``joints/NAME/film/*``, ``state/*``.
    names
        Of the mechanism's coordinates, ``bodies/rod/x``.
    films
        Family, radius and clearance of films by joint; empty: they were not read.
    summary, scene
        See `Result`.
    """
    tree: dict[str, dict[str, dict[str, Quantity]]] = {"joints": {}, "bodies": {}}
    run, nodal = {"time": values["time"]}, {name: dict(film) for name, film in films.items()}
    for path, found in values.items():
        match path.split("/"):
            case ["run", name]:
                run[name] = found
            case ["joints" | "bodies" as kind, owner, name]:
                tree[kind].setdefault(owner, {})[name] = found
            case ["joints", owner, "film", name]:
                nodal[owner][name] = found
    z, rates = (np.asarray(values[f"state/{name}"]) for name in ("coordinates", "rates"))
    owners = np.array([name.rpartition("/")[0] for name in names])
    bodies = {}
    for name in dict.fromkeys([*tree["bodies"], *_names(owners)]):
        own = owners == f"bodies/{name}"
        bodies[name] = BodyResult(tree["bodies"].get(name, {}), z[:, own], rates[:, own])
    joints = {
        name: JointResult(found, FilmResult(**nodal[name]) if nodal else None)
        for name, found in tree["joints"].items()
    }
    patterns = np.asarray(values.get("state/quasi_static", np.zeros((len(z), 0))))
    every = Quantities(run)
    return Result(_time(every), joints, bodies, every, z, rates, patterns, summary, scene or {})


def _names(owners: np.ndarray) -> list[str]:
    """Of bodies that have coordinates."""
    return [owner.partition("/")[2] for owner in owners if owner.startswith("bodies/")]


def _time(run: Quantities) -> Quantity:
    """That of the cycle where all steps are of one."""
    numbers = run.get("cycle")
    one = numbers is not None and len(numbers) and numbers[0] == numbers[-1]
    return run["cycle_time" if one else "time"]
