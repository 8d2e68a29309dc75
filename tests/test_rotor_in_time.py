"""Rotor maps against runs in time: decay of small vibrations, and vibration under an unbalance."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import trapezoid

import fenics_ehd as ehd
from fenics_ehd.analysis.rotor_map import rotor_map_of

STEPS = {"tolerance": 1e-6, "periodicity": 1e-4, "cycles": 60, "order": 2}


@cache
def rotor():
    return ehd.build(ehd.read_scene("rotor-two-bearings")).mechanism


def at_speed(speed):
    """The shipped rotor at a speed, without its rotating force."""
    return replace(rotor(), drives={"shaft": ehd.Speed(speed)}, forces={})


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "most"), [(600.0, 3e-3), (800.0, 1e-3)])
def test_small_vibrations_decay_in_time_as_the_least_stable_mode(speed, most, figure):
    period = 2 * np.pi / speed
    history = ehd.simulate(at_speed(speed), period=period, **STEPS)
    multiplier = ehd.multiplier(history)
    point = rotor_map_of([at_speed], [speed]).points[0]
    expected = np.exp(point.largest_real_part * period)
    figure("rotor maps", f"multiplier of a cycle in time at {speed:g} rad/s, least stable mode",
           abs(abs(multiplier.value) / expected - 1.0), most=most, unit="%")  # fmt: skip


@pytest.mark.slow
def test_an_unbalance_moves_the_rotor_in_time_as_in_its_map(figure):
    speed = 500.0
    period = 2 * np.pi / speed
    unbalance = ehd.Unbalance("shaft.disk", 5.0 / speed**2)
    mechanism = replace(at_speed(speed), forces={"unbalance": unbalance})
    cycle = ehd.simulate(mechanism, period=period, **STEPS).last_cycle()
    turned = np.exp(-1j * speed * cycle.time)
    response = rotor_map_of([at_speed], [speed], unbalances=[unbalance]).response
    amplitude = response.deflections[0, response.points.index("shaft.left")]
    force = response.forces["left"][0]
    for i, axis in enumerate("xy"):
        first = {
            name: 2 / period * trapezoid(cycle[f"left.{name}_{axis}"] * turned, cycle.time)
            for name in ("eccentricity", "force")
        }
        figure("rotor maps", f"journal under an unbalance of 5 N in time, along {axis}",
               abs(first["eccentricity"] / amplitude[i] - 1.0), most=0.02, unit="%")  # fmt: skip
        figure("rotor maps", f"force of its bearing in time, along {axis}",
               abs(first["force"] / force[i] - 1.0), most=0.03, unit="%")  # fmt: skip
