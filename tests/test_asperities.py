"""Asperity pressure and flow factors against quadrature and published values."""

import numpy as np
import pytest
from rough_cases import MODULUS, surfaces
from scipy.integrate import quad
from scipy.special import gamma

from fenics_ehd.film import rough_surfaces
from fenics_ehd.film.rough_surfaces import APART, seven_halves


def integral(order, ratio):
    """F_n by adaptive quadrature."""

    def integrand(s):
        return s**order * np.exp(-0.5 * (s + ratio) ** 2) / np.sqrt(2 * np.pi)

    peak = max(0.0, -ratio) + 1.0
    ends = (0.0, peak), (peak, peak + 12.0)
    return sum(quad(integrand, *e, epsabs=0, epsrel=1e-13, limit=200)[0] for e in ends)


def test_asperity_integral_is_that_of_quadrature(figure):
    ratio = np.linspace(-7.9, 7.9, 101)
    expected = [
        factor * np.array([integral(order, h) for h in ratio])
        for order, factor in ((3.5, 1.0), (2.5, -3.5), (1.5, 3.5 * 2.5))
    ]
    errors = np.abs(seven_halves(ratio) / np.array(expected) - 1).max(axis=1)
    assert errors.max() < 1e-10
    figure("contact", "F_5/2 of Greenwood and Tripp against quadrature", errors[1], most=1e-10)


def test_asperity_integral_of_touching_mean_planes_is_a_gamma_function():
    expected = 2**0.25 * gamma(1.75) / np.sqrt(np.pi)
    assert seven_halves(np.zeros(1))[1][0] / -3.5 == pytest.approx(expected, rel=1e-13)


def test_asperity_pressure_ends_without_a_jump():
    ends = seven_halves(np.array([APART - 1e-9, APART]))
    assert np.all(np.abs(np.array(ends)[:, 0]) < 1e-14)
    assert not np.array(ends)[:, 1].any()


@pytest.mark.parametrize("offset", [0.0, 1.5])
def test_force_of_a_rough_plane_on_a_tilted_one(offset):
    rough = surfaces(offset=offset)
    # p_c over a wedge, by quadrature of the definition, and by the potential at both ends.
    ends, width = np.array([-0.3e-6, 2e-6]), 1e-2
    factor = 16 * np.sqrt(2) * np.pi / 15 * 0.04**2 * 0.1 * MODULUS
    slope = (ends[1] - ends[0]) / width
    expected = quad(
        lambda x: factor * integral(2.5, (ends[0] + slope * x) / rough.roughness - offset), 0, width
    )[0]
    potential = rough.contact(ends).potential
    assert (potential[0] - potential[1]) / slope == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("offset", [0.0, 2.0])
def test_contact_is_conservative_and_its_stiffness_exact(offset):
    rough, gap, step = surfaces(offset=offset), np.linspace(-1e-6, 3.9e-6, 40), 1e-11
    low, middle, high = (rough.contact(gap + x) for x in (-step, 0.0, step))
    for value, slope in (("potential", -middle.pressure), ("pressure", middle.slope)):
        difference = (getattr(high, value) - getattr(low, value)) / (2 * step)
        np.testing.assert_allclose(difference, slope, rtol=1e-4, atol=1e-8 * np.abs(slope).max())


def test_share_of_true_contact():
    rough = surfaces(1e-6, offset=1.2)
    for ratio in (-0.5, 0.0, 1.0, 3.0):
        expected = np.pi**2 * 0.04**2 * integral(2.0, ratio - 1.2)
        assert rough.contact_share(1e-6 * np.array(ratio)) == pytest.approx(expected, rel=1e-9)


def test_flow_factors_are_those_of_patir_and_cheng():
    # By the coefficients of their tables (gamma = 1), by a pocket calculator, for H = 1, 3 and 6.
    ratio = np.array([1.0, 3.0, 6.0])
    np.testing.assert_allclose(
        rough_surfaces.pressure_factor(ratio), [0.485912, 0.832264, 0.968738], atol=1e-6
    )
    np.testing.assert_allclose(
        rough_surfaces.shear_factor(ratio), [0.795589, 0.553202, 0.251245], atol=1e-6
    )
    np.testing.assert_allclose(
        ratio * rough_surfaces.rough_stress_factor(ratio), [1.146765, 0.299614, 0.022958], atol=1e-6
    )
    np.testing.assert_allclose(
        rough_surfaces.stress_pressure_factor(ratio), [0.276408, 0.806703, 0.973312], atol=1e-6
    )
    # Both branches of the shear factor meet to the digits of its coefficients.
    ends = rough_surfaces.shear_factor(np.array([5.0, 5.0 + 1e-12]))
    assert abs(ends[1] - ends[0]) < 2e-4


@pytest.mark.parametrize("ratio", [-1.0, 0.5, 2.0, 3.0, 3.2, 8.0, 29.9, 30.1, 200.0])
def test_stress_factor_is_the_mean_of_one_over_the_film(ratio):
    def integrand(s):
        return 35 / 96 * (1 - (s / 3) ** 2) ** 3 / (ratio + s)

    mean = quad(integrand, max(-3.0, 0.01 - ratio), 3.0, epsrel=1e-12, limit=400)[0]
    # The published polynomial leaves out terms of the least film, 0.01 sigma.
    tolerance = 3e-3 if ratio <= 3 else 1e-8
    assert rough_surfaces.stress_factor(np.array([ratio]))[0] == pytest.approx(mean, rel=tolerance)


def test_mean_gap_is_the_mean_of_what_is_open():
    for ratio in (-7.0, -4.1, -3.9, -2.0, 0.0, 0.5, 4.0):
        open_, _ = quad(
            lambda s, h=ratio: (h + s) * np.exp(-0.5 * s**2) / np.sqrt(2 * np.pi),
            -ratio,
            max(-ratio, 0) + 12,
            epsabs=0,
        )
        value, share = rough_surfaces.mean_gap(np.array([ratio]))
        assert value[0] == pytest.approx(open_, rel=1e-9)
        step = 1e-5
        sides = [rough_surfaces.mean_gap(np.array([ratio + x])) for x in (-step, step)]
        assert (sides[1][0] - sides[0][0])[0] / (2 * step) == pytest.approx(share[0], rel=1e-6)


@pytest.mark.parametrize("ratio", [0.5, 0.7, 2.0, 7.0, 12.0])
def test_mobility_is_as_published_and_goes_on_without_a_kink(ratio):
    least, value, power = continuation = rough_surfaces.continuation_below()

    def mobility(ratio):
        return rough_surfaces.mobility(ratio, rough_surfaces.mean_gap(ratio)[0], continuation)

    published = ratio**3 * rough_surfaces.pressure_factor(ratio)
    np.testing.assert_allclose(mobility(np.array([ratio])), published, rtol=1e-12)
    step, end = 1e-6, rough_surfaces.PUBLISHED
    below, at, above = mobility(np.array([end - step, end, end + step]))
    assert at == pytest.approx(value, rel=1e-12)
    assert (at - below) == pytest.approx(above - at, rel=1e-4)
    deep = np.array([-2.0])
    average = rough_surfaces.mean_gap(deep)[0]
    np.testing.assert_allclose(mobility(deep), value * (average / least) ** power, rtol=1e-14)
