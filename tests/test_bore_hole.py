"""A bore whose mesh has a hole, as that of an oil passage: found, loaded, fed or closed."""

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scene_cases import LOAD, LOADED_JOURNAL, tables_of

import fenics_ehd as ehd
from fenics_ehd.film.forces import FilmFlows
from fenics_ehd.film.transfer import Surface, interpolation_matrix, mean_value, solid_share
from fenics_ehd.multibody.elastic_bore import bore_surface
from fenics_ehd.reduction.bore import bore_holes
from fenics_ehd.scenes import part as elastic_part
from fenics_ehd.scenes.scene import scene_of

MODEL = Path(__file__).parent / "ring-with-hole.geo"
RING = {
    "bodies.housing": {
        "kind": "flexible", "model": str(MODEL), "cells": "tet", "clamped": "outside",
        "points": [], "damping_time": 1e-4, "reduction": {"method": "m3", "residual_modes": 12},
    },
    "joints.bearing.bore": "housing.bore",
    "joints.bearing.radius": None,
    "joints.bearing.width": None,
    "joints.bearing.cells": [40, 10],
    "bodies.ground": None,
    "forces.load.file": "load.csv",
}  # fmt: skip
PLACE, HEIGHT, RADIUS = np.pi / 2, 1e-3, 3.5e-3


@pytest.fixture(scope="module")
def ring():
    settings = scene_of(tables_of("loaded-journal", RING), "ring").bodies["housing"]
    return elastic_part.elastic_part(settings, "bodies.housing", "lagrange", MPI.COMM_SELF).source


def test_the_hole_is_found_where_it_is(ring):
    bore = ring.bores["bore"]
    (hole,) = bore_holes(bore.coordinates, bore.cells, bore.family)
    assert hole.angle == pytest.approx(PLACE, abs=0.01)
    assert hole.height == pytest.approx(HEIGHT, abs=0.05 * RADIUS)
    assert hole.radius == pytest.approx(bore.radius, rel=1e-6)
    # A polygon of few edges within a circle.
    assert 0.9 * 2 * RADIUS < hole.diameter < 2 * RADIUS


def test_what_the_rim_knows_is_extended_linearly(ring):
    bore = ring.bores["bore"]
    surface = bore_surface(bore.coordinates, bore.cells, bore.family)
    (hole,) = surface.holes
    grid = ehd.uniform_grid(bore.radius, bore.width, (160, 40))
    angle, height = grid.node_positions.T
    inside = hole.contains(angle, height)
    assert 100 < inside.sum() < 400
    matrix = interpolation_matrix(surface, angle, height)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=1e-12)
    linear = surface.nodes[:, 1] + 0.3 * np.mod(surface.nodes[:, 0], 2 * np.pi)
    linear[hole.rim] = hole.polygon @ [0.3, 1.0]
    found = (matrix @ linear)[inside]
    np.testing.assert_allclose(found, height[inside] + 0.3 * angle[inside], rtol=1e-9)


@pytest.mark.slow
def test_the_film_presses_on_what_the_hole_leaves(ring):
    bore, body = ring.bores["bore"], ehd.load_dependent(ring, 4, 12)
    grid = ehd.uniform_grid(bore.radius, bore.width, (40, 10))
    film = ehd.Film(ehd.FilmParameters(grid, 20e-6, ehd.Lubricant(0.01), 300.0))
    maps = ehd.BoreFilm(body, film)
    (hole,) = maps.holes
    angle, height = grid.node_positions.T
    one = np.ones(len(angle))
    # In all, the film's own; on elastic modes, that of the body's load matrix.
    np.testing.assert_allclose(maps.force @ one, 0.0, atol=1e-9 * bore.radius * bore.width)
    area = bore.radius * np.sum(film.assembly.area * bore.radius * maps.solid)
    surface = bore_surface(bore.coordinates, bore.cells, bore.family)
    assert area == pytest.approx(bore.radius * surface.covered, rel=1e-12)
    for pressure in (one, 1 + np.cos(angle), height / bore.width + 1, 2 + np.sin(angle)):
        expected = body.load_projection[1 + 2 :] @ maps.structure_pressure(pressure)
        found = maps.load @ pressure
        assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()
    assert hole.angle == pytest.approx(PLACE, abs=0.01)


