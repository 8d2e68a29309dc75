"""Film mesh: the unwrapped bore as rectangles, periodic; even, graded, or taken from a bore mesh.

Node numbers run along the axis first, so that a matrix of the film is banded. Cells are numbered in
the same order: cell ``i * along + j`` is the i-th around and the j-th along the axis.

**Grading by the gap** puts many cells where the film is thin. Sommerfeld's variable ``gamma``, with
``1 + eps cos(theta) = (1 - eps^2) / (1 - eps cos(gamma))``, spreads the pressure of a long bearing
evenly at every eccentricity. Points at equal distances of gamma have the density ``dgamma / dtheta
~ 1 / h``. The density of the cells is a weighted mean of this density and of a uniform one, so that
cells are left for the thick film, in which the pressure rises slowly. Towards the ends of a long
bearing the pressure falls off within a length l, which is of the order of the extent of the thin
film along the circumference: the density of the cells along the axis is
``1 / (d + l)`` at the distance d from the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.integrate import cumulative_trapezoid
from scipy.spatial import cKDTree

from fenics_ehd.base.arguments import (
    require_class,
    require_count,
    require_number,
    require_word,
)
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import InterfaceMismatchError, SettingsError
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.base.fields import FILM_ELEMENTS
from fenics_ehd.reduction.elements import ELEMENTS

TURN = 2 * np.pi


@dataclass(frozen=True, eq=False)
class FilmGrid(Described):
    """Cells and nodes of a film mesh on a bore.

    Attributes
    ----------
    radius
        Bore radius R [m].
    angles
        Cell boundaries along the circumference, ascending over one turn,
        shape (around + 1,) [rad].
    heights
        Cell boundaries along the axis, ascending, shape (along + 1,) [m].
    family
        Element family: ``"bilinear"``, ``"serendipity"`` (8-node) or ``"lagrange"`` (9-node).

    Raises
    ------
    SettingsError
        If the radius is not positive, there are fewer than 3 cells around or 1 along, boundaries
        do not ascend, angles do not span one turn, or the family is unknown.
    """

    radius: float
    angles: np.ndarray
    heights: np.ndarray
    family: str = "lagrange"

    def __post_init__(self) -> None:
        require_word("family", self.family, FILM_ELEMENTS)
        require_number("radius", self.radius, above=0)
        around, along = self.cells
        if around < 3 or along < 1:
            raise SettingsError(
                f"the film has {around} x {along} cells: use at least 3 around and 1 along"
            )
        if not (np.all(np.diff(self.angles) > 0) and np.all(np.diff(self.heights) > 0)):
            raise SettingsError("the cell boundaries of the film, angles and heights, must ascend")
        if not abs(self.angles[-1] - self.angles[0] - TURN) < 1e-9:
            raise SettingsError(
                f"the film's cells span {self.angles[-1] - self.angles[0]:.6g} rad, not one turn"
            )

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield cells and size of the mesh."""
        around, along = self.cells
        yield (
            "FilmGrid",
            f"{around} x {along} {self.family} cells, radius {1e3 * self.radius:.5g} mm, "
            f"width {1e3 * self.width:.5g} mm",
        )

    @property
    def cells(self) -> tuple[int, int]:
        """Number of cells along the circumference and along the axis."""
        return len(self.angles) - 1, len(self.heights) - 1

    @property
    def width(self) -> float:
        """Bearing width B [m]."""
        return float(self.heights[-1] - self.heights[0])

    @cached_property
    def _numbers(self) -> np.ndarray:
        """Node numbers on a grid of half cells; -1 at grid points without a node.

        The shape is (2 around, 2 along + 1), for `around` times `along` cells.
        """
        around, along = self.cells
        exists = np.zeros((2 * around, 2 * along + 1), dtype=bool)
        for a, b in self._halves:
            exists[a::2, b::2] = True
        numbers = np.full(exists.shape, -1)
        numbers[exists] = np.arange(exists.sum())
        return numbers

    @property
    def _halves(self) -> np.ndarray:
        """Positions of the k nodes of a cell around and along, counted in half cells, (k, 2).

        Nodes are in the order of dolfinx.
        """
        return np.rint(2 * ELEMENTS[self.family].nodes).astype(int)

    @cached_property
    def node_positions(self) -> np.ndarray:
        """Angle [rad] and height [m] of the nodes, shape (n, 2)."""
        i, j = 0.5 * np.array(np.nonzero(self._numbers >= 0))
        angle = np.interp(i, np.arange(len(self.angles)), self.angles)
        height = np.interp(j, np.arange(len(self.heights)), self.heights)
        return np.column_stack([angle, height])

    @cached_property
    def rows(self) -> FilmRows:
        """Indices, angles and heights of the nodes, arranged in rows around the bore.

        Extremes of nodal fields are interpolated between the nodes of a row.
        """
        return FilmRows.of(*self.node_positions.T)

    @property
    def nodes(self) -> np.ndarray:
        """Cartesian positions of the nodes on the bore, shape (n, 3) [m]."""
        angle, height = self.node_positions.T
        return np.column_stack([self.radius * np.cos(angle), self.radius * np.sin(angle), height])

    @cached_property
    def cell_nodes(self) -> np.ndarray:
        """Node numbers of every cell in dolfinx order, shape (cells, nodes per cell)."""
        around, along = self.cells
        i, j = np.meshgrid(np.arange(around), np.arange(along), indexing="ij")
        a, b = self._halves.T
        i = 2 * i.reshape(-1, 1) + a
        j = 2 * j.reshape(-1, 1) + b
        return self._numbers[i % (2 * around), j]

    @cached_property
    def cell_sizes(self) -> tuple[np.ndarray, np.ndarray]:
        """Size of every cell around [rad], and along the axis over the radius [-], (cells,)."""
        around, along = self.cells
        widths = np.diff(self.angles)
        heights = np.diff(self.heights) / self.radius
        return np.repeat(widths, along), np.tile(heights, around)

    def interpolation(self, angle: np.ndarray, height: np.ndarray) -> sparse.csr_matrix:
        """Matrix from the n nodal values to values at angles [rad] and heights [m], (points, n)."""
        relative = np.mod(angle - self.angles[0], TURN) + self.angles[0]
        around, along = self.cells
        i = np.clip(np.searchsorted(self.angles, relative, "right") - 1, 0, around - 1)
        j = np.clip(np.searchsorted(self.heights, height, "right") - 1, 0, along - 1)
        x = (relative - self.angles[i]) / np.diff(self.angles)[i]
        y = (height - self.heights[j]) / np.diff(self.heights)[j]
        values = ELEMENTS[self.family].shapes(np.column_stack([x, y]))
        columns = self.cell_nodes[i * along + j]
        starts = np.arange(len(values) + 1) * values.shape[1]
        shape = (len(values), len(self.node_positions))
        return sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape)


