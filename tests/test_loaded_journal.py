"""A massless journal under a periodic load, against equilibria and the short bearing."""

from dataclasses import replace

import numpy as np
import pytest
from journal_cases import (
    ETA,
    OMEGA,
    UNIT_LOAD,
    C,
    R,
    constant,
    ellipse,
    equilibrium,
    journal,
    make_film,
    orbit,
)
from scipy.integrate import quad, solve_ivp

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.verdict import verdict


def test_constant_load_ends_at_the_equilibrium_of_the_table(figure):
    film, load = make_film((32, 6)), 0.436957 * UNIT_LOAD * np.array([0.0, -1.0])
    mechanism, period = journal(film, constant(load), 0.02, rows=3)
    result = ehd.simulate(
        mechanism, period=period, periodicity=1e-5, tolerance=1e-3, largest=0.2, order=2, first=1e-6
    )
    last = result.joints["bearing"].eccentricity
    expected = equilibrium(film, load, OMEGA)
    assert np.abs(last - expected).max() < 1e-3 * C
    # Eccentricity 0.6 bears 0.436957 at 51.98 degrees from the load line, in the sense of rotation.
    error = abs(np.hypot(*last[-1]) / C / 0.6 - 1)
    name = "journal under a constant load, eccentricity of the table"
    figure("machines", name, error, most=1.5e-3, unit="%")
    assert np.degrees(np.arctan2(last[-1, 1], last[-1, 0])) + 90 == pytest.approx(51.98, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.25, 0.75])
def test_rotating_load_sees_the_speed_minus_twice_its_own(share):
    # A thin film: in a turning frame the thin-film equation keeps its form to order c / R only.
    clearance = 0.1 * C
    film = make_film(clearance=clearance)
    size, speed = 100 * 0.15 * UNIT_LOAD, share * OMEGA
    # In the frame of the load the shaft rests; the sense of rotation turns at half speed.
    expected = equilibrium(film, np.array([size, 0.0]), OMEGA - 2 * speed)
    mechanism, period = journal(
        film,
        lambda s: size * np.array([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s)]),
        2 * np.pi / speed,
        eccentricity=tuple(expected),
    )
    time, found = orbit(mechanism, period)
    cosine, sine = np.cos(speed * time), np.sin(speed * time)
    x, y = found.T
    turned = np.column_stack([cosine * x + sine * y, cosine * y - sine * x])
    assert np.sign(expected[1]) == (1 if share < 0.5 else -1)
    assert np.abs(turned - expected).max() < 2e-3 * clearance


def test_oil_as_thin_as_air_is_squeezed_as_any_other_only_sooner():
    # At rest the film is a function of the load times the time over the viscosity. Its flow is
    # up to 1e8 times the one that the speed of the film's scale makes, and so is its round-off.
    ends = []
    for viscosity in (ETA, 1e-3 * ETA, 1e-6 * ETA):
        film = make_film((20, 4), oil=ehd.Lubricant(viscosity))
        time = 2e-3 * viscosity / ETA
        mechanism, _ = journal(film, constant(UNIT_LOAD * np.array([0.8, -0.6])), time, speed=0.0)
        result = ehd.simulate(mechanism, time, tolerance=1e-4, order=2, first=1e-6)
        ends.append(result.joints["bearing"].eccentricity[-1] / C)
    assert np.hypot(*ends[0]) > 0.3
    assert np.abs(np.array(ends[1:]) - ends[0]).max() < 2e-4


def short_bearing_force(ratio, rate, width, speed):
    """Force of a short bearing's film on the shaft and its derivative along the velocity.

    ``p = 6 eta s (z^2 - B^2 / 4) / h^3`` where the source ``s = omega / 2 dh/dphi + dh/dt`` is
    negative, integrated by the midpoint rule.
    """
    angle = 2 * np.pi * (np.arange(720) + 0.5) / 720
    normal = np.stack([np.cos(angle), np.sin(angle)])
    tangent = np.stack([-np.sin(angle), np.cos(angle)])
    source = -0.5 * speed * C * (ratio @ tangent) - rate @ normal
    weight = ETA * width**3 / (C * (1 - ratio @ normal)) ** 3 * R * 2 * np.pi / 720
    weight = weight * (source < 0)
    return (weight * source) @ normal.T, -(weight * normal) @ normal.T


def short_bearing_rate(load, ratio, width, speed):
    """Velocity that bears a load, by Newton's method."""
    rate = np.zeros(2) + 1e-12
    for _ in range(50):
        force, derivative = short_bearing_force(ratio, rate, width, speed)
        update = -np.linalg.solve(derivative, force + load)
        rate = rate + update
        if np.hypot(*update) < 1e-12 * np.hypot(*rate):
            break
    return rate


