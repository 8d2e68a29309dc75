"""Derivatives of what a run answers, through its steps, against scaling laws and other runs."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import call, exit_of
from scene_cases import RIGID_ROD, tables_of, write_scene
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import fenics_ehd as ehd
from fenics_ehd.analysis.sensitivity import derivatives, objective_of, smooth_mean
from fenics_ehd.base.extremes import over_time
from fenics_ehd.scenes.scene import scene_of
from fenics_ehd.study.sensitivity import mechanism_parameter, parameter_path, scene_sensitivity

#: The shipped loaded journal on a coarse film: massless, so that its orbit depends on groups only.
JOURNAL = {"joints.bearing.cells": [12, 2], "time.tolerance": 3e-4, "time.largest_step": 0.1}
FILM, PRESSURE = "bearing.min_film_thickness", "bearing.max_pressure"
CLEARANCE, VISCOSITY, LOAD = "joints.bearing.clearance", "lubricants.oil.viscosity", "load.scale"
CLEARANCE_OF_ROD = "joints.big_end.clearance"


def scene(name, *changes):
    tables = tables_of(name, {key: v for change in changes for key, v in change.items()})
    return scene_of(tables, name)


def by_runs(scene, number, figures, share=0.01, bodies=None):
    """Derivatives by two whole runs in steps of their own, which have the noise of these."""
    names = [f"{figure.joint}.{figure.name}" for figure in figures]
    above, below = (
        scene_sensitivity(number.change(scene, sign * share), names, [], bodies=bodies).values
        for sign in (1, -1)
    )
    return {own: (above[own] - below[own]) / (2 * share * number.scale) for own in figures}


def elasticities(found):
    """By name of the figure and key."""
    return {
        (figure.name, number.key): found.elasticity(figure, number)
        for figure in found.objectives
        for number in found.parameters
    }


@pytest.fixture(scope="module")
def journal(tmp_path_factory):
    """Derivatives of a loaded journal along what its Sommerfeld number consists of."""
    file = tmp_path_factory.mktemp("load") / "turn.csv"
    turn = 2 * np.pi * np.linspace(0.0, 1.0, 13)
    rows = np.column_stack([turn / 300, 600 * np.cos(turn), 700 + 300 * np.sin(turn)])
    np.savetxt(file, rows, delimiter=",", header="time_s,Fx_N,Fy_N", comments="")
    changes = {"forces.load.file": str(file), "time.revolutions": 1.0, "time.tolerance": 1e-3}
    found = [FILM, PRESSURE], [CLEARANCE, VISCOSITY, LOAD]
    return scene_sensitivity(scene("loaded-journal", JOURNAL, changes), *found)


@pytest.mark.slow
def test_derivatives_obey_sommerfeld_scaling(journal, figure):
    # h / c and p over the load are functions of eta / (load (c / R)^2) alone: with a the derivative
    # along the viscosity those along load and clearance follow, to c / R of the journal's radius.
    found = elasticities(journal)
    worst = 0.0
    for name, load, clearance in (("min_film_thickness_m", 0, 1), ("max_pressure_Pa", 1, 0)):
        a = found[name, VISCOSITY]
        worst = max(
            worst,
            abs(found[name, "forces.load.scale"] - (load - a)),
            abs(found[name, CLEARANCE] - (clearance - 2 * a)),
        )
    assert found["min_film_thickness_m", VISCOSITY] > 0.3
    name = "Sommerfeld scaling of a journal's derivatives, largest elasticity off"
    figure("derivatives", name, worst, most=2e-3)


@pytest.mark.parametrize("periodic", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_simulated_mechanism_has_the_derivatives_of_its_scene(periodic):
    times = {"time.tolerance": 1e-3}
    if not periodic:
        times |= {"time.periodic": False, "time.revolutions": 0.5}
    own = scene("loaded-journal", JOURNAL, times)
    names = ["min_film_thickness", "max_pressure"]
    expected = scene_sensitivity(own, names, [CLEARANCE])
    number = expected.parameters[0]

    def make(clearance):
        return ehd.build(number.change(own, clearance / number.value - 1.0)).mechanism

    machine = ehd.build(own)
    history = ehd.simulate(machine.mechanism, **machine.options)
    found = ehd.sensitivity(history, make, {"clearance": number.value}, names)
    for name, figure in zip(names, expected.objectives, strict=True):
        slope = expected.derivatives[figure, number.key]
        assert found[name]["clearance"] == pytest.approx(slope, rel=1e-3)
    with pytest.raises(ehd.errors.SensitivityError, match="clearance = 0"):
        ehd.sensitivity(history, make, {"clearance": 0.0}, names)


@pytest.mark.slow
def test_a_derivative_takes_about_a_run(journal):
    assert journal.reduced == []
    assert journal.seconds["derivatives"] < 2.0 * 3 * journal.seconds["run"]


@pytest.mark.slow
def test_derivatives_are_those_of_held_steps_and_the_error_falls_with_the_tolerance(figure):
    # Of a tenth of the change; in steps of their own they are 0.25 % off.
    fine = scene("loaded-journal", JOURNAL, {"time.tolerance": 2e-5, "time.periodicity": 2e-5})
    best = scene_sensitivity(fine, [FILM, PRESSURE], [VISCOSITY])
    number = mechanism_parameter(fine, best.parameters[0], {})
    expected = derivatives(best.trajectory, number, best.objectives, share=1e-3)
    coarse = scene("loaded-journal", JOURNAL, {"time.tolerance": 1e-3})
    found = scene_sensitivity(coarse, [FILM, PRESSURE], [VISCOSITY])
    errors = [
        max(abs(own.derivatives[f, VISCOSITY] / expected[f] - 1) for f in own.objectives)
        for own in (found, best)
    ]
    # What is left of it is of the second order in the change.
    assert errors[1] < 0.2 * errors[0]
    name = "derivatives along the viscosity in the same steps, loaded journal"
    figure("derivatives", name, errors[1], most=1e-3, unit="%")


@pytest.mark.slow
def test_mass_and_speed_of_a_rigid_slider_crank(figure):
    machine = scene("slider-crank", RIGID_ROD, {"time.tolerance": 2e-5})
    keys = ["bodies.piston.mass", "drives.crank.speed"]
    found = scene_sensitivity(machine, ["min_film_thickness"], keys)
    worst = 0.0
    for number in found.parameters:
        expected = by_runs(machine, number, found.objectives)
        for own, slope in expected.items():
            worst = max(worst, abs(found.derivatives[own, number.key] / slope - 1))
    assert found.derivatives[found.objectives[0], "drives.crank.speed"] < 0
    name = "derivatives along mass and speed against runs, rigid slider-crank"
    figure("derivatives", name, worst, most=0.01, unit="%")


def test_an_initial_value_problem_starts_from_the_derivative_of_its_start():
    # A pendulum falls on a lubricated hinge, whose mean force is the momentum that it gave: the
    # film is thin against the pendulum's length, an ideal hinge gives the same.
    body = {
        "kind": "rigid", "mass": 2.0, "inertia": 0.01, "centre": [0.3, 0.0], "angle": -60.0,
        "points": {"hook": [0.0, 0.0]},
    }  # fmt: skip
    hinge = {
        "kind": "lubricated", "journal": "ground", "bore": "pendulum.hook", "clearance": 50e-6,
        "radius": 0.02, "width": 0.02, "cells": [12, 2], "viscosity": 0.05,
    }  # fmt: skip
    tables = {
        "bodies": {"pendulum": body},
        "joints": {"hinge": hinge},
        "forces": {"gravity": {"kind": "gravity"}},
        "time": {"end": 0.05, "tolerance": 1e-5, "first_step": 1e-6},
    }
    pendulum = scene_of(tables, "pendulum")
    figure_name, key = "hinge.mean_force_x", "bodies.pendulum.angle"
    found = scene_sensitivity(pendulum, [figure_name], [key, "bodies.pendulum.mass"])

    def mean_force(angle, mass):
        inertia = 0.01 + mass * 0.3**2

        def rates(_, y):
            return [y[1], -mass * 9.81 * 0.3 * np.cos(y[0]) / inertia]

        end = 0.05
        solved = solve_ivp(rates, (0, end), [np.radians(angle), 0.0], rtol=1e-10, atol=1e-12)
        # What the bearing gives: mass times the mean acceleration of its centre, along x.
        y = solved.y[:, -1]
        return mass * (-0.3 * np.sin(y[0]) * y[1]) / end

    for name, slope in (
        (key, (mean_force(-59.9, 2.0) - mean_force(-60.1, 2.0)) / 0.2),
        ("bodies.pendulum.mass", (mean_force(-60.0, 2.01) - mean_force(-60.0, 1.99)) / 0.02),
    ):
        # Of the pendulum on the hinge, not of the hinge on the pendulum.
        assert found.derivatives[found.objectives[0], name] == pytest.approx(-slope, rel=0.02)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("clearence", "did you mean joints.bearing.clearance"),
        ("bearing.cells", "not a continuous parameter"),
        ("barus", "0.0 means that the setting is not used"),
        ("time.tolerance", "is a setting of the run"),
        ("journal.position", "is a pair: give bodies.journal.position.x"),
        ("bearing.lubricant", "not a continuous parameter"),
    ],
)
def test_keys_without_a_derivative_are_refused(key, message):
    with pytest.raises((ehd.errors.SensitivityError, ehd.errors.SettingsError), match=message):
        parameter_path(scene("loaded-journal", JOURNAL), key)


@pytest.mark.parametrize(
    ("key", "off"),
    [
        ("drives.shaft.speed", "forces.unbalance"),
        ("forces.unbalance.speed", "forces.unbalance"),
        ("drives.shaft.speed", "drives.shaft"),
    ],
)
def test_a_number_that_breaks_the_period_is_refused_before_the_run(key, off, tmp_path, capfd):
    # An unbalance keeps its speed; a crank its angle at the end of a period that is given.
    change = {"time.revolutions": 0.0, "time.period": 2 * np.pi / 300}
    crank = {"bodies.shaft": {"kind": "rigid", "mass": 1.0, "points": {"disk": [0.01, 0.0]}}}
    crank |= {"bodies.shaft.points.left": [0.0, 0.0], "bodies.shaft.points.right": [0.0, 0.0]}
    change = change | crank if off == "drives.shaft" else {}
    path = write_scene(tmp_path / "s.toml", "rotor-two-bearings", change)
    arguments = ("--of", "left.min_film_thickness", "--to", key, "--to", "left.clearance")
    status, out, err = exit_of(capfd, "sensitivity", path, *arguments)
    assert (status, out) == (2, "")
    assert f"{key}: if only this parameter changes, {off} " in err


def test_a_temperature_in_celsius_has_no_elasticity():
    once = {"time.periodic": False, "time.revolutions": 0.02, "time.tolerance": 1e-2}
    oil = {"lubricants.oil": {"grade": "ISO VG 46", "temperature": 60.0}}
    with pytest.raises(ehd.errors.SensitivityError, match=r"= -273\.15 means .* not used"):
        parameter_path(scene("loaded-journal"), "lubricants.oil.temperature")
    found = scene_sensitivity(
        scene("loaded-journal", JOURNAL, once, oil), ["max_pressure"], ["oil.temperature"]
    )
    (number,), (own,) = found.parameters, found.objectives
    assert (number.unit, number.relative) == ("C", False)
    assert abs(found.derivatives[own, number.key]) > 0.0
    assert found.elasticity(own, number) is None


def test_an_unknown_quantity_is_refused_after_one_step(tmp_path, capfd):
    path = write_scene(tmp_path / "s.toml", "loaded-journal", JOURNAL)
    status, out, err = exit_of(
        capfd, "sensitivity", path, "--of", "min_film_thicknes", "--to", "clearance"
    )
    assert (status, out) == (2, "")
    assert "--of min_film_thicknes is now --of bearing.min_film_thicknes" in err
    assert "SensitivityError" in err
    assert "did you mean bearing.min_film_thickness?" in err


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("max_pressure_angle", "did you mean bearing.max_pressure"),
        ("max_pressure_angle_deg", "unknown quantity max_pressure_angle_deg"),
        ("mean_max_pressure", "did you mean bearing.max_pressure"),
    ],
)
def test_the_largest_angle_of_a_peak_is_no_figure(name, message):
    columns = ("max_pressure_Pa", "max_pressure_angle_deg", "side_flow_m3_per_s")
    paths = [f"joints/bearing/{column}" for column in columns]
    with pytest.raises(ehd.errors.SensitivityError, match=message):
        objective_of(name, paths)
    assert objective_of("bearing.mean_side_flow", paths).column == "side_flow_m3_per_s"
    with pytest.warns(DeprecationWarning, match=r"mean_side_flow is now bearing\.mean_side_flow"):
        assert objective_of("mean_side_flow", paths).joint == "bearing"
    two = [*paths, "joints/other/side_flow_m3_per_s"]
    with pytest.raises(ehd.errors.SensitivityError, match="unknown quantity mean_side_flow"):
        objective_of("mean_side_flow", two)
    with pytest.raises(ehd.errors.SensitivityError, match="no joint is lubricated"):
        objective_of("max_pressure", [])


def test_the_command_prints_a_table_and_json(tmp_path, capfd):
    once = {"time.periodic": False, "time.revolutions": 0.1, "time.tolerance": 1e-3}
    path = write_scene(tmp_path / "s.toml", "loaded-journal", JOURNAL, once)
    asked = ("sensitivity", path, "--of", "bearing.min_film_thickness", "--to", "clearance")
    status, out, _ = exit_of(capfd, *asked, "--json")
    found = json.loads(out)["quantities"]["bearing.min_film_thickness_m"]
    along = found["along"][CLEARANCE]
    assert not status
    assert along["method"] == "differences in the same steps"
    # The table has the change by 18 x 3 cells.
    more = 100 * (along["on_finer_film"] / along["derivative"] - 1)
    assert 0.1 < abs(more) < 10.0
    assert along["elasticity"] == pytest.approx(along["derivative"] * along["at"] / found["value"])
    assert call(*asked) == 0
    assert along["units"] == "m/m"
    line = next(line for line in capfd.readouterr().out.splitlines() if CLEARANCE in line)
    assert line.split()[4:6] == ["m/m", f"{along['elasticity']:.4f}"]
    assert f"{more:+.2g} % on a finer film, differences in the same steps" in line
    assert call(*asked, "--no-finer-film") == 0
    assert "finer" not in capfd.readouterr().out


def test_an_extreme_between_steps_is_exact_on_a_parabola():
    times = np.array([0.0, 0.2, 0.5, 0.9, 1.0])
    values = 3.0 - 2.0 * (times - 0.62) ** 2
    assert over_time(times, values, None, 1)[0] == pytest.approx(3.0)
    assert over_time(times, -values, None, -1)[0] == pytest.approx(-3.0)


@pytest.mark.parametrize("period", [None, 1.0])
@pytest.mark.parametrize(
    "values", [np.zeros(6), np.full(6, 3e7), np.array([0.0, 2.0, 2.0, 2.0, 2.0, 2.0])]
)
def test_an_extreme_of_equal_values_is_that_value(values, period):
    """A contact that no asperity touches at an instant, or that is level over some."""
    times = np.linspace(0.0, 1.0, 7)[1:]
    assert over_time(times, values, period, 1)[0] == values.max()
    level = np.full_like(values, values.max())
    assert over_time(times, level, period, 1)[0] == pytest.approx(values.max(), rel=1e-12)
    assert over_time(times, -level, period, -1)[0] == pytest.approx(-values.max(), rel=1e-12)


def test_a_figure_that_is_no_number_is_refused():
    values = np.array([1.0, np.nan, 2.0, 1.0, 0.5])
    joint = SimpleNamespace(columns={"max_contact_pressure_Pa": values})
    course = SimpleNamespace(
        joints={"pin": joint}, times=np.arange(1.0, 6.0), began=0.0, period=None
    )
    figure = objective_of("pin.max_contact_pressure", ["joints/pin/max_contact_pressure_Pa"])
    with pytest.raises(ehd.errors.VerificationError, match=r"pin\.max_contact.* is not finite"):
        figure.value(course)


def test_an_extreme_across_the_ends_of_a_cycle_converges_and_never_jumps():
    errors, jumps = [], []
    for count in (20, 40):
        times = np.linspace(0.0, 1.0, count + 1)[1:]
        # From before the last step over the end of the cycle to beyond its first one.
        places = np.linspace(-1.3, 1.3, 401) / count
        curves = np.cos(2 * np.pi * (times - places[:, None]))
        values, below, above = (
            np.array([over_time(times, own, 1.0, 1)[0] for own in curves + more])
            for more in (
                np.zeros(count),
                *np.multiply.outer((-1e-6, 1e-6), np.sin(2 * np.pi * times)),
            )
        )
        errors.append(abs(values - 1.0).max())
        # What a number adds to every step, at the place of the extreme.
        along = (above - below) / 2e-6
        jumps.append((abs(np.diff(values)).max(), abs(np.diff(along)).max()))
    assert errors[1] < 0.2 * errors[0]
    assert errors[1] < 2e-4
    assert jumps[1][0] < 1e-5
    assert jumps[1][1] < 1.2 * 2 * np.pi * 2.6 / 40 / 400


def test_means_of_a_cycle_and_of_a_run_converge():
    errors = []
    for count in (20, 40):
        even = np.linspace(0.0, 1.0, count + 1)[1:]
        times = even + 0.05 * np.sin(2 * np.pi * even)
        # The mean of exp(sin) is the modified Bessel function I_0(1).
        values = np.exp(np.sin(2 * np.pi * times))
        errors.append(abs(smooth_mean(times, values, 1.0) - 1.2660658777520082))
    assert errors[1] < 0.2 * errors[0]
    # That of a run has a start that is no end.
    found = smooth_mean(times, values, None)
    mean = CubicSpline(times, values).integrate(times[0], 1.0) / (1.0 - times[0])
    assert found == pytest.approx(mean, rel=1e-4)


@pytest.mark.slow
def test_a_slider_crank_with_an_elastic_rod(figure):
    machine = scene(
        "slider-crank",
        {
            "joints.big_end.cells": [12, 3],
            "time.tolerance": 3e-6,
            "time.periodicity": 1e-5,
            "bodies.rod.geometry": {"bore_cells_around": 10, "bore_cells_along": 2},
            "bodies.rod.reduction.estimate_error": False,
        },
    )
    # Each number costs two runs at this tolerance.
    keys = [CLEARANCE_OF_ROD, "drives.crank.speed"]
    bodies = ehd.build(machine).bodies
    found = scene_sensitivity(machine, ["min_film_thickness", "max_pressure"], keys, bodies=bodies)
    worst = 0.0
    for number in found.parameters:
        for own, slope in by_runs(machine, number, found.objectives, bodies=bodies).items():
            error = abs(found.derivatives[own, number.key] - slope) * number.value
            worst = max(worst, error / found.values[own])
    name = "derivatives against runs, slider-crank with an elastic rod, largest elasticity off"
    figure("derivatives", name, worst, most=3e-3)


@pytest.mark.slow
def test_geometry_goes_by_differences():
    machine = scene(
        "slider-crank",
        {
            "joints.big_end.cells": [12, 3],
            "time.tolerance": 1e-3,
            "bodies.rod.geometry.bore_cells_around": 10,
            "bodies.rod.geometry.bore_cells_along": 2,
            "bodies.rod.reduction.estimate_error": False,
        },
    )
    found = scene_sensitivity(
        machine, ["min_film_thickness"], ["big_end_wall", "joints.big_end.clearance"]
    )
    assert found.reduced == ["bodies.rod.geometry.big_end_wall"]
    assert all(np.isfinite(slope) for slope in found.derivatives.values())


@pytest.mark.slow
def test_a_film_whose_heat_is_balanced_takes_its_temperature_along():
    heated = scene(
        "loaded-journal",
        JOURNAL,
        {
            "lubricants.oil": {"grade": "ISO VG 46"},
            "joints.bearing.heat": {"supply_temperature": 60.0, "tolerance": 1e-3},
            "joints.bearing.shear_rule": "full",
            "time.tolerance": 3e-5,
        },
    )
    # At one temperature the film's is -0.3: the wider bearing is the cooler one.
    found = scene_sensitivity(heated, ["min_film_thickness"], [CLEARANCE])
    clearance, own = found.parameters[0], found.objectives[0]
    slope = by_runs(heated, clearance, [own], share=0.02)[own]
    expected = slope * clearance.value / found.values[own]
    assert expected > 0.1
    assert found.elasticity(own, clearance) == pytest.approx(expected, abs=0.01)
