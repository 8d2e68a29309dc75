"""Errors of extremes, from errors over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.multibody.error_curves import Change

#: Said of what cannot be estimated, and of what a run or joint does not have.
NOT_ESTIMATED, NOT_APPLICABLE = "not estimated", "not applicable"

#: Near an extreme the quantity is within this of it.
NEAR = 0.1

#: Least error of an extreme over the root mean square of the errors near it: that it stays as it
#: is while what surrounds it moves is luck, and so is it that errors cancel beyond this.
LUCK = 0.4

#: Share of what nodes and steps miss near an extreme that counts among those errors. What they miss
#: of the extreme is added, but may be next to nothing, or cancel what a finer mesh changes: an
#: engine's thinnest film is 0.062 % off, 0.012 % by what moves there, 0.037 % so; with all of it a
#: peak 0.24 % off, known as 0.22 %, would be 0.54 % (`docs/error-budget.md`).
MISSED = 0.75


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

    def curves(self, change: Change) -> tuple[np.ndarray, np.ndarray]:
        """Values of the run and what the exact solution has more, + away from the extreme."""
        if self.quantity == "max_pressure":
            return change.peaks[:, self.joint], change.more_pressure[:, self.joint]
        return -change.films[:, self.joint], -change.more_film[:, self.joint]

    def moved(self, changes: Sequence[Change]) -> float:
        """Relative change of the extreme by all of them."""
        curves = [self.curves(change) for change in changes]
        values = curves[0][0]
        more = np.sum([own for _, own in curves], axis=0)
        return float((values + more).max() - values.max()) / abs(self.value)

    def near(self, change: Change) -> float:
        """Relative root mean square of a change near the extreme."""
        values, more = self.curves(change)
        near = values >= values.max() - NEAR * abs(values.max())
        return float(np.sqrt(np.mean(more[near] ** 2)) / abs(self.value))

    def over(self, change: Change) -> float:
        """Largest relative change: of pressures over their peak, of films place by place."""
        values, more = self.curves(change)
        scale = np.abs(values) if self.quantity == "min_film_thickness" else abs(self.value)
        return float((np.abs(more) / scale).max())


def share(moved: float, near: float) -> float:
    """Error of an extreme by one component."""
    return max(abs(moved), LUCK * near)


def total(values: Mapping[str, Any]) -> float | str:
    """Of components that are known: the root of the sum of their squares."""
    known = [value for value in values.values() if not isinstance(value, str)]
    return float(np.sqrt(np.sum(np.square(known)))) if known else NOT_ESTIMATED


def shares(
    extreme: Extreme,
    changes: Mapping[str, Change],
    sampling: Change,
    start: float | str,
    start_over: float | str,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Errors of an extreme, and the largest over the cycle, by component and in total.

    Parameters
    ----------
    extreme
        Of a run.
    changes
        By component.
    sampling
        What the run's values miss between nodes and steps: known, and part of the film's mesh.
    start, start_over
        Distance from the periodic state, of the extreme and over the cycle, or why there is none.

    Returns
    -------
    values, over
        Of the extreme also ``between_nodes``: what the run's nodes and steps miss of its own curve
        nearby, as root mean square; what they miss of the extreme is part of the film's mesh.
    """
    near = {component: extreme.near(change) for component, change in changes.items()}
    between = extreme.near(sampling)
    whole = dict(changes)
    if "film_mesh" in whole:
        whole["film_mesh"] = whole["film_mesh"].and_also(sampling)
        near["film_mesh"] = float(np.hypot(near["film_mesh"], MISSED * between))
    values: dict[str, Any] = {
        component: share(extreme.moved([change]), near[component])
        for component, change in whole.items()
    }
    over: dict[str, Any] = {name: extreme.over(change) for name, change in whole.items()}
    values["start"], over["start"] = start, start_over
    values["between_nodes"] = between
    over["total"] = total(over)
    values["total"] = NOT_ESTIMATED
    if whole:
        error = share(
            extreme.moved(list(whole.values())), float(np.hypot.reduce(list(near.values())))
        )
        values["total"] = error + (0.0 if isinstance(start, str) else start)
        over["total"] = max(over["total"], values["total"])  # the extreme is of the cycle
    return values, over
