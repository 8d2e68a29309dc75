"""Constraints and forces between markers, carried to the coordinates by the chain rule.

A relation is written in values of its own: those of a few markers, then a joint's coordinates.
The values u of all relations stand one behind another, ``U = du/dz``, and for constraints phi(u)

    G = phi_u U,      d(G^T l)/dz = U^T (l . phi_uu) U + sum bend(l . phi_u),
    d(G v)/dz = (phi_uu U v) U + phi_u carry(v).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.marker import Marker


@dataclass(frozen=True, eq=False)
class Geometry:
    """``phi(u)`` of m rows and k values with its derivatives.

    Attributes
    ----------
    value, jacobian
        shape (m,), (m, k).
    curvature
        Makes the second derivatives, shape (m, k, k); None: phi is linear.
    """

    value: np.ndarray
    jacobian: np.ndarray
    curvature: Callable[[], np.ndarray] | None = None


@dataclass(frozen=True, eq=False)
class Imposed:
    """What ``phi = h(t)`` imposes: ``h`` and ``h'``, shape (m,) each."""

    value: np.ndarray
    rate: np.ndarray


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
class Layout:
    """Where the values of one relation are in u, and how many each of its markers has."""

    columns: slice
    sizes: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Seen:
    """A marker that relations see.

    Attributes
    ----------
    body, point
        Whose.
    rough
        The marker in the body's rough pose, which is all there is of a body without coordinates.
    places
        Of the body's coordinates in z.
    columns
        Of the marker's values in u, once for every relation.
    """

    body: Body
    point: str
    rough: Marker
    places: slice
    columns: list[slice] = field(default_factory=list)

    def at(self, z: np.ndarray) -> Marker:
        """The marker at given coordinates."""
        return self.body.marker(self.point, z[self.places])


class Relations:
    """The values u of all relations of a mechanism, as they depend on its coordinates.

    Attributes
    ----------
    size
        Number k of values.
    seen
        Markers by name.
    own
        Columns of joints' own coordinates in u, and their places in z.
    """

    def __init__(self) -> None:
        self.size = 0
        self.seen: dict[str, Seen] = {}
        self.own: list[tuple[slice, slice]] = []
        self._constant: tuple[np.ndarray, np.ndarray] | None = None

    def add(self, markers: Sequence[tuple[str, Body, str, slice]], own: slice) -> Layout:
        """One more relation.

        Parameters
        ----------
        markers
            Name, body, point and places of the body's coordinates in z, of each.
        own
            Places of a joint's own coordinates in z.
        """
        first, sizes = self.size, []
        for name, body, point, places in markers:
            if name not in self.seen:
                self.seen[name] = Seen(body, point, body.marker(point, body.start), places)
            sizes.append(len(self.seen[name].rough.values))
            self.seen[name].columns.append(self._more(sizes[-1]))
        if own.stop > own.start:
            self.own.append((self._more(own.stop - own.start), own))
        return Layout(slice(first, self.size), tuple(sizes))

    @cached_property
    def moving(self) -> list[Seen]:
        """Markers of bodies that have coordinates."""
        return [seen for seen in self.seen.values() if seen.places.stop > seen.places.start]

    def constant(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Values u and their derivative along n coordinates, as far as they never change."""
        if self._constant is None:
            u, jacobian = np.zeros(self.size), np.zeros((self.size, n))
            for seen in self.seen.values():
                for columns in seen.columns:
                    u[columns] = seen.rough.values
            for columns, places in self.own:
                jacobian[columns, places] = np.eye(places.stop - places.start)
            self._constant = u, jacobian
        u, jacobian = self._constant
        return u.copy(), jacobian.copy()

    def _more(self, count: int) -> slice:
        self.size += count
        return slice(self.size - count, self.size)


class Values:
    """Values of all relations at given coordinates.

    Attributes
    ----------
    u, jacobian
        shape (k,), and U, shape (k, n).
    """

    def __init__(self, relations: Relations, z: np.ndarray):
        self.u, self.jacobian = relations.constant(len(z))
        self._markers = [(seen, seen.at(z)) for seen in relations.moving]
        for seen, marker in self._markers:
            for columns in seen.columns:
                self.u[columns] = marker.values
                self.jacobian[columns, seen.places] = marker.jacobian
        for columns, places in relations.own:
            self.u[columns] = z[places]

    def bend(self, force: np.ndarray, form: np.ndarray) -> np.ndarray:
        """Derivative of ``U^T f`` for a force f that changes by `form` along u, shape (n, n)."""
        result = self.jacobian.T @ (form @ self.jacobian)
        for seen, marker in self._markers:
            if marker.bend is not None:
                for columns in seen.columns:
                    result[seen.places, seen.places] += marker.bend(force[columns])
        return result

    def carry(self, rates: np.ndarray) -> np.ndarray:
        """Derivative of ``U v`` for rates v of all coordinates, shape (k, n)."""
        result = np.zeros_like(self.jacobian)
        for seen, marker in self._markers:
            if marker.carry is not None:
                carried = marker.carry(rates[seen.places])
                for columns in seen.columns:
                    result[columns, seen.places] = carried
        return result
