"""Ideal joints and drives as constraints between markers.

Constraints and forces between markers, carried to the coordinates by the chain rule.

A relation is written in values of its own: those of a few markers, then a joint's coordinates.
The values u of all relations stand one behind another, ``U = du/dz``, and for constraints phi(u)

    G = phi_u U,      d(G^T l)/dz = U^T (l . phi_uu) U + sum bend(l . phi_u),
    d(G v)/dz = (phi_uu U v) U + phi_u carry(v).

Ideal joints and drives: relations between markers.

A joint names two markers, ``"body.point"`` or ``"body"`` for its origin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Protocol

import attrs
import numpy as np

from fenics_ehd.base.fields import REQUIRED, flag, names, number, pair, text
from fenics_ehd.base.plane import rotation
from fenics_ehd.multibody.body import ANGLE, Body, Marker
from fenics_ehd.multibody.tabulated import Curve


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
    """Right-hand side of ``phi = h(t)``: ``h`` and ``h'``, shape (m,) each."""

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
    """Places of one relation's values in u, and how many each of its markers has."""

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


class Joint(Protocol):
    """Constraint of a mechanism."""

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of the bodies that it constrains."""

    @property
    def own(self) -> int:
        """Number of own coordinates, behind the markers' values in u."""

    @property
    def rows(self) -> int:
        """Number m of constraints."""

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """``phi`` at values of markers of these sizes."""

    def imposed(self, time: float) -> Imposed | None:
        """``h(t)``; None: zero."""


@cache
def _apart(rows: int, sizes: tuple[int, ...]) -> np.ndarray:
    """The first values of one marker less those of another, shape (rows, k)."""
    return np.eye(rows, sum(sizes)) - np.eye(rows, sum(sizes), sizes[0])


class Pair:
    """Joint between two points: no coordinates, nothing imposed."""

    @property
    def own(self) -> int:
        """Number of own coordinates: none."""
        return 0

    def imposed(self, time: float) -> None:
        """Nothing is imposed over time."""


@attrs.frozen
class Revolute(Pair):
    """Two points that stay together and turn freely."""

    between: tuple[str, ...] = names(
        "the points, ground.hook or crank (its origin)", REQUIRED, count=2
    )
    rows = 2

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of the two points."""
        return self.between

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """Distance of the points, linear, see `Joint`."""
        jacobian = _apart(self.rows, sizes)
        return Geometry(jacobian @ u, jacobian)


@attrs.frozen
class Fixed(Revolute):
    """Two points that stay together and do not turn."""

    angle: float = number(0.0, "of the second body ahead of the first [degrees]")
    rows = 3

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """Distance of the points and their relative angle, see `Joint`."""
        jacobian = _apart(self.rows, sizes)
        return Geometry(jacobian @ u + np.array([0.0, 0.0, np.radians(self.angle)]), jacobian)


@attrs.frozen
class Slider(Pair):
    """A point on a line of another body."""

    line: str = text(REQUIRED, "point through which the line goes, fixed to its body")
    point: str = text(REQUIRED, "point that stays on the line")
    direction: tuple[float, float] = pair(
        "of the line in the frame of its body", (1.0, 0.0), zero=False
    )
    hold_rotation: bool = flag(True, "whether the bodies keep their relative angle")
    angle: float = number(0.0, "held, of the point's body ahead of the line's [degrees]")

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of line and point."""
        return self.line, self.point

    @property
    def rows(self) -> int:
        """Number of constraints: the distance and, where it is held, the angle."""
        return 2 if self.hold_rotation else 1

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """Distance of the point from the line, see `Joint`."""
        other, k = sizes[0], sum(sizes)
        along = np.array(self.direction) / np.hypot(*self.direction)
        normal = rotation(u[ANGLE]) @ np.array([-along[1], along[0]])
        turned = np.array([-normal[1], normal[0]])
        offset = u[other : other + 2] - u[:2]
        value, jacobian = np.zeros(self.rows), np.zeros((self.rows, k))
        there = slice(other, other + 2)
        value[0] = normal @ offset
        jacobian[0, :2], jacobian[0, there], jacobian[0, ANGLE] = -normal, normal, turned @ offset
        if self.hold_rotation:
            value[1] = u[other + ANGLE] - u[ANGLE] - np.radians(self.angle)
            jacobian[1, ANGLE], jacobian[1, other + ANGLE] = -1.0, 1.0

        def curvature() -> np.ndarray:
            result = np.zeros((self.rows, k, k))
            result[0, ANGLE, ANGLE] = -value[0]
            result[0, ANGLE, :2] = result[0, :2, ANGLE] = -turned
            result[0, ANGLE, there] = result[0, there, ANGLE] = turned
            return result

        return Geometry(value, jacobian, curvature)


#: Angle and angular speed at a time [rad], [rad/s].
AngleOverTime = Callable[[float], tuple[float, float]]


@dataclass(frozen=True)
class AngleDrive:
    """A body's angle, given over time."""

    body: str
    motion: AngleOverTime
    own = 0
    rows = 1

    @property
    def markers(self) -> tuple[str, ...]:
        """Marker of the body."""
        return (self.body,)

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """Angle of the body, see `Joint`."""
        return Geometry(u[ANGLE : ANGLE + 1], np.eye(1, sizes[0], ANGLE))

    def imposed(self, time: float) -> Imposed:
        """Angle and speed at a time."""
        angle, speed = self.motion(time)
        return Imposed(np.array([angle]), np.array([speed]))


@dataclass(frozen=True)
class Speed:
    """Constant speed of a body's angle.

    Attributes
    ----------
    speed
        [rad/s].
    start
        Angle at time zero [rad].
    """

    speed: float
    start: float = 0.0

    def __call__(self, time: float) -> tuple[float, float]:
        """Angle and speed at a time."""
        return self.start + self.speed * time, self.speed


@dataclass(frozen=True, eq=False)
class SpeedTable:
    """Speed of a body's angle over time.

    Attributes
    ----------
    speed
        Over time [rad/s].
    start
        Angle at time zero [rad].
    """

    speed: Curve
    start: float = 0.0

    def __call__(self, time: float) -> tuple[float, float]:
        """Angle and speed at a time."""
        return self.start + self.speed.integral(time), self.speed(time)[0]
