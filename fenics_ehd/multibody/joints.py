"""Ideal joints and drives: constraints between markers, and their derivatives by the chain rule.

A joint names one marker or two, ``"body.point"`` or ``"body"`` for the body's origin. Its
constraints are functions of u: the values of the markers, `WIDTH` each, followed by the
joint's additional coordinates. With the values u of all joints and forces of a mechanism in one
vector, ``U = du/dz``, and constraints ``phi(u) = h(t)``, the derivatives by the coordinates z are

    G = phi_u U,      d(G^T l)/dz = U^T (l . phi_uu) U + sum force_derivative(l . phi_u),
    d(G v)/dz = (phi_uu U v) U + phi_u rate_derivative(v).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import attrs
import numpy as np

from fenics_ehd.base import fields as quantities
from fenics_ehd.base.arguments import require_class, require_number
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import REQUIRED, flag, names, number, pair, text
from fenics_ehd.base.needs import NONE
from fenics_ehd.base.plane import rotation
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.multibody.body import ANGLE, WIDTH
from fenics_ehd.multibody.tabulated import Curve, Variation, variations_of

#: Attributes of joints and forces, and keys in scenes, whose values are names of points or bodies.
POINT_ATTRIBUTES = ("between", "line", "point", "journal", "bore", "body", "angle_of")

#: Attributes of joints and forces whose values are the points at which they act.
ACTING_POINTS = ("between", "point", "journal", "bore")


def named_points(source: object) -> list[tuple[str, str]]:
    """Markers that a joint or force names, as pairs of the attribute's name and the marker.

    A marker is the name of a body, or of a body and its point.
    """
    names: list[tuple[str, str]] = []
    for attribute in POINT_ATTRIBUTES:
        value = getattr(source, attribute, ())
        markers = (value,) if isinstance(value, str) else value
        names += [(attribute, marker) for marker in markers if marker]
    return names


#: Names of the points of every body; None if they are unknown until the body's file is read.
PointNames = Mapping[str, Collection[str] | None]


def require_body(key: str, name: str, points: PointNames) -> None:
    """Refuse the name of a body that does not exist.

    Raises
    ------
    SettingsError
        If no body has this name; the message has the key and the names of all bodies.
    """
    if name not in points:
        known = ", ".join(sorted(points))
        raise SettingsError(f"{key}: there is no body {name!r}: choose from {known}")


def require_point(key: str, marker: str, points: PointNames) -> None:
    """Refuse a marker whose body or point does not exist.

    Raises
    ------
    SettingsError
        If the body or the point does not exist; the message has the key, and the names of all
        bodies or of all points of the body.
    """
    name, dot, point = marker.partition(".")
    require_body(key, name, points)
    known = points[name]
    if dot and known is not None and point not in known:
        hint = f"its points: {', '.join(known)}" if known else "it has none but its origin"
        raise SettingsError(f"{key} = {marker!r}: body {name} has no point {point!r}, {hint}")


def require_two_bodies(key: str, markers: Sequence[str]) -> None:
    """Refuse two markers that are different points of one body.

    Raises
    ------
    SettingsError
        If two markers are different points of one body; the message has the key and both points.
    """
    first: dict[str, str] = {}
    for marker in markers:
        other = first.setdefault(marker.partition(".")[0], marker)
        if other is not marker:
            raise SettingsError(
                f"{key}: {other} and {marker} are points of one body: choose points of two bodies"
            )


def require_single_bores(bores: Mapping[str, str]) -> None:
    """Refuse a bore that belongs to two joints.

    Parameters
    ----------
    bores
        Marker of the bore of every lubricated joint, by name of the joint.

    Raises
    ------
    SettingsError
        If two joints have the same bore; the message names both.
    """
    first: dict[str, str] = {}
    for name, bore in bores.items():
        other = first.setdefault(bore, name)
        if other != name:
            raise SettingsError(
                f"joints.{name}.bore = {bore!r} is the bore of joints.{other} already: a bore "
                "holds one journal; give one of the joints another bore"
            )


def require_turning(key: str, name: str, *, turns: bool) -> None:
    """Refuse a body that cannot turn.

    Raises
    ------
    SettingsError
        If `turns` is false; the message names the key and the body.
    """
    if not turns:
        raise SettingsError(f"{key}: body {name} cannot turn: choose a body that can")


#: Index in u of the first value of a joint's second marker.
SECOND = WIDTH

#: Index in u of the first additional coordinate of a joint with two markers.
ADDITIONAL = 2 * WIDTH


@dataclass(frozen=True, eq=False)
class Geometry:
    """Constraint function ``phi(u)`` of k values u, with m rows, and its derivatives.

    Attributes
    ----------
    value
        Value of phi, shape (m,) [m], [rad].
    jacobian
        Derivative of phi with respect to u, shape (m, k).
    curvature
        Function that computes the second derivatives, shape (m, k, k); None if phi is linear.
    """

    value: np.ndarray
    jacobian: np.ndarray
    curvature: Callable[[], np.ndarray] | None = None


@renamed_attributes(own="additional")
class Joint(Described, ABC):
    """Joint or drive of a mechanism, with m constraints between its markers.

    Attributes
    ----------
    rows
        Number m of constraints.
    additional
        Number of additional coordinates, which belong to the joint and to no body.
    """

    rows: int
    additional = 0

    @property
    @abstractmethod
    def markers(self) -> tuple[str, ...]:
        """Markers whose values the joint constrains."""

    @abstractmethod
    def geometry(self, u: np.ndarray) -> Geometry:
        """Constraint function of the joint and its derivatives, at the values u.

        u, shape (k,), has the values of the joint's markers, then its additional coordinates.
        """

    def imposed(self, time: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Values that the joint imposes on its m constraints at a time [s], and their rates.

        Both have the shape (m,); None if they are zero.
        """
        return None


