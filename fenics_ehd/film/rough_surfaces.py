"""Rough surfaces: average gap and flow factors, and the pressure of asperity contact.

**Asperity contact** (Greenwood and Tripp 1970) are paraboloids of one radius beta, eta of them
per area, their heights a Gaussian of the combined roughness sigma. Elastic contacts of pairs give,
h the distance of the surfaces' mean planes, above which those of the asperities' tips lie by d
sigma together,

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

**The gap.** The nominal gap h is the distance of the mean planes. Oil flows in the average gap
``h_T(h)``, which is positive however far the mean planes overlap: it replaces h in the Couette and
squeeze terms (and, without flow factors, in the mobility ``h_T^3``). With flow factors the mobility
is ``h^3 phi_p`` and the mean velocity

    V + (U / 2) sigma w phi_s / h_T,

which is the same flow. Below H = 0.5, where no factor is published, the mobility continues as the
power of h_T that has its value and slope there: our own continuation.

An update or an error of h is compared with ``h_T / (dh_T / dh)``: h itself if the surfaces are
separated, about sigma if they touch.

**Mean flow and mean shear** of oil (Patir and Cheng 1978, 1979). With ``H = h / sigma``, h the
distance of the mean planes and sigma the combined rms roughness of two Gaussian surfaces without
direction (gamma = 1), the mean flow and stress are

    q   = -phi_p h^3 / (12 eta) grad p + V h_T + (U / 2) sigma w phi_s
    tau = phi_f eta U / h,                         of the pressure: phi_fp (h / 2) grad p

with V mean and ``U = v_1 - v_2`` sliding velocity, ``w = (sigma_1^2 - sigma_2^2) / sigma^2``:
the rougher surface drags more oil. The factors are those of R. Boman's program
(github.com/rboman/progs, apps/EHD/EHD/ehd_flow_cisail.c: phi_f, phi_fs, phi_fp); phi_p and phi_s
by the coefficients ``C = 0.9, r = 0.56`` and ``A_1 = 1.899, alpha_1 = 0.98, alpha_2 = 0.92,
alpha_3 = 0.05, A_2 = 1.126`` of the papers' tables. They are published for H above 0.5
(phi_fp: 0.75).

``h_T = int_-h^inf (h + s) f(s) ds`` is the mean gap where the surfaces do not touch. It is
positive, however far they overlap. Deep below, where the terms of ``H Phi(H) + f(H)`` cancel, it
is taken from the even part of Laplace's continued fraction of ``Phi(-x) / f(x)``: exact to 6e-12
at H = -4, 3e-14 at -5.

Terms of the Reynolds equation are written with `Functions`, for arrays and for symbols.
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

#: H down to which the factors are published.
PUBLISHED = 0.5

#: phi_p = 1 - C exp(-r H).
PRESSURE = 0.9, 0.56

#: phi_s = A_1 H^alpha_1 exp(-alpha_2 H + alpha_3 H^2) up to H = 5, A_2 exp(-H / 4) above.
SHEAR = (1.899, 0.98, 0.92, 0.05)
SHEAR_ABOVE = 1.126
SHEAR_END = 5.0

#: phi_fs = A_3 H^alpha_4 exp(-alpha_5 H + alpha_6 H^2) up to H = 7, 0 above.
STRESS = (11.1, 2.31, 2.38, 0.11)
STRESS_END = 7.0

#: phi_fp = 1 - D exp(-s H).
STRESS_PRESSURE = 1.4, 0.66

#: Least local film over sigma in the integral of phi_f.
LEAST_FILM = 0.01

#: H above which the closed form of phi_f loses digits, and its series begins.
SERIES_FROM = 30.0


#: H below which h_T is evaluated as a continued fraction.
DEEP = -4.0

#: Levels of this fraction.
LEVELS = 10


def mean_gap(ratio: Any, f: Functions = ARRAYS) -> tuple[Any, Any]:
    """``h_T / sigma`` and its derivative: H Phi(H) + f(H) and Phi(H)."""
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
    """``h_T / (dh_T / dh)`` of nominal gaps at a combined roughness, all in [m]; above 0."""
    value, share = mean_gap(gap / roughness)
    return roughness * value / np.maximum(share, np.finfo(float).tiny)


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
    factor = pressure_factor(PUBLISHED)
    (c, r) = PRESSURE
    slope = r * c * math.exp(-r * PUBLISHED)
    power = average / share * (3 / PUBLISHED + slope / factor)
    return float(average), float(PUBLISHED**3 * factor), float(power)


def shear_factor(ratio: Any, f: Functions = ARRAYS) -> Any:
    """phi_s of a rough on a smooth surface; 0 for H below 0."""
    a, power, decay, growth = SHEAR
    is_open = ratio > 0.0
    above = ratio > SHEAR_END
    inside = f.where(is_open, f.where(above, SHEAR_END, ratio), 1.0)
    near = a * inside**power * f.exp(-decay * inside + growth * inside * inside)
    far = SHEAR_ABOVE * f.exp(-0.25 * ratio)
    return f.where(above, far, f.where(is_open, near, 0.0))


def stress_factor(ratio: np.ndarray) -> np.ndarray:
    """``phi_f / H``: sigma times the mean of the inverse local film.

    For heights of the density ``35 / 96 (1 - (s / 3)^2)^3``, films below `LEAST_FILM` left out;
    It is continued without a jump to H = -3, below which there is no film.
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


