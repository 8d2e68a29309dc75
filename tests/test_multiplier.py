"""Largest multiplier of a periodic solution against those known by heart or from coefficients."""

from dataclasses import replace

import numpy as np
import pytest
from journal_cases import OMEGA, UNIT_LOAD, C, in_bearing, make_film, steady

import fenics_ehd as ehd
from fenics_ehd.analysis.multiplier import largest_multiplier
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.run import Run

TURN = 2 * np.pi / OMEGA


def multiplier_of(mechanism, period, tolerance, periodicity=1e-4):
    run = Run(mechanism, IntegratorOptions(tolerance=tolerance, first=1e-6), period)
    for _ in PeriodicSolver(run, period, periodicity, most=40):
        pass
    before = run.state
    found = largest_multiplier(run, period)
    after = run.state
    np.testing.assert_equal(vars(after), vars(before), "the run moved")
    return found


@pytest.mark.slow
def test_mass_on_a_spring_keeps_what_its_damper_leaves(figure):
    """With a massless journal: all of a change remains that the film does not squeeze out."""
    mass, stiffness, damping = 2.0, 2.0 * 60.0**2, 2 * 0.05 * 2.0 * 60.0
    load = ehd.RotatingForce("journal", 0.3 * UNIT_LOAD, OMEGA)
    spring = ehd.SpringDamper(("mass", "ground.wall"), stiffness, damping)
    alone = in_bearing(make_film((12, 2)), {"load": load, "spring": spring})
    others = {
        "ground": ehd.ground({"wall": (0.1, 0.0)}),
        "mass": ehd.RigidBody(mass, 1e-3, position=(0.1, 0.0)),
    }
    drives = alone.drives | {"mass": ehd.Speed(0.0)}
    mechanism = replace(alone, bodies=alone.bodies | others, drives=drives)
    found = multiplier_of(mechanism, TURN, 1e-4)
    decay, wave = damping / (2 * mass), np.sqrt(stiffness / mass - (damping / (2 * mass)) ** 2)
    expected = np.exp((-decay + 1j * wave) * TURN)
    expected = complex(expected.real, abs(expected.imag))
    error = abs(found.value - expected) / abs(expected)
    figure("periodic solutions", "multiplier of a mass on spring and damper", error, most=2e-3)


@pytest.mark.parametrize("share", [0.3, pytest.param(0.9, marks=pytest.mark.slow)])
def test_rotor_in_its_bearing_keeps_what_its_coefficients_say(share, figure):
    """A rigid rotor under its weight: roots of the linear machine over a turn."""
    load = 0.15 * UNIT_LOAD
    mass = share * 6.5 * load / (C * OMEGA**2)
    machine = in_bearing(make_film((12, 2)), {"load": steady(load)}, mass=mass)
    expected = np.abs(np.exp(TURN * ehd.linearise(machine).roots)).max()
    found = multiplier_of(machine, TURN, 1e-6)
    error = abs(abs(found.value) - expected)
    figure("periodic solutions", f"multiplier of a rotor, {share:g} of whirl", error, most=2e-3)
