"""Solution of one time step of a film that conserves its oil, and what it must satisfy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.errors import CavitationError
from fenics_ehd.film.film import FilmState

#: Largest defect of the oil balance: its sum over the nodes, without sign, over the sum of what
#: is dragged through them and of what they hold over the time step.
BALANCE_TOLERANCE = 1e-10

#: Weight gamma of the defect in the equation of the pressures, see
#: `fenics_ehd.film.mass_conserving_solver`. Small, because next to the nodes just emptied the
#: defect has the wrong sign; not below round-off of the void fractions of full nodes over it.
DEFECT_WEIGHT = 1e-6

#: Largest excess of the void fraction over 1.
VOID_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False, kw_only=True)
class OilState(FilmState):
    """Solution of one time step.

    `cavitation` and `problem` belong to the nodes `OilBalance.unknown`;
    `fluid_fraction` is never None.

    Attributes
    ----------
    content
        Oil at the nodes, as volume at ambient density, shape (nodes,) [m^3]: the
        start of the next step.
    outflow
        Flow out of the film where it has an end, negative into it, zero at all
        other nodes, shape (nodes,) [m^3/s].
    time_step
        [s].
    imbalance
        Defect of the oil balance, see `BALANCE_TOLERANCE`.
    """

    fluid_fraction: np.ndarray
    content: np.ndarray
    outflow: np.ndarray
    time_step: float
    imbalance: float


def verify_oil(state: OilState) -> None:
    """Check that no fluid fraction is negative and no oil lost.

    Raises
    ------
    CavitationError
        Naming the violation.
    """
    arrays = {"pressure": state.pressure, "void_fraction": 1 - state.fluid_fraction}
    excess = -float(state.fluid_fraction.min())
    if not excess <= VOID_TOLERANCE:
        raise CavitationError(
            f"the fluid fraction is {-excess:.2e}, below 0 by more than {VOID_TOLERANCE:.0e}: "
            "use cells that are less elongated",
            state=arrays,
        )
    if not state.imbalance <= BALANCE_TOLERANCE:
        raise CavitationError(
            f"the oil balance of the film does not close: defect {state.imbalance:.2e} above "
            f"{BALANCE_TOLERANCE:.0e} of the flow",
            state=arrays,
        )
