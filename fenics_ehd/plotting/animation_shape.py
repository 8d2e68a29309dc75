"""What shows of a flexible body: its front by the whole part's basis, or rings for its bores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.plotting.animation_part import front_faces
from fenics_ehd.reduction import BasisFile, ReducedBody
from fenics_ehd.reduction.body import bore_fields

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


def shape_of_basis(file: BasisFile, body: ReducedBody) -> PartShape | None:
    """Front of a part by its basis on disk, None if that is not the basis of the body.

    Residual patterns (M4) are not in such a file: they move the bore's nodes only.
    """
    nodes, unit, moved = file.nodes, np.eye(file.modes), bore_fields(body)
    distance, bore = cKDTree(nodes).query(body.places())
    if distance.max() > 1e-9 or not len(file.cells) or file.modes != body.modes:
        return None
    rows, found = body.bore_basis, np.moveaxis(file.displacement(unit, bore), 0, -1)
    # A mode has no sign of its own: two reductions of one part may choose different ones.
    signs = np.where(np.einsum("mcn,mcn->n", rows, found) < 0, -1.0, 1.0)
    if np.abs(signs * found - rows).max(initial=0.0) > AGREEMENT * np.abs(rows).max(initial=0.0):
        return None
    faces = front_faces(nodes, file.cells)
    shown, local = np.unique(faces, return_inverse=True)
    fields = np.zeros((len(nodes), 2, moved.shape[2]))
    found = file.displacement(np.diag(signs), shown)[..., :2]
    fields[shown, :, : body.modes] = np.moveaxis(found, 0, -1)
    fields[bore] = moved[:, :2]
    return PartShape(nodes[shown], local.reshape(faces.shape), fields[shown])


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
