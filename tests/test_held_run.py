"""Derivatives in the steps of the run against the exact ones of the equations of these steps.

Version 0.2 differentiated every step by its own matrix, along numbers and all that was before; the
elasticities here are those.
"""

import numpy as np
import pytest
from scene_cases import RIGID_ROD, tables_of

from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.scenes.scene import scene_of
from fenics_ehd.study.sensitivity import scene_sensitivity

#: The engine with a rigid rod and coarse films.
ROD = {"position": [0.043, 0.0], "points": {"bore": [0.0, 0.0], "pin": [0.143, 0.0]}}
RIGID_ENGINE = RIGID_ROD | {
    "bodies.rod": RIGID_ROD["bodies.rod"] | ROD,
    "joints.front.cells": [12, 2],
    "joints.back.cells": [12, 2],
    "joints.big_end.cells": [12, 2],
}
FRICTION = {"joints.big_end.friction": True, "joints.big_end.cells": [40, 5]}
FROM_ITS_START = {"time.periodic": False}
TWO_BEARINGS = {"joints.left.cells": [12, 2], "joints.right.cells": [12, 2]}
JOURNAL = {"joints.bearing.cells": [20, 4], "time.largest_step": 0.1}
GROOVE = {"joints.bearing.grooves": [[90.0, 18.0, 2e5]]}
HOLE = {
    "kind": "hole",
    "on": "journal",
    "angle": 90.0,
    "diameter": 8e-3,
    "pressure": 3e5,
    "resistance": 1e9,
}
ROUGH = {
    "joints.bearing.contact": {
        "journal_roughness": 0.8e-6,
        "bore_roughness": 0.8e-6,
        "asperity_product": 0.04,
        "asperity_slenderness": 1e-3,
        "bore_modulus": 210e9,
        "boundary_friction": 0.1,
    },
    "joints.bearing.friction": True,
    "forces.load.scale": 2.0,
}

#: Oil that is accounted for, fed by a short groove under a load that turns with the journal.
TURNING_LOAD = {
    "forces.load": {"kind": "rotating", "point": "journal", "amplitude": 1500.0, "speed": 300.0},
    "forces.weight": {"kind": "constant", "point": "journal", "force": [0.0, -3000.0]},
    "time.periodicity": 1e-4,
    "time.cycles": 40,
}
OIL = ("min_film_thickness", "max_pressure", "mean_side_flow", "mean_oil_content")

