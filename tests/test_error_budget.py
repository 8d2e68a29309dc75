"""Error budgets of runs, compared with true errors."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import call
from csv_history import only_joint
from hand_made_rod import driven
from journal_cases import in_bearing, steady
from mechanism_cases import film as plain_film
from mechanism_cases import rigid_rod, slider_crank
from oil_cases import conserved
from scene_cases import LOADED_JOURNAL, write_scene

import fenics_ehd as ehd
from fenics_ehd.analysis.error_budget import (
    SETTLED,
    Estimator,
    missing_gaps,
    remaining_part,
    summed,
)
from fenics_ehd.analysis.error_curves import ErrorCurves, Extreme
from fenics_ehd.analysis.replay import (
    LONGEST,
    Replay,
    Trajectory,
    finer_grid,
    recorded,
    trajectory_of,
    transferred_state,
    with_finer_films,
)
from fenics_ehd.base.columns import Quantity
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.cli.run import budget_table, error_text
from fenics_ehd.multibody.bdf import IntegratorOptions, IntegratorState
from fenics_ehd.multibody.cycle import TOO_SHORT, Cycle
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.trust import COMPONENTS, NOT_APPLICABLE, NOT_ESTIMATED, QUANTITIES

#: Largest true error over the estimate, and least.
WITHIN = 2.0

#: Of the slider-crank [s].
END = 6e-3


def machine(cells, clearance=17e-6, family="lagrange", **joint):
    grid = ehd.uniform_grid(0.0225, 0.022, cells, family)
    film = ehd.Film(ehd.FilmParameters(grid, clearance, ehd.Lubricant(0.01), 500.0))
    return slider_crank(rigid_rod(), film, **joint)


def extremes(mechanism, tolerance, end=END, joint="big_end"):
    solved = ehd.simulate(mechanism, end, tolerance=tolerance).solved
    return [RunSummary(solved).extremes[joint][quantity][0] for quantity in QUANTITIES]


@pytest.fixture(scope="module")
def course():
    return trajectory_of(ehd.simulate(machine((12, 3)), END, tolerance=1e-3).solved)


def replayed(course, run=None, **how):
    """The course in the steps of the run or longer ones, as an error budget takes them."""
    replay = Replay(run or course.base, course, SETTLED * course.base.control.tolerance, **how)
    return recorded(replay, course.times[-1])


def test_along_its_own_steps_a_run_is_met_again_and_in_longer_ones_it_ends_where_it_ends(course):
    again = replayed(course)
    np.testing.assert_array_equal(again.times, course.times)
    late = course.times > 1e-4
    found, expected = again.extremes[:, late], course.extremes[:, late]
    np.testing.assert_allclose(found[0], expected[0], rtol=2e-3)
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-3)
    longer = replayed(course, stride=3).times
    assert longer[-1] == course.times[-1]
    assert np.isin(longer, course.times).all()
    sizes = np.diff(longer, prepend=0.0)
    assert (sizes[1:] / sizes[:-1] <= LONGEST).all()
    assert len(course.times) / 3 < len(longer) < 0.6 * len(course.times)


class Stopped(Replay):
    """A replay whose steps have no solution beyond a time, if they are longer than some."""

    def __init__(self, course, longest, row):
        super().__init__(course.base, course, 1e-4, forgiving=True)
        before, after = course.times[row - 1 : row + 1]
        own = self.solve

        def solve(norm, step, former, gap_changes):
            length = step.time - self.state.time
            if before < step.time <= after and length > longest * (after - before):
                return SimpleNamespace(solved=None, iterations=1)
            return own(norm, step, former, gap_changes)

        self.solve = solve


@pytest.mark.parametrize(("longest", "parts"), [(0.6, 2), (0.3, 4), (0.1, 16)])
def test_a_step_without_a_partner_is_taken_in_parts(course, longest, parts):
    row = len(course) - 5
    replay = Stopped(course, longest, row)
    again = recorded(replay, course.times[-1])
    assert replay.left_out == 0.0
    between = np.linspace(*course.times[row - 1 : row + 1], parts + 1)[1:-1]
    np.testing.assert_allclose(np.setdiff1d(again.times, course.times), between)
    assert np.isin(course.times, again.times).all()
    found, expected = again.extremes[:, -4:], course.extremes[:, -4:]
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_a_step_without_a_partner_in_parts_either_is_left_out(course):
    row = len(course) - 5
    replay = Stopped(course, 0.0, row)
    again = recorded(replay, course.times[-1])
    assert replay.left_out == pytest.approx(np.diff(course.times)[row - 1])
    np.testing.assert_array_equal(again.times, np.delete(course.times, row))
    # It continues as any run begins, by a formula of first order.
    np.testing.assert_allclose(again.extremes[:, -1:], course.extremes[:, -1:], rtol=1e-2)


def test_a_film_keeps_its_oil_where_a_step_is_left_out():
    mechanism = machine((24, 6), family="bilinear", **conserved(initial_filling=0.6))
    course = trajectory_of(ehd.simulate(mechanism, 3e-4, tolerance=1e-2).solved)
    replay = Stopped(course, 0.0, len(course) - 3)
    again = recorded(replay, course.times[-1])
    assert replay.left_out > 0.0
    filled = [own.joints["big_end"].film.fluid_fraction[-1] for own in (again, course)]
    assert np.mean(filled[1]) < 0.95
    np.testing.assert_allclose(np.mean(filled[0]), np.mean(filled[1]), rtol=2e-3)


def test_a_replay_that_is_not_asked_to_forgive_ends_there(course):
    replay = Stopped(course, 0.0, len(course) - 5)
    replay._forgiving = False
    with pytest.raises(ehd.errors.StepSizeError, match=r"^no solution near the recorded one"):
        recorded(replay, course.times[-1])


@pytest.mark.parametrize("missed", ["late step", "every step"])
def test_an_estimate_is_of_what_has_partners(course, missed, monkeypatch):
    """One late step without a solution in the run's own steps does not take the estimate away."""
    history = ehd.simulate(machine((12, 3)), END, tolerance=1e-3)
    times = history.time
    first, last = (times[-9], times[-4]) if missed == "late step" else (0.0, times[-1])
    own = Replay._step

    def step(replay, row, time, share=1.0):
        return None if first < time <= last else own(replay, row, time, share)

    monkeypatch.setattr(Replay, "_step", step)
    budget = ehd.error_budget(history)
    peak = budget.joints["big_end"]["max_pressure"]
    if missed == "late step":
        assert budget.notes == {}
        assert 0.0 < budget.left_out["film_mesh"] < 0.1
        assert 0.0 < peak["total"] < 0.5
    else:
        assert set(budget.notes) == {"step_size", "film_mesh"}
        assert peak["known"] == NOT_ESTIMATED


