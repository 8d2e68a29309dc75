"""Gap and surface velocities of a shaft in a bore (2)-(7), and deviations from round.

**Shape** of a bore or a journal: how far its surface lies outside the round one. The radial
deviation ``delta(phi, z)`` [m] is positive outward, away from the axis. A deviation of the bore
opens the gap, one of the journal closes it,

    h = c + delta_bore(phi, z) - delta_journal(phi - alpha, z) - ...,

alpha being the angle of the journal relative to the bore. At a fixed point of the bore the turning
shape changes the gap at the rate

    dh/dt = ... + alpha' d delta_journal/dphi (phi - alpha, z),

and has no other effect: the flux through a section stays ``h (v_1 + v_2) / 2 - h^3 / (12 eta)
dp/dx``, for the oil that the inclined surface pushes ahead of it is this rate. (Integrate
continuity over the film: ``d/dx int u dy - u(h) dh/dx + v(h) - v(0) = 0`` and ``v(h) = dh/dt + u(h)
dh/dx``.)

**Gap and surface velocities** (2)-(7). The bore carries the frame: its points keep their angle phi
and height z, and all velocities are relative to it. A shaft of radius ``R_1 = R_2 - c`` with its
centre at ``e`` and its axis tilted by the small rotations ``psi_x, psi_y`` has its centre at ``e(z)
= e + z (psi_y, -psi_x)`` in the plane of height z, and

    h     = R_2 + delta_r - e_r - s,    s = sqrt(R_1^2 - e_t^2)        (4), (5)
    dh/dt = d(delta_r)/dt - (de/dt)_r + (de/dt)_t e_t / s
    v_1   = (de/dt)_t + omega_1 s,      v_2 = omega_2 R_2 + d(delta_t)/dt   (6), (7)

``dh/dt`` is (2) evaluated on the shaft's surface: the two terms with omega_1
that (2) contains cancel there, because a round shaft spinning about its centre
does not change the gap. Taking ``d/dy`` with ``y = R_2 phi`` on both surfaces,
as printed, yields an additional ``omega_1 e_t h / R_2``, a false squeeze of order c / R.

All terms with ``e_t`` are kept; ``R_1 - s = e_t^2 / (R_1 + s)`` is formed without
cancellation. Left out, each smaller than what is kept by a factor c / R: the
product of tangential bore velocity and bore slope, and the axial velocity of
a tilted shaft (w in (6), which the paper drops too).

Imports inside functions: SciPy's splines take a tenth of a second, and most surfaces are round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeGuard

import attrs
import numpy as np

from fenics_ehd.base.arguments import require_class, require_number, require_pair
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.base.needs import NONE
from fenics_ehd.base.shared_settings import Deviations

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline, PPoly


#: Least number of angles in a table: fewer do not define a smooth curve.
FEWEST_ANGLES = 4

#: Accepted overshoot of a spline beyond its two neighbouring rows, over the range of the table.
OVERSHOOT = 0.05

#: Accepted overshoot at an extreme between rows, over the smaller one of the two adjacent steps.
#: A cosine with n rows a wave overshoots by 0.139 of that step for n = 8, 0.150 for 6, 0.162 for 5;
#: two rows that stand out, 0, 1, 1, 0, by 0.201.
ROUNDED = 0.165


@dataclass(frozen=True, eq=False)
class ShapeTable:
    """Measured deviations: a periodic cubic spline around, linear along the axis.

    Beyond the first and last height the deviation is constant. At a height at which the spline
    overshoots its rows (a step of the surface), a monotone cubic curve (PCHIP) replaces the spline:
    its slope is continuous, too, and its values stay within the range of the two neighbouring rows.

    Attributes
    ----------
    angles
        Angles, ascending within one turn, shape (n,) [rad].
    heights
        Heights, ascending, shape (k,) [m]; the deviations of a single height are valid at all
        heights.
    deviations
        shape (n, k) [m].

    Raises
    ------
    SettingsError
        The angles are too few, or do not ascend.
    """

    angles: np.ndarray
    heights: np.ndarray
    deviations: np.ndarray

    def __post_init__(self) -> None:
        for name, dimensions in (("angles", 1), ("heights", 1), ("deviations", 2)):
            array = np.asarray(getattr(self, name))
            if array.ndim != dimensions or array.dtype.kind not in "iuf":
                raise SettingsError(
                    f"{name} of a shape must be numbers in {dimensions} dimension"
                    f"{'s' * (dimensions > 1)}"
                )
            object.__setattr__(self, name, array.astype(float))
        if self.deviations.shape != (len(self.angles), len(self.heights)):
            raise SettingsError(
                f"deviations of shape {self.deviations.shape} for {len(self.angles)} angles and "
                f"{len(self.heights)} heights of a shape"
            )
        if len(self.angles) < FEWEST_ANGLES:
            raise SettingsError(
                f"a shape over {len(self.angles)} angles: at least {FEWEST_ANGLES} are needed"
            )
        ascending = (np.diff(self.angles) > 0).all() and (np.diff(self.heights) > 0).all()
        if not (ascending and np.ptp(self.angles) < 2 * np.pi):
            raise SettingsError("angles of a shape must ascend within one turn, and its heights")
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
        """Largest overshoot of the spline, accepted extremes excluded, shape (k,) [m]."""
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
        """True of the heights at which the curve is monotone between the rows, shape (k,)."""
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
        """Deviation or its derivative around, see `Shape.radial`; linear between heights."""
        angle, height = np.broadcast_arrays(angle, height)
        columns = np.moveaxis(self._around(angle, order), -1, 0)
        units = np.eye(len(self.heights))
        hats = [np.interp(height, self.heights, unit) for unit in units]
        return np.sum(columns * hats, axis=0)


def _outer_steps(rows: np.ndarray) -> np.ndarray:
    """Smaller step before or after every interval of a closed table, shape (n,) [m].

    0 unless the rows have an extreme in the interval.
    """
    before = rows - np.roll(rows, 1)
    after = np.roll(rows, -1) - np.roll(rows, -2)
    smaller = np.minimum(np.abs(before), np.abs(after))
    return np.where(before * after > 0, smaller, 0.0)


def require_read(table: str, read: object, key: str = "table", given: str = "a curve") -> None:
    """Refuse a setting whose table was not read: only scenes read tables.

    Raises
    ------
    SettingsError
        The message contains the key, and the value to be `given` instead.
    """
    if table != NONE and read is None:
        raise SettingsError(f"{key} = {table!r} is read with a scene: give {given} in Python")


def require_inside(
    eccentricity: tuple[float, float], *, rough: bool, key: str = "eccentricity"
) -> None:
    """Refuse a journal that lies on its bore or beyond, unless the surfaces are rough.

    Parameters
    ----------
    eccentricity
        Eccentricity over the clearance [-].
    rough
        Whether the surfaces are rough: the mean surfaces of rough ones may overlap.
    key
        Setting of the eccentricity.

    Raises
    ------
    SettingsError
        Naming the key.
    """
    share = float(np.hypot(*eccentricity))
    if not (rough or share < 1.0):
        raise SettingsError(
            f"{key} = {share:.3g} of the clearance must be below 1: the journal lies on the bore "
            "or beyond"
        )


@attrs.frozen(kw_only=True, slots=False)
class Shape(Deviations):
    """Radial deviation of a surface.

    With z the height over half the width, it is
    ``ovality cos(lobes (phi - ovality_angle)) + (barrel z + taper) z`` plus the deviations of a
    tilted axis at ``z (psi_y, -psi_x)`` and of a table.
    """

    #: Half the width of the bearing [m], for barrel and taper.
    half_width: float = np.inf
    #: Table of measured deviations.
    measured: ShapeTable | None = None

    def __attrs_post_init__(self) -> None:
        require_class("measured", self.measured, ShapeTable, optional=True)
        if self.half_width != np.inf:
            require_number("half_width", self.half_width, above=0)
        require_read(self.table, self.measured, given="it as measured")
        if (self.barrel or self.taper) and self.half_width == np.inf:
            raise SettingsError(
                f"barrel = {self.barrel:g} m, taper = {self.taper:g} m need half_width, half the "
                "bearing's width [m]"
            )

    @property
    def round(self) -> bool:
        """True of a shape that is the same at all angles: turning does not change the gap."""
        return not (self.ovality or any(self.misalignment) or self.measured)

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """Deviation [m] at angles [rad] and heights [m], or its derivative along the angle.

        `order` is 0, 1 or 2.
        """
        total = np.zeros(np.broadcast(angle, height).shape)
        quarters = order * (0.5 * np.pi)  # each derivative is a quarter turn of a wave
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
    """True of a `Shape` and of a user's object with its `radial`."""
    return hasattr(value, "radial")


