"""Stresses of the slider-crank's rod over the cycle: by method, by mesh, with and without damping.

    python benchmarks/stress_recovery.py [FOLDER]

runs the shipped machine with every reduction method, its film on the bore's own cells, then with M4
on other meshes, and `fenics-ehd stress` on each; runs that FOLDER has already are taken. Fields of
methods are compared with the completed ones of the full interface at every node.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import meshio
import numpy as np

from fenics_ehd.scenes.given import changed
from fenics_ehd.scenes.scene_file import read_scene
from fenics_ehd.scenes.scene_text import scene_text

METHOD, MODES = "bodies.rod.reduction.method", "bodies.rod.reduction.modes"
OWN_CELLS = {"joints.big_end.cells": []}
GEOMETRY = "bodies.rod.geometry."

METHODS = {
    "M1, 37 modes": {METHOD: "m1", MODES: 37},
    "M2, 37 modes": {METHOD: "m2", MODES: 37},
    "M3, 31 residual modes": {METHOD: "m3"},
    "M4": {METHOD: "m4"},
    "full": {METHOD: "full"},
}
MESHES = {
    "as shipped": {},
    "4 cells through the walls": {
        GEOMETRY + "big_end_layers": 4,
        GEOMETRY + "small_end_layers": 4,
    },
    "40 x 10 cells on the bore, 4 through the walls": {
        GEOMETRY + "bore_cells_around": 40,
        GEOMETRY + "bore_cells_along": 10,
        GEOMETRY + "big_end_layers": 4,
        GEOMETRY + "small_end_layers": 4,
        GEOMETRY + "shank_cells": 24,
    },
    "tetrahedra": {"bodies.rod.cells": "tet"},
}


def command(*arguments):
    """Output of a command of the package."""
    line = [sys.executable, "-m", "fenics_ehd.cli", *map(str, arguments)]
    return subprocess.run(line, check=True, text=True, stdout=subprocess.PIPE).stdout


def run(folder, name, changes):
    """Folder of a run of the slider-crank with other values."""
    place = folder / "".join(c if c.isalnum() else "-" for c in name)
    if not (place / "summary.json").exists():
        scene = folder / f"{place.name}.toml"
        scene.write_text(scene_text(changed(read_scene("slider-crank"), changes)))
        command("run", scene, "--no-plots", "-o", place)
    return place


def stress(place, *options):
    """The rod's figures and fields."""
    found = json.loads(command("stress", place, "--json", *options))
    rod = found["bodies"]["rod"]
    return rod, meshio.read(place / rod["fields"]).point_data, found["wall_time_s"]


def row(name, *values):
    """Print a row of a table."""
    print("| " + " | ".join([name, *values]) + " |", flush=True)


def mpa(value):
    """A stress in MPa."""
    return f"{value * 1e-6:.1f}"


def by_method(folder):
    """Half-ranges of every method as it is and completed."""
    places = {name: run(folder, name, OWN_CELLS | values) for name, values in METHODS.items()}
    _, exact, _ = stress(places["full"], "--complete")
    exact = exact["half_range_von_mises_Pa"]
    print(f"\nhalf-range, von Mises [MPa]; full interface, completed: {mpa(exact.max())}\n")
    row("method", "largest", "of a node at most off", "completed", "at most off", "stress [s]")
    row(*6 * ["---"])
    for name, place in places.items():
        cells = []
        for options in ([], ["--complete"]):
            _, fields, seconds = stress(place, *options)
            values = fields["half_range_von_mises_Pa"]
            off = 100 * np.abs(values - exact).max() / exact.max()
            cells += [mpa(values.max()), f"{off:.2f} %"]
        row(name, *cells, f"{seconds:.1f}")


def by_mesh(folder):
    """M4 on other meshes."""
    print()
    row("mesh", "nodes", "half-range", "cells around", "mean", "principal", "deformation alone")
    row(*7 * ["---"])
    for name, values in MESHES.items():
        place = run(folder, f"mesh {name}", values)
        alone, *_ = stress(place, "--no-damping")
        rod, *_ = stress(place)
        half = rod["half_range"]
        row(
            name,
            str(rod["nodes"]),
            mpa(half["von_mises_Pa"]),
            " to ".join(map(mpa, half["in_cells_around_Pa"])),
            mpa(half["mean_von_mises_Pa"]),
            mpa(rod["largest_principal"]["stress_Pa"]),
            mpa(alone["half_range"]["von_mises_Pa"]),
        )


def main():
    """Print both tables."""
    with TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1] if sys.argv[1:] else temporary)
        folder.mkdir(parents=True, exist_ok=True)
        by_mesh(folder)
        by_method(folder)


if __name__ == "__main__":
    main()
