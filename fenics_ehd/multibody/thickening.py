"""What is to be said of oil that thickens under pressure without bound, or faster than cells see.

Between rigid surfaces a film of Barus' oil can bear no more than a finite load however fast they
close, see `fenics_ehd.film.piezoviscous`: on the way there pressures rise without bound in a
moment, and no step is short enough. What the solver says of it differs from step to step. A coarse
mesh does not see the peak and goes on with pressures that are its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_ehd.base.errors import SolverError, ViscosityError
from fenics_ehd.film.lubricant import PressureLaw
from fenics_ehd.film.thickening import MOST_WITHIN_A_CELL
from fenics_ehd.multibody.solver_state import SolverState
from fenics_ehd.multibody.system import FilmPlace

#: Ratio of viscosities at the last accepted step beyond which it is the oil that failed. Films that
#: go on reach 1e3 and more in runs, but rarely fail a step there.
THICKENED = 1e2


def unresolved(place: FilmPlace, steepest: float) -> str:
    """What is to be said of an oil that thickens too much within a cell; usually nothing."""
    if steepest <= MOST_WITHIN_A_CELL:
        return ""
    return (
        f"untrustworthy: the oil in {place.name} thickens {steepest:.2g} times within a cell, "
        f"above {MOST_WITHIN_A_CELL:g}: use more joints.{place.name}.cells; where that does not "
        "help the viscosity runs away, lower the load or the pressure coefficient (barus, roelands)"
    )


def told_apart(
    error: SolverError, films: Sequence[FilmPlace], former: SolverState | None
) -> SolverError:
    """The error, or the one of a viscosity that runs away, by the films at the former step."""
    if former is None or isinstance(error, ViscosityError):
        return error
    place = 0
    for film in films:
        size, law = film.film.film.assembly.size, film.film.film.equation.lubricant.viscosity_law
        highest = former.values[0, place : place + size].max()
        place += size
        ratio = _ratio(law, highest)
        if ratio > THICKENED:
            return ViscosityError(
                f"the viscosity of the oil in {film.name} runs away with the pressure: at "
                f"{highest * 1e-6:.4g} MPa it is {ratio:.2g} times that at ambient pressure: lower "
                "the load or the pressure coefficient (barus, roelands)"
            )
    return error


def _ratio(law: PressureLaw, pressure: float) -> float:
    """Of viscosities at a pressure [Pa], infinite beyond all that is computed."""
    try:
        return 1.0 if law.constant else float(law(np.array([pressure]))[0][0])
    except ViscosityError:
        return np.inf