def require_shape(name: str, value: Any) -> None:
    """Refuse a value that is neither a `Shape`, None, nor a user's object with `radial`.

    Raises
    ------
    SettingsError
        The message contains the argument and its class.
    """
    if not is_shape(value):
        require_class(name, value, Shape, optional=True)


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points of a bore: arrays of angle [rad] and height [m] of the same shape."""

    angle: np.ndarray
    height: np.ndarray

    @property
    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        """X and y components of the outward normal e_r."""
        return np.cos(self.angle), np.sin(self.angle)

    @cached_property
    def rows(self) -> FilmRows:
        """Points in rows around, between which extremes are computed."""
        return FilmRows.of(self.angle.ravel(), self.height.ravel())


@dataclass(frozen=True, eq=False)
class Gap:
    """Film thickness and velocities of the two surfaces at the Gauss points.

    Attributes
    ----------
    thickness, thickness_rate
        h [m] and its rate at a fixed point of the bore's frame [m/s].
    mean_velocity, sliding_velocity
        ``(v_1 + v_2) / 2`` and ``v_1 - v_2`` along the circumference [m/s].
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
        """The gap with changes of its thickness [m] and thickness rate [m/s], shape (g,)."""
        shape = self.thickness.shape
        return replace(
            self,
            thickness=self.thickness + thickness.reshape(shape),
            thickness_rate=self.thickness_rate + rate.reshape(shape),
        )


