"""Extremes of stress histories: half-ranges over pairs of instants, principal stresses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fenics_ehd.fem.stress import deviatoric, largest_half_range, largest_principal
from fenics_ehd.reduction.basis_file import von_mises

TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def numbers(shape):
    return hnp.arrays(float, shape, elements=st.floats(-1e8, 1e8, allow_subnormal=False))


@st.composite
def histories(draw):
    """Histories of a few points: anything, few values many times over, or nearly along a line."""
    points, instants = draw(st.integers(1, 4)), draw(st.integers(1, 12))
    stress = draw(numbers((points, 6, instants)))
    kind = draw(st.sampled_from(["any", "repeated", "line"]))
    if kind == "repeated":
        stress = 1e8 * np.sign(stress)
    if kind == "line":
        stress = stress[:, :1] * draw(numbers((points, 6, 1))) * 1e-8 + 1e-9 * stress
    return stress


def by_force(stress):
    """Largest von Mises stress of ``(s_i - s_j) / 2``, all pairs tried."""
    pairs = 0.5 * (stress[:, :, :, None] - stress[:, :, None])
    return von_mises(np.moveaxis(pairs, 1, -1)).max(axis=(1, 2))


@given(histories())
def test_half_range_is_the_largest_of_all_pairs(stress):
    found = largest_half_range(stress)
    size = np.abs(stress).max(initial=1.0)
    np.testing.assert_allclose(found.von_mises, by_force(stress), rtol=1e-12, atol=1e-12 * size)
    for point, (i, j) in enumerate(found.instants):
        assert i <= j
        first, last = stress[point, :, i], stress[point, :, j]
        np.testing.assert_array_equal(found.half_range[point], 0.5 * (last - first))
        np.testing.assert_array_equal(found.mean[point], 0.5 * (last + first))
    np.testing.assert_allclose(von_mises(found.half_range), found.von_mises, rtol=1e-12, atol=1e-6)


@given(numbers((5, 6)))
def test_coordinates_have_the_length_of_the_von_mises_stress(stress):
    found = np.linalg.norm(deviatoric(stress), axis=1)
    size = np.abs(stress).max(initial=1e-300)
    np.testing.assert_allclose(found, von_mises(stress), rtol=1e-9, atol=1e-13 * size)


@given(histories())
def test_principal_stress_is_the_largest_eigenvalue_of_all_instants(stress):
    values, instants = largest_principal(stress)
    every = np.linalg.eigvalsh(np.moveaxis(stress, 1, 2)[..., TENSOR])[..., 2]
    size = np.abs(stress).max(initial=1.0)
    np.testing.assert_allclose(values, every.max(axis=1), rtol=1e-12, atol=1e-13 * size)
    there = every[np.arange(len(stress)), instants]
    np.testing.assert_allclose(values, there, rtol=1e-12, atol=1e-13 * size)


def turned(angles, principal):
    """Histories of a plane state whose axes are at given angles, shape (1, 6, instants)."""
    c, s = np.cos(angles), np.sin(angles)
    turn = np.array([[c, -s], [s, c]])
    tensor = np.einsum("ikt,k,jkt->ijt", turn, principal, turn)
    zero = np.zeros_like(angles)
    return np.array([[tensor[0, 0], tensor[1, 1], zero, zero, zero, tensor[0, 1]]])


@pytest.mark.parametrize("instants", [7, 360])
def test_uniaxial_stress_that_turns_once_keeps_its_von_mises_stress_and_yet_has_a_range(instants):
    """A tension s whose direction turns about z: its von Mises stress is s at all times.

    Opposite states are a quarter turn apart, (s - 0) / 2 along one axis and (0 - s) / 2 along the
    other, pure shear: sqrt(3) / 2 s. The mean of the pair is s / 2 in both directions.
    """
    angles = np.pi * np.arange(instants) / instants
    stress = turned(angles, np.array([1e8, 0.0]))
    found = largest_half_range(stress)
    apart = np.diff(found.instants[0])[0]
    nearest = np.abs(np.arange(instants) / instants - 0.5).argmin()
    assert apart in (nearest, instants - nearest)
    exact = 0.5 * np.sqrt(3) * np.sin(np.pi * nearest / instants)
    assert found.von_mises[0] == pytest.approx(1e8 * exact, rel=1e-12)
    if instants == 360:
        np.testing.assert_allclose(found.mean[0, :2], 0.5e8, rtol=1e-12)
    values, _ = largest_principal(stress)
    assert values[0] == pytest.approx(1e8, rel=1e-12)


def test_tension_and_compression_have_no_mean():
    """Uniaxial s cos(t): half-range s, mean 0; beside a constant stress the mean is that."""
    time = 2 * np.pi * np.arange(24) / 24
    swing = np.zeros((2, 6, 24))
    swing[:, 0] = 3e7 * np.cos(time)
    swing[1, 3] = 5e6
    found = largest_half_range(swing)
    np.testing.assert_allclose(found.von_mises, 3e7, rtol=1e-12)
    np.testing.assert_array_equal(found.instants, [[0, 12], [0, 12]])
    np.testing.assert_allclose(found.mean[:, 3], [0.0, 5e6], atol=1e-6)
    np.testing.assert_allclose(found.mean[:, 0], 0.0, atol=1e-6)


def test_pressure_from_all_sides_has_no_range():
    stress = np.zeros((1, 6, 9))
    stress[0, :3] = np.linspace(-1e9, 1e9, 9)
    assert largest_half_range(stress).von_mises[0] <= 1e-6
    assert largest_principal(stress)[0][0] == 1e9


def test_many_points_in_blocks_are_each_their_own(monkeypatch):
    from fenics_ehd.fem import stress as stress_module

    stress = np.random.default_rng(2).normal(size=(60, 6, 40))
    # From lines to clouds: from few to many candidates.
    stress *= np.linspace(0, 1, 60)[:, None, None] ** 3 + np.eye(6)[0][:, None] * 2
    whole = largest_half_range(stress)
    monkeypatch.setattr(stress_module, "_PAIRS", 500)
    parts = largest_half_range(stress)
    np.testing.assert_array_equal(parts.instants, whole.instants)
    np.testing.assert_allclose(whole.von_mises, by_force(stress), rtol=1e-12)
