"""Ideal joints and drives: relations between markers.

A joint names two markers, ``"body.point"`` or ``"body"`` for its origin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.plane import rotation
from fenics_ehd.multibody.marker import ANGLE
from fenics_ehd.multibody.relation import Geometry, Imposed
from fenics_ehd.multibody.tabulated import Curve


class Joint(Protocol):
    """What constrains a mechanism."""

    @property
    def markers(self) -> tuple[str, ...]:
        """Of which bodies."""

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


@dataclass(frozen=True)
class Pair:
    """What joints between two points have in common: no coordinates, nothing imposed."""

    first: str
    second: str

    @property
    def markers(self) -> tuple[str, ...]:
        """See `Joint`."""
        return self.first, self.second

    @property
    def own(self) -> int:
        """See `Joint`."""
        return 0

    def imposed(self, time: float) -> None:
        """See `Joint`."""


@dataclass(frozen=True)
class Revolute(Pair):
    """Two points that stay together and turn freely."""

    rows = 2

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """See `Joint`."""
        jacobian = _apart(self.rows, sizes)
        return Geometry(jacobian @ u, jacobian)


@dataclass(frozen=True)
class Fixed(Pair):
    """Two points that stay together and do not turn: `angle` is the second's ahead [rad]."""

    angle: float = 0.0
    rows = 3

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """See `Joint`."""
        jacobian = _apart(self.rows, sizes)
        return Geometry(jacobian @ u + np.array([0.0, 0.0, self.angle]), jacobian)


@dataclass(frozen=True)
class Slider(Pair):
    """The second point on a line through the first, fixed to the first's body.

    Attributes
    ----------
    first, second
        Markers.
    direction
        Of the line in the first's body, any length.
    hold_rotation
        Whether the bodies keep their relative angle `angle` [rad].
    """

    direction: tuple[float, float] = (1.0, 0.0)
    hold_rotation: bool = True
    angle: float = 0.0

    def __post_init__(self) -> None:
        if not np.hypot(*self.direction) > 0.0:
            raise SettingsError(f"direction = {self.direction} of a slider must have a length")

    @property
    def rows(self) -> int:
        """See `Joint`."""
        return 2 if self.hold_rotation else 1

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """See `Joint`."""
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
            value[1] = u[other + ANGLE] - u[ANGLE] - self.angle
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
        """See `Joint`."""
        return (self.body,)

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """See `Joint`."""
        return Geometry(u[ANGLE : ANGLE + 1], np.eye(1, sizes[0], ANGLE))

    def imposed(self, time: float) -> Imposed:
        """See `Joint`."""
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
