"""A film in the bore of a reduced body: conjugate, and exact in its resultants on any mesh."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from film_cases import ETA, OMEGA, C

import fenics_ehd as ehd
from fenics_ehd.multibody.elastic_bore import ElasticBore
from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.scenes.films import film_mesh
from fenics_ehd.scenes.schema import LubricatedSettings

MESHES = [
    (20, 5, "serendipity"),
    (20, 5, "lagrange"),
    (13, 3, "lagrange"),
    (48, 8, "bilinear"),
    (40, 10, "serendipity"),
    (40, 10, "bilinear"),  # its nodes are those of the bore's 20 x 5 9-node cells
]


def test_cells_of_the_bore_take_the_element_of_the_scene(rod_body):
    for element in ("lagrange", "bilinear"):
        joint = LubricatedSettings(journal="crank", bore="rod.bore", clearance=C, element=element)
        grid = film_mesh(joint, rod_body.bore)
        assert (grid.cells, grid.family) == ((20, 5), element)


def film_in(body, around, along, family, **more):
    grid = ehd.uniform_grid(body.bore.radius, body.bore.width, (around, along), family)
    return film_on(grid, **more)


def film_on(grid, **more):
    return ehd.Film(ehd.FilmParameters(grid, C, ehd.Lubricant(ETA), OMEGA), **more)


def some_pressure(film):
    """Smooth, positive, zero at the sides."""
    angle, height = film.parameters.grid.node_positions.T
    z = 2 * height / film.parameters.grid.width
    return 1e7 * (1 - z**2) * np.exp(np.cos(angle - 0.7)) * (1 + 0.3 * z)


def forces(bore):
    """Of nodal pressures: along x and y, and on the elastic modes."""
    return np.vstack([bore.force, bore.load])


@pytest.mark.parametrize("transfer", ["conservative", "mortar"])
@pytest.mark.parametrize("mesh", MESHES)
def test_resultants_are_those_of_the_films_pressure(rod_body, mesh, transfer):
    film = film_in(rod_body, *mesh)
    bore = ehd.BoreFilm(rod_body, film, transfer)
    pressure = some_pressure(film)
    normal = np.stack(film.points.normal, axis=-1)
    expected = film.load(normal) @ pressure
    # The mortar's P_s is loaded on the body's own surface, which is not quite round.
    exact = 1e-12 if transfer == "conservative" or bore.projected is None else 2e-3
    scale = np.linalg.norm(expected)
    np.testing.assert_allclose(bore.force @ pressure, expected, atol=exact * scale)


@pytest.mark.parametrize("tilting", [False, True])
@pytest.mark.parametrize("mesh", MESHES)
def test_force_and_gap_are_conjugate(rod_body, mesh, tilting):
    # Power on the coordinates = integral of pressure times gap rate, the film's own rule.
    film = film_in(rod_body, *mesh)
    joint = JointFilm(
        ehd.LubricatedJoint("shaft", "rod.bore", film),
        partial(ElasticBore, rod_body, "bore"),
        tilting=tilting,
    )
    random = np.random.default_rng(0)
    rate = random.uniform(-1, 1, joint.size)
    pressure = random.uniform(0, 1, len(film.parameters.grid.nodes))
    gap = joint.gap(0 * rate, rate, OMEGA)
    value = film.assembly.at_points(pressure)[0]
    area = film.parameters.grid.radius**2 * film.assembly.area
    power = np.sum(area * value * gap.thickness_rate)
    force = joint.load @ pressure
    assert force @ rate == pytest.approx(power, abs=1e-12 * np.abs(force) @ np.abs(rate))
    np.testing.assert_allclose(
        joint.gap(1e-9 * rate, rate, OMEGA).thickness, C + 1e-9 * gap.thickness_rate, rtol=1e-12
    )
    observed = C + (joint.observed @ (1e-9 * rate))[: gap.thickness.size]
    np.testing.assert_allclose(observed, (C + 1e-9 * gap.thickness_rate).ravel(), rtol=1e-12)


def test_matching_mesh_gives_the_loads_of_the_body(rod_body):
    # Whose own integrals run over the discrete bore of 20 cells: round to 1e-4.
    film = film_on(ehd.film_grid(rod_body.pressure_nodes))
    assert film.parameters.grid.cells == (20, 5)
    bore = ehd.BoreFilm(rod_body, film)
    assert bore.projected is None
    pressure = some_pressure(film)
    expected = rod_body.load_projection[1:] @ bore.structure_pressure(pressure)
    np.testing.assert_allclose(
        forces(bore) @ pressure, expected, atol=2e-4 * np.abs(expected).max()
    )
    # Node by node up to their order.
    np.testing.assert_array_equal(np.sort(bore.structure_pressure(pressure)), np.sort(pressure))


def test_generalised_forces_converge_with_the_film_mesh(rod_body):
    # The same smooth pressure on finer and finer film meshes, on the bore of 20 x 5 cells.
    fine = film_in(rod_body, 160, 20, "lagrange")
    expected = forces(ehd.BoreFilm(rod_body, fine)) @ some_pressure(fine)
    errors = []
    for cells in ((20, 5), (40, 10)):
        film = film_in(rod_body, *cells, "lagrange")
        errors.append(
            np.abs(forces(ehd.BoreFilm(rod_body, film)) @ some_pressure(film) - expected).max()
        )
    assert errors[-1] < 1e-4 * np.abs(expected).max()
    assert errors[0] / errors[1] > 6


def test_film_of_another_cylinder_is_refused(rod_body):
    for radius, width, named in (
        (1.001 * rod_body.bore.radius, rod_body.bore.width, "radius"),
        (rod_body.bore.radius, 0.9 * rod_body.bore.width, "width"),
    ):
        film = film_on(ehd.uniform_grid(radius, width, (20, 5)))
        with pytest.raises(ehd.errors.InterfaceMismatchError, match=f"the film's {named} of"):
            ehd.BoreFilm(rod_body, film)


@pytest.mark.parametrize("mesh", [(20, 5, "serendipity"), (24, 4, "lagrange")])
def test_load_matrix_of_another_body_is_refused(rod_body, mesh):
    film = film_in(rod_body, *mesh)
    for load in (
        1.05 * rod_body.load_projection,
        -rod_body.load_projection,
        rod_body.load_projection[:, ::-1],
    ):
        with pytest.raises(ehd.errors.InterfaceMismatchError, match="give different forces"):
            ehd.BoreFilm(replace(rod_body, load_projection=load), film)
