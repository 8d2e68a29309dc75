"""Mean flow and mean shear of oil between two rough surfaces (Patir and Cheng 1978, 1979).

With ``H = h / sigma``, h the distance of the mean planes and sigma the combined rms roughness of
two Gaussian surfaces without direction (gamma = 1), the mean flow and stress are

    q   = -phi_p h^3 / (12 eta) grad p + V h_T + (U / 2) sigma w phi_s
    tau = phi_f eta U / h,                         of the pressure: phi_fp (h / 2) grad p

with V mean and ``U = v_1 - v_2`` sliding velocity, ``w = (sigma_1^2 - sigma_2^2) / sigma^2``:
the rougher surface takes more oil with it. Factors as they are coded in R. Boman's program
(github.com/rboman/progs, apps/EHD/EHD/ehd_flow_cisail.c: phi_f, phi_fs, phi_fp); phi_p and phi_s
by the coefficients ``C = 0.9, r = 0.56`` and ``A_1 = 1.899, alpha_1 = 0.98, alpha_2 = 0.92,
alpha_3 = 0.05, A_2 = 1.126`` of the papers' tables. They are published for H above 0.5
(phi_fp: 0.75).

``h_T = int_-h^inf (h + s) f(s) ds`` is the mean gap where the surfaces do not touch. It is
positive, however far they overlap. Deep below, where the terms of ``H Phi(H) + f(H)`` cancel, it
is taken from the even part of Laplace's continued fraction of ``Phi(-x) / f(x)``: exact to 6e-12
at H = -4, 3e-14 at -5.

What the Reynolds equation contains is written in `Functions`, for arrays and for symbols.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fenics_ehd.film.lubricant import ARRAYS, Functions

#: H down to which the factors are published.
PUBLISHED = 0.5

#: phi_p = 1 - C exp(-r H).
PRESSURE = 0.9, 0.56

#: phi_s = A_1 H^alpha_1 exp(-alpha_2 H + alpha_3 H^2) up to H = 5, A_2 exp(-H / 4) above.
SHEAR, SHEAR_ABOVE, SHEAR_END = (1.899, 0.98, 0.92, 0.05), 1.126, 5.0

#: phi_fs = A_3 H^alpha_4 exp(-alpha_5 H + alpha_6 H^2) up to H = 7, 0 above.
STRESS, STRESS_END = (11.1, 2.31, 2.38, 0.11), 7.0

#: phi_fp = 1 - D exp(-s H).
STRESS_PRESSURE = 1.4, 0.66

#: Least local film over sigma that phi_f integrates over.
LEAST_FILM = 0.01

#: H above which the closed form of phi_f loses digits, and its series begins.
SERIES_FROM = 30.0


#: H below which h_T is evaluated as a continued fraction, and its levels.
DEEP, LEVELS = -4.0, 10


def mean_gap(ratio: Any, f: Functions = ARRAYS) -> tuple[Any, Any]:
    """``h_T / sigma`` and its derivative: H Phi(H) + f(H) and Phi(H)."""
    density = f.exp(-0.5 * ratio * ratio) / math.sqrt(2 * math.pi)
    share = 0.5 * (1 + f.erf(ratio / math.sqrt(2)))
    deep = ratio < DEEP
    x = -f.where(deep, ratio, DEEP)
    square, tail = x * x, 0.0
    for k in range(LEVELS, 0, -1):
        tail = 2 * k * (2 * k - 1) / (square + (4 * k + 1) - tail)
    below = density / (square + 1 - tail)
    return (
        f.where(deep, below * (1 - tail), ratio * share + density),
        f.where(deep, below * x, share),
    )


def pressure_factor(ratio: Any, f: Functions = ARRAYS) -> Any:
    """phi_p, as published."""
    c, r = PRESSURE
    return 1 - c * f.exp(-r * ratio)


def mobility(ratio: Any, average: Any, continuation: Any, f: Functions = ARRAYS) -> Any:
    """``H^3 phi_p``; below what is published the power of ``h_T / sigma`` that continues it.

    Parameters
    ----------
    ratio, average
        H and ``h_T / sigma``.
    continuation
        See `continuation_below`.
    """
    least, value, power = continuation
    low = average < least
    relative = f.where(low, average / least, 1.0)
    published = ratio * ratio * ratio * pressure_factor(ratio, f)
    return f.where(low, value * relative**power, published)


def continuation_below() -> tuple[float, float, float]:
    """``h_T / sigma`` and mobility at the end of what is published, and the power from there."""
    average, share = mean_gap(PUBLISHED)
    factor, (c, r) = pressure_factor(PUBLISHED), PRESSURE
    slope = r * c * math.exp(-r * PUBLISHED)
    power = average / share * (3 / PUBLISHED + slope / factor)
    return float(average), float(PUBLISHED**3 * factor), float(power)


def shear_factor(ratio: Any, f: Functions = ARRAYS) -> Any:
    """phi_s of a rough on a smooth surface; 0 for H below 0."""
    a, power, decay, growth = SHEAR
    is_open, above = ratio > 0.0, ratio > SHEAR_END
    inside = f.where(is_open, f.where(above, SHEAR_END, ratio), 1.0)
    near = a * inside**power * f.exp(-decay * inside + growth * inside * inside)
    far = SHEAR_ABOVE * f.exp(-0.25 * ratio)
    return f.where(above, far, f.where(is_open, near, 0.0))


def stress_factor(ratio: np.ndarray) -> np.ndarray:
    """``phi_f / H``: the mean of one over the local film, over sigma.

    For heights of the density ``35 / 96 (1 - (s / 3)^2)^3``, films below `LEAST_FILM` left out;
    it goes on without a jump to H = -3, from where on there is no film.
    """
    z = np.asarray(ratio, dtype=float) / 3
    result = np.zeros(z.shape)
    below, far = z <= 1, np.asarray(ratio) > SERIES_FROM
    x = np.clip(z[below], -1 + LEAST_FILM / 3, None)
    polynomial = np.polynomial.polynomial.polyval(x, [-55, 132, 345, -160, -405, 60, 147])
    inside = (1 - x**2) ** 3 * np.log((x + 1) / (LEAST_FILM / 3)) + polynomial / 60
    result[below] = np.maximum(35 / 32 * inside / 3, 0.0)
    above = ~below & ~far
    x = z[above]
    inside = (1 - x**2) ** 3 * np.log((x + 1) / (x - 1)) + x / 15 * (66 + x**2 * (30 * x**2 - 80))
    result[above] = 35 / 32 * inside / 3
    # Moments of the density: 1, 1/9, 1/33 of (s / 3)^0, 2, 4.
    inverse = 1 / z[far] ** 2
    result[far] = (1 + inverse / 9 + inverse**2 / 33 + inverse**3 * 5 / 429) / (3 * z[far])
    return result


def rough_stress_factor(ratio: np.ndarray) -> np.ndarray:
    """``phi_fs / H`` of a rough on a smooth surface; 0 for H below 0."""
    a, power, decay, growth = STRESS
    inside = np.clip(ratio, 0.0, STRESS_END)
    value = a * inside ** (power - 1) * np.exp(-decay * inside + growth * inside**2)
    return np.where(ratio < STRESS_END, value, 0.0)


def stress_pressure_factor(ratio: np.ndarray) -> np.ndarray:
    """phi_fp; 0 where its formula is negative, below H = 0.51."""
    d, s = STRESS_PRESSURE
    return np.maximum(1 - d * np.exp(-s * ratio), 0.0)
