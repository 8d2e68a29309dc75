"""Pressure distributions that generate residual modes, (34), (35), or given ones.

Patterns may be trained on snapshots: what a former run recorded, in a few columns.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction.bore import Bore
from fenics_ehd.reduction.residual_modes import RANK_TOLERANCE
from fenics_ehd.reduction.structure import Structure

#: Mean pressure of the long and peak pressure of the short bearing solution, section 4.2.
LONG_BEARING_PRESSURE = 1.0
SHORT_BEARING_PRESSURE = 1.5

#: Scatter of the angles of nodes at one position [rad].
ANGLE_TOLERANCE = 1e-5

#: Eccentricities and powers of the axial parabola of `journal_shapes`.
JOURNAL_ECCENTRICITIES = (0.5, 0.8, 0.9, 0.95)
AXIAL_POWERS = (0.5, 1.0)

#: Circumferential positions on an unstructured bore, those of the paper's.
HAT_POSITIONS = 40


def unit_pressures(bore: Bore) -> np.ndarray:
    """``P_c1 = I`` (34), shape (k, k)."""
    return np.eye(len(bore.pressure_coordinates))


def long_bearing_shapes(bore: Bore) -> np.ndarray:
    """First half of (35): constant in z at every circumferential position, shape (k, m_sy)."""
    return LONG_BEARING_PRESSURE * _positions(bore)


def short_bearing_shapes(bore: Bore) -> np.ndarray:
    """Second half of (35): a parabola in z at every circumferential position, shape (k, m_sy)."""
    parabola = 1.0 - (2.0 * bore.pressure_coordinates[:, 2] / bore.width) ** 2
    return SHORT_BEARING_PRESSURE * parabola[:, None] * _positions(bore)


def bearing_shapes(bore: Bore) -> np.ndarray:
    """``P_c2`` (35): long and short bearing shapes at every circumferential position.

    Returns
    -------
    numpy.ndarray
        shape (k, 2 m_sy): first the long (constant in z), then the short
        (parabolic in z) bearing solutions, by ascending angle.
    """
    return np.hstack([long_bearing_shapes(bore), short_bearing_shapes(bore)])


def _positions(bore: Bore) -> np.ndarray:
    """One pattern for each circumferential position, by ascending angle, shape (k, m_sy)."""
    x, y, _ = bore.pressure_coordinates.T
    # A mesh scatters about angle zero.
    angle = np.mod(np.arctan2(y, x) + ANGLE_TOLERANCE, 2 * np.pi)
    return _hats(angle - ANGLE_TOLERANCE) if bore.pressure_family == "triangle" else _columns(angle)


def _columns(angle: np.ndarray) -> np.ndarray:
    """One at the nodes of each circumferential position of a structured bore."""
    order = np.argsort(angle)
    steps = np.diff(angle[order], prepend=angle[order[0]]) > 2 * ANGLE_TOLERANCE
    position = np.empty(len(angle), dtype=int)
    position[order] = np.cumsum(steps)
    return np.eye(position.max() + 1)[position]


def _hats(angle: np.ndarray) -> np.ndarray:
    """Piecewise linear hats at evenly spaced positions, for a bore without columns of nodes.

    At the nodes of a structured bore with as many positions they are `_columns`.
    """
    place = angle / (2 * np.pi) * HAT_POSITIONS
    distance = place[:, None] - np.arange(HAT_POSITIONS)
    distance -= HAT_POSITIONS * np.round(distance / HAT_POSITIONS)
    return np.maximum(1.0 - np.abs(distance), 0.0)


def journal_shapes(bore: Bore) -> np.ndarray:
    """Pressures that journals make: short-bearing solutions at every angle, not only their pieces.

    Half-Sommerfeld pressures of several eccentricities, turning either way, with a parabola
    along the bore and a flatter profile that a bent bore has. Smooth, as real pressures are: the
    most energetic combinations of their responses need fewer modes than those of (35).

    Returns
    -------
    numpy.ndarray
        shape (k, 16 `HAT_POSITIONS`), of a much lower rank.
    """
    x, y, z = bore.pressure_coordinates.T
    parabola = np.maximum(1.0 - (2.0 * z / bore.width) ** 2, 0.0)
    angle = np.arctan2(y, x)
    turn = 2 * np.pi * np.arange(HAT_POSITIONS) / HAT_POSITIONS
    columns = []
    for eccentricity in JOURNAL_ECCENTRICITIES:
        for direction in (-1.0, 1.0):
            theta = direction * (angle[:, None] - turn)
            around = np.maximum(np.sin(theta), 0.0) / (1.0 + eccentricity * np.cos(theta)) ** 3
            around /= around.max()
            columns += [parabola[:, None] ** power * around for power in AXIAL_POWERS]
    return np.hstack(columns)


PRESSURE_SETS = {
    "pc1": unit_pressures,
    "pc2": bearing_shapes,
    "pc2-long": long_bearing_shapes,
    "pc2-short": short_bearing_shapes,
    "journal": journal_shapes,
}


def pressure_patterns(structure: Structure, pressure_set: str | np.ndarray) -> np.ndarray:
    """Pressure patterns ``P_c`` by name, or the given columns if they fit.

    Returns
    -------
    numpy.ndarray
        shape (k, p) [Pa]; of several bores, a pattern of one of them is zero on the others.

    Raises
    ------
    SettingsError
        No set has this name, or the columns are no finite nodal pressures of the bores.
    """
    bores = structure.every_bore()
    if isinstance(pressure_set, str):
        if pressure_set not in PRESSURE_SETS:
            known = ", ".join(PRESSURE_SETS)
            raise SettingsError(f"pressure_set {pressure_set!r} is not one of {known}")
        return _apart([PRESSURE_SETS[pressure_set](bore) for bore in bores])
    patterns = np.asarray(pressure_set, dtype=float)
    nodes = structure.pressures
    if patterns.ndim != 2 or len(patterns) != nodes or not patterns.shape[1]:
        raise SettingsError(
            f"pressure_set has shape {patterns.shape}: it needs columns of {nodes} nodal pressures"
        )
    if not np.isfinite(patterns).all():
        raise SettingsError("pressure_set holds a value that is not finite")
    return patterns


def _apart(patterns: list[np.ndarray]) -> np.ndarray:
    """Patterns of every bore on its own pressure nodes, zero on those of the others."""
    if len(patterns) == 1:
        return patterns[0]
    rows, columns = np.cumsum([(0, 0), *(p.shape for p in patterns)], axis=0).T
    whole = np.zeros((rows[-1], columns[-1]))
    for pattern, row, column in zip(patterns, rows, columns, strict=False):
        whole[row : row + len(pattern), column : column + pattern.shape[1]] = pattern
    return whole


# Patterns of a run

#: Relative difference of singular values below which round-off chooses their vectors.
EQUAL = 1e-6


def proper_orthogonal(snapshots: np.ndarray, count: int) -> np.ndarray:
    """Proper orthogonal decomposition of recorded pressures, largest share first.

    Equal singular values belong to a space, and its basis is round-off of the linear algebra
    library: what `count` would cut is kept whole, so there may be more patterns than asked for.

    The columns are nodal pressures of equal weight; the
    directions of least squares error keep what the pressures were and
    know nothing of the part. (Largest eigenvalues of ``K_cc`` are the same
    decomposition in the norm of the strain energy, after solving for every column.)

    Parameters
    ----------
    snapshots
        Nodal pressures, shape (k, p) [Pa].
    count
        Patterns wanted.

    Returns
    -------
    numpy.ndarray
        Orthonormal patterns, shape (k, r): `count` or more, or fewer if the rank is.
    """
    left, sizes, _ = np.linalg.svd(snapshots, full_matrices=False)
    rank = int(np.sum(sizes > RANK_TOLERANCE * sizes.max(initial=0.0)))
    while 0 < count < rank and sizes[count] > (1.0 - EQUAL) * sizes[count - 1]:
        count += 1
    return left[:, : min(count, rank)]
