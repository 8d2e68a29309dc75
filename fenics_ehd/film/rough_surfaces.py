"""A film between rough surfaces: what the Reynolds equation sees of the gap, and what touches.

The nominal gap h is the distance of the mean planes. Oil flows in the average gap ``h_T(h)``,
which is positive however far the mean planes overlap: it takes the place of h in the Couette and
squeeze terms (and, without flow factors, in the mobility ``h_T^3``). With flow factors
(`fenics_ehd.film.flow_factors`) the mobility is ``h^3 phi_p`` and the mean velocity

    V + (U / 2) sigma w phi_s / h_T,

which is the same flow. Below H = 0.5, where no factor is published, the mobility goes on as the
power of h_T that has its value and slope there: our own continuation.

An update or an error of h is small beside ``h_T / (dh_T / dh)``: h itself where the surfaces are
apart, about sigma where they touch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film import flow_factors
from fenics_ehd.film.asperities import Asperities
from fenics_ehd.film.kinematics import Gap, GapDerivatives

#: h over sigma at which the model ends: all but 2 % of the surfaces would touch, and neither
#: elastic asperities that do not know of each other nor a film between them are left.
DEEPEST_CONTACT = -2.0

#: The same for iterates on the way to a solution.
DEEPEST_ITERATE = -4.0

#: Sliding velocity U_0 [m/s] of ``s(U) = U / sqrt(U^2 + U_0^2)``: at 13 times that boundary
#: friction is 0.3 % below its full size. It only makes friction a function where sliding reverses.
FULL_SLIDING = 1e-3

#: h_T over sigma above which h is h_T to round-off.
SMOOTH = 8.0


class GapChange(NamedTuple):
    """How the film's gap changes, at the Gauss points, each (cells, points).

    Attributes
    ----------
    thickness
        ``dh_T / dh``.
    rate
        Derivative of ``dh_T / dt`` along h, its rate held [1/s].
    velocity, sliding
        Derivatives of the film's mean velocity along h [1/s] and along U [-].
    """

    thickness: np.ndarray
    rate: np.ndarray
    velocity: np.ndarray
    sliding: np.ndarray


@dataclass(frozen=True)
class RoughSurfaces:
    """Roughness of a journal and its bore.

    Attributes
    ----------
    journal, bore
        rms roughness [m], at least one above 0.
    asperities
        How they touch, of the combined roughness.
    boundary_friction
        Coefficient of friction of touching asperities.
    flow_factors
        Whether the oil's flow and friction follow Patir and Cheng.
    """

    journal: float
    bore: float
    asperities: Asperities
    boundary_friction: float = 0.0
    flow_factors: bool = True

    def __post_init__(self) -> None:
        if not (self.journal >= 0 and self.bore >= 0 and 0 < self.roughness < np.inf):
            raise SettingsError(
                f"roughness = {self.journal:g} m of the journal and {self.bore:g} m of the bore "
                "must be at least 0, one of them above"
            )
        if not abs(self.asperities.roughness - self.roughness) <= 1e-12 * self.roughness:
            raise SettingsError(
                f"roughness of the asperities, {self.asperities.roughness:g} m, must be the "
                f"combined one of both surfaces, {self.roughness:g} m"
            )

    @property
    def roughness(self) -> float:
        """Combined rms roughness sigma [m]."""
        return float(np.hypot(self.journal, self.bore))

    @property
    def weight(self) -> float:
        """w: how much rougher the journal is than the bore, -1 to 1."""
        return (self.journal**2 - self.bore**2) / self.roughness**2

    @property
    def dragging(self) -> bool:
        """Whether sliding surfaces take oil along beside what both carry."""
        return self.flow_factors and self.weight != 0.0

    def average(self, gap: Gap) -> Gap:
        """What the film sees of a nominal gap."""
        ratio = gap.thickness / self.roughness
        value, share, _ = flow_factors.mean_gap(ratio)
        velocity = gap.mean_velocity
        if self.dragging:
            velocity = velocity + gap.sliding_velocity * self._drag(ratio, value)
        return replace(
            gap,
            thickness=self.roughness * value,
            thickness_rate=share * gap.thickness_rate,
            mean_velocity=velocity,
        )

    def excess(self, thickness: np.ndarray) -> np.ndarray:
        """``h_T - h`` of nominal gaps [m], which is ``h_T(-h)``: nothing cancels."""
        return self.roughness * flow_factors.mean_gap(-thickness / self.roughness)[0]

    def _drag(self, ratio: np.ndarray, value: np.ndarray) -> np.ndarray:
        """``sigma w phi_s / (2 h_T)``."""
        return 0.5 * self.weight * flow_factors.shear_factor(ratio)[0] / value

    def change(self, gap: Gap) -> GapChange:
        """Derivatives of `average`."""
        ratio = gap.thickness / self.roughness
        value, share, density = flow_factors.mean_gap(ratio)
        rate = density / self.roughness * gap.thickness_rate
        if not self.dragging:
            none = np.zeros_like(share)
            return GapChange(share, rate, none, none)
        factor, slope = flow_factors.shear_factor(ratio)
        along = 0.5 * self.weight * (slope - factor * share / value) / value
        velocity = gap.sliding_velocity * along / self.roughness
        return GapChange(share, rate, velocity, self._drag(ratio, value))

    def along(self, gap: Gap, derivatives: GapDerivatives) -> GapDerivatives:
        """Changes of the film's gap along those of the nominal one."""
        shape = (*derivatives.thickness.shape[:-1], 1)
        change = GapChange(*(values.reshape(shape) for values in self.change(gap)))
        thickness, sliding = derivatives.thickness, derivatives.sliding_velocity
        velocity = derivatives.mean_velocity + change.velocity * thickness
        if sliding is not None:
            velocity = velocity + change.sliding * sliding
        return GapDerivatives(
            change.thickness * thickness,
            change.thickness * derivatives.thickness_rate + change.rate * thickness,
            velocity,
            sliding,
        )

    def rubbing(self, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Boundary friction over contact pressure at sliding velocities [m/s], its derivative."""
        size = np.hypot(speed, FULL_SLIDING)
        mu = self.boundary_friction
        return mu * speed / size, mu * FULL_SLIDING**2 / size**3

    def sheared(self, gap: Gap) -> tuple[np.ndarray, np.ndarray]:
        """Heights of smooth films with the same stress of sliding, and of pressure [m].

        Patir and Cheng's stress on a surface leaves out what the pressure does to its slopes. On a
        smooth one there is none: what acts there, ``phi_f + |w| phi_fs``, acts on both.
        """
        if not self.flow_factors:
            average = self.average(gap).thickness
            return average, average
        ratio = gap.thickness / self.roughness
        inverse = flow_factors.stress_factor(ratio)
        if self.weight:
            inverse = inverse + abs(self.weight) * flow_factors.rough_stress_factor(ratio)
        deep = gap.thickness * flow_factors.stress_pressure_factor(ratio)
        return self.roughness / np.maximum(inverse, np.finfo(float).tiny), deep

    def length(self, gap: np.ndarray) -> np.ndarray:
        """``h_T / (dh_T / dh)`` of nominal gaps [m]: above 0 however far they overlap."""
        value, share, _ = flow_factors.mean_gap(gap / self.roughness)
        return self.roughness * value / np.maximum(share, np.finfo(float).tiny)

    def conductance(self, clearance: float) -> Callable[[np.ndarray], np.ndarray] | None:
        """Mobility over ``h_T^3`` and its derivative, of h_T over the clearance; None: one."""
        if not self.flow_factors:
            return None
        scale = clearance / self.roughness

        def factor(thickness: np.ndarray) -> np.ndarray:
            value, slope = self._mobility(scale * thickness)
            cube = (scale * thickness) ** 3
            return np.stack([value / cube, scale * slope / cube - 3 * value / cube / thickness])

        return factor

    def _mobility(self, average: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``H^3 phi_p`` and its derivative along ``h_T / sigma``."""
        least, power = self._continuation
        inside = np.maximum(average, least[0])
        ratio = nominal(inside)
        share = flow_factors.mean_gap(ratio)[1]
        factor, slope = flow_factors.pressure_factor(ratio)
        value = ratio**3 * factor
        along = (3 * ratio**2 * factor + ratio**3 * slope) / share
        power_law = least[1] * (average / least[0]) ** power
        low = average < least[0]
        return np.where(low, power_law, value), np.where(low, power * power_law / average, along)

    @cached_property
    def _continuation(self) -> tuple[tuple[float, float], float]:
        """h_T over sigma and mobility at the end of what is published, and the power from there."""
        ratio = np.array(flow_factors.PUBLISHED)
        value, share, _ = flow_factors.mean_gap(ratio)
        factor, slope = flow_factors.pressure_factor(ratio)
        power = value / share * (3 / ratio + slope / factor)
        return (float(value), float(ratio**3 * factor)), float(power)


def nominal(average: np.ndarray) -> np.ndarray:
    """H for ``h_T / sigma`` of at least that of H = 0, by Newton's method: h_T is convex."""
    ratio = np.array(average, dtype=float)
    near = average < SMOOTH
    wanted = average[near]
    # From above, where the slope is largest: every step stays there.
    found = wanted.copy()
    for _ in range(6):
        value, share, _ = flow_factors.mean_gap(found)
        step = (value - wanted) / share
        found -= step
        if not np.any(step > 1e-15 * wanted):
            break
    ratio[near] = found
    return ratio
