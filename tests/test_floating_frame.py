"""Inertia of the floating frame against clouds of point masses, followed point by point."""

from dataclasses import dataclass

import numpy as np
import pytest
from differences import numbers, slope
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fenics_ehd.multibody.crank import CrankMotion
from fenics_ehd.multibody.floating_frame import inertia_forces, kinetic_energy, with_point_mass
from fenics_ehd.multibody.guide import RodAngle
from fenics_ehd.reduction.body import InertiaIntegrals

pytestmark = pytest.mark.kernels

#: Derandomised, so that every machine tests the same cases.
profile = settings(deadline=None, derandomize=True, max_examples=40)


@dataclass
class Cloud:
    """Point masses (N,) at positions (N, 3) with displacement fields (N, 3, n)."""

    masses: np.ndarray
    positions: np.ndarray
    modes: np.ndarray

    def integrals(self):
        fields = np.zeros((len(self.masses), 3, 3 + self.modes.shape[2]))
        fields[:, :, 0] = self.positions
        fields[:, 0, 1] = fields[:, 1, 2] = 1.0
        fields[:, :, 3:] = self.modes
        turned = np.stack([-fields[:, 1], fields[:, 0], 0 * fields[:, 2]], axis=1)

        def total(a, b):
            return np.einsum("k,kci,kcj->ij", self.masses, a, b)

        return InertiaIntegrals(total(fields, fields), total(fields, turned), total(turned, turned))

    def places(self, c1, xi, theta):
        """Where the points are: ``C1 + A(theta) (x + Phi q - e)``, also for complex arguments."""
        local = self.positions + self.modes @ xi[2:]
        x, y = local[:, 0] + xi[0], local[:, 1] + xi[1]
        c, s = np.cos(theta), np.sin(theta)
        return np.stack([c1[0] + c * x - s * y, c1[1] + s * x + c * y, local[:, 2]], axis=1)


@dataclass
class Motion:
    """Parabolas ``value + t rate + t^2/2 acceleration`` of xi, theta and C1."""

    xi: np.ndarray
    theta: np.ndarray
    c1: np.ndarray

    @staticmethod
    def _at(rows, t):
        return rows[0] + t * rows[1] + 0.5 * t**2 * rows[2]

    def coordinates(self, t):
        """All coordinates that are free to vary: xi, then theta."""
        return np.append(self._at(self.xi, t), self._at(self.theta, t))

    def rates(self, t):
        return np.append(self.xi[1] + t * self.xi[2], self.theta[1] + t * self.theta[2])

    def crank(self):
        return CrankMotion(*self.c1, speed=1.0)

    def angle(self, slopes=None):
        n = self.xi.shape[1]
        slopes = np.zeros((3, n)) if slopes is None else slopes
        return RodAngle(*self.theta, *slopes, curvature=lambda: np.zeros((n, n)))


@st.composite
def clouds(draw):
    points, modes = draw(st.integers(1, 5)), draw(st.integers(0, 3))
    masses = draw(hnp.arrays(float, points, elements=st.floats(0.1, 2.0), fill=st.nothing()))
    return Cloud(masses, draw(numbers(points, 3)), draw(numbers(points, 3, modes)))


@st.composite
def moving_clouds(draw):
    cloud = draw(clouds())
    size = 2 + cloud.modes.shape[2]
    motion = Motion(draw(numbers(3, size)), draw(numbers(3, largest=1.5)), draw(numbers(3, 2)))
    return cloud, motion


def point_energy(cloud, motion, coordinates, rates, t):
    """Kinetic energy of the points; velocities by complex step, so exact, from positions alone."""
    tiny = 1e-40
    x, c1 = coordinates + 1j * tiny * rates, motion._at(motion.c1, t + 1j * tiny)
    velocity = cloud.places(c1, x[:-1], x[-1]).imag / tiny
    return 0.5 * cloud.masses @ np.sum(velocity**2, axis=1)


