"""Rigid rotors in rigid bearings, in time, against a table of bearings: onset of oil whirl."""

import numpy as np
import pytest
from rotor_cases import (
    PARALLEL_SHAFT,
    SPEED,
    R,
    held_body,
    linearise,
    make_film,
    rigid_rotor,
    steps_of,
)
from scipy.linalg import eig

from fenics_ehd.multibody.bdf import StepControl
from fenics_ehd.multibody.dry_system import DrySystem
from fenics_ehd.multibody.energy import EnergyBalance
from fenics_ehd.multibody.shaft_journal import ShaftJournal
from fenics_ehd.scenes.rotor import Rotor

#: Plain bearing, L/D = 1, Reynolds' condition, by finite volumes: x along the load, y a quarter
#: turn on in the shaft's direction, K = k c / W, C = b c Omega / W; the mass at the threshold of
#: stability is `critical` W / (c Omega^2).
TABLE = {
    0.2: {
        "S": 0.62436, "attitude": 77.6601, "critical": 6.3614,
        "K": [[1.1916, 5.4478], [-4.6541, 2.1251]], "C": [[10.705, 2.141], [2.141, 9.7869]],
    },
    0.3: {
        "S": 0.38672, "attitude": 71.4370, "critical": 6.3013,
        "K": [[1.3484, 4.0146], [-2.8118, 2.0962]], "C": [[7.7479, 2.1302], [2.1302, 6.3433]],
    },
    0.6: {
        "S": 0.12141, "attitude": 51.9786, "critical": 7.3055,
        "K": [[2.5071, 3.2079], [-0.57391, 1.9736]], "C": [[5.8738, 2.1007], [2.1007, 2.6867]],
    },
    0.75: {
        "S": 0.060377, "attitude": 40.9583, "critical": 17.501,
        "K": [[4.1689, 3.6179], [0.17996, 1.9211]], "C": [[6.4942, 2.1059], [2.1059, 1.828]],
    },
}  # fmt: skip


class Balanced:
    """A bearing of the table (L/D = 1, thin film) and a load that it bears at an eccentricity."""

    def __init__(self, ratio, cells=(48, 6)):
        self.row = TABLE[ratio]
        self.clearance = 1e-4 * R
        self.film = make_film(cells, width=2 * R, clearance=self.clearance)
        revolutions = SPEED / (2 * np.pi)
        unit = (1e4) ** 2 * 0.01 * revolutions * 4 * R**2
        self.weight = unit / self.row["S"]
        angle = np.radians(self.row["attitude"])
        # The load along x; the shaft turns from x to y and rests off the load by the attitude.
        self.start = ratio * self.clearance * np.array([np.cos(angle), np.sin(angle)])
        self.threshold = self.row["critical"] * self.weight / (self.clearance * SPEED**2)

    def rotor(self, mass):
        return rigid_rotor(self.film, mass, [self.weight, 0.0], SPEED)

    def equilibrium(self):
        """Eccentricity at rest, by Newton's method on the film's own forces."""
        rotor, x, rest = self.rotor(1.0), self.start, np.zeros(2)
        for _ in range(6):
            residual, derivative, _ = linearise(rotor, 0.0, x, rest, rest, (0.0, 0.0))
            x = x - np.linalg.solve(derivative, residual)
        return x

    def coefficients(self, x):
        """Stiffness and damping of the film in the units of the table."""
        rotor, rest = self.rotor(0.0), np.zeros(2)
        _, stiffness, _ = linearise(rotor, 0.0, x, rest, rest, (0.0, 0.0))
        shift = 1e9
        _, both, _ = linearise(rotor, 0.0, x, rest, rest, (shift, 0.0))
        damping = (both - stiffness) / shift
        scale = self.clearance / self.weight
        return scale * stiffness, scale * SPEED * damping


@pytest.mark.parametrize("ratio", [0.2, 0.6, 0.75])
def test_equilibrium_and_coefficients_of_a_rigid_rotor(ratio):
    bearing = Balanced(ratio)
    x = bearing.equilibrium()
    assert np.hypot(*(x - bearing.start)) < 5e-4 * bearing.clearance
    stiffness, damping = bearing.coefficients(x)
    for found, expected in ((stiffness, bearing.row["K"]), (damping, bearing.row["C"])):
        np.testing.assert_allclose(found, expected, rtol=0, atol=7e-3 * np.abs(expected).max())


