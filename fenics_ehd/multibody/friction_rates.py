"""Torques and powers of one lubricated joint: what its bodies put into the oil, and what is lost.

The film acts at the journal's centre on both bodies, with a force F on the journal and torques
about that point that are opposite: of the oil's shear, and of the pressure on a journal that is
not round. About the bore's own axis, where a bearing's friction is measured on its housing, the
torque differs by the couple of the eccentric force,

    T_bore = T - (e x F)_z,

T braking the journal, T_bore dragging the bore along. The bodies put into the film

    P = -int p dh/dt dA - Q . xi' - T_shear Omega,

by squeezing it and by shear (`friction`), and oil enters under pressure with P_s. Both leave as
heat: the discrete Reynolds equation tested with its own pressure says

    P + P_s = int h^3 / (12 eta) |grad p|^2 + theta eta U^2 / h dA

at every instant, to what Newton's method leaves; with 8-node elements, whose complementarity is
not that of pressure and flux at a node (11), to the discretisation.
"""

from __future__ import annotations

from fenics_ehd.film import FilmState
from fenics_ehd.film.flow import under_pressure
from fenics_ehd.multibody.film_integrals import FilmIntegrals
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.system import FilmPlace


def friction_rates(place: FilmPlace, step: MechanismStep, film: FilmIntegrals) -> dict[str, float]:
    """Columns of a joint with friction, and perhaps contact, at an accepted step.

    Returns
    -------
    dict
        ``friction_torque_Nm`` brakes the journal about its own axis, ``bore_friction_torque_Nm``
        drags the bore along about its own: called the other way round, the bodies exchange them.
        ``friction_power_W`` and ``dissipated_power_W`` are what is lost, the same whatever the
        bodies are called. Each turning about its own axis in the frame at rest, they put in
        ``journal_friction_power_W`` and ``bore_friction_power_W``; the rest of ``film_power_W``, P,
        squeezes the film. ``supply_power_W`` is P_s, where pressures are given.
    """
    joint, state, found, rate = place.film, film.state, film.friction, step.rate
    force = joint.load[:2] @ state.pressure + found.on_xi[:2]
    # What else brakes the journal belongs here.
    torque = -found.torque - _pressure_torque(place, step, state)
    if film.contact is not None:
        torque += film.contact.braking(film.touch, state.gap)
        force = force + film.contact.forces(film.touch, state.gap)[:2]
    e, speeds, lost = step.x[place.xi[:2]], place.angles(rate), film.dissipated
    bore = torque - float(e[0] * force[1] - e[1] * force[0])
    opening = joint.film.pressure_areas.T @ state.gap.thickness_rate.ravel()
    squeezed = -float(state.pressure @ opening)
    sheared = -float(found.on_xi @ rate[place.xi]) - found.torque * place.ahead(rate)
    rates = {
        "friction_torque_Nm": torque,
        "bore_friction_torque_Nm": bore,
        "friction_power_W": lost,
        "journal_friction_power_W": torque * speeds[0],
        "bore_friction_power_W": -bore * speeds[1],
        "film_power_W": squeezed + sheared + film.rubbed,
        "dissipated_power_W": lost,
    }
    if under_pressure(joint.film):
        rates["supply_power_W"] = film.flows.work
    return rates


def _pressure_torque(place: FilmPlace, step: MechanismStep, film: FilmState) -> float:
    """Of the pressure on a journal that is not round, about its centre [N m]."""
    if place.film.shape is None:
        return 0.0
    turned = place.film.shape.turned(place.ahead(step.x), place.ahead(step.rate))
    return 0.0 if turned is None else float(turned.torque @ film.pressure)
