"""Shape of a bore or a journal: how far its surface lies outside the round one.

The radial deviation ``delta(phi, z)`` [m] is positive outward, away from the axis: it opens the
gap where the bore has it and closes it where the journal has it,

    h = c + delta_bore(phi, z) - delta_journal(phi - alpha, z) - ...,

alpha the angle of the journal ahead of the bore. At a fixed point of the bore the turning shape
changes the gap at the rate

    dh/dt = ... + alpha' d delta_journal/dphi (phi - alpha, z),

and nothing else: the flux through a section stays ``h (v_1 + v_2) / 2 - h^3 / (12 eta) dp/dx``,
for the oil that the inclined surface pushes ahead of it is this rate. (Integrate continuity over
the film: ``d/dx int u dy - u(h) dh/dx + v(h) - v(0) = 0`` and ``v(h) = dh/dt + u(h) dh/dx``.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fenics_ehd.base.errors import SettingsError

if TYPE_CHECKING:  # slow to import, and for tables alone
    from scipy.interpolate import CubicSpline

#: Fewest angles of a table: with fewer there is no smooth curve through them.
FEWEST_ANGLES = 4


class Shape(Protocol):
    """Radial deviation of a surface."""

    @property
    def round(self) -> bool:
        """Whether it is the same at all angles: then turning changes nothing."""

    def __hash__(self) -> int: ...

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """Deviation [m] at angles [rad] and heights [m], or its derivative along the angle.

        `order` is 0, 1 or 2.
        """


@dataclass(frozen=True)
class Lobes:
    """``a cos(n (phi - phi_0))``: ovality with n = 2, a polygon with more.

    Attributes
    ----------
    amplitude
        a [m]: n times around the surface lies so far outside, and in between inside.
    angle
        phi_0 [rad].
    count
        n, at least 1; 1 is an eccentric surface.
    """

    amplitude: float
    angle: float = 0.0
    count: int = 2
    round = False

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """See `Shape`."""
        # Each derivative is a quarter turn of the wave.
        turned = self.count * (angle - self.angle) + order * (0.5 * np.pi)
        return self.amplitude * self.count**order * np.cos(turned) + 0.0 * height


@dataclass(frozen=True)
class Profile:
    """``barrel (z / l)^2 + taper z / l``: the same at all angles.

    Attributes
    ----------
    half_width
        l, half the bearing's width [m].
    barrel
        Deviation at both ends [m], zero at mid-width: negative of a crowned journal, positive of a
        bore that opens to its ends.
    taper
        Deviation at the upper end, ``z = l``, and minus that at the lower [m].
    """

    half_width: float
    barrel: float = 0.0
    taper: float = 0.0
    round = True

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """See `Shape`."""
        z = height / self.half_width + 0.0 * angle
        return (self.barrel * z + self.taper) * z if order == 0 else np.zeros_like(z)


@dataclass(frozen=True)
class Misalignment:
    """An axis tilted by small rotations about x and y [rad], to ``z (psi_y, -psi_x)``."""

    about_x: float
    about_y: float
    round = False

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """See `Shape`."""
        turned = angle + order * (0.5 * np.pi)
        return height * (self.about_y * np.cos(turned) - self.about_x * np.sin(turned))


@dataclass(frozen=True, eq=False)
class ShapeTable:
    """Measured deviations: a periodic cubic spline around, linear along the axis.

    Beyond the first and last height the deviation there stays.

    Attributes
    ----------
    angles
        Ascending within one turn, shape (n,) [rad].
    heights
        Ascending, shape (k,) [m]; one stands for all.
    deviations
        shape (n, k) [m].

    Raises
    ------
    SettingsError
        Too few angles, or some that do not ascend.
    """

    angles: np.ndarray
    heights: np.ndarray
    deviations: np.ndarray
    round = False

    def __post_init__(self) -> None:
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
    def _around(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline

        closed = np.append(self.angles, self.angles[0] + 2 * np.pi)
        rows = np.vstack([self.deviations, self.deviations[:1]])
        return CubicSpline(closed, rows, bc_type="periodic")

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """See `Shape`."""
        angle, height = np.broadcast_arrays(angle, height)
        columns = self._around(angle, order)
        if len(self.heights) == 1:
            return columns[..., 0]
        inside = np.clip(height, self.heights[0], self.heights[-1])
        below = np.clip(np.searchsorted(self.heights, inside) - 1, 0, len(self.heights) - 2)
        share = (inside - self.heights[below]) / np.diff(self.heights)[below]
        low, high = (
            np.take_along_axis(columns, place[..., None], -1)[..., 0]
            for place in (below, below + 1)
        )
        return (1.0 - share) * low + share * high


@dataclass(frozen=True)
class SumOfShapes:
    """Several shapes at once."""

    parts: tuple[Shape, ...]

    @property
    def round(self) -> bool:
        """See `Shape`."""
        return all(part.round for part in self.parts)

    def radial(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """See `Shape`."""
        total = np.zeros(np.broadcast(angle, height).shape)
        for part in self.parts:
            total += part.radial(angle, height, order)
        return total


def shape_of(
    half_width: float,
    *,
    lobes: Lobes | None = None,
    barrel: float = 0.0,
    taper: float = 0.0,
    misalignment: tuple[float, float] = (0.0, 0.0),
    table: ShapeTable | None = None,
) -> Shape | None:
    """What is not zero of them, together; None: a round surface."""
    parts: list[Shape] = []
    if lobes is not None and lobes.amplitude:
        parts.append(lobes)
    if barrel or taper:
        parts.append(Profile(half_width, barrel, taper))
    if any(misalignment):
        parts.append(Misalignment(*misalignment))
    if table is not None:
        parts.append(table)
    return SumOfShapes(tuple(parts)) if parts else None
