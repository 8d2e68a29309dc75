"""Forces and torques on markers of bodies, with exact derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import attrs
import numpy as np

from fenics_ehd.base import fields as quantities
from fenics_ehd.base.arguments import require_callable, require_class, require_pair
from fenics_ehd.base.described import Described
from fenics_ehd.base.fields import REQUIRED, choice, names, number, text
from fenics_ehd.base.needs import NONE, only_with
from fenics_ehd.multibody.body import ANGLE
from fenics_ehd.multibody.joints import SECOND
from fenics_ehd.multibody.tabulated import Variation, variations_of

#: Variables over which a torque may have a table.
BASES = ("angle", "time")

#: Function of time [s] or of an angle [rad] that returns a value and its derivative. A table whose
#: rows no step may miss is a `Curve`.
Table = Callable[[float], tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Load:
    """Generalised force on the k values u of a force's markers, with its derivatives.

    Attributes
    ----------
    value
        Forces and torques, shape (k,) [N], [N m].
    position, rate
        Derivatives with respect to u and to the rates u', shape (k, k); None if zero.
    """

    value: np.ndarray
    position: np.ndarray | None = None
    rate: np.ndarray | None = None


class Force(Described, ABC):
    """Force or torque on the bodies of a mechanism."""

    @property
    @abstractmethod
    def markers(self) -> tuple[str, ...]:
        """Markers on which the force acts, or on whose values and rates it depends."""

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variations over time or an angle: periods, and tables whose rows no step may miss."""
        return ()

    @property
    def turned_body(self) -> str:
        """Name of the body on which the force acts as a torque; empty if there is none."""
        return ""

    @property
    def left_out_of_equilibrium(self) -> str:
        """Description of the force if equilibria are computed without the force; else empty."""
        return ""

    @abstractmethod
    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Generalised force at a time [s], for values u of its markers and their rates."""


@dataclass(frozen=True)
class PointForce(Force):
    """Force of constant direction on a point, with a size over time or over an angle.

    Attributes
    ----------
    point
        Marker on which the force acts.
    direction
        Direction in the frame at rest, shape (2,), of any length.
    size
        Function that returns the force [N], and its derivative, over time [s] or over the angle of
        `angle_of` [rad].
    angle_of
        Name of the body over whose angle the size is given; empty for a size over time.
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
        """Marker of the point, and of the body on whose angle the force depends, if any."""
        return (self.point, self.angle_of) if self.angle_of else (self.point,)

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variation of the force over time or angle, see `Force.variations`."""
        return variations_of(self.size, angle_of=self.angle_of.partition(".")[0])

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Generalised force on the point, see `Force.load`."""
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
    """Torque on a body, which starts with the angle and the speed of its pose.

    Attributes
    ----------
    body
        Name of the body on which the torque acts.
    curve
        Function that returns an additional torque [N m], and its derivative, over the body's angle
        [rad] or over time [s]; a scene reads it from `table`.
    """

    body: str = ""
    curve: Table | None = attrs.field(default=None, kw_only=True)
    torque: float = number(0.0, "constant part, + in the sense of the angle [N m]")
    table: str = text(NONE, "additional torque: CSV file angle_deg,torque_Nm or time_s,torque_Nm")
    over: str = only_with(
        choice("angle", BASES, "variable of the table, the body's angle or time"), "table"
    )
    damping: float = number(0.0, "torque per speed difference to `speed` [N m s/rad]", least=0)
    speed: float = only_with(
        quantities.speed(0.0, "without torque from damping [rad/s]"), "damping"
    )

    def __attrs_post_init__(self) -> None:
        require_callable("curve", self.curve, optional=True)

    @property
    def markers(self) -> tuple[str, ...]:
        """Marker of the body on which the torque acts."""
        return (self.body,)

    @property
    def turned_body(self) -> str:
        """Name of the body on which the torque acts."""
        return self.body.partition(".")[0]

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variation of the curve over time or angle, see `Force.variations`."""
        return variations_of(self.curve, angle_of=self.turned_body if self.over == "angle" else "")

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Generalised force on the body, see `Force.load`."""
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
    """Force that rotates at constant speed, and points along x at time zero.

    During the ramp the amplitude grows as ``(1 - cos(pi t / ramp)) / 2``.
    """

    point: str = text(REQUIRED, "point on which the force acts, shaft.disk")
    amplitude: float = number(
        REQUIRED, "[N]", least=0, usual=(1e-3, 1e8), example="3600 for 3.6 kN"
    )
    speed: float = quantities.speed(REQUIRED, "[rad/s]")
    ramp: float = number(0.0, "time over which it grows [s], 0: constant from the start", least=0)

    @property
    def markers(self) -> tuple[str, ...]:
        """Marker of the point on which the force acts."""
        return (self.point,)

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Period of one turn, and the ramp, as variations over time, see `Force.variations`."""
        period = 2 * np.pi / abs(self.speed) if self.speed else 0.0
        return Variation(period=period), Variation(settled=self.ramp, setting="ramp")

    @property
    def left_out_of_equilibrium(self) -> str:
        """Description of the force unless it is constant, see `Force.left_out_of_equilibrium`."""
        return f"of {self.amplitude:g} N" if self.speed or self.ramp else ""

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Generalised force on the point at a time, see `Force.load`."""
        share = 1.0
        if time < self.ramp:
            share = 0.5 * (1 - np.cos(np.pi * time / self.ramp))
        angle = self.speed * time
        value = np.zeros(len(u))
        value[:2] = share * self.amplitude * np.array([np.cos(angle), np.sin(angle)])
        return Load(value)


