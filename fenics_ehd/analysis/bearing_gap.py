"""Film thickness of a rigid bearing whose shaft may be tilted and whose bore may have any shape."""

from __future__ import annotations

import attrs
import numpy as np

from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.base.errors import GapClosedError
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.kinematics import Shape
from fenics_ehd.film.rough_surfaces import DEEPEST_CONTACT

#: Angles and heights at which the gap is sampled before the film has a mesh.
ANGLES = 720
HEIGHTS = 41
AROUND = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)


def shape_of(settings: BearingSettings, angle: float = 0.0) -> Shape:
    """Shape of the bore relative to the shaft, in a frame at an angle from the load line [rad].

    A tilted shaft is a misaligned bore. The angle is zero for a bore that is not round.
    """
    shape = settings.bore_shape or Shape()
    if not any(settings.tilt):
        return shape
    tilt = shape.misalignment - rotation(-angle) @ settings.tilt
    return attrs.evolve(shape, misalignment=tilt.tolist())


def gaps(settings: BearingSettings, position: np.ndarray) -> np.ndarray:
    """Film thickness for an eccentricity, shape (2,) [m], from the load line.

    Returns
    -------
    numpy.ndarray
        Thickness at all `ANGLES` and `HEIGHTS`, shape (720, 41) [m].
    """
    shape = shape_of(settings)
    height = settings.width * np.linspace(-0.5, 0.5, HEIGHTS)
    round_gap = settings.clearance - np.stack([np.cos(AROUND), np.sin(AROUND)], axis=-1) @ position
    return round_gap[:, None] + shape.radial(AROUND[:, None], height)


def open_gaps(settings: BearingSettings, position: np.ndarray) -> np.ndarray:
    """Film thickness for an eccentricity, see `gaps`, of a journal that does not touch the bore.

    Raises
    ------
    GapClosedError
        The thickness is not positive; rough surfaces may overlap, up to a limit.
    """
    film = gaps(settings, position)
    thinnest = float(film.min())
    least = DEEPEST_CONTACT * settings.roughness
    if not thinnest > least:
        also = ", or the deviations of the bore" if settings.bore_shape is not None else ""
        raise GapClosedError(
            f"the film thickness is {thinnest * 1e6:.3g} um at its thinnest, it must be "
            f"{f'above {least * 1e6:.3g} um' if least else 'positive'}: "
            f"lower the eccentricity or the tilt{also}"
        )
    return film
