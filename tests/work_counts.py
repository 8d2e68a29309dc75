"""Counts of the work of shortened runs and of reductions, and the golden file that has them.

Scenes are shortened: coarse parts and films, large steps, few of them. The part is `conrod` as
`slider-crank-paper` has it. Counts of these agree between BLAS kernels to 0.3 %.
`benchmarks/golden.py --counts` compares them with the golden file, or makes that anew.
"""

import json
import tempfile
from itertools import islice
from pathlib import Path

from golden_curves import SHIPPED, run_of
from mpi4py import MPI
from study_cases import COARSE
from sweep_cases import scene_as

import fenics_ehd as ehd
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.scenes.build import build
from fenics_ehd.scenes.part import body_counts, elastic_part

GOLDEN = Path(__file__).parent / "golden" / "counts.json"

#: Steps of every scene.
STEPS = 60

#: Settings of every reduction.
REDUCTIONS = {
    "m1-37": {"method": "m1", "modes": 37},
    "m2-37": {"method": "m2", "modes": 37},
    "m3": {"method": "m3"},
    "m4": {"method": "m4"},
    "full": {"method": "full"},
}

HOUSING = {
    "bodies.housing.geometry.bore_cells_around": 10,
    "bodies.housing.geometry.bore_cells_along": 2,
    "bodies.housing.geometry.ring_layers": 1,
    "bodies.housing.geometry.web_layers": 1,
    "bodies.housing.geometry.foot_layers": 1,
}

#: Coarse parts of the shipped scenes, by the name of the body.
PARTS = {"rod": COARSE, "housing": HOUSING}

#: Counts that must be the same. Others may differ by a share or a number, whichever is larger.
EXACT = {
    f"{prefix}{name}"
    for prefix in ("", "mesh_error_")
    for name in ("part_factorisations", "static_solves")
}
SHARE = 0.02
FEW = 2


def with_values(name, values):
    """A shipped scene with other values."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(scene_as(name, values))
        return ehd.read_scene(path)


def shortened(name):
    """A shipped scene with coarse parts and films."""
    values = {"film": 0.5, "time.tolerance": 1e-3}
    for body in ehd.read_scene(name).bodies:
        values |= PARTS.get(body, {})
        if body in PARTS:
            values |= {"reduction.estimate_error": False}
    return with_values(name, values)


def scene_counts(name):
    """Counts of the first steps of a shortened scene."""
    machine = build(shortened(name), cache=False)
    run = run_of(machine)
    recorder = Recorder(run, machine.period or machine.end)
    for _ in islice(recorder.steps(), STEPS):
        pass
    return dict(recorder.counts)


def rod_part(values):
    """The rod of `slider-crank-paper`, with other settings of its body."""
    scene = with_values("slider-crank-paper", {f"bodies.rod.{k}": v for k, v in values.items()})
    edges = scene.film_edges("rod")
    element = scene.film_element("rod")
    return elastic_part(scene.bodies["rod"], "bodies.rod", element, MPI.COMM_WORLD, edges)


def reduction_counts(name):
    """Counts of a reduction of the rod."""
    part = rod_part({f"reduction.{key}": value for key, value in REDUCTIONS[name].items()})
    return body_counts(part.reduce(mesh_error=name == "m4").body)


def counts_of(name):
    """Counts of a scene or of a reduction."""
    return reduction_counts(name) if name in REDUCTIONS else scene_counts(name)


def differing(counts, expected):
    """Counts that differ by more than the tolerance, with those expected; by name."""
    return {
        key: (counts.get(key), number)
        for key, number in expected.items()
        if key not in counts or abs(counts[key] - number) > allowance(key, number)
    }


def allowance(name, number):
    """Largest accepted difference of a count."""
    return 0 if name in EXACT else max(SHARE * number, FEW)


def stored():
    """Counts of the golden file, by scene or reduction."""
    return json.loads(GOLDEN.read_text())


def store():
    """Make the golden file anew."""
    counts = {name: counts_of(name) for name in (*SHIPPED, *REDUCTIONS)}
    GOLDEN.write_text(json.dumps(counts, indent=1) + "\n")
