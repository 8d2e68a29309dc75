"""What a run says of its own errors, beside what they are."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import call
from hand_made_rod import driven
from mechanism_cases import rigid_rod, slider_crank
from scene_cases import LOADED_JOURNAL, write_scene

from fenics_ehd.cli.error_budget import beside, budget_table
from fenics_ehd.film import Film, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.multibody.bdf import IntegratorState
from fenics_ehd.multibody.beside import LONGEST, Beside
from fenics_ehd.multibody.between_nodes import BetweenNodes
from fenics_ehd.multibody.course import Course, course_of
from fenics_ehd.multibody.disturbance import Disturbance
from fenics_ehd.multibody.error_budget import judged
from fenics_ehd.multibody.error_curves import Change, ErrorCurves
from fenics_ehd.multibody.error_shares import (
    COMPONENTS,
    NOT_APPLICABLE,
    NOT_ESTIMATED,
    QUANTITIES,
    Extreme,
    summed,
)
from fenics_ehd.multibody.forces import RotatingForce
from fenics_ehd.multibody.joints import Speed
from fenics_ehd.multibody.lubricated_joint import ConservedContent, LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.other_films import finer_grid, on_finer_films, with_finer_films
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.recorder import gathered
from fenics_ehd.multibody.rigid_body import RigidBody
from fenics_ehd.multibody.run import Run, Steps
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.step_solver import CoupledSteps
from fenics_ehd.multibody.system import System
from fenics_ehd.multibody.tracking import Tracker

#: Largest true error over the estimate, and least.
WITHIN = 2.0

#: Of the slider-crank [s].
END = 6e-3


def film(cells, clearance=17e-6, family="lagrange"):
    grid = uniform_grid(0.0225, 0.022, cells, family)
    return Film(FilmParameters(grid, clearance, Lubricant(0.01), 500.0))


def machine(cells, clearance=17e-6, family="lagrange", **joint):
    return slider_crank(rigid_rod(), film(cells, clearance, family), **joint)


def followed(mechanism, tolerance, end=END):
    """A run, its beginning, its course, and what it has shown."""
    run = Run(mechanism, Steps(tolerance=tolerance), end)
    tracker, began = Tracker(run.equations, run.norm), run.state
    rows, fields = zip(*map(tracker.add, run.until(end)), strict=True)
    return run, began, course_of(run.equations.system, gathered(rows), gathered(fields)), tracker


def grids(run):
    return [place.film.film.parameters.grid for place in run.equations.system.films]


@pytest.fixture(scope="module")
def coarse_run():
    return followed(machine((12, 3)), 1e-3)


def test_along_its_own_steps_a_run_is_met_again(coarse_run):
    run, began, course, _ = coarse_run
    again = Beside(run.solve, run.control, grids(run)).follow(began, course, 1)
    np.testing.assert_array_equal(again.times, course.times)
    late = course.times > 1e-4
    np.testing.assert_allclose(again.films[late], course.films[late], rtol=1e-3)
    np.testing.assert_allclose(again.peaks[late], course.peaks[late], rtol=2e-3)


def test_longer_steps_end_where_the_run_ends_and_grow_no_faster(coarse_run):
    run, began, course, _ = coarse_run
    again = Beside(run.solve, run.control, grids(run)).follow(began, course, 3)
    assert again.times[-1] == course.times[-1]
    assert np.isin(again.times, course.times).all()
    sizes = np.diff(again.times, prepend=0.0)
    assert (sizes[1:] / sizes[:-1] <= LONGEST).all()
    assert len(course.times) / 3 < len(again.times) < 0.6 * len(course.times)


def test_a_given_gap_acts_as_a_clearance_does(coarse_run):
    run, began, course, _ = coarse_run
    wider, more = CoupledSteps(System(machine((12, 3), 17.1e-6))), 0.1e-6
    other = Beside(wider, run.control, grids(run)).follow(began, course, 2)
    observed = np.full((len(course.times), len(run.equations.system.films[0].film.observed)), more)
    points = [len(run.equations.system.films[0].film.thickness)]
    given = Disturbance(course.times, [observed], points)
    beside = Beside(run.solve, run.control, grids(run))
    found = beside.follow(began, course, 2, given)
    plain = beside.follow(began, course, 2)
    late = found.times > 1e-4
    effect = np.abs(plain.films[late] / other.films[late] - 1.0).max()
    assert effect > 3e-3
    # The clearance is also in the shaft's radius.
    assert np.abs(found.films[late] / other.films[late] - 1.0).max() < 0.02 * effect
    assert np.abs(found.peaks[late] / other.peaks[late] - 1.0).max() < 0.02 * effect


@pytest.mark.parametrize(
    ("cells", "finer"), [((20, 5), (30, 8)), ((24, 4), (36, 6)), ((7, 1), (11, 2))]
)
def test_finer_films_are_graded_alike(cells, finer):
    grid = uniform_grid(0.02, 0.01, cells, "lagrange")
    graded = replace(grid, heights=0.005 * np.linspace(-1.0, 1.0, cells[1] + 1) ** 3)
    found = finer_grid(graded)
    assert found.cells == finer
    assert found.heights[[0, -1]] == pytest.approx(graded.heights[[0, -1]])
    uniform = finer_grid(grid)
    np.testing.assert_allclose(np.diff(uniform.heights), 0.01 / finer[1])
    np.testing.assert_allclose(np.diff(uniform.angles), 2 * np.pi / finer[0])


def test_a_finer_film_holds_the_same_share_of_oil():
    mechanism = machine((24, 6), family="bilinear", oil=ConservedContent(0.6))
    run = Run(mechanism, Steps(tolerance=1e-2), 2e-4)
    for _ in run.until(2e-4):
        pass
    finer = CoupledSteps(System(with_finer_films(mechanism)))
    state = on_finer_films(IntegratorState(**run.state.points()), run.solve, finer)
    contents = []
    for solve, point in ((run.solve, run.state.x[0]), (finer, state.x[0])):
        norm = StepNorm(solve.equations)
        contents += solve.equations.contents(point, norm.film_gaps(norm.observe(point)))
    assert contents[1] == pytest.approx(contents[0], rel=0.02)


@pytest.mark.parametrize(
    ("changes", "known", "total", "said"),
    [
        ({}, 0.28, 0.28, "+- 28 %, too high by about 13 MPa, "),
        ({"part_mesh": NOT_APPLICABLE}, 0.25, 0.25, "+- 25 %, too high by about 13 MPa, "),
        ({"part_mesh": NOT_ESTIMATED}, 0.25, None, "+- 25 %, part mesh not included, "),
        ({"basis": 0.02, "bias": -0.02}, 0.1, 0.1, "+- 10 % "),
        (dict.fromkeys(COMPONENTS, NOT_ESTIMATED), None, None, "+- not estimated "),
    ],
)
def test_the_total_is_the_sum_and_none_where_a_component_is_missing(changes, known, total, said):
    errors = dict(zip(COMPONENTS, (0.2, 0.02, 0.03, 0.02, 0.01), strict=True))
    found = summed(errors | {"bias": 0.28} | changes)
    assert found["known"] == (NOT_ESTIMATED if known is None else pytest.approx(known))
    assert found["total"] == (NOT_ESTIMATED if total is None else pytest.approx(total))
    assert beside({"error_budget": {"max_pressure": found}}, "max_pressure", 46.3, "MPa") == said


@pytest.mark.parametrize("family", ["lagrange", "serendipity", "bilinear"])
def test_a_peak_between_nodes_is_met_as_it_passes_them(family):
    """The largest nodal value is off by the square of the mesh size, this by more."""
    centres, nodes, between = np.linspace(0.0, 7.0, 200)[:, None], [], []
    for cells in ((24, 4), (48, 8)):
        grid = uniform_grid(0.02, 0.01, cells, family)
        angle, height = grid.node_positions.T
        values = np.exp(np.cos(angle - centres)) - ((height - 1e-3) / 0.01) ** 2
        nodes.append(np.abs(values.max(axis=1) - np.e).max())
        between.append(np.abs(BetweenNodes(grid).largest(values) - np.e).max())
        np.testing.assert_allclose(BetweenNodes(grid).least(-values), -np.e, rtol=2e-3)
    assert np.log2(nodes[0] / nodes[1]) < 2.6
    assert np.log2(between[0] / between[1]) > 3.0
    assert between[0] < 0.1 * nodes[0]


def test_at_the_end_of_a_row_a_film_is_as_its_node_says():
    grid = uniform_grid(0.02, 0.01, (24, 4))
    angle, height = grid.node_positions.T
    assert BetweenNodes(grid).largest((height + 0.0 * angle)[None])[0] == pytest.approx(0.005)


def curves(times, peaks, films, sampled=None):
    none = np.zeros((0, 0))
    columns = peaks[:, None], films[:, None]
    return Course(times, none, [], {}, *columns, none, none, sampled or columns)


def test_extremes_move_by_what_lies_between_long_steps():
    """A parabola's vertex moves by what the curve changes there, wherever the steps are."""

    def at(times, rise, delay):
        curve = 10.0 + rise - (times - 1.03 - delay) ** 2
        return curves(times, curve, 20.0 - curve)

    short, long = np.linspace(0.0, 2.0, 41), np.linspace(0.0, 2.0, 11)
    run = at(short, 0.0, 0.0)
    sampled = run.peaks - 0.05, run.films + 0.05
    own = ErrorCurves(curves(short, run.peaks[:, 0], run.films[:, 0], sampled), -0.05)
    change = own.change(run, at(long, -0.3, 0.1), -0.1)
    peak, film = Extreme("max_pressure", 0, 9.95), Extreme("min_film_thickness", 0, 10.05)
    # The step before the vertex and that behind it change it differently, the vertex by 0.03.
    assert peak.bias([change]) == pytest.approx(-0.03 / 9.95, rel=0.05)
    assert film.bias([change]) == pytest.approx(0.03 / 10.05, rel=0.05)
    # What nodes miss is missed as well.
    assert peak.bias([change, own.sampling]) == pytest.approx(-0.08 / 9.95, rel=0.05)
    assert peak.over(own.sampling) == pytest.approx(0.05 / 9.95, rel=0.02)


