"""Films between rough surfaces: the average gap and flow factors in the Reynolds equation."""

from dataclasses import replace

import numpy as np
import pytest
from film_cases import OMEGA, C, R, make_film
from rough_cases import surfaces

import fenics_ehd as ehd

ROUGH = {
    "average gap alone": surfaces(flow_factors=False),
    "equal": surfaces(),
    "rough journal": surfaces(share=0.9),
}


def touching(film, seed=3):
    """A gap whose surfaces overlap at some points."""
    p = film.parameters
    motion = ehd.ShaftMotion(C * np.array([0.99, 0.12]), OMEGA, C * np.array([0.0, 30.0]))
    gap = ehd.shaft_gap(film.points, R, C, motion)
    bump = 0.01 * C * np.random.default_rng(seed).standard_normal(gap.thickness.shape)
    gap = replace(gap, thickness=gap.thickness + bump)
    assert gap.thickness.min() < 0.0 < gap.thickness.min() + 2 * p.surfaces.roughness
    return gap


def test_film_far_above_its_roughness_is_that_of_smooth_surfaces():
    smooth, rough = make_film(), make_film(surfaces=surfaces(0.1e-6, flow_factors=False))
    gap = ehd.shaft_gap(smooth.points, R, C, ehd.ShaftMotion(C * np.array([0.9, 0.0]), OMEGA))
    assert gap.thickness.min() > 10 * 0.1e-6
    np.testing.assert_allclose(
        rough.solve(gap).pressure, smooth.solve(gap).pressure, rtol=1e-12, atol=1e-6
    )


def test_flow_factors_hinder_flow_and_roughness_on_the_journal_drags_it_along():
    gap, load = None, {}
    for name, rough in {
        "smooth": None,
        "equal": surfaces(1e-6, 0.5),
        "journal": surfaces(1e-6, 1.0),
        "bore": surfaces(1e-6, 0.0),
    }.items():
        film = make_film(surfaces=rough)
        gap = ehd.shaft_gap(film.points, R, C, ehd.ShaftMotion(C * np.array([0.8, 0.0]), OMEGA))
        load[name] = np.hypot(
            *(film.load(np.stack(film.points.normal, -1)) @ film.solve(gap).pressure)
        )
    # A rough surface that stands holds the oil back and builds up pressure (Patir and Cheng 1979).
    assert load["bore"] > load["equal"] > load["journal"]
    assert load["equal"] > load["smooth"]


@pytest.mark.parametrize("rough", ROUGH)
def test_powers_of_the_film_are_what_its_surfaces_do(rough):
    film = make_film(surfaces=ROUGH[rough], tolerance=1e-13)
    gap = touching(film)
    state = film.solve(gap)
    lost, fed = film.powers(state)
    area = film.assembly.area * R**2
    work = np.sum(area * film.assembly.at_points(state.pressure)[0] * gap.thickness_rate)
    assert lost - fed == pytest.approx(-work, rel=1e-8)


def test_surfaces_that_overlap_too_far_are_refused():
    film = make_film(surfaces=surfaces())
    gap = ehd.shaft_gap(film.points, R, C, ehd.ShaftMotion(C * np.array([1.2, 0.0]), OMEGA))
    with pytest.raises(ehd.errors.GapClosedError, match=r"overlap by .* their combined roughness"):
        film.solve(gap)
