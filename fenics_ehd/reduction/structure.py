"""What a reduction needs to know about a part, whichever program made it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.errors import SettingsError, StructureError
from fenics_ehd.reduction.boundary_points import load_vectors
from fenics_ehd.reduction.matrices import as_matrix
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.row_blocks import agree


@dataclass(frozen=True, eq=False)
class Bore:
    """Lubricated interface: nodes and pressure load.

    Attributes
    ----------
    radius, width
        Bore radius R2 and bearing width B [m]; the axis is z through the origin.
    nodes
        Global node numbers, shape (m,), sorted by z, then angle, the same on every rank.
    coordinates
        Their positions, shape (m, 3) [m].
    pressure_coordinates
        Positions of the pressure nodes, shape (k, 3) [m], in the same order.
    load
        J = M_ss of (15), (3 nodes) x k: nodal forces [N] of unit nodal pressures
        [Pa], pushing the bore outward. Whatever `as_matrix` takes; in a `Structure` it is
        a PETSc matrix with the rows of K.
    cells, family
        Surface mesh of the displacement: positions in `nodes` of the nodes of each
        bore cell, shape (c, 8, 9 or 6), corners, edge midpoints, centre in dolfinx
        order, and ``"serendipity"``, ``"lagrange"`` or ``"triangle"``. None when
        unknown; a film that does not match the bore needs it.
    pressure_cells, pressure_family
        The same of the pressure nodes.
    reference
        Mean motion of the bore, its centre C2: ``sum_ic reference[i, c, k] u[i, c]`` is for
        k < 3 the mean translation [m], else the mean rotation about the origin [rad], see
        `mean_motion`; shape (m, 3, 6). Read the other way it spreads a unit force or moment
        at C2 over the nodes. None when unknown.
    """

    radius: float
    width: float
    nodes: np.ndarray
    coordinates: np.ndarray
    pressure_coordinates: np.ndarray
    load: PETSc.Mat
    cells: np.ndarray | None = None
    family: str | None = None
    pressure_cells: np.ndarray | None = None
    pressure_family: str | None = None
    reference: np.ndarray | None = None


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
        [Pa] in these cells, as a `fenics_ehd.stress.StressField` or anything else with
        its `shape`, `positions` and `block`; collective. None: they are unknown.
    """

    cells: np.ndarray
    stress: Callable[[np.ndarray], Any] | None = None


@dataclass(frozen=True, eq=False)
class Structure:
    """Linear structure ``M x'' + K x = f`` (16) with a lubricated bore.

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
    bore
        The lubricated interface; None for a part without one, of which only
        static responses and vibration modes can be computed.
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
    bore: Bore | None = None
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
        bore = self.bore
        if bore is not None:
            load = as_matrix(bore.load, comm, "bore.load", rows=rows)
            bore = bore if load is bore.load else replace(bore, load=load)
        converted = {
            "stiffness": stiffness,
            "mass": as_matrix(self.mass, comm, "mass", rows=rows),
            "coordinates": _owned_rows(self.coordinates, stiffness),
            "bore": bore,
            "attachments": {
                name: load_vectors(source, stiffness, name)
                for name, source in self.attachments.items()
            },
            "comm": stiffness.comm.tompi4py(),
        }
        for name, value in converted.items():
            object.__setattr__(self, name, value)

    @property
    def lubricated_bore(self) -> Bore:
        """The bore, of a part that must have one.

        Raises
        ------
        SettingsError
            The part has no bore.
        """
        if self.bore is None:
            raise SettingsError("the structure has no bore: pressure loads need one")
        return self.bore

    @property
    def node_range(self) -> tuple[int, int]:
        """Global numbers of the first node this rank owns and of the one behind its last."""
        first, last = self.stiffness.getOwnershipRange()
        return first // 3, last // 3

    @property
    def size(self) -> int:
        """Number of degrees of freedom of the whole part."""
        return self.stiffness.size[0]


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


def mean_motion(coordinates: np.ndarray, weights: Any) -> np.ndarray:
    """Mean rigid motion of a surface as linear functions of its nodal displacements.

    Least-squares fit of ``a + b x r`` to the displacement u over the surface: the
    a and b that minimise ``int |u - a - b x r|^2 dA``. On a surface centred at the
    origin a is the area-weighted mean of u.

    Parameters
    ----------
    coordinates
        Positions r of the nodes, shape (m, 3) [m].
    weights
        ``int N_i N_j dA`` of the shape functions, shape (m, m), an array or a SciPy sparse
        matrix; or lumped nodal areas, shape (m,) [m^2].

    Returns
    -------
    numpy.ndarray
        shape (m, 3, 6): weights of u_i for the components of a, and those of b about the
        origin. A rigid motion of all nodes gives itself. As nodal forces, column k has a
        resultant of a unit force or moment along its axis at the origin, and no other.

    Raises
    ------
    StructureError
        The nodes lie on one line, so that they have no rotation about it.
    """
    size = np.abs(coordinates).max()
    fields = rigid_fields(coordinates / size).reshape(len(coordinates), 18)
    weighted = weights[:, None] * fields if weights.ndim == 1 else weights @ fields
    weighted, fields = (a.reshape(-1, 6) for a in (weighted, fields))
    gram = fields.T @ weighted
    if not np.linalg.cond(gram) < 1e12:
        raise StructureError("the nodes of a surface lie on one line: it has no mean rotation")
    motion = np.linalg.solve(gram, weighted.T).T
    motion[:, 3:] /= size
    return motion.reshape(-1, 3, 6)
