"""Film mesh graded by the gap: many cells where the film is thin.

Sommerfeld's variable ``gamma``, ``1 + eps cos(theta) = (1 - eps^2) / (1 - eps cos(gamma))``,
spreads the pressure of a long bearing evenly at every eccentricity; its density
is ``dgamma / dtheta ~ 1 / h``. Cells follow that density, mixed with an even one for
the pressure's slow rise. Towards the ends the pressure of a long bearing falls off
within a length l of the order of the thin part's extent along the circumference: there
the density is ``1 / (d + l)`` at the distance d from the end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.grid import FilmGrid

#: Share of the cells that follows 1 / h; the rest is even. Measured with 64 x 12
#: cells, L/D 0.25 to 4, eccentricity 0.1 to 0.999: 0.5 to 0.85 do not differ by
#: more than 0.1 % in load.
THIN_SHARE = 0.7

#: Share of the cells along the axis that crowd at the ends. With 12 cells even ones err by
#: 1.4 % in load at L/D = 4, eccentricity 0.999; these by 0.1 %.
END_SHARE = 0.8

#: Intervals in which the density is integrated.
SAMPLES = 20000


def gap_graded_grid(
    radius: float,
    width: float,
    cells: tuple[int, int],
    family: str,
    thickness: Callable[[np.ndarray], np.ndarray],
    edges: Sequence[float] = (),
) -> FilmGrid:
    """Grid for a given gap, with cell boundaries at its minimum or at given angles.

    Parameters
    ----------
    radius, width, cells, family
        As for `FilmGrid`.
    thickness
        The gap, any unit, above 0, at angles [rad].
    edges
        Angles that must be cell boundaries, the edges of grooves; without any, a
        boundary lies where the gap is smallest.

    Raises
    ------
    SettingsError
        Fewer cells around than edges.
    """
    around, along = cells
    even = np.linspace(0.0, 2 * np.pi, SAMPLES + 1)
    thinnest = even[np.argmin(thickness(even))]
    start = float(edges[0]) if len(edges) else float(thinnest)
    breaks = _breaks(start, edges)
    if around < len(breaks) - 1:
        raise SettingsError(
            f"{around} cells around cannot resolve {len(breaks) - 1} groove edges: use more cells"
        )
    density = 1.0 / thickness(start + even)
    share = cumulative_trapezoid(density, even, initial=0)
    share_of_turn = share[-1] / (2 * np.pi * density.max())
    share = THIN_SHARE * share / share[-1] + (1 - THIN_SHARE) * even / (2 * np.pi)
    at_breaks = np.interp(breaks, even, share)
    counts = _apportion(np.diff(at_breaks), around)
    targets = np.concatenate(
        [
            np.linspace(low, high, count, endpoint=False)
            for low, high, count in zip(at_breaks[:-1], at_breaks[1:], counts, strict=True)
        ]
    )
    angles = np.interp(targets, share, even)
    # The given angles themselves, not what the two interpolations make of them.
    angles[np.cumsum(counts) - counts] = breaks[:-1]
    angles = start + np.append(angles, 2 * np.pi)
    # 1 / h has a hump as wide as this angle, half a turn when the shaft is centred.
    layer = radius * share_of_turn * np.pi
    return FilmGrid(radius, angles, _towards_ends(width, along, layer), family)


def _breaks(start: float, edges: Sequence[float]) -> np.ndarray:
    """Offsets from `start` that must be boundaries, with 0 and a full turn, ascending."""
    offsets = np.mod(np.asarray(edges, dtype=float) - start, 2 * np.pi)
    offsets = np.sort(np.append(offsets[offsets < 2 * np.pi - 1e-9], 0.0))
    kept = offsets[np.append(True, np.diff(offsets) > 1e-9)]
    return np.append(kept, 2 * np.pi)


def _apportion(shares: np.ndarray, total: int) -> np.ndarray:
    """Whole numbers of at least one with a given total, in proportion to shares."""
    wanted = np.maximum(shares / shares.sum() * total, 1.0)
    counts = np.floor(wanted).astype(int)
    while counts.sum() < total:
        counts[np.argmax(wanted / (counts + 0.5))] += 1
    while counts.sum() > total:
        counts[np.argmax(np.where(counts > 1, counts / wanted, 0.0))] -= 1
    return counts


def _towards_ends(width: float, along: int, layer: float) -> np.ndarray:
    """Cell boundaries that crowd in a layer at both ends [m], shape (along + 1,)."""
    distance = width * np.append(0.0, np.geomspace(1e-8, 0.5, SAMPLES))
    share = np.log1p(distance / layer)
    share = END_SHARE * share / share[-1] + (1 - END_SHARE) * distance / distance[-1]
    wanted = np.linspace(0.0, 2.0, along + 1)
    inward = 0.5 * width - np.interp(np.minimum(wanted, 2.0 - wanted), share, distance)
    return np.where(wanted <= 1.0, -inward, inward)
