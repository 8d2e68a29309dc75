"""Work of the first steps of every shipped scene, counted: what no machine changes.

    python tests/work_counts.py

writes `tests/golden/counts.json`. Scenes are shortened: coarse parts and films, large steps.
"""

import json
import tempfile
from itertools import islice
from pathlib import Path

from golden_curves import SHIPPED, run_of
from study_cases import COARSE
from sweep_cases import scene_as

import fenics_ehd as ehd
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.scenes.build import build

GOLDEN = Path(__file__).parent / "golden" / "counts.json"

#: Steps of every scene.
STEPS = 60

HOUSING = {
    "bodies.housing.geometry.bore_cells_around": 10,
    "bodies.housing.geometry.bore_cells_along": 2,
    "bodies.housing.geometry.ring_layers": 1,
    "bodies.housing.geometry.web_layers": 1,
    "bodies.housing.geometry.foot_layers": 1,
}

#: Coarse parts of the shipped scenes, by the name of the body.
PARTS = {"rod": COARSE, "housing": HOUSING}


def shortened(name):
    """A shipped scene with coarse parts and films."""
    values = {"film": 0.5, "time.tolerance": 1e-3}
    for body in ehd.read_scene(name).bodies:
        values |= PARTS.get(body, {})
        if body in PARTS:
            values |= {"reduction.estimate_error": False}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(scene_as(name, values))
        return ehd.read_scene(path)


def counts_of(name):
    """Counts of the first steps of a scene."""
    machine = build(shortened(name))
    run = run_of(machine)
    recorder = Recorder(run, machine.period or machine.end)
    for _ in islice(recorder.steps(), STEPS):
        pass
    return dict(recorder.counts)


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps({name: counts_of(name) for name in SHIPPED}, indent=1) + "\n")
