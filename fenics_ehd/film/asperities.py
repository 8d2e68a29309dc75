"""Pressure of two rough surfaces whose asperities touch (Greenwood and Tripp 1970).

Asperities are paraboloids of one radius beta, eta of them per area, their heights a Gaussian of
the combined roughness sigma. Elastic contacts of pairs give, h the distance of the surfaces' mean
planes, above which those of the asperities' tips lie by d sigma together,

    p_c = (16 sqrt(2) pi / 15) (eta beta sigma)^2 sqrt(sigma / beta) E' F_5/2(h / sigma - d),
    1 / E' = (1 - nu_1^2) / E_1 + (1 - nu_2^2) / E_2,
    F_n(H) = 1 / sqrt(2 pi) int_H^inf (s - H)^n exp(-s^2 / 2) ds,

and the share ``pi^2 (eta beta sigma)^2 F_2`` of the area in true contact. As ``dF_n / dH`` is
``-n F_(n-1)``, the pressure is minus the slope of a potential ``2 / 7 ... F_7/2``.

``y = F_n`` satisfies ``y'' + H y' - n y = 0``, which gives the Taylor series about any point from
value and slope there. F_7/2 is evaluated by such series about points 1/16 apart, value and slopes
by the trapezoidal rule over ``t = sqrt(s - H)``, where the integrand is even and entire: both are
exact to 1e-12 of the value (`tests/test_asperities.py`). Pressure and its slope are slopes of the
same polynomial, so that the pressure is conservative to round-off.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.special import erfc

#: Asperities are apart: beyond this H the pressure, below 1e-15 of that at H = 0, is zero.
APART = 8.0

#: Least H of the table; what is above it is far below what any model of contact describes.
DEEPEST = -8.0

#: Distance of the points of the table, and the order of the series about them.
SPACING, ORDER = 1.0 / 16.0, 10

#: Step and end of the trapezoidal rule: half the step changes no value by more than 1e-14 of it.
STEP, END = 0.02, 5.0


class Touch(NamedTuple):
    """Contact of nominal gaps: energy per area [J/m2], pressure [Pa], its derivative [Pa/m]."""

    potential: np.ndarray
    pressure: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True)
class Asperities:
    """Elastic asperities of two surfaces.

    Attributes
    ----------
    roughness
        Combined rms height sigma [m].
    density_radius
        eta beta sigma [-].
    slenderness
        sigma / beta [-].
    modulus
        E' as above [Pa].
    offset
        d as above [-], 0 to 2.
    """

    roughness: float
    density_radius: float
    slenderness: float
    modulus: float
    offset: float = 0.0

    def apart(self, gap: np.ndarray) -> np.ndarray:
        """Distance of the mean planes of the tips at nominal gaps [m], over the roughness."""
        return gap / self.roughness - self.offset

    @property
    def strength(self) -> float:
        """Factor of F_5/2 [Pa]."""
        factor = 16 * np.sqrt(2) * np.pi / 15
        return float(factor * self.density_radius**2 * np.sqrt(self.slenderness) * self.modulus)

    def touch(self, gap: np.ndarray) -> Touch:
        """At nominal gaps [m] of any shape."""
        potential, slope, curvature = seven_halves(self.apart(gap))
        scale = self.strength * 2 / 7
        return Touch(
            scale * self.roughness * potential, -scale * slope, -scale / self.roughness * curvature
        )

    def contact_share(self, gap: np.ndarray) -> np.ndarray:
        """Share of the nominal area in true contact, 1 at most."""
        share = np.pi**2 * self.density_radius**2 * _two(self.apart(gap))
        return np.minimum(share, 1.0)


def seven_halves(ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F_7/2 and its first two derivatives, at H of any shape; below `DEEPEST` as there."""
    shape, ratio = np.shape(ratio), np.ravel(ratio)
    found = np.zeros((3, len(ratio)))
    near = np.flatnonzero(ratio < APART)
    if len(near):
        inside = np.maximum(ratio[near], DEEPEST)
        place = np.rint((inside - DEEPEST) / SPACING).astype(int)
        found[:, near] = _series(_table()[place], inside - DEEPEST - SPACING * place)
    return found[0].reshape(shape), found[1].reshape(shape), found[2].reshape(shape)


def _series(coefficients: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Value and two derivatives of polynomials, coefficients (points, k), at x (points,)."""
    value, slope, half = np.zeros((3, len(x)))
    for c in coefficients.T[::-1]:
        half = half * x + slope
        slope = slope * x + value
        value = value * x + c
    return np.stack([value, slope, 2 * half])


@cache
def _table() -> np.ndarray:
    """Taylor coefficients of F_7/2 about the points of the table, shape (points, ORDER + 1)."""
    points = np.arange(DEEPEST, APART + 0.5 * SPACING, SPACING)
    derivatives = [half_order(points, 3), -3.5 * half_order(points, 2)]
    for k in range(ORDER - 1):
        derivatives.append(-points * derivatives[-1] + (3.5 - k) * derivatives[-2])
    factorials = np.cumprod(np.maximum(np.arange(ORDER + 1.0), 1.0))
    return np.ascontiguousarray(np.stack(derivatives, axis=-1) / factorials)


def half_order(ratio: np.ndarray, whole: int) -> np.ndarray:
    """``F_(whole + 1/2)`` at H, shape (points,), by the trapezoidal rule."""
    t = np.arange(STEP, END, STEP)
    height = ratio[:, None] + t**2
    # With s = H + t^2 the integral over t from 0 is half that over the whole line.
    values = 2 * t ** (2 * whole + 2) * np.exp(-0.5 * height**2)
    return STEP * values.sum(axis=1) / np.sqrt(2 * np.pi)


def _two(ratio: np.ndarray) -> np.ndarray:
    """F_2 in closed form; beyond `APART` it is zero, as the pressure is."""
    tail = 0.5 * erfc(ratio / np.sqrt(2))
    density = np.exp(-0.5 * ratio**2) / np.sqrt(2 * np.pi)
    value = (1 + ratio**2) * tail - ratio * density
    return np.where(ratio < APART, np.maximum(value, 0.0), 0.0)
