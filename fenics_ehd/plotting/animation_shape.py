"""What of a part moves in an animation: its front by the whole part's basis, or its bore alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.plotting.animation_part import front_faces
from fenics_ehd.reduction import BasisFile, ReducedBody

#: Largest difference of bore rows from the body's, relative to the largest of these.
AGREEMENT = 1e-6

#: Outer radius of the ring that stands for a part whose basis is not at hand, over the bore's.
RING = 1.42


@dataclass(frozen=True, eq=False)
class PartShape:
    """Nodes that show, and their displacement from what a run records.

    Attributes
    ----------
    nodes
        shape (p, 3) [m].
    faces
        Nodes around each face that shows, shape (f, v).
    basis, patterns
        Displacements of unit elastic coordinates and residual patterns, shape (p, 3, n) and
        (p, 3, r).
    mesh
        False for the ring that stands for a part.
    """

    nodes: np.ndarray
    faces: np.ndarray
    basis: np.ndarray
    patterns: np.ndarray
    mesh: bool = True

    def displacement(self, coordinates: np.ndarray, quasi_static: np.ndarray) -> np.ndarray:
        """For coordinates (n,) and amplitudes (r,), x and y, shape (p, 2) [m]."""
        return self.basis[:, :2] @ coordinates + self.patterns[:, :2] @ quasi_static


def shape_of_basis(file: BasisFile, body: ReducedBody) -> PartShape | None:
    """Front of a part by its basis on disk, None if that is not the basis of the body.

    Residual patterns (M4) are not in such a file: they move the bore's nodes only.
    """
    nodes, unit = file.nodes, np.eye(file.modes)
    bore = _rows_at(nodes, body.bore_nodes)
    if bore is None or not len(file.cells) or file.modes != body.modes:
        return None
    if not _same_modes(np.moveaxis(file.displacement(unit, bore), 0, -1), body):
        return None
    faces, shown = _front(nodes, file.cells)
    basis = np.moveaxis(file.displacement(unit, shown), 0, -1)
    rank = body.residual.rank if body.residual else 0
    patterns = np.zeros((len(nodes), 3, rank))
    if body.residual is not None:
        patterns[bore] = body.residual.displacement
    return PartShape(nodes[shown], faces, basis, patterns[shown])


def shape_of_bore(body: ReducedBody) -> PartShape:
    """A ring around the bore, and for a rod its shank, moved by the bore's edge and the pin."""
    x = body.bore_nodes
    edge = np.flatnonzero(x[:, 2] > x[:, 2].max() - 1e-6 * body.bore_radius)
    edge = edge[np.argsort(np.arctan2(x[edge, 1], x[edge, 0]), kind="stable")]
    rank = body.residual.rank if body.residual else 0
    rows = body.residual.displacement[edge] if body.residual else np.zeros((len(edge), 3, 0))
    bore = np.concatenate([body.bore_basis[edge], rows], axis=2)
    nodes, fields = [x[edge], x[edge] * [RING, RING, 1.0]], [bore, bore]
    faces = [_ring_faces(len(edge), 0)]
    if "pin" in body.points:
        at_pin = np.hstack([body.points["pin"][:, 3:], np.zeros((3, rank))])
        more, which = _shank(body.points["pin"][:, 0], body.bore_radius, float(x[edge[0], 2]))
        ends = np.stack([bore.mean(axis=0), at_pin])
        faces = [_shank_faces(len(more), 2 * len(edge)), *faces]
        nodes, fields = [*nodes, more], [*fields, ends[which]]
    shown, moved = np.concatenate(nodes), np.concatenate(fields)
    modes = body.modes
    return PartShape(shown, np.concatenate(faces), moved[..., :modes], moved[..., modes:], False)


def bore_displacement(
    body: ReducedBody, coordinates: np.ndarray, quasi_static: np.ndarray
) -> np.ndarray:
    """Radial displacement of the bore's nodes, shape (t, m) [m].

    Parameters
    ----------
    body
        Reduced part.
    coordinates
        Elastic, shape (t, n).
    quasi_static
        Amplitudes of its residual patterns, shape (t, r).
    """
    normal = normals(body)
    result = coordinates @ np.einsum("mc,mcn->nm", normal, body.bore_basis[:, :2])
    if body.residual is not None:
        radial = np.einsum("mc,mcr->rm", normal, body.residual.displacement[:, :2])
        result = result + quasi_static @ radial
    return result


def normals(body: ReducedBody) -> np.ndarray:
    """Outward unit normals of the bore's nodes, shape (m, 2)."""
    x = body.bore_nodes[:, :2]
    return x / np.linalg.norm(x, axis=1)[:, None]


def _front(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces that show, numbered by the nodes they have, and those nodes."""
    faces = front_faces(nodes, cells)
    shown, local = np.unique(faces, return_inverse=True)
    return local.reshape(faces.shape), shown


def _rows_at(nodes: np.ndarray, wanted: np.ndarray) -> np.ndarray | None:
    """Numbers of the nodes at given positions, None if one is missing."""
    from scipy.spatial import cKDTree

    distance, index = cKDTree(nodes).query(wanted)
    return index if distance.max() < 1e-9 else None


def _same_modes(rows: np.ndarray, body: ReducedBody) -> bool:
    if rows.shape != body.bore_basis.shape:
        return False
    largest = np.abs(body.bore_basis).max(initial=0.0)
    return bool(np.abs(rows - body.bore_basis).max(initial=0.0) <= AGREEMENT * largest)


def _ring_faces(count: int, first: int) -> np.ndarray:
    """Quadrilaterals between `count` inner nodes and the outer ones behind them."""
    i = np.arange(count)
    j = (i + 1) % count
    return first + np.column_stack([i, i + count, i + count, j + count, j + count, j, j, i])


def _shank_faces(count: int, first: int) -> np.ndarray:
    """A bar of four nodes, and the ring of the small end behind them."""
    bar = first + np.array([[0, 1, 1, 2, 2, 3, 3, 0]])
    return np.vstack([bar, _ring_faces((count - 4) // 2, first + 4)])


def _shank(pin: np.ndarray, radius: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of a bar from ring to small end and of the latter, and which end they move with."""
    length = float(np.hypot(*pin[:2]))
    along = pin[:2] / length
    across = np.array([-along[1], along[0]])
    half, inner = 0.55 * radius, 0.5 * radius
    outer = 1.75 * inner
    # Its corners lie on the rings.
    start = np.sqrt((RING * radius) ** 2 - half**2) * along
    end = pin[:2] - np.sqrt(outer**2 - half**2) * along
    bar = np.array([start - half * across, end - half * across, end + half * across])
    bar = np.vstack([bar, start + half * across])
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    nodes = np.vstack([bar, pin[:2] + inner * circle, pin[:2] + outer * circle])
    which = np.array([0, 1, 1, 0] + [1] * (2 * len(angle)))
    return np.column_stack([nodes, np.full(len(nodes), height)]), which