def test_what_cancels_is_not_relied_on():
    times = np.linspace(0.0, 1.0, 51)
    value = 10.0 - (times[:, None] - 0.5) ** 2
    more = np.where(np.abs(times[:, None] - 0.5) < 0.05, 0.0, -0.1)
    change = Change(times, value, value, more, more)
    extreme = Extreme("max_pressure", 0, 10.0)
    assert extreme.bias([change]) == 0.0
    assert extreme.near(change) == pytest.approx(0.01, rel=0.1)
    assert extreme.share(change) == pytest.approx(0.5 * extreme.near(change))


@pytest.mark.parametrize("contraction", [0.5, -0.75])
def test_a_cycle_is_judged_by_what_is_different_the_second_time(contraction):
    period = 1.0
    times = np.linspace(0.0, 2.0, 81)[1:]
    base = 10.0 + np.cos(2 * np.pi * times)
    grown = base + 0.1 * (1.0 - contraction ** np.ceil(times - 1e-9))
    run, other = (curves(times, own, own) for own in (base, grown))
    first = times <= 1.0 + 1e-9
    course = curves(times[first], base[first], base[first])
    found = ErrorCurves(course, 0.0, period).change(run, other, 1.0, contraction)
    np.testing.assert_allclose(found.more_pressure[15:-5], 0.1, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["lagrange", "bilinear"])