def test_notes_are_printed_once():
    notes = {"step_size": "no step", "film_mesh": "no step", "part_mesh": "no mesh"}
    quantities = dict.fromkeys(QUANTITIES, summed(dict.fromkeys(COMPONENTS, NOT_ESTIMATED)))
    joint = {"error_budget": {**quantities, "largest_over_cycle": quantities}}
    parts = {"film_mesh": 0.004}
    summary = {"error_budget_notes": notes, "error_budget_left_out": parts}
    lines = budget_table({"pin": joint}, summary)
    assert "  step size and film mesh not estimated: no step" in lines
    assert "  part mesh not estimated: no mesh" in lines
    assert sum("not estimated: " in line for line in lines) == 2
    assert lines[-1].startswith("  film mesh: excludes 0.4 % of the time")
    assert any("over the cycle" in line for line in lines)
    without_cycle = Cycle(0.0, 1.0, TOO_SHORT, complete=False, periodic=False)
    whole = budget_table({"pin": joint}, summary | without_cycle.entries())
    assert not any("cycle" in line for line in whole)


@pytest.mark.parametrize(
    ("moved", "left", "contraction", "growths", "start"),
    [
        (1e-3, 2e-4, 0.2, [], 2.5e-4),
        (1e-3, 2e-4, 0.2, [(1.0, 0.7)], 2.5e-4),
        (1e-9, 2e-9, 2.0, [], 2e-8),
        (4e-4, 5e-4, 1.2, [], 5e-3),
        (4e-4, 5e-4, 1.2, [(3.0, 0.9), (1.0, 1.1)], 1e-3),
        (4e-4, 5e-4, 1.2, [(1.0, 1.5)], 5e-3),
        (4e-4, 5e-4, 1.2, [(0.0, 0.0)], 5e-3),
        (4e-2, 5e-4, 1.2, [], NOT_ESTIMATED),
        (4e-2, 5e-2, 1.2, [(1.0, 0.5)], NOT_ESTIMATED),
        (np.nan, 1e-9, np.nan, [], NOT_ESTIMATED),
        (0.0, 0.0, 0.0, [], 0.0),
    ],
)
def test_the_start_error_of_cycles_that_change_by_noise(moved, left, contraction, growths, start):
    """If nothing moves but noise, the ratio of replays is used, not that of the noise."""
    cycles = SimpleNamespace(moved=moved, left=left, contraction=contraction, periodicity=1e-4)
    decay = Estimator._decay.fget(SimpleNamespace(_growths=growths))
    peaks = {"pin": {"max_pressure": (1e7, 0.0)}}
    estimator = SimpleNamespace(
        _cycles=cycles,
        _summary=SimpleNamespace(extremes=peaks, former_extremes=peaks),
        _remaining_part=remaining_part(cycles, 1e-3, decay),
    )
    _, over_cycle = Estimator._start(estimator, "pin", "max_pressure")
    assert over_cycle == (start if isinstance(start, str) else pytest.approx(start))


