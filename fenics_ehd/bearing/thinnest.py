"""Smallest film of a rigid bearing; where its bore is not round no formula tells it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fenics_ehd.base.errors import GapClosedError, SettingsError
from fenics_ehd.bearing.contact import least_gap
from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.film.shape import Shape

#: Angles and heights at which the film is looked at. Between them a parabola in either direction
#: has the minimum, 1e-5 off where it lies askew.
ANGLES, HEIGHTS = 720, 41
_EVERYWHERE = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)


def end_shifts(width: float, tilt: np.ndarray) -> list[np.ndarray]:
    """Offset of a tilted shaft's centre at the two ends from that at mid-width."""
    shift = 0.5 * width * np.array([tilt[1], -tilt[0]])
    return [shift, -shift]


def minimum_film(settings: BearingSettings, position: np.ndarray) -> float:
    """Smallest film thickness for an eccentricity, shape (2,), from the load line [m].

    In a round bore at an end, in the direction of its centre; in another looked for everywhere.

    Raises
    ------
    GapClosedError
        It is not positive.
    """
    if settings.bore_shape is not None:
        thinnest, also = _shaped_minimum(settings, position), ", or the deviations of the bore"
    else:
        ends = end_shifts(settings.width, np.array(settings.tilt))
        farthest = max(float(np.linalg.norm(position + shift)) for shift in ends)
        thinnest, also = settings.clearance - farthest, ""
    least = least_gap(settings)
    if not thinnest > least:
        raise GapClosedError(
            f"the film thickness is {thinnest * 1e6:.3g} um at its thinnest, it must be "
            f"{f'above {least * 1e6:.3g} um' if least else 'positive'}: "
            f"lower the eccentricity or the tilt{also}"
        )
    return thinnest


def require_open(settings: BearingSettings) -> None:
    """Refuse a bore whose shape leaves no room for a centred shaft.

    Raises
    ------
    SettingsError
        Naming its smallest film.
    """
    try:
        minimum_film(settings, np.zeros(2))
    except GapClosedError as error:
        raise SettingsError(f"bore_shape closes the gap around a centred shaft: {error}") from None


@lru_cache(maxsize=8)
def _outside(shape: Shape, width: float) -> np.ndarray:
    """Deviation at `ANGLES` and `HEIGHTS`, shape (n, k) [m]."""
    height = width * np.linspace(-0.5, 0.5, HEIGHTS)
    return shape.radial(_EVERYWHERE[:, None], height)


def shaped_film(
    settings: BearingSettings,
    angle: np.ndarray,
    position: np.ndarray,
    tilt: np.ndarray,
    turned: float = 0.0,
) -> np.ndarray:
    """Film thickness in a bore that is not round, at angles (n,) and `HEIGHTS` heights [m].

    Angles, eccentricity and tilt in a frame that is turned from the load line [rad].
    """
    assert settings.bore_shape is not None
    height = settings.width * np.linspace(-0.5, 0.5, HEIGHTS)
    if angle is _EVERYWHERE and not turned:
        outside = _outside(settings.bore_shape, settings.width)
    else:
        outside = settings.bore_shape.radial(angle[:, None] + turned, height)
    x, y = position[0] + height * tilt[1], position[1] - height * tilt[0]
    around = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    return settings.clearance + outside - around


def _shaped_minimum(settings: BearingSettings, position: np.ndarray) -> float:
    """Smallest film thickness of a bore that is not round, perhaps not positive [m]."""
    film = shaped_film(settings, _EVERYWHERE, position, np.array(settings.tilt))
    i, k = np.unravel_index(int(np.argmin(film)), film.shape)
    around = film[np.arange(i - 1, i + 2) % ANGLES, k]
    along = film[i, k - 1 : k + 2] if 0 < k < HEIGHTS - 1 else film[i, [k, k, k]]
    return float(film[i, k]) - _below(around) - _below(along)


def _below(values: np.ndarray) -> float:
    """How far below the middle one, the least of three, a parabola through them has its vertex."""
    bend, slope = values[0] - 2 * values[1] + values[2], 0.5 * (values[2] - values[0])
    return float(0.5 * slope**2 / bend) if bend > 0 else 0.0