def test_shares_of_a_cell_integrate_quadratics():
    # A hole of straight edges in a mesh of bilinear cells: what is left is known.
    grid = ehd.uniform_grid(1.0, 2.0, (24, 12), "bilinear")
    angle, height = grid.node_positions.T
    cells = grid.cell_nodes
    out = (np.abs(angle[cells] - np.pi) < 0.6).all(axis=1)
    out &= (np.abs(height[cells]) < 0.4).all(axis=1)
    kept = cells[~out]
    nodes = np.unique(kept)
    number = np.full(len(angle), -1)
    number[nodes] = np.arange(len(nodes))
    surface = Surface(grid.node_positions[nodes], number[kept], "bilinear")
    (hole,) = surface.holes
    film_grid = ehd.uniform_grid(1.0, 2.0, (10, 7))
    film = Surface(film_grid.node_positions, film_grid.cell_nodes, "lagrange")
    made = ehd.Film(ehd.FilmParameters(film_grid, 1e-3, ehd.Lubricant(0.01), 1.0))
    share = solid_share(surface, film, made.assembly.reference)
    x, z = made.points.angle, made.points.height
    ends = hole.polygon.min(axis=0), hole.polygon.max(axis=0)
    a, b = ends
    for i in range(3):
        for j in range(3):
            whole = ((2 * np.pi) ** (i + 1)) / (i + 1) * (1 - (-1) ** (j + 1)) / (j + 1)
            lacks = (b[0] ** (i + 1) - a[0] ** (i + 1)) * (b[1] ** (j + 1) - a[1] ** (j + 1))
            exact = whole - lacks / ((i + 1) * (j + 1))
            found = np.sum(made.assembly.area * share * x**i * z**j)
            assert found == pytest.approx(exact, rel=1e-10, abs=1e-12)
    # Film cells that the hole does not touch are as they were, to the last bit.
    assert 0 < (share != 1.0).any(axis=1).sum() < 20


# --- In a scene


def ring_run(ring, monkeypatch, changes):
    """Mechanism of a scene and a run of it, its part assembled before."""
    # The error of the mesh frees the mass matrix of the part that it is given.
    copied = replace(ring, mass=ring.mass.copy())
    monkeypatch.setattr(elastic_part, "_assembled", lambda *_: copied)
    end = 1e-3
    short = {"time.periodic": False, "time.period": None, "time.end": end}
    scene = scene_of(tables_of("loaded-journal", LOADED_JOURNAL | RING | short | changes), "ring")
    mechanism = ehd.build(scene).mechanism
    return mechanism, lambda: ehd.simulate(mechanism, end=end, tolerance=1e-3, order=2, first=1e-6)


@pytest.fixture
def load(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "load.csv").write_text(LOAD)


HOLE = {"joints.bearing.supply.inlet": {"kind": "hole", "pressure": 2e6}}


@pytest.mark.slow
def test_a_hole_in_the_mesh_is_closed_unless_a_supply_is_there(ring, monkeypatch, load):
    mechanism, run = ring_run(ring, monkeypatch, {})
    film = mechanism.joints["bearing"].film
    assert film.parameters.feeds == ()
    (recess,) = film.parameters.recesses
    assert recess.middle == pytest.approx(PLACE, abs=0.01)
    closed = run()
    mechanism, run = ring_run(ring, monkeypatch, HOLE)
    parameters = mechanism.joints["bearing"].film.parameters
    assert parameters.recesses == ()
    (feed,) = parameters.feeds
    place_and_size = (feed.angle, feed.height, feed.diameter)
    assert place_and_size == (
        recess.angle,
        recess.height,
        recess.diameter,
    )  # place and size are the mesh's
    fed = run()
    assert closed.status == fed.status == "complete"
    assert fed.columns["inlet.flow_m3_per_s"][-1] > 0.0
    # The hole lies where the film bears the load: the closed one lets it, the fed one helps.
    assert (
        fed.joints["bearing"].min_film_thickness[-1]
        > 1.0001 * (closed.joints["bearing"].min_film_thickness[-1])
    )
    for result in (closed, fed):
        assert result.summary()["energy_balance_error"] < 1e-3