@attrs.frozen
class Unbalance(Force):
    """Unbalance on the axis of a body, whose centrifugal force rotates with the body.

    With the magnitude m e, the phase phi, and the angle theta of the body, the force is
    ``m e theta'^2 (cos(theta + phi), sin(theta + phi))``. The mass of the body includes m. The part
    of the force with ``theta''`` is neglected; it is zero at constant speed.
    """

    point: str = text(REQUIRED, "point on the axis of the body, shaft.disk")
    magnitude: float = number(
        REQUIRED, "mass times distance from the axis [kg m]", least=0, usual=(1e-9, 10.0),
        example="4e-4 for 400 g mm",
    )  # fmt: skip
    phase: float = number(0.0, "angle from the body's x axis, + in the sense of x to y [degrees]")

    @property
    def markers(self) -> tuple[str, ...]:
        """Marker of the point on which the force acts."""
        return (self.point,)

    @property
    def rotates_with(self) -> str:
        """Name of the body with which the force rotates."""
        return self.point.partition(".")[0]

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Period of one turn of the body, see `Force.variations`."""
        return (Variation(period=2 * np.pi, angle_of=self.rotates_with),)

    @property
    def left_out_of_equilibrium(self) -> str:
        """Description of the force, see `Force.left_out_of_equilibrium`."""
        return f"of the unbalance {self.magnitude:g} kg m"

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Generalised force on the point, see `Force.load`."""
        direction = float(u[ANGLE]) + np.radians(self.phase)
        outward = np.array([np.cos(direction), np.sin(direction)])
        speed = float(rates[ANGLE])
        value = np.zeros(len(u))
        position = np.zeros((len(u), len(u)))
        rate = np.zeros((len(u), len(u)))
        value[:2] = self.magnitude * speed**2 * outward
        position[:2, ANGLE] = self.magnitude * speed**2 * np.array([-outward[1], outward[0]])
        rate[:2, ANGLE] = 2 * self.magnitude * speed * outward
        return Load(value, position, rate)


@attrs.frozen
class SpringDamper(Force):
    """Spring and damper between two points, with equal coefficients in all directions."""

    between: tuple[str, ...] = names("the points", REQUIRED, count=2)
    stiffness: float = number(0.0, "[N/m]", least=0, below=1e18)
    damping: float = number(0.0, "[N s/m]", least=0, below=1e18)

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of the two points."""
        return self.between

    def load(self, time: float, u: np.ndarray, rates: np.ndarray) -> Load:
        """Generalised forces of spring and damper on both points, see `Force.load`."""
        difference = np.zeros((2, len(u)))
        for axis in range(2):
            difference[axis, axis] = 1.0
            difference[axis, SECOND + axis] = -1.0
        form = difference.T @ difference
        position = -self.stiffness * form
        rate = -self.damping * form
        return Load(position @ u + rate @ rates, position, rate)