@pytest.mark.slow
def test_squeeze_under_sinusoidal_load_follows_the_short_bearing(figure):
    width, period = 0.05 * 2 * R, 0.01
    size = 3.2 * np.pi * ETA * R * width**3 / C**2 / period
    film = make_film((40, 2), width=width)
    mechanism, _ = journal(
        film, lambda s: size * np.stack([np.sin(2 * np.pi * s), 0.0 * s]), period, rows=181, speed=0
    )
    result = ehd.simulate(mechanism, period, tolerance=3e-4, order=2, first=1e-6)

    def resistance(ratio):
        return quad(lambda a: np.cos(a) ** 2 / (1 - ratio * np.cos(a)) ** 3, -np.pi / 2, np.pi / 2)[
            0
        ]

    def rate(t, ratio):
        force = size * np.sin(2 * np.pi * t / period)
        forward = np.sign(force)
        return force * C**2 / (ETA * R * width**3 * resistance(forward * ratio[0]))

    oracle = solve_ivp(rate, (0, period), [0.0], t_eval=result.time, rtol=1e-8, atol=1e-10).y[0]
    assert oracle.max() > 0.6
    found = result.joints["bearing"].eccentricity
    error = np.abs(found[:, 0] / C - oracle).max()
    name = "journal in a short bearing under a sine, of the clearance, one ODE"
    figure("machines", name, error, most=2.5e-3, unit="%")
    # Periodic: it swings as far to either side.
    _, last = orbit(mechanism, period, tolerance=3e-4)
    assert last[:, 0].max() == pytest.approx(-last[:, 0].min(), rel=1e-3)
    assert np.abs(last[:, 1]).max() < 1e-9 * C


def test_turning_shaft_under_elliptic_load_follows_the_short_bearing():
    width, period = 0.05 * 2 * R, 4 * np.pi / OMEGA
    size = 0.6 * ETA * OMEGA * R * width**3 / C**2

    def load(share):
        return size * np.stack([np.cos(2 * np.pi * share), 0.4 * np.sin(4 * np.pi * share) - 0.5])

    film = make_film((40, 2), width=width)
    mechanism, _ = journal(film, load, period, rows=181)
    result = ehd.simulate(mechanism, period, tolerance=1e-4, order=2, first=1e-6)
    oracle = solve_ivp(
        lambda t, ratio: short_bearing_rate(load(t / period), ratio, width, OMEGA) / C,
        (0, period),
        [0.0, 0.0],
        t_eval=result.time,
        rtol=1e-6,
        atol=1e-8,
    ).y.T
    assert np.hypot(*oracle.T).max() > 0.5
    assert np.abs(result.joints["bearing"].eccentricity / C - oracle).max() < 2.5e-3


@pytest.fixture(scope="module")
def small():
    """Turning shaft under an elliptic load, on a small mesh: the integrator does not mind."""
    return journal(make_film((12, 2)), ellipse(0.3, 0.5, 2), 4 * np.pi / OMEGA, rows=37,
                   eccentricity=(0.3 * C, 0.1 * C))  # fmt: skip


def test_error_falls_with_the_tolerance_to_the_two_thirds(small):
    mechanism, period = small

    def end(tolerance, order=2):
        result = ehd.simulate(
            mechanism, 0.15 * period, tolerance=tolerance, order=order, first=1e-6, largest=0.6
        )
        return result.joints["bearing"].eccentricity[-1]

    exact = end(3e-7, order=3)
    tolerances = np.array([1e-3, 2e-4, 4e-5, 8e-6])
    errors = [np.hypot(*(end(tolerance) - exact)) / C for tolerance in tolerances]
    # Local error ~ step^3 at the tolerance, error at the end ~ step^2.
    assert 0.58 < np.polyfit(np.log(tolerances), np.log(errors), 1)[0] < 0.75
    assert errors[-1] < 4e-4


def test_turned_load_turns_the_orbit(small):
    mechanism, period = small
    turned = {
        axis: replace(force, direction=direction)
        for (axis, force), direction in zip(
            mechanism.forces.items(), ((0.0, 1.0), (-1.0, 0.0)), strict=True
        )
    }
    bearing = replace(mechanism.joints["bearing"], eccentricity=(-0.1 * C, 0.3 * C))
    other = replace(mechanism, forces=turned, joints={"bearing": bearing})
    first, second = (
        ehd.simulate(m, 0.3 * period, tolerance=1e-3, order=2).joints["bearing"].eccentricity[-1]
        for m in (mechanism, other)
    )
    assert second == pytest.approx([-first[1], first[0]], abs=1e-8 * C)


def test_an_unloaded_film_lets_the_shaft_go_round_at_half_speed(small):
    # No load: without pressure the gap is carried round with the mean oil speed.
    mechanism = replace(small[0], forces={})
    bearing = replace(mechanism.joints["bearing"], eccentricity=(0.5 * C, 0.0))
    result = ehd.simulate(
        replace(mechanism, joints={"bearing": bearing}), np.pi / OMEGA, tolerance=1e-5, order=2
    )
    assert result.joints["bearing"].eccentricity[-1] == pytest.approx([0.0, 0.5 * C], abs=3e-3 * C)


@pytest.mark.parametrize(("thickness", "cells", "enough"),
                         [(0.06, 20, True), (0.04, 20, False), (0.04, 40, True)])  # fmt: skip
def test_mesh_too_coarse_for_the_thinnest_film_is_called_untrustworthy(
    thickness, cells, enough, monkeypatch
):
    mechanism, period = journal(make_film((cells, 2)), ellipse(0.3, 0.5, 2), 0.02)
    run = Run(mechanism, IntegratorOptions(), period)
    tracker = Recorder(run, period)
    message = {"max_pressure": (1e6, 0.0), "min_film_thickness": (thickness * C, 0.0)}
    monkeypatch.setattr(RunSummary, "extremes", {"bearing": message})
    reason = verdict(RunSummary(tracker))
    assert (reason == "complete") == enough
    if not enough:
        assert reason.startswith("untrustworthy: joints.bearing.cells put nodes 9 degrees apart")
