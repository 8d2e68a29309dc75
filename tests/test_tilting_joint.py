"""A shaft that tilts in a flexible bore: the film's linear maps, derivatives, energy."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from moving_point import assert_derivatives
from rotor_cases import SPEED, C, R, flexible, held_body, make_film, shifted

import fenics_ehd as ehd
from fenics_ehd.multibody.elastic_bore import ElasticBore
from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.multibody.mechanism import System

pytestmark = pytest.mark.kernels

# --- The film's linear maps on xi = (e_x, e_y, psi_x, psi_y, q)


@pytest.fixture(scope="module")
def film():
    return make_film()


def joint_film(film, body):
    return JointFilm(
        ehd.LubricatedJoint("shaft", "housing.bore", film),
        partial(ElasticBore, body, "bore"),
        tilting=True,
    )


@pytest.fixture(scope="module")
def joint(film):
    return joint_film(film, flexible(film))


def test_gap_of_a_tilting_shaft_is_the_films_own(film, joint):
    xi, rate = np.zeros((2, joint.size))
    xi[:4], rate[:4] = [3e-7, -2e-7, 1e-5, 3e-5], [2e-3, 1e-3, 0.2, -0.1]
    exact = ehd.shaft_gap(
        film.points,
        R,
        C,
        ehd.ShaftMotion(
            xi[:2], SPEED, eccentricity_rate=rate[:2], tilt=xi[2:4], tilt_rate=rate[2:4]
        ),
    )
    found = joint.gap(xi, rate, SPEED)
    # What is left out is e_t^2 / 2 R and its rate.
    furthest, fastest = 7e-7, 5e-3
    assert np.abs(found.thickness - exact.thickness).max() < furthest**2 / R
    assert np.abs(found.thickness_rate - exact.thickness_rate).max() < furthest * fastest / R
    # The surface's speed is that of the journal's own radius, R - c.
    slower = 1.1 * SPEED * C
    assert np.abs(found.mean_velocity - exact.mean_velocity).max() < slower
    assert np.abs(found.sliding_velocity - exact.sliding_velocity).max() < slower
    # And of the right sign: the gap changes by as much as the shaft moves.
    assert np.ptp(found.thickness) == pytest.approx(np.ptp(exact.thickness), rel=1e-4)
    assert np.ptp(found.thickness) > 1e-6


def test_a_bore_that_moves_is_a_shaft_that_moves_back(film):
    joint = joint_film(film, held_body(film, [shifted], (1e3,)))
    back = -np.array([1.0, 0.5])
    for name in ("thickness", "mean_velocity", "sliding_velocity"):
        columns = getattr(joint, name)
        np.testing.assert_allclose(columns[:, 4], columns[:, :2] @ back, atol=1e-12)
    np.testing.assert_allclose(
        joint.load[4], back @ joint.load[:2], atol=1e-12 * np.abs(joint.load).max()
    )


def test_gap_and_force_are_conjugate(film, joint, figure):
    rng = np.random.default_rng(2)
    pressure = rng.uniform(0, 1e6, len(film.parameters.grid.nodes))
    rate = rng.uniform(-1e-3, 1e-3, joint.size)
    # Power on the surfaces, point by point: p dh/dt.
    opening = joint.gap(np.zeros(joint.size), rate, 0.0).thickness_rate
    values = film.assembly.at_points(pressure)[0]
    power = R**2 * np.sum(film.assembly.area * values * opening)
    error = abs(joint.load @ pressure @ rate / power - 1)
    figure("rotor", "power of the pressure, on gap and on coordinates", error, most=1e-12)


def test_observed_gap_holds_gauss_points_and_nodes(film, joint):
    xi = 1e-6 * np.random.default_rng(8).uniform(-1, 1, joint.size)
    inside = joint.gap(xi, xi, SPEED).thickness.ravel()
    gap = C + joint.observed @ xi
    np.testing.assert_allclose(gap[: len(inside)], inside, rtol=1e-12)
    angle, z = film.parameters.grid.node_positions.T
    e_x, e_y, psi_x, psi_y = xi[:4]
    xi[4:] = 0.0
    moved = (e_x + z * psi_y) * np.cos(angle) + (e_y - z * psi_x) * np.sin(angle)
    np.testing.assert_allclose((C + joint.observed @ xi)[len(inside) :], C - moved, rtol=1e-12)


# --- Equations of a step


def shaft_in_housing(film, force="shaft.disk"):
    """An elastic shaft that tilts, on springs, in a flexible bore."""
    shaft = ehd.ShaftBody(
        diameter=2 * R,
        density=7446.0,
        support_stiffness=2e7,
        elements=8,
        modes=8,
        damping_ratio=5e-3,
        points={"middle": 0.5, "disk": 0.75},
    )
    return ehd.Mechanism(
        {"shaft": shaft, "housing": ehd.FlexibleBody(flexible(film), 1e-6)},
        {"bearing": ehd.LubricatedJoint("shaft.middle", "housing.bore", film)},
        {"shaft": ehd.Speed(SPEED)},
        {"load": ehd.RotatingForce(force, 2000.0, SPEED)},
    )


@pytest.mark.parametrize("shift", [1e3, 1e5])
def test_derivatives_of_a_step_are_exact(film, shift):
    assert_derivatives(System(shaft_in_housing(film)), shift, 1e-3, 1e-8)


@pytest.mark.slow
def test_energy_balance_closes_with_the_tolerance(film, figure):
    # A force that is there at once is the hardest start: order 2 is tolerance^(2/3).
    loose, tight = (
        ehd.simulate(shaft_in_housing(film), 5e-4, tolerance=tolerance, order=2).summary()[
            "energy_balance_error"
        ]
        for tolerance in (1e-7, 1e-9)
    )
    figure("rotor", "energy balance from a sudden force", tight, most=3e-3, unit="%")
    assert tight < loose / 8


def test_a_force_half_way_does_not_tilt():
    film = make_film((20, 3))

    def tilt(mechanism):
        rigid = {**mechanism.bodies, "housing": ehd.FlexibleBody(held_body(film))}
        result = ehd.simulate(replace(mechanism, bodies=rigid), 1e-4, tolerance=1e-4, order=2)
        motion = mechanism.bodies["shaft"].rotor.motion(0.5)
        return np.abs(result.bodies["shaft"].coordinates[:, 1:] @ motion[2:].T).max()

    assert tilt(shaft_in_housing(film, "shaft.middle")) < 1e-12
    assert tilt(shaft_in_housing(film, "shaft.disk")) > 1e-9


def test_a_ramp_begins_gently():
    force = ehd.RotatingForce("shaft", 3600.0, 600.0, 1e-3)
    sizes = [np.hypot(*force.load(t, np.zeros(5), np.zeros(5)).value[:2])
             for t in (0.0, 1e-6, 5e-4, 1e-3, 2e-3)]  # fmt: skip
    assert sizes[0] == 0.0
    assert sizes[1] < 1e-5 * sizes[3]
    assert sizes[2:] == pytest.approx([1800.0, 3600.0, 3600.0])
    turned = force.load(1e-3, np.zeros(5), np.zeros(5)).value[:2]
    assert turned == pytest.approx(3600.0 * np.array([np.cos(0.6), np.sin(0.6)]))
