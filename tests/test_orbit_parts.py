"""Amplitude and phase of the 1x and 0.5x parts of orbits, made up and in runs."""

from dataclasses import replace

import numpy as np
import pytest
from test_equilibrium import SPEED, film, journal

import fenics_ehd as ehd
from fenics_ehd.multibody.orbit import orbit_parts


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_parts_of_a_made_up_orbit(sense):
    # Steps of different lengths, as a run has.
    steps = np.cumsum(1.0 + 0.8 * np.sin(np.arange(150.0)))
    angle = sense * (3.0 + 4 * np.pi * (steps - steps[0]) / np.ptp(steps))
    orbit = (
        5e-6 - 8e-6j
        + 2e-6 * np.exp(1j * (angle + np.radians(40.0))) + 0.5e-6 * np.exp(-1j * (angle - 1.0))
        + 1e-6 * np.exp(1j * (0.5 * angle - np.radians(70.0))) + 0.1e-6 * np.exp(3j * angle)
    )  # fmt: skip
    parts = orbit_parts(angle, orbit, 2)
    assert parts["orbit_1x_amplitude_m"] == pytest.approx(2.5e-6, rel=1e-9)
    assert parts["orbit_1x_phase_deg"] == pytest.approx(40.0, abs=1e-6)
    assert parts["orbit_0_5x_amplitude_m"] == pytest.approx(1e-6, rel=1e-9)
    assert parts["orbit_0_5x_phase_deg"] == pytest.approx(-70.0, abs=1e-6)
    # One turn has no 0.5x part, and few steps have none.
    one = orbit_parts(angle[75:], orbit[75:] - orbit[75:] * 0, 1)
    assert set(one) == {"orbit_1x_amplitude_m", "orbit_1x_phase_deg"}
    assert orbit_parts(angle[:20], orbit[:20], 2) == {}


def unbalanced(**changes):
    """Journal of 2 kg under a load of 4 kN and a rotating force of 5 N, at its equilibrium."""
    still = journal(film(cells=(20, 4)))
    rest = ehd.equilibrium(still)
    place = tuple(rest.z[rest.system.films[0].xi[:2]])
    joint = replace(still.joints["bearing"], eccentricity=place)
    force = ehd.RotatingForce(point="shaft", amplitude=5.0, speed=SPEED)
    return rest, replace(
        still, joints={"bearing": joint}, forces={**still.forces, "unbalance": force}, **changes
    )


def test_the_1x_part_of_a_run_is_the_linear_response():
    rest, mechanism = unbalanced()
    history = ehd.simulate(mechanism, 3 * 2 * np.pi / SPEED, tolerance=1e-6)
    figures = history.figures["bearing"]
    small = ehd.linearise(rest).along(rest.system.bodies["shaft"].start + np.arange(2))
    matrix = small.stiffness + 1j * SPEED * small.damping - SPEED**2 * small.mass
    u, v = np.linalg.solve(matrix, 5.0 * np.array([1.0, -1.0j]))
    forward, backward = (u + 1j * v) / 2, (np.conj(u) + 1j * np.conj(v)) / 2
    expected = abs(forward) + abs(backward)
    assert figures["orbit_1x_amplitude_m"] == pytest.approx(expected, rel=0.02)
    assert figures["orbit_1x_phase_deg"] == pytest.approx(np.degrees(np.angle(forward)), abs=1.0)
    assert figures["orbit_0_5x_amplitude_m"] < 0.02 * expected


def test_a_run_without_a_revolution_or_a_bore_that_turns_has_no_parts():
    mechanism = unbalanced()[1]
    short = ehd.simulate(mechanism, 0.5 * 2 * np.pi / SPEED, tolerance=1e-3)
    assert not any(name.startswith("orbit_") for name in short.figures["bearing"])
