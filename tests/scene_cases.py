"""Small scenes of bodies and joints for tests: shipped ones with some settings changed."""

import json
import tomllib
from collections.abc import Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from types import MappingProxyType
from typing import Any

from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.scenes.library import shipped
from fenics_ehd.scenes.part import elastic_part
from fenics_ehd.scenes.scene import scene_of

#: The paper's machine with a rod of a file next to the scene, for `hand_made_rod.make_body`.
ROD_OF_A_FILE = {
    "bodies.rod": {
        "kind": "flexible",
        "body": "rod.h5",
        "damping_time": 1e-3,
        "position": [0.048, 0.0],
    }
}

#: The paper's machine with a rigid rod and a coarse film: nothing is meshed.
RIGID_ROD = {
    "bodies.rod": {
        "kind": "rigid",
        "mass": 0.973,
        "inertia": 4e-3,
        "centre": [0.0677, 0.0],
        "position": [0.048, 0.0],
        "points": {"bore": [0.0, 0.0], "pin": [0.16, 0.0]},
    },
    "joints.big_end.radius": 0.0225,
    "joints.big_end.width": 0.022,
    "joints.big_end.cells": [12, 3],
}

#: A load that repeats, as a table.
LOAD = "time_s,Fx_N,Fy_N\n0,500,900\n5e-3,0,500\n10e-3,-500,900\n15e-3,0,1200\n20e-3,500,900\n"

#: The shipped loaded journal under `LOAD` on a coarse film.
LOADED_JOURNAL = {
    "forces.load.file": "load.csv",
    "joints.bearing.cells": [12, 2],
    "time.revolutions": None,
    "time.of": None,
    "time.period": 20e-3,
    "time.tolerance": 1e-3,
    "time.largest_step": 0.1,
    "time.periodicity": 1e-3,
}


class Raw(str):
    """Text of a value in TOML, written as it is."""


def tables_of(scene: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of a shipped scene, changed by dotted keys; None takes a key out."""
    tables = tomllib.loads(shipped(scene))
    for path, value in changes.items():
        *groups, key = path.split(".")
        table = tables
        for group in groups:
            table = table.setdefault(group, {})
        if value is None:
            table.pop(key, None)
        else:
            table[key] = deepcopy(value)
    return tables


def toml(tables: Mapping[str, Any]) -> str:
    """TOML text of tables, one dotted key a line."""
    return "".join(f"{line}\n" for line in _lines(tables))


def _lines(tables: Mapping[str, Any], place: str = "") -> Iterator[str]:
    for key, value in tables.items():
        if isinstance(value, Mapping) and value:
            yield from _lines(value, f"{place}{key}.")
        else:
            yield f"{place}{key} = {value if isinstance(value, Raw) else json.dumps(value)}"


def write_scene(path: Path, scene: str, *changes: Mapping[str, Any]) -> Path:
    """Write a shipped scene with changes, and the load that `LOADED_JOURNAL` names."""
    together = {key: value for change in changes for key, value in change.items()}
    path.write_text(toml(tables_of(scene, together)))
    if together.get("forces.load.file") == "load.csv":
        (path.parent / "load.csv").write_text(LOAD)
    return path


def structure(
    scene: str, body: str, comm: MPI.Comm, changes: Mapping[str, Any] = MappingProxyType({})
) -> ehd.Structure:
    """The assembled part of a body of a shipped scene with changes; collective."""
    settings = scene_of(tables_of(scene, changes), scene).bodies[body]
    source = elastic_part(settings, f"bodies.{body}", "lagrange", comm).source
    assert isinstance(source, ehd.Structure)
    return source
