"""The housing: its mesh, its clamped foot, its reduction, and a shaft in it."""

import attrs
import numpy as np
import pytest
from foreign_parts import to_scipy
from mpi4py import MPI
from scene_cases import tables_of
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

import fenics_ehd as ehd
from fenics_ehd.multibody.trust import ENERGY_LIMIT
from fenics_ehd.reduction.structure import check_structure
from fenics_ehd.scenes.part import (
    elastic_part,
    reduce_structure,
    reduction_provenance,
    structure_provenance,
)
from fenics_ehd.scenes.part_settings import ReductionSettings
from fenics_ehd.scenes.scene import scene_of

HEIGHT, THICKNESS, FOOT = 0.060, 0.022, 0.104

#: Six modes of the held housing, nothing else.
LOWEST = ReductionSettings(method="m1", modes=6, estimate_error=False)

#: Two layers along, one through the ring: for what does not depend on the mesh.
COARSE = {"bore_cells_around": 10, "bore_cells_along": 2, "ring_layers": 1, "web_layers": 2}


def housing_settings(geometry=None, **changes):
    return attrs.evolve(
        ehd.read_scene("rotor-paper").bodies["housing"], geometry=geometry or {}, **changes
    )


def build_structure(settings, comm=MPI.COMM_SELF):
    return elastic_part(settings, "bodies.housing", "lagrange", comm).source


@pytest.fixture(scope="module")
def pressed_at_once(coarse):
    """Figures of a journal without mass in the housing, by the housing's damping time."""
    reduction = ReductionSettings(vibration_modes=4)
    made = reduce_structure(coarse, reduction)

    def run(damping_time):
        housing = attrs.asdict(
            housing_settings(COARSE, damping_time=damping_time, reduction=reduction)
        )
        changes = {"bodies.housing": housing | {"kind": "flexible"}, "bodies.ground": None}
        changes |= {f"joints.bearing.{key}": None for key in ("radius", "width")}
        changes |= {"joints.bearing.bore": "housing.bore", "joints.bearing.cells": [12, 2]}
        changes |= {"time.periodic": False, "time.revolutions": 0.1, "time.tolerance": 1e-3}
        changes |= {"time.periodicity": None, "time.cycles": None}
        force = {"kind": "constant", "point": "journal", "force": [500.0, 900.0]}
        scene = scene_of(tables_of("loaded-journal", changes | {"forces.load": force}), "pressed")
        built = ehd.build(scene, bodies={"housing": made})
        return ehd.simulate(built.mechanism, scene.span, **vars(built.steps)).figures["bearing"]

    return {zeta: run(zeta) for zeta in (0.0, 1e-8, 1e-5)}


@pytest.mark.slow
def test_a_journal_without_mass_needs_no_damping(pressed_at_once):
    """Its film presses at once on a bore that nothing holds back: there the run begins."""
    films = {zeta: own["min_film_thickness_m"] for zeta, own in pressed_at_once.items()}
    assert films[0.0] == pytest.approx(films[1e-8], rel=2e-3)
    assert films[0.0] == pytest.approx(films[1e-5], rel=1e-2)


@pytest.mark.slow
def test_the_ringing_of_a_start_is_no_error_of_the_basis(pressed_at_once):
    """It grew with one over the damping time: 31 um at 1e-8 s, of the same films."""
    errors = np.array([own["basis_error_estimate_m"] for own in pressed_at_once.values()])
    assert errors.max() < 5e-8


@pytest.fixture(scope="module")
def coarse():
    return build_structure(housing_settings(COARSE))


#: Lengths of the default housing, in metres.
LENGTHS = {
    "bore_radius": 0.0225, "bore_width": 0.022, "wall": 0.010, "centre_height": HEIGHT,
    "web_width": 0.080, "foot_width": FOOT, "foot_thickness": 0.012,
}  # fmt: skip


