"""Oil that pressure makes denser in the coupled steps of mechanisms."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_rod import CLEARANCE
from mechanism_cases import REVOLUTION, SPEED
from oil_cases import (
    CLOSED,
    ETA,
    RADIUS,
    heights,
    oil_film,
    oscillating,
    rigid_slider_crank,
    whirling,
    with_oil,
)
from oracle_compressible import CompressibleArc
from rough_cases import surfaces
from test_conserved_oil import GROOVE, assert_oil_derivatives, flown
from test_coupled_steps import mechanism_with

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.bearing.operating_point import solve_bearing
from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.film import Lubricant
from fenics_ehd.film.lubricant import Barus, DowsonHigginson
from fenics_ehd.film.mass_conserving import MassConservingFilm
from fenics_ehd.film.reynolds import DensityRate
from fenics_ehd.film.supply import AxialGroove
from fenics_ehd.multibody import oil_densities
from fenics_ehd.multibody.bdf import NEWTON_FRACTION
from fenics_ehd.multibody.run import Run, Steps
from fenics_ehd.multibody.simulation import simulate
from fenics_ehd.multibody.tracking import Tracker

pytestmark = pytest.mark.kernels

GROUP = "oil"
DENSE = Lubricant(ETA, density_law=DowsonHigginson())


def without_oil(mechanism):
    """The same under Reynolds' condition."""
    film = replace(mechanism.joints["film"], oil=None)
    return replace(mechanism, joints={**mechanism.joints, "film": film})


# --- Against a computation of our own


def squeezed(cells, steps, conserved, amplitude=0.3, speed=100.0, supply=4e8, clearance=3e-6):
    """Pressures of a journal that moves to and fro between two lines, and those of the oracle."""
    lines = tuple(AxialGroove(angle, 0.0, supply) for angle in (np.pi / 2, -np.pi / 2))
    film = oil_film((cells, 1), clearance=clearance, sides=CLOSED, regions=lines, oil=DENSE)
    mechanism = oscillating(film, amplitude, speed)
    end = 0.7 * 2 * np.pi / speed
    # A first step as long as others is of order one, whose error has faded at the end.
    control = Steps(tolerance=0.9, order=2, largest=1.0001 / steps, first=end / steps)
    *_, last = Run(mechanism if conserved else without_oil(mechanism), control, end).until(end)
    (state,) = last.solution.films
    phi, every = heights(film)
    errors = []
    for middle in (0.0, np.pi):
        arc = CompressibleArc(
            middle, clearance, RADIUS, ETA, supply, lambda t: amplitude * np.cos(speed * t)
        )
        angle, expected = arc.pressures(end)
        place = np.mod(phi - middle + np.pi, 2 * np.pi) - np.pi + middle
        inside = np.abs(place - middle) < np.pi / 2 - 1e-9
        found = np.interp(place[inside], angle, expected)
        errors.append(np.abs(state.pressure[::every][inside] - found).max())
    return max(errors) / supply, state


@pytest.mark.parametrize("conserved", [False, True])
def test_a_squeezed_film_is_that_of_finite_volumes(conserved, figure):
    errors = []
    for cells, steps in ((16, 40), (32, 80), (64, 160)):
        error, state = squeezed(cells, steps, conserved)
        assert state.pressure.min() > 1e8
        errors.append(error)
    what = "conserved" if conserved else "under Reynolds' condition"
    name = f"compressible oil {what}, squeezed journal, pressure over the supply's"
    figure(GROUP, name, errors[-1], most=5e-4, unit="%")
    figure(GROUP, f"{name}, observed order", np.log2(errors[0] / errors[-1]) / 2, least=1.7)


def test_the_density_counts_in_that_test():
    # A hundred times its errors.
    _, dense = squeezed(16, 40, False)
    lines = AxialGroove(np.pi / 2, 0.0, 4e8), AxialGroove(-np.pi / 2, 0.0, 4e8)
    film = oil_film((16, 1), clearance=3e-6, sides=CLOSED, regions=lines)
    alone = film.solve(dense.gap).pressure
    assert np.abs(alone - dense.pressure).max() > 0.02 * 4e8


# --- Against films alone


def test_one_step_formulas_solve_what_a_film_under_reynolds_condition_does():
    film = oil_film((24, 4), regions=(GROOVE,), oil=DENSE)
    mechanism = without_oil(whirling(film, 0.8, 150.0))
    end = 0.3 * REVOLUTION
    run = Run(mechanism, Steps(tolerance=1e-5, order=1, largest=0.05), end)
    density, time, expanded = 1.0 + 0.0 * film.points.angle, 0.0, 0.0
    for step in run.until(end):
        (state,) = step.solution.films
        shift = 1.0 / (step.time - time)
        found = film.solve(state.gap, density_rate=DensityRate(shift, -shift * density))
        steady = film.solve(state.gap).pressure
        density, time = film.density(found), step.time
        largest = found.pressure.max()
        np.testing.assert_allclose(state.pressure, found.pressure, atol=1e-5 * (largest + 1e3))
        expanded = max(expanded, np.abs(steady - found.pressure).max() / largest)
    assert expanded > 1e-3


