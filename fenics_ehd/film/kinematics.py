"""Gap and surface velocities of a shaft in a bore (2)-(7), and deviations from a round shape.

**Shape.** The shape of a bore or a journal is the radial deviation ``delta(phi, z)`` [m] of its
surface from a cylinder, positive outward. A deviation of the bore increases the gap, one of the
journal reduces it,

    h = c + delta_bore(phi, z) - delta_journal(phi - alpha, z) - ...,

with the angle alpha of the journal relative to the bore. At a fixed point of the bore the turning
shape of the journal changes the gap at the rate

    dh/dt = ... + alpha' d delta_journal/dphi (phi - alpha, z),

and has no other effect: the flux through a section remains ``h (v_1 + v_2) / 2 - h^3 / (12 eta)
dp/dx``, and this rate is the oil that the inclined surface displaces. (Integrate continuity over
the film: ``d/dx int u dy - u(h) dh/dx + v(h) - v(0) = 0`` with ``v(h) = dh/dt + u(h) dh/dx``.)

**Gap and surface velocities** (2)-(7). The frame is fixed to the bore: points of the bore keep
their angle phi and height z, and all velocities are relative to it. A shaft of radius ``R_1 = R_2 -
c`` with its centre at ``e`` and its axis tilted by the small rotations ``psi_x, psi_y`` has its
centre at ``e(z) = e + z (psi_y, -psi_x)`` in the plane of height z, and

    h     = R_2 + delta_r - e_r - s,    s = sqrt(R_1^2 - e_t^2)        (4), (5)
    dh/dt = d(delta_r)/dt - (de/dt)_r + (de/dt)_t e_t / s
    v_1   = (de/dt)_t + omega_1 s,      v_2 = omega_2 R_2 + d(delta_t)/dt   (6), (7)

``dh/dt`` is (2) evaluated on the shaft's surface: the two terms with omega_1
that (2) contains cancel there, because a round shaft spinning about its centre
does not change the gap. Taking ``d/dy`` with ``y = R_2 phi`` on both surfaces,
as printed, yields an additional ``omega_1 e_t h / R_2``, a false squeeze of order c / R.

All terms with ``e_t`` are kept; ``R_1 - s = e_t^2 / (R_1 + s)`` is formed without
cancellation. Two terms are neglected, because each is smaller by a factor c / R than those kept:
the product of tangential bore velocity and bore slope, and the axial velocity of
a tilted shaft (w in (6), which the paper neglects too).

Imports inside functions: SciPy's splines take a tenth of a second to import, and round surfaces
need no splines.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeGuard

import attrs
import numpy as np

from fenics_ehd.base.arguments import require_class, require_number, require_pair
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.base.needs import NONE
from fenics_ehd.base.shared_settings import Deviations

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline, PPoly


#: Smallest number of angles in a table: fewer do not define a smooth curve.
FEWEST_ANGLES = 4

#: Accepted overshoot of a spline beyond the two adjacent rows, over the range of the table.
OVERSHOOT = 0.05

#: Accepted overshoot at an extreme between two rows, over the smaller step of the table before or
#: after these rows. A cosine with n rows per wave overshoots by 0.139 of that step for n = 8, 0.150
#: for 6 and 0.162 for 5; the spline of two raised rows, 0, 1, 1, 0, by 0.201.
ROUNDED = 0.165


@dataclass(frozen=True, eq=False)
class ShapeTable(Described):
    """Table of measured deviations: a periodic cubic spline around, linear along the axis.

    A row of the table has the deviations at one angle. Beyond the first and last height the
    deviation is constant. Next to a step of the surface, the spline may exceed the range of the two
    adjacent rows. At the heights where it does, a monotone cubic curve (PCHIP) replaces the spline:
    the slope of this curve is continuous, too, and its values stay within that range.

    Attributes
    ----------
    angles
        Angles of the rows, ascending within one turn, shape (n,) [rad].
    heights
        Heights of the columns, ascending, shape (k,) [m]; the deviations of a single height are
        valid at all heights.
    deviations
        Radial deviations, positive outward, shape (n, k) [m].

    Raises
    ------
    SettingsError
        If the angles are too few or do not ascend, or an array has a wrong shape or values that are
        not finite numbers.
    """

    angles: np.ndarray
    heights: np.ndarray
    deviations: np.ndarray

    def __post_init__(self) -> None:
        for name, dimensions in (("angles", 1), ("heights", 1), ("deviations", 2)):
            array = np.asarray(getattr(self, name))
            if array.ndim != dimensions or array.dtype.kind not in "iuf":
                raise SettingsError(
                    f"{name} of a shape must be an array of numbers with {dimensions} dimension"
                    f"{'s' * (dimensions > 1)}"
                )
            object.__setattr__(self, name, array.astype(float))
        if self.deviations.shape != (len(self.angles), len(self.heights)):
            raise SettingsError(
                f"deviations have the shape {self.deviations.shape}, not ({len(self.angles)}, "
                f"{len(self.heights)}), angles by heights"
            )
        if len(self.angles) < FEWEST_ANGLES:
            raise SettingsError(
                f"a shape has {len(self.angles)} angles: give at least {FEWEST_ANGLES}"
            )
        ascending = (np.diff(self.angles) > 0).all() and (np.diff(self.heights) > 0).all()
        if not (ascending and np.ptp(self.angles) < 2 * np.pi):
            raise SettingsError(
                "angles of a shape must ascend within one turn, and heights must ascend"
            )
        if not np.isfinite(self.deviations).all():
            raise SettingsError("deviations of a shape must be finite numbers")

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline

        closed = np.append(self.angles, self.angles[0] + 2 * np.pi)
        rows = np.vstack([self.deviations, self.deviations[:1]])
        return CubicSpline(closed, rows, bc_type="periodic")

    @cached_property
    def overshoot(self) -> np.ndarray:
        """Largest overshoot of the spline beyond two adjacent rows, at each height, shape (k,) [m].

        Overshoots at extremes between two rows count as 0 if `ROUNDED` accepts them.
        """
        spline = self._spline
        rows = self.deviations
        following = np.roll(rows, -1, axis=0)
        extremes = spline.derivative().roots(extrapolate=False)
        largest = np.zeros(len(self.heights))
        for column, angles in enumerate(extremes):
            angles = angles[np.isfinite(angles)]
            interval = np.clip(np.searchsorted(spline.x, angles) - 1, 0, len(rows) - 1)
            ends = np.stack([rows[interval, column], following[interval, column]])
            value = spline(angles)[:, column]
            beyond = np.maximum(value - ends.max(axis=0), ends.min(axis=0) - value)
            beyond[beyond <= ROUNDED * _outer_steps(rows[:, column])[interval]] = 0.0
            largest[column] = beyond.max(initial=0.0)
        return largest

    @cached_property
    def stepped(self) -> np.ndarray:
        """Mask of the heights at which a monotone curve replaces the spline, shape (k,)."""
        return self.overshoot > OVERSHOOT * np.ptp(self.deviations)

    @cached_property
    def _around(self) -> PPoly:
        if not self.stepped.any():
            return self._spline
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator, PPoly

        closed = self._spline.x
        turn = 2 * np.pi
        around = np.concatenate([self.angles - turn, closed, self.angles[1:3] + turn])
        rows = np.vstack([*[self.deviations] * 2, self.deviations[:3]])
        slopes = PchipInterpolator(around, rows).derivative()(closed)
        closing = rows[: len(closed)]
        monotone = CubicHermiteSpline(closed, closing, slopes)
        pieces = np.where(self.stepped, monotone.c, self._spline.c)
        return PPoly(pieces, closed, extrapolate="periodic")

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """Radial deviation at angles [rad] and heights [m], or its derivative by angle.

        `order` is the order of the derivative: 0, 1 or 2.
        """
        angle, height = np.broadcast_arrays(angle, height)
        columns = np.moveaxis(self._around(angle, order), -1, 0)
        units = np.eye(len(self.heights))
        hats = [np.interp(height, self.heights, unit) for unit in units]
        return np.sum(columns * hats, axis=0)


def _outer_steps(rows: np.ndarray) -> np.ndarray:
    """Smaller of the two steps that precede and follow each interval of a table, shape (n,) [m].

    `rows` are the n values of a periodic table; a step is the difference of two adjacent values. If
    the values rise before the interval and fall after it, or the reverse, a smooth curve has an
    extreme within the interval. In all other cases the result is 0.
    """
    before = rows - np.roll(rows, 1)
    after = np.roll(rows, -1) - np.roll(rows, -2)
    smaller = np.minimum(np.abs(before), np.abs(after))
    return np.where(before * after > 0, smaller, 0.0)


def require_read(table: str, read: object, key: str = "table", given: str = "a curve") -> None:
    """Refuse settings that name the file of a table, if this file was not read.

    Files are read together with a scene. In Python the data are given as an argument instead.

    Parameters
    ----------
    table, read
        Name of the file in the settings, and the data read from it; None if it was not read.
    key, given
        Key of the table, and the data to give in Python, for the message.

    Raises
    ------
    SettingsError
        If the file was not read; the message contains `key` and `given`.
    """
    if table != NONE and read is None:
        raise SettingsError(f"{key} = {table!r} is read only for scenes: in Python, give {given}")


def require_inside(
    eccentricity: tuple[float, float], *, rough: bool, key: str = "eccentricity"
) -> None:
    """Refuse a journal that touches its bore or overlaps with it, unless the surfaces are rough.

    Parameters
    ----------
    eccentricity
        Components of the eccentricity over the clearance [-].
    rough
        Whether the surfaces are rough: mean planes of rough surfaces may overlap.
    key
        Key of the eccentricity.

    Raises
    ------
    SettingsError
        If smooth surfaces touch; the message names the key.
    """
    share = float(np.hypot(*eccentricity))
    if not (rough or share < 1.0):
        raise SettingsError(
            f"{key} = {share:.3g} of the clearance must be below 1: the journal would touch or "
            "penetrate the bore"
        )


@attrs.frozen(kw_only=True, slots=False)
class Shape(Deviations):
    """Radial deviation of a bore or a journal from a cylinder, positive outward.

    It is the sum of four parts: the waves ``ovality cos(lobes (phi - ovality_angle))``; the profile
    ``(barrel s + taper) s`` along the axis, with ``s = z / half_width``; the tilt
    ``z (psi_y cos(phi) - psi_x sin(phi))`` of an axis with the misalignment (psi_x, psi_y); and the
    deviations of a table.
    """

    #: Half the width of the bearing [m], needed for barrel and taper.
    half_width: float = np.inf
    #: Table of measured deviations; None if there is none.
    measured: ShapeTable | None = None

    def __attrs_post_init__(self) -> None:
        require_class("measured", self.measured, ShapeTable, optional=True)
        if self.half_width != np.inf:
            require_number("half_width", self.half_width, above=0)
        require_read(self.table, self.measured, given="the argument measured")
        if (self.barrel or self.taper) and self.half_width == np.inf:
            raise SettingsError(
                f"barrel = {self.barrel:g} m, taper = {self.taper:g} m need half_width, half the "
                "bearing's width [m]: give it"
            )

    @property
    def round(self) -> bool:
        """Whether the shape has rotational symmetry: turning it does not change the gap."""
        return not (self.ovality or any(self.misalignment) or self.measured)

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """Radial deviation at angles [rad] and heights [m], or its derivative by angle.

        `order` is the order of the derivative: 0, 1 or 2.
        """
        total = np.zeros(np.broadcast(angle, height).shape)
        quarters = order * (0.5 * np.pi)  # each derivative shifts a wave by a quarter period
        if self.ovality:
            wave = self.lobes * (angle - np.radians(self.ovality_angle)) + quarters
            total += self.ovality * self.lobes**order * np.cos(wave)
        if order == 0 and (self.barrel or self.taper):
            z = height / self.half_width
            total += (self.barrel * z + self.taper) * z
        if any(self.misalignment):
            about_x, about_y = self.misalignment
            turned = angle + quarters
            total += height * (about_y * np.cos(turned) - about_x * np.sin(turned))
        if self.measured is not None:
            total += self.measured.radial(angle, height, order)
        return total


def is_shape(value: Any) -> TypeGuard[Shape]:
    """Whether a value is a `Shape`, or another object with a method `radial`."""
    return hasattr(value, "radial")


def require_shape(name: str, value: Any) -> None:
    """Refuse a value that is neither a `Shape`, None, nor a user's object with a method `radial`.

    Raises
    ------
    SettingsError
        If the value is another object; the message names the argument and the object's class.
    """
    if not is_shape(value):
        require_class(name, value, Shape, optional=True)


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points on a bore: arrays of their angles [rad] and heights [m], of the same shape."""

    angle: np.ndarray
    height: np.ndarray

    @property
    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        """Components x and y, at every point, of the unit vector e_r that points outward."""
        return np.cos(self.angle), np.sin(self.angle)

    @cached_property
    def rows(self) -> FilmRows:
        """Indices, angles and heights of the points, arranged in rows around the bore.

        Extremes of fields are interpolated between the points of a row.
        """
        return FilmRows.of(self.angle.ravel(), self.height.ravel())


