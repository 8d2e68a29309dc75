"""The part as a reduction takes it: K, M, bores and points, whichever program made them.

Boundary points are load vectors, made from whatever describes their mean displacement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import BORE, Bore, only
from fenics_ehd.reduction.matrices import agree, as_matrix, assemble, owned_range

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
        for vector in source:
            own, total = vector.getSizes()
            owned_range(total, vector.comm.tompi4py(), label, stiffness.local_size[0], own)
        return tuple(source)
    if not (isinstance(source, str | Path | PETSc.Mat) or hasattr(source, "tocsr")):
        from scipy import sparse

        nodes, weights = _weights(source, stiffness.size[0] // 3, label)
        mean = np.bincount(nodes, weights, minlength=stiffness.size[0] // 3)
        source = sparse.kron(mean[:, None], sparse.identity(3), format="csr")
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


@dataclass(frozen=True, eq=False)
class Recovery:
    """Elements of the part, for displacement and stress fields.

    Attributes
    ----------
    cells
        Global node numbers of the cells this rank owns, shape (cells, 20 or 10),
        in the order of VTK's quadratic hexahedron or tetrahedron.
    stress
        From displacements, owned rows of shape (owned dofs, n) [m], to the stresses
        [Pa] in these cells, as a `fenics_ehd.fem.stress.StressField` or anything else with
        its `shape`, `positions` and `block`; collective. None: they are unknown.
    """

    cells: np.ndarray
    stress: Callable[[np.ndarray], Any] | None = None


@dataclass(frozen=True, eq=False)
class Structure:
    """Linear structure ``M x'' + K x = f`` (16) with lubricated bores.

    Degrees of freedom are ``3 * node + component``; rows are distributed over
    the ranks of `comm` by whole nodes.

    The arguments may come from any finite-element program; the attributes hold what is
    described first, ready for use.

    Attributes
    ----------
    stiffness, mass
        K [N/m] and M [kg], symmetric PETSc matrices; given as those, as SciPy sparse
        matrices or as files, see `as_matrix`.
    coordinates
        Positions of the owned nodes, shape (owned nodes, 3) [m]; given for the owned or for
        all nodes.
    bores
        The lubricated interfaces by name, the first with its centre in the origin; given as a
        mapping, or as the `Bore` of a part that has one, which is then ``"bore"``. Of a part
        without any only static responses and vibration modes can be computed.
    attachments
        Load vectors of unit forces along x, y and z at each boundary point.
        The same vectors give the point's mean displacement: force and
        displacement are dual. Given as those, as node numbers, or as nodes with weights, see
        `boundary_points.load_vectors`.
    recovery
        Elements, when displacement fields are to be drawn.
    owner
        Whatever must outlive the matrices; dolfinx frees the communicator they
        live on together with the mesh.
    comm
        MPI communicator (mpi4py) of the matrices. Its ranks share out those that come from
        SciPy or files; PETSc matrices have their own.

    Raises
    ------
    StructureError
        Something cannot be read, or cannot belong to the stiffness matrix. What fits but
        makes no sense `check_structure` finds.
    """

    stiffness: PETSc.Mat
    mass: PETSc.Mat
    coordinates: np.ndarray
    bores: Mapping[str, Bore] = field(default_factory=dict)
    attachments: Mapping[str, tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]] = field(default_factory=dict)
    recovery: Recovery | None = None
    owner: object = None
    comm: MPI.Comm = field(default_factory=lambda: MPI.COMM_WORLD)

    def __post_init__(self) -> None:
        comm = self.comm
        if isinstance(self.stiffness, PETSc.Mat):
            comm = self.stiffness.comm.tompi4py()
        stiffness = as_matrix(self.stiffness, comm, "stiffness")
        rows = stiffness.local_size[0]
        given = {BORE: self.bores} if isinstance(self.bores, Bore) else self.bores
        converted = {
            "stiffness": stiffness,
            "mass": as_matrix(self.mass, comm, "mass", rows=rows),
            "coordinates": _owned_rows(self.coordinates, stiffness),
            "bores": {name: _converted(name, bore, comm, rows) for name, bore in given.items()},
            "attachments": {
                name: load_vectors(source, stiffness, name)
                for name, source in self.attachments.items()
            },
            "comm": stiffness.comm.tompi4py(),
        }
        for name, value in converted.items():
            object.__setattr__(self, name, value)
        for name, matrix in (("stiffness", self.stiffness), ("mass", self.mass)):
            if matrix.size != (self.size, self.size):
                raise StructureError(f"{name} has shape {matrix.size}, not {(self.size,) * 2}")

    @property
    def bore(self) -> Bore:
        """The bore of a part that has one.

        Raises
        ------
        SettingsError
            The part has none, or several.
        """
        return only(self.bores, "structure")

    def every_bore(self) -> list[Bore]:
        """All bores, of which a part that is loaded by pressure has at least one.

        Raises
        ------
        SettingsError
            The part has none.
        """
        return list(self.bores.values()) or [self.bore]

    @cached_property
    def bore_nodes(self) -> np.ndarray:
        """Global numbers of the nodes of all bores, one bore after the other."""
        return np.concatenate([bore.nodes for bore in self.every_bore()])

    @property
    def pressures(self) -> int:
        """Number of pressure nodes of all bores."""
        return sum(len(bore.pressure_coordinates) for bore in self.bores.values())

    @cached_property
    def load(self) -> PETSc.Mat:
        """J of all bores, their columns one after the other; collective."""
        loads = [bore.load for bore in self.every_bore()]
        if len(loads) == 1:
            return loads[0]
        from scipy import sparse

        blocks = []
        for load in loads:
            pointers, columns, values = load.getValuesCSR()
            shape = len(pointers) - 1, load.size[1]
            blocks.append(sparse.csr_matrix((values, columns, pointers), shape=shape))
        return assemble(sparse.hstack(blocks, format="csr"), self.comm)

    @property
    def node_range(self) -> tuple[int, int]:
        """Global numbers of the first node this rank owns and of the one behind its last."""
        first, last = self.stiffness.getOwnershipRange()
        return first // 3, last // 3

    @property
    def size(self) -> int:
        """Number of degrees of freedom of the whole part."""
        return self.stiffness.size[0]


def _converted(name: str, bore: Bore, comm: MPI.Comm, rows: int) -> Bore:
    """A bore with its load matrix in PETSc's format."""
    load = as_matrix(bore.load, comm, f"{name}.load", rows=rows)
    return bore if load is bore.load else replace(bore, load=load)


def _owned_rows(coordinates: np.ndarray, stiffness: PETSc.Mat) -> np.ndarray:
    """Positions of the nodes this rank owns, from those or from all."""
    positions = np.asarray(coordinates, dtype=float)
    first, last = (row // 3 for row in stiffness.getOwnershipRange())
    count = stiffness.size[0] // 3
    given = len(positions)
    problem = None
    if positions.ndim != 2 or positions.shape[1] != 3 or given not in (last - first, count):
        problem = (
            f"coordinates have shape {positions.shape}, the stiffness matrix is one of {count} "
            f"nodes: give ({count}, 3), or on each rank its own nodes' rows"
        )
    agree(stiffness.comm.tompi4py(), problem)
    return positions if given == last - first else positions[first:last]
