"""Derivatives at the newest of points in time, blended of two orders.

With ``D_k`` the derivative of the polynomial through the newest and the last k points,

    x' = (1 - b) D_k x + b D_(k+1) x.

For k = 2 and b = 1/2 this is the numerical differentiation formula of Klopfenstein, also known
as BDF2-OPT: like BDF2 it is A-stable at constant steps and damps the high-frequency static modes,
which carry no dynamics, with half the error (Shampine and Reichelt, SIAM J. Sci. Comput. 1997;
Vatsa, Carpenter and Lockard 2010). For k = 3 it is A(82)-stable, BDF3 A(86).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: The formula of order k + 1 is left out while steps grow faster than it is zero-stable for.
BLENDED_GROWTH = {2: 1.55, 3: 1.25}


def derivative_weights(times: np.ndarray) -> np.ndarray:
    """Weights of the derivative, at the first time, of the polynomial through all times."""
    distance, share = times[0] - times[1:], 1.0 / _products(times[:, None] - times)
    weights = np.empty(len(times))
    weights[0] = np.sum(1.0 / distance)
    weights[1:] = share[1:] / (share[0] * distance)
    return weights


def extrapolation_weights(times: np.ndarray, target: float | np.ndarray) -> np.ndarray:
    """Weights of the value at `target` of the polynomial through all points.

    shape (n,), or (n, k) for targets of shape (k, 1).
    """
    ahead = (target - times)[..., None, :]
    return (_products(ahead) / _products(times[:, None] - times)).T


def _products(factors: np.ndarray) -> np.ndarray:
    """Of every row, its diagonal left out; one row stands for all."""
    return np.prod(np.where(np.eye(factors.shape[-1]), 1.0, factors), axis=-1)


@dataclass(frozen=True, eq=False)
class Formula:
    """Weights of the derivative at a new point, that point first, and the share of order k."""

    weights: np.ndarray
    lower: float


def blended(time: float, past: np.ndarray, order: int, blend: float) -> Formula:
    """Formula at a new point.

    Parameters
    ----------
    time, past
        The new point and those before it, newest first [s].
    order
        k, at most the number of past points.
    blend
        b, for k > 1 and where there are points enough.
    """
    times = np.concatenate([[time], past[: order + 1]])
    weights = derivative_weights(times[: order + 1])
    if not blend or order not in BLENDED_GROWTH or len(times) < order + 2:
        return Formula(weights, 1.0)
    if time - times[1] > BLENDED_GROWTH[order] * (times[1] - times[2]):
        return Formula(weights, 1.0)
    higher = blend * derivative_weights(times)
    higher[:-1] += (1 - blend) * weights
    return Formula(higher, 1.0 - blend)
