"""Films between rough surfaces that keep account of their oil, in coupled steps."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_rod import CLEARANCE
from mechanism_cases import REVOLUTION, SPEED
from oil_cases import CLOSED, ETA, oil_film, rigid_slider_crank, whirling, with_oil
from oracle_mass_conserving import ClosedJournalFilm, RoughClosedJournalFilm
from rough_cases import surfaces
from test_conserved_oil import (
    GROOVE,
    assert_oil_derivatives,
    assert_patterns_are_massless_coordinates,
    assert_steps_are_those_of_the_film_alone,
    closed_journal_errors,
    flown,
)
from test_coupled_steps import mechanism_with

from fenics_ehd.base.errors import FilmTooThinError
from fenics_ehd.film import Lubricant
from fenics_ehd.film.shape import Lobes
from fenics_ehd.film.supply import Sides
from fenics_ehd.multibody.bdf import NEWTON_FRACTION
from fenics_ehd.multibody.run import Run, Steps
from fenics_ehd.multibody.simulation import simulate

pytestmark = pytest.mark.kernels

GROUP = "contact"


# --- Derivatives


@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize(("share", "shape"), [(0.5, None), (0.9, None), (0.9, Lobes(3e-6, 0.3))])
def test_derivatives_equal_central_differences(residual, share, shape, monkeypatch):
    # Dry sides beside a round journal, oil around one that is not.
    # So rough and stiff that contact is everywhere, and as strong as the film.
    film = oil_film(
        (12, 3), surfaces=surfaces(CLEARANCE / 2, share, modulus=1e13), regions=(GROOVE,)
    )
    mechanism = with_oil(mechanism_with("bilinear", residual), film, oil_outside=shape is not None)
    joints = {
        name: replace(joint, journal_shape=shape) if hasattr(joint, "film") else joint
        for name, joint in mechanism.joints.items()
    }
    point = assert_oil_derivatives(replace(mechanism, joints=joints), monkeypatch)
    assert point.films[0].touch.pressure.max() > 1e6


# --- Against solutions of our own


@pytest.mark.slow
@pytest.mark.parametrize("whirl", [0.0, 400.0])
def test_a_closed_journal_settles_to_the_free_boundary_solution(whirl, figure):
    # Roughness a fifth of the clearance: H from 2.5 at the thinnest place on.
    ratio, share, clearance = 0.2, 0.2, 1e-6
    rough = surfaces(ratio * clearance, share)
    velocity = 0.5 - whirl / SPEED
    exact = RoughClosedJournalFilm(0.5, 0.8, ratio, 0.5 * ratio * rough.weight / velocity)
    assert abs(exact.largest_pressure / ClosedJournalFilm(0.5, 0.8).largest_pressure - 1) > 0.05
    errors = closed_journal_errors(exact, whirl, rough)
    rates = np.log2(errors[0] / errors[-1]) / 2
    name = f"conserved oil between rough surfaces, closed journal whirling at {whirl:g} rad/s"
    figure(GROUP, f"{name}, fluid fraction", errors[-1][0], most=0.01, unit="%")
    figure(GROUP, f"{name}, observed order of it", rates[0], least=0.9)
    figure(GROUP, f"{name}, largest pressure", errors[-1][1], most=0.02, unit="%")


def test_one_step_formulas_solve_what_a_film_alone_does():
    film = oil_film((24, 4), regions=(GROOVE,), surfaces=surfaces(2e-6, 0.9))
    control, end = Steps(tolerance=1e-5, order=1, largest=0.05), 0.5 * REVOLUTION
    run = Run(whirling(film, 0.7, 150.0, filling=0.6), control, end)
    state, largest = assert_steps_are_those_of_the_film_alone(film, run, end, 0.6)
    assert np.count_nonzero(largest > 1e5) > 10
    assert state.fluid_fraction.min() < 0.6


# --- Balance


def touching(*, cells=(20, 4), order=2, filling=1.0, tolerance=3e-3, **parameters):
    """The paper's machine whose rigid bearing touches, for the first half revolution."""
    film = oil_film(cells, surfaces=surfaces(), oil=Lubricant(2e-4), **parameters)
    mechanism = rigid_slider_crank(film, filling=filling)
    return Run(mechanism, Steps(tolerance=tolerance, order=order), REVOLUTION)