@pytest.mark.parametrize("diameter", [0.3, 0.5])
def test_a_housing_with_a_large_bore_is_similar_to_the_default(diameter, coarse, figure):
    # Of similar bodies of one material, stiffness is in the ratio of lengths, mass of its cube.
    factor = diameter / 0.045
    lengths = {name: factor * length for name, length in LENGTHS.items()}
    large = build_structure(housing_settings(lengths | COARSE))
    assert large.bore.radius == pytest.approx(0.5 * diameter)
    each = [reduce_structure(part, LOWEST) for part in (coarse, large)]
    small, scaled = (np.sqrt(eigh(b.stiffness, b.mass, eigvals_only=True)) for b in each)
    error = np.abs(factor * scaled / small - 1).max()
    name = f"frequencies of a similar housing with a bore of {diameter:g} m"
    figure("part and reduction", name, error, most=1e-8)


def held_dofs(part):
    """Degrees of freedom on the sole."""
    nodes = np.flatnonzero(np.abs(part.coordinates[:, 1] + HEIGHT) < 1e-9)
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def profile_area():
    """Of the default profile: ring, web and foot."""
    inner, outer = 0.0225, 0.0325
    angle = 0.3 * 2 * np.pi
    top, bottom = 2 * outer * np.sin(angle / 2), 0.080
    height = HEIGHT - 0.012 - outer * np.cos(angle / 2)
    segment = outer**2 / 2 * (angle - np.sin(angle))
    ring = np.pi * (outer**2 - inner**2)
    return ring + 0.5 * (top + bottom) * height - segment + FOOT * 0.012


def test_default_housing_has_the_papers_degrees_of_freedom(housing_structure):
    assert housing_structure.size == 8931
    bore = housing_structure.bore
    assert len(bore.nodes) == 340
    assert (bore.radius, bore.width) == pytest.approx((0.0225, THICKNESS))
    # A cell boundary at angle zero, where the film mesh starts.
    angle = np.arctan2(*bore.coordinates[bore.cells[:, :4]].transpose(2, 0, 1)[1::-1])
    assert np.any(np.abs(angle) < 1e-7)


def test_foot_is_held_and_the_mass_is_kept(housing_structure):
    assert not check_structure(housing_structure).free
    held = held_dofs(housing_structure)
    assert len(held) == 3 * ((2 * 8 + 1) * (2 * 5 + 1) - 8 * 5)
    stiffness, mass = to_scipy(housing_structure.stiffness), to_scipy(housing_structure.mass)
    for matrix in (stiffness, mass):
        coupled = matrix[held].tocoo()
        off = coupled.col != held[coupled.row]
        assert not coupled.data[off].any()
        assert np.all(coupled.data[~off] > 0)
    # 20 quadratic cells around miss 1e-5 of the circle.
    along = np.tile([1.0, 0.0, 0.0], housing_structure.size // 3)
    expected = 7850 * THICKNESS * profile_area()
    assert along @ mass @ along == pytest.approx(expected, rel=2e-5)


def test_held_modes_are_those_of_the_free_block_of_the_matrices(coarse, figure):
    body = reduce_structure(coarse, LOWEST)
    keep = np.setdiff1d(np.arange(coarse.size), held_dofs(coarse))
    stiffness, mass = (to_scipy(m)[keep][:, keep] for m in (coarse.stiffness, coarse.mass))
    values = eigsh(stiffness.tocsc(), 6, mass.tocsc(), sigma=0.0, return_eigenvectors=False)
    expected = np.sqrt(np.sort(values)) / (2 * np.pi)
    error = np.abs(body.frequencies / expected - 1).max()
    figure(
        "part and reduction",
        "held housing, SciPy on the free block of the matrices",
        error,
        most=1e-8,
    )
    assert body.frame == "clamped"


@pytest.mark.slow
def test_frequencies_converge_from_above():
    found = []
    for n in (1, 2, 3):
        geometry = {
            "bore_cells_around": 10 * n, "bore_cells_along": 2 * n, "ring_layers": n,
            "web_layers": 2 * n, "foot_layers": n, "foot_cells": n,
        }  # fmt: skip
        part = build_structure(housing_settings(geometry))
        found.append(reduce_structure(part, LOWEST).frequencies)
    fallen, falling = -np.diff(found, axis=0)
    # Refined once and once more: order 1 would be a ratio of 3. The corners between ring, web and
    # foot, where stresses are infinite, keep it from the elements' own.
    assert np.all(falling > 0)
    assert np.all(fallen > 4 * falling)
    default = reduce_structure(build_structure(housing_settings()), LOWEST).frequencies
    assert np.all((found[2] < default) & (default < found[1]))


@pytest.fixture(scope="module")
def quasi_static(coarse):
    return reduce_structure(coarse, ReductionSettings(method="m4", vibration_modes=4))


def test_a_housing_that_does_not_turn_has_no_centrifugal_mode(quasi_static):
    assert quasi_static.frame == "clamped"
    assert quasi_static.kinds == ("vibration",) * 4
    assert not quasi_static.missing_flexibility.size
    assert quasi_static.flexibility_error < 1e-3


@pytest.mark.slow
def test_housing_of_tetrahedra_is_the_same_part(figure):
    ours, reference = (
        reduce_structure(build_structure(housing_settings(cells=cells)), LOWEST)
        for cells in ("hex", "tet")
    )
    assert ours.inertia.total_mass == pytest.approx(reference.inertia.total_mass, rel=1e-4)
    difference = np.abs(reference.frequencies[:4] / ours.frequencies[:4] - 1).max()
    figure(
        "part and reduction",
        "four lowest frequencies of the housing, tetrahedra against hexahedra",
        difference,
        most=1e-2,
        unit="%",
    )


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ({"bore_cells_around": 15}, "multiple of 10"),
        ({"foot_cells": 1.5}, "1.5"),
        ({"centre_height": 0.04}, "raise centre_height"),
        ({"web_width": 0.11}, "foot_width = 0.104"),
        ({"wal": 0.01}, "'wal'"),
    ],
)
def test_geometry_that_cannot_be_is_named(geometry, message):
    with pytest.raises(ehd.errors.MeshError, match=message):
        ehd.build_mesh(ehd.model_path("housing"), geometry, comm=MPI.COMM_SELF)