def lagrange_forces(cloud, motion):
    """``d/dt (dT/dx') - dT/dx`` at time zero for every coordinate."""

    def energy(t, change=0.0, rate_change=0.0):
        return point_energy(
            cloud, motion, motion.coordinates(t) + change, motion.rates(t) + rate_change, t
        )

    forces = []
    for unit in np.eye(len(motion.rates(0.0))):
        # T is quadratic in the rates: a central difference over any step is exact.
        def momentum(t, unit=unit):
            return 0.5 * (energy(t, rate_change=unit) - energy(t, rate_change=-unit))

        varied = slope(lambda h, unit=unit: energy(0.0, change=h * unit), step=0.02)
        forces.append(slope(momentum, step=0.02) - varied)
    return np.array(forces)


@profile
@given(moving_clouds())
def test_inertia_forces_are_the_lagrange_equations_of_the_points(case):
    cloud, motion = case
    forces = inertia_forces(
        cloud.integrals(), motion.crank(), motion.angle(), tuple(motion.xi), (0.0, 0.0)
    )
    found = np.append(forces.on_xi, forces.on_theta)
    expected = lagrange_forces(cloud, motion)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * cloud.masses.sum())


@profile
@given(moving_clouds(), st.data())
def test_slopes_of_the_inertia_forces_equal_central_differences(case, data):
    cloud, motion = case
    size = motion.xi.shape[1]
    # The angle may follow xi in any way: that is for the guide to say.
    angle_slopes = data.draw(numbers(3, size, largest=3.0))
    shifts = data.draw(st.floats(0.0, 50.0)), data.draw(st.floats(0.0, 2500.0))
    integrals = cloud.integrals()

    def forces(change):
        xi = motion.xi + np.outer([1.0, *shifts], change)
        theta = motion.theta + angle_slopes @ change
        moved = Motion(xi, theta, motion.c1)
        return inertia_forces(
            integrals, motion.crank(), moved.angle(angle_slopes), tuple(xi), shifts
        )

    here = forces(np.zeros(size))
    # Differences over a step that moves the rates by 1e-2 at most.
    step = 1e-2 / (1.0 + max(shifts))
    found = np.vstack([here.on_xi_slope, here.on_theta_slope])
    expected = np.column_stack([
        slope(lambda h, u=unit: np.append((f := forces(h * u)).on_xi, f.on_theta), step=step / 4)
        for unit in np.eye(size)
    ])  # fmt: skip
    scale = cloud.masses.sum() * (1.0 + max(shifts))
    assert found == pytest.approx(expected, rel=1e-8, abs=1e-8 * scale)


@profile
@given(moving_clouds())
def test_kinetic_energy_is_the_sum_over_the_points(case):
    cloud, motion = case
    found = kinetic_energy(cloud.integrals(), motion.crank(), motion.angle(), *motion.xi[:2])
    expected = point_energy(cloud, motion, motion.coordinates(0.0), motion.rates(0.0), 0.0)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12 * cloud.masses.sum())


@profile
@given(clouds(), st.floats(0.1, 2.0), st.data())
def test_a_point_mass_joins_the_cloud(cloud, mass, data):
    position = data.draw(numbers(2))
    modes = data.draw(numbers(2, cloud.modes.shape[2]))
    # The planar frame carries the piston in its plane: no height, no motion along z.
    larger = Cloud(
        np.append(cloud.masses, mass),
        np.vstack([cloud.positions, [*position, 0.0]]),
        np.concatenate([cloud.modes, np.vstack([modes, 0 * modes[:1]])[None]]),
    ).integrals()
    found = with_point_mass(cloud.integrals(), np.column_stack([position, np.eye(2), modes]), mass)
    for name in ("mass", "spin", "centrifugal"):
        assert getattr(found, name) == pytest.approx(getattr(larger, name), rel=1e-12, abs=1e-13)


def test_named_integrals_are_those_of_the_points():
    masses, positions = np.array([1.0, 2.0, 0.5]), np.array([[1, 2, 3], [-1, 0, 2], [0, 4, -5.0]])
    integrals = Cloud(masses, positions, np.zeros((3, 3, 0))).integrals()
    centre = masses @ positions[:, :2] / masses.sum()
    polar = masses @ np.sum((positions[:, :2] - centre) ** 2, axis=1)
    assert integrals.total_mass == pytest.approx(masses.sum())
    assert integrals.centre_of_mass == pytest.approx(centre)
    assert integrals.polar_inertia == pytest.approx(polar)
