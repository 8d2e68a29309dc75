"""Stiff and extreme runs: what was found wrong with them, and quick rows of the benchmark."""

import numpy as np
import pytest
from extremes import measured
from extremes_case import scene
from extremes_machines import machines
from extremes_numerics import numerics
from extremes_runs import Workshop
from scene_runs import changed, follow

from fenics_ehd.base.errors import FilmTooThinError
from fenics_ehd.multibody.run import Run

QUICK = (
    "E = 1 GPa, 500 rad/s",
    "piston 10 kg, 500 rad/s",
    "viscosity 0.5 Pa s",
    "n_r = 8, P_c1",
    "zeta 0, M4 truncated at 0.1",
    "start at e_x = 0.98 c",
    "crank reversed by a brake, rigid",
)


@pytest.fixture(scope="module")
def shop():
    return Workshop()


@pytest.fixture(scope="module")
def rows(shop):
    return {case.name: case for case in (*machines(shop.folder), *numerics())}


def test_few_rows_expect_errors(rows):
    assert sum(case.error is not None for case in rows.values()) <= len(rows) / 4


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_a_row_goes_as_expected(shop, rows, name):
    row = measured(shop, rows[name])
    assert row.passed, row.cells()


def new_run(shop, settings):
    built = shop.build(settings)
    return Run(built.mechanism, built.steps, settings.span)


def test_a_film_without_thickness_is_an_infinite_error(shop):
    run = new_run(shop, scene("m3"))
    observed = run.norm.observe(run.state.x[0])
    error = np.zeros_like(observed)
    gaps = run.norm.gaps(observed)
    error[: len(gaps)] = 1e-9
    assert run.norm.error_norm(observed, error) == pytest.approx(1e-9 / gaps.min())
    observed[3] = -1e-7
    assert run.norm.error_norm(observed, error) == np.inf


def test_a_run_does_not_step_through_the_bore(shop):
    """A rod as soft as rubber: the film closes at its nodes before it does at Gauss points."""
    soft = {"bodies.rod.material.youngs_modulus": 1e9}
    found = follow(new_run(shop, scene("m3", 0.1, soft)), 1.0)
    assert isinstance(found.error, FilmTooThinError)
    assert found.film.min() > 0


def test_few_patterns_without_damping_start_a_film(shop):
    """Full updates lead from one active set to another and back there, from 1e-8 s down."""
    few = {"bodies.rod.reduction.residual_truncation": 0.1, "bodies.rod.damping_time": 0.0}
    settings = scene("m4", 0.002, few)
    run = new_run(shop, settings)
    found = follow(run, settings.span)
    assert found.error is None
    assert found.figures["max_pressure_Pa"] > 1e6
    assert found.figures["rejected_because"].keys() <= {"error above tolerance"}
    # Only where full updates fail are others tried.
    attempts = found.figures["steps"] + found.figures["rejected_steps"]
    assert attempts < run.solve.solves < 1.5 * found.figures["steps"]


def test_steps_that_converge_at_once_need_no_search(shop):
    settings = changed(scene("m3", 0.01), {"time.tolerance": 1e-5})
    run = new_run(shop, settings)
    figures = follow(run, settings.span).figures
    assert run.solve.solves == figures["steps"] + figures["rejected_steps"]
