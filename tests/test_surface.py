"""Surfaces of a film: a lopsided compliance at rest in the bore and turning with the journal."""

import re
from collections import deque
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from attrs import evolve
from film_cases import oval
from given_surface import Bearing, GivenBody, stiffness
from journal_cases import ETA, OMEGA, UNIT_LOAD, C, R, make_film
from moving_point import assert_derivatives
from rough_cases import surfaces
from test_conserved_oil import assert_oil_derivatives
from test_coupled_steps import assert_derivatives as assert_contact_derivatives

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.trust import NOT_ESTIMATED
from fenics_ehd.results.motion import RecordedMotion
from fenics_ehd.results.paraview import write_run
from fenics_ehd.results.recorded_run import continue_from, load_run_state, save_run_state

pytestmark = pytest.mark.kernels

#: Mean compliance that moves the surface by a third of the clearance at the bearing's pressures.
MEAN = 0.3 * C / (UNIT_LOAD / (4 * R * R))


def swinging(film=None, *, angle=0.3, **joint):
    """A heavy elastic journal, not round either, that turns in a ring that turns too."""
    film = film or make_film((12, 3))
    given = stiffness(R, 2 * R, MEAN)
    return ehd.Mechanism(
        {
            "shaft": GivenBody(given, mass=2.0, inertia=1e-3, speed=OMEGA, angle=np.degrees(angle)),
            "ring": ehd.RigidBody(1.0, 2e-3, speed=-40.0, angle=np.degrees(-0.2)),
        },
        {
            "pivot": ehd.Revolute(("ground", "ring")),
            "bearing": ehd.LubricatedJoint("shaft", "ring", film, **joint),
        },
        forces={"load": ehd.PointForce("shaft", (0.3, -1.0), lambda _: (0.1 * UNIT_LOAD, 0.0))},
    )


# --- Equations of a step


@pytest.mark.parametrize("shift", [1e3, 1e5])
@pytest.mark.parametrize("shape", [None, oval(2e-6, 0.3)])
def test_derivatives_of_a_step_are_exact(shift, shape):
    assert_derivatives(System(swinging(journal_shape=shape)), shift, 1e-2, 1e-7)


#: Groove in the journal.
INLET = ehd.AxialGrooveSupply(
    name="inlet", on="journal", angle=17.0, extent=34.0, length=2 * R / 3, pressure=4e5
)


def film_with(family="lagrange", **parameters):
    """Film with further parameters."""
    grid = ehd.uniform_grid(R, 2 * R, (12, 3), family)
    return ehd.Film(ehd.FilmParameters(grid, C, ehd.Lubricant(ETA), OMEGA, **parameters))


def test_derivatives_with_contact_are_exact():
    film = film_with(surfaces=surfaces(C / 2, modulus=1e13))
    mechanism = swinging(film, journal_shape=oval(2e-6, 0.3))
    point = assert_contact_derivatives(mechanism, 1e-6)
    assert point.films[0].contact.pressure.max() > 1e6


def test_derivatives_with_a_supply_that_turns_are_exact():
    film = film_with(feeds=(INLET,))
    assert_contact_derivatives(swinging(film, journal_shape=oval(2e-6, 0.3)))


@pytest.mark.parametrize("rough", [None, surfaces(C / 2, modulus=1e13)])
def test_derivatives_with_mass_conserving_cavitation_are_exact(rough, monkeypatch):
    film = film_with("bilinear", surfaces=rough)
    joint = {"journal_shape": oval(2e-6, 0.3), "cavitation": "mass-conserving"}
    assert_oil_derivatives(swinging(film, **joint), monkeypatch)


def moving(system, seed=0):
    """Coordinates and rates of a system in motion, and pressures at the nodes of its film."""
    rng = np.random.default_rng(seed)
    z = 1e-6 * rng.uniform(-1, 1, system.n)
    rates = 1e-2 * rng.uniform(-1, 1, system.n)
    (binding,) = system.films
    z[binding.turning] = [0.7, -0.2]
    rates[binding.turning] = [OMEGA, -40.0]
    return z, rates, rng.uniform(0.0, 1e7, binding.film.load.shape[1])


