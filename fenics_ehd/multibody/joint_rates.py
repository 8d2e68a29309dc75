"""What flows and is lost in a lubricated joint at an accepted step, by column with its unit.

Only what the joint's models have to tell: nothing is computed for a joint without them.
"""

from __future__ import annotations

from fenics_ehd.film import FilmState
from fenics_ehd.multibody.friction import film_friction
from fenics_ehd.multibody.oil_account import oil_rates
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.system import FilmPlace


def joint_rates(place: FilmPlace, step: MechanismStep, film: FilmState) -> dict[str, float]:
    """Columns of the history whose means over a run, or a cycle, are figures of its summary."""
    rates: dict[str, float] = {}
    if place.film.friction:
        # Braking is positive, and the power that the journal's turning puts into the oil.
        torque = -film_friction(place.film, film).torque
        rates["friction_torque_Nm"] = torque
        rates["friction_power_W"] = torque * place.ahead(step.rate)
    return rates | oil_rates(place, film)
