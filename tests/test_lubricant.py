"""Oils whose properties change with pressure and place."""

import numpy as np
import pytest
from film_cases import ETA, FAMILIES, OMEGA, C, R, given_gap, make_film, solve

import fenics_ehd as ehd
from fenics_ehd.film.lubricant import Constant

LAWS = [
    Constant(),
    ehd.Barus(1.8e-8),
    ehd.Roelands(0.01),
    ehd.Roelands(0.4, 0.7),
    ehd.DowsonHigginson(),
]


def test_shear_thinning_has_its_limits():
    law = ehd.Cross(1e6, 0.8, 0.3)
    np.testing.assert_allclose(law(np.array([0.0, 1e6, 1e300])), [1.0, 0.65, 0.3])
    with np.errstate(all="raise", under="ignore"):
        ehd.Cross(1e-30, 9.99, 0.0)(np.array([0.0, 1e-300, 1e9, 1e300]))


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_laws_are_ratios_to_ambient_pressure(law):
    ratio = law(np.array([0.0, 1e8]))
    assert ratio[0] == 1.0
    assert law.constant == (ratio[1] == 1.0)


def test_laws_have_values_from_the_literature():
    # Barus: e at p = 1 / alpha. Roelands' law has Barus' slope alpha at zero, with
    # alpha = Z (ln eta_0 + 9.67) / 0.196 GPa. Oil at 1 GPa is denser by 22 %.
    assert ehd.Barus(2e-8)(np.array([5e7])) == pytest.approx(np.e)
    alpha = 0.6 * (np.log(0.1) + 9.67) / 1.96e8
    weak = np.array([1e2])
    assert ehd.Roelands(0.1)(weak) - 1 == pytest.approx(alpha * weak, rel=1e-5)
    assert ehd.DowsonHigginson()(np.array([1e9])) == pytest.approx(1 + 0.6 / 2.7)


@pytest.mark.parametrize("family", FAMILIES)
def test_factor_everywhere_is_that_viscosity(family):
    double = ehd.Lubricant(ETA, viscosity_field=lambda phi, z: np.full_like(phi, 2.0))
    found = solve(make_film(family=family, oil=double), 0.6).pressure
    expected = solve(make_film(family=family, oil=ehd.Lubricant(2 * ETA)), 0.6).pressure
    np.testing.assert_allclose(found, expected, atol=1e-9 * expected.max())
    # A denser oil of the same viscosity makes no difference in (1).
    dense = ehd.Lubricant(ETA, density_field=lambda phi, z: np.full_like(phi, 3.0))
    found = solve(make_film(family=family, oil=dense), 0.6).pressure
    np.testing.assert_allclose(2 * found, expected, atol=1e-8 * expected.max())


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("rise", "stiffening"), [(0.6e-9, 1.7e-9), (3e-9, 1e-9)])
def test_compressible_film_conserves_mass(family, rise, stiffening):
    # Closed ends, two lines of given pressure: what flows in at one flows out at the other
    # or is squeezed. r sums over all nodes to the source alone: shape functions add up to one.
    law = ehd.DowsonHigginson(rise, stiffening)
    oil = ehd.Lubricant(ETA, viscosity_law=ehd.Barus(2e-9), density_law=law)
    lines = (ehd.AxialGroove(0.0, 0.0, 8e7),)
    film = make_film((48, 2), family, oil=oil, sides=ehd.Sides(None, None), regions=lines)
    gap = given_gap(film, lambda phi, z: 1 + 0.3 * np.cos(phi), 0.0, 0.5)
    state = film.solve(gap)
    assert len(state.cavitation.full_film) == len(film.free)
    # Mass flux round the bearing, by the pressure's slope: the same in the middle of every cell.
    angle = (np.arange(48) + 0.5) * 2 * np.pi / 48
    at = film.parameters.grid.interpolation
    step, zero = 1e-4, np.zeros(48)
    value = at(angle, zero) @ state.pressure
    gradient = (at(angle + step, zero) - at(angle - step, zero)) @ state.pressure / (2 * step * R)
    h, factor = C * (1 + 0.3 * np.cos(angle)), 12 * ETA * np.exp(2e-9 * value)
    density = 1 + rise * value / (1 + stiffening * value)
    flux = density * (h * 0.5 * OMEGA * R - h**3 / factor * gradient)
    accuracy = 5e-3 if family == "bilinear" else 2e-3
    np.testing.assert_allclose(flux, flux.mean(), rtol=accuracy)
    # Compressed oil needs less flow to be carried round than an incompressible film's.
    stiff = make_film((48, 2), family, oil=ehd.Lubricant(ETA, viscosity_law=ehd.Barus(2e-9)),
                      sides=ehd.Sides(None, None), regions=lines)  # fmt: skip
    assert np.abs(stiff.solve(gap).pressure - state.pressure).max() > 1e-3 * state.pressure.max()


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: ehd.Lubricant(0.0), "viscosity = 0.0 must be above 0"),
        (lambda: ehd.Lubricant(np.nan), "viscosity = nan"),
        (lambda: ehd.Barus(-1e-8), "coefficient = -1e-08 must be above 0"),
        (lambda: ehd.Roelands(0.01, 0.0), "index = 0.0 must be above 0"),
        (lambda: ehd.Roelands(1e-5), "1e-05 Pa s must be above 6.3e-5"),
        (lambda: ehd.Roelands(np.nan), "viscosity = nan must be a finite number"),
        (lambda: ehd.Cross(0.0), "rate = 0.0 must be above 0"),
        (lambda: ehd.Cross(1e6, 10.0), "exponent = 10.0 must be below 10"),
        (lambda: ehd.Cross(1e6, 1.0, 1.1), "second = 1.1 must be at most 1"),
        (lambda: ehd.Cross(np.nan), "rate = nan"),
        (
            lambda: make_film(oil=ehd.Lubricant(ETA, viscosity_field=lambda a, z: np.cos(a))),
            "lubricant's viscosity_field must be finite and above 0",
        ),
        (
            lambda: make_film(oil=ehd.Lubricant(ETA, density_field=lambda a, z: a * np.nan)),
            "lubricant's density_field must be finite and above 0",
        ),
        (
            lambda: make_film(oil=ehd.Lubricant(ETA, viscosity_field=lambda a, z: a + np.inf)),
            "viscosity_field",
        ),
    ],
)
def test_impossible_oils_are_refused(make, named):
    with pytest.raises(ehd.errors.SettingsError, match=named):
        make()
