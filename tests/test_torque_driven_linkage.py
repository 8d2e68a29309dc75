"""A rigid four-bar linkage that a torque moves, against the ordinary differential equation of the
ideal one in its crank's angle."""

import numpy as np
import pytest
from mechanism_cases import film
from scipy.integrate import solve_ivp

from fenics_ehd.multibody.assembly import assemble
from fenics_ehd.multibody.forces import Torque
from fenics_ehd.multibody.joints import Revolute
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.rigid_body import RigidBody, ground
from fenics_ehd.multibody.simulation import simulate
from fenics_ehd.multibody.system import System

CRANK, COUPLER, ROCKER, APART = 0.05, 0.15, 0.12, 0.14
MASSES = {"crank": 0.4, "coupler": 0.8, "rocker": 0.6}
INERTIAS = {"crank": 2e-3, "coupler": 2e-3, "rocker": 1e-3}
GRAVITY, SPEED, END = 9.81, 100.0, 0.08


def motor(time):
    return 3.0 * np.sin(60.0 * time), 180.0 * np.cos(60.0 * time)


def linkage(joint):
    """Its coupler and rocker meet in a joint of one's choice; a motor turns the crank."""
    return Mechanism(
        {
            "ground": ground({"hook": (APART, 0.0)}),
            "crank": RigidBody(
                MASSES["crank"], INERTIAS["crank"], {"tip": (CRANK, 0.0)}, speed=SPEED
            ),
            "coupler": RigidBody(
                MASSES["coupler"], INERTIAS["coupler"], {"tip": (COUPLER, 0.0)},
                centre=(COUPLER / 2, 0.01), position=(CRANK, 0.0),
            ),
            "rocker": RigidBody(
                MASSES["rocker"], INERTIAS["rocker"], {"tip": (ROCKER, 0.0)},
                centre=(ROCKER / 2, 0.0), position=(APART, 0.0), orientation=np.pi / 2,
            ),
        },
        {
            "left": Revolute("ground", "crank"),
            "a": Revolute("crank.tip", "coupler"),
            "b": joint,
            "right": Revolute("ground.hook", "rocker"),
        },
        forces={"motor": Torque("crank", motor)},
        gravity=(0.0, -GRAVITY),
    )  # fmt: skip


def centres(crank):
    """Centres of coupler and rocker and their angles, the rocker's tip above."""
    tip = CRANK * np.exp(1j * crank)
    apart = APART - tip
    reach = abs(apart)
    cosine = (COUPLER**2 + reach**2 - ROCKER**2) / (2 * COUPLER * reach)
    coupler = np.angle(apart) + np.arccos(cosine)
    rocker = np.angle(tip + COUPLER * np.exp(1j * coupler) - APART)
    middle = tip + (COUPLER / 2 + 0.01j) * np.exp(1j * coupler)
    other = APART + ROCKER / 2 * np.exp(1j * rocker)
    return np.array([middle.real, middle.imag, coupler, other.real, other.imag, rocker])


def ideal(times, start):
    """Angle and speed of the crank with ideal joints: ``J a'' + J_a a'^2 / 2 + V_a = torque``."""
    weights = np.array([
        MASSES["coupler"], MASSES["coupler"], INERTIAS["coupler"],
        MASSES["rocker"], MASSES["rocker"], INERTIAS["rocker"],
    ])  # fmt: skip
    step = 1e-4

    def motion(time, state):
        before, now, after = (centres(state[0] + d) for d in (-step, 0.0, step))
        # Angles do not pass their branch cut here.
        along, curved = (after - before) / (2 * step), (after - 2 * now + before) / step**2
        inertia = INERTIAS["crank"] + weights @ along**2
        pull = GRAVITY * (MASSES["coupler"] * along[1] + MASSES["rocker"] * along[4])
        torque = motor(time)[0] - pull - weights @ (along * curved) * state[1] ** 2
        return [state[1], torque / inertia]

    exact = solve_ivp(motion, (0, END), start, "DOP853", times, rtol=1e-10, atol=1e-10)
    return exact.y


def crank_of(mechanism, **steps):
    """Times, angle and speed of the crank, and both at the start, as assembly closes the loop."""
    system = System(mechanism)
    start = [values[system.bodies["crank"]][2] for values in assemble(system)]
    result = simulate(mechanism, END, **steps)
    found = result.bodies["crank"].coordinates[:, 2], result.bodies["crank"].rates[:, 2]
    return result.time, np.array(found), start


@pytest.mark.parametrize("order", [*(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2)), 3])
def test_without_a_film_the_error_falls_with_the_tolerance_as_the_formula_says(order):
    # A step's error of the size of the tolerance leaves steps of its root of order + 1.
    tolerances, errors, counts = [1e-4, 1e-5] if order == 1 else [1e-5, 1e-7], [], []
    for tolerance in tolerances:
        time, found, start = crank_of(
            linkage(Revolute("rocker.tip", "coupler.tip")), tolerance=tolerance, order=order,
            largest=1.0,
        )  # fmt: skip
        exact = ideal(time, start)
        errors.append(np.abs(found[0] - exact[0]).max())
        counts.append(len(time))
    # A turn of the crank, and speeds that differ by half of their mean.
    assert np.ptp(exact[0]) > 2 * np.pi
    assert np.ptp(exact[1]) > 0.5 * exact[1].mean()
    observed = -np.diff(np.log(errors)) / np.diff(np.log(counts))
    assert order - 0.15 < observed < order + 1.1  # it has a share of the next order
    against_tolerance = np.diff(np.log(errors)) / np.diff(np.log(tolerances))
    assert against_tolerance == pytest.approx(order / (order + 1), abs=0.1)
    assert errors[-1] < {1: 0.1, 2: 2e-4, 3: 1e-4}[order]


@pytest.mark.slow
def test_a_film_lets_the_linkage_move_as_the_ideal_one_but_for_its_clearance(figure):
    errors = []
    for clearance in (40e-6, 20e-6, 10e-6):
        # The oil's viscosity keeps the eccentricity ratio.
        oil = film(10e-3, 10e-3, clearance, 0.05 * (clearance / 20e-6) ** 2, (24, 4))
        joint = LubricatedJoint("rocker.tip", "coupler.tip", oil)
        time, found, start = crank_of(linkage(joint), tolerance=1e-6, order=3)
        errors.append(np.abs(found - ideal(time, start)).max(axis=1))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ratios == pytest.approx(2.0, rel=0.03)
    worst = errors[-1][1] / SPEED
    figure("mechanisms", "speed of a lubricated four-bar linkage, clearance 10 um, against the "
           "ideal one's differential equation", worst, most=0.005, unit="%")  # fmt: skip
