"""Oil that pressure makes denser in the coupled steps of mechanisms."""

import numpy as np
import pytest
from hand_made_rod import CLEARANCE
from mechanism_cases import REVOLUTION
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
from test_conserved_oil import (
    GROOVE,
    assert_oil_derivatives,
    assert_steps_are_those_of_the_film_alone,
    flown,
)
from test_coupled_steps import mechanism_with

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.bearing.operating_point import solve_bearing
from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.film import Lubricant
from fenics_ehd.film.lubricant import Barus, DowsonHigginson
from fenics_ehd.film.supply import AxialGroove, Sides
from fenics_ehd.multibody.bdf import NEWTON_FRACTION
from fenics_ehd.multibody.run import Run, Steps
from fenics_ehd.multibody.simulation import simulate

pytestmark = pytest.mark.kernels

GROUP = "oil"
DENSE = Lubricant(ETA, density_law=DowsonHigginson())


# --- Against a computation of our own


def squeezed(cells, steps, amplitude=0.3, speed=100.0, supply=4e8, clearance=3e-6):
    """Pressures of a journal that moves to and fro between two lines, and those of the oracle."""
    lines = tuple(AxialGroove(angle, 0.0, supply) for angle in (np.pi / 2, -np.pi / 2))
    film = oil_film((cells, 1), clearance=clearance, sides=CLOSED, regions=lines, oil=DENSE)
    mechanism = oscillating(film, amplitude, speed)
    end = 0.7 * 2 * np.pi / speed
    # A first step as long as others is of order one, whose error has faded at the end.
    control = Steps(tolerance=0.9, order=2, largest=1.0001 / steps, first=end / steps)
    *_, last = Run(mechanism, control, end).until(end)
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


def test_a_squeezed_film_is_that_of_finite_volumes(figure):
    errors = []
    for cells, steps in ((16, 40), (32, 80), (64, 160)):
        error, state = squeezed(cells, steps)
        assert state.pressure.min() > 1e8
        errors.append(error)
    name = "compressible oil, squeezed journal, pressure over the supply's"
    figure(GROUP, name, errors[-1], most=5e-4, unit="%")
    figure(GROUP, f"{name}, observed order", np.log2(errors[0] / errors[-1]) / 2, least=1.7)


def test_the_density_counts_in_that_test():
    # A hundred times its errors.
    _, dense = squeezed(16, 40)
    lines = AxialGroove(np.pi / 2, 0.0, 4e8), AxialGroove(-np.pi / 2, 0.0, 4e8)
    film = oil_film((16, 1), clearance=3e-6, sides=CLOSED, regions=lines)
    alone = film.solve(dense.gap).pressure
    assert np.abs(alone - dense.pressure).max() > 0.02 * 4e8


# --- Against films alone


def test_one_step_formulas_solve_what_a_film_that_conserves_its_oil_does():
    film = oil_film((24, 4), regions=(GROOVE,), oil=DENSE)
    control, end = Steps(tolerance=1e-5, order=1, largest=0.05), 0.3 * REVOLUTION
    run = Run(whirling(film, 0.8, 150.0, filling=0.9), control, end)
    _, largest = assert_steps_are_those_of_the_film_alone(film, run, end, 0.9)
    assert largest[-1] > 1e7


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


# --- Derivatives


@pytest.mark.parametrize("rough", [None, surfaces(CLEARANCE / 2, 0.9)], ids=["smooth", "rough"])
@pytest.mark.parametrize("residual", [False, True])
def test_derivatives_of_conserved_oil_equal_central_differences(residual, rough, monkeypatch):
    oil = Lubricant(ETA, Barus(1e-8), DowsonHigginson())
    film = oil_film((12, 3), regions=(GROOVE,), oil=oil, surfaces=rough)
    mechanism = with_oil(mechanism_with("bilinear", residual), film)
    assert_oil_derivatives(mechanism, monkeypatch)


# --- Runs


def test_a_run_goes_on_to_the_last_bit():
    film, end = oil_film((16, 3), regions=(GROOVE,), oil=DENSE), 0.05 * REVOLUTION
    steps, mechanism = Steps(tolerance=1e-3), rigid_slider_crank(film, filling=1.0)
    whole, stopped, other = (Run(mechanism, steps, end) for _ in range(3))
    for _ in whole.until(end):
        pass
    for number, _ in enumerate(stopped.until(end)):
        if number == 12:
            break
    other.load_state(stopped.stored_state())
    for _ in other.until(end):
        pass
    np.testing.assert_array_equal(other.state.x, whole.state.x)


@pytest.mark.slow
def test_what_it_changes_in_the_machine(figure):
    found = {}
    for name, oil in (("stiff", Lubricant(ETA)), ("dense", DENSE)):
        film = oil_film((32, 6), oil=oil, sides=Sides(1e5, 1e5))
        result = simulate(
            rigid_slider_crank(film, filling=1.0), REVOLUTION, tolerance=1e-4, order=2
        )
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


def test_it_is_refused_under_reynolds_condition():
    with pytest.raises(SettingsError, match="needs cavitation = 'mass-conserving'"):
        rigid_slider_crank(oil_film((12, 3), oil=DENSE))
