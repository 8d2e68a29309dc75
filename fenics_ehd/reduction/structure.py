"""What a reduction needs to know about a part, whichever program made it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import BORE, Bore, only
from fenics_ehd.reduction.boundary_points import load_vectors
from fenics_ehd.reduction.matrices import as_matrix
from fenics_ehd.reduction.row_blocks import RowBlock, agree, assemble


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
        if stiffness.size[0] % 3 or not stiffness.size[0]:
            raise StructureError(f"stiffness has {stiffness.size[0]} rows, not 3 for every node")
        split = f"stiffness: a rank owns {rows} rows, not 3 for every node"
        agree(stiffness.comm.tompi4py(), split if rows % 3 else None)
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
        whole = sparse.hstack(blocks, format="csr")
        block = RowBlock(whole.indptr, whole.indices, whole.data, (self.size, whole.shape[1]))
        return assemble(block, self.comm, "bores")

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
