"""Rough surfaces: average gap and flow factors of the oil, and pressure of asperity contact.

**Asperity contact** (Greenwood and Tripp 1970). Asperities are paraboloids of radius beta, with eta
of them per area and Gaussian heights; the combined roughness of both surfaces is sigma. The mean
planes of the surfaces are at the distance h. The mean planes of the asperities' tips are closer to
each other, at the distance ``h - d sigma``. Elastic contact of pairs of asperities gives the
contact pressure

    p_c = (16 sqrt(2) pi / 15) (eta beta sigma)^2 sqrt(sigma / beta) E' F_5/2(h / sigma - d),
    1 / E' = (1 - nu_1^2) / E_1 + (1 - nu_2^2) / E_2,
    F_n(H) = 1 / sqrt(2 pi) int_H^inf (s - H)^n exp(-s^2 / 2) ds,

and the share ``pi^2 (eta beta sigma)^2 F_2`` of the area is in true contact. Because ``dF_n / dH =
-n F_(n-1)``, the pressure is minus the slope of a potential, which is proportional to F_7/2.

``y = F_n`` satisfies ``y'' + H y' - n y = 0``, so that value and slope at a point give the Taylor
series about it. F_7/2 is evaluated by series about points at distances of 1/16. Value and slope at
these points are integrated by the trapezoidal rule over ``t = sqrt(s - H)``, because the integrand
is even and entire in t. Both have a relative error of 1e-12 (`tests/test_asperities.py`). Pressure
and its slope are derivatives of the same polynomial, so that the pressure is conservative to
round-off.

**The gap.** The nominal gap h is the distance of the mean planes. Oil flows in the average gap
``h_T(h)``, which is positive for every overlap of the mean planes: it replaces h in the Couette and
squeeze terms (and, without flow factors, in the mobility ``h_T^3``). With flow factors the mobility
is ``h^3 phi_p`` and the mean velocity

    V + (U / 2) sigma w phi_s / h_T,

which gives the mean flow q below. Flow factors are published for H above 0.5. Below, the mobility
is continued as the power of h_T with the same value and slope at H = 0.5; this continuation is not
from the literature.

An update or an error of h is compared with ``h_T / (dh_T / dh)``: h itself if the surfaces are
separated, about sigma if they touch.

**Mean flow and mean shear** of oil (Patir and Cheng 1978, 1979). With ``H = h / sigma`` and the
combined rms roughness sigma of two Gaussian surfaces without direction (gamma = 1), the mean flow
and the stresses are

    q      = -phi_p h^3 / (12 eta) grad p + V h_T + (U / 2) sigma w phi_s
    tau    = phi_f eta U / h                  (of sliding)
    tau_p  = phi_fp (h / 2) grad p            (of the pressure)

with mean velocity V, sliding velocity ``U = v_1 - v_2`` and ``w = (sigma_1^2 - sigma_2^2) /
sigma^2``: the rougher surface drags more oil. phi_f, phi_fs and phi_fp are those of R. Boman's
program (github.com/rboman/progs, apps/EHD/EHD/ehd_flow_cisail.c). phi_p and phi_s have the
coefficients ``C = 0.9, r = 0.56`` and ``A_1 = 1.899, alpha_1 = 0.98, alpha_2 = 0.92, alpha_3 =
0.05, A_2 = 1.126`` of the papers' tables. They are published for H above 0.5 (phi_fp: 0.75).

``h_T = int_-h^inf (h + s) f(s) ds = sigma (H Phi(H) + f(H))`` is the average of the gap where the
surfaces do not touch, with the Gaussian density f of the combined heights and its integral Phi.
For H far below 0 the terms of ``H Phi(H) + f(H)`` cancel. There h_T is computed from the even part
of Laplace's continued fraction of ``Phi(-x) / f(x)``, with a relative error of 6e-12 at H = -4 and
3e-14 at -5.

Factors in the Reynolds equation are written with `Functions`, for arrays and for UFL's symbols.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import attrs
import numpy as np
from scipy.special import erfc

from fenics_ehd.base.fields import REQUIRED, number
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.base.shared_settings import Roughness
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.lubricant import ARRAYS, Functions

#: Smallest H for which the flow factors are published.
PUBLISHED = 0.5

#: Coefficients C and r of phi_p = 1 - C exp(-r H).
PRESSURE = 0.9, 0.56

#: Coefficients of phi_s = A_1 H^alpha_1 exp(-alpha_2 H + alpha_3 H^2) up to H = 5, and A_2 of
#: phi_s = A_2 exp(-H / 4) above.
SHEAR = (1.899, 0.98, 0.92, 0.05)
SHEAR_ABOVE = 1.126
SHEAR_END = 5.0

#: Coefficients of phi_fs = A_3 H^alpha_4 exp(-alpha_5 H + alpha_6 H^2) up to H = 7; it is 0 above.
STRESS = (11.1, 2.31, 2.38, 0.11)
STRESS_END = 7.0

#: Coefficients D and s of phi_fp = 1 - D exp(-s H).
STRESS_PRESSURE = 1.4, 0.66

#: Smallest local film thickness over sigma in the integral of phi_f.
LEAST_FILM = 0.01

#: H above which the closed form of phi_f loses digits, and a series replaces it.
SERIES_FROM = 30.0


#: H below which h_T is computed from a continued fraction.
DEEP = -4.0

#: Number of levels of the continued fraction.
LEVELS = 10


def mean_gap(ratio: Any, f: Functions = ARRAYS) -> tuple[Any, Any]:
    """Average gap ``h_T / sigma = H Phi(H) + f(H)``, and its derivative Phi(H).

    H = `ratio` is the nominal gap over the roughness sigma, f the Gaussian density of the heights,
    and Phi its integral.
    """
    density = f.exp(-0.5 * ratio * ratio) / math.sqrt(2 * math.pi)
    share = 0.5 * (1 + f.erf(ratio / math.sqrt(2)))
    deep = ratio < DEEP
    x = -f.where(deep, ratio, DEEP)
    square = x * x
    tail = 0.0
    for k in range(LEVELS, 0, -1):
        tail = 2 * k * (2 * k - 1) / (square + (4 * k + 1) - tail)
    below = density / (square + 1 - tail)
    return (
        f.where(deep, below * (1 - tail), ratio * share + density),
        f.where(deep, below * x, share),
    )


def length_scale(gap: np.ndarray, roughness: float) -> np.ndarray:
    """Length ``h_T / (dh_T / dh)`` of nominal gaps h, with the average gap h_T [m]; above 0.

    `gap` are the nominal gaps [m], `roughness` is that of both surfaces together [m].
    """
    value, share = mean_gap(gap / roughness)
    return roughness * value / np.maximum(share, np.finfo(float).tiny)


def pressure_factor(ratio: Any, f: Functions = ARRAYS) -> Any:
    """Pressure flow factor phi_p by the published formula, for `ratio`, the gap over roughness."""
    c, r = PRESSURE
    return 1 - c * f.exp(-r * ratio)


def mobility(ratio: Any, average: Any, continuation: Any, f: Functions = ARRAYS) -> Any:
    """Mobility ``H^3 phi_p`` of oil between rough surfaces; below H = 0.5 a power continues it.

    Parameters
    ----------
    ratio, average
        Nominal gap H and average gap ``h_T / sigma``, both over the roughness sigma.
    continuation
        Coefficients of the continuation, see `continuation_below`.
    """
    least, value, power = continuation
    low = average < least
    relative = f.where(low, average / least, 1.0)
    published = ratio * ratio * ratio * pressure_factor(ratio, f)
    return f.where(low, value * relative**power, published)


def continuation_below() -> tuple[float, float, float]:
    """Coefficients with which `mobility` continues the mobility below H = 0.5.

    H is the nominal gap over the roughness. Below 0.5 the mobility is proportional to a power of
    the average gap. The coefficients are the average gap over the roughness at H = 0.5, the
    mobility at H = 0.5, and the power, which gives the mobility the slope of the published formula
    at H = 0.5.
    """
    average, share = mean_gap(PUBLISHED)
    factor = pressure_factor(PUBLISHED)
    (c, r) = PRESSURE
    slope = r * c * math.exp(-r * PUBLISHED)
    power = average / share * (3 / PUBLISHED + slope / factor)
    return float(average), float(PUBLISHED**3 * factor), float(power)


def shear_factor(ratio: Any, f: Functions = ARRAYS) -> Any:
    """Shear flow factor phi_s of a rough surface on a smooth one; 0 for negative gaps.

    `ratio` is the nominal gap over the roughness.
    """
    a, power, decay, growth = SHEAR
    is_open = ratio > 0.0
    above = ratio > SHEAR_END
    inside = f.where(is_open, f.where(above, SHEAR_END, ratio), 1.0)
    near = a * inside**power * f.exp(-decay * inside + growth * inside * inside)
    far = SHEAR_ABOVE * f.exp(-0.25 * ratio)
    return f.where(above, far, f.where(is_open, near, 0.0))


def stress_factor(ratio: np.ndarray) -> np.ndarray:
    """Factor ``phi_f / H`` of the shear stress of sliding, for H = `ratio`, the gap over roughness.

    It is the roughness times the mean of the inverse local film thickness, for heights with the
    density ``35 / 96 (1 - (s / 3)^2)^3``; films thinner than `LEAST_FILM` do not count. It is
    continuous down to H = -3, below which no film remains.
    """
    z = np.asarray(ratio, dtype=float) / 3
    result = np.zeros(z.shape)
    below = z <= 1
    far = np.asarray(ratio) > SERIES_FROM
    x = np.clip(z[below], -1 + LEAST_FILM / 3, None)
    polynomial = np.polynomial.polynomial.polyval(x, [-55, 132, 345, -160, -405, 60, 147])
    inside = (1 - x**2) ** 3 * np.log((x + 1) / (LEAST_FILM / 3)) + polynomial / 60
    result[below] = np.maximum(35 / 32 * inside / 3, 0.0)
    above = ~below & ~far
    x = z[above]
    inside = (1 - x**2) ** 3 * np.log((x + 1) / (x - 1)) + x / 15 * (66 + x**2 * (30 * x**2 - 80))
    result[above] = 35 / 32 * inside / 3
    # The means of (s / 3)^0, (s / 3)^2 and (s / 3)^4 are 1, 1/9 and 1/33.
    inverse = 1 / z[far] ** 2
    result[far] = (1 + inverse / 9 + inverse**2 / 33 + inverse**3 * 5 / 429) / (3 * z[far])
    return result


def rough_stress_factor(ratio: np.ndarray) -> np.ndarray:
    """Factor ``phi_fs / H`` of the shear stress between a rough surface and a smooth one.

    H = `ratio` is the nominal gap over the roughness; the factor is 0 below H = 0.
    """
    a, power, decay, growth = STRESS
    inside = np.clip(ratio, 0.0, STRESS_END)
    value = a * inside ** (power - 1) * np.exp(-decay * inside + growth * inside**2)
    return np.where(ratio < STRESS_END, value, 0.0)


def stress_pressure_factor(ratio: np.ndarray) -> np.ndarray:
    """Factor phi_fp of the shear stress of the pressure gradient on rough surfaces.

    H = `ratio` is the nominal gap over the roughness. The factor is 0 below H = 0.51, at which its
    formula changes sign.
    """
    d, s = STRESS_PRESSURE
    return np.maximum(1 - d * np.exp(-s * ratio), 0.0)


#: H above which the contact pressure is set to zero: it is below 1e-15 of the pressure at H = 0.
APART = 8.0

#: Smallest H of the table of F_7/2, far below the range of any contact model.
DEEPEST = -8.0

#: Distance in H of the points of the table.
SPACING = 1.0 / 16.0

#: Order of the Taylor series about the points of the table.
ORDER = 10

#: Step and end of the trapezoidal rule: half the step changes values by at most 1e-14 of them.
STEP = 0.02
END = 5.0


class AsperityContact(NamedTuple):
    """Asperity contact at nominal gaps h: energy per area, pressure and its slope.

    Attributes
    ----------
    potential
        Elastic energy per area [J/m2].
    pressure
        Contact pressure p_c [Pa].
    slope
        Derivative dp_c/dh [Pa/m].
    """

    potential: np.ndarray
    pressure: np.ndarray
    slope: np.ndarray


def seven_halves(ratio: np.ndarray) -> np.ndarray:
    """Integral F_7/2 of asperity contact and its first two derivatives, shape (3, ...).

    The argument `ratio`, shape (...), is the distance of the asperities' mean planes over the
    roughness. Values below `DEEPEST` are those at `DEEPEST`.
    """
    values = np.zeros((3, *np.shape(ratio)))
    near = ratio < APART
    if near.any():
        inside = np.maximum(ratio[near], DEEPEST) - DEEPEST
        nearest = np.rint(inside / SPACING).astype(int)
        values[:, near] = _series(_table()[nearest], inside - SPACING * nearest)
    return values


def _series(coefficients: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Values and first two derivatives, shape (3, points), of one polynomial per point.

    `coefficients`, shape (points, k), are in ascending order; `x` has the shape (points,).
    """
    value, slope, half = np.zeros((3, len(x)))
    for c in coefficients.T[::-1]:
        half = half * x + slope
        slope = slope * x + value
        value = value * x + c
    return np.stack([value, slope, 2 * half])


