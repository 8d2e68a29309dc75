"""Families of nodal pressures: what they hold, and the flexibility that follows from them."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from work_counts import differing

import fenics_ehd as ehd
from fenics_ehd.cli.run import budget_table
from fenics_ehd.film.grid import uniform_grid
from fenics_ehd.reduction.bore import BoreSurface
from fenics_ehd.reduction.family_responses import (
    FamilyResponses,
    flexibility_form,
    largest_error,
)
from fenics_ehd.reduction.pressure_family import (
    ORDERS,
    PressureFamily,
    edges_of,
    edges_text,
    missing_edges,
    short_bearing,
    stored_pressures,
    verification_pressures,
)
from fenics_ehd.reduction.residual_completion import pattern_fields
from fenics_ehd.reduction.static import bore_rows
from fenics_ehd.results.recorded_run import BODY_FILE
from fenics_ehd.scenes.build import build
from fenics_ehd.scenes.part import body_counts, elastic_part
from fenics_ehd.scenes.part_changes import require_provenance, with_body
from fenics_ehd.scenes.scene import changed

RADIUS = 0.02
WIDTH = 0.016

#: Geometry of a rod with few cells off its bore, which has all pressures of the default rod.
FEW_CELLS = {"big_end_layers": 1, "shank_cells": 4, "small_end_layers": 1}
INFINITE = float("inf")


def surface(around, along, family="lagrange"):
    """Bore whose pressure nodes are those of a grid."""
    grid = uniform_grid(RADIUS, WIDTH, (around, along), family)
    return BoreSurface(
        radius=RADIUS, width=WIDTH, coordinates=grid.nodes, pressure_coordinates=grid.nodes
    )


def scattered(count):
    """Bore whose pressure nodes form no grid, as those of tetrahedra."""
    rng = np.random.default_rng(1)
    angle = rng.uniform(0, 2 * np.pi, count)
    z = WIDTH * rng.uniform(-0.5, 0.5, count)
    nodes = np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), z])
    return BoreSurface(radius=RADIUS, width=WIDTH, coordinates=nodes, pressure_coordinates=nodes)


def polar(bore):
    """Angles [rad] and relative heights of the pressure nodes."""
    x, y, z = bore.pressure_coordinates.T
    return np.arctan2(y, x), 2 * z / bore.width


def remainder(pressures, columns):
    """Largest part of any pressure that columns do not contain, relative to the pressure."""
    rest = pressures - columns @ (columns.T @ pressures)
    return (np.linalg.norm(rest, axis=0) / np.linalg.norm(pressures, axis=0)).max()


# --- the family ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bore", "count"),
    [(surface(20, 5), 222), (surface(40, 10), 280), (surface(20, 5, "serendipity"), None),
     (scattered(500), None)],
    ids=("20 x 5", "40 x 10", "serendipity", "no grid"),
)  # fmt: skip
def test_columns_are_orthonormal_and_few(bore, count):
    base = PressureFamily({"bore": bore}).base
    np.testing.assert_allclose(base.T @ base, np.eye(base.shape[1]), atol=1e-12)
    assert base.shape[1] <= 0.7 * len(bore.pressure_coordinates)
    assert count is None or base.shape[1] == count


@pytest.mark.parametrize("cells", [(20, 5), (40, 10)])
def test_short_bearings_and_the_shortest_wave_of_the_mesh_are_in_the_base_family(cells):
    bore = surface(*cells)
    angle, zeta = polar(bore)
    base = PressureFamily({"bore": bore}).base
    parabola = 1 - zeta**2
    pressures = [parabola * short_bearing(angle, e, 0.3, 1) for e in (0.3, 0.9, 0.99)]
    pressures += [parabola * np.cos(m * angle) for m in (0, 7, cells[0])]
    pressures.append(np.ones(len(angle)))
    assert remainder(np.column_stack(pressures), base) < 1e-10


def test_levels_are_nested_and_the_last_one_is_every_pressure():
    family = PressureFamily({"bore": surface(40, 10)})
    levels = [family.up_to(level) for level in range(family.last + 1)]
    for former, level in pairwise(levels):
        np.testing.assert_array_equal(level[:, : former.shape[1]], former)
    assert [level.shape[1] for level in levels[:-1]] == [280, 489]
    np.testing.assert_allclose(levels[-1] @ levels[-1].T, np.eye(1680), atol=1e-12)


def test_a_family_that_would_have_most_pressures_has_all_of_them():
    bore = surface(20, 5)
    family = PressureFamily({"bore": bore}, {"bore": (-0.002, 0.002)})
    np.testing.assert_array_equal(family.base, np.eye(len(bore.pressure_coordinates)))


def test_functions_of_several_bores_act_in_one_of_them():
    bores = {"bore": surface(20, 5), "pin": surface(30, 6)}
    base = PressureFamily(bores).base
    k = len(bores["bore"].pressure_coordinates)
    assert (np.abs(base[:k]).max(axis=0) * np.abs(base[k:]).max(axis=0)).max() < 1e-12
    alone = [PressureFamily({name: bore}).base.shape[1] for name, bore in bores.items()]
    assert base.shape[1] == sum(alone)


def test_an_edge_adds_pressures_of_lands_and_of_grooves():
    """Parabolas on both lands of a groove, and its own pressure, smooth around."""
    bore = surface(40, 10)
    angle, _ = polar(bore)
    z = bore.pressure_coordinates[:, 2]
    groove = 0.1 * WIDTH
    wave = (1 + np.cos(angle)) ** 3
    knots = [-WIDTH / 2, -groove, groove, WIDTH / 2]
    lands = np.maximum(0, (np.abs(z) - groove) * (WIDTH / 2 - np.abs(z)))
    pressures = np.column_stack([wave * lands, wave * np.interp(z, knots, [0, 1, 1, 0])])
    edged = PressureFamily({"bore": bore}, {"bore": (-groove, groove)}).base
    assert remainder(pressures, edged) < 1e-10
    assert remainder(pressures, PressureFamily({"bore": bore}).base) > 0.05
    rough = PressureFamily({"bore": bore}, {"bore": (-INFINITE, INFINITE)}).base
    contact = np.exp(-(WIDTH / 2 - z) / (0.05 * WIDTH / 2)) * wave
    assert remainder(contact[:, None], rough) < 1e-10
    assert remainder(contact[:, None], edged) > 0.1


def test_holes_in_the_mesh_of_a_bore_are_edges(bore_with_a_hole):
    family = PressureFamily({"bore": bore_with_a_hole})
    low, high = family.every_edge("bore")
    assert low < high
    assert (low + high) / 2 == pytest.approx(0.0, abs=1e-3)


@pytest.fixture
def bore_with_a_hole(monkeypatch):
    """A bore with a hole of 4 mm in its middle, the rest of it whole."""
    hole = SimpleNamespace(height=0.0, diameter=4e-3)
    monkeypatch.setattr(
        "fenics_ehd.reduction.pressure_family.bore_holes", lambda *arguments: [hole]
    )
    return replace(surface(20, 5), cells=np.zeros((1, 9), dtype=int), family="lagrange")


def test_edges_survive_as_text():
    edges = {"pin": (0.001, -0.002, 0.001), "bore": (-INFINITE, INFINITE), "empty": ()}
    text = edges_text(edges)
    assert text == "bore -inf inf, pin -0.002 0.001"
    assert edges_of(text) == {"pin": (-0.002, 0.001), "bore": (-INFINITE, INFINITE)}
    assert edges_of(edges_text({})) == {}


def test_missing_edges_are_those_that_a_family_lacks():
    known = {"pressure_level": "0", "film_edges": "bore -0.002 0.002"}
    assert missing_edges(known, {"bore": (-0.002, 0.002)}) == {}
    assert missing_edges(known, {"bore": (0.002, 0.003)}) == {"bore": [0.003]}
    assert missing_edges(known, {"pin": (-INFINITE,)}) == {"pin": [-INFINITE]}
    assert missing_edges({}, {"bore": (0.1,)}) == {}  # of version 0.3
    assert missing_edges(known | {"pressure_level": str(len(ORDERS))}, {"bore": (0.1,)}) == {}


# --- verification -------------------------------------------------------------------------------


def test_sixteen_pressures_verify_and_edges_add_some():
    bore = surface(40, 10)
    plain = verification_pressures(bore, ())
    assert plain.shape == (1680, 16)
    assert plain.min() == 0.0
    assert 0.2 < plain.max(axis=0).min() <= plain.max() <= 1.2
    np.testing.assert_array_equal(plain, verification_pressures(bore, ()))
    assert verification_pressures(bore, (-INFINITE, -0.002, 0.002, INFINITE)).shape[1] == 20


def test_stored_pressures_are_smooth_and_even_along_the_bore():
    angle = np.linspace(0, 2 * np.pi, 200)
    table = stored_pressures(angle, np.zeros(200))
    np.testing.assert_allclose(table[0], table[-1])
    assert table.max() == pytest.approx(1.0)
    assert not stored_pressures(angle, np.ones(200)).any()
    halves = [stored_pressures(angle, np.full(200, zeta)) for zeta in (-0.4, 0.4)]
    np.testing.assert_array_equal(*halves)
    # A quarter of a turn of the mesh is no special place.
    at_nodes = stored_pressures(2 * np.pi * np.arange(80) / 80, np.full(80, 0.1))
    between = stored_pressures(2 * np.pi * (np.arange(80) + 0.5) / 80, np.full(80, 0.1))
    np.testing.assert_allclose(between, 0.5 * (at_nodes + np.roll(at_nodes, -1, axis=0)),
                               atol=1e-12)  # fmt: skip


# --- flexibility --------------------------------------------------------------------------------


def flexibility(size, rng):
    """A flexibility whose eigenvalues fall, and a family of pressures."""
    axes = np.linalg.qr(rng.standard_normal((size, size)))[0]
    return axes * 2.0 ** -np.arange(size) @ axes.T


@pytest.mark.parametrize("count", [1, 7, 20])
def test_the_form_is_exact_on_its_pressures_and_never_too_flexible(count):
    rng = np.random.default_rng(count)
    whole = flexibility(20, rng)
    pressures = np.linalg.qr(rng.standard_normal((20, count)))[0]
    form = flexibility_form(pressures, whole @ pressures, np.diag(whole).max())
    found = form.patterns * form.stiffness @ form.patterns.T
    np.testing.assert_allclose(found @ pressures, whole @ pressures, atol=1e-10)
    assert np.linalg.eigvalsh(whole - found).min() > -1e-10
    np.testing.assert_allclose(
        form.patterns.T @ form.patterns, np.eye(len(form.stiffness)), atol=1e-12
    )
    # Displacements are the same combinations of responses.
    displacement = whole @ pressures @ form.combinations @ form.patterns.T
    np.testing.assert_allclose(displacement, found, atol=1e-10)


def test_flexibility_that_nothing_lacks_has_no_form():
    pressures = np.eye(20)[:, :5]
    round_off = 1e-16 * np.random.default_rng(0).standard_normal((20, 5))
    assert not len(flexibility_form(pressures, round_off, 1.0).stiffness)


@pytest.fixture(scope="module")
def rod(rod_structure):
    """Reductor of the default rod."""
    return ehd.Reductor(rod_structure)


@pytest.fixture(scope="module")
def every(rod):
    """Reductor of the same rod that solves for every nodal pressure."""
    return ehd.Reductor(rod.structure, every_pressure=True)


@pytest.fixture(scope="module")
def exact(rod):
    """Responses of the rod to pressures of its verification, and random smooth ones."""
    return rod.family_responses(keep_columns=True).verification


@pytest.fixture(scope="module")
def bodies(rod):
    """M4 by its tolerance: the base family, and every nodal pressure."""
    return {tolerance: ehd.residual_flexibility(rod, 6, tolerance=tolerance)
            for tolerance in (2e-3, 0.0)}  # fmt: skip


def test_the_base_family_has_the_accuracy_that_is_stated(bodies, exact):
    few, all_of_them = bodies[2e-3], bodies[0.0]
    assert few.residual.rank == few.accuracy["flexibility_columns"] == 222
    assert few.provenance["pressure_level"] == "0"
    assert 1e-5 < few.flexibility_error < 3e-4
    assert few.flexibility_error == pytest.approx(largest_error(exact, few), rel=1e-3)
    assert all_of_them.flexibility_error < 1e-9
    assert all_of_them.accuracy["flexibility_columns"] == 440
    run = exact.some(slice(-4, None))  # of an elastic run
    assert largest_error(run, few) < 3e-5


def test_a_pressure_that_the_family_lacks_takes_more_orders(rod):
    base = ehd.residual_flexibility(rod, 6).flexibility_error
    tighter = ehd.residual_flexibility(rod, 6, tolerance=0.5 * base)
    assert int(tighter.provenance["pressure_level"]) == 1
    assert tighter.accuracy["flexibility_columns"] == 440  # most of them: then all
    assert tighter.flexibility_error <= 0.5 * base
    again = ehd.residual_flexibility(rod, 6)
    assert again.provenance["pressure_level"] == "0"
    assert again.flexibility_error == pytest.approx(base, rel=1e-6)


def test_patterns_are_never_stiffer_and_inertia_is_that_of_every_pressure(bodies, exact):
    few, whole = (bodies[tolerance].residual for tolerance in (2e-3, 0.0))
    energies = [r.patterns.T * r.stiffness @ r.patterns for r in (few, whole)]
    assert np.linalg.eigvalsh(energies[1] - energies[0]).min() > -1e-9 * whole.stiffness.max()
    amplitudes = [r.patterns @ exact.pressures for r in (few, whole)]
    inertias = [
        np.einsum("ic,ij,jc->c", a, r.mass, a)
        for a, r in zip(amplitudes, (few, whole), strict=True)
    ]
    np.testing.assert_allclose(*inertias, rtol=1e-3)


def test_fields_of_the_patterns_move_the_bore_as_the_body_does(rod, bodies):
    body = bodies[2e-3]
    basis = ehd.residual_flexibility(rod, 6, keep_basis=True).columns
    amplitudes = np.eye(body.residual.rank)[:, ::40] * 1e6
    fields = pattern_fields(rod.structure, body, basis, amplitudes)
    moved = body.residual.displacement @ amplitudes
    rows = bore_rows(rod.structure, fields)
    assert np.abs(rows - moved).max() < 1e-6 * np.abs(moved).max()


@pytest.mark.parametrize("reduced", ["m1", "m3", "rigid"])
def test_the_estimate_of_other_methods_is_exact_on_the_family(rod, every, exact, reduced):
    reductions = {
        "m1": lambda part: ehd.craig_bampton(part, 10),
        "m3": lambda part: ehd.load_dependent(part, 6, 10),
        "rigid": lambda part: ehd.reduction.rigid(part, estimate_error=True),
    }
    estimate, whole = (reductions[reduced](part).missing_flexibility for part in (rod, every))
    base = rod.family.base
    scale = np.abs(whole @ base).max()
    assert np.abs((estimate - whole) @ base).max() < 1e-7 * scale
    smooth = exact.pressures
    assert np.abs((estimate - whole) @ smooth).max() < 2e-3 * np.abs(whole @ smooth).max()


def test_solves_of_the_family_are_shared_by_all_reductions(rod, monkeypatch):
    rod.family_responses(keep_columns=True)
    monkeypatch.setattr(FamilyResponses, "__init__", None)
    ehd.load_dependent(rod, 6, 4)
    ehd.residual_flexibility(rod, 2)


def error_on_a_cylinder(bore, pressures, edges=(), level=0):
    """Largest relative error of displacements for a flexibility that falls with the distance."""
    nodes = bore.pressure_coordinates
    distance = np.linalg.norm(nodes[:, None] - nodes, axis=2)
    whole = np.exp(-distance / RADIUS)
    columns = PressureFamily({"bore": bore}, {"bore": edges}).up_to(level)
    form = flexibility_form(columns, whole @ columns, 1.0)
    found = form.patterns * form.stiffness @ (form.patterns.T @ pressures)
    expected = whole @ pressures
    return (np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)).max()


def test_errors_fall_with_the_level():
    """An eighth at least, of pressures that no level has."""
    bore = surface(40, 10)
    angle, zeta = polar(bore)
    sharp = np.exp(-(((angle - 0.3) / 0.15) ** 2) - ((zeta - 0.2) / 0.4) ** 2) * (1 - zeta**2)
    errors = [error_on_a_cylinder(bore, sharp[:, None], level=level) for level in (0, 1)]
    assert errors[1] < errors[0] / 8
    assert errors[0] < 1e-2


@pytest.mark.parametrize(
    ("edges", "numbers"),
    [((-0.0016, 0.0016), slice(12, 14)), ((-INFINITE, INFINITE), slice(12, 14))],
    ids=("groove", "contact"),
)
def test_edges_lower_the_error_of_pressures_with_edges(edges, numbers):
    """To a quarter at most, of the pressures with which they are verified."""
    bore = surface(40, 10)
    pressures = verification_pressures(bore, edges)[:, numbers]
    without, within = (error_on_a_cylinder(bore, pressures, e) for e in ((), edges))
    assert within < without / 4
    assert within < 1e-3


@pytest.mark.mpi
def test_two_ranks_find_the_flexibility_of_one():
    rod = ehd.read_scene("slider-crank-paper", **{"bodies.rod.geometry": FEW_CELLS}).bodies["rod"]
    alone, together = (
        ehd.residual_flexibility(
            elastic_part(rod, "rod", "lagrange", comm).source, 3, centrifugal=False
        )
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    assert together.provenance["pressure_level"] == alone.provenance["pressure_level"]
    assert together.flexibility_error == pytest.approx(alone.flexibility_error, rel=1e-4)
    found, expected = (body.basis_flexibility() for body in (together, alone))
    assert np.abs(found - expected).max() < 1e-10 * np.abs(expected).max()
    masses = [np.linalg.eigvalsh(body.residual.mass)[-5:] for body in (together, alone)]
    np.testing.assert_allclose(*masses, rtol=1e-6)
    assert not differing(body_counts(together), body_counts(alone))


# --- in scenes ----------------------------------------------------------------------------------

GROOVE = {"kind": "circumferential-groove", "width": 3e-3, "pressure": 2e5}


def with_supply(**supply):
    return ehd.read_scene(
        "slider-crank-paper",
        **{"joints.big_end.cells": [40, 10], "joints.big_end.supply": {"feed": supply}},
    )


def test_a_scene_passes_the_edges_of_its_films_along_z_alone():
    assert ehd.read_scene("slider-crank-paper").film_edges("rod") == {}
    assert with_supply(**GROOVE).film_edges("rod") == {"bore": (-1.5e-3, 1.5e-3)}
    pocket = {"kind": "axial-groove", "length": 8e-3, "extent": 20.0, "pressure": 2e5}
    pockets = [with_supply(**pocket, angle=angle).film_edges("rod") for angle in (0.0, 70.0)]
    assert pockets[0] == pockets[1] == {"bore": (-4e-3, 4e-3)}
    hole = {"kind": "hole", "diameter": 4e-3, "height": 1e-3, "pressure": 2e5}
    assert with_supply(**hole).film_edges("rod")["bore"] == pytest.approx((-1e-3, 3e-3))
    rough = ehd.read_scene("slider-crank-paper", **{"joints.big_end.contact.bore_roughness": 5e-7})
    assert rough.film_edges("rod") == {"bore": (-INFINITE, INFINITE)}


def short(**values):
    """Scene of the rod with M4 for a few steps."""
    return ehd.read_scene(
        "slider-crank-paper",
        **{"bodies.rod.reduction.method": "m4", "time.revolutions": 0.002, "time.tolerance": 1e-3,
           "output.part_mesh_error": False, "output.plots": False, **values},
    )  # fmt: skip


def test_a_body_whose_family_lacks_edges_is_named(bodies, tmp_path):
    ehd.save_body(bodies[2e-3], tmp_path / "rod.h5")
    scene = with_body(short(), str(tmp_path / "rod.h5"), {})
    contact = {"joints.big_end.contact.bore_roughness": 5e-7}
    groove = {"joints.big_end.supply": {"feed": GROOVE}, "joints.big_end.cells": [40, 10]}
    for change, words in (
        ({}, ()),
        (contact, ("bodies.rod", "contact at its ends")),
        (contact | groove, ("edges at z = -1.5, 1.5 mm and contact at its ends in bore",)),
    ):
        lines = build(changed(scene, change)).warnings
        assert len(lines) == bool(words)
        assert all(word in lines[0] for word in words)


def test_pressures_of_a_run_are_checked_if_the_part_is_at_hand(tmp_path):
    """They are smooth: their error is less than the verified one, and the budget has it."""
    coarse = {"bodies.rod.geometry": FEW_CELLS}
    history = ehd.run(short(**coarse), tmp_path / "run")
    body = ehd.load_body(tmp_path / "run" / BODY_FILE.format("rod"))
    checked = history.entries["flexibility_errors"]["rod"]
    assert 0 < checked < body.flexibility_error
    verified = {"rod": pytest.approx(body.flexibility_error)}
    assert history.entries["verified_flexibility_errors"] == verified
    line = budget_table(history.entries["joints"], history.entries)[-1]
    assert line.endswith("checked with pressures of this run")
    entries = history.entries | {"flexibility_errors": {}}  # as of a kept body
    line = budget_table(history.entries["joints"], entries)[-1]
    assert "verified at its reduction" in line
    assert "pressures of this run were not checked" in line
    exact = coarse | {"bodies.rod.reduction.flexibility_tolerance": 0.0}
    again = ehd.run(short(**exact), tmp_path / "exact")
    assert again.entries["flexibility_errors"] == {}
    assert again.entries["verified_flexibility_errors"] == {}
    basis = [
        h.entries["joints"]["big_end"]["error_budget"]["max_pressure"]["basis"]
        for h in (again, history)
    ]
    assert 0 <= basis[0] < basis[1] < 1e-3


def test_a_body_of_version_0_3_is_accepted_for_any_tolerance(bodies):
    asked = {"model": "conrod.geo", "method": "m4", "flexibility_tolerance": "0.002"}
    former = {"model": "conrod.geo", "method": "m4", "residual_truncation": "0.0001"}
    body = replace(bodies[2e-3], provenance=former)
    require_provenance(body, asked, set(asked), "bodies.rod")
    with pytest.raises(ehd.errors.SettingsError, match="made with method = m4, but"):
        require_provenance(body, asked | {"method": "m3"}, set(asked), "bodies.rod")
