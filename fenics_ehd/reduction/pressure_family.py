"""Families of nodal pressures that films make, and pressures that verify such a family.

A film's pressure is smooth along a bore, except at edges of the film: grooves, holes and pockets
under given pressure, and ends of the bore that touch the journal. Jumps around the bore do no harm,
since the part smooths them. With ``zeta = 2 z / B`` along a bore of width B and the angle phi
around it, the base family consists of

    (1 - zeta^2) P_n(zeta) cos m phi,   (1 - zeta^2) P_n(zeta) sin m phi,   m <= M_n,

with Legendre polynomials P_n, and the uniform pressure. An edge at a height within the bore adds
two kinds of axial functions: the polynomials above on every land between edges, and hat functions
that are 1 at one edge and 0 at the neighbouring edges. An edge at an end of the bore adds the axial
functions ``exp(-2 d / (s B))``, where d is the distance from this end, for two relative lengths s.
The functions are evaluated at the pressure nodes, which need not form a grid. Orders M_n are
limited to the shortest wave that the nodes resolve.

A family has levels: each level contains the columns of the level before, and the last level
consists of all nodal pressures. The level that a part needs is determined by pressures that are not
in the family (`verification_pressures`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag, qr

from fenics_ehd.base.described import Described
from fenics_ehd.reduction.bore import BoreSurface, bore_holes

#: Orders M_0, M_1, ... of the levels. Errors of the bore's displacement under the pressures of a
#: run by the first level: 1.0e-4 with 20 x 5 cells, 221 columns; 9e-5 with 40 x 10 cells, 279.
ORDERS = (
    (40, 24, 24, 14, 14, 8, 8, 4),
    (60, 40, 40, 24, 24, 16, 16, 12, 12, 8, 8),
)

#: Orders on the lands between edges, by level. The order of hats is the first one.
LAND_ORDERS = ((24, 14), (40, 40, 24, 24, 14, 14))

#: Largest order of the functions of an edge at an end, by level. Contact pressures are sharp.
END_ORDERS = (40, 60)

#: Lengths of the functions of an edge at an end, over half the width.
END_LENGTHS = (0.05, 0.3)

#: Share of all nodal pressures from which on every nodal pressure is solved for: a family of this
#: size saves too little.
COMPLETE = 0.7

#: Part of a column, relative to its length, that must not be contained in the columns before.
INDEPENDENT = 1e-6

#: Distance from an end of the bore, over its width, within which an edge is at this end.
AT_END = 1e-3

#: Decimals of a rounded angle [rad] or height over the radius, by which nodes of a row are found.
DIGITS = 5


@dataclass(frozen=True, eq=False)
class PressureFamily(Described):
    """Nested sets of nodal pressures on the bores of a part; each pressure acts in one bore only.

    Attributes
    ----------
    bores
        Surface of every bore, by its name.
    edges
        Heights of the films' edges in a bore, measured from its middle, by the name of the bore
        [m]; minus infinity and infinity are the ends of the bore.
    """

    bores: Mapping[str, BoreSurface]
    edges: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @property
    def last(self) -> int:
        """Number of the level that contains every nodal pressure."""
        return len(ORDERS)

    def every_edge(self, name: str) -> tuple[float, ...]:
        """Heights of the edges in a bore [m], ascending: of films, and of holes in its mesh."""
        bore = self.bores[name]
        heights = set(_rounded(self.edges.get(name, ())))
        if bore.cells.size and bore.family:
            for hole in bore_holes(bore.coordinates, bore.cells, bore.family):
                heights |= {round(hole.height + s * 0.5 * hole.diameter, 9) for s in (-1, 1)}
        return tuple(sorted(heights))

    @cached_property
    def base(self) -> np.ndarray:
        """Orthonormal pressures of the base family, as columns, shape (k, r)."""
        return self.columns(0, np.zeros((self._nodes, 0)))

    def up_to(self, level: int) -> np.ndarray:
        """Orthonormal pressures of all levels up to `level`, as columns, shape (k, r)."""
        known = self.base
        for number in range(1, level + 1):
            known = np.hstack([known, self.columns(number, known)])
        return known

    @property
    def _nodes(self) -> int:
        return sum(len(bore.pressure_coordinates) for bore in self.bores.values())

    def columns(self, level: int, known: np.ndarray) -> np.ndarray:
        """Orthonormal pressures, as columns, that a level adds to those of the level before.

        Parameters
        ----------
        level
            Number of the level, 0 for the base family.
        known
            Orthonormal pressures of the level before, as columns, shape (k, r).

        Returns
        -------
        numpy.ndarray
            Added columns, shape (k, c). If the level would have more than the share `COMPLETE` of
            all nodal pressures, the result adds all missing nodal pressures.
        """
        nodes = self._nodes
        if level >= self.last:
            return _complement(known) if known.shape[1] else np.eye(nodes)
        functions = [
            _functions(bore, self.every_edge(name), level) for name, bore in self.bores.items()
        ]
        added = _added(np.asarray(block_diag(*functions)), known)
        if known.shape[1] + added.shape[1] > COMPLETE * nodes:
            return self.columns(self.last, known)
        return added

    def verification(self) -> np.ndarray:
        """Pressures of `verification_pressures` for every bore, zero on other bores, (k, v)."""
        pressures = [
            verification_pressures(bore, self.every_edge(name)) for name, bore in self.bores.items()
        ]
        return np.asarray(block_diag(*pressures))


def _added(columns: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the space by which columns extend the span of known columns."""
    lengths = np.linalg.norm(columns, axis=0)
    # The sine of the shortest wave is zero at all nodes, but for round-off.
    present = lengths > INDEPENDENT * lengths.max()
    columns = columns[:, present] / lengths[present]
    # Twice: the first pass has round-off as large as the part that remains of a known column.
    for _ in range(2):
        columns = columns - known @ (known.T @ columns)
    basis, triangle, _ = qr(columns, mode="economic", pivoting=True)
    added = basis[:, np.abs(np.diag(triangle)) > INDEPENDENT]
    return np.ascontiguousarray(added - known @ (known.T @ added))