#: H above which the contact pressure is set to zero: it is below 1e-15 of the pressure at H = 0.
APART = 8.0

#: Least H of the table, far below the range of any model of contact.
DEEPEST = -8.0

#: Distance of the points of the table.
SPACING = 1.0 / 16.0

#: Order of the series about these points.
ORDER = 10

#: Step and end of the trapezoidal rule: half the step changes no value by more than 1e-14 of it.
STEP = 0.02
END = 5.0


class AsperityContact(NamedTuple):
    """Contact of nominal gaps: energy per area [J/m2], pressure [Pa], its derivative [Pa/m]."""

    potential: np.ndarray
    pressure: np.ndarray
    slope: np.ndarray


def seven_halves(ratio: np.ndarray) -> np.ndarray:
    """F_7/2 and two derivatives, shape (3, ...), at H of any shape; constant below `DEEPEST`."""
    values = np.zeros((3, *np.shape(ratio)))
    near = ratio < APART
    if near.any():
        inside = np.maximum(ratio[near], DEEPEST) - DEEPEST
        nearest = np.rint(inside / SPACING).astype(int)
        values[:, near] = _series(_table()[nearest], inside - SPACING * nearest)
    return values


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


#: h over sigma at which the model ends: all but 2 % of the surfaces would touch, and neither
#: independent elastic asperities nor a film between them are a valid model.
DEEPEST_CONTACT = -2.0

#: The same limit for iterates of Newton's method.
DEEPEST_ITERATE = -4.0

#: Sliding velocity U_0 [m/s] of ``s(U) = U / sqrt(U^2 + U_0^2)``: at 13 times that boundary
#: friction is 0.3 % below its full size. U_0 makes friction continuous where sliding reverses.
FULL_SLIDING = 1e-3


@renamed_attributes(touch="contact", apart="separation", rubbing="boundary_friction_factor")
@attrs.frozen(kw_only=True, slots=False)
class RoughSurfaces(Roughness):
    """Rough surfaces of a journal and its bore with elastic asperities."""

    modulus: float = number(REQUIRED, "E' of both surfaces, as above [Pa]", above=0)

    @classmethod
    def of(cls, settings: Roughness, modulus: float) -> RoughSurfaces | None:
        """Surfaces of a contact modulus E' [Pa] as settings say; None for smooth ones."""
        values = {field.name: getattr(settings, field.name) for field in attrs.fields(Roughness)}
        return cls(**values, modulus=modulus) if settings.roughness else None

    def separation(self, gap: np.ndarray) -> np.ndarray:
        """Distance of the mean planes of the tips at nominal gaps [m], over the roughness [-]."""
        return gap / self.roughness - self.summit_offset

    @property
    def strength(self) -> float:
        """Factor of F_5/2 [Pa]."""
        factor = 16 * np.sqrt(2) * np.pi / 15
        product = self.asperity_product
        slenderness = self.asperity_slenderness
        return float(factor * product**2 * np.sqrt(slenderness) * self.modulus)

    def contact(self, gap: np.ndarray) -> AsperityContact:
        """Contact of the asperities at nominal gaps [m] of any shape."""
        potential, slope, curvature = seven_halves(self.separation(gap))
        scale = self.strength * 2 / 7
        return AsperityContact(
            scale * self.roughness * potential, -scale * slope, -scale / self.roughness * curvature
        )

    def contact_share(self, gap: np.ndarray) -> np.ndarray:
        """Share of the nominal area in true contact, 1 at most."""
        share = np.pi**2 * self.asperity_product**2 * _two(self.separation(gap))
        return np.minimum(share, 1.0)

    @property
    def weight(self) -> float:
        """w: how much rougher the journal is than the bore, -1 to 1."""
        return (self.journal_roughness**2 - self.bore_roughness**2) / self.roughness**2

    @property
    def dragging(self) -> bool:
        """True if sliding changes the flow, as one surface is rougher than the other."""
        return self.flow_factors and self.weight != 0.0

    def excess(self, thickness: np.ndarray) -> np.ndarray:
        """``h_T - h`` of nominal gaps [m], which is ``h_T(-h)``, free of cancellation."""
        return self.roughness * mean_gap(-thickness / self.roughness)[0]

    def boundary_friction_factor(self, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Boundary friction over contact pressure at sliding velocities [m/s], its derivative."""
        size = np.hypot(speed, FULL_SLIDING)
        mu = self.boundary_friction
        return mu * speed / size, mu * FULL_SLIDING**2 / size**3

    def sheared(self, gap: Gap) -> tuple[np.ndarray, np.ndarray]:
        """Heights of smooth films with the same stress of sliding, and of pressure [m].

        Patir and Cheng's stress on a surface does not contain the pressure on the slopes of its
        roughness. A smooth surface has no slopes: the stress on it, ``phi_f + |w| phi_fs``, acts on
        both surfaces. The pressure acts on both together with ``-h dp/dy``. The part of this stress
        that exceeds ``phi_fp h / 2`` on each surface acts on the slopes, on those of the journal in
        proportion to its roughness.
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
        """``h_T / (dh_T / dh)`` of nominal gaps [m]: above 0 however far they overlap."""
        return length_scale(gap, self.roughness)
