"""What flows and is lost in a lubricated joint at an accepted step, by column with its unit.

Only what the joint's models have to tell: nothing is computed for a joint without them.
"""

from __future__ import annotations

from fenics_ehd.film import FilmState
from fenics_ehd.multibody.friction_rates import friction_rates
from fenics_ehd.multibody.oil_account import oil_rates
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.system import FilmPlace


def joint_rates(place: FilmPlace, step: MechanismStep, film: FilmState) -> dict[str, float]:
    """Columns of the history whose means over a run, or a cycle, are figures of its summary."""
    rates: dict[str, float] = {}
    if place.film.friction:
        rates |= friction_rates(place, step, film)
    return rates | oil_rates(place, film)