#: Function that makes the mesh of a film from the edges of its axial grooves [rad].
MeshMaker = Callable[[np.ndarray], FilmGrid]


def uniform_grid(
    radius: float,
    width: float,
    cells: tuple[int, int],
    family: str = "lagrange",
    *,
    start: float = 0.0,
) -> FilmGrid:
    """Film mesh of equal cells, with a cell boundary at angle `start` [rad].

    Raises
    ------
    SettingsError
        If `cells` is not two whole numbers, a size is not above 0, or the family is unknown.
    """
    require_class("cells", cells, tuple, list, np.ndarray)
    if len(cells) != 2:
        raise SettingsError(
            f"cells = {list(cells)} must be two whole numbers, the cells around and along"
        )
    around, along = (require_count(f"cells[{i}]", number) for i, number in enumerate(cells))
    half = 0.5 * require_number("width", width, above=0)
    angles = require_number("start", start) + np.linspace(0.0, TURN, around + 1)
    heights = np.linspace(-half, half, along + 1)
    return FilmGrid(radius, angles, heights, family)


def aligned_grid(grid: FilmGrid, edges: np.ndarray) -> FilmGrid:
    """Film mesh whose cell boundaries nearest to the edges of grooves are moved onto these edges.

    Parameters
    ----------
    grid
        The film mesh to start from.
    edges
        Angles of the edges [rad], shape (e,).

    Raises
    ------
    SettingsError
        If two edges are nearest to the same boundary: the mesh is too coarse.
    """
    if not len(edges):
        return grid
    start = grid.angles[0]
    relative = grid.angles[:-1] - grid.angles[0]
    wanted = _offsets(start, edges)
    apart = np.mod(wanted - relative[:, None] + np.pi, TURN) - np.pi
    nearest = np.argmin(np.abs(apart), axis=0)
    order = np.argsort(nearest, kind="stable")
    fixed = nearest[order]
    wanted = wanted[order]
    clash = np.flatnonzero(np.diff(fixed) == 0)
    if clash.size:
        first, second = np.degrees(start + wanted[clash[0] :][:2])
        raise SettingsError(
            f"{grid.cells[0]} cells around cannot resolve groove edges at {first:.4g} and "
            f"{second:.4g} degrees: use more cells"
        )
    # Boundaries between two fixed ones keep the proportions of their distances.
    source = np.append(relative[fixed], relative[fixed[0]] + TURN)
    target = relative[fixed] + apart[fixed, order]
    target = np.append(target, target[0] + TURN)
    unrolled = np.where(relative < source[0], relative + TURN, relative)
    moved = np.sort(np.interp(unrolled, source, target))
    boundaries = start + np.append(moved, moved[0] + TURN)
    return FilmGrid(grid.radius, boundaries, grid.heights, grid.family)


