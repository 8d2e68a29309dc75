"""Structure: a part as input of a reduction, with matrices, bores and points from any program.

A boundary point is described by its load vectors, which are made from nodes, weights or a matrix.
`check_structure` checks a part before a reduction; the checks of its matrices are those of
`fenics_ehd.reduction.matrix_check`. The checks cost 15 to 35 products with a matrix on one rank and
twice as many on several ranks, but no factorisation.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from fenics_ehd.base.arguments import require_count
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.reduction.bore import (
    BORE,
    CYLINDER_TOLERANCE,
    Bore,
    BoreSurface,
    bore_holes,
    only,
    rigid_fields,
)
from fenics_ehd.reduction.elements import surface_element
from fenics_ehd.reduction.matrices import (
    agree,
    as_matrix,
    assemble,
    inner,
    load_columns,
    owned_range,
)
from fenics_ehd.reduction.matrix_check import (
    FORCED_EVERYWHERE,
    MOST_DIGITS,
    RigidMotions,
    require,
    require_finite,
    require_matrices,
)

#: Sum of weights, relative to the sum of their magnitudes, above which they define a mean.
_SMALLEST_SUM = 1e-12


class PointWeights(NamedTuple):
    """A boundary point whose displacement is the weighted mean over nodes.

    Attributes
    ----------
    nodes
        Global node numbers, shape (k,).
    weights
        Weights of the nodes, shape (k,); only their ratios matter. Weights of a repeated node add.
    """

    nodes: np.ndarray
    weights: np.ndarray


def load_vectors(
    source: Any, stiffness: PETSc.Mat, name: str
) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
    """Make the load vectors of unit forces along x, y and z at a boundary point.

    Parameters
    ----------
    source
        Three vectors, which are returned unchanged; numbers of nodes with equal weights, shape
        (k,); nodes with weights, as `PointWeights` or a pair; or a matrix of shape (dofs, 3) with
        the vectors as columns, in a form that `as_matrix` accepts.
    stiffness
        Stiffness matrix of the part; the vectors are distributed as its rows.
    name
        Name of the point for messages.

    Raises
    ------
    StructureError
        If nodes, weights or vectors do not fit the part.
    """
    label = f"attachment {name!r}"
    if isinstance(source, tuple | list) and any(isinstance(v, PETSc.Vec) for v in source):
        if len(source) != 3:
            raise StructureError(f"{label} has {len(source)} load vectors, not 3")
        for vector in source:
            owned, total = vector.getSizes()
            owned_range(total, vector.comm.tompi4py(), label, stiffness.local_size[0], owned)
        return tuple(source)
    if not (isinstance(source, str | Path | PETSc.Mat) or hasattr(source, "tocsr")):
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
    """Node numbers, and their weights divided by their sum, from nodes or nodes with weights.

    Raises
    ------
    StructureError
        If the nodes are not among the `count` nodes of the part, or if the weights define no mean.
    """
    pair = isinstance(source, tuple) and len(source) == 2
    nodes = np.asarray(source[0] if pair else source)
    if nodes.ndim != 1 or not len(nodes) or nodes.dtype.kind not in "iu":
        raise StructureError(
            f"{label}: node numbers have shape {nodes.shape} and type {nodes.dtype}; give node "
            "numbers, a pair of node numbers and weights, or three load vectors"
        )
    weights = np.asarray(source[1] if pair else np.ones(len(nodes)), dtype=float)
    if weights.shape != nodes.shape:
        raise StructureError(
            f"{label}: weights have shape {weights.shape}, but there are {len(nodes)} nodes"
        )
    if not 0 <= nodes.min() <= nodes.max() < count:
        wrong = nodes[(nodes < 0) | (nodes >= count)][0]
        raise StructureError(f"{label}: node {wrong} is not one of 0 to {count - 1}")
    total = weights.sum()
    if not abs(total) > _SMALLEST_SUM * np.abs(weights).sum() or not np.isfinite(weights).all():
        raise StructureError(
            f"{label}: the sum of the weights is {total:g}: a mean needs finite weights with a sum "
            "other than 0"
        )
    return nodes, weights / total


@dataclass(frozen=True, eq=False)
class Recovery:
    """Elements of a part, which are needed to recover displacement and stress fields.

    Attributes
    ----------
    cells
        Global node numbers of the cells of this rank, shape (cells, 20 or 10), in the order of
        VTK's quadratic hexahedron or tetrahedron.
    stress
        Collective function from displacements, rows of this rank, shape (owned dofs, n) [m], to
        stresses [Pa] in these cells. It returns a `fenics_ehd.fem.stress.StressField` or an
        object that also has `shape`, `positions` and `block`. None if stresses are unknown.
    """

    cells: np.ndarray
    stress: Callable[[np.ndarray], Any] | None = None


@renamed_attributes(reach="largest_coordinate")
@dataclass(frozen=True, eq=False)
class Structure(Described):
    """Linear structure ``M x'' + K x = f`` (16) with lubricated bores.

    Degrees of freedom are ``3 * node + component``. Rows are distributed over the ranks of `comm`;
    a rank owns all three rows of a node.

    Arguments may come from any finite-element program. Some are accepted in several forms and
    converted: an attribute has the form that is described first.

    Attributes
    ----------
    stiffness, mass
        Symmetric PETSc matrices K [N/m] and M [kg]. Also accepted: SciPy sparse matrices, files,
        see `as_matrix`.
    coordinates
        Positions of the nodes of this rank, shape (owned nodes, 3) [m]. Also accepted: positions
        of all nodes.
    bores
        Lubricated bores by name; the first has its centre at the origin. Also accepted: a single
        `Bore`, which gets the name ``"bore"``. For a part without bores only static responses
        and vibration modes can be computed.
    attachments
        Load vectors of unit forces along x, y and z at each boundary point, by name. The products
        of these vectors and the nodal displacements are the displacement of the point. Also
        accepted: node numbers, or nodes with weights, see `load_vectors`.
    recovery
        Elements for displacement and stress fields; None if unknown.
    owner
        Object that exists as long as the structure. A dolfinx mesh must outlive the matrices,
        because dolfinx frees the communicator together with the mesh.
    digits
        Digits of the file from which K was read, if K was rotated, or converted by another factor
        than a power of ten; None to count them in the values. Elastic forces in rigid motions that
        this rounding causes are accepted.
    comm
        MPI communicator (mpi4py) of the ranks that share the matrices. PETSc matrices keep their
        own communicator.

    Raises
    ------
    StructureError
        If an argument cannot be read or does not fit the stiffness matrix. The values are checked
        by `check_structure`.
    """

    stiffness: PETSc.Mat
    mass: PETSc.Mat
    coordinates: np.ndarray
    bores: Mapping[str, Bore] = field(default_factory=dict)
    attachments: Mapping[str, tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]] = field(default_factory=dict)
    recovery: Recovery | None = None
    owner: object = None
    digits: int | None = None
    comm: MPI.Comm = field(default_factory=lambda: MPI.COMM_WORLD)

    def __post_init__(self) -> None:
        comm = self.comm
        if self.digits is not None:
            require_count("digits", self.digits, 1, MOST_DIGITS)
        if isinstance(self.stiffness, PETSc.Mat):
            comm = self.stiffness.comm.tompi4py()
        stiffness = as_matrix(self.stiffness, comm, "stiffness")
        rows = stiffness.local_size[0]
        bores = {BORE: self.bores} if isinstance(self.bores, Bore) else self.bores
        converted = {
            "stiffness": stiffness,
            "mass": as_matrix(self.mass, comm, "mass", rows=rows),
            "coordinates": _owned_rows(self.coordinates, stiffness),
            "bores": {name: _converted(name, bore, comm, rows) for name, bore in bores.items()},
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
        """Bore of the part, if it has exactly one.

        Raises
        ------
        SettingsError
            If the part has no bore or several bores.
        """
        return only(self.bores, "structure")

    def every_bore(self) -> list[Bore]:
        """List all bores of a part that has at least one.

        Raises
        ------
        SettingsError
            If the part has no bore.
        """
        return list(self.bores.values()) or [self.bore]

    @cached_property
    def bore_nodes(self) -> np.ndarray:
        """Global numbers of the nodes of all bores, one bore after the other, shape (m,)."""
        return np.concatenate([bore.nodes for bore in self.every_bore()])

    @property
    def pressures(self) -> int:
        """Number of pressure nodes of all bores."""
        return sum(len(bore.pressure_coordinates) for bore in self.bores.values())

    @cached_property
    def load(self) -> PETSc.Mat:
        """Load matrix J of all bores, with the columns of one bore after the other; collective."""
        loads = [bore.load for bore in self.every_bore()]
        if len(loads) == 1:
            return loads[0]
        blocks = []
        for load in loads:
            pointers, columns, values = load.getValuesCSR()
            shape = len(pointers) - 1, load.size[1]
            blocks.append(sparse.csr_matrix((values, columns, pointers), shape=shape))
        return assemble(sparse.hstack(blocks, format="csr"), self.comm)

    @cached_property
    def largest_coordinate(self) -> float:
        """Largest magnitude of the coordinates of all nodes [m]; collective."""
        return self.comm.allreduce(np.abs(self.coordinates).max(initial=0.0), op=MPI.MAX)

    @property
    def node_range(self) -> tuple[int, int]:
        """Global numbers of this rank's first node, and of the node after its last one."""
        first, last = self.stiffness.getOwnershipRange()
        return first // 3, last // 3

    @property
    def size(self) -> int:
        """Number of degrees of freedom of the whole part."""
        return self.stiffness.size[0]


