"""What floats free in the plane keeps momentum, angular momentum and energy.

Momenta are summed over every node of the rod's mesh by its own mass matrix.
"""

from functools import partial

import numpy as np
import pytest
from mechanism_cases import REVOLUTION

import fenics_ehd as ehd
from fenics_ehd.reduction.matrices import MassOperator

DISK = ehd.RigidBody(0.8, 4e-4, centre=(0.002, 0.001), speed=600.0, velocity=(0.2, 0.5))
END = 0.5 * REVOLUTION


KEPT = {"keep_basis": True, "estimate_error": False}
METHODS = {
    "m1": partial(ehd.craig_bampton, n_modes=12, **KEPT),
    "m3": partial(ehd.load_dependent, n_vibration=6, n_residual=12, **KEPT),
}


def rod_momenta(structure, mass, part, place, rates):
    """Momentum (2,) and angular momentum about the origin of all nodes of the elastic rod."""
    x, y, angle = place[:3]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    local = structure.coordinates[:, :2] + (part.columns @ place[3:]).reshape(-1, 3)[:, :2]
    moving = (part.columns @ rates[3:]).reshape(-1, 3)[:, :2]
    at = [x, y] + local @ turn.T
    arm = at - [x, y]
    speed = rates[:2] + rates[2] * np.stack([-arm[:, 1], arm[:, 0]], axis=1) + moving @ turn.T
    velocity = np.zeros((len(at), 3))
    velocity[:, :2] = speed
    momentum = mass.multiply(velocity.reshape(-1, 1)).reshape(-1, 3)[:, :2]
    spin = np.sum(at[:, 0] * momentum[:, 1] - at[:, 1] * momentum[:, 0])
    return np.array([*momentum.sum(axis=0), spin])


def disk_momenta(body, place, rates):
    x, y, angle = place
    cosine, sine = np.cos(angle), np.sin(angle)
    arm = np.array([[cosine, -sine], [sine, cosine]]) @ body.centre
    momentum = body.mass * (rates[:2] + rates[2] * np.array([-arm[1], arm[0]]))
    at = np.array([x, y]) + arm
    spin = body.inertia * rates[2] + at[0] * momentum[1] - at[1] * momentum[0]
    return np.array([*momentum, spin])


def changes(structure, part, result):
    """Largest change of momentum and angular momentum, over the disk's."""
    rows = zip(
        *(
            values
            for name in ("rod", "disk")
            for values in (result.bodies[name].coordinates, result.bodies[name].rates)
        ),
        strict=True,
    )
    mass = MassOperator(structure.mass)
    momenta = np.array(
        [
            rod_momenta(structure, mass, part, rod, rod_rates)
            + disk_momenta(DISK, disk, disk_rates)
            for rod, rod_rates, disk, disk_rates in rows
        ]
    )
    # The first steps are as long as 1e-8 s: their rates are differences of round-off.
    momenta = momenta[result.time > 1e-5]
    own = DISK.mass * np.hypot(*DISK.velocity), DISK.inertia * DISK.speed
    found = np.abs(momenta - momenta[0]).max(axis=0)
    return max(found[:2]) / own[0], found[2] / own[1]


def oil_in(part, friction):
    # Streamers begin and end at points of the film, so that powers are not smooth over time.
    film = ehd.Film(
        ehd.FilmParameters(
            ehd.film_grid(part.pressure_nodes), 17e-6, ehd.Lubricant(0.02), rate=600.0
        )
    )
    return ehd.LubricatedJoint(
        "disk", "rod.bore", film, friction=friction, shear_rule="full",
        eccentricity=(5e-6, 0.0), eccentricity_rate=(0.0, 0.02),
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("method", "friction"), [("m1", True), ("m3", False), ("m3", True)])
def test_a_disk_in_an_elastic_rod_keeps_momenta_and_energy(rod_structure, method, friction, figure):
    part = METHODS[method](rod_structure)
    rod = ehd.FlexibleBody(part, 1e-4, velocity=(0.2, 0.5), speed=-20.0)
    mechanism = ehd.Mechanism({"disk": DISK, "rod": rod}, {"joint": oil_in(part, friction)})
    errors = []
    for tolerance in (1e-5, 1e-7):
        result = ehd.simulate(mechanism, END, tolerance=tolerance, order=3, largest=1.0)
        # Without friction the film exchanges little apart from what it loses at once.
        errors.append(
            (*changes(rod_structure, part, result), result.summary()["energy_balance_error"])
        )
    # As much as the oil does: it brakes the disk, or nothing does.
    braked = result.bodies["disk"].rates[0, 2] - result.bodies["disk"].rates[-1, 2]
    assert braked > 10.0 if friction else abs(braked) < 1.0
    assert result.joints["joint"].max_pressure.max() > 1e7
    # With the tolerance to the power of three fourths, as errors of a formula of order 3 do.
    coarse, fine = np.array(errors)
    assert (coarse / fine).min() > 100**0.75
    figure("mechanisms", "momentum of what floats free, over the disk's", fine[0], most=5e-5)
    figure("mechanisms", "its angular momentum", fine[1], most=1e-6)
    if friction:
        figure("mechanisms", "its energy, over what is exchanged", fine[2], most=2e-5)
    else:
        assert fine[2] < 0.01
