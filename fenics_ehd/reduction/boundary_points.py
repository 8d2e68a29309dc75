"""Boundary points of a part as load vectors, from whatever describes their mean displacement."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from petsc4py import PETSc

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.matrices import as_matrix

#: Smallest sum of weights, relative to the sum of their magnitudes.
_SMALLEST_SUM = 1e-12


class PointWeights(NamedTuple):
    """A boundary point as the weighted mean displacement of nodes.

    Attributes
    ----------
    nodes
        Global node numbers, shape (k,).
    weights
        Their weights, shape (k,); only the ratios count. One named twice counts twice.
    """

    nodes: np.ndarray
    weights: np.ndarray


def load_vectors(
    source: Any, stiffness: PETSc.Mat, name: str
) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
    """Load vectors of unit forces along x, y and z at a boundary point.

    Parameters
    ----------
    source
        Three vectors, returned as they are; node numbers, shape (k,), of equal weight;
        nodes with weights as `PointWeights` or a plain pair; or the three vectors as the
        columns of a matrix of shape (dofs, 3) that `as_matrix` takes.
    stiffness
        K of the part, whose rows the vectors have, whole nodes on each rank.
    name
        Name of the point, for the messages.

    Raises
    ------
    StructureError
        Nodes or weights that the part cannot have.
    """
    label = f"attachment {name!r}"
    if isinstance(source, tuple | list) and any(isinstance(v, PETSc.Vec) for v in source):
        if len(source) != 3:
            raise StructureError(f"{label} has {len(source)} load vectors, not 3")
        return tuple(source)
    if isinstance(source, str | Path | PETSc.Mat) or hasattr(source, "tocsr"):
        return _columns(source, stiffness, label)
    return _from_weights(*_weights(source, stiffness.size[0] // 3, label), stiffness)


def _columns(
    source: Any, stiffness: PETSc.Mat, label: str
) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
    comm = stiffness.comm.tompi4py()
    matrix = as_matrix(source, comm, label, rows=stiffness.local_size[0])
    if matrix.size[1] != 3:
        raise StructureError(f"{label} has {matrix.size[1]} columns, not 3")
    vectors = tuple(stiffness.createVecLeft() for _ in range(3))
    for column, vector in enumerate(vectors):
        matrix.getColumnVector(column, vector)
    return vectors


def _weights(source: Any, count: int, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of sum one."""
    pair = isinstance(source, tuple) and len(source) == 2
    nodes = np.asarray(source[0] if pair else source)
    if nodes.ndim != 1 or not len(nodes) or nodes.dtype.kind not in "iu":
        raise StructureError(
            f"{label}: node numbers of shape {nodes.shape} and type {nodes.dtype}; give node "
            "numbers, a pair of node numbers and weights, or three load vectors"
        )
    weights = np.asarray(source[1] if pair else np.ones(len(nodes)), dtype=float)
    if weights.shape != nodes.shape:
        raise StructureError(f"{label}: weights of shape {weights.shape} for {len(nodes)} nodes")
    if not 0 <= nodes.min() <= nodes.max() < count:
        wrong = nodes[(nodes < 0) | (nodes >= count)][0]
        raise StructureError(f"{label}: node {wrong} is not one of 0 to {count - 1}")
    total = weights.sum()
    if not abs(total) > _SMALLEST_SUM * np.abs(weights).sum() or not np.isfinite(weights).all():
        raise StructureError(f"{label}: the weights sum to {total:g}, that is no mean")
    return nodes, weights / total


def _from_weights(
    nodes: np.ndarray, weights: np.ndarray, stiffness: PETSc.Mat
) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
    first, last = stiffness.getOwnershipRange()
    mine = (3 * nodes >= first) & (3 * nodes < last)
    mean = np.zeros((last - first) // 3)
    np.add.at(mean, nodes[mine] - first // 3, weights[mine])
    vectors = tuple(stiffness.createVecLeft() for _ in range(3))
    for component, vector in enumerate(vectors):
        values = np.zeros((len(mean), 3))
        values[:, component] = mean
        vector.array = values.ravel()
    return vectors
