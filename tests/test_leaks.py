"""Many runs in one process: nothing of a run stays behind."""

import gc

import pytest
from hand_made_rod import Joint, flexible, make_body
from journal_cases import UNIT_LOAD, orbit, periodic, scene
from petsc4py import PETSc
from test_coupled_steps import with_residual

from fenics_ehd.multibody.coupled import CoupledSteps
from fenics_ehd.scenes import transient
from fenics_ehd.scenes.run import Totals, simulate
from fenics_ehd.scenes.slider_crank_settings import BigEndFilm, Mechanism, SliderCrankSettings, Time


def run(body, **film):
    settings = SliderCrankSettings(
        mechanism=Mechanism(revolutions=0.0003), time=Time(tolerance=1e-3), film=BigEndFilm(**film)
    )
    simulate(settings, body, Totals())


def nine_nodes():
    run(make_body(Joint((8, 2))))


def weighted():
    run(make_body(Joint((8, 2))), element="serendipity")


def another_mesh():
    run(make_body(Joint((8, 2))), cells=(12, 3))


def residual_patterns():
    joint = Joint((8, 2))
    run(with_residual(joint, flexible(joint)[0]))


def journal():
    load = periodic(lambda share: (UNIT_LOAD * (1 + share - share**2), 0.0), 1e-3, rows=9)
    orbit(scene(cells=(8, 2), tolerance=1e-2, periodicity=0.9), load)


@pytest.mark.parametrize("work", [nine_nodes, weighted, another_mesh, residual_patterns, journal])
@pytest.mark.parametrize("sparse", [False, True])
def test_petsc_keeps_nothing_of_a_run(work, sparse, capfd, monkeypatch):
    if sparse:
        monkeypatch.setattr(transient, "CoupledSteps", lambda m: CoupledSteps(m, dense_limit=0))
    gc.collect()
    PETSc.garbage_cleanup(PETSc.COMM_SELF)
    work()
    gc.collect()
    capfd.readouterr()
    PETSc.garbage_view(PETSc.COMM_SELF)
    # Where there is garbage, a table of it.
    assert "|" not in capfd.readouterr().out
