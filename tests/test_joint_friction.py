"""Friction of a lubricated joint: torques on both bodies, and where its energy goes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from csv_history import only_joint
from film_cases import oval
from hand_made_rod import (
    CLEARANCE,
    RADIUS,
    REVOLUTION,
    SPEED,
    VISCOSITY,
    WIDTH,
    Joint,
    flexible,
    make_mechanism,
    with_residual,
)
from journal_cases import ETA, OMEGA, C, R, ellipse, journal, make_film
from mechanism_cases import film as film_of
from mechanism_cases import rigid_rod, slider_crank
from oracle_walls import walls

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.quantities import averaged, joint_row
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.reported_rows import with_reported
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import film_friction
from fenics_ehd.multibody.summary import RunSummary

pytestmark = pytest.mark.kernels


def supplied_film(pressure=2e5, ambient=5e4, cells=(24, 4)):
    """The paper's bearing with a groove and sides at given pressures."""
    grid = ehd.uniform_grid(RADIUS, WIDTH, cells, "lagrange")
    groove = ehd.AxialGroove(np.pi / 2, 2 * np.pi / cells[0], pressure)
    sides = ehd.Sides(ambient, ambient)
    return ehd.Film(
        ehd.FilmParameters(grid, CLEARANCE, ehd.Lubricant(VISCOSITY), SPEED, sides, (groove,))
    )


def rows_of(mechanism, end, tolerance):
    """Accepted steps with the rates of every joint."""
    going = Run(mechanism, IntegratorOptions(tolerance=tolerance), end)
    for step in going.until(end):
        yield going, step, [joint_row(joint) for joint in step.solution.joints]


@cache
def machines():
    joint = Joint((10, 2))
    elastic = with_residual(joint, flexible(joint)[0])
    both_ends = film_of(22.5e-3, 22e-3, 17e-6, 0.01), film_of(11e-3, 20e-3, 12e-6, 0.01, (24, 4))
    two = slider_crank(rigid_rod(), *both_ends, friction=True)
    gudgeon = replace(two.joints["gudgeon"], friction=True, journal_shape=oval(2e-6, 0.3))
    return {
        "rigid": slider_crank(rigid_rod(), film_of(22.5e-3, 22e-3, 17e-6, 0.01), friction=True),
        "supplied": slider_crank(rigid_rod(), supplied_film(), friction=True),
        "elastic": make_mechanism(elastic, joint, friction=True),
        "oval journal": slider_crank(
            rigid_rod(), supplied_film(), friction=True, journal_shape=oval(3e-6)
        ),
        "two joints": replace(two, joints={**two.joints, "gudgeon": gudgeon}),
    }


@pytest.mark.parametrize("name", machines())
def test_what_goes_into_a_joint_is_dissipated(name, figure):
    # At every step, and far better than a thousandth: the film keeps no energy.
    worst = 0.0
    for _, _, joints in rows_of(machines()[name], 0.02 * REVOLUTION, 1e-6):
        for rates in joints:
            supply = rates.get("supply_power_W", 0.0)
            defect = rates["film_power_W"] + supply - rates["dissipated_power_W"]
            worst = max(worst, abs(defect) / rates["dissipated_power_W"])
            assert rates["friction_power_W"] == rates["dissipated_power_W"]
    title = f"energy of each joint, {name}: defect over what is dissipated"
    figure("friction", title, worst, most=1e-6)


@pytest.mark.parametrize("name", machines())
def test_recorded_rows_give_friction_and_side_flow_of_the_steps(name):
    # Residual patterns, supplies and a shaped journal that turns among them.
    end = 0.02 * REVOLUTION
    run = Run(machines()[name], IntegratorOptions(tolerance=1e-4), end)
    recorder = Recorder(run, end)
    for number, (step, _) in enumerate(recorder.steps()):
        if number % 5:
            continue
        row = recorder.rows[-1]
        for joint in step.solution.joints:
            path = f"joints/{joint.binding.name}/"
            expected = joint_row(joint) | {"side_flow_m3_per_s": joint.flows.balance.side}
            hidden = [f"{path}{name}" for name in expected if "friction" in name]
            bare = {name: value for name, value in row.items() if name not in hidden}
            found = with_reported(run, bare)
            for column in (*(name.removeprefix(path) for name in hidden), "side_flow_m3_per_s"):
                assert found[f"{path}{column}"] == pytest.approx(expected[column], rel=1e-9)


def test_friction_is_reported_whether_it_acts_or_not():
    rod, grid = rigid_rod(), film_of(22.5e-3, 22e-3, 17e-6, 0.01)
    end = 0.02 * REVOLUTION
    free, braked = (
        ehd.simulate(slider_crank(rod, grid, friction=acts), end, tolerance=1e-4)
        for acts in (False, True)
    )
    for name in ("friction_torque", "friction_power", "side_flow", "bore_friction_torque"):
        column = f"big_end.{name}"
        assert free[column][-1] == pytest.approx(braked[column][-1], rel=1e-3)
        key = f"mean_{name}_{'Nm' if 'torque' in name else 'W' if 'power' in name else 'm3_per_s'}"
        assert free.figures["big_end"][key] == pytest.approx(
            braked.figures["big_end"][key], rel=1e-3
        )
    assert "big_end.film_power" not in free
    load = np.hypot(free["big_end.force_x"], free["big_end.force_y"])
    np.testing.assert_allclose(
        free["big_end.specific_load"], load / (2 * 22.5e-3 * 22e-3), rtol=1e-12
    )


