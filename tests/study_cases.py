"""A study of a coarse rod over a small part of a revolution."""

from sweep_cases import Inline

from fenics_ehd.study.compare import StudyFolder, run_study
from fenics_ehd.study.plan import Scope, film, full, m1, m3, m4, make_study, rigid, steps

SCENE = "slider-crank-paper"

COARSE = {
    "bodies.rod.geometry.bore_cells_around": 10,
    "bodies.rod.geometry.bore_cells_along": 2,
    "bodies.rod.geometry.big_end_layers": 1,
    "bodies.rod.geometry.shank_cells": 4,
    "bodies.rod.geometry.small_end_layers": 1,
}

#: More residual modes than there are pressures.
TOO_MANY = m3("pc2", "lowest-frequency", 500)

#: Time from which on errors count [s].
START = 1e-4

TINY = Scope(
    settings={"time.revolutions": 0.02, "time.largest_step": 0.0055, **COARSE, **steps(1e-4)},
    methods=(m1(10), m3("pc1", "largest-eigenvalue", 20), TOO_MANY, m4(6), rigid()),
    tolerances=(1e-3, 1e-4),
    stepped=(m4(6),),
    films=(1, 2, 4),
    meshed=(m3("pc1", "largest-eigenvalue", 20),),
    finest_steps=steps(1e-6),
    reference=full(8),
    reference_steps=steps(1e-6),
    step_check=steps(1e-5),
    film_check=film(2) | steps(1e-5),
    basis_check=(full(6), steps(1e-5)),
)


def tiny_study(scope=TINY, scene=SCENE, start=START):
    return make_study(scene, scope=scope, start=start)


def run_tiny(directory, study=None, **options):
    """Study, what the pool was given, and the rows."""
    study = study or tiny_study()
    pool = Inline()
    with StudyFolder(directory, study, **options) as folder:
        rows = run_study(folder, pool)
    return study, pool, rows
