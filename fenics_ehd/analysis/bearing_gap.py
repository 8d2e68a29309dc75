"""Film thickness of a rigid bearing whose shaft may be tilted and whose bore may have any shape."""

from __future__ import annotations

import attrs
import numpy as np

from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.base.errors import GapClosedError
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.kinematics import Shape
from fenics_ehd.film.rough_surfaces import DEEPEST_CONTACT

#: Numbers of angles and heights at which the gap is sampled. Parabolas in both directions give the
#: minimum between the samples; its relative error is at most 1e-5.
ANGLES = 720
HEIGHTS = 41
AROUND = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)


def shape_of(settings: BearingSettings, angle: float = 0.0) -> Shape:
    """Shape of the bore as seen from the shaft, in a frame at an angle from the load line [rad].

    A tilt of the shaft becomes a misalignment of the bore. If the bore is not round, the angle must
    be zero.
    """
    shape = settings.bore_shape or Shape()
    if not any(settings.tilt):
        return shape
    tilt = shape.misalignment - rotation(-angle) @ settings.tilt
    return attrs.evolve(shape, misalignment=tilt.tolist())


def gaps(settings: BearingSettings, position: np.ndarray) -> np.ndarray:
    """Film thickness for an eccentricity, shape (2,), x along the load [m].

    Returns
    -------
    numpy.ndarray
        Film thickness at all `ANGLES` and `HEIGHTS`, shape (720, 41) [m].
    """
    shape = shape_of(settings)
    height = settings.width * np.linspace(-0.5, 0.5, HEIGHTS)
    round_gap = settings.clearance - np.stack([np.cos(AROUND), np.sin(AROUND)], axis=-1) @ position
    return round_gap[:, None] + shape.radial(AROUND[:, None], height)


def minimum_film(settings: BearingSettings, position: np.ndarray) -> float:
    """Minimum film thickness [m] for an eccentricity, shape (2,), x along the load [m].

    Raises
    ------
    GapClosedError
        The minimum is not positive, or rough surfaces overlap beyond their limit.
    """
    film = gaps(settings, position)
    i, k = np.unravel_index(int(np.argmin(film)), film.shape)
    around = film[np.arange(i - 1, i + 2) % ANGLES, k]
    along = film[i, k - 1 : k + 2] if 0 < k < HEIGHTS - 1 else film[i, [k, k, k]]
    thinnest = float(film[i, k]) - _vertex_depth(around) - _vertex_depth(along)
    least = DEEPEST_CONTACT * settings.roughness
    if not thinnest > least:
        also = ", or the deviations of the bore" if settings.bore_shape is not None else ""
        raise GapClosedError(
            f"the minimum film thickness is {thinnest * 1e6:.3g} um, but must be "
            f"{f'above {least * 1e6:.3g} um' if least else 'positive'}: "
            f"lower the eccentricity or the tilt{also}"
        )
    return thinnest


def _vertex_depth(values: np.ndarray) -> float:
    """Depth of the vertex of a parabola through three values below the middle one, the least."""
    curvature = values[0] - 2 * values[1] + values[2]
    slope = 0.5 * (values[2] - values[0])
    return float(0.5 * slope**2 / curvature) if curvature > 0 else 0.0
