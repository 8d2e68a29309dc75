"""Extremes and means of columns of a history as weights on its steps.

An extreme is that of cubics between the steps with the slopes of parabolas through three steps, in
a cycle across its ends. There the curve is level: the extreme's derivative is that of the curve at
the place of the extreme, the derivatives of the steps with the cubic's weights there. Curve and
slope are continuous, so that neither jumps where the extreme passes a step, as that of parabolas
does (0.3 % of a thinnest film in steps of 6 degrees). A mean is the integral of cubics through four
steps (`Integrals`).
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.multibody.differentiation import derivative_weights
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
    count = len(times)
    found = np.zeros(count)
    k = int(np.argmax(sign * values))
    found[k] = 1.0
    near = np.arange(k - 2, k + 3)
    if period is None:
        near = near[(near >= 0) & (near < count)]
    if count < 5 or k in (near[0], near[-1]):
        return found, float(times[k])
    places = near % count
    t = times[places] + near // count * (period or 0.0)
    here = k - int(near[0])
    slope = _slope_weights(t, here)
    rising = float(slope @ values[places]) * sign
    if rising == 0.0:
        return found, float(times[k])
    first = here if rising > 0.0 else here - 1
    length = t[first + 1] - t[first]
    slopes = [length * (_slope_weights(t, i) if i != here else slope) for i in (first, first + 1)]
    ends = np.eye(len(t))[first : first + 2]
    # Of the cubic in s from 0 to 1, by powers of s.
    rise = ends[1] - ends[0]
    cubic = np.stack(
        [ends[0], slopes[0], 3 * rise - 2 * slopes[0] - slopes[1], slopes[0] + slopes[1] - 2 * rise]
    )
    own = cubic @ values[places]
    level = np.roots([3 * own[3], 2 * own[2], own[1]])
    level = np.clip(level[np.isreal(level)].real, 0.0, 1.0)
    shares = level[:, None] ** np.arange(4)
    best = int(np.argmax(sign * (shares @ own)))
    found[k] = 0.0
    np.add.at(found, places, shares[best] @ cubic)
    place = float(t[first] + level[best] * length)
    return found, place % period if period else place


def _slope_weights(times: np.ndarray, i: int) -> np.ndarray:
    """Weights of the slope at a point, of the parabola through it and its neighbours."""
    middle = min(max(i, 1), len(times) - 2)
    order = [i, *(j for j in (middle - 1, middle, middle + 1) if j != i)]
    found = np.zeros(len(times))
    found[order] = derivative_weights(times[order])
    return found


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