def test_estimates_of_a_rigid_rod_are_the_errors(family, figure):
    cells = {"lagrange": (16, 4), "bilinear": (32, 8)}[family]
    run = Run(machine(cells, family=family), Steps(tolerance=1e-3), END)
    tracker, budget = judged(run, END)
    exact = followed(machine(cells, family=family), 1e-5)[3]
    finer = followed(machine((3 * cells[0], 3 * cells[1]), family=family), 1e-5)[3]
    found = {}
    for quantity in QUANTITIES:
        own, steps, mesh = (
            getattr(each.extremes["big_end"], quantity) for each in (tracker, exact, finer)
        )
        estimates = budget.joints["big_end"][quantity]
        assert set(estimates) == {*COMPONENTS, "between_nodes", "known", "total", "bias"}
        assert estimates["basis"] == NOT_APPLICABLE
        assert estimates["start"] == NOT_APPLICABLE
        # A mesh three times as fine leaves a ninth of an error of order two.
        found[quantity] = (
            abs(own - steps) / own / estimates["step_size"],
            9 / 8 * abs(steps - mesh) / own / estimates["film_mesh"],
            abs(own - mesh) / own / estimates["total"],
        )
        name = f"rigid rod, {family}: {quantity}, true error over its estimate"
        figure("error budget", name, found[quantity][-1], most=WITHIN)
    assert min(ratios[-1] for ratios in found.values()) > 1 / (2 * WITHIN), found


@pytest.mark.parametrize(("crank", "tolerance"), [("driven", 1e-2), ("free", 3e-3)])
def test_steps_of_a_coarse_tolerance_are_not_taken_for_too_little(crank, tolerance):
    mechanism, end = machine((12, 3)), 4 * END
    if crank == "free":
        mechanism = driven(mechanism, 0.02)
    run = Run(mechanism, Steps(tolerance=tolerance, largest=0.01), end)
    tracker, budget = judged(run, end)
    exact = followed(mechanism, 3e-5, end)[3]
    for quantity in QUANTITIES:
        own, true = (getattr(each.extremes["big_end"], quantity) for each in (tracker, exact))
        stated = budget.joints["big_end"][quantity]["step_size"]
        assert abs(own - true) / own < max(WITHIN * stated, 3e-3)


