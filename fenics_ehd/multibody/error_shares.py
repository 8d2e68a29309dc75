"""Errors of extremes, from errors over time, and what they say of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.multibody.error_curves import Change

#: Components of an error, and the settings that make them smaller.
KEYS = {
    "basis": "reduction",
    "film_mesh": "cells",
    "part_mesh": "geometry",
    "step_size": "time.tolerance",
    "start": "time.periodicity",
}
COMPONENTS = tuple(KEYS)

#: Quantities by their names in a summary.
QUANTITIES = ("max_pressure", "min_film_thickness")

#: Said of what cannot be estimated, and of what a run or joint does not have.
NOT_ESTIMATED, NOT_APPLICABLE = "not estimated", "not applicable"

#: Near an extreme the quantity is within this of it.
NEAR = 0.1


@dataclass(frozen=True, eq=False)
class Extreme:
    """Of a joint's peak pressure or thinnest film, as a run says it.

    Attributes
    ----------
    quantity
        ``"max_pressure"`` or ``"min_film_thickness"``.
    joint
        Its number.
    value
        [Pa], [m].
    """

    quantity: str
    joint: int
    value: float

    @property
    def _away(self) -> int:
        """Sign of a value that is further out."""
        return 1 if self.quantity == "max_pressure" else -1

    def curves(self, change: Change) -> tuple[np.ndarray, np.ndarray]:
        """Values of the run and what the exact solution has more, + away from the extreme."""
        if self.quantity == "max_pressure":
            return change.peaks[:, self.joint], change.more_pressure[:, self.joint]
        return -change.films[:, self.joint], -change.more_film[:, self.joint]

    def bias(self, changes: Sequence[Change]) -> float:
        """Relative error of the extreme by all of them together, + where the run says too much."""
        curves = [self.curves(change) for change in changes]
        values = curves[0][0]
        more = np.sum([own for _, own in curves], axis=0)
        moved = float((values + more).max() - values.max()) / abs(self.value)
        return -self._away * moved

    def near(self, change: Change) -> float:
        """Relative root mean square of a change near the extreme."""
        values, more = self.curves(change)
        near = values >= values.max() - NEAR * abs(values.max())
        return float(np.sqrt(np.mean(more[near] ** 2)) / abs(self.value))

    def share(self, change: Change) -> float:
        """Error of the extreme by one component: the mean of what moves it and what moves nearby.

        That an extreme stays as it is while what surrounds it moves is luck.
        """
        return 0.5 * (abs(self.bias([change])) + self.near(change))

    def over(self, change: Change) -> float:
        """Largest relative change: of pressures over their peak, of films place by place."""
        values, more = self.curves(change)
        scale = np.abs(values) if self.quantity == "min_film_thickness" else abs(self.value)
        return float((np.abs(more) / scale).max())


def summed(errors: Mapping[str, Any]) -> dict[str, Any]:
    """Errors by component with their plain sum.

    Errors of one sign add up, and that those of two cancel is luck.

    Returns
    -------
    dict
        Also ``known``, the sum of those that are estimated, and ``total``, which is the same, or
        ``"not estimated"`` where one of them is.
    """
    own = [errors[component] for component in COMPONENTS]
    shares = [error for error in own if not isinstance(error, str)]
    known = float(sum(shares)) if shares else NOT_ESTIMATED
    return {**errors, "known": known, "total": NOT_ESTIMATED if NOT_ESTIMATED in own else known}


def stated(worth: Mapping[str, Any], component: str) -> float | None:
    """The largest error over the cycle by one component of all joints; None: one is not known."""
    errors = [
        own["largest_over_cycle"][quantity][component]
        for own in worth.values()
        for quantity in QUANTITIES
    ]
    if not errors or NOT_ESTIMATED in errors:
        return None
    return max((error for error in errors if not isinstance(error, str)), default=0.0)


def above(worth: Mapping[str, Any], limit: float) -> str:
    """Why figures cannot be trusted of which one is off by more than a limit; usually nothing."""
    errors = {
        (joint, quantity): own[quantity]["known"]
        for joint, own in worth.items()
        for quantity in QUANTITIES
        if not isinstance(own[quantity]["known"], str)
    }
    if not errors or max(errors.values()) <= limit:
        return ""
    joint, quantity = max(errors, key=errors.__getitem__)
    own = worth[joint][quantity]
    worst = max((key for key in COMPONENTS if not isinstance(own[key], str)), key=own.__getitem__)
    return (
        f"untrustworthy: {quantity} of joints.{joint} is off by {100 * own['known']:.3g} %, above "
        f"output.error_limit = {100 * limit:g} %, most of it by the {worst.replace('_', ' ')}: "
        f"see {KEYS[worst]}"
    )
