"""Means of dynamic coefficients over film meshes with a few more cells around."""

import attrs
import numpy as np
import pytest
from test_equilibrium import LOAD, film, journal

import fenics_ehd as ehd
from fenics_ehd.analysis.film_meshes import MeshMean, extra_cells, mean_linearisation
from fenics_ehd.scenes.film_meshes import scenes_on_meshes

SETTINGS = ehd.BearingSettings(cells_around=24, cells_along=4)


def test_mean_and_scatter_over_meshes():
    mean = MeshMean.of([np.array([1.0, 4.0]), np.array([3.0, 4.0]), np.array([2.0, 1.0])])
    np.testing.assert_allclose(mean.value, [2.0, 3.0])
    np.testing.assert_allclose(mean.scatter, [1.0, 1.5])
    assert MeshMean.of([np.ones(2)]).scatter is None
    assert [*extra_cells(4)] == [0, 2, 4, 6]
    assert [*extra_cells(1)] == [0]


def test_a_bearing_on_one_mesh_has_the_derivatives_of_its_own_film():
    meshes = [
        ehd.solve_bearing(
            attrs.evolve(SETTINGS, cells_around=24 + extra, meshes=1),
            load=LOAD,
            with_coefficients=True,
        ).coefficients
        for extra in (0, 2, 4, 6)
    ]
    averaged = ehd.solve_bearing(SETTINGS, load=LOAD, with_coefficients=True).coefficients
    assert meshes[0].stiffness_scatter is meshes[0].damping_scatter is None
    for name in ("stiffness", "damping"):
        values = np.array([getattr(linear, name) for linear in meshes])
        size = np.abs(values).max()
        np.testing.assert_allclose(getattr(averaged, name), values.mean(0), atol=4e-3 * size)
        scatter = getattr(averaged, f"{name}_scatter")
        np.testing.assert_allclose(scatter, np.ptp(values, axis=0) / 2, atol=4e-3 * size)
        assert scatter.max() > 5e-4 * size


def test_numbers_of_meshes_have_limits():
    for meshes in (0, 5):
        with pytest.raises(ehd.errors.SettingsError, match=f"meshes = {meshes} must be"):
            ehd.BearingSettings(meshes=meshes)


def test_means_of_matrices_do_not_depend_on_the_bases_of_the_meshes():
    parts = [ehd.linearise(journal(film(cells=(24 + extra, 4)))) for extra in (0, 4)]
    assert mean_linearisation(parts[:1]) is parts[0]
    expected = mean_linearisation(parts)
    np.testing.assert_allclose(expected.mass, parts[0].mass, rtol=1e-9, atol=1e-9)
    turn, _ = np.linalg.qr(np.random.default_rng(1).standard_normal(expected.mass.shape))
    other = mean_linearisation([parts[0], parts[1].with_coordinates(turn)])
    for name in ("mass", "damping", "stiffness"):
        matrix = getattr(expected, name)
        size = np.abs(matrix).max()
        np.testing.assert_allclose(getattr(other, name), matrix, atol=1e-9 * size)
    first, second = (part.along(np.arange(2)).stiffness for part in parts)
    mean = expected.along(np.arange(2)).stiffness
    size = np.abs(mean).max()
    np.testing.assert_allclose(mean, (first + second) / 2, atol=1e-6 * size)


def test_scenes_have_more_cells_around_in_rigid_bores_alone():
    rotor = ehd.read_scene("rotor-two-bearings")
    scenes = scenes_on_meshes(rotor, 4)
    assert scenes[0] is rotor
    assert [scene.joints["left"].cells for scene in scenes] == [(n, 6) for n in (24, 26, 28, 30)]
    assert [scene.joints["right"].cells[0] for scene in scenes] == [24, 26, 28, 30]
    crank = ehd.read_scene("slider-crank")
    assert scenes_on_meshes(crank, 4) == [crank]
