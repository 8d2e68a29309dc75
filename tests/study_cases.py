"""A study of a coarse rod over a small part of a revolution."""

from sweep_cases import Inline

from fenics_ehd.study.folder import StudyFolder
from fenics_ehd.study.plan import make_study
from fenics_ehd.study.run import run_study
from fenics_ehd.study.scope import Scope
from fenics_ehd.study.variants import film, full, m1, m3, m4, rigid, steps

COARSE = {
    "bore_cells_around": 10,
    "bore_cells_along": 2,
    "big_end_layers": 1,
    "shank_cells": 4,
    "small_end_layers": 1,
}

#: More residual modes than there are pressures.
TOO_MANY = m3("pc2", "lowest-frequency", 500)

TINY = Scope(
    start=1e-4,
    settings={
        "mechanism.revolutions": 0.02,
        "rod.geometry": COARSE,
        "time.largest_step": 2.0,
        **steps(1e-4),
    },
    methods=(m1(10), m3("pc1", "largest-eigenvalue", 20), TOO_MANY, m4(6), rigid()),
    tolerances=(1e-3, 1e-4),
    stepped=(m4(6),),
    meshes=((10, 2), (20, 4), (40, 8)),
    meshed=(m3("pc1", "largest-eigenvalue", 20),),
    finest_steps=steps(1e-6, 3),
    reference=full(8),
    reference_steps=steps(1e-6, 3),
    step_check=steps(1e-5, 2),
    film_check=film(20, 4) | steps(1e-5),
    basis_check=(full(6), steps(1e-5, 3)),
)


def run_tiny(directory, study=None, **options):
    """Study, what the pool was given, and the rows."""
    study = study or make_study("slider-crank", scope=TINY)
    pool = Inline()
    with StudyFolder(directory, study, **options) as folder:
        rows = run_study(study, folder, pool)
    return study, pool, rows