@cache
def _difference(rows: int) -> np.ndarray:
    """Matrix (rows, k) that subtracts the second of two markers from the first.

    It is applied to the values u of both markers, shape (k,), and gives the differences of their
    first `rows` values.
    """
    return np.eye(rows, 2 * WIDTH) - np.eye(rows, 2 * WIDTH, SECOND)


@attrs.frozen
class Revolute(Joint):
    """Revolute joint: two points coincide, and their bodies turn freely."""

    between: tuple[str, ...] = names(
        "the points, ground.hook or crank (its origin)", REQUIRED, count=2
    )
    rows = 2

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of the two points."""
        return self.between

    def geometry(self, u: np.ndarray) -> Geometry:
        """Constraint function: difference of the positions [m], see `Joint.geometry`."""
        jacobian = _difference(self.rows)
        return Geometry(jacobian @ u, jacobian)


@attrs.frozen
class Fixed(Revolute):
    """Fixed joint: two points coincide, and their bodies keep their relative angle."""

    angle: float = number(0.0, "of the second body relative to the first [degrees]")
    rows = 3

    def geometry(self, u: np.ndarray) -> Geometry:
        """Constraint function: difference of positions and angles, see `Joint.geometry`."""
        jacobian = _difference(self.rows)
        return Geometry(jacobian @ u + np.array([0.0, 0.0, np.radians(self.angle)]), jacobian)


@attrs.frozen
class Slider(Joint):
    """Slider: a point stays on a line that is fixed to another body."""

    line: str = text(REQUIRED, "point through which the line goes, fixed to its body")
    point: str = text(REQUIRED, "point that stays on the line")
    direction: tuple[float, float] = pair(
        "of the line in the frame of its body", (1.0, 0.0), zero=False
    )
    hold_rotation: bool = flag(True, "whether the bodies keep their relative angle")
    angle: float = number(0.0, "held, of the point's body relative to the line's [degrees]")

    @property
    def markers(self) -> tuple[str, ...]:
        """Marker on the line, and marker of the point."""
        return self.line, self.point

    @property
    def rows(self) -> int:  # type: ignore[override]
        """Number of constraints: the distance and, if the rotation is held, the angle."""
        return 2 if self.hold_rotation else 1

    def geometry(self, u: np.ndarray) -> Geometry:
        """Constraint function: distance of the point from the line, see `Joint.geometry`.

        The second row, if the rotation is held, is the change of the relative angle.
        """
        point = slice(SECOND, SECOND + 2)
        along = np.array(self.direction) / np.hypot(*self.direction)
        normal = rotation(u[ANGLE]) @ np.array([-along[1], along[0]])
        normal_rate = np.array([-normal[1], normal[0]])
        offset = u[point] - u[:2]
        value = np.zeros(self.rows)
        value[0] = normal @ offset
        jacobian = np.zeros((self.rows, len(u)))
        jacobian[0, :2] = -normal
        jacobian[0, point] = normal
        jacobian[0, ANGLE] = normal_rate @ offset
        if self.hold_rotation:
            value[1] = u[SECOND + ANGLE] - u[ANGLE] - np.radians(self.angle)
            jacobian[1, ANGLE] = -1.0
            jacobian[1, SECOND + ANGLE] = 1.0

        def curvature() -> np.ndarray:
            result = np.zeros((self.rows, len(u), len(u)))
            result[0, ANGLE, ANGLE] = -value[0]
            result[0, ANGLE, :2] = result[0, :2, ANGLE] = -normal_rate
            result[0, ANGLE, point] = result[0, point, ANGLE] = normal_rate
            return result

        return Geometry(value, jacobian, curvature)


#: Function of time [s] that returns an angle [rad] and an angular speed [rad/s].
AngleOverTime = Callable[[float], tuple[float, float]]


@dataclass(frozen=True)
class AngleDrive(Joint):
    """Drive that imposes the angle of a body as a function of time.

    Attributes
    ----------
    body
        Name of the body.
    motion
        Function of time [s] that returns the angle [rad] and the angular speed [rad/s].
    """

    body: str
    motion: AngleOverTime
    rows = 1

    @property
    def markers(self) -> tuple[str, ...]:
        """Marker of the body that the drive turns."""
        return (self.body,)

    def geometry(self, u: np.ndarray) -> Geometry:
        """Constraint function: angle of the body [rad], see `Joint.geometry`."""
        return Geometry(u[ANGLE : ANGLE + 1], np.eye(1, WIDTH, ANGLE))

    def imposed(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Imposed angle [rad] and angular speed [rad/s] at a time [s], shape (1,) each."""
        angle, speed = self.motion(time)
        return np.array([angle]), np.array([speed])


@attrs.frozen
class Speed(Described):
    """Drive at a given speed, from the angle of the body at the start.

    Attributes
    ----------
    start
        Angle at time zero [rad].
    curve
        Speed over time [rad/s] in place of the constant speed; a scene reads it from `table`.
    """

    speed: float = quantities.speed(0.0, "constant [rad/s]")
    start: float = 0.0
    table: str = text(NONE, "in place of speed: CSV file time_s,speed_rad_per_s, or none")
    curve: Curve | None = None

    def __attrs_post_init__(self) -> None:
        require_number("start", self.start)
        require_class("curve", self.curve, Curve, optional=True)

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variation of the speed over time, see `fenics_ehd.multibody.tabulated.Variation`."""
        return variations_of(self.curve, setting="table")

    def __call__(self, time: float) -> tuple[float, float]:
        """Angle [rad] and angular speed [rad/s] at a time [s]."""
        if self.curve is None:
            return self.start + self.speed * time, self.speed
        return self.start + self.curve.integral(time), self.curve(time)[0]
