"""What flows and is lost in a lubricated joint at an accepted step, by column with its unit.

Only what the joint's models have to tell: nothing is computed for a joint without them.
"""

from __future__ import annotations

from fenics_ehd.multibody.contact_record import contact_rates
from fenics_ehd.multibody.film_integrals import FilmIntegrals
from fenics_ehd.multibody.friction_rates import friction_rates
from fenics_ehd.multibody.joint_heat import heat_rates
from fenics_ehd.multibody.oil_account import oil_rates
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.system import FilmPlace


def joint_rates(place: FilmPlace, step: MechanismStep, film: FilmIntegrals) -> dict[str, float]:
    """Columns of the history whose means over a run, or a cycle, are figures of its summary."""
    rates: dict[str, float] = {}
    if place.film.friction:
        rates |= friction_rates(place, step, film)
    if film.contact is not None:
        rates |= contact_rates(film.contact, place, film)
    if place.film.film.parameters.feeds:
        flows = film.flows.balance
        rates |= {f"{name}.flow_m3_per_s": flow for name, flow in flows.feeds.items()}
        rates["side_flow_m3_per_s"] = flows.side
    if place.joint.heat is not None:
        rates |= heat_rates(film)
    return rates | oil_rates(place, film)