def test_the_power_of_all_forces_is_that_of_the_opening_gap():
    system = System(swinging(journal_shape=oval(2e-6, 0.3)))
    (binding,) = system.films
    z, rates, pressure = moving(system)
    gap = binding.gap(z, rates, 0.0)
    expected = pressure @ (binding.film.film.pressure_areas.T @ gap.thickness_rate.ravel())
    rows = binding.turning_rows(z, rates)
    forces = np.zeros(system.n)
    forces[binding.xi] += binding.film.load @ pressure
    forces[binding.turning_dofs] += (rows.load @ pressure) @ binding.turning_map
    assert forces @ rates == pytest.approx(expected, rel=1e-12)


def test_the_torque_on_a_journal_is_the_slope_of_the_energy_of_contact():
    """Asperities are a spring: their torque is the loss of their energy by rotation."""
    film = film_with(surfaces=surfaces(C / 2, modulus=1e13))
    joint = {"journal_shape": oval(2e-6, 0.3), "eccentricity": (0.6 * C, 0.3 * C)}
    run = Run(swinging(film, **joint), IntegratorOptions(), 1e-3)
    step = next(run.until(1e-3))
    (joint,) = step.solution.joints

    def energy(turn):
        x = step.x.copy()
        x[joint.binding.turning[0]] += turn
        gap = joint.binding.gap(x, step.rate, step.time)
        return joint.contact.area @ joint.contact.at_gap(gap.thickness).potential

    of_oil = replace(joint, contact=None).braking
    friction = joint.contact.friction_torque(joint.touch, joint.state.gap)
    expected = (energy(1e-5) - energy(-1e-5)) / 2e-5
    assert abs(expected) > 1e-3 * abs(of_oil)
    found = joint.braking - of_oil - friction
    assert found == pytest.approx(expected, rel=1e-5)


def test_rows_of_a_turning_surface_are_derivatives_of_its_gap():
    system = System(swinging(journal_shape=oval(2e-6, 0.3)))
    (binding,) = system.films
    z, rates, _ = moving(system)
    rows = binding.turning_rows(z, rates)
    for column, h in ((0, 1e-9), (3, 1e-9), (-1, 1e-6)):
        change = np.zeros(system.n)
        dof = binding.turning_dofs[: len(rows.load)][column]
        change[dof] = h
        before, after = (binding.gap(z + s * change, rates, 0.0) for s in (-1, 1))
        slope = (after.thickness - before.thickness).ravel() / (2 * h)
        rate = (after.thickness_rate - before.thickness_rate).ravel() / (2 * h)
        for exact, difference in ((rows.gap, slope), (rows.gap_rate, rate)):
            scale = np.abs(exact).max()
            np.testing.assert_allclose(exact[:, column], difference, atol=1e-6 * scale)


def test_the_norm_knows_the_gap_of_the_equations():
    run = Run(swinging(journal_shape=oval(2e-6, 0.3)), IntegratorOptions(tolerance=1e-3), 1e-3)
    *_, last = run.until(1e-4)
    (film,) = last.solution.films
    (gap,) = run.norm.film_gaps(last.observed)
    inside = film.gap.thickness.size
    np.testing.assert_allclose(gap[:inside], film.gap.thickness.ravel(), rtol=1e-4)


# --- Residual patterns


