"""A film in the bore of a reduced body: conjugate, and exact in its resultants on any mesh."""

from dataclasses import replace

import numpy as np
import pytest
from film_cases import ETA, OMEGA, C

from fenics_ehd.errors import InterfaceMismatchError
from fenics_ehd.film import Film, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.film.layout import film_grid
from fenics_ehd.multibody.bore_film import BoreFilm
from fenics_ehd.multibody.journal import Journal
from fenics_ehd.scenes.film_mesh import film_mesh
from fenics_ehd.scenes.slider_crank_settings import Film as FilmSettings

MESHES = [
    (20, 5, "serendipity"),
    (20, 5, "lagrange"),
    (13, 3, "lagrange"),
    (48, 8, "bilinear"),
    (40, 10, "serendipity"),
    (40, 10, "bilinear"),  # its nodes are those of the bore's 20 x 5 9-node cells
]


@pytest.fixture(scope="module")
def body(rod_body):
    return rod_body


def test_cells_of_the_bore_take_the_element_of_the_scene(body):
    for element in ("lagrange", "bilinear"):
        grid = film_mesh(FilmSettings(element=element), body)
        assert (grid.cells, grid.family) == ((20, 5), element)


def film_in(body, around, along, family, **more):
    grid = uniform_grid(body.bore_radius, body.bore_width, (around, along), family)
    return film_on(grid, **more)


def film_on(grid, **more):
    return Film(FilmParameters(grid, C, Lubricant(ETA), OMEGA), **more)


def some_pressure(film):
    """Smooth, positive, zero at the sides."""
    angle, height = film.parameters.grid.node_positions.T
    z = 2 * height / film.parameters.grid.width
    return 1e7 * (1 - z**2) * np.exp(np.cos(angle - 0.7)) * (1 + 0.3 * z)


@pytest.mark.parametrize("transfer", ["conservative", "mortar"])
@pytest.mark.parametrize("mesh", MESHES)
def test_resultants_are_those_of_the_films_pressure(body, mesh, transfer):
    film = film_in(body, *mesh)
    bore = BoreFilm(body, film, transfer)
    pressure = some_pressure(film)
    normal = np.stack(film.points.normal, axis=-1)
    expected = film.load(normal) @ pressure
    # The mortar's P_s is loaded on the body's own surface, which is not quite round.
    exact = 1e-12 if transfer == "conservative" or bore.matching else 2e-3
    scale = np.linalg.norm(expected)
    np.testing.assert_allclose(bore.load[1:3] @ pressure, expected, atol=exact * scale)
    # Radial forces have no moment about the axis; the spin of the position is one about z.
    moment = bore.spin_load[0] @ pressure
    assert abs(moment) < 1e-3 * scale * body.bore_radius


@pytest.mark.parametrize("mesh", MESHES)
def test_force_and_gap_are_conjugate(body, mesh):
    # Power on the coordinates = integral of pressure times gap rate, the film's own rule.
    film = film_in(body, *mesh)
    journal = Journal(body, film)
    random = np.random.default_rng(0)
    rate = random.uniform(-1, 1, 2 + body.modes)
    pressure = random.uniform(0, 1, len(film.parameters.grid.nodes))
    gap = journal.film_gap(0 * rate, rate, OMEGA)
    value = film.assembly.at_points(pressure)[0]
    area = film.parameters.grid.radius**2 * film.assembly.area
    power = np.sum(area * value * gap.thickness_rate)
    force = journal.bore.load[1:] @ pressure
    assert force @ rate == pytest.approx(power, abs=1e-12 * np.abs(force) @ np.abs(rate))
    np.testing.assert_allclose(
        journal.film_gap(1e-9 * rate, rate, OMEGA).thickness,
        C + 1e-9 * gap.thickness_rate,
        rtol=1e-12,
    )
    watched = journal.gap(1e-9 * rate)[: gap.thickness.size]
    np.testing.assert_allclose(watched, (C + 1e-9 * gap.thickness_rate).ravel(), rtol=1e-12)


def test_matching_mesh_gives_the_loads_of_the_body(body):
    # Whose own integrals run over the discrete bore of 20 cells: round to 1e-4.
    film = film_on(film_grid(body.pressure_nodes))
    assert film.parameters.grid.cells == (20, 5)
    bore = BoreFilm(body, film)
    assert bore.matching
    pressure = some_pressure(film)
    for own, given in (
        (bore.load, body.load_projection),
        (bore.spin_load, body.spin_load_projection),
    ):
        expected = given @ bore.structure_pressure(pressure)
        np.testing.assert_allclose(
            (own @ pressure)[1:], expected[1:], atol=2e-4 * np.abs(expected[1:]).max()
        )
    # Node by node up to their order.
    np.testing.assert_array_equal(np.sort(bore.structure_pressure(pressure)), np.sort(pressure))


def test_generalised_forces_converge_with_the_film_mesh(body):
    # The same smooth pressure on finer and finer film meshes, on the bore of 20 x 5 cells.
    fine = film_in(body, 160, 20, "lagrange")
    expected = BoreFilm(body, fine).load @ some_pressure(fine)
    errors = []
    for cells in ((20, 5), (40, 10)):
        film = film_in(body, *cells, "lagrange")
        errors.append(np.abs(BoreFilm(body, film).load @ some_pressure(film) - expected).max())
    assert errors[-1] < 1e-4 * np.abs(expected).max()
    assert errors[0] / errors[1] > 6


@pytest.mark.parametrize("transfer", ["conservative", "mortar"])
def test_film_of_a_run_hardly_depends_on_its_mesh(body, transfer):
    xi = np.zeros(2 + body.modes)
    xi[:2] = 0.6 * C, 0.2 * C
    rate = np.zeros_like(xi)
    rate[:2] = 20 * C, -50 * C
    forces = []
    for mesh in ((20, 5, "lagrange"), (40, 10, "lagrange"), (80, 20, "bilinear")):
        journal = Journal(body, film_in(body, *mesh), transfer)
        pressure = journal.film.solve(journal.film_gap(xi, rate, OMEGA)).pressure
        forces.append(journal.load[1:] @ pressure)
    scale = np.abs(forces[1]).max()
    for other in (forces[0], forces[2]):
        np.testing.assert_allclose(other, forces[1], atol=1e-2 * scale)


def test_film_of_another_cylinder_is_refused(body):
    for radius, width, named in (
        (1.001 * body.bore_radius, body.bore_width, "radius"),
        (body.bore_radius, 0.9 * body.bore_width, "width"),
    ):
        film = film_on(uniform_grid(radius, width, (20, 5)))
        with pytest.raises(InterfaceMismatchError, match=f"the film's {named} of"):
            BoreFilm(body, film)


@pytest.mark.parametrize("mesh", [(20, 5, "serendipity"), (24, 4, "lagrange")])
def test_load_matrix_of_another_body_is_refused(body, mesh):
    film = film_in(body, *mesh)
    for load in (1.05 * body.load_projection, -body.load_projection, body.load_projection[:, ::-1]):
        with pytest.raises(InterfaceMismatchError, match="disagree on the work of a pressure"):
            BoreFilm(replace(body, load_projection=load), film)