@dataclass(frozen=True, eq=False)
class Gap(Described):
    """Film thickness and velocities of the two surfaces at the Gauss points.

    Attributes
    ----------
    thickness, thickness_rate
        Film thickness h [m] and its rate at a fixed point of the bore's frame [m/s].
    mean_velocity, sliding_velocity
        Mean ``(v_1 + v_2) / 2`` and difference ``v_1 - v_2`` of the velocities of shaft and bore
        along the circumference [m/s].
    turn, time
        Angle of the journal relative to the bore [rad], and time [s]; supplies may depend on both.
    """

    thickness: np.ndarray
    thickness_rate: np.ndarray
    mean_velocity: np.ndarray
    sliding_velocity: np.ndarray
    turn: float = 0.0
    time: float = 0.0

    def changed(self, thickness: np.ndarray, rate: np.ndarray) -> Gap:
        """Gap with `thickness` [m] and `rate` [m/s] added to its thickness and thickness rate.

        Both arrays have one entry for every Gauss point, in the order of the gap's arrays.
        """
        shape = self.thickness.shape
        return replace(
            self,
            thickness=self.thickness + thickness.reshape(shape),
            thickness_rate=self.thickness_rate + rate.reshape(shape),
        )


#: Two components, along x and y or about x and y.
Pair = np.ndarray | tuple[float, float]


