"""Equations of motion of a mechanism at one instant, the films' forces left out.

With constraints g and multipliers l on position and m on velocity level (Gear, Gupta and
Leimkuhler 1985),

    z' = v + W G^T m,   F(z, v, v') + G^T l = Q(z, v, t),   g(z, t) = 0,   G v + g_t = 0.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from fenics_ehd.multibody.body import Balance
from fenics_ehd.multibody.inertia_forces import Derivatives
from fenics_ehd.multibody.relation import Geometry, Load, Values
from fenics_ehd.multibody.system import Place, System


class Instant:
    """Markers and constraints of a system at given coordinates.

    Attributes
    ----------
    values
        Of all relations.
    gradient
        Derivative of all constraints along the values, shape (m, k).
    jacobian, defect
        G, shape (m, n), and g, shape (m,).
    imposed_rate
        What ``G v`` has to be: ``-g_t``, shape (m,).
    """

    def __init__(self, system: System, time: float, z: np.ndarray):
        self.system, self.time, self.z = system, time, z
        self.values = Values(system.relations, z)
        gradient, constant, curved = system.linear_constraints
        self.gradient, self.defect = gradient.copy(), gradient @ self.values.u + constant
        self.imposed_rate = np.zeros(system.m)
        self._geometries: list[tuple[Place, Geometry]] = []
        for place in curved:
            rows, layout = place.rows, place.layout
            geometry = place.joint.geometry(self.values.u[layout.columns], layout.sizes)
            self._geometries.append((place, geometry))
            self.gradient[rows, layout.columns] = geometry.jacobian
            self.defect[rows] = geometry.value
        for place in system.constraints:
            imposed = place.joint.imposed(time)
            if imposed is not None:
                self.defect[place.rows] -= imposed.value
                self.imposed_rate[place.rows] = imposed.rate
        self.jacobian = self.gradient @ self.values.jacobian

    @cached_property
    def curvatures(self) -> list[tuple[Place, np.ndarray]]:
        """Constraints that are not linear in the values, and their second derivatives."""
        return [
            (place, geometry.curvature())
            for place, geometry in self._geometries
            if geometry.curvature is not None
        ]

    def rate_defect(self, rates: np.ndarray) -> np.ndarray:
        """``G v + g_t``, shape (m,)."""
        return self.jacobian @ rates - self.imposed_rate

    def form(self, multipliers: np.ndarray) -> np.ndarray:
        """Second derivative of ``multipliers . phi`` along the values, shape (k, k)."""
        result = np.zeros((len(self.values.u),) * 2)
        for place, curvature in self.curvatures:
            own = place.layout.columns
            result[own, own] = multipliers[place.rows] @ curvature.swapaxes(0, 1)
        return result

    def bend(self, multipliers: np.ndarray) -> np.ndarray:
        """Derivative of ``G^T multipliers``, shape (n, n)."""
        return self.values.bend(multipliers @ self.gradient, self.form(multipliers))


class Motion:
    """Equations of motion of a system, the films' forces left out.

    Attributes
    ----------
    instant, rates, accelerations, multipliers
        What they are for: v and v', shape (n,), l, shape (m,).
    value_rates
        ``u'``, shape (k,).
    residual
        ``F + G^T l - Q``, shape (n,).
    """

    def __init__(
        self,
        instant: Instant,
        rates: np.ndarray,
        accelerations: np.ndarray,
        multipliers: np.ndarray,
    ):
        self.instant, self.rates, self.accelerations = instant, rates, accelerations
        self.multipliers = multipliers
        values = instant.values
        self.value_rates = values.jacobian @ rates
        self._applied: list[tuple[slice, Load]] = []
        self._on_values = multipliers @ instant.gradient
        for force, layout in instant.system.forces:
            own = layout.columns
            load = force.load(instant.time, values.u[own], self.value_rates[own], layout.sizes)
            self._applied.append((own, load))
            self._on_values[own] -= load.value
        self.residual = self._on_values @ values.jacobian
        self._balances: list[tuple[slice, Balance]] = []
        system = instant.system
        for places, body, motion in system.each_body(instant.z, rates, accelerations):
            balance = body.balance(*motion, lift=system.lift)
            self.residual[places] += balance.forces
            self._balances.append((places, balance))

    @cached_property
    def _carried(self) -> np.ndarray:
        """Derivative of the values' rates along z, shape (k, n)."""
        return self.instant.values.carry(self.rates)

    def derivatives(self) -> Derivatives:
        """Of the residual along z, v and v', shape (n, n) each."""
        instant, jacobian = self.instant, self.instant.values.jacobian
        form, damping = instant.form(self.multipliers), None
        for own, load in self._applied:
            if load.position is not None:
                form[own, own] -= load.position
            if load.rate is not None:
                damping = np.zeros_like(form) if damping is None else damping
                damping[own, own] -= load.rate
        position = instant.values.bend(self._on_values, form)
        rate, acceleration = np.zeros_like(position), np.zeros_like(position)
        if damping is not None:
            damping = jacobian.T @ damping
            position += damping @ self._carried
            rate += damping @ jacobian
        for places, balance in self._balances:
            parts = balance.derivatives()
            position[places, places] += parts.position
            rate[places, places] += parts.rate
            acceleration[places, places] = parts.acceleration
        return Derivatives(position, rate, acceleration)

    def carry(self) -> np.ndarray:
        """Derivative of ``G v`` along z, shape (m, n)."""
        instant = self.instant
        along = np.zeros_like(instant.gradient)
        for place, curvature in instant.curvatures:
            own = place.layout.columns
            along[place.rows, own] = curvature @ self.value_rates[own]
        return along @ instant.values.jacobian + instant.gradient @ self._carried

    @property
    def drive_power(self) -> float:
        """Power of what is imposed over time [W]."""
        return float(-self.multipliers @ self.instant.imposed_rate)

    @property
    def applied_power(self) -> float:
        """Power of all forces and of gravity [W]."""
        system = self.instant.system
        power = sum(load.value @ self.value_rates[own] for own, load in self._applied)
        if system.lift.any():
            zero, none = np.zeros_like(self.rates), np.zeros(2)
            for _, body, (z, rates, rest) in system.each_body(self.instant.z, self.rates, zero):
                lifted, free = (body.balance(z, rest, rest, lift=g) for g in (system.lift, none))
                power -= (lifted.forces - free.forces) @ rates
        return float(power)
