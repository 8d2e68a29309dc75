"""What shows of a flexible body: its front by the whole part's basis, or rings for its bores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.plotting.animation_part import front_faces
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.reduction.body import bore_fields
from fenics_ehd.results.part_fields import PartFields

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
    fields
        In-plane displacements of unit elastic coordinates, then of residual patterns, shape
        (p, 2, n + r).
    mesh
        False for the rings that stand for a part.
    """

    nodes: np.ndarray
    faces: np.ndarray
    fields: np.ndarray
    mesh: bool = True


def shape_of_part(part: PartFields) -> PartShape:
    """Front of a whole part."""
    faces = front_faces(part.nodes, part.cells)
    shown, local = np.unique(faces, return_inverse=True)
    fields = np.concatenate([part.basis[shown, :2], part.patterns[shown, :2]], axis=2)
    return PartShape(part.nodes[shown], local.reshape(faces.shape), fields)


def shape_of_bores(body: ReducedBody) -> PartShape:
    """A ring around every bore, moved by the bore's edge."""
    nodes: list[np.ndarray] = []
    faces, fields, first = [], [], 0
    for rows in body.each_bore():
        x = rows.surface.coordinates
        edge = np.flatnonzero(x[:, 2] > x[:, 2].max() - 1e-6 * rows.surface.radius)
        edge = edge[np.argsort(np.arctan2(x[edge, 1], x[edge, 0]), kind="stable")]
        outer = len(edge)
        i = first + np.arange(outer)
        j, first = np.roll(i, -1), first + 2 * outer
        faces.append(np.column_stack([i, i + outer, i + outer, j + outer, j + outer, j, j, i]))
        nodes.append(rows.surface.centre + np.vstack([x[edge], x[edge] * [RING, RING, 1.0]]))
        fields += 2 * [bore_fields(body)[rows.nodes][edge, :2]]
    return PartShape(np.vstack(nodes), np.vstack(faces), np.vstack(fields), False)