@dataclass(frozen=True, eq=False)
class ShaftMotion(Described):
    """Position and motion of a shaft in its bore.

    Attributes
    ----------
    eccentricity, eccentricity_rate
        Centre of the shaft at mid-width, x and y [m], and its velocity [m/s].
    tilt, tilt_rate
        Small rotations of the shaft's axis about x and y [rad], and their rates [rad/s].
    shaft_speed, bore_speed
        Angular speeds of shaft and bore about the axis, in the frame of the eccentricity [rad/s].
    """

    eccentricity: Pair
    shaft_speed: float
    eccentricity_rate: Pair = (0.0, 0.0)
    tilt: Pair = (0.0, 0.0)
    tilt_rate: Pair = (0.0, 0.0)
    bore_speed: float = 0.0

    def __post_init__(self) -> None:
        for name in ("eccentricity", "eccentricity_rate", "tilt", "tilt_rate"):
            require_pair(name, getattr(self, name))
        for name in ("shaft_speed", "bore_speed"):
            require_number(name, getattr(self, name))


def _local(points: SurfacePoints, pair: Pair, tilt: Pair) -> tuple[np.ndarray, np.ndarray]:
    """Components of the shaft's centre (3): e_r toward each point, e_t at right angles to it.

    On a tilted shaft, the centre in the plane of the point is used. `pair` is the centre at
    mid-width, and `tilt` the rotation of the axis. If both arguments are rates, the results are
    components of the centre's velocity.
    """
    cosine, sine = points.normal
    x = pair[0] + points.height * tilt[1]
    y = pair[1] - points.height * tilt[0]
    return x * cosine + y * sine, y * cosine - x * sine


