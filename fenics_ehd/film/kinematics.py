"""Gap and surface velocities of a shaft in a bore, (2)-(7).

The bore carries the frame: its points keep their angle phi and height z, and
all velocities are relative to it. A shaft of radius ``R_1 = R_2 - c`` with its
centre at ``e`` and its axis tilted by the small rotations ``psi_x, psi_y`` has
its centre at ``e(z) = e + z (psi_y, -psi_x)`` in the plane of height z, and

    h     = R_2 + delta_r - e_r - s,    s = sqrt(R_1^2 - e_t^2)        (4), (5)
    dh/dt = d(delta_r)/dt - (de/dt)_r + (de/dt)_t e_t / s
    v_1   = (de/dt)_t + omega_1 s,      v_2 = omega_2 R_2 + d(delta_t)/dt   (6), (7)

``dh/dt`` is (2) evaluated on the shaft's surface: the two terms with omega_1
that (2) contains cancel there, because a round shaft spinning about its centre
does not change the gap. Taking ``d/dy`` with ``y = R_2 phi`` on both surfaces,
as printed, leaves ``omega_1 e_t h / R_2``, a false squeeze of order c / R.

All terms with ``e_t`` are kept; ``R_1 - s = e_t^2 / (R_1 + s)`` is formed without
cancellation. Left out, each smaller than what is kept by a factor c / R: the
product of tangential bore velocity and bore slope, and the axial velocity of
a tilted shaft (w in (6), which the paper drops too).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fenics_ehd.base.errors import SettingsError


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points of a bore: angle [rad] and height [m], each of one shape (any)."""

    angle: np.ndarray
    height: np.ndarray

    @property
    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        """X and y components of the outward normal e_r."""
        return np.cos(self.angle), np.sin(self.angle)


@dataclass(frozen=True, eq=False)
class Gap:
    """What the film sees of its two surfaces, at the Gauss points.

    Attributes
    ----------
    thickness, thickness_rate
        h [m] and its rate at a fixed point of the bore's frame [m/s].
    mean_velocity, sliding_velocity
        ``(v_1 + v_2) / 2`` and ``v_1 - v_2`` along the circumference [m/s].
    turn, time
        Angle of the journal from the bore's [rad], and time [s]; what supplies the film may
        depend on them.
    """

    thickness: np.ndarray
    thickness_rate: np.ndarray
    mean_velocity: np.ndarray
    sliding_velocity: np.ndarray
    turn: float = 0.0
    time: float = 0.0


def _pair() -> np.ndarray:
    return np.zeros(2)


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

    eccentricity: np.ndarray
    shaft_speed: float
    eccentricity_rate: np.ndarray = field(default_factory=_pair)
    tilt: np.ndarray = field(default_factory=_pair)
    tilt_rate: np.ndarray = field(default_factory=_pair)
    bore_speed: float = 0.0


def _local(points: SurfacePoints, pair: np.ndarray, tilt: np.ndarray) -> tuple:
    """Radial and tangential components (3) at every point of a centre and a tilt."""
    cosine, sine = points.normal
    x = pair[0] + points.height * tilt[1]
    y = pair[1] - points.height * tilt[0]
    return x * cosine + y * sine, y * cosine - x * sine


def _half_chord(radius: float, tangential: np.ndarray) -> np.ndarray:
    """``s = sqrt(R_1^2 - e_t^2)`` of (4)."""
    if not np.abs(tangential).max(initial=0.0) < radius:
        raise SettingsError(
            f"the shaft's centre lies {np.abs(tangential).max():.3g} m off, outside the shaft's "
            f"radius of {radius:.3g} m"
        )
    return np.sqrt(radius**2 - tangential**2)


def shaft_gap(
    points: SurfacePoints,
    radius: float,
    clearance: float,
    motion: ShaftMotion,
    *,
    bore_displacement: tuple[np.ndarray, np.ndarray] | None = None,
    bore_velocity: tuple[np.ndarray, np.ndarray] | None = None,
) -> Gap:
    """Gap between a round shaft and a bore, rigid or deformed.

    Parameters
    ----------
    points
        Where on the bore.
    radius, clearance
        Bore radius R_2 and radial clearance c [m].
    motion
        The shaft's.
    bore_displacement, bore_velocity
        Radial and tangential components of the bore's elastic displacement [m]
        and velocity [m/s] at the points, in the bore's frame; None: rigid.

    Returns
    -------
    Gap

    Raises
    ------
    SettingsError
        The bore is deformed and turns in the frame at once, or the shaft's
        centre lies outside the shaft.
    """
    if bore_displacement is not None and motion.bore_speed:
        raise SettingsError(
            f"bore_speed = {motion.bore_speed:g} rad/s: a deformed bore carries the frame and "
            "must be at rest in it"
        )
    e_r, e_t = _local(points, motion.eccentricity, motion.tilt)
    rate_r, rate_t = _local(points, motion.eccentricity_rate, motion.tilt_rate)
    shaft_radius = radius - clearance
    s = _half_chord(shaft_radius, e_t)
    delta_r = 0.0 if bore_displacement is None else bore_displacement[0]
    velocity_r, velocity_t = (0.0, 0.0) if bore_velocity is None else bore_velocity
    shaft = rate_t + motion.shaft_speed * s
    bore = motion.bore_speed * radius + velocity_t
    return Gap(
        thickness=clearance + delta_r - e_r + e_t**2 / (shaft_radius + s),
        thickness_rate=velocity_r - rate_r + rate_t * e_t / s,
        mean_velocity=0.5 * (shaft + bore),
        sliding_velocity=shaft - bore,
    )


@dataclass(frozen=True, eq=False)
class GapDerivatives:
    """Derivatives of a gap, each (points..., n directions).

    `thickness`, `thickness_rate`, `mean_velocity` and `sliding_velocity` as in `Gap`; the last,
    which only an oil that thins asks for, may be None for zero.
    """

    thickness: np.ndarray
    thickness_rate: np.ndarray
    mean_velocity: np.ndarray
    sliding_velocity: np.ndarray | None = None


def shaft_gap_derivatives(
    points: SurfacePoints, radius: float, clearance: float, motion: ShaftMotion
) -> tuple[GapDerivatives, GapDerivatives]:
    """Exact derivatives of `shaft_gap`, with respect to position and to velocity.

    Returns
    -------
    position, velocity : GapDerivatives
        Along ``e_x, e_y, psi_x, psi_y`` and along their rates: n = 4.
    """
    cosine, sine = points.normal
    z = points.height
    zero = np.zeros_like(z)
    # Columns: change of the shaft's centre in the plane of height z.
    x = np.stack([zero + 1, zero, zero, z], axis=-1)
    y = np.stack([zero, zero + 1, -z, zero], axis=-1)
    cosine, sine = cosine[..., None], sine[..., None]
    along_r, along_t = x * cosine + y * sine, y * cosine - x * sine
    _, e_t = _local(points, motion.eccentricity, motion.tilt)
    _, rate_t = _local(points, motion.eccentricity_rate, motion.tilt_rate)
    s = _half_chord(radius - clearance, e_t)
    inclination = (e_t / s)[..., None]
    # d(e_t / s) = R_1^2 / s^3 d(e_t); ds = -e_t / s d(e_t).
    curvature = (rate_t * (radius - clearance) ** 2 / s**3)[..., None]
    thickness = -along_r + inclination * along_t
    sliding = -motion.shaft_speed * inclination * along_t
    position = GapDerivatives(thickness, curvature * along_t, 0.5 * sliding, sliding)
    return position, GapDerivatives(np.zeros_like(thickness), thickness, 0.5 * along_t, along_t)
