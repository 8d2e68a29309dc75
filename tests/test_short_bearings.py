"""Short bearings: films that an ordinary differential equation knows in closed form.

The bearings are a tenth as wide as the paper's and the oil a thousand times as viscous, so that
the pressure is the short bearing's (Ocvirk), its positive part,

    p = 6 eta / h^3 (z^2 - B^2 / 4) (h' + w / 2 dh/dphi).

The oracle integrates slider-cranks with it in minimal coordinates by SciPy, as deviations from the
mechanism with ideal joints: nothing of the program is in it.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from mechanism_cases import (
    CRANK,
    REVOLUTION,
    ROD,
    SPEED,
    film,
    rigid_rod,
    short_films,
    slider_crank,
)
from scipy.integrate import solve_ivp

import fenics_ehd as ehd

MASS, INERTIA, CENTRE, PISTON = 0.973, 4e-3, 0.0677, 0.5


@dataclass(frozen=True)
class Short:
    """A short bearing."""

    radius: float
    width: float
    clearance: float
    viscosity: float

    def at(self, place, rate, turning):
        """Force on the journal in the bore's frame [N] and thinnest film [m]."""
        angle = 2 * np.pi * np.arange(400) / 400
        normal = np.stack([np.cos(angle), np.sin(angle)])
        around = np.stack([-normal[1], normal[0]])
        gap = self.clearance - place @ normal
        source = -rate @ normal - 0.5 * turning * (place @ around)
        line = np.maximum(-self.viscosity * self.width**3 * source / gap**3, 0.0)
        return -self.radius * 2 * np.pi / 400 * normal @ line, gap.min()


BIG_END, SMALL_END = Short(22.5e-3, 2.2e-3, 17e-6, 10.0), Short(11e-3, 2e-3, 12e-6, 10.0)


