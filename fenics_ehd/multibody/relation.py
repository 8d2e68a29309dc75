"""Constraints and forces between markers, carried to the coordinates by the chain rule.

A relation is written in the values u of a few markers and a joint's own coordinates. What it
means for the coordinates z of a mechanism, ``u = u(z)``, is the same for all of them:

    G = phi_u U,      d(G^T l)/dz = U^T (l . phi_uu) U + sum bend(l . phi_u),
    d(G v)/dz = (phi_uu U v) U + phi_u carry(v).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fenics_ehd.multibody.marker import Marker


@dataclass(frozen=True, eq=False)
class Geometry:
    """``phi(u)`` of m rows and k values with its derivatives.

    Attributes
    ----------
    value, jacobian
        shape (m,), (m, k).
    curvature
        shape (m, k, k); None: phi is linear.
    """

    value: np.ndarray
    jacobian: np.ndarray
    curvature: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Imposed:
    """What ``phi = h(t)`` imposes: ``h`` and ``h'``, shape (m,) each."""

    value: np.ndarray
    rate: np.ndarray


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the values u of some markers, and own coordinates behind them, are and come from.

    Attributes
    ----------
    markers
        Their names.
    sizes
        Values of each marker.
    columns, places
        Of each marker and of the own coordinates, where its values are in u and the coordinates
        they depend on in z.
    """

    markers: tuple[str, ...]
    sizes: tuple[int, ...]
    columns: tuple[slice, ...]
    places: tuple[slice, ...]


class Part(NamedTuple):
    """Values that depend on coordinates: du/dz is the marker's, or 1 for own coordinates."""

    columns: slice
    places: slice
    marker: Marker | None

    def pull(self, rows: np.ndarray) -> np.ndarray:
        """``rows @ du/dz`` for rows of these values, shape (..., n)."""
        return rows if self.marker is None else rows @ self.marker.jacobian

    def move(self, rates: np.ndarray) -> np.ndarray:
        """Rates of these values for the rates of all coordinates."""
        own = rates[self.places]
        return own if self.marker is None else self.marker.jacobian @ own


class Values:
    """Values u of some markers and own coordinates.

    Parameters
    ----------
    layout, markers
        Which, and the markers at an instant.
    z
        All coordinates.

    Attributes
    ----------
    u
        shape (k,).
    parts
        Those that depend on coordinates; what belongs to the ground does not.
    """

    def __init__(self, layout: Layout, markers: list[Marker], z: np.ndarray):
        self.layout = layout
        own = layout.places[-1]
        self.u = np.concatenate([*(marker.values for marker in markers), z[own]])
        self.parts = [
            Part(columns, places, marker)
            for columns, places, marker in zip(
                layout.columns, layout.places, [*markers, None], strict=True
            )
            if places.stop > places.start
        ]

    def rates(self, rates: np.ndarray) -> np.ndarray:
        """``u'`` for the rates of all coordinates, shape (k,)."""
        result = np.zeros(len(self.u))
        for part in self.parts:
            result[part.columns] = part.move(rates)
        return result

    def add_force(self, target: np.ndarray, force: np.ndarray) -> None:
        """Add ``U^T force`` to forces on all coordinates."""
        for part in self.parts:
            target[part.places] += part.pull(force[part.columns])

    def add_bend(self, target: np.ndarray, force: np.ndarray) -> None:
        """Add the derivative of ``U^T force`` to a matrix over all coordinates."""
        for part in self.parts:
            if part.marker is not None and part.marker.bend is not None:
                target[part.places, part.places] += part.marker.bend(force[part.columns])

    def add_form(self, target: np.ndarray, form: np.ndarray) -> None:
        """Add ``U^T form U`` for a form of shape (k, k)."""
        for left in self.parts:
            rows = form[left.columns]
            if not rows.any():
                continue
            half = left.pull(rows.T).T
            for right in self.parts:
                target[left.places, right.places] += right.pull(half[:, right.columns])

    def add_rows(self, target: np.ndarray, rows: np.ndarray) -> None:
        """Add ``rows U`` to rows over all coordinates."""
        for part in self.parts:
            target[:, part.places] += part.pull(rows[:, part.columns])

    def add_carried(self, target: np.ndarray, rows: np.ndarray, rates: np.ndarray) -> None:
        """Add ``rows carry(rates)`` to rows over all coordinates."""
        for part in self.parts:
            if part.marker is not None and part.marker.carry is not None:
                carried = part.marker.carry(rates[part.places])
                target[:, part.places] += rows[:, part.columns] @ carried


@dataclass(frozen=True, eq=False)
class Constraint:
    """One joint's or drive's ``phi(u) = h(t)`` at an instant.

    Attributes
    ----------
    rows
        Its places in g.
    geometry, values, imposed
        See there; nothing imposed: zero.
    """

    rows: slice
    geometry: Geometry
    values: Values
    imposed: Imposed | None = None

    @property
    def defect(self) -> np.ndarray:
        """g, shape (m,)."""
        value = self.geometry.value
        return value if self.imposed is None else value - self.imposed.value

    def add_jacobian(self, target: np.ndarray) -> None:
        """Add to G, shape (all m, all n)."""
        self.values.add_rows(target[self.rows], self.geometry.jacobian)

    def add_bend(self, target: np.ndarray, multipliers: np.ndarray) -> None:
        """Add the derivative of ``G^T l`` for all multipliers, shape (all n, all n)."""
        own = multipliers[self.rows]
        self.values.add_bend(target, own @ self.geometry.jacobian)
        if self.geometry.curvature is not None:
            form = sum(o * c for o, c in zip(own, self.geometry.curvature, strict=True))
            self.values.add_form(target, form)

    def add_carry(self, target: np.ndarray, rates: np.ndarray) -> None:
        """Add the derivative of ``G v``, shape (all m, all n)."""
        rows = target[self.rows]
        self.values.add_carried(rows, self.geometry.jacobian, rates)
        if self.geometry.curvature is not None:
            self.values.add_rows(rows, self.geometry.curvature @ self.values.rates(rates))


@dataclass(frozen=True, eq=False)
class Load:
    """Generalised force on u with its derivatives.

    Attributes
    ----------
    value
        shape (k,).
    position, rate
        Along u and u', shape (k, k); None: zero.
    """

    value: np.ndarray
    position: np.ndarray | None = None
    rate: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Applied:
    """A load and the values that it acts on."""

    load: Load
    values: Values

    def add_derivatives(self, position: np.ndarray, rate: np.ndarray, rates: np.ndarray) -> None:
        """Add the forces' derivatives along coordinates and rates, shape (all n, all n) each."""
        load, values = self.load, self.values
        values.add_bend(position, load.value)
        if load.position is not None:
            values.add_form(position, load.position)
        if load.rate is not None:
            values.add_form(rate, load.rate)
            rows = np.zeros((len(values.u), len(rates)))
            values.add_carried(rows, load.rate, rates)
            for part in values.parts:
                position[part.places] += part.pull(rows[part.columns].T).T

    def power(self, rates: np.ndarray) -> float:
        """[W]."""
        return float(self.load.value @ self.values.rates(rates))