def squeezed(bore, journal):
    """A shaft pressed into a housing without turning, on patterns of two stiffnesses or none."""
    none = np.zeros((0, 0))
    film = make_film((12, 3))
    shaft = GivenBody(none, mass=2.0, inertia=1e-3, stiffness_of_patterns=journal, still=True)
    return ehd.Mechanism(
        {"shaft": shaft, "housing": GivenBody(none, held=True, stiffness_of_patterns=bore)},
        {"bearing": ehd.LubricatedJoint("shaft", "housing", film)},
        {"shaft": ehd.Speed(0.0)},
        {"load": ehd.PointForce("shaft", (1.0, 0.3), lambda _: (0.3 * UNIT_LOAD, 0.0))},
    )


def test_two_surfaces_with_patterns_bend_as_one_that_is_twice_as_soft():
    given = stiffness(R, 2 * R, MEAN)
    rigid, one, both = (
        ehd.simulate(squeezed(*patterns), 1e-4, tolerance=1e-3)
        for patterns in ((None, None), (given, None), (2 * given, 2 * given))
    )
    offset = [run.joints["bearing"].eccentricity_x[-1] for run in (rigid, one)]
    assert offset[1] > 2 * offset[0]
    for name in ("min_film_thickness", "max_pressure", "eccentricity_x"):
        expected = getattr(one.joints["bearing"], name)
        np.testing.assert_allclose(getattr(both.joints["bearing"], name), expected, rtol=1e-9)
    assert both.summary()["newton_iterations"] == one.summary()["newton_iterations"]


def test_derivatives_with_patterns_of_both_surfaces_are_exact():
    given = stiffness(R, 2 * R, MEAN)
    assert_contact_derivatives(squeezed(given, 2 * given))


def test_patterns_of_a_journal_that_turns_are_refused():
    given = stiffness(R, 2 * R, MEAN)
    mechanism = swinging()
    shaft = GivenBody(given, mass=2.0, inertia=1e-3, stiffness_of_patterns=given)
    mechanism = replace(mechanism, bodies={**mechanism.bodies, "shaft": shaft})
    expected = r"joints.bearing.journal = 'shaft': residual patterns .* of a journal that turns"
    with pytest.raises(ehd.errors.SettingsError, match=expected):
        ehd.simulate(mechanism, 1e-3)


def test_patterns_that_face_each_other_must_have_one_damping():
    mechanism = squeezed(*[stiffness(R, 2 * R, MEAN)] * 2)
    housing = evolve(mechanism.bodies["housing"], damping_time=2e-4)
    mechanism = replace(mechanism, bodies={**mechanism.bodies, "housing": housing})
    expected = r"different damping_time \(housing: 0.0002 s, shaft: 0.0001 s\)"
    with pytest.raises(ehd.errors.SettingsError, match=expected):
        ehd.simulate(mechanism, 1e-3)


# --- In motion

#: So that c / R, by which the two frames differ, is below the errors of the meshes.
NARROW = 0.05 * C


def ends(cells, turns, tolerance):
    """Least film over clearance, and peak pressure, of both bearings at the end, shape (2, 2)."""
    film = make_film(cells, clearance=NARROW)
    load = 0.2 * UNIT_LOAD * (C / NARROW) ** 2
    bearing = Bearing(film, 0.3 * NARROW / (load / (4 * R * R)), OMEGA, load)
    rows = []
    for mechanism in (bearing.at_rest, bearing.turning):
        end = turns * 2 * np.pi / OMEGA
        start = (0.3 * NARROW, 0.0)
        result = ehd.simulate(
            mechanism(start), end, tolerance=tolerance, order=2, first=1e-7
        ).joints["bearing"]
        rows.append([result.min_film_thickness[-1] / NARROW, result.max_pressure[-1]])
    return np.array(rows)


def test_a_journal_that_turns_bends_as_a_bore_at_rest(figure):
    # After a quarter of a turn the nodes of one film lie at nodes of the other.
    at_rest, turning = ends((12, 2), 0.25, 1e-4)
    error = np.abs(turning / at_rest - 1.0).max()
    figure("shapes", "elastic journal that turns against bore at rest", error, most=1e-3)


