"""Holes in the surface mesh of a bore, as that of an oil passage: their rims, places and sizes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.surface_elements import ELEMENTS

#: Edges that a rim has at least: fewer are those of a face or two that a mesh lacks.
FEWEST_EDGES = 6

#: Slack in deciding whether an edge lies at an end of the bore, over its width.
END_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class BoreHole:
    """A hole in a bore.

    Attributes
    ----------
    rim
        Its nodes one after the other, those in the middle of edges too.
    polygon
        Their angle [rad], within half a turn of the first one's, and height [m], shape (r, 2).
    angle, height
        Middle of its area [rad], [m].
    diameter
        Of the circle of its area on the unwrapped bore [m].
    """

    rim: np.ndarray
    polygon: np.ndarray
    angle: float
    height: float
    diameter: float

    @property
    def area(self) -> float:
        """[rad m]."""
        return abs(_moments(self.polygon)[0])

    @property
    def radius(self) -> float:
        """Of the bore [m]."""
        return float(0.25 * np.pi * self.diameter**2 / self.area)

    def straight(self) -> BoreHole:
        """The same with straight edges between corners, of a mesh of quadratic cells."""
        polygon = self.polygon.copy()
        closed = np.vstack([polygon[0::2], polygon[:1]])
        polygon[1::2] = 0.5 * (closed[:-1] + closed[1:])
        return replace(self, polygon=polygon)

    def contains(self, angle: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Whether points lie within the rim."""
        x = self.angle + np.mod(angle - self.angle + np.pi, 2 * np.pi) - np.pi
        inside = np.zeros(np.shape(x), dtype=bool)
        # Crossings of a ray along the circumference with every edge.
        for (a, low), (b, high) in zip(
            self.polygon, np.roll(self.polygon, -1, axis=0), strict=True
        ):
            crosses = (low > height) != (high > height)
            with np.errstate(divide="ignore", invalid="ignore"):
                place = a + (height - low) / (high - low) * (b - a)
            inside ^= crosses & (x < place)
        return inside


def bore_holes(coordinates: np.ndarray, cells: np.ndarray, family: str) -> list[BoreHole]:
    """Holes of a bore's surface mesh, by height, then angle.

    Parameters
    ----------
    coordinates
        Positions of the nodes about the bore's centre, shape (m, 3) [m].
    cells, family
        As in `BoreSurface`.

    Raises
    ------
    StructureError
        A rim does not close around a hole, or is one of `FEWEST_EDGES` or fewer edges.
    """
    radius = float(np.linalg.norm(coordinates[:, :2], axis=1).mean())
    found = []
    for rim in _rims(coordinates, cells, family):
        angle = np.unwrap(np.arctan2(coordinates[rim, 1], coordinates[rim, 0]))
        polygon = np.column_stack([angle, coordinates[rim, 2]])
        turned = abs(angle[-1] - angle[0]) > np.pi
        edges = len(rim) // (1 if family in ("bilinear", "linear triangle") else 2)
        if turned or edges < FEWEST_EDGES:
            raise StructureError(
                f"the bore is not a whole cylinder: a rim of {edges} edges "
                + ("goes all around it" if turned else f"is no hole, which has {FEWEST_EDGES}")
            )
        area, x, z = _moments(polygon)
        diameter = float(np.sqrt(4 * radius * abs(area) / np.pi))
        found.append(BoreHole(rim, polygon, float(x), float(z), diameter))
    return sorted(found, key=lambda hole: (round(hole.height / radius, 6), hole.angle))


def _moments(polygon: np.ndarray) -> tuple[float, float, float]:
    """Area of a polygon, with its sense, and the middle of the area."""
    first = polygon[0]
    a, b = polygon - first, np.roll(polygon, -1, axis=0) - first
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = 0.5 * cross.sum()
    middle = first + ((a + b) * cross[:, None]).sum(axis=0) / (6 * area)
    return float(area), float(middle[0]), float(middle[1])


def _rims(coordinates: np.ndarray, cells: np.ndarray, family: str) -> list[np.ndarray]:
    """Nodes around every hole: edges of one cell alone that lie at no end of the bore."""
    kind = ELEMENTS[family]
    ends = cells[:, kind.edges].reshape(-1, 2)
    count = len(kind.edges)
    _, first, uses = np.unique(np.sort(ends, axis=1), axis=0, return_index=True, return_counts=True)
    single = first[uses == 1]
    z = coordinates[:, 2]
    slack = END_TOLERANCE * np.ptp(z)
    heights = z[ends[single]]
    at_end = (heights < z.min() + slack).all(axis=1) | (heights > z.max() - slack).all(axis=1)
    single = single[~at_end]
    # Mid-side nodes come behind the corners, edge by edge.
    quadratic = cells.shape[1] >= kind.corners + count
    middles = cells[single // count, kind.corners + single % count] if quadratic else None
    at: dict[int, list[int]] = {}
    for edge, nodes in enumerate(ends[single]):
        for node in nodes:
            at.setdefault(int(node), []).append(edge)
    odd = [node for node, edges in at.items() if len(edges) != 2]
    if odd:
        raise StructureError(
            f"the bore is not a whole cylinder: {len(at[odd[0]])} edges of a rim meet at node "
            f"{odd[0]}"
        )
    loops, left = [], set(range(len(single)))
    while left:
        edge = min(left)
        start, node = (int(n) for n in ends[single[edge]])
        loop = [start]
        while True:
            left.discard(edge)
            if middles is not None:
                loop.append(int(middles[edge]))
            if node == start:
                break
            loop.append(node)
            edge = next(e for e in at[node] if e != edge)
            one, other = (int(n) for n in ends[single[edge]])
            node = other if one == node else one
        loops.append(np.array(loop))
    return loops


def area_vector(coordinates: np.ndarray, hole: BoreHole, family: str) -> np.ndarray:
    """Area of whatever closes a hole, as a vector away from the axis, ``int x x dx / 2``, (3,)."""
    x = coordinates[hole.rim]
    if family in ("bilinear", "linear triangle"):
        total = np.cross(x, np.roll(x, -1, axis=0)).sum(axis=0)
    else:
        a, m, b = x[0::2], x[1::2], np.roll(x, -2, axis=0)[0::2]
        # Of the parabola through three nodes, exactly.
        total = (4 * np.cross(a, m) + 4 * np.cross(m, b) - np.cross(a, b)).sum(axis=0) / 3
    outward = x[:, :2].sum(axis=0)
    return 0.5 * total * np.sign(total[:2] @ outward)
