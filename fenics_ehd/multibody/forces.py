"""Forces and torques on markers, each with exact derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import attrs
import numpy as np

from fenics_ehd.base import fields as quantities
from fenics_ehd.base.arguments import require_callable, require_class, require_pair
from fenics_ehd.base.fields import REQUIRED, choice, names, number, text
from fenics_ehd.base.needs import NONE, only_with
from fenics_ehd.multibody.body import ANGLE
from fenics_ehd.multibody.joints import SECOND
from fenics_ehd.multibody.tabulated import Variation, variations_of

#: Variables that a torque's table may be over.
BASES = ("angle", "time")

#: Function of the time or of an angle that returns a value and its derivative. A table with rows,
#: which no step may cross, is a `Curve`.
Table = Callable[[float], tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Load:
    """Generalised force on the values u of a force's markers with its derivatives.

    Attributes
    ----------
    value
        Forces and torques, shape (k,) [N], [N m].
    position, rate
        Derivatives along u and along u', shape (k, k); None: zero.
    """

    value: np.ndarray
    position: np.ndarray | None = None
    rate: np.ndarray | None = None


class Force(ABC):
    """Force or torque on the bodies of a mechanism."""

    @property
    @abstractmethod
    def markers(self) -> tuple[str, ...]:
        """Markers that the force acts on or whose values and rates it depends on."""

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variations over the time or over an angle: periods, and tables no step may cross."""
        return ()

    @property
    def turned_body(self) -> str:
        """Body that the force turns by a torque; empty: none."""
        return ""

    @property
    def left_out_of_equilibrium(self) -> str:
        """Description of a force that an equilibrium is computed without; empty: with it."""
        return ""

    @abstractmethod
    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Generalised force on the values u of its markers, at u and its rates."""


@dataclass(frozen=True)
class PointForce(Force):
    """Force of constant direction whose size is a table.

    Attributes
    ----------
    point
        Marker that the force acts on.
    direction
        Direction in the frame at rest, shape (2,), of any length.
    size
        Force [N] over the time [s], or over the angle of `angle_of` [rad].
    angle_of
        Body whose angle the table is over; empty: the table is over the time.
    """

    point: str
    direction: tuple[float, float]
    size: Table
    angle_of: str = ""

    def __post_init__(self) -> None:
        require_class("point", self.point, str)
        require_pair("direction", self.direction, zero=False)
        require_callable("size", self.size)
        require_class("angle_of", self.angle_of, str)

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of the point and of the body whose angle the table is over."""
        return (self.point, self.angle_of) if self.angle_of else (self.point,)

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variation of the size, see `Force`."""
        return variations_of(self.size, angle_of=self.angle_of.partition(".")[0])

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Force on the point, see `Force`."""
        along = np.array(self.direction) / np.hypot(*self.direction)
        value = np.zeros(len(u))
        if not self.angle_of:
            value[:2] = self.size(time)[0] * along
            return Load(value)
        angle = SECOND + ANGLE
        size, derivative = self.size(float(u[angle]))
        value[:2] = size * along
        position = np.zeros((len(u), len(u)))
        position[:2, angle] = derivative * along
        return Load(value, position)


@attrs.frozen
class Torque(Force):
    """A torque on a body; the body begins at its angle and speed at the start.

    Attributes
    ----------
    body
        Body that the torque acts on.
    curve
        Additional torque [N m] over the body's angle [rad] or over the time [s]; a scene reads it
        from `table`.
    """

    body: str = ""
    curve: Table | None = attrs.field(default=None, kw_only=True)
    torque: float = number(0.0, "constant part, + in the sense of the angle [N m]")
    table: str = text(NONE, "more torque: CSV file angle_deg,torque_Nm or time_s,torque_Nm")
    over: str = only_with(
        choice("angle", BASES, "what the table is over, the body's own angle or time"), "table"
    )
    damping: float = number(0.0, "more torque per speed below the given one [N m s/rad]", least=0)
    speed: float = only_with(quantities.speed(0.0, "the given one [rad/s]"), "damping")

    def __attrs_post_init__(self) -> None:
        require_callable("curve", self.curve, optional=True)

    @property
    def markers(self) -> tuple[str, ...]:
        """Marker of the body."""
        return (self.body,)

    @property
    def turned_body(self) -> str:
        """Body that the torque acts on."""
        return self.body.partition(".")[0]

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variation of the curve, see `Force`."""
        return variations_of(self.curve, angle_of=self.turned_body if self.over == "angle" else "")

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Torque on the body, see `Force`."""
        value = np.zeros(len(u))
        position = np.zeros((len(u), len(u)))
        rate = np.zeros((len(u), len(u)))
        value[ANGLE] = self.torque + self.damping * (self.speed - rates[ANGLE])
        if self.curve is not None:
            over_angle = self.over == "angle"
            torque, derivative = self.curve(float(u[ANGLE]) if over_angle else time)
            value[ANGLE] += torque
            position[ANGLE, ANGLE] = derivative if over_angle else 0.0
        rate[ANGLE, ANGLE] = -self.damping
        return Load(value, position, rate)


@attrs.frozen
class RotatingForce(Force):
    """A force that turns at constant speed and points along x at time zero.

    During the ramp the force grows as ``(1 - cos(pi t / ramp)) / 2``.
    """

    point: str = text(REQUIRED, "where it acts, shaft.disk")
    amplitude: float = number(
        REQUIRED, "[N]", above=0, usual=(1e-3, 1e8), example="3600 for 3.6 kN"
    )
    speed: float = quantities.speed(REQUIRED, "[rad/s]")
    ramp: float = number(0.0, "time over which it grows [s], 0: there from the start", least=0)

    @property
    def markers(self) -> tuple[str, ...]:
        """Marker of the point."""
        return (self.point,)

    @property
    def variations(self) -> tuple[Variation, ...]:
        """A turn of the force, and the time over which it grows; see `Force`."""
        period = 2 * np.pi / abs(self.speed) if self.speed else 0.0
        return Variation(period=period), Variation(settled=self.ramp, setting="ramp")

    @property
    def left_out_of_equilibrium(self) -> str:
        """Description of the force, unless it is constant; see `Force`."""
        return f"of {self.amplitude:g} N" if self.speed or self.ramp else ""

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Force at a time, see `Force`."""
        share = 1.0
        if time < self.ramp:
            share = 0.5 * (1 - np.cos(np.pi * time / self.ramp))
        angle = self.speed * time
        value = np.zeros(len(u))
        value[:2] = share * self.amplitude * np.array([np.cos(angle), np.sin(angle)])
        return Load(value)


@attrs.frozen
class SpringDamper(Force):
    """A spring and a damper between two points, the same in all directions of the plane."""

    between: tuple[str, ...] = names("the points", REQUIRED, count=2)
    stiffness: float = number(0.0, "[N/m]", least=0, below=1e18)
    damping: float = number(0.0, "[N s/m]", least=0, below=1e18)

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of the two points."""
        return self.between

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Forces of spring and damper, see `Force`."""
        difference = np.zeros((2, len(u)))
        for axis in range(2):
            difference[axis, axis] = 1.0
            difference[axis, SECOND + axis] = -1.0
        form = difference.T @ difference
        position = -self.stiffness * form
        rate = -self.damping * form
        return Load(position @ u + rate @ rates, position, rate)