@cache
def _table() -> np.ndarray:
    """Taylor coefficients of F_7/2 about evenly spaced points, shape (points, ORDER + 1).

    The points reach from `DEEPEST` to `APART`.
    """
    points = np.arange(DEEPEST, APART + 0.5 * SPACING, SPACING)
    derivatives = [half_order(points, 3), -3.5 * half_order(points, 2)]
    for k in range(ORDER - 1):
        derivatives.append(-points * derivatives[-1] + (3.5 - k) * derivatives[-2])
    factorials = np.cumprod(np.maximum(np.arange(ORDER + 1.0), 1.0))
    return np.ascontiguousarray(np.stack(derivatives, axis=-1) / factorials)


def half_order(ratio: np.ndarray, whole: int) -> np.ndarray:
    """Integral F_n of asperity contact for n = `whole` + 1/2, by the trapezoidal rule.

    The argument `ratio` and the values have the shape (points,).
    """
    t = np.arange(STEP, END, STEP)
    height = ratio[:, None] + t**2
    # With s = H + t^2, the integrand is even in t: the sum over t > 0 is half the sum over all t.
    values = 2 * t ** (2 * whole + 2) * np.exp(-0.5 * height**2)
    return STEP * values.sum(axis=1) / np.sqrt(2 * np.pi)