#: Two components, along x and y or about x and y.
Pair = np.ndarray | tuple[float, float]


@dataclass(frozen=True, eq=False)
class ShaftMotion:
    """Position and motion of a shaft in its bore.

    Attributes
    ----------
    eccentricity, eccentricity_rate
        Centre of the shaft at mid-width, x and y [m], [m/s].
    tilt, tilt_rate
        Small rotations of its axis about x and y [rad], [rad/s].
    shaft_speed, bore_speed
        Angular speeds about the axis, in the frame in which the eccentricity
        is given [rad/s].
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
    """Radial and tangential components (3) at every point of a centre and a tilt."""
    cosine, sine = points.normal
    x = pair[0] + points.height * tilt[1]
    y = pair[1] - points.height * tilt[0]
    return x * cosine + y * sine, y * cosine - x * sine


def shaft_gap(points: SurfacePoints, radius: float, clearance: float, motion: ShaftMotion) -> Gap:
    """Gap between a round shaft and a rigid bore; deformations add to gap and velocities.

    Parameters
    ----------
    points
        Points on the bore.
    radius, clearance
        Bore radius R_2 and radial clearance c [m].
    motion
        Motion of the shaft.

    Returns
    -------
    Gap

    Raises
    ------
    SettingsError
        The shaft's centre lies outside the shaft.
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
            f"the shaft's centre lies {off:.3g} m off, outside the shaft's radius of "
            f"{shaft_radius:.3g} m"
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