def test_a_given_gap_acts_as_a_clearance_does(course):
    more = 0.1e-6
    other = replayed(course, course.base.with_mechanism(machine((12, 3), 17e-6 + more)))
    (place,) = course.base.equations.system.films
    wider = [np.full((len(course), len(place.film.observed)), more)]
    found = replayed(course, changes=wider).widened(wider)
    plain = replayed(course)
    late = course.times > 1e-4

    def apart(one):
        return np.abs(one.extremes[:, late] / other.extremes[:, late] - 1).max(axis=(1, 2))

    effect = apart(plain)[1]
    assert effect > 3e-3
    # The clearance is also in the shaft's radius.
    assert apart(found).max() < 0.02 * effect


def test_a_course_of_one_step_has_no_rates(course):
    one = course.each(lambda values: values[:1])
    with pytest.raises(
        ehd.errors.SettingsError, match="one step is too few to estimate errors: raise time"
    ):
        missing_gaps(course.base.equations, one, "basis", periodic=False)


@pytest.mark.parametrize(
    ("cells", "finer"), [((20, 5), (30, 8)), ((24, 4), (36, 6)), ((7, 1), (11, 2))]
)
def test_finer_films_are_graded_alike(cells, finer):
    grid = ehd.uniform_grid(0.02, 0.01, cells, "lagrange")
    graded = replace(grid, heights=0.005 * np.linspace(-1.0, 1.0, cells[1] + 1) ** 3)
    found = finer_grid(graded)
    assert found.cells == finer
    assert found.heights[[0, -1]] == pytest.approx(graded.heights[[0, -1]])
    uniform = finer_grid(grid)
    np.testing.assert_allclose(np.diff(uniform.heights), 0.01 / finer[1])
    np.testing.assert_allclose(np.diff(uniform.angles), 2 * np.pi / finer[0])


def test_a_finer_film_holds_the_same_share_of_oil():
    mechanism = machine((24, 6), family="bilinear", **conserved(initial_filling=0.6))
    run = Run(mechanism, IntegratorOptions(tolerance=1e-2), 2e-4)
    for _ in run.until(2e-4):
        pass
    finer = run.with_mechanism(with_finer_films(mechanism))
    state = transferred_state(run.state, run, finer)
    contents = []
    for own, point in ((run, run.state.x[0]), (finer, state.x[0])):
        gaps = own.norm.film_gaps(own.norm.observe(point))
        contents.extend(own.equations.contents(point, gaps))
    assert contents[1] == pytest.approx(contents[0], rel=0.02)


@pytest.mark.parametrize(
    ("changes", "known", "total", "statement"),
    [
        ({}, 0.28, 0.28, "+- 28 %, too high by about 13 MPa, "),
        ({"part_mesh": NOT_APPLICABLE}, 0.25, 0.25, "+- 25 %, too high by about 13 MPa, "),
        ({"part_mesh": NOT_ESTIMATED}, 0.25, None, "+- 25 %, part mesh not included, "),
        ({"basis": 0.02, "bias": -0.02}, 0.1, 0.1, "+- 10 % "),
        (dict.fromkeys(COMPONENTS, NOT_ESTIMATED), None, None, "+- not estimated "),
    ],
)
def test_the_total_is_the_sum_and_none_where_a_component_is_missing(
    changes, known, total, statement
):
    errors = dict(zip(COMPONENTS, (0.2, 0.02, 0.03, 0.02, 0.01), strict=True))
    found = summed(errors | {"bias": 0.28} | changes)
    assert found["known"] == (NOT_ESTIMATED if known is None else pytest.approx(known))
    assert found["total"] == (NOT_ESTIMATED if total is None else pytest.approx(total))
    text = error_text({"error_budget": {"max_pressure": found}}, "max_pressure", 46.3, "MPa")
    assert text == statement