@pytest.mark.slow
def test_both_agree_to_the_second_order_of_the_mesh(figure):
    errors = []
    for cells in ((12, 2), (24, 4)):
        at_rest, turning = ends(cells, 0.27, 1e-5)
        errors.append(np.abs(turning / at_rest - 1.0))
    coarse, fine = np.array(errors)
    figure("shapes", "elastic journal that turns, film and peak", fine.max(), most=3e-3)
    assert np.all(np.log2(coarse / fine) > 1.8)


def test_energy_balance_closes_with_the_tolerance():
    loose, tight = (
        ehd.simulate(swinging(), 2e-3, tolerance=t, order=2).summary()["energy_balance_error"]
        for t in (1e-3, 1e-5)
    )
    assert tight < 0.3 * loose
    assert loose < 2e-2


# --- Records


def test_a_resumed_run_with_a_journal_that_turns_is_the_same_to_the_last_bit(tmp_path):
    def recorder():
        mechanism = swinging(journal_shape=oval(2e-6, 0.3))
        return Recorder(Run(mechanism, IntegratorOptions(), 1e-3), 1e-3)

    complete, stopped, resumed = (recorder() for _ in range(3))
    deque(islice(complete.steps(), 12), maxlen=0)
    deque(islice(stopped.steps(), 5), maxlen=0)
    began = {"about": {"reduction_time_s": 0.0, "scene": "case"}, "digests": {}}
    save_run_state(stopped, tmp_path, began)
    continue_from(load_run_state(tmp_path), resumed, tmp_path)
    deque(islice(resumed.steps(), 7), maxlen=0)
    for found, expected in zip(resumed.rows, complete.rows, strict=True):
        assert found["run/step_s"] == expected["run/step_s"]
        np.testing.assert_array_equal(found["state/coordinates"], expected["state/coordinates"])
        np.testing.assert_array_equal(found["state/rates"], expected["state/rates"])


def test_budget_and_pictures_of_a_journal_that_turns(tmp_path):
    mechanism = swinging(journal_shape=oval(2e-6, 0.3))
    history = ehd.simulate(mechanism, 1e-5, tolerance=1e-2)
    errors = ehd.error_budget(history).joints["bearing"]["max_pressure"]
    assert 0.0 < errors["step_size"] < 0.1
    assert 0.0 < errors["film_mesh"] < 0.1
    assert errors["basis"] == errors["part_mesh"] == NOT_ESTIMATED
    gaps = RecordedMotion(mechanism, history).gaps["bearing"]
    np.testing.assert_allclose(gaps, history.joints["bearing"].film.gap, rtol=1e-12)
    assert write_run(mechanism, history, {}, tmp_path, 2).is_file()


# --- The seam

#: Rooms whose modules get surfaces from bodies, and modules that may know the kinds of surfaces:
#: surfaces are defined or made there, or notices compare a body with its reduced part.
ROOMS = ("multibody", "analysis", "results", "plotting", "scenes")
KNOWING = ("multibody/surface", "multibody/elastic_bore", "multibody/body", "multibody/notices")

#: Questions which side of a film is elastic.
ASKING = re.compile(
    r"\bElasticBore\b|\bBoreFilm\b|\.bore_body\b|\bfilm\.bore\b|\bbinding\.bore\b"
    r"|\belastic_bore\(|isinstance\(.*\bFlexibleBody\b|surfaces\[\d\]\.(surface\.)?elastic"
)


def test_nothing_outside_asks_which_side_is_elastic():
    package = Path(ehd.__file__).parent
    files = [file for room in ROOMS for file in sorted((package / room).glob("*.py"))]
    asked = [
        f"{file.name}:{number}: {line.strip()}"
        for file in files
        if str(file.relative_to(package).with_suffix("")) not in KNOWING
        for number, line in enumerate(file.read_text().splitlines(), 1)
        if ASKING.search(line) and not line.startswith("from ") and "`" not in line
    ]
    assert len(files) > 50
    assert not asked
