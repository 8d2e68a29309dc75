"""Oil that pressure makes denser, and what it changes; more in `test_conserved_oil.py`."""

import numpy as np
import pytest
from mechanism_cases import REVOLUTION
from oil_cases import CLOSED, ETA, RADIUS, heights, oil_film, oscillating, rigid_slider_crank
from oracle_compressible import CompressibleArc

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.run import Run

pytestmark = pytest.mark.kernels

GROUP = "oil"
DENSE = ehd.Lubricant(ETA, density_law=ehd.DowsonHigginson())


# --- Against a computation of our own


def squeezed(cells, steps, amplitude=0.3, speed=100.0, supply=4e8, clearance=3e-6):
    """Pressures of a journal that moves to and fro between two lines, and those of the oracle."""
    lines = tuple(ehd.AxialGroove(angle, 0.0, supply) for angle in (np.pi / 2, -np.pi / 2))
    film = oil_film((cells, 1), clearance=clearance, sides=CLOSED, regions=lines, oil=DENSE)
    mechanism = oscillating(film, amplitude, speed)
    end = 0.7 * 2 * np.pi / speed
    # A first step as long as others is of order one, whose error has faded at the end.
    control = IntegratorOptions(tolerance=0.9, order=2, largest=1.0001 / steps, first=end / steps)
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


@pytest.mark.slow
def test_a_squeezed_film_is_that_of_finite_volumes(figure):
    errors = []
    for cells, steps in ((16, 40), (64, 160)):
        error, state = squeezed(cells, steps)
        assert state.pressure.min() > 1e8
        errors.append(error)
    # The density counts: a hundred times its errors.
    lines = ehd.AxialGroove(np.pi / 2, 0.0, 4e8), ehd.AxialGroove(-np.pi / 2, 0.0, 4e8)
    constant = oil_film((cells, 1), clearance=3e-6, sides=CLOSED, regions=lines)
    assert np.abs(constant.solve(state.gap).pressure - state.pressure).max() > 0.02 * 4e8
    name = "compressible oil, squeezed journal, pressure over the supply's"
    figure(GROUP, name, errors[-1], most=5e-4, unit="%")
    figure(GROUP, f"{name}, observed order", np.log2(errors[0] / errors[-1]) / 2, least=1.7)


# --- Runs


@pytest.mark.slow
def test_what_it_changes_in_the_machine(figure):
    found = {}
    for name, oil in (("stiff", ehd.Lubricant(ETA)), ("dense", DENSE)):
        film = oil_film((32, 6), oil=oil, sides=ehd.Sides(1e5, 1e5))
        result = ehd.simulate(
            rigid_slider_crank(film, initial_filling=1.0), REVOLUTION, tolerance=1e-4, order=2
        )
        late = result.time > 0.1 * REVOLUTION
        found[name] = result.columns["min_film_thickness_m"][late].min()
    changed = found["dense"] / found["stiff"] - 1
    figure(GROUP, "Dowson and Higginson's law, minimum film of a rigid slider-crank",
           changed, least=0.01, unit="%")  # fmt: skip
    assert changed < 0.03


def test_coefficients_of_a_bearing_do_not_know_it():
    dense = ehd.BearingSettings(cells_around=16, cells_along=3, density_law="dowson-higginson")
    plain = ehd.BearingSettings(cells_around=16, cells_along=3)
    pressures = [ehd.solve_bearing(s, eccentricity=0.8).max_pressure for s in (dense, plain)]
    assert 1.001 < pressures[0] / pressures[1] < 1.1
    with pytest.raises(ehd.errors.SettingsError, match="use density_law = "):
        ehd.solve_bearing(dense, eccentricity=0.8, with_coefficients=True)


def test_it_is_refused_under_reynolds_condition():
    with pytest.raises(ehd.errors.SettingsError, match="needs cavitation = 'mass-conserving'"):
        Run(rigid_slider_crank(oil_film((12, 3), oil=DENSE)), IntegratorOptions(), 1e-3)