def _complement(known: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the space that is orthogonal to known, orthonormal columns."""
    return np.ascontiguousarray(qr(known, mode="full")[0][:, known.shape[1] :])


def _functions(bore: BoreSurface, edges: Sequence[float], level: int) -> np.ndarray:
    """Functions of a level at the pressure nodes of a bore, shape (k, c); they may be dependent."""
    x, y, z = bore.pressure_coordinates.T
    half = 0.5 * bore.width
    waves = _Waves(np.arctan2(y, x), _shortest_wave(bore))
    rows = _rows(bore)
    columns = [
        waves.times(np.ones((len(z), 1)), (0,)),
        waves.times(_bubbles(z / half, ORDERS[level][:rows]), ORDERS[level]),
    ]
    ends = [z_e for z_e in edges if abs(z_e) > half - AT_END * bore.width]
    knots = np.array([-half, *(z_e for z_e in edges if z_e not in ends), half])
    for end in ends:
        distance = np.abs(z - np.copysign(half, end))
        decays = np.exp(-distance[:, None] / (half * np.array(END_LENGTHS)))
        columns.append(waves.times(decays, (END_ORDERS[level],) * len(END_LENGTHS)))
    if len(knots) > 2:
        orders = LAND_ORDERS[level]
        hats = np.column_stack([np.interp(z, knots, hat) for hat in np.eye(len(knots))[1:-1]])
        columns.append(waves.times(hats, orders[:1] * hats.shape[1]))
        for low, high in pairwise(knots):
            within = (2.0 * z - low - high) / (high - low)
            columns.append(waves.times(_bubbles(within, orders), orders))
    return np.hstack(columns)


def _bubbles(zeta: np.ndarray, orders: Sequence[int]) -> np.ndarray:
    """Axial functions ``(1 - zeta^2) P_n(zeta)``, one for each of n orders, shape (k, n).

    The functions are zero where zeta is outside -1 to 1.
    """
    inside = np.clip(zeta, -1.0, 1.0)
    polynomials = np.polynomial.legendre.legvander(inside, len(orders) - 1)
    return (1.0 - inside**2)[:, None] * polynomials


@dataclass(frozen=True, eq=False)
class _Waves:
    """Waves around a bore at its pressure nodes.

    Attributes
    ----------
    angle
        Angles of the nodes, shape (k,) [rad].
    highest
        Order of the shortest wave.
    """

    angle: np.ndarray
    highest: int

    def times(self, profiles: np.ndarray, orders: Sequence[int]) -> np.ndarray:
        """Products of axial profiles and waves around the bore, as columns.

        `profiles` has n profiles, shape (k, n); each is multiplied by all waves up to its order.
        """
        products = []
        for profile, order in zip(profiles.T, orders, strict=False):
            phase = np.arange(min(order, self.highest) + 1) * self.angle[:, None]
            products += [profile[:, None] * np.cos(phase), profile[:, None] * np.sin(phase[:, 1:])]
        return np.hstack(products)


def _shortest_wave(bore: BoreSurface) -> int:
    """Order of the shortest wave around a bore that its pressure nodes resolve."""
    x, y, _ = bore.pressure_coordinates.T
    angles = np.mod(np.round(np.arctan2(y, x), DIGITS), round(2 * np.pi, DIGITS))
    # Angles of a column of nodes scatter by round-off, at the seam by a turn.
    columns = len(np.unique(np.round(angles, DIGITS - 1)))
    return min(columns, _spaced(bore, 2 * np.pi * bore.radius)) // 2


def _rows(bore: BoreSurface) -> int:
    """Number of axial functions that a bore's pressure nodes resolve between its ends."""
    rows = len(np.unique(np.round(bore.pressure_coordinates[:, 2] / bore.radius, DIGITS)))
    return max(1, min(rows, _spaced(bore, bore.width)) - 2)


def _spaced(bore: BoreSurface, length: float) -> int:
    """Length on a bore in halves of the mean spacing of its pressure nodes, rounded up."""
    spacing = np.sqrt(2 * np.pi * bore.radius * bore.width / len(bore.pressure_coordinates))
    return int(np.ceil(2.0 * length / spacing))


def edges_text(edges: Mapping[str, Sequence[float]]) -> str:
    """Edges of films as text for the provenance of a body: ``"bore -0.0044 0.0044, pin 0.0"``."""
    each = {name: map(repr, _rounded(edges[name])) for name in sorted(edges) if edges[name]}
    return ", ".join(" ".join([name, *heights]) for name, heights in each.items())


def _rounded(heights: Sequence[float]) -> list[float]:
    """Distinct heights in ascending order, rounded to a nanometre."""
    return sorted({round(float(height), 9) for height in heights})


def edges_of(text: str) -> dict[str, tuple[float, ...]]:
    """Edges of films from the text of a body's provenance, see `edges_text`."""
    entries = (entry.split() for entry in text.split(", ") if entry)
    return {name: tuple(map(float, heights)) for name, *heights in entries}


def missing_edges(
    provenance: Mapping[str, str], edges: Mapping[str, Sequence[float]]
) -> dict[str, list[float]]:
    """Heights of film edges for which the pressure family of a body was not made, by bore [m].

    Parameters
    ----------
    provenance
        Provenance of the body. Without an entry ``pressure_level``, the family consists of all
        nodal pressures, as for M4 in version 0.3.
    edges
        Heights of the edges of the films in the body's bores, by the name of the bore [m].
    """
    if int(provenance.get("pressure_level", len(ORDERS))) >= len(ORDERS):
        return {}
    known = edges_of(provenance["film_edges"])
    each = {
        name: sorted({*_rounded(heights)} - {*known.get(name, ())})
        for name, heights in edges.items()
    }
    return {name: heights for name, heights in each.items() if heights}


# Verification

#: Eccentricities of the short bearings, straight and tilted, with which families are verified.
STRAIGHT = (0.3, 0.6, 0.8, 0.9, 0.95, 0.99)
TILTED = (0.6, 0.8, 0.9, 0.95)

#: Angle from one verification pressure to the next [rad]: the golden one, of which no multiple is
#: a whole number of turns.
TURN = np.pi * (3.0 - np.sqrt(5.0))

#: Pressures of a slider-crank with an elastic rod at four crank angles, by 16-bit integers over the
#: largest: shape (4, heights from the middle to an end, angles of a turn).
STORED = Path(__file__).with_name("film_pressures.npy")


def short_bearing(
    angle: np.ndarray, eccentricity: float, turn: float, direction: int
) -> np.ndarray:
    """Half-Sommerfeld pressure around a short bearing, at most 1.

    Parameters
    ----------
    angle
        Angles of the nodes, shape (k,) [rad].
    eccentricity, turn
        Relative eccentricity, and angle of the thickest film [rad].
    direction
        Direction of rotation, 1 or -1.
    """
    theta = direction * (angle - turn)
    around = np.maximum(np.sin(theta), 0.0) / (1.0 + eccentricity * np.cos(theta)) ** 3
    return np.asarray(around / max(around.max(), np.finfo(float).tiny))


def verification_pressures(bore: BoreSurface, edges: Sequence[float]) -> np.ndarray:
    """Pressures outside of the pressure family, with which the error of the family is measured.

    There are 16 pressures: ten of short bearings with several eccentricities (six straight, four
    tilted), one that is flat along the bore, one with peaks near the ends, and four from a run with
    an elastic bore. Edges within the bore add two pressures: of grooves without and with pressure.
    Each edge at an end of the bore adds the pressure of a contact there. All angles are fixed.

    Parameters
    ----------
    bore
        Surface of the bore.
    edges
        Heights of the films' edges [m].

    Returns
    -------
    numpy.ndarray
        Pressures, shape (k, v) [Pa], at most 1.
    """
    x, y, z = bore.pressure_coordinates.T
    angle = np.arctan2(y, x)
    half = 0.5 * bore.width
    zeta = z / half
    parabola = np.maximum(1.0 - zeta**2, 0.0)
    profiles = [parabola] * len(STRAIGHT) + [parabola * (1.0 + 0.5 * zeta)] * len(TILTED)
    eccentricities = [*STRAIGHT, *TILTED, 0.8, 0.8]
    profiles += [np.maximum(1.0 - zeta**8, 0.0), parabola * (0.3 + np.abs(zeta) ** 5)]
    ends = [end for end in edges if abs(end) > half - AT_END * bore.width]
    knots = [-half, *(edge for edge in edges if edge not in ends), half]
    if len(knots) > 2:
        profiles += [_drained(z, knots), np.interp(z, knots, [0.0, *[1.0] * (len(knots) - 2), 0.0])]
        eccentricities += [0.8, 0.8]
    for end in ends:
        profiles.append(np.exp(-np.abs(z - np.copysign(half, end)) / (0.1 * half)))
        eccentricities.append(0.8)
    columns = [
        profile * short_bearing(angle, eccentricity, TURN * number, (-1) ** number)
        for number, (profile, eccentricity) in enumerate(
            zip(profiles, eccentricities, strict=True), start=1
        )
    ]
    return np.column_stack([*columns, stored_pressures(angle, zeta)])


def _drained(z: np.ndarray, knots: Sequence[float]) -> np.ndarray:
    """Axial pressure profile between grooves without pressure: a parabola on every land, (k,)."""
    profile = np.zeros(len(z))
    for low, high in pairwise(knots):
        within = np.clip((2.0 * z - low - high) / (high - low), -1.0, 1.0)
        profile = np.maximum(profile, 1.0 - within**2)
    return profile


def stored_pressures(angle: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """The four pressures of `STORED` at angles [rad] and relative heights, shape (k, 4)."""
    table = _stored()
    last = table.shape[1] - 1
    columns = table.shape[2]
    height = np.clip(np.abs(zeta), 0.0, 1.0) * last
    position = np.mod(angle / (2 * np.pi), 1.0) * columns
    row = np.minimum(height.astype(int), last - 1)
    column = position.astype(int)
    weights = {0: 1.0 - position + column, 1: position - column}
    pressures = np.zeros((len(table), len(angle)))
    for k, weight in weights.items():
        lower = table[:, row, (column + k) % columns]
        upper = table[:, row + 1, (column + k) % columns]
        pressures += weight * (lower + (height - row) * (upper - lower))
    return np.asarray(pressures.T)


@cache
def _stored() -> np.ndarray:
    """Table of the pressures in the file `STORED`, scaled to the largest value 1."""
    return np.load(STORED).astype(float) / np.iinfo(np.uint16).max