def _converted(name: str, bore: Bore, comm: MPI.Comm, rows: int) -> Bore:
    """Convert the load matrix of a bore to PETSc's format; return the bore."""
    load = as_matrix(bore.load, comm, f"{name}.load", rows=rows)
    return bore if load is bore.load else replace(bore, load=load)


def _owned_rows(coordinates: np.ndarray, stiffness: PETSc.Mat) -> np.ndarray:
    """Positions of the nodes of this rank, from an array of those nodes or of all nodes.

    Raises
    ------
    StructureError
        If the array has neither of these two shapes.
    """
    positions = np.asarray(coordinates, dtype=float)
    first, last = (row // 3 for row in stiffness.getOwnershipRange())
    count = stiffness.size[0] // 3
    rows = len(positions)
    problem = None
    if positions.ndim != 2 or positions.shape[1] != 3 or rows not in (last - first, count):
        problem = (
            f"coordinates have shape {positions.shape}, but the stiffness matrix has {count} "
            f"nodes: give ({count}, 3), or on each rank the rows of its own nodes"
        )
    agree(stiffness.comm.tompi4py(), problem)
    return positions if rows == last - first else positions[first:last]


# Checks

#: Largest deviation of a boundary point's displacement from 1 or 0 under a unit translation.
WEIGHT_TOLERANCE = 1e-8

#: Smallest eigenvalue of the Gram matrix of the unit load vectors of two different boundary points.
INDEPENDENT = 1e-10

#: Largest distance between a node of a bore and the same node of the part, relative to the radius.
#: In files with rounded numbers the bore's node is on the cylinder, the part's node is not.
PLACE_TOLERANCE = 1e-4

#: Largest relative difference between the volume swept by a uniform pressure and that of a
#: cylinder. A hexagon with its corners on the circle has 9 % less.
SWEPT_TOLERANCE = 0.2

#: Largest relative deviation between the mean motion of a rigidly moved bore and its motion.
REFERENCE_TOLERANCE = 1e-8

#: Largest force on a node off the bore, relative to the largest force on a node of the bore.
ROUND_OFF = 1e-9


def check_structure(structure: Structure) -> RigidMotions:
    """Check that matrices, coordinates, bores and boundary points describe one part; collective.

    A motion without energy that is not rigid, for instance of a loose piece, is detected by
    `StaticSolver`, not here.

    Returns
    -------
    RigidMotions
        Rigid motions of the part.

    Raises
    ------
    StructureError
        If `require_matrices` refuses the matrices; if a load matrix has a value that is not finite;
        if bore nodes are not on the bore, or its load matrix does not push outward; if
        the first bore is not at the origin, or two bores share a node; if the load vectors of a
        boundary point do not average displacements, or two boundary points are the same.
    """
    require_finite({f"{name}.load": bore.load for name, bore in structure.bores.items()})
    motions = require_matrices(
        structure.stiffness, structure.mass, structure.coordinates, structure.digits
    )
    if motions.forced_everywhere and structure.comm.rank == 0:
        warnings.warn(FORCED_EVERYWHERE, stacklevel=2)
    for name, bore in structure.bores.items():
        check_surface(bore, name)
        _check_nodes(structure, bore, name)
        _check_load(structure, bore, name)
    if structure.bores:
        _check_centres(structure)
    _check_attachments(structure)
    return motions


def _check_attachments(structure: Structure) -> None:
    """Refuse boundary points whose load vectors do not average displacements, and equal points."""
    translations = rigid_fields(structure.coordinates)[:, :3]
    comm = structure.comm
    units = {}
    for name, three in structure.attachments.items():
        columns = np.column_stack([vector.array for vector in three])
        mean = inner(columns, translations, comm)
        to, along = np.unravel_index(np.argmax(np.abs(mean - np.eye(3))), (3, 3))
        require(
            abs(mean[to, along] - (to == along)) <= WEIGHT_TOLERANCE,
            f"attachment {name!r}: a unit translation along {'xyz'[along]} moves it by "
            f"{mean[to, along]:.6g} along {'xyz'[to]}, not {float(to == along):g}: "
            "the weights of each component must sum to one",
        )
        units[name] = columns / np.sqrt(comm.allreduce(np.sum(columns**2, axis=0)))
    for one, other in itertools.combinations(units, 2):
        both = np.hstack([units[one], units[other]])
        require(
            np.linalg.eigvalsh(inner(both, both, comm))[0] > INDEPENDENT,
            f"attachments {one!r} and {other!r} are the same point: their load vectors are "
            "linearly dependent",
        )


# Bores


def check_surface(bore: BoreSurface, name: str) -> None:
    """Check the arrays of a bore: shapes and values, surface meshes, and nodes on the cylinder.

    Raises
    ------
    StructureError
        If an array is wrong; the message names it.
    """
    nodes = len(bore.coordinates)
    pressures = len(bore.pressure_coordinates)
    require(min(nodes, pressures) > 0, f"{name} has {nodes} nodes and {pressures} pressure nodes")
    shapes = {
        "coordinates": (nodes, 3),
        "pressure_coordinates": (pressures, 3),
        "centre": (3,),
        "nodes": (nodes,),
        "reference": (nodes, 3, 6),
    }
    for key, shape in shapes.items():
        array = getattr(bore, key, None)
        if array is None and key in ("nodes", "reference"):
            continue
        assert array is not None
        require(array.shape == shape, f"{name}.{key} has shape {array.shape}, not {shape}")
        require(
            array.dtype.kind in "iuf" and np.isfinite(array).all(),
            f"{name}.{key} has a value that is not a finite number",
        )
    require(
        0 < bore.radius < np.inf and 0 < bore.width < np.inf,
        f"{name}.radius {bore.radius:g} m or width {bore.width:g} m is not above 0",
    )
    for prefix in ("", "pressure_"):
        x = getattr(bore, f"{prefix}coordinates")
        cells = getattr(bore, f"{prefix}cells")
        family = getattr(bore, f"{prefix}family")
        if cells.size or family:  # a mesh may be unknown
            surface_element(family, cells, f"{name}.{prefix}cells")
            require(
                cells.dtype.kind in "iu" and np.array_equal(np.unique(cells), np.arange(len(x))),
                f"{name}.{prefix}cells must use each of the {len(x)} nodes",
            )
        radial = np.abs(np.linalg.norm(x[:, :2], axis=1) - bore.radius)
        off = np.maximum(radial, np.abs(x[:, 2]) - 0.5 * bore.width)
        require(
            off.max() <= CYLINDER_TOLERANCE * bore.radius,
            f"{name}.{prefix}coordinates: node {np.argmax(off)} lies {off.max():.1e} m off the "
            f"cylinder of radius {bore.radius:.6g} m and width {bore.width:.6g} m about z, centred "
            f"at z = 0; the limit is {CYLINDER_TOLERANCE:.0e} radii",
        )
        if family:
            bore_holes(x, cells, family)  # raises if faces of the mesh are missing


def _check_nodes(structure: Structure, bore: Bore, name: str) -> None:
    """Refuse node numbers of a bore whose positions differ from those of the part's nodes.

    The weights of the mean motion are checked, too.
    """
    lowest = bore.nodes.min()
    highest = bore.nodes.max()
    last = structure.size // 3 - 1
    require(
        bore.nodes.dtype.kind in "iu" and 0 <= lowest <= highest <= last,
        f"{name}.nodes are {lowest} to {highest}, but must be whole numbers from 0 to {last}",
    )
    local = bore.nodes - structure.node_range[0]
    mine = np.flatnonzero((local >= 0) & (local < len(structure.coordinates)))
    positions = bore.centre + bore.coordinates[mine]
    distances = np.linalg.norm(structure.coordinates[local[mine]] - positions, axis=1)
    problem = None
    if distances.max(initial=0.0) > PLACE_TOLERANCE * bore.radius:
        worst = int(np.argmax(distances))
        problem = (
            f"{name}.nodes: node {bore.nodes[mine[worst]]} of the part lies {distances[worst]:.1e} "
            f"m from its position in {name}.coordinates: do the node numbers begin at 0?"
        )
    agree(structure.comm, problem)
    if bore.reference is None:
        return
    moved = rigid_fields(bore.coordinates).reshape(bore.reference.shape)
    motion = np.einsum("ick,icl->kl", bore.reference, moved)
    # Rotations are multiplied by the radius: displacements of the surface are compared.
    lever = np.r_[np.ones(3), np.full(3, bore.radius)]
    defect = np.abs(motion * lever[:, None] / lever - np.eye(6)).max()
    require(
        defect <= REFERENCE_TOLERANCE,
        f"{name}.reference: the mean motion of a rigidly moved bore has a relative error of "
        f"{defect:.1e}, limit {REFERENCE_TOLERANCE:.0e}",
    )


def _check_load(structure: Structure, bore: Bore, name: str) -> None:
    """Refuse a load matrix with forces off the bore, or with a wrong sum of outward forces.

    For a unit growth of the radius, the work of a uniform pressure must be the pressure times the
    area.
    """
    columns = bore.load.size[1]
    pressures = len(bore.pressure_coordinates)
    require(
        columns == pressures,
        f"{name}.load has {columns} columns, but there are {pressures} pressure nodes",
    )
    x = structure.coordinates - bore.centre
    comm = structure.comm
    force = load_columns(bore.load, np.ones((columns, 1))).reshape(-1, 3)
    on_bore = np.isin(np.arange(*structure.node_range), bore.nodes)
    work = np.sum(force[on_bore, :2] * x[on_bore, :2]) / bore.radius
    largest, elsewhere = (
        comm.allreduce(np.abs(force[rows]).max(initial=0.0), op=MPI.MAX)
        for rows in (on_bore, ~on_bore)
    )
    swept = comm.allreduce(work) / (2 * np.pi * bore.radius * bore.width)
    require(
        elsewhere <= ROUND_OFF * largest,
        f"{name}.load has forces on nodes that are not in {name}.nodes",
    )
    require(
        abs(swept - 1) <= SWEPT_TOLERANCE,
        f"{name}.load: a uniform pressure pushes the bore outward with {swept:.3g} times the "
        "force on an area of 2 pi radius width: pressure must push outward, and units must agree",
    )


def _check_centres(structure: Structure) -> None:
    """Refuse a first bore that is not at the origin, and nodes that belong to two bores."""
    first = structure.every_bore()[0]
    require(
        np.abs(first.centre).max() <= CYLINDER_TOLERANCE * first.radius,
        f"{next(iter(structure.bores))}.centre is {first.centre.tolist()} m: the centre of the "
        "first bore must be the origin of the part",
    )
    numbers, uses = np.unique(structure.bore_nodes, return_counts=True)
    require(
        uses.max() == 1,
        f"{', '.join(structure.bores)}: node {numbers[np.argmax(uses)]} occurs {uses.max()} times "
        "among the nodes of the bores, but must belong to one bore",
    )
