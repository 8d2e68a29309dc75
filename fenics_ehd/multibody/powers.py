"""Energy of a mechanism with films, and the powers that change it."""

from __future__ import annotations

from fenics_ehd.film.flow import under_pressure
from fenics_ehd.film.shear import full_shear
from fenics_ehd.multibody.energy import Powers
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.step_equations import StepEquations


def step_powers(equations: StepEquations, step: MechanismStep) -> Powers:
    """Energy and the powers that change it, at an accepted step; see `Powers`."""
    system, state = equations.system, step.solution
    motion = state.motion
    z, rates = step.x[: system.n], step.rate[: system.n]
    kinetic = strain = damping = film = drag = unfelt = 0.0
    for _, body, (own, own_rates) in system.each_body(z, rates):
        energies = body.energies(own, own_rates)
        kinetic, strain = kinetic + energies.kinetic, strain + energies.strain
        damping += energies.dissipated
    responses = equations.responses
    for flexibility, places in zip(responses.flexibilities, responses.amplitudes, strict=True):
        strain += flexibility.energy(step.x[places])
        damping += flexibility.dissipation(step.rate[places])
    for place, found in zip(system.films, state.integrals, strict=True):
        lost, fed = found.powers
        lost -= found.flows.refill_work
        if place.film.friction:
            lost, fed = lost + found.friction.sheared, 0.0
        else:
            unfelt += full_shear(place.film.film, found.state)
        if under_pressure(place.film.film):
            fed += found.flows.work
        if found.contact is not None:
            strain += found.contact.stored(found.touch)
            lost += found.rubbed if found.contact.friction else 0.0
        film, drag = film + lost, drag + fed
    return Powers(
        kinetic=kinetic,
        strain=strain,
        drive=motion.drive_power,
        drag=drag,
        film=film,
        damping=damping,
        applied=motion.applied_power,
        unfelt=unfelt,
    )