def test_structure_without_a_foot_is_named(tmp_path):
    text = ehd.model_path("housing").read_text().replace('Physical Surface("foot", 3)', "x[]")
    (tmp_path / "loose.geo").write_text(text)
    with pytest.raises(ehd.errors.MeshError, match="'foot'"):
        build_structure(housing_settings(COARSE, model=str(tmp_path / "loose.geo")))


def test_provenance_names_what_the_body_depends_on():
    settings = housing_settings({"wall": 0.011}, reduction=ReductionSettings(method="m4"))
    found = structure_provenance(settings, ehd.model_path("housing"), "lagrange")
    found |= reduction_provenance(settings.reduction)
    assert found["geometry.wall"] == "0.011"
    assert found["flexibility_tolerance"] == "0.002"
    assert "modes" not in found


@pytest.mark.mpi
def test_held_housing_is_the_same_on_any_number_of_ranks(coarse):
    shared = build_structure(housing_settings(COARSE), MPI.COMM_WORLD)
    assert not check_structure(shared).free
    own, found = (reduce_structure(part, LOWEST) for part in (coarse, shared))
    np.testing.assert_allclose(found.frequencies, own.frequencies, rtol=1e-8)
    assert found.inertia.total_mass == pytest.approx(own.inertia.total_mass, rel=1e-12)


# --- A shaft in it


def part_of_a_turn(body):
    """Film of the paper's rotor in this housing, from rest."""
    scene = ehd.read_scene("rotor-paper", **{"time.revolutions": 0.1, "time.tolerance": 1e-4})
    built = ehd.build(scene, bodies={"housing": body})
    result = ehd.simulate(built.mechanism, **built.options)
    assert result.summary()["energy_balance_error"] < ENERGY_LIMIT
    return result.joints["bearing"]


@pytest.mark.slow
def test_quasi_static_bore_moves_as_the_full_interface(coarse, quasi_static):
    whole = reduce_structure(coarse, ReductionSettings(method="full", vibration_modes=4))
    found, expected = (part_of_a_turn(body) for body in (quasi_static, whole))
    assert found.max_pressure[-1] == pytest.approx(expected.max_pressure[-1], rel=0.01)
    assert found.min_film_thickness[-1] == pytest.approx(expected.min_film_thickness[-1], rel=0.01)
