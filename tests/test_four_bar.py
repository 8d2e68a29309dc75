"""The shipped four-bar linkage, its rocker end ideal or lubricated, against the ideal one.

Under a drive and under a torque: closed forms, and the differential equation in the crank's angle.
"""

from dataclasses import replace

import numpy as np
import pytest
from scene_cases import tables_of
from scipy.integrate import solve_ivp

import fenics_ehd as ehd
from fenics_ehd.multibody.mechanism import System, assemble
from fenics_ehd.scenes.scene import scene_of

CRANK, COUPLER, ROCKER, APART = 0.05, 0.15, 0.12, 0.14
GRAVITY, SPEED, END = 9.81, 100.0, 0.08

#: Masses and inertias that go with `centres`, and the inertia of a free crank.
WEIGHTS = np.array([0.8, 0.8, 2e-3, 0.6, 0.6, 1e-3])
INERTIA = 2e-3

IDEAL = {"joints.rocker_end": {"kind": "revolute", "between": ["rocker.tip", "coupler.tip"]}}
FREE = {
    "drives.crank": {"kind": "torque", "torque": 1.0},
    "bodies.crank.centre": [0.0, 0.0],
    "bodies.crank.inertia": INERTIA,
    "bodies.crank.angle": 26.6,
    "bodies.crank.speed": 83.73,
    "forces.weight": {"kind": "gravity", "acceleration": [0.0, -GRAVITY]},
}


def linkage(*changes):
    """The shipped one, its coupler's centre off the line between its joints."""
    together = {"bodies.coupler.centre": [COUPLER / 2, 0.01]}
    for change in changes:
        together |= change
    return ehd.build(scene_of(tables_of("four-bar", together), "four-bar")).mechanism


def of_clearance(clearance):
    """The oil's viscosity keeps the eccentricity ratio."""
    viscosity = 0.05 * (clearance / 20e-6) ** 2
    return {"joints.rocker_end.clearance": clearance, "lubricants.oil.viscosity": viscosity}


def motor(time):
    return 3.0 * np.sin(60.0 * time), 180.0 * np.cos(60.0 * time)


def free(*changes):
    """A motor turns the crank."""
    return replace(
        linkage(FREE, *changes), forces={"motor": ehd.Torque("crank", curve=motor, over="time")}
    )


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
    step = 1e-4

    def motion(time, state):
        before, now, after = centres(state[0] + step * np.arange(-1, 2)).T
        # Angles do not pass their branch cut here.
        along, curved = (after - before) / (2 * step), (after - 2 * now + before) / step**2
        inertia = INERTIA + WEIGHTS @ along**2
        pull = GRAVITY * (WEIGHTS[0] * along[1] + WEIGHTS[3] * along[4])
        torque = motor(time)[0] - pull - WEIGHTS @ (along * curved) * state[1] ** 2
        return [state[1], torque / inertia]

    # At 1e-10 the round-off of the differences above asks for 45 times as many steps.
    exact = solve_ivp(motion, (0, END), start, "DOP853", times, rtol=1e-9, atol=1e-9)
    return exact.y


def ideal_force(time, step=1e-5):
    """On the rocker in its joint with the coupler, from Newton's and Euler's laws, (2, steps)."""
    before, now, after = (centres(SPEED * (time + d)) for d in (-step, 0.0, step))
    ax, ay, bent, bx, by, swung = (after - 2 * now + before) / step**2
    # Moments about the coupler's joint with the crank and about the rocker's hinge.
    x, y = now[0] - CRANK * np.cos(SPEED * time), now[1] - CRANK * np.sin(SPEED * time)
    coupler = WEIGHTS[2] * bent + WEIGHTS[0] * (x * ay - y * ax)
    rocker = WEIGHTS[5] * swung + WEIGHTS[3] * ((now[3] - APART) * by - now[4] * bx)
    torque = np.array([-coupler / COUPLER, rocker / ROCKER])
    rows = np.array([[-np.sin(angle), np.cos(angle)] for angle in (now[2], now[5])])
    return np.linalg.solve(np.moveaxis(rows, 2, 0), torque.T[:, :, None])[:, :, 0].T


