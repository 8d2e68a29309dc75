"""Rod angle from the pin's line: the condition itself, and every derivative by differences."""

from dataclasses import dataclass

import numpy as np
import pytest
from differences import numbers, slope
from hypothesis import given, settings
from hypothesis import strategies as st

from fenics_ehd.errors import SolverError
from fenics_ehd.multibody.crank import ConstantSpeedCrank, CrankMotion
from fenics_ehd.multibody.guide import rod_angle
from fenics_ehd.plane import rotation

#: Derandomised, so that every machine tests the same cases.
profile = settings(deadline=None, derandomize=True, max_examples=60)


@dataclass
class Rod:
    """Pin fields of a rod about 3 long and parabolas of its coordinates, of order 0.2."""

    pin: np.ndarray
    xi: np.ndarray
    crank: ConstantSpeedCrank

    def coordinates(self, t):
        value, rate, acceleration = self.xi
        return value + t * rate + 0.5 * t**2 * acceleration, rate + t * acceleration, acceleration

    def angle(self, t, change=0.0, shifts=(0.0, 0.0)):
        xi, rate, acceleration = self.coordinates(t)
        return rod_angle(
            self.crank.at(t), self.pin, xi + change, rate + shifts[0] * change,
            acceleration + shifts[1] * change, shifts,
        )  # fmt: skip

    def pin_place(self, t, theta):
        """Inertial position of the pin."""
        xi = self.coordinates(t)[0]
        return self.crank.at(t).position + rotation(theta) @ (self.pin[:, 0] + self.pin[:, 1:] @ xi)


@st.composite
def rods(draw):
    # The frame need not lie along the rod.
    modes = draw(st.integers(0, 3))
    position = np.array([3.0, 0.0]) + draw(numbers(2))
    pin = np.column_stack([position, np.eye(2), draw(numbers(2, modes))])
    crank = ConstantSpeedCrank(draw(st.floats(0.1, 1.0)), draw(st.floats(-2.0, 2.0)))
    return Rod(pin, draw(numbers(3, 2 + modes, largest=0.2)), crank)


@profile
@given(rods(), st.floats(0.0, 6.3))
def test_the_pin_stays_on_its_line_on_the_far_side_of_the_crank(rod, t):
    crank, pin = rod.crank.at(t).position, rod.pin_place(t, rod.angle(t).angle)
    assert pin[1] == pytest.approx(0.0, abs=1e-14)
    assert pin[0] > crank[0]


@profile
@given(rods(), st.floats(0.0, 6.3))
def test_rates_are_those_of_the_angle_along_a_motion(rod, t):
    here = rod.angle(t)
    assert here.rate == pytest.approx(slope(lambda s: rod.angle(s).angle, t), abs=1e-9)
    assert here.acceleration == pytest.approx(slope(lambda s: rod.angle(s).rate, t), abs=1e-9)


@profile
@given(rods(), st.floats(0.0, 6.3), st.floats(0.0, 50.0), st.floats(0.0, 2500.0))
def test_slopes_equal_central_differences(rod, t, alpha, beta):
    shifts = alpha, beta
    here = rod.angle(t, shifts=shifts)
    found = np.vstack([here.angle_slope, here.rate_slope, here.acceleration_slope])

    def moved(change):
        a = rod.angle(t, change, shifts)
        return np.array([a.angle, a.rate, a.acceleration])

    step = 1e-2 / (1.0 + alpha)
    expected = np.column_stack(
        [slope(lambda h, u=u: moved(h * u), step=step) for u in np.eye(rod.xi.shape[1])]
    )
    scale = np.array([1.0, 1.0 + alpha, 1.0 + alpha + beta])[:, None]
    assert found / scale == pytest.approx(expected / scale, abs=1e-8)


@profile
@given(rods(), st.floats(0.0, 6.3))
def test_curvature_equals_central_differences_of_the_slope(rod, t):
    curvature = rod.angle(t).angle_curvature
    expected = np.column_stack([
        slope(lambda h, u=u: rod.angle(t, h * u).angle_slope) for u in np.eye(rod.xi.shape[1])
    ])  # fmt: skip
    assert curvature == pytest.approx(expected, abs=1e-10)
    assert curvature == pytest.approx(curvature.T, abs=1e-14)


def test_an_arm_across_the_frame_is_turned_onto_the_line():
    # A rod modelled along the y axis, crank pin on the line: the frame turns back by 90 degrees.
    crank = CrankMotion(np.zeros(2), np.zeros(2), np.zeros(2), 1.0)
    pin = np.column_stack([[0.0, 2.0], np.eye(2)])
    found = rod_angle(crank, pin, np.zeros(2), np.zeros(2), np.zeros(2), (0.0, 0.0))
    assert found.angle == pytest.approx(-np.pi / 2)


@pytest.mark.parametrize("height", [0.048, -0.048])
@pytest.mark.parametrize("length", [0.04, 0.048, 0.0])
def test_a_pin_out_of_reach_names_both_lengths(height, length):
    # At equal lengths the rod stands across the line and its angle has no rate.
    crank = CrankMotion(np.array([0.0, height]), np.zeros(2), np.zeros(2), 1.0)
    pin = np.column_stack([[length, 0.0], np.eye(2)])
    with pytest.raises(SolverError) as caught:
        rod_angle(crank, pin, np.zeros(2), np.zeros(2), np.zeros(2), (0.0, 0.0))
    assert f"{length:.4g} m" in str(caught.value)
    assert "0.048 m" in str(caught.value)


def test_a_position_that_is_no_number_is_refused():
    crank = CrankMotion(np.array([0.0, 0.01]), np.zeros(2), np.zeros(2), 1.0)
    pin = np.column_stack([[0.16, 0.0], np.eye(2)])
    with pytest.raises(SolverError):
        rod_angle(crank, pin, np.full(2, np.nan), np.zeros(2), np.zeros(2), (0.0, 0.0))


@profile
@given(st.floats(0.01, 1.0), st.floats(-600.0, 600.0), st.floats(0.0, 0.1))
def test_crank_motion_is_that_of_a_point_on_a_circle(length, speed, t):
    crank = ConstantSpeedCrank(length, speed)
    here = crank.at(t)
    step = 0.01 / (1.0 + abs(speed))
    velocity = slope(lambda s: crank.at(s).position, t, step)
    acceleration = slope(lambda s: crank.at(s).velocity, t, step)
    assert here.position == pytest.approx(length * np.array([np.cos(speed * t), np.sin(speed * t)]))
    assert here.velocity == pytest.approx(velocity, abs=1e-10 * (1 + abs(speed)))
    assert here.acceleration == pytest.approx(acceleration, abs=1e-10 * (1 + speed**2))
    assert here.speed == speed
