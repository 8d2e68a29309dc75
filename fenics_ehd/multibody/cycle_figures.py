"""Extremes and means of columns of a history as weights on its steps.

An extreme is that of the parabola through the extreme step and its two neighbours, in a cycle
across its ends. There the curve is level: the extreme's derivative is that of the curve at the
place of the extreme, the derivatives of the three steps with the parabola's weights there. A mean
is the integral of cubics through four steps (`Integrals`).
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.multibody.differentiation import extrapolation_weights
from fenics_ehd.multibody.integrals import last_interval


def extreme_weights(
    times: np.ndarray, values: np.ndarray, period: float | None, sign: int
) -> tuple[np.ndarray, float]:
    """Weights of the largest value of ``sign * values``, and the time there.

    Parameters
    ----------
    times, values
        At the steps, from the start of the run or the cycle, shape (steps,).
    period
        Of a cycle whose last step is its start; None: it does not repeat.
    sign
        1 for a maximum, -1 for a minimum.
    """
    found = np.zeros(len(times))
    k = int(np.argmax(sign * values))
    found[k] = 1.0
    near = np.arange(k - 1, k + 2)
    if len(times) < 3 or (period is None and not 0 < k < len(times) - 1):
        return found, float(times[k])
    turns = near // len(times)
    near = near % len(times)
    t = times[near] + turns * (period or 0.0)
    left, right = np.diff(values[near]) / np.diff(t)
    if left == right:
        return found, float(times[k])
    # The slope is `left` and `right` in the middles of the two intervals, and linear.
    place = 0.5 * (t[0] + t[1]) + 0.5 * (t[2] - t[0]) * left / (left - right)
    found[near] = extrapolation_weights(t, float(np.clip(place, t[0], t[2])))
    return found, float(place % period if period else place)


def mean_weights(times: np.ndarray, period: float | None) -> np.ndarray:
    """Weights of the mean over time, shape (steps,); arguments as of `extreme_weights`."""
    count = len(times)
    if count == 1:
        return np.ones(1)
    # The end of a cycle is its start, too.
    places = np.arange(count) if period is None else np.arange(-1, count)
    own = times if period is None else np.concatenate([[0.0], times])
    found = np.zeros(count)
    for last in range(2, len(own) + 1):
        first = max(0, last - 4)
        np.add.at(found, places[first:last], last_interval(own[first:last]))
    return found / (own[-1] - own[0])