#: Share of the cells with a density proportional to 1 / h; the density of the others is even.
#: Measured with 64 x 12 cells, L/D 0.25 to 4, eccentricity 0.1 to 0.999: loads with shares of 0.5
#: to 0.85 differ by at most 0.1 %.
THIN_SHARE = 0.7

#: Share of the cells along the axis that are concentrated at the ends. At L/D = 4, eccentricity
#: 0.999, the error of the load is 1.4 % with 12 even cells, and 0.1 % with 12 cells of this share.
END_SHARE = 0.8

#: Number of intervals for integrals of the cell density.
SAMPLES = 20000


def gap_graded_grid(
    radius: float,
    width: float,
    cells: tuple[int, int],
    family: str,
    thickness: Callable[[np.ndarray], np.ndarray],
    edges: Sequence[float] = (),
) -> FilmGrid:
    """Film mesh graded by a gap, with cell boundaries at its minimum or at given angles.

    Parameters
    ----------
    radius, width
        Bore radius and bearing width [m].
    cells, family
        Number of cells around and along; element family, see `FilmGrid`.
    thickness
        Function from angles [rad] to the gap at these angles, above 0, in any unit.
    edges
        Angles that must be cell boundaries, the edges of grooves [rad]; without edges, a
        boundary lies where the gap is smallest.

    Raises
    ------
    SettingsError
        If there are fewer cells around than edges.
    """
    around, along = cells
    even = np.linspace(0.0, TURN, SAMPLES + 1)
    edges = edges if len(edges) else [even[np.argmin(thickness(even))]]
    start = float(edges[0])
    breaks = np.append(_offsets(start, edges), TURN)
    if around < len(breaks) - 1:
        raise SettingsError(
            f"{around} cells around cannot resolve {len(breaks) - 1} groove edges: use more cells"
        )
    density = 1.0 / thickness(start + even)
    share = cumulative_trapezoid(density, even, initial=0)
    share_of_turn = share[-1] / (TURN * density.max())
    share = THIN_SHARE * share / share[-1] + (1 - THIN_SHARE) * even / (TURN)
    at_breaks = np.interp(breaks, even, share)
    counts = _apportion(np.diff(at_breaks), around)
    targets = np.concatenate(
        [
            np.linspace(low, high, count, endpoint=False)
            for low, high, count in zip(at_breaks[:-1], at_breaks[1:], counts, strict=True)
        ]
    )
    angles = np.interp(targets, share, even)
    # The edges are set exactly: the two interpolations above round them.
    angles[np.cumsum(counts) - counts] = breaks[:-1]
    angles = start + np.append(angles, TURN)
    # Length of the thin film around: radius times the width of the peak of 1 / h, which is half a
    # turn if the shaft is centred.
    layer = radius * share_of_turn * np.pi
    return FilmGrid(radius, angles, _towards_ends(width, along, layer), family)


def _offsets(start: float, edges: Sequence[float] | np.ndarray) -> np.ndarray:
    """Angles of edges counted from `start`, without repetitions, ascending in [0, 2 pi) [rad]."""
    offsets = np.mod(np.asarray(edges, dtype=float) - start, TURN)
    offsets = np.sort(np.where(offsets > TURN - 1e-9, 0.0, offsets))
    return offsets[np.append(True, np.diff(offsets) > 1e-9)]


def _apportion(shares: np.ndarray, total: int) -> np.ndarray:
    """Whole numbers, each at least 1, that sum to `total`, in proportion to shares."""
    wanted = np.maximum(shares / shares.sum() * total, 1.0)
    counts = np.floor(wanted).astype(int)
    while counts.sum() < total:
        counts[np.argmax(wanted / (counts + 0.5))] += 1
    while counts.sum() > total:
        counts[np.argmax(np.where(counts > 1, counts / wanted, 0.0))] -= 1
    return counts