def whirl(stiffness, damping, mass):
    """Least stable eigenvalue over Omega, all in the table's units: right and left vectors."""
    matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness / mass, -damping / mass]])
    values, left, right = eig(matrix, left=True, right=True)
    least = int(np.argmax(values.real + 1e-9 * values.imag))
    return values[least], right[:, least], left[:, least].conj()


def growth_of(bearing, x, mass, revolutions, tolerance=3e-7):
    """Growth rate and frequency over Omega of a small whirl about the equilibrium, in time.

    Also as the eigenvalue of the film's own coefficients.
    """
    critical = mass * bearing.row["critical"]
    value, right, left = whirl(*bearing.coefficients(x), critical)
    c = bearing.clearance
    start = 2e-3 * (right / np.abs(right[:2]).max()).real
    control = StepControl(tolerance, 1e-6, 1e-12, 1e-2)
    end = revolutions * 2 * np.pi / SPEED
    rotor = bearing.rotor(mass * bearing.threshold)
    steps = steps_of(rotor, end, x + c * start[:2], c * SPEED * start[2:], control)
    times, states = zip(
        *[(step.time, np.append((step.x - x) / c, step.rate / (c * SPEED))) for step in steps],
        strict=True,
    )
    times, amplitude = SPEED * np.array(times), np.array(states) @ left
    later = times > 0.25 * times[-1]
    logarithm = np.log(np.abs(amplitude[later])), np.unwrap(np.angle(amplitude[later]))
    growth, frequency = (np.polyfit(times[later], part, 1)[0] for part in logarithm)
    return growth, abs(frequency), value


@pytest.mark.parametrize("ratio", [0.3, pytest.param(0.6, marks=pytest.mark.slow)])
def test_onset_of_oil_whirl(ratio, figure):
    # Masses 5 % below and above the table's threshold, at its speed and load.
    bearing = Balanced(ratio)
    x = bearing.equilibrium()
    light, heavy = (growth_of(bearing, x, mass, 3.0) for mass in (0.95, 1.05))
    assert light[0] < 0.0 < heavy[0]
    for growth, frequency, value in (light, heavy):
        assert growth == pytest.approx(value.real, abs=4e-4)
        assert frequency == pytest.approx(abs(value.imag), rel=0.01)
    threshold = 0.95 - 0.1 * light[0] / (heavy[0] - light[0])
    error = abs(threshold - 1.0)
    figure("rotor", "onset of oil whirl in time, mass of the table", error, most=0.02, unit="%")
    # Half the speed of the shaft, and less on a heavily loaded one.
    ratio_of_whirl = 0.5 * (light[1] + heavy[1])
    error = abs(ratio_of_whirl / {0.3: 0.50038, 0.6: 0.45233}[ratio] - 1)
    figure("rotor", "its frequency", error, most=0.01, unit="%")


# --- A load that turns with the shaft


def test_a_load_that_turns_with_the_shaft_runs_the_table_backwards():
    # In the frame of the load the shaft stands still and the bore turns back at its speed: the
    # journal of the table, seen in a mirror, on a circle.
    bearing = Balanced(0.6, (36, 5))
    weight, angle = bearing.weight, np.radians(bearing.row["attitude"])
    radius = 0.6 * bearing.clearance
    zero = np.zeros((2, 2))

    def load(time):
        return weight * np.array([np.cos(SPEED * time), np.sin(SPEED * time)])

    journal = ShaftJournal(held_body(bearing.film), bearing.film, PARALLEL_SHAFT)
    mass = 1e-3 * bearing.threshold
    rotor = Rotor(DrySystem(mass * np.eye(2), zero, zero, load), journal, SPEED)
    x = radius * np.array([np.cos(angle), -np.sin(angle)])
    rate = SPEED * np.array([-x[1], x[0]])
    control = StepControl(1e-5, 1e-6, 1e-13, 1e-2)
    balance = None
    for step in steps_of(rotor, 0.5 * np.pi / SPEED, x, rate, control):
        powers = rotor.powers(step.x, step.rate, step.auxiliary)
        if balance is None:
            balance = EnergyBalance(step.time, powers)
        else:
            balance.add(step.time, powers)
    # A quarter of a turn later.
    expected = np.array([-x[1], x[0]])
    assert np.hypot(*(step.x - expected)) < 3e-3 * bearing.clearance
    # The motor brakes: the oil's drag feeds back a good part of what the force puts in.
    assert powers.drive + powers.drag == pytest.approx(powers.film, rel=5e-3)
    assert abs(powers.drag) > 0.2 * powers.film
    assert balance.error < 2e-3