@pytest.mark.slow
def test_steps_near_a_whirl_are_not_taken_for_much_too_much():
    """What a cycle changes comes back with the other sign after the next."""
    grid = uniform_grid(0.025, 0.02, (24, 5))
    own = Film(FilmParameters(grid, 25e-6, Lubricant(0.01), 600.0))
    mechanism = Mechanism(
        bodies={"shaft": RigidBody(100.0, 1e-2)},
        joints={"bearing": LubricatedJoint("shaft", "ground", own, eccentricity=(0.0, -10e-6))},
        drives={"shaft": Speed(600.0)},
        forces={"unbalance": RotatingForce("shaft", 60.0, 600.0)},
        gravity=(0.0, -2.0),
    )
    period, found = 2 * np.pi / 600.0, []
    for tolerance in (1e-3, 1e-5):
        run = Run(mechanism, Steps(tolerance=tolerance, largest=0.04, order=2), period)
        cycles = Cycles(run, period, 1e-4, 60)
        found.append(judged(run, period, cycles))
    assert cycles.contraction > 0.5
    own, true = (each.extremes["bearing"].min_film_thickness for each, _ in found)
    stated = found[0][1].joints["bearing"]["min_film_thickness"]["step_size"]
    assert 1 / WITHIN < stated / (abs(own - true) / own) < WITHIN


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    folder = tmp_path_factory.mktemp("budget")
    write_scene(folder / "scene.toml", "loaded-journal", LOADED_JOURNAL)
    for name, options in (("judged", ()), ("plain", ("--no-error-budget",))):
        command = ("run", folder / "scene.toml", "--no-plots", "-o", folder / name, *options)
        assert call(*command) == 0
    return folder


def test_a_run_says_what_it_is_worth(folders):
    summary = json.loads((folders / "judged" / "summary.json").read_text())
    budget = summary["error_budget"]
    for quantity in QUANTITIES:
        own = budget[quantity]
        assert {own["basis"], own["part_mesh"]} == {NOT_APPLICABLE}
        assert 0.0 < own["step_size"] < 0.1
        assert 0.0 < own["film_mesh"] < 0.5
        assert 0.0 <= own["start"] < 1e-2
        assert own["total"] >= 0.5 * own["film_mesh"]
        largest = budget["largest_over_cycle"][quantity]
        assert largest["film_mesh"] > 0.0
        assert largest["total"] >= own["total"]
    assert summary["error_budget_notes"] == {}
    curves = json.loads((folders / "judged" / "error_budget.json").read_text())["bearing"]
    assert set(curves) == {"step_size", "film_mesh"}
    times = np.array(curves["film_mesh"]["time_s"])
    assert times[-1] == pytest.approx(20e-3)
    assert (np.diff(times) > 0).all()
    assert len(curves["film_mesh"]["more_max_pressure_Pa"]) == len(times)
    table = budget_table({"bearing": summary}, summary)
    assert len(table) == 6
    assert "film mesh" in table[0]


def test_a_budget_that_was_interrupted_is_the_same_after_all(folders, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    folder = folders / "stopped"
    with monkeypatch.context() as patched:
        patched.setattr("fenics_ehd.scenes.run.estimated", stop)
        assert call("run", folders / "scene.toml", "--no-plots", "-o", folder) == 130
    assert json.loads((folder / "summary.json").read_text())["status"] == "interrupted"
    assert call("run", "--resume", folder, "--no-plots") == 0
    names = ("history.csv", "error_budget.json")
    whole, found = (
        [(folders / run / name).read_bytes() for name in names] for run in ("judged", "stopped")
    )
    assert found == whole
    found, whole = (
        json.loads((folders / run / "summary.json").read_text()) for run in ("stopped", "judged")
    )
    for key in ("error_budget", "periodicity_defect", "error_budget_iterations"):
        assert found[key] == whole[key]


def test_who_asks_for_no_budget_has_the_same_run(folders):
    plain = json.loads((folders / "plain" / "summary.json").read_text())
    assert not any("error_budget" in key for key in plain)
    assert not (folders / "plain" / "error_budget.json").exists()
    judged_one = json.loads((folders / "judged" / "summary.json").read_text())
    for key in ("max_pressure_Pa", "min_film_thickness_m", "newton_iterations", "cycles"):
        assert plain[key] == judged_one[key]
    histories = [(folders / name / "history.csv").read_bytes() for name in ("plain", "judged")]
    assert histories[0] == histories[1]