def shaft_gap(points: SurfacePoints, radius: float, clearance: float, motion: ShaftMotion) -> Gap:
    """Gap between a round shaft and a rigid bore; callers add deformations to gap and velocities.

    Parameters
    ----------
    points
        Points on the bore.
    radius, clearance
        Bore radius R_2 and radial clearance c [m].
    motion
        Position and motion of the shaft.

    Returns
    -------
    Gap
        Gap at the points.

    Raises
    ------
    SettingsError
        If the shaft is displaced tangentially by more than its radius.
    """
    require_class("points", points, SurfacePoints)
    require_class("motion", motion, ShaftMotion)
    require_number("radius", radius, above=0)
    require_number("clearance", clearance, above=0)
    e_r, e_t = _local(points, motion.eccentricity, motion.tilt)
    rate_r, rate_t = _local(points, motion.eccentricity_rate, motion.tilt_rate)
    shaft_radius = radius - clearance
    off = np.abs(e_t).max(initial=0.0)
    if not off < shaft_radius:
        raise SettingsError(
            f"the shaft's centre is displaced by {off:.3g} m at right angles to the direction of a "
            f"bore point: this must be less than the shaft's radius, {shaft_radius:.3g} m"
        )
    # The half chord of (4).
    s = np.sqrt(shaft_radius**2 - e_t**2)
    shaft = rate_t + motion.shaft_speed * s
    bore = motion.bore_speed * radius
    return Gap(
        thickness=clearance - e_r + e_t**2 / (shaft_radius + s),
        thickness_rate=rate_t * e_t / s - rate_r,
        mean_velocity=0.5 * (shaft + bore),
        sliding_velocity=shaft - bore,
    )