def _two(ratio: np.ndarray) -> np.ndarray:
    """Integral F_2 of asperity contact, with the argument `ratio`, in closed form.

    It is 0 for arguments above `APART`, like the contact pressure.
    """
    tail = 0.5 * erfc(ratio / np.sqrt(2))
    density = np.exp(-0.5 * ratio**2) / np.sqrt(2 * np.pi)
    value = (1 + ratio**2) * tail - ratio * density
    return np.where(ratio < APART, np.maximum(value, 0.0), 0.0)


#: Smallest h over sigma of a valid step: 98 % of the surfaces would touch, and neither independent
#: elastic asperities nor a film between them are a valid model.
DEEPEST_CONTACT = -2.0

#: Smallest h over sigma of iterates of Newton's method.
DEEPEST_ITERATE = -4.0

#: Sliding velocity U_0 [m/s] in the factor ``U / sqrt(U^2 + U_0^2)`` of boundary friction, which
#: makes friction continuous when sliding reverses. At 13 U_0 friction is 0.3 % below its full
#: value.
FULL_SLIDING = 1e-3


@renamed_attributes(touch="contact", apart="separation", rubbing="boundary_friction_factor")
@attrs.frozen(kw_only=True, slots=False)
class RoughSurfaces(Roughness):
    """Rough surfaces of a journal and its bore with elastic asperities."""

    modulus: float = number(REQUIRED, "E' of both surfaces together [Pa]", above=0)

    @classmethod
    def of(cls, settings: Roughness, modulus: float) -> RoughSurfaces | None:
        """Make rough surfaces from settings and a contact modulus E' [Pa]; None if smooth."""
        values = {field.name: getattr(settings, field.name) for field in attrs.fields(Roughness)}
        return cls(**values, modulus=modulus) if settings.roughness else None

    def separation(self, gap: np.ndarray) -> np.ndarray:
        """Distance of the mean planes of the asperity tips over the roughness [-].

        `gap` are nominal gaps [m].
        """
        return gap / self.roughness - self.summit_offset

    @property
    def strength(self) -> float:
        """Factor of the integral F_5/2 in Greenwood and Tripp's contact pressure [Pa]."""
        factor = 16 * np.sqrt(2) * np.pi / 15
        product = self.asperity_product
        slenderness = self.asperity_slenderness
        return float(factor * product**2 * np.sqrt(slenderness) * self.modulus)

    def contact(self, gap: np.ndarray) -> AsperityContact:
        """Asperity contact at nominal gaps [m], an array of any shape."""
        potential, slope, curvature = seven_halves(self.separation(gap))
        scale = self.strength * 2 / 7
        return AsperityContact(
            scale * self.roughness * potential, -scale * slope, -scale / self.roughness * curvature
        )

    def contact_share(self, gap: np.ndarray) -> np.ndarray:
        """Share of the nominal area in true contact at nominal gaps [m], at most 1."""
        share = np.pi**2 * self.asperity_product**2 * _two(self.separation(gap))
        return np.minimum(share, 1.0)

    @property
    def weight(self) -> float:
        """Weight ``w = (sigma_1^2 - sigma_2^2) / sigma^2`` of the shear flow [-].

        sigma_1 is the roughness of the journal, sigma_2 that of the bore, sigma the combined one.
        """
        return (self.journal_roughness**2 - self.bore_roughness**2) / self.roughness**2

    @property
    def dragging(self) -> bool:
        """Whether sliding adds a flow of oil: flow factors are on, and roughnesses differ."""
        return self.flow_factors and self.weight != 0.0

    def excess(self, thickness: np.ndarray) -> np.ndarray:
        """Average gap less nominal gap [m], computed as ``h_T(-h)`` without cancellation."""
        return self.roughness * mean_gap(-thickness / self.roughness)[0]

    def boundary_friction_factor(self, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shear stress of boundary friction over contact pressure [-], and its derivative [s/m].

        The derivative is that with respect to `speed`, the sliding velocity [m/s].
        """
        size = np.hypot(speed, FULL_SLIDING)
        mu = self.boundary_friction
        return mu * speed / size, mu * FULL_SLIDING**2 / size**3

    def sheared(self, gap: Gap) -> tuple[np.ndarray, np.ndarray]:
        """Thicknesses of two smooth films that have the shear stress of the rough film [m].

        The first has the same stress of sliding, the second the same stress of the pressure
        gradient.

        Patir and Cheng's stress on a surface does not contain the force of the pressure on the
        slopes of its roughness. A smooth surface has no slopes: the stress of sliding on it,
        ``phi_f + |w| phi_fs``, acts on both surfaces. The stresses of the pressure gradient on the
        two surfaces have the sum ``-h dp/dy``. Patir and Cheng's stresses are ``-phi_fp (h / 2)
        dp/dy`` on each surface. The remainder of the sum acts on the slopes of both surfaces, in
        proportion to the squared roughness of each.
        """
        ratio = gap.thickness / self.roughness
        if not self.flow_factors:
            average = self.roughness * mean_gap(ratio)[0]
            return average, average
        inverse = stress_factor(ratio)
        if self.weight:
            inverse = inverse + abs(self.weight) * rough_stress_factor(ratio)
        on_slopes = 1.0 - stress_pressure_factor(ratio)
        deep = gap.thickness * (1.0 + self.weight * on_slopes)
        return self.roughness / np.maximum(inverse, np.finfo(float).tiny), deep

    def length(self, gap: np.ndarray) -> np.ndarray:
        """Length to which changes of nominal gaps are compared [m].

        It is ``h_T / (dh_T / dh)`` with the average gap h_T of the nominal gap h, and is positive
        even if the mean planes overlap.
        """
        return length_scale(gap, self.roughness)