def test_one_step_formulas_solve_what_a_film_that_conserves_its_oil_does():
    film = oil_film((24, 4), regions=(GROOVE,), oil=DENSE)
    end = 0.3 * REVOLUTION
    control = Steps(tolerance=1e-5, order=1, largest=0.05)
    run = Run(whirling(film, 0.8, 150.0, filling=0.9), control, end)
    alone = MassConservingFilm(film)
    (place,) = run.equations.system.films
    gap = place.film.gap(run.state.x[0, place.xi], run.state.rate[0, place.xi], SPEED)
    content, time = alone.filled(gap, 0.9), 0.0
    content = np.where(alone.balance.reservoir, alone.filled(gap), content)
    for step in run.until(end):
        (state,) = step.solution.films
        found = alone.solve(state.gap, content, step.time - time)
        content, time = found.content, step.time
        largest = found.pressure.max()
        np.testing.assert_allclose(state.pressure, found.pressure, atol=1e-5 * (largest + 1e3))
        np.testing.assert_allclose(state.content, content, atol=1e-6 * content.max())
    assert largest > 1e7


# --- Balance


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("rough", [None, surfaces(1e-6, 0.9)], ids=["smooth", "rough"])
def test_a_closed_film_keeps_its_oil_whatever_the_formula(order, rough, figure):
    film = oil_film((20, 3), sides=CLOSED, oil=DENSE, surfaces=rough)
    run = Run(
        rigid_slider_crank(film, filling=0.97), Steps(tolerance=3e-3, order=order), REVOLUTION
    )
    _, content, outflow, _ = flown(run, 0.4 * REVOLUTION, NEWTON_FRACTION * 3e-3)
    assert not outflow.any()
    name = f"compressible oil, order {order}, change of a closed film's content"
    if rough is not None:
        name += ", rough"
    figure(GROUP, name, np.abs(content / content[0] - 1).max(), most=1e-12)


# --- Derivatives; under Reynolds' condition in `test_coupled_steps`


@pytest.mark.parametrize("rough", [None, surfaces(CLEARANCE / 2, 0.9)], ids=["smooth", "rough"])
@pytest.mark.parametrize("residual", [False, True])
def test_derivatives_of_conserved_oil_equal_central_differences(residual, rough, monkeypatch):
    oil = Lubricant(ETA, Barus(1e-8), DowsonHigginson())
    film = oil_film((12, 3), regions=(GROOVE,), oil=oil, surfaces=rough)
    mechanism = with_oil(mechanism_with("bilinear", residual), film)
    assert_oil_derivatives(mechanism, monkeypatch)


# --- Runs


def test_a_run_goes_on_to_the_last_bit():
    film, end = oil_film((16, 3), family="lagrange", oil=DENSE), 0.05 * REVOLUTION
    steps, mechanism = Steps(tolerance=1e-3), rigid_slider_crank(film)
    whole, stopped, other = (Run(mechanism, steps, end) for _ in range(3))
    for _ in whole.until(end):
        pass
    for number, _ in enumerate(stopped.until(end)):
        if number == 12:
            break
    other.load_state(stopped.stored_state())
    for _ in other.until(end):
        pass
    assert other.state.x.shape[1] == whole.equations.system.n + film.points.angle.size
    np.testing.assert_array_equal(other.state.x, whole.state.x)


def test_an_oil_is_a_spring_that_formulas_of_order_3_do_not_damp():
    found = {}
    for name, oil in (("stiff", Lubricant(ETA)), ("dense", DENSE)):
        run = Run(rigid_slider_crank(oil_film((16, 3), oil=oil)), Steps(tolerance=1e-3), 1e-3)
        found[name] = run.equations.system.least_damping
    assert found == {"stiff": np.inf, "dense": 0.0}


def test_nothing_of_it_is_computed_without_it(monkeypatch):
    monkeypatch.setattr(oil_densities.OilDensity, "__init__", None)
    run = Run(rigid_slider_crank(oil_film((12, 2))), Steps(tolerance=1e-2), 0.01 * REVOLUTION)
    *_, last = run.until(0.01 * REVOLUTION)
    assert len(last.x) == run.equations.system.n
    Tracker(run.equations, run.norm).add(last)


@pytest.mark.slow
def test_what_it_changes_in_the_machine(figure):
    found = {}
    for name, oil in (("stiff", Lubricant(ETA)), ("dense", DENSE)):
        film = oil_film((32, 6), family="lagrange", oil=oil)
        result = simulate(rigid_slider_crank(film), REVOLUTION, tolerance=1e-4, order=2)
        late = result.time > 0.1 * REVOLUTION
        found[name] = result.columns["min_film_thickness_m"][late].min()
    changed = found["dense"] / found["stiff"] - 1
    figure(GROUP, "Dowson and Higginson's law, minimum film of a rigid slider-crank",
           changed, least=0.01, unit="%")  # fmt: skip
    assert changed < 0.03


def test_coefficients_of_a_bearing_do_not_know_it():
    dense = BearingSettings(cells_around=16, cells_along=3, density_law="dowson-higginson")
    plain = BearingSettings(cells_around=16, cells_along=3)
    pressures = [solve_bearing(s, eccentricity=0.8).max_pressure for s in (dense, plain)]
    assert 1.001 < pressures[0] / pressures[1] < 1.1
    with pytest.raises(SettingsError, match="coefficients need density_law = 'constant'"):
        solve_bearing(dense, eccentricity=0.8, with_coefficients=True)