@pytest.mark.parametrize("order", [1, 2])
def test_a_closed_film_keeps_its_oil_whatever_the_formula(order, figure):
    run = touching(order=order, sides=CLOSED, filling=0.9)
    _, content, outflow, _ = flown(run, 0.2 * REVOLUTION, NEWTON_FRACTION * 3e-3)
    assert not outflow.any()
    name = f"conserved oil between rough surfaces, order {order}, change of a closed film's content"
    figure(GROUP, name, np.abs(content / content[0] - 1).max(), most=1e-12)


def test_content_changes_by_the_summed_flow_with_a_one_step_formula(figure):
    run = touching(order=1, tolerance=1e-2, regions=(GROOVE,))
    time, content, outflow, size = flown(run, 0.2 * REVOLUTION, NEWTON_FRACTION * 1e-2)
    defect = np.abs(np.diff(content) + np.diff(time) * outflow[1:]).max() / content[0]
    assert np.sum(np.diff(time) * size[1:]) > 0.1 * content[0]
    figure(GROUP, "conserved oil between rough surfaces, oil lost in a step", defect, most=1e-13)


# --- Limits


def test_without_roughness_the_film_is_that_of_smooth_surfaces(figure):
    def ends(rough):
        film = oil_film((20, 4), regions=(GROOVE,), surfaces=rough)
        steps = Steps(tolerance=0.9, order=2, first=2e-5, largest=0.02)
        *_, last = Run(rigid_slider_crank(film, filling=0.9), steps, 1e-3).until(1e-3)
        (state,) = last.solution.films
        return state.pressure / 1e6, state.fluid_fraction

    smooth = ends(None)
    errors = []
    for roughness in (0.8e-6, 0.4e-6, 0.2e-6):
        rough = ends(surfaces(roughness, 0.9))
        errors.append(max(np.abs(r - s).max() for r, s in zip(rough, smooth, strict=True)))
    name = "conserved oil between rough surfaces, 0.2 um against smooth ones"
    figure(GROUP, name, errors[-1], most=1e-3)
    assert errors[0] > 4 * errors[1] > 16 * errors[2]


#: Until surfaces touch, and what makes them.
END, THIN = 1.7e-3, {"oil": Lubricant(2e-4), "sides": Sides(1e5, 1e5)}


def touched(tolerance, rough):
    film = oil_film((16, 3), **THIN, surfaces=rough)
    return simulate(rigid_slider_crank(film, filling=1.0), END, tolerance=tolerance)


def test_a_run_that_ends_with_smooth_surfaces_goes_on_with_rough_ones():
    with pytest.raises(FilmTooThinError):
        touched(1e-3, None)
    result = touched(1e-3, surfaces())
    assert result.time[-1] == pytest.approx(END)
    assert result.columns["contact_share"].max() > 0.3
    assert result.newton_iterations < 3.0 * len(result.time)


@pytest.mark.slow
def test_energy_is_balanced(figure):
    defects = []
    for tolerance in (1e-4, 3e-7):
        columns = touched(tolerance, surfaces()).columns
        defects.append(np.abs(columns["energy_defect_J"]).max() / columns["film_work_J"][-1])
    name = "conserved oil between rough surfaces, energy balance over what is dissipated, 3e-7"
    figure(GROUP, name, defects[1], most=1e-3)
    assert defects[1] < 0.3 * defects[0]


@pytest.mark.slow
def test_residual_patterns_are_coordinates_without_mass():
    film = oil_film((12, 3), surfaces=surfaces(2e-6), oil=Lubricant(0.1 * ETA))
    found = assert_patterns_are_massless_coordinates(film, "max_contact_pressure_Pa")
    assert found["max_contact_pressure_Pa"][-1] > 1e5