def turned(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


class Rod:
    """Crank at constant speed, a rigid rod in two short bearings, a piston on its line.

    The state is what rod (centre of mass, angle) and piston deviate from the ideal mechanism, and
    its rate: in double precision eccentricities are differences of positions without loss.
    """

    @staticmethod
    def ideal(time):
        """``(x, y, angle, piston)`` with ideal joints, and its first two derivatives."""
        crank, share = SPEED * time, CRANK / ROD
        sine, cosine = -share * np.sin(crank), np.sqrt(1 - (share * np.sin(crank)) ** 2)
        angle = np.arcsin(sine)
        rate = -share * SPEED * np.cos(crank) / cosine
        turning = (share * SPEED**2 * np.sin(crank) + sine * rate**2) / cosine
        pin = CRANK * np.array([np.cos(crank), np.sin(crank)])
        pin_rate = SPEED * CRANK * np.array([-np.sin(crank), np.cos(crank)])
        along, across = np.array([cosine, sine]), np.array([-sine, cosine])
        swing = turning * across - rate**2 * along
        x, v, a = (
            pin + CENTRE * along,
            pin_rate + CENTRE * rate * across,
            (-(SPEED**2) * pin + CENTRE * swing),
        )
        return (
            np.array([*x, angle, (pin + ROD * along)[0]]),
            np.array([*v, rate, (pin_rate + ROD * rate * across)[0]]),
            np.array([*a, turning, (-(SPEED**2) * pin + ROD * swing)[0]]),
        )

    def joints(self, time, state):
        """Forces on the rod, their arms about its centre of mass, and thinnest films."""
        place, rate, _ = self.ideal(time)
        # Differences between nearly equal numbers are taken of deviations alone.
        change, change_rate = state[:4], state[4:]
        angle, speed = place[2] + change[2], rate[2] + change_rate[2]
        turn = turned(angle)
        # Of the rod's arms: turned by the deviation as well, to its full order.
        moved = turn - turned(place[2])
        found = []
        for bearing, arm, journal, journal_rate, turning in (
            (BIG_END, -CENTRE, np.zeros(2), np.zeros(2), SPEED),
            (
                SMALL_END,
                ROD - CENTRE,
                np.array([change[3], 0.0]),
                np.array([change_rate[3], 0.0]),
                0,
            ),
        ):
            apart = journal - change[:2] - arm * moved[:, 0]
            spun = speed * turn[:, 1] - rate[2] * turned(place[2])[:, 1]
            apart_rate = journal_rate - change_rate[:2] - arm * spun
            e = turn.T @ apart
            e_rate = turn.T @ apart_rate - speed * np.array([-e[1], e[0]])
            force, thinnest = bearing.at(e, e_rate, turning - speed)
            # On the rod at the journal's centre.
            found.append((-turn @ force, turn @ [arm, 0.0] + apart, thinnest))
        return found

    def __call__(self, time, state):
        _, _, acceleration = self.ideal(time)
        (big, big_arm, _), (small, small_arm, _) = self.joints(time, state)
        torque = cross(big_arm, big) + cross(small_arm, small)
        motion = np.array([*(big + small) / MASS, torque / INERTIA, -small[0] / PISTON])
        return np.concatenate([state[4:], motion - acceleration])

    def films(self, times):
        """Thinnest films of both ends, shape (2, times) [m]."""
        # Deviations are in micrometres: 1e-12 m is a millionth of the thinnest film.
        exact = solve_ivp(
            self, (0.0, times[-1]), np.zeros(8), "Radau", times, rtol=1e-6,
            atol=np.array([1e-12, 1e-12, 1e-11, 1e-12, 1e-8, 1e-8, 1e-7, 1e-8]), first_step=1e-9,
        )  # fmt: skip
        assert exact.success
        return np.array(
            [[j[2] for j in self.joints(t, y)] for t, y in zip(times, exact.y.T, strict=True)]
        ).T


@pytest.mark.slow
def test_both_ends_of_a_rod_are_lubricated(figure):
    result = ehd.simulate(
        slider_crank(rigid_rod(), *short_films()), REVOLUTION, tolerance=1e-4, order=2
    )
    late = result.time > 2e-4
    exact = Rod().films(result.time[late])
    found = np.array([result.joints[n].min_film_thickness[late] for n in ("big_end", "gudgeon")])
    # What another program gave (DESIGN, fact 6), which the oracle has to give as well.
    assert exact.min(axis=1) == pytest.approx([3.482e-6, 4.456e-6], rel=1e-3)
    assert result.time[late][found[1].argmin()] == pytest.approx(9.73e-3, rel=0.01)
    error = np.abs(found / exact - 1).max()
    figure("mechanisms", "both ends of a rod in short bearings, films over a revolution, against "
           "an ordinary differential equation", error, most=0.01, unit="%")  # fmt: skip


def crank_in_bearings(names, viscosity):
    """The rigid slider-crank, its crank carried by lubricated main bearings of these names."""
    mechanism = slider_crank(rigid_rod(), short_films()[0])
    mains = {
        name: ehd.LubricatedJoint("crank", f"ground.{name}", film(15e-3, 2e-3, 25e-6, viscosity))
        for name in names
    }
    joints = {name: joint for name, joint in mechanism.joints.items() if name != "main"}
    return replace(
        mechanism,
        bodies={**mechanism.bodies, "ground": ehd.ground(dict.fromkeys(names, (0.0, 0.0)))},
        joints={**joints, **mains},
    )


@pytest.mark.slow
def test_two_main_bearings_on_one_crank_are_one_of_double_force(figure):
    steps = {"tolerance": 1e-6, "order": 2}
    two = ehd.simulate(crank_in_bearings(("front", "back"), 20.0), 0.2 * REVOLUTION, **steps)
    one = ehd.simulate(crank_in_bearings(("only",), 40.0), 0.2 * REVOLUTION, **steps)
    late = two.time > 2e-4
    worst = 0.0
    for name, other in (("front", "only"), ("back", "only"), ("big_end", "big_end")):
        expected = np.interp(two.time[late], one.time, one.joints[other].min_film_thickness)
        found = two.joints[name].min_film_thickness[late]
        worst = max(worst, float(np.abs(found / expected - 1).max()))
    figure("mechanisms", "two main bearings on a crank against one of double force, films at a "
           "tolerance of 1e-6", worst, most=1e-3, unit="%")  # fmt: skip