@pytest.mark.parametrize("family", ["lagrange", "serendipity", "bilinear"])
def test_a_peak_between_nodes_is_met_as_it_passes_them(family):
    """The largest nodal value is off by the square of the mesh size, this by more."""
    centres, nodes, between = np.linspace(0.0, 7.0, 200)[:, None], [], []
    for cells in ((24, 4), (48, 8)):
        places = ehd.uniform_grid(0.02, 0.01, cells, family).node_positions.T
        angle, height = places
        values = np.exp(np.cos(angle - centres)) - ((height - 1e-3) / 0.01) ** 2
        nodes.append(np.abs(values.max(axis=1) - np.e).max())
        between.append(np.abs(FilmRows.of(*places).largest(values)[0] - np.e).max())
    assert np.log2(nodes[0] / nodes[1]) < 2.6
    assert np.log2(between[0] / between[1]) > 3.0
    assert between[0] < 0.1 * nodes[0]
    # At the end of a row it is the value of the node.
    rising = FilmRows.of(*places).largest((height + 0.0 * angle)[None])[0]
    assert rising[0] == pytest.approx(0.005)


def curves(times, peaks, films, began=0.0, period=None):
    grid = ehd.uniform_grid(0.02, 0.01, (4, 1))
    nodal = np.ones(len(grid.node_positions))
    values = {
        "time": times,
        "state/coordinates": np.zeros((len(times), 0)),
        "joints/pin/film/angle": grid.node_positions[:, 0],
        "joints/pin/film/height": grid.node_positions[:, 1],
        "joints/pin/film/cells": grid.cell_nodes,
        "joints/pin/film/radius": 0.02,
        "joints/pin/film/clearance": 1e-5,
        "joints/pin/film/pressure": np.multiply.outer(peaks, nodal),
        "joints/pin/film/gap": np.multiply.outer(films, nodal),
    }
    values = {path: Quantity(v, "1") for path, v in values.items()}
    start = IntegratorState([began], *4 * [np.zeros((0, 0))])
    return Trajectory(
        values, base=None, start=start, search=period and SimpleNamespace(period=period)
    )


def test_extremes_move_by_what_lies_between_long_steps():
    """A parabola's vertex moves by what the curve changes there, wherever the steps are."""

    def at(times, rise, delay):
        curve = 10.0 + rise - (times - 1.03 - delay) ** 2
        return curves(times, curve, 20.0 - curve)

    short, long = np.linspace(0.0, 2.0, 41), np.linspace(0.0, 2.0, 11)
    run = at(short, 0.0, 0.0)
    peaks, films = run.extremes[..., 0]
    own = ErrorCurves(curves(short, peaks, films, began=-0.05))
    change = own.change(run, at(long, -0.3, 0.1), -0.1)
    peak = Extreme("max_pressure", 0, 10.0, own.reported)
    film = Extreme("min_film_thickness", 0, 10.0, own.reported)
    # The step before the vertex and that behind it change it differently, the vertex by 0.03.
    assert peak.bias([change]) == pytest.approx(-0.03 / 10.0, rel=0.05)
    assert film.bias([change]) == pytest.approx(0.03 / 10.0, rel=0.05)
    # Changes of several components add up.
    rise = np.full_like(change, 0.05)
    assert peak.bias([change, rise]) == pytest.approx(-0.08 / 10.0, rel=0.05)
    assert peak.over(rise) == pytest.approx(0.05 / 10.0, rel=0.02)


def test_what_cancels_is_not_relied_on():
    times = np.linspace(0.0, 1.0, 51)
    value = 10.0 - (times[:, None] - 0.5) ** 2
    more = np.where(np.abs(times[:, None] - 0.5) < 0.05, 0.0, -0.1)
    change = np.array([more, more])
    extreme = Extreme("max_pressure", 0, 10.0, np.array([value, value]))
    assert extreme.bias([change]) == 0.0
    assert extreme.near(change) == pytest.approx(0.01, rel=0.1)
    assert extreme.share(change) == pytest.approx(0.5 * extreme.near(change))


@pytest.mark.parametrize("contraction", [0.5, -0.75])
def test_a_cycle_is_judged_by_what_is_different_the_second_time(contraction):
    times = np.linspace(0.0, 2.0, 81)[1:]
    base = 10.0 + np.cos(2 * np.pi * times)
    grown = base + 0.1 * (1.0 - contraction ** np.ceil(times - 1e-9))
    run, other = (curves(times, own, own) for own in (base, grown))
    first = times <= 1.0 + 1e-9
    course = curves(times[first], base[first], base[first], period=1.0)
    found = ErrorCurves(course).change(run, other, 1.0, contraction)
    np.testing.assert_allclose(found[0, 15:-5], 0.1, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["lagrange", "bilinear"])
