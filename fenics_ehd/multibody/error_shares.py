"""Errors of extremes, from errors over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.multibody.tracking import Extremes

#: Said of what cannot be estimated, and of what a run or joint does not have.
NOT_ESTIMATED, NOT_APPLICABLE = "not estimated", "not applicable"

#: Near an extreme the quantity is within this of it.
NEAR = 0.1


@dataclass(frozen=True, eq=False)
class Change:
    """Estimated error of a component over time: what the exact solution has more.

    Attributes
    ----------
    times
        shape (k,) [s].
    peaks, films
        Values of the run, shape (k, joints) [Pa], [m].
    more_pressure, more_film
        shape (k, joints) [Pa], [m].
    """

    times: np.ndarray
    peaks: np.ndarray
    films: np.ndarray
    more_pressure: np.ndarray
    more_film: np.ndarray


def relative(change: Change, joint: int, quantity: str, extremes: Extremes) -> tuple[float, float]:
    """Error of an extreme with its sign, and the largest over the cycle, relative."""
    if quantity == "max_pressure":
        values, more = change.peaks[:, joint], change.more_pressure[:, joint]
        extreme = extremes.max_pressure
        moved = (values + more).max() - values.max()
        near = values >= (1.0 - NEAR) * values.max()
        over = np.abs(more).max() / extreme
    else:
        values, more = change.films[:, joint], change.more_film[:, joint]
        extreme = extremes.min_film_thickness
        moved = (values + more).min() - values.min()
        near = values <= (1.0 + NEAR) * values.min()
        over = (np.abs(more) / values).max()
    # Where an extreme stays as it is while what surrounds it moves, that is luck.
    least = np.sqrt(np.mean(more[near] ** 2))
    error = np.copysign(max(abs(moved), least), moved)
    return float(error / abs(extreme)), float(over)


def total(values: Mapping[str, Any], together: float = 0.0) -> float | str:
    """Of components that are known, the start among them, and the sum of those with a sign.

    They may cancel, but not beyond half the root of the sum of their squares.
    """
    known = [value for value in values.values() if not isinstance(value, str)]
    if not known:
        return NOT_ESTIMATED
    start = values.get("start", 0.0)
    left = abs(together) + (0.0 if isinstance(start, str) else start)
    spread = float(np.sqrt(np.sum(np.square(known))))
    return max(left, 0.5 * spread) if together else spread
