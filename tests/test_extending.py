"""The worked examples of docs/extending.md, run as they stand, against independent answers."""

import re
from pathlib import Path

import numpy as np
import pytest
from differences import slope

import fenics_ehd as ehd
from fenics_ehd.film.heat import TemperatureSearch
from fenics_ehd.film.lubricant import Constant, TemperatureLaw
from fenics_ehd.multibody import quantities

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"


@pytest.fixture(scope="module")
def page():
    """Names of all examples; what they register is taken back."""
    registered, found = list(quantities.OUTPUTS), {}
    for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
        exec(compile(code, str(PAGE), "exec"), found)
    yield found
    quantities.OUTPUTS[:] = registered


def test_a_power_law_of_large_exponent_is_that_of_barus(page):
    largest_pressure, law = page["largest_pressure"], page["PowerLaw"]
    assert largest_pressure(Constant()) < page["thickening"] < largest_pressure(ehd.Barus(2e-8))
    steep = largest_pressure(law(base=1e7 / 2e-8, exponent=1e7))
    assert steep == pytest.approx(largest_pressure(ehd.Barus(2e-8)), rel=1e-6)


def test_a_law_of_temperature_agrees_with_walther_where_it_is_fitted(page):
    vogel = page["vogel"]
    walther = ehd.Oil(100.0, 11.0, density_15=870.0, expansion=0.0)
    for temperature in (40.0, 100.0):
        assert vogel.viscosity(temperature) == pytest.approx(walther.viscosity(temperature))
    between = np.linspace(40.0, 100.0, 13)
    ratios = [vogel.viscosity(t) / walther.viscosity(t) for t in between]
    np.testing.assert_allclose(ratios, 1.0, atol=0.03)
    for law in (vogel, walther, ehd.Oil(100.0, 11.0)):
        assert isinstance(law, TemperatureLaw)
        numerical = slope(lambda x, law=law: law.viscosity(70.0 + x), step=1e-2)
        assert law.viscosity_slope(70.0) == pytest.approx(numerical, rel=1e-6)


def test_a_lubricant_and_its_heat_take_a_law_of_temperature(page):
    vogel, cool = page["vogel"], page["cool"]
    assert cool.viscosity == vogel.viscosity(50.0)
    heat = ehd.Heat(supply_temperature=50.0)
    search = TemperatureSearch(heat, vogel)
    while abs(search.defect(200.0, 3e-6)) > 1e-3:
        search.move(200.0, 3e-6)
    rise = 200.0 / (3e-6 * vogel.density(60.0) * vogel.specific_heat)
    assert search.temperature == pytest.approx(50.0 + 0.5 * rise, abs=2e-3)


def test_derivatives_of_a_link_are_those_of_its_value(page):
    link, direction = page["Link"](("a", "b"), 0.3), np.arange(10.0)
    u = np.array([0.1, 0.2, 0.3, 0.0, 0.0, -0.1, 0.4, 0.2, 0.0, 0.0])
    geometry = link.geometry(u)
    value = slope(lambda t: link.geometry(u + t * direction).value, step=1e-3)
    np.testing.assert_allclose(value, geometry.jacobian @ direction, atol=1e-9)
    jacobian = slope(lambda t: link.geometry(u + t * direction).jacobian, step=1e-3)
    np.testing.assert_allclose(jacobian, geometry.curvature() @ direction, atol=1e-9)


def test_a_bob_on_a_link_swings_like_a_pendulum(page):
    swing, length = page["swing"], 0.3
    angle = np.arctan2(swing["bob.x"], -swing["bob.y"])
    # The series of the period, amplitude a: T = 2 pi sqrt(L / g) (1 + a^2 / 16 + ...).
    period = 2 * np.pi * np.sqrt(length / 9.81) * (1 + angle[0] ** 2 / 16)
    expected = angle[0] * np.cos(2 * np.pi * swing.time / period)
    np.testing.assert_allclose(angle, expected, atol=2e-3 * angle[0])
    np.testing.assert_allclose(np.hypot(swing["bob.x"], swing["bob.y"]), length, rtol=1e-6)


def test_a_registered_quantity_is_a_column_with_unit_and_mean(page):
    share, history = page["share"], page["history"]
    assert 0.0 < share.max() < 1.0
    assert history.units("bearing.loaded_share") == "1"
    assert min(share) <= history.summary()["mean_loaded_share"] <= max(share)
