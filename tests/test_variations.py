"""Forces, drives and supplies state their variations, which steps, cycles and checks read."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from journal_cases import in_bearing, make_film, steady
from scipy.interpolate import PchipInterpolator

import fenics_ehd as ehd
from fenics_ehd.multibody.forces import Force, Load
from fenics_ehd.multibody.tabulated import Curve, Variation

#: One turn of the journal [s].
TURN = 2 * np.pi / 300


@dataclass(frozen=True)
class Pulsating(Force):
    """A force along -y that pulsates, of a class that the package does not contain."""

    period: float
    markers = ("journal",)

    @property
    def variations(self):
        return (Variation(period=self.period),)

    def load(self, time, u, rates):
        value = np.zeros(len(u))
        value[1] = -300.0 + 50.0 * np.cos(2 * np.pi * time / self.period)
        return Load(value)


@dataclass(frozen=True)
class Knock(Force):
    """A force along x with a table of its own, over the time."""

    curve: Curve
    markers = ("sled",)

    @property
    def variations(self):
        return self.curve.variations

    def load(self, time, u, rates):
        value = np.zeros(len(u))
        value[0] = self.curve(time)[0]
        return Load(value)


def pulsating(period):
    """A journal under a pulsating force."""
    return in_bearing(make_film((12, 2)), {"pulse": Pulsating(period)})


def test_a_cycle_has_whole_periods_of_a_new_force():
    search = {"periodicity": 1e-2, "tolerance": 1e-2, "largest": 0.2}
    with pytest.raises(ehd.errors.SettingsError, match=r"forces\.pulse repeats 1\.5 times .* 2 "):
        ehd.simulate(pulsating(2 * TURN), period=3 * TURN, **search)
    assert ehd.simulate(pulsating(2 * TURN), period=2 * TURN, **search).cycles > 1


def test_the_last_cycle_is_as_long_as_the_period_of_a_new_force():
    for period, length in ((2 * TURN, 2 * TURN), (0.5 * TURN, TURN)):
        figures = ehd.simulate(pulsating(period), 4.5 * TURN, tolerance=1e-2, largest=0.5).summary()
        assert figures["cycle_end_s"] - figures["cycle_start_s"] == pytest.approx(length)


def test_no_step_crosses_the_rows_of_a_new_force():
    times = np.array([0.0, 1e-3, 1.01e-3, 1.02e-3, 2e-3])
    knock = Knock(Curve(PchipInterpolator(times, [0.0, 0.0, 1e5, 0.0, 0.0]), periodic=False))
    sled = ehd.Mechanism({"sled": ehd.RigidBody(1.0, 1.0)}, {}, {}, {"knock": knock})
    speeds = ehd.simulate(sled, 2e-3, largest=0.5).bodies["sled"].rates[:, 0]
    assert speeds[-1] == pytest.approx(knock.curve.integral(2e-3), rel=0.02)


def test_a_supply_states_the_period_of_its_table():
    times = np.array([0.0, 0.5, 1.0]) * 2 * TURN
    pressure = Curve(PchipInterpolator(times, [1e5, 2e5, 1e5]), periodic=True)
    supply = ehd.HoleSupply(name="inlet", diameter=5e-3, resistance=1e12, curve=pressure)
    film = make_film((26, 8))
    film = ehd.Film(replace(film.parameters, feeds=(supply,)))
    mechanism = in_bearing(film, {"load": steady(0.0, -300.0)})
    assert [key for key, _ in mechanism.variations()] == ["joints.bearing.supply.inlet"]
    with pytest.raises(ehd.errors.SettingsError, match=r"supply\.inlet repeats 0\.5 times"):
        ehd.simulate(mechanism, period=TURN)


def test_a_table_over_the_angle_of_a_body_that_cannot_turn_has_no_rows_in_time():
    # It would be read at the time in place of the angle.
    rows = Curve(PchipInterpolator([0.0, 1e-4, 2e-4], [0.0, 0.0, 1.0]), periodic=False)
    force = ehd.PointForce("sled", (1.0, 0.0), rows, angle_of="ground")
    sled = ehd.Mechanism({"sled": ehd.RigidBody(1.0, 1.0)}, {}, {}, {"push": force})
    assert not ehd.simulate(sled, 1e-2, largest=0.5).bodies["sled"].rates.any()


def test_bodies_state_whether_they_look_the_same_at_every_angle():
    assert ehd.RigidBody(1.0, 1e-3).axisymmetric
    assert not ehd.RigidBody(1.0, 1e-3, centre=(1e-3, 0.0)).axisymmetric
    assert not ehd.MasslessBody({"pin": (0.1, 0.0)}).axisymmetric
    assert ehd.ShaftBody(points={"journal": 0.5}).axisymmetric