def ideal_energy(time, step=1e-6):
    """Kinetic energy of coupler and rocker, shape (steps,) [J]."""
    rate = (centres(SPEED * (time + step)) - centres(SPEED * (time - step))) / (2 * step)
    return 0.5 * WEIGHTS @ rate**2


# --- Under a drive


@pytest.mark.slow
def test_energy_of_a_four_bar_without_a_film_converges_with_the_step(figure):
    """Over whole turns nothing is lost and nothing stays: the drive's work is the kinetic energy's.

    The distance from the closed form is that of the run's own balance, and of second order.
    """
    mechanism, stated, true = linkage(IDEAL), [], []
    for largest in (0.01, 0.005, 0.0025):
        found = ehd.simulate(
            mechanism, 4 * np.pi / SPEED, tolerance=1.0, order=2, first=1e-6, largest=largest
        )
        energy = ideal_energy(np.asarray(found.time))
        change = energy - energy[0]
        true.append(np.abs(found.run.drive_work - change).max() / np.abs(change).max())
        stated.append(found.summary()["energy_balance_error"])
    assert found.status == "complete"
    np.testing.assert_allclose(stated, true, rtol=0.05)
    rate = np.log2(stated[1] / stated[2])
    figure("mechanisms", "order of a four-bar's energy defect", rate, least=1.8)


@pytest.mark.slow
def test_a_lubricated_four_bar_approaches_the_ideal_one_with_the_clearance():
    cycle = 2 * np.pi / SPEED
    angles, forces = [], []
    for clearance in (20e-6, 5e-6):
        result = ehd.simulate(linkage(of_clearance(clearance)), 1.5 * cycle, order=2)
        late = result.time > 0.5 * cycle
        time = result.time[late]
        angle = result.bodies["rocker"].angle[late]
        angles.append(np.abs(angle - centres(SPEED * time)[5]).max())
        force = ideal_force(time)
        missed = np.linalg.norm(result.joints["rocker_end"].force[late].T - force, axis=0).max()
        forces.append(missed / np.linalg.norm(force, axis=0).max())
    assert angles[0] / angles[1] == pytest.approx(4.0, rel=0.05)
    assert forces[1] < 0.005
    assert forces[1] < 0.5 * forces[0]


# --- Under a torque


def crank_of(mechanism, **steps):
    """Times, angle and speed of the crank, and both at the start, as assembly closes the loop."""
    system = System(mechanism)
    start = [values[system.bodies["crank"]][2] for values in assemble(system)]
    result = ehd.simulate(mechanism, END, **steps)
    found = result.bodies["crank"].coordinates[:, 2], result.bodies["crank"].rates[:, 2]
    return result.time, np.array(found), start


@pytest.mark.parametrize("order", [*(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2)), 3])
def test_without_a_film_the_error_falls_with_the_tolerance_as_the_formula_says(order):
    # A step's error of the size of the tolerance leaves steps of its root of order + 1.
    tolerances, errors, counts = [1e-4, 1e-5] if order == 1 else [1e-5, 1e-7], [], []
    for tolerance in tolerances:
        time, found, start = crank_of(free(IDEAL), tolerance=tolerance, order=order, largest=1.0)
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
        mechanism = free(of_clearance(clearance))
        time, found, start = crank_of(mechanism, tolerance=1e-6, order=3)
        errors.append(np.abs(found - ideal(time, start)).max(axis=1))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ratios == pytest.approx(2.0, rel=0.03)
    worst = errors[-1][1] / SPEED
    figure("mechanisms", "speed of a lubricated four-bar linkage, clearance 10 um, against the "
           "ideal one's differential equation", worst, most=0.005, unit="%")  # fmt: skip