#: Scene, changes, figures, numbers, and elasticities by number and figure. The place of the rod's
#: mass hardly matters to the peak: runs in steps of their own do not tell that derivative's sign.
#: Peaks of the rotors lie between the nodes of coarse films: central differences of whole runs,
#: parameters 1 % lower and higher, step tolerance 3e-4.
MODELS = {
    "slider-crank": (
        "slider-crank",
        RIGID_ROD,
        ("min_film_thickness", "max_pressure"),
        ("joints.big_end.clearance", "rod.centre.x", "drives.crank.speed"),
        ((-0.52308, 0.51793), (0.12762, 0.0032), (-0.76173, 2.25898)),
    ),
    "supply": (
        "loaded-journal",
        JOURNAL | GROOVE | {"joints.bearing.supply": {"inlet": HOLE}, "time.periodicity": 2e-3},
        ("min_film_thickness", "mean_side_flow", "mean_inlet.flow"),
        ("inlet.pressure", "inlet.resistance"),
        ((0.10687, 0.34694, 2.98278), (0.10658, -0.02876, -0.93649)),
    ),
    "contact": (
        "loaded-journal",
        JOURNAL | ROUGH,
        ("min_film_thickness", "max_contact_pressure", "mean_contact_force"),
        ("journal_roughness", "load.scale"),
        ((0.03376, 4.07626, 4.98582), (-0.64695, 5.6394, 6.24303)),
    ),
    "conserved oil": (
        "loaded-journal-starved",
        JOURNAL | GROOVE | TURNING_LOAD,
        OIL,
        ("bearing.clearance", "oil.viscosity"),
        ((-0.49572, 0.52395, 1.53327, 0.86307), (0.74748, -0.26183, -0.26706, 0.06843)),
    ),
    "conserved oil that is compressible": (
        "loaded-journal-starved",
        JOURNAL | GROOVE | TURNING_LOAD | {"lubricants.oil.density_law": "dowson-higginson"},
        OIL,
        ("bearing.clearance", "journal.mass"),
        ((-0.49474, 0.82801, 1.52645, 0.86319), (-0.00032, 0.0002, -0.00013, 5e-05)),
    ),
    "starved journal": (
        "loaded-journal-starved",
        JOURNAL | {"joints.bearing.cells": [60, 6]},
        OIL,
        ("bearing.clearance",),
        ((-0.31953, -7.02729, 1.60682, 0.70069),),
    ),
    "rotor in two bearings": (
        "rotor-two-bearings",
        TWO_BEARINGS,
        ("left.min_film_thickness", "right.max_pressure"),
        ("left.clearance", "unbalance.amplitude"),
        ((-0.43319, 0.15745), (-0.37497, 0.28076)),
    ),
    "rotor whose films still change by 5 %": (
        "rotor-two-bearings",
        TWO_BEARINGS | {"time.periodicity": 0.05},
        ("left.min_film_thickness", "right.max_pressure"),
        ("left.clearance",),
        ((-0.43472, 0.15745),),
    ),
    "engine of three films": (
        "engine",
        RIGID_ENGINE,
        ("big_end.min_film_thickness", "front.max_pressure"),
        ("front.clearance", "gas.scale"),
        ((-5e-05, -4.04982), (-0.2678, 1.76107)),
    ),
    "slider-crank from its start": (
        "slider-crank",
        RIGID_ROD | FROM_ITS_START | {"time.revolutions": 0.6, "joints.big_end.cells": [8, 2]},
        ("min_film_thickness", "max_pressure"),
        ("joints.big_end.clearance",),
        ((-0.42724, 0.60019),),
    ),
    # Its peak has a kink: rows of nodes fill at once, along 1 % some of them a step earlier.
    "starved journal from its start": (
        "loaded-journal-starved",
        JOURNAL | GROOVE | FROM_ITS_START | {"time.revolutions": 0.3},
        ("min_film_thickness", "max_oil_content"),
        ("bearing.clearance",),
        ((-0.09705, 1.0),),
    ),
    # Where points fill and empty.
    "rigid rod": (
        "slider-crank",
        RIGID_ROD | FRICTION,
        ("mean_friction_power",),
        ("joints.big_end.clearance", "piston.mass"),
        ((-0.36429,), (0.12043,)),
    ),
    "elastic rod": (
        "slider-crank",
        {"bodies.rod.reduction.estimate_error": False} | FRICTION,
        ("mean_friction_power",),
        ("joints.big_end.clearance", "piston.mass"),
        ((-0.33439,), (0.11906,)),
    ),
}

#: Models of which no run takes long.
QUICK = ("slider-crank from its start", "starved journal from its start")


def largest_error(scene, changes, of, to, exact):
    """Of derivatives over themselves or, of elasticities below 0.1, over 0.1."""
    own = scene_of(tables_of(scene, {"time.tolerance": 1e-3} | changes), scene)
    found = scene_sensitivity(own, of, to)
    errors = []
    for number, expected in zip(found.parameters, exact, strict=True):
        for figure, wanted in zip(found.objectives, expected, strict=True):
            error = abs(found.elasticity(figure, number) - wanted)
            errors.append(error / max(abs(wanted), 0.1))
    return max(errors)


@pytest.mark.parametrize(
    "model",
    [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in MODELS],
)
def test_derivatives_are_the_exact_ones_of_every_model_of_films_and_several_joints(model, figure):
    error = largest_error(*MODELS[model])
    what = "mean friction's derivatives" if model.endswith(" rod") else "derivatives"
    name = f"{what} in the same steps against exact ones, {model}"
    figure("derivatives", name, error, most=2e-3 if model in QUICK else 0.01, unit="%")


def test_extremes_around_a_film_do_not_jump_from_node_to_node():
    errors = []
    for count in (24, 48):
        angle, height = (
            grid.ravel()
            for grid in np.meshgrid(np.linspace(0, 2 * np.pi, count + 1)[:-1], [-1.0, 0.0, 1.0])
        )
        found = []
        for place in np.linspace(-0.6, 0.6, 201) * 2 * np.pi / count:
            values = np.exp(np.cos(angle - place)) * (1.0 - 0.1 * height**2)
            found.append(FilmRows.of(angle, height).largest(values[None])[0][0])
        errors.append(np.abs(np.array(found) / np.e - 1.0).max())
    assert errors[1] < 0.2 * errors[0]
    # The largest of the nodes is below it by half a distance of nodes squared, over 2.
    assert errors[1] < 0.03 * 0.5 * (np.pi / 48) ** 2
