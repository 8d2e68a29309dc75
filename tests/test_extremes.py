"""Stiff and extreme runs: what was found wrong with them, and quick rows of the benchmark."""

from dataclasses import replace

import numpy as np
import pytest
from extremes import measured
from extremes_case import scene
from extremes_machines import machines
from extremes_numerics import numerics
from extremes_runs import Workshop

from fenics_ehd.errors import FilmTooThinError
from fenics_ehd.reduction import residual_flexibility
from fenics_ehd.scenes.run import Totals, build_mechanism, simulate
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

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


def test_a_film_without_thickness_is_an_infinite_error(rod_body):
    machine = build_mechanism(SliderCrankSettings(), rod_body)
    gap = machine.watch(np.zeros(machine.size))
    error = np.full_like(gap, 1e-9)
    assert machine.error_norm(gap, error) == pytest.approx(1e-9 / gap.min())
    gap[3] = -1e-7
    assert machine.error_norm(gap, error) == np.inf


def test_a_run_does_not_step_through_the_bore(rod_body):
    """A rod as soft as rubber: the film closes at its nodes before it does at Gauss points."""
    soft = replace(rod_body, stiffness=rod_body.stiffness / 210)
    settings = scene("m3", 0.1)
    films = []
    with pytest.raises(FilmTooThinError):
        simulate(settings, soft, Totals(), lambda row, _: films.append(row["min_film_thickness_m"]))
    assert min(films) > 0


def test_few_patterns_without_damping_start_a_film(rod_structure):
    """Full updates lead from one partition to another and back there, from 1e-8 s down."""
    body = residual_flexibility(rod_structure, 6, truncation=0.1, estimate_error=False)
    settings = scene("m4", 0.002, rod__damping_time=0.0)
    totals = simulate(settings, body, Totals())
    assert totals.max_pressure > 1e6
    assert totals.rejections.keys() <= {"error above tolerance"}
    # Only where full updates fail are others tried.
    assert totals.steps + totals.rejected_steps < totals.film_solves < 1.5 * totals.steps


def test_steps_that_converge_at_once_need_no_search(rod_body):
    totals = simulate(scene("m3", 0.01), rod_body, Totals())
    assert totals.film_solves == totals.steps + totals.rejected_steps