def test_estimates_of_a_rigid_rod_are_the_errors(family, figure):
    cells = {"lagrange": (16, 4), "bilinear": (32, 8)}[family]
    history = ehd.simulate(machine(cells, family=family), END, tolerance=1e-3)
    own = [RunSummary(history.solved).extremes["big_end"][quantity][0] for quantity in QUANTITIES]
    budget, found = ehd.error_budget(history), {}
    exact = extremes(machine(cells, family=family), 1e-5)
    finer = extremes(machine((3 * cells[0], 3 * cells[1]), family=family), 1e-5)
    for quantity, statement, steps, mesh in zip(QUANTITIES, own, exact, finer, strict=True):
        estimates = budget.joints["big_end"][quantity]
        assert set(estimates) == {*COMPONENTS, "between_nodes", "known", "total", "bias"}
        assert estimates["basis"] == NOT_APPLICABLE
        assert estimates["start"] == NOT_APPLICABLE
        # A mesh three times as fine leaves a ninth of an error of order two.
        found[quantity] = (
            abs(statement - steps) / statement / estimates["step_size"],
            9 / 8 * abs(steps - mesh) / statement / estimates["film_mesh"],
            abs(statement - mesh) / statement / estimates["total"],
        )
        name = f"rigid rod, {family}: {quantity}, true error over its estimate"
        figure("error budget", name, found[quantity][-1], most=WITHIN)
    assert min(ratios[-1] for ratios in found.values()) > 1 / (2 * WITHIN), found


@pytest.mark.slow
@pytest.mark.parametrize(("crank", "tolerance"), [("driven", 1e-2), ("free", 3e-3)])
def test_steps_of_a_coarse_tolerance_are_not_taken_for_too_little(crank, tolerance):
    mechanism, end = machine((12, 3)), 2 * END
    if crank == "free":
        mechanism = driven(mechanism, 0.02)
    history = ehd.simulate(mechanism, end, tolerance=tolerance, largest=0.01)
    budget = ehd.error_budget(history).joints["big_end"]
    for quantity, true in zip(QUANTITIES, extremes(mechanism, 3e-5, end), strict=True):
        own = RunSummary(history.solved).extremes["big_end"][quantity][0]
        stated = budget[quantity]["step_size"]
        assert abs(own - true) / own < max(WITHIN * stated, 3e-3)


@pytest.mark.slow
def test_steps_near_a_whirl_are_not_taken_for_much_too_much():
    """What a cycle changes comes back with the other sign after the next."""
    own = plain_film(0.025, 0.02, 25e-6, 0.01, (24, 5), rate=600.0)
    forces = {"unbalance": ehd.RotatingForce("journal", 60.0, 600.0), "weight": steady(0.0, -200.0)}
    mechanism = in_bearing(
        own, forces, mass=100.0, inertia=1e-2, speed=600.0, eccentricity=(0.0, -10e-6)
    )
    period, found = 2 * np.pi / 600.0, []
    for tolerance in (1e-3, 1e-5):
        steps = {"tolerance": tolerance, "largest": 0.04, "order": 2}
        found.append(ehd.simulate(mechanism, period=period, periodicity=1e-4, cycles=60, **steps))
    assert found[1].solved.cycles.contraction > 0.5
    own, true = (
        RunSummary(each.solved).extremes["bearing"]["min_film_thickness"][0] for each in found
    )
    stated = ehd.error_budget(found[0]).joints["bearing"]["min_film_thickness"]["step_size"]
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
    budget = only_joint(summary)["error_budget"]
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
    table = budget_table(summary["joints"], summary)
    assert len(table) == 6
    assert "film mesh" in table[0]


def test_a_budget_that_was_interrupted_is_the_same_after_all(folders, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    folder = folders / "stopped"
    with monkeypatch.context() as patched:
        patched.setattr("fenics_ehd.scenes.run.estimate_errors", stop)
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
    for key in ("joints", "periodicity_defect", "error_budget_iterations"):
        assert found[key] == whole[key]


def test_who_asks_for_no_budget_has_the_same_run(folders):
    plain = json.loads((folders / "plain" / "summary.json").read_text())
    assert not any("error_budget" in key for key in (*plain, *only_joint(plain)))
    assert not (folders / "plain" / "error_budget.json").exists()
    judged_one = json.loads((folders / "judged" / "summary.json").read_text())
    for key in ("newton_iterations", "cycles"):
        assert plain[key] == judged_one[key]
    for key in ("max_pressure_Pa", "min_film_thickness_m"):
        assert only_joint(plain)[key] == only_joint(judged_one)[key]
    histories = [(folders / name / "history.csv").read_bytes() for name in ("plain", "judged")]
    assert histories[0] == histories[1]