def test_the_pressure_in_a_closed_hole_is_uniform():
    bore = ehd.HoleSupply(angle=np.degrees(-1.8), diameter=7e-3)
    grid = ehd.uniform_grid(0.0225, 0.022, (80, 20))
    film = ehd.Film(ehd.FilmParameters(grid, 20e-6, ehd.Lubricant(0.01), 300.0, recesses=(bore,)))
    plain = ehd.Film(ehd.FilmParameters(grid, 20e-6, ehd.Lubricant(0.01), 300.0))
    motion = ehd.ShaftMotion(np.array([10e-6, -4e-6]), 300.0)
    states = [f.solve(ehd.shaft_gap(f.points, 0.0225, 20e-6, motion)) for f in (film, plain)]
    angle, height = grid.node_positions.T
    arc = 0.0225 * (np.mod(angle + 1.8 + np.pi, 2 * np.pi) - np.pi)
    inside = np.hypot(arc, height) < 0.6 * 3.5e-3
    spread = [np.ptp(s.pressure[inside]) / s.pressure[inside].mean() for s in states]
    assert spread[1] > 0.1
    assert spread[0] < 0.02 * spread[1]
    flows = FilmFlows(film, states[0]).balance
    assert flows.supply == 0.0


@pytest.mark.parametrize("kind", ["recesses", "feeds"])
def test_a_film_that_has_become_warm_is_one_of_warm_oil(kind):
    oil = ehd.Oil(viscosity_40=100.0, viscosity_100=11.0, density_15=880.0)
    hole = ehd.HoleSupply(name="inlet", angle=np.degrees(-1.8), diameter=7e-3, pressure=2e5)
    grid = ehd.uniform_grid(0.0225, 0.022, (40, 10))

    def film(temperature):
        lubricant = ehd.Lubricant.of(oil, temperature)
        return ehd.Film(ehd.FilmParameters(grid, 20e-6, lubricant, 300.0, **{kind: (hole,)}))

    warm, warmed = film(90.0), film(40.0)
    warmed.set_temperature(90.0)
    motion = ehd.ShaftMotion(np.array([10e-6, -4e-6]), 300.0)
    gap = ehd.shaft_gap(warm.points, 0.0225, 20e-6, motion)
    expected = warm.solve(gap).pressure
    assert np.abs(warmed.solve(gap).pressure - expected).max() < 1e-9 * expected.max()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints.bearing.cells": []}, r"bearing.cells is missing: grooves, supplies and holes of"),
        ({"joints.bearing.cells": [16, 4]}, r"the hole in the mesh of the bore at 90 degrees, .*"
         r"use cells = \[22, 4\]"),
        (HOLE | {"joints.bearing.supply.inlet.on": "journal"}, r"inlet.diameter is missing \[m\]"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_hole_is_refused(ring, monkeypatch, load, changes, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        ring_run(ring, monkeypatch, deepcopy(changes))


def test_a_rigid_bore_has_no_hole_to_name():
    scene = scene_of(tables_of("loaded-journal", deepcopy(HOLE)), "rigid")
    with pytest.raises(ehd.errors.SettingsError, match="has no hole in a mesh whose diameter"):
        ehd.build(scene)


def test_faces_of_another_program_may_leave_a_hole_but_no_gap(ring):
    bore = ring.bores["bore"]
    found = ehd.bore_from_faces(bore.coordinates, bore.cells, bore.family)
    assert len(bore_holes(found.coordinates, found.cells, found.family)) == 1
    with pytest.raises(ehd.errors.StructureError, match="not a complete cylinder"):
        ehd.bore_from_faces(bore.coordinates, bore.cells[1:], bore.family)
    angle = np.arctan2(bore.coordinates[:, 1], bore.coordinates[:, 0])
    slit = np.abs(angle[bore.cells]).max(axis=1) < 0.3
    with pytest.raises(ehd.errors.StructureError, match="not a complete cylinder"):
        ehd.bore_from_faces(bore.coordinates, bore.cells[~slit], bore.family)


def test_extension_into_a_hole_is_linear_on_its_rim():
    angle = 2 * np.pi * np.arange(9) / 9
    polygon = 1e-3 * np.column_stack([2.0 + np.cos(angle), np.sin(angle)])
    middles = 0.5 * (polygon + np.roll(polygon, -1, axis=0))
    for points in (polygon, middles, polygon + 1e-19):
        weights = mean_value(polygon, points, 1.0)
        np.testing.assert_allclose(weights @ polygon, points, rtol=1e-12, atol=1e-15)
        assert np.sum(np.abs(weights) > 1e-9) == (18 if points is middles else 9)