def _towards_ends(width: float, along: int, layer: float) -> np.ndarray:
    """Heights of cell boundaries, shape (along + 1,) [m], dense within `layer` [m] of both ends."""
    distance = width * np.append(0.0, np.geomspace(1e-8, 0.5, SAMPLES))
    share = np.log1p(distance / layer)
    share = END_SHARE * share / share[-1] + (1 - END_SHARE) * distance / distance[-1]
    wanted = np.linspace(0.0, 2.0, along + 1)
    inward = 0.5 * width - np.interp(np.minimum(wanted, 2.0 - wanted), share, distance)
    return np.where(wanted <= 1.0, -inward, inward)


#: Largest distance between a film node and its bore node, relative to the radius.
MATCH_TOLERANCE = 1e-6


def _positions(values: np.ndarray, tolerance: float) -> int:
    """Number of distinct values, those within `tolerance` of each other counted once."""
    ordered = np.sort(values)
    return 1 + int(np.sum(np.diff(ordered) > tolerance))


def film_layout(nodes: np.ndarray) -> tuple[tuple[int, int], str]:
    """Number of cells and element family of a film mesh whose nodes are those of a bore.

    Parameters
    ----------
    nodes
        Positions of all bore nodes of a quadratic mesh, shape (m, 3) [m].

    Returns
    -------
    cells : tuple of int
        Number of cells along the circumference and along the axis.
    family : str
        ``"serendipity"`` (8-node) or ``"lagrange"`` (9-node).

    Raises
    ------
    InterfaceMismatchError
        If the nodes are not those of a structured quadratic mesh.
    """
    angle = np.mod(np.arctan2(nodes[:, 1], nodes[:, 0]) + 1e-6, TURN)
    around = _positions(angle, 1e-5) // 2
    radius = np.linalg.norm(nodes[:, :2], axis=1).mean()
    along = (_positions(nodes[:, 2], 1e-5 * radius) - 1) // 2
    full = 2 * around * (2 * along + 1)
    counts = {full: "lagrange", full - around * along: "serendipity"}
    if around < 2 or along < 1 or len(nodes) not in counts:
        raise InterfaceMismatchError(
            f"the {len(nodes)} bore nodes do not form a structured quadratic mesh: {around} x "
            f"{along} cells would have {' or '.join(map(str, sorted(counts)))} nodes"
        )
    return (around, along), counts[len(nodes)]


def film_grid(nodes: np.ndarray) -> FilmGrid:
    """Film mesh with the cells and the element family of a structured mesh of a bore.

    `nodes` has the positions of all bore nodes, shape (m, 3) [m].

    Raises
    ------
    InterfaceMismatchError
        If the nodes are not those of a structured quadratic mesh of equal cells.
    SettingsError
        If `nodes` is not an array of positions.
    """
    require_class("nodes", nodes, np.ndarray)
    if nodes.ndim != 2 or nodes.shape[1] != 3:
        raise SettingsError(f"nodes of shape {nodes.shape} must be positions of shape (m, 3)")
    cells, family = film_layout(nodes)
    radius = float(np.linalg.norm(nodes[:, :2], axis=1).mean())
    angle = np.mod(np.arctan2(nodes[:, 1], nodes[:, 0]), TURN / cells[0])
    # Angles of corner nodes are the start plus whole cells, those of mid-side nodes half a cell
    # further. Every angle of the first row of nodes may be the start.
    first = nodes[:, 2] <= nodes[:, 2].min() + MATCH_TOLERANCE * radius
    half = angle[first] % (np.pi / cells[0])
    starts = half[np.unique(np.round(half, 6), return_index=True)[1]]
    for start in (0.0, *starts, *(starts + np.pi / cells[0])):
        grid = uniform_grid(radius, float(np.ptp(nodes[:, 2])), cells, family, start=start)
        if match(grid.nodes, nodes) is not None:
            return grid
    raise InterfaceMismatchError(
        f"the {len(nodes)} bore nodes are no mesh of {cells[0]} x {cells[1]} equal cells (a node "
        f"of such a mesh is {cKDTree(nodes).query(grid.nodes)[0].max():.2e} m from the nearest "
        "bore node), so that the film needs its own mesh: set its number of cells, for example "
        f"cells = [{cells[0]}, {cells[1]}]"
    )


def match(nodes: np.ndarray, others: np.ndarray) -> np.ndarray | None:
    """Index in `others` of each of the `nodes`, shape (n,); None unless both have the same nodes.

    Both arrays have positions of nodes, shape (n, 3) [m]. Two nodes are the same if their distance
    over the radius is at most `MATCH_TOLERANCE`.
    """
    if len(nodes) != len(others):
        return None
    distance, index = cKDTree(others).query(nodes)
    radius = np.linalg.norm(others[:, :2], axis=1).max()
    return index if distance.max() <= MATCH_TOLERANCE * radius else None