@pytest.mark.parametrize("name", ["rigid", "elastic", "oval journal"])
def test_the_bodies_lose_what_goes_into_the_joint(name):
    # By the multipliers and the bodies' own velocities, in the frame at rest: the force of
    # kilonewtons that goes with metres per second cancels between them.
    for number, (going, step, (rates,)) in enumerate(
        rows_of(machines()[name], 0.02 * REVOLUTION, 1e-6)
    ):
        if number % 7:
            continue
        system, motion = going.equations.system, step.solution.motion
        (place,) = system.films
        moved = motion.instant.jacobian[place.rows].copy()
        moved[:, place.xi[:2]] = 0.0
        power = motion.multipliers[place.rows] @ moved @ motion.rates
        power += rates["friction_torque_Nm"] * place.relative_angle(step.rate)
        # And the elastic rod, by its modes and its residual patterns.
        film = step.solution.films[0]
        elastic = place.film.thickness[:, 2:] @ step.rate[place.xi[2:]]
        residual = film.gap.thickness_rate.ravel() - place.film.thickness @ step.rate[place.xi]
        turning = place.turning_rows(step.x, step.rate)
        if turning is not None:
            residual = residual - turning.gap[:, 0] * place.relative_angle(step.rate)
        pressures = place.film.film.pressure_areas @ film.pressure
        power -= float(pressures @ (elastic + residual))
        on_modes = film_friction(place.film, film).on_xi[2:]
        power -= float(on_modes @ step.rate[place.xi[2:]])
        assert power == pytest.approx(rates["film_power_W"], rel=1e-5)


def test_torques_on_journal_and_bore_are_those_of_the_walls():
    # A rigid bore: its own axis and the journal's.
    mechanism = machines()["rigid"]
    *_, (going, step, (rates,)) = rows_of(mechanism, 0.3 * REVOLUTION, 1e-3)
    (place,), (film,) = going.equations.system.films, step.solution.films
    filled = step.solution.joints[0].friction.sheared_fraction
    found = walls(place.film.film, film, step.x[place.xi[:2]], filled)
    size = rates["friction_torque_Nm"]
    assert size == pytest.approx(-found.shaft_torque, rel=2e-3)
    bore = rates["bore_friction_torque_Nm"]
    assert bore == pytest.approx(found.bore_torque, abs=3e-3 * size)
    assert abs(bore - size) > 0.05 * size


def test_a_centred_journal_has_petroffs_torque(figure):
    # Under next to no load.
    film = make_film()
    mechanism, period = journal(film, ellipse(1e-6, 1.0, 1), np.pi / OMEGA, friction=True)
    result = ehd.simulate(mechanism, period, tolerance=1e-4)
    petroff = ETA * OMEGA * (R - C) ** 2 * 2 * np.pi * R * 2 * R / C
    for body in ("", "bore_"):
        found = result.columns[f"{body}friction_torque_Nm"][-1]
        name = f"torque on the {'bore' if body else 'journal'} after Petroff, centred"
        figure("friction", name, abs(found / petroff - 1), most=1e-6)


@pytest.mark.parametrize("name", ["supplied", pytest.param("two joints", marks=pytest.mark.slow)])
def test_the_machine_puts_in_what_its_films_dissipate(name, figure):
    # Drives, forces and stored energy against dissipation: what no single joint's balance knows.
    steps = {"largest": 1.0, "order": 2}
    loose, tight = (
        ehd.simulate(machines()[name], 0.05 * REVOLUTION, tolerance=t, **steps).summary()[
            "energy_balance_error"
        ]
        for t in (1e-3, 1e-6)
    )
    # Of order 2 with the local error under control: tolerance^(2/3), a factor of 100.
    assert loose > 30 * tight
    figure("friction", f"energy put into the machine, {name}, over exchanged", tight, most=1e-4)


@pytest.mark.slow
def test_means_over_a_cycle_balance():
    period = 2 * np.pi / OMEGA
    loaded, _ = journal(make_film((12, 2)), ellipse(0.2, 0.5, 2), period, friction=True)
    run = Run(loaded, IntegratorOptions(1e-3, 2, 1e-6), period)
    tracker = Recorder(run, period, PeriodicSolver(run, period, 1e-2))
    *_, (_, row) = tracker.steps()
    found = only_joint(RunSummary(tracker).entries())
    means = {name: value for name, value in found.items() if name.startswith("mean_")}
    rates = averaged({name.removeprefix("bearing."): value for name, value in row.items()})
    assert set(means) == {f"mean_{name}" for name in rates}
    lost = means["mean_dissipated_power_W"]
    assert means["mean_film_power_W"] == pytest.approx(lost, rel=1e-6)
    assert means["mean_journal_friction_power_W"] == pytest.approx(
        OMEGA * means["mean_friction_torque_Nm"], rel=1e-9
    )
