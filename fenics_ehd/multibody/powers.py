"""Energy of a mechanism with films, and the powers that change it."""

from __future__ import annotations

import numpy as np

from fenics_ehd.multibody.bdf import Step
from fenics_ehd.multibody.energy import Powers
from fenics_ehd.multibody.friction import film_friction
from fenics_ehd.multibody.step_equations import StepEquations


def step_powers(equations: StepEquations, step: Step) -> Powers:
    """Energy and the powers that change it, at an accepted step.

    Without friction the oil's drag is what the surfaces' turning feeds into the film from
    outside: no torque of it acts on the bodies. With friction all of the shear does, and the
    film's loss is all that the oil dissipates.
    """
    system, state = equations.system, step.auxiliary
    motion = state.motion
    z, y = np.split(step.x, [system.n])
    rates, y_rates = np.split(step.rate, [system.n])
    kinetic = strain = damping = film = drag = 0.0
    for _, body, (own, own_rates) in system.each_body(z, rates):
        energies = body.energies(own, own_rates)
        kinetic, strain = kinetic + energies.kinetic, strain + energies.strain
        damping += energies.dissipated
    first = 0
    for flexibility, joint, found in zip(
        equations.flexibilities, system.films, state.films, strict=True
    ):
        lost, fed = joint.film.film.powers(found)
        if joint.film.friction:
            lost, fed = lost + film_friction(joint.film, found).sheared, 0.0
        film, drag = film + lost, drag + fed
        if flexibility is not None:
            patterns = slice(first, first + flexibility.size)
            strain += flexibility.energy(y[patterns])
            damping += flexibility.dissipation(y_rates[patterns])
            first += flexibility.size
    return Powers(
        kinetic=kinetic,
        strain=strain,
        drive=motion.drive_power,
        drag=drag,
        film=film,
        damping=damping,
        gas=motion.applied_power,
    )
