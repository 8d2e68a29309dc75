"""Inertia of the floating frame against clouds of point masses, followed point by point."""

from dataclasses import dataclass

import numpy as np
import pytest
from differences import numbers, slope
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fenics_ehd.multibody.body import (
    FrameInertia,
    in_order_of_coordinates,
    rigid_integrals,
    with_total,
)
from fenics_ehd.reduction.body import InertiaIntegrals

pytestmark = pytest.mark.kernels

profile = settings(max_examples=40)


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

    def places(self, z):
        """Where the points are for ``(x, y, theta, q)``, also complex ones."""
        local = self.positions + self.modes @ z[3:]
        c, s = np.cos(z[2]), np.sin(z[2])
        x, y = local[:, 0], local[:, 1]
        return np.stack([z[0] + c * x - s * y, z[1] + s * x + c * y, local[:, 2]], axis=1)

    def kinetic_energy(self, z, rates):
        """Velocities by complex step, so exact, from positions alone."""
        velocity = self.places(z + 1e-40j * rates).imag / 1e-40
        return 0.5 * self.masses @ np.sum(velocity**2, axis=1)


@st.composite
def clouds(draw):
    points, modes = draw(st.integers(1, 5)), draw(st.integers(0, 3))
    masses = draw(hnp.arrays(float, points, elements=st.floats(0.1, 2.0), fill=st.nothing()))
    return Cloud(masses, draw(numbers(points, 3)), draw(numbers(points, 3, modes)))


@st.composite
def moving_clouds(draw):
    """A cloud, its coordinates, rates and accelerations, and what gravity is felt as."""
    cloud = draw(clouds())
    return cloud, draw(numbers(3, 3 + cloud.modes.shape[2], largest=1.5)), draw(numbers(2))


def frame(cloud, motion, minus_gravity):
    return FrameInertia(in_order_of_coordinates(cloud.integrals()), *motion, minus_gravity)


def lagrange_forces(cloud, motion, minus_gravity):
    """``d/dt (dT/dz') - d(T - V)/dz`` at time zero for every coordinate."""
    z, v, a = motion

    def energy(t, change=0.0, rate_change=0.0):
        place = z + t * v + 0.5 * t**2 * a + change
        return cloud.kinetic_energy(place, v + t * a + rate_change)

    def lagrangian(change):
        return energy(0.0, change) - cloud.masses @ cloud.places(z + change)[:, :2] @ minus_gravity

    forces = []
    for unit in np.eye(len(z)):
        # T is quadratic in the rates: a central difference over any step is exact.
        def momentum(t, unit=unit):
            return 0.5 * (energy(t, rate_change=unit) - energy(t, rate_change=-unit))

        varied = slope(lambda h, unit=unit: lagrangian(h * unit), step=0.02)
        forces.append(slope(momentum, step=0.02) - varied)
    return np.array(forces)


@profile
@given(moving_clouds())
def test_inertia_forces_are_the_lagrange_equations_of_the_points(case):
    cloud, motion, minus_gravity = case
    expected = lagrange_forces(cloud, motion, minus_gravity)
    found = frame(cloud, motion, minus_gravity).forces
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * cloud.masses.sum())


@profile
@given(moving_clouds())
def test_derivatives_of_the_inertia_forces_equal_central_differences(case):
    cloud, motion, minus_gravity = case
    derivatives = frame(cloud, motion, minus_gravity).derivatives()
    found = derivatives.position, derivatives.rate, derivatives.acceleration
    for row, derivative in enumerate(found):

        def forces(change, row=row):
            moved = motion.copy()
            moved[row] += change
            return frame(cloud, moved, minus_gravity).forces

        columns = [slope(lambda h, u=u: forces(h * u)) for u in np.eye(motion.shape[1])]
        expected = np.column_stack(columns)
        assert derivative == pytest.approx(expected, rel=1e-9, abs=1e-9 * cloud.masses.sum())


@profile
@given(moving_clouds())
def test_kinetic_energy_is_the_sum_over_the_points(case):
    cloud, motion, minus_gravity = case
    expected = cloud.kinetic_energy(*motion[:2])
    found = frame(cloud, motion, minus_gravity).kinetic_energy
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12 * cloud.masses.sum())


@profile
@given(clouds(), st.data())
def test_another_total_is_that_of_masses_fixed_to_the_frame(cloud, data):
    # In the plane, where the frame has its inertia.
    added = Cloud(np.array([0.3, 0.5]), np.zeros((2, 3)), np.zeros((2, 3, cloud.modes.shape[2])))
    added.positions[:, :2] = data.draw(numbers(2, 2))
    parts = (np.concatenate(pair) for pair in zip(*(vars(c).values() for c in (cloud, added))))  # noqa: B905
    larger = Cloud(*parts).integrals()
    found = with_total(
        cloud.integrals(), larger.total_mass, larger.polar_inertia, larger.centre_of_mass
    )
    # Heights of the points are none of a planar frame's business.
    for name in ("spin", "centrifugal"):
        assert getattr(found, name) == pytest.approx(getattr(larger, name), rel=1e-9, abs=1e-11)
    assert found.mass[1:, 1:] == pytest.approx(larger.mass[1:, 1:], rel=1e-9, abs=1e-11)
    assert found.centre_of_mass == pytest.approx(larger.centre_of_mass, rel=1e-9, abs=1e-11)
    same = with_total(cloud.integrals(), None, None, None)
    assert same.mass == pytest.approx(cloud.integrals().mass, abs=1e-12)


@profile
@given(numbers(3, 2), numbers(2))
def test_integrals_of_a_rigid_body_are_those_of_its_points(positions, offset):
    flat = np.column_stack([positions + offset, np.zeros(3)])
    cloud = Cloud(np.array([0.4, 1.0, 1.6]), flat, np.zeros((3, 3, 0)))
    expected = cloud.integrals()
    found = rigid_integrals(expected.total_mass, expected.polar_inertia, expected.centre_of_mass)
    for name in ("mass", "spin", "centrifugal"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=1e-12)


def test_named_integrals_are_those_of_the_points():
    masses, positions = np.array([1.0, 2.0, 0.5]), np.array([[1, 2, 3], [-1, 0, 2], [0, 4, -5.0]])
    integrals = Cloud(masses, positions, np.zeros((3, 3, 0))).integrals()
    centre = masses @ positions[:, :2] / masses.sum()
    polar = masses @ np.sum((positions[:, :2] - centre) ** 2, axis=1)
    assert integrals.total_mass == pytest.approx(masses.sum())
    assert integrals.centre_of_mass == pytest.approx(centre)
    assert integrals.polar_inertia == pytest.approx(polar)
