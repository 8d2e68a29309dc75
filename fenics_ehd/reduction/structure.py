"""A part as input of a reduction: K, M, bores and points, from any program.

Boundary points are load vectors, made from nodes, weights or matrices. The matrices of a part are
checked before any reduction. The checks are cheap: 15 to 35 products with a matrix on one rank,
twice as many on several, no factorisation.
"""

from __future__ import annotations

import itertools
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

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.petsc_options import configured
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
    multiply,
    norm,
    owned_range,
)

#: Smallest sum of weights, relative to the sum of their magnitudes.
_SMALLEST_SUM = 1e-12


class PointWeights(NamedTuple):
    """A boundary point as the weighted mean displacement of nodes.

    Attributes
    ----------
    nodes
        Global node numbers, shape (k,).
    weights
        Weights of the nodes, shape (k,); only their ratios matter. A repeated node counts twice.
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
        Three vectors, returned unchanged; node numbers, shape (k,), of equal weight; nodes with
        weights as `PointWeights` or a plain pair; or the three vectors as columns of a matrix of
        shape (dofs, 3) in a form that `as_matrix` accepts.
    stiffness
        K of the part, whose row distribution the vectors get, with whole nodes on each rank.
    name
        Name of the point, for the messages.

    Raises
    ------
    StructureError
        Nodes or weights do not fit the part.
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
    """Node numbers, and weights whose sum is one."""
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
        Function of displacements, owned rows of shape (owned dofs, n) [m], that returns the
        stresses [Pa] in these cells, as a `fenics_ehd.fem.stress.StressField` or another class
        with `shape`, `positions` and `block`; collective. None: stresses are unknown.
    """

    cells: np.ndarray
    stress: Callable[[np.ndarray], Any] | None = None


@renamed_attributes(reach="largest_coordinate")
@dataclass(frozen=True, eq=False)
class Structure:
    """Linear structure ``M x'' + K x = f`` (16) with lubricated bores.

    Degrees of freedom are ``3 * node + component``; rows are distributed over
    the ranks of `comm` by whole nodes.

    The arguments may come from any finite-element program and in several forms; the attributes have
    the form that is described first.

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
        `load_vectors`.
    recovery
        Elements, for displacement and stress fields.
    owner
        Object that must outlive the matrices: dolfinx frees their communicator together with the
        mesh.
    comm
        MPI communicator (mpi4py) of the matrices. Its ranks share matrices from SciPy or files;
        PETSc matrices have their own communicator.

    Raises
    ------
    StructureError
        An argument cannot be read, or does not fit the stiffness matrix. `check_structure` checks
        the values.
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
        """The bore of a part that has one.

        Raises
        ------
        SettingsError
            The part has none, or several.
        """
        return only(self.bores, "structure")

    def every_bore(self) -> list[Bore]:
        """All bores; a part that is loaded by pressure has at least one.

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
        blocks = []
        for load in loads:
            pointers, columns, values = load.getValuesCSR()
            shape = len(pointers) - 1, load.size[1]
            blocks.append(sparse.csr_matrix((values, columns, pointers), shape=shape))
        return assemble(sparse.hstack(blocks, format="csr"), self.comm)

    @cached_property
    def largest_coordinate(self) -> float:
        """Largest coordinate of any node [m]; collective."""
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
    """A bore with its load matrix in PETSc's format."""
    load = as_matrix(bore.load, comm, f"{name}.load", rows=rows)
    return bore if load is bore.load else replace(bore, load=load)


def _owned_rows(coordinates: np.ndarray, stiffness: PETSc.Mat) -> np.ndarray:
    """Positions of the nodes that this rank owns, given for those nodes or for all nodes."""
    positions = np.asarray(coordinates, dtype=float)
    first, last = (row // 3 for row in stiffness.getOwnershipRange())
    count = stiffness.size[0] // 3
    rows = len(positions)
    problem = None
    if positions.ndim != 2 or positions.shape[1] != 3 or rows not in (last - first, count):
        problem = (
            f"coordinates have shape {positions.shape}, the stiffness matrix is one of {count} "
            f"nodes: give ({count}, 3), or on each rank its own nodes' rows"
        )
    agree(stiffness.comm.tompi4py(), problem)
    return positions if rows == last - first else positions[first:last]


def _owned_nodes(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Mask of the bores' nodes that this rank owns, and their local indices."""
    local = structure.bore_nodes - structure.node_range[0]
    mine = (local >= 0) & (local < len(structure.coordinates))
    return mine, local[mine]


def bore_rows(structure: Structure, columns: np.ndarray) -> np.ndarray:
    """Rows of part-size columns at the nodes of all bores, on every rank, shape (m, 3, n)."""
    mine, local = _owned_nodes(structure)
    rows = np.zeros((len(mine), 3, columns.shape[1]))
    rows[mine] = columns[3 * local[:, None] + np.arange(3)]
    return structure.comm.allreduce(rows, op=MPI.SUM)


def on_bores(structure: Structure, values: np.ndarray) -> np.ndarray:
    """Part-size fields with values at the bores' nodes, shape (m, 3, n), and zero elsewhere.

    Returns
    -------
    numpy.ndarray
        Owned rows, shape (owned dofs, n).
    """
    mine, local = _owned_nodes(structure)
    columns = np.zeros((len(structure.coordinates), 3, values.shape[2]))
    columns[local] = values[mine]
    return np.asfortranarray(columns.reshape(-1, values.shape[2]))


# Checks

#: Largest strain energy of a rigid-body mode, relative to that of the same nodal values with the
#: diagonal of K.
FREE_TOLERANCE = 1e-9

#: Smallest energy of any rigid motion of a clamped part, relative to that with the diagonal of K.
HELD = 1e-12


_MOTIONS = tuple(
    f"{motion} {axis}" for motion in ("translation along", "rotation about") for axis in "xyz"
)


def rigid_motions(structure: Structure) -> tuple[np.ndarray, bool]:
    """Rigid motions of a part, and whether it is free of supports.

    Returns
    -------
    fields : numpy.ndarray
        Owned rows (owned dofs, 6), scaled to unit energy with the diagonal of K.
    free : bool
        Whether none of them stores energy.

    Raises
    ------
    StructureError
        All nodes lie at one point, or on an axis; the part is neither free nor clamped.
    """
    fields = rigid_fields(structure.coordinates)
    comm = structure.comm
    diagonal = structure.stiffness.getDiagonal().array
    bound = np.sqrt(comm.allreduce(np.sum(fields**2 * diagonal[:, None], axis=0)))
    if not bound.all():
        raise StructureError("all nodes lie at the origin or on one axis: are there coordinates?")
    fields /= bound
    energy = inner(fields, multiply(structure.stiffness, fields), comm)
    ratios = np.diag(energy)
    lowest = int(np.argmin(ratios))
    if ratios[lowest] < -FREE_TOLERANCE:
        raise StructureError(
            f"stiffness is not positive semidefinite: {_MOTIONS[lowest]} has the relative energy "
            f"{ratios[lowest]:.1e}, limit {-FREE_TOLERANCE:.0e}; were all digits written?"
        )
    free = ratios <= FREE_TOLERANCE
    if free.any() and not free.all():
        names = ", ".join(itertools.compress(_MOTIONS, free))
        raise StructureError(
            f"{free.sum()} of 6 rigid motions store no energy ({names}), a part must be free or "
            f"clamped (largest relative energy {ratios.max():.1e}, limit {FREE_TOLERANCE:.0e}): "
            "are the coordinates in the order of the degrees of freedom?"
        )
    softest = np.linalg.eigvalsh(energy)[0]
    if not free.any() and not softest > HELD:
        raise StructureError(
            f"a rigid motion other than about the axes stores no energy (relative {softest:.1e}, "
            f"limit {HELD:.0e}): the supports do not clamp the part"
        )
    return fields, bool(free.all())


#: Largest antisymmetric part of K or M, applied to a random vector, relative to the symmetric
#: one, every degree of freedom scaled by its diagonal entry; static responses are checked to 1e-8.
SYMMETRY_TOLERANCE = 1e-9

#: Smallest eigenvalue of M, scaled by its diagonal, relative to the largest. Elements of degree
#: 2 have 1e-2, round-off 1e-16.
MASS_TOLERANCE = 1e-8

#: Smallest part in a random load that a null vector of M may have, relative to the average one:
#: the probability that one is missed.
_MISSED = 1e-2

#: Largest force of a translation on a node far from supports, relative to the diagonal entry.
_UNLOADED = 1e-6

#: Range of mass over the volume of a box around the nodes that no part has: in SI units a frame of
#: thin bars has 10 kg/m3, in millimetres and tonnes gold has 2e-8; in millimetres and kilograms a
#: solid block of steel has 8e-6.
IMPOSSIBLE = (3e-8, 0.1)

#: Largest defect of the mean displacement that a boundary point has under unit translations.
WEIGHT_TOLERANCE = 1e-8

#: Smallest eigenvalue of the Gram matrix of two boundary points' unit vectors.
INDEPENDENT = 1e-10

#: Largest distance of a bore's node from the same node of the part, relative to the radius: in
#: files with rounded numbers, the bore's node is on the cylinder and the part's node is rounded.
PLACE_TOLERANCE = 1e-4

#: Largest difference of the volume that a uniform pressure sweeps from that of a cylinder,
#: relative: a hexagon with its corners on the circle has 9 % less.
SWEPT_TOLERANCE = 0.2

#: Largest defect of the mean motion of a rigidly moved bore.
REFERENCE_TOLERANCE = 1e-8

#: Largest force on a node off the bore, relative to the largest on it.
ROUND_OFF = 1e-9


def check_structure(structure: Structure) -> None:
    """Check that matrices, coordinates, bores and boundary points make one part.

    Collective. A motion without energy beyond the rigid ones, of a loose piece say, is not
    found here but by `StaticSolver`.

    Raises
    ------
    StructureError
        A value is not finite; K or M is not symmetric, has an empty row or
        a diagonal entry that is not positive; K has an entry that none of a positive semidefinite
        one has; M is singular or not positive definite; some
        rigid motions cost energy and others do not; degrees of freedom go component by component;
        mass and coordinates are of different units; bore nodes are not on the bore, or its
        load matrix is not one of a pressure that pushes outward; the first bore is not at the
        origin, or a node is of two bores; a boundary point is no mean
        displacement, or two of them are one.
    """
    _check_finite(structure)
    for name, matrix in (("stiffness", structure.stiffness), ("mass", structure.mass)):
        _check_diagonal(matrix, name)
        _check_symmetric(matrix, name)
    _check_order(structure)
    rigid_motions(structure)
    _check_minors(structure.stiffness)
    _check_definite(structure.mass)
    _check_units(structure)
    for name, bore in structure.bores.items():
        check_surface(bore, name)
        _check_nodes(structure, bore, name)
        _check_load(structure, bore, name)
    if structure.bores:
        _check_centres(structure)
    _check_attachments(structure)


def _require(holds: bool | np.bool_, problem: str) -> None:
    """Refuse a part for which a condition does not hold."""
    if not holds:
        raise StructureError(problem)


def _place(row: int) -> str:
    return f"node {row // 3}, component {'xyz'[row % 3]}"


def _random(matrix: PETSc.Mat, count: int = 1) -> np.ndarray:
    """Owned rows of random vectors of unit variance, shape (owned dofs, count)."""
    rank = matrix.comm.tompi4py().rank
    return np.random.default_rng([3, rank]).standard_normal((matrix.local_size[0], count))


def _check_finite(structure: Structure) -> None:
    matrices = {"stiffness": structure.stiffness, "mass": structure.mass}
    matrices |= {f"{name}.load": bore.load for name, bore in structure.bores.items()}
    for name, matrix in matrices.items():
        _require(np.isfinite(matrix.norm()), f"{name} holds a value that is not finite")
    sums = np.concatenate(structure.comm.allgather(structure.coordinates.sum(axis=1)))
    worst = np.argmin(np.isfinite(sums))
    _require(np.isfinite(sums[worst]), f"the coordinates of node {worst} are not finite")


def _check_diagonal(matrix: PETSc.Mat, name: str) -> None:
    diagonal = np.concatenate(matrix.comm.tompi4py().allgather(matrix.getDiagonal().array))
    row = int(np.argmin(diagonal))
    _require(
        diagonal[row] > 0,
        f"{name} has the diagonal entry {diagonal[row]:.3g} at {_place(row)}, it must be "
        "positive there: is the row empty?",
    )


def _check_symmetric(matrix: PETSc.Mat, name: str) -> None:
    """The work of one random vector on another must be symmetric."""
    comm = matrix.comm.tompi4py()
    scale = 1.0 / np.sqrt(matrix.getDiagonal().array)[:, None]
    vectors = scale * _random(matrix, 2)
    product = multiply(matrix, vectors)
    work = inner(vectors, product, comm)
    defect = abs(work[0, 1] - work[1, 0]) / norm(scale * product, comm)
    _require(
        defect <= SYMMETRY_TOLERANCE,
        f"{name} is not symmetric: relative defect {defect:.1e}, limit "
        f"{SYMMETRY_TOLERANCE:.0e}; both triangles must be given, with the same digits",
    )


#: Largest excess of an entry of K over the geometric mean of its two diagonal entries, relative:
#: files of other programs have 7 digits.
MINOR_TOLERANCE = 1e-6


def _check_minors(stiffness: PETSc.Mat) -> None:
    """Every principal minor of two degrees of freedom must be non-negative.

    The check is one pass over the entries. The factorisation refuses a matrix that passes and still
    has a negative eigenvalue (`fenics_ehd.reduction.static.LinearSolver`).
    """
    comm = stiffness.comm.tompi4py()
    roots = np.sqrt(np.concatenate(comm.allgather(stiffness.getDiagonal().array)))
    pointers, columns, entries = stiffness.getValuesCSR()
    first = stiffness.getOwnershipRange()[0]
    rows = first + np.repeat(np.arange(len(pointers) - 1), np.diff(pointers))
    ratios = np.abs(entries) / (roots[rows] * roots[columns])
    problem = None
    if ratios.max(initial=0.0) > 1.0 + MINOR_TOLERANCE:
        worst = int(np.argmax(ratios))
        problem = (
            f"stiffness is not positive semidefinite: the entry {entries[worst]:.3g} of "
            f"{_place(rows[worst])} and {_place(columns[worst])} is {ratios[worst]:.3g} times the "
            "geometric mean of their diagonal entries, it may be 1"
        )
    agree(comm, problem)


def _check_order(structure: Structure) -> None:
    """Degrees of freedom must be numbered node by node: then translations load supports alone."""
    stiffness = structure.stiffness
    comm = structure.comm
    limit = _UNLOADED * stiffness.getDiagonal().array
    rows = np.arange(*stiffness.getOwnershipRange())
    along = np.sqrt([[1.0], [2.0], [3.0]])  # a direction outside every plane of symmetry
    by_node, by_component = (
        comm.allreduce(int((np.abs(multiply(stiffness, along[order])[:, 0]) <= limit).sum()))
        for order in (rows % 3, rows // (stiffness.size[0] // 3))
    )
    _require(
        by_component <= by_node,
        "the degrees of freedom go component by component: those of all nodes along x, then y, "
        "then z; they must go node by node, as reorder(matrix, dofs) brings them with "
        "dofs = numpy.arange(matrix.shape[0]).reshape(3, -1).T",
    )


def _check_units(structure: Structure) -> None:
    """Mass over the volume of a box around the nodes must be possible; other checks miss units."""
    comm = structure.comm
    along = rigid_fields(structure.coordinates)[:, :1]
    sides = np.ptp(np.vstack(comm.allgather(structure.coordinates)), axis=0)
    mass = float(inner(along, multiply(structure.mass, along), comm)[0, 0])
    density = mass / max(float(np.prod(sides)), 1e-300)
    _require(
        not IMPOSSIBLE[0] < density < IMPOSSIBLE[1],
        f"the part weighs {mass:.3g} kg and its nodes lie in a box of "
        f"{' x '.join(f'{side:.3g}' for side in sides)} m, {density:.1g} kg/m3: give "
        "coordinates in m where K is in N/m and M in kg",
    )


def _check_definite(mass: PETSc.Mat) -> None:
    """M must have no null vector: ``M x = f`` is solved for a random f by conjugate gradients.

    The component of f along a null vector never vanishes from the residual, and the Ritz values
    approach the eigenvalue zero, or negative ones.
    """
    x, force = mass.createVecs()
    force.array = np.sqrt(mass.getDiagonal().array) * _random(mass)[:, 0]
    ksp = PETSc.KSP().create(mass.comm)
    ksp.setOperators(mass)
    ksp.setComputeEigenvalues(True)
    options = {
        "ksp_type": "cg",
        "ksp_rtol": _MISSED / np.sqrt(mass.size[0]),
        "ksp_max_it": 300,
        # Symmetric Gauss-Seidel at the cost of one product on one rank; PETSc 3.18 has no such
        # variant on several ranks.
        "pc_type": "eisenstat" if mass.getType() == "seqaij" else "sor",
    }
    with configured(ksp, "mass_check_", options):
        ksp.solve(force, x)
    ritz = ksp.computeEigenvalues().real
    indefinite = ksp.getConvergedReason() in (
        PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT,
        PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_PC,
    )
    ksp.destroy()
    ratio = ritz.min(initial=1.0) / ritz.max(initial=1e-300)
    # The last iterate has grown along the null vector.
    largest = int(np.argmax(np.concatenate(mass.comm.tompi4py().allgather(np.abs(x.array)))))
    _require(
        ratio > MASS_TOLERANCE and not indefinite,
        f"mass is singular or not positive definite: relative eigenvalue {ratio:.1e}, limit "
        f"{MASS_TOLERANCE:.0e}, its vector is largest at {_place(largest)}",
    )


def _check_attachments(structure: Structure) -> None:
    """Boundary points must be mean displacements, and distinct."""
    translations = rigid_fields(structure.coordinates)[:, :3]
    comm = structure.comm
    units = {}
    for name, three in structure.attachments.items():
        columns = np.column_stack([vector.array for vector in three])
        mean = inner(columns, translations, comm)
        to, along = np.unravel_index(np.argmax(np.abs(mean - np.eye(3))), (3, 3))
        _require(
            abs(mean[to, along] - (to == along)) <= WEIGHT_TOLERANCE,
            f"attachment {name!r}: a unit translation along {'xyz'[along]} moves it by "
            f"{mean[to, along]:.6g} along {'xyz'[to]}, not {float(to == along):g}: "
            "the weights of each component must sum to one",
        )
        units[name] = columns / np.sqrt(comm.allreduce(np.sum(columns**2, axis=0)))
    for one, other in itertools.combinations(units, 2):
        both = np.hstack([units[one], units[other]])
        _require(
            np.linalg.eigvalsh(inner(both, both, comm))[0] > INDEPENDENT,
            f"attachments {one!r} and {other!r} are the same point: their load vectors depend on "
            "each other",
        )


# Bores


def check_surface(bore: BoreSurface, name: str) -> None:
    """Check arrays of a bore: shapes and kinds, surface meshes of their nodes, a cylinder.

    Raises
    ------
    StructureError
        The message has the array.
    """
    nodes = len(bore.coordinates)
    pressures = len(bore.pressure_coordinates)
    _require(min(nodes, pressures) > 0, f"{name} has {nodes} nodes, {pressures} of pressures")
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
        _require(array.shape == shape, f"{name}.{key} has shape {array.shape}, not {shape}")
        _require(
            array.dtype.kind in "iuf" and np.isfinite(array).all(),
            f"{name}.{key} holds a value that is not finite, or no number",
        )
    _require(
        0 < bore.radius < np.inf and 0 < bore.width < np.inf,
        f"{name}.radius {bore.radius:g} m or width {bore.width:g} m is not above 0",
    )
    for prefix in ("", "pressure_"):
        x = getattr(bore, f"{prefix}coordinates")
        cells = getattr(bore, f"{prefix}cells")
        family = getattr(bore, f"{prefix}family")
        if cells.size or family:  # a mesh may be unknown
            surface_element(family, cells, f"{name}.{prefix}cells")
            _require(
                cells.dtype.kind in "iu" and np.array_equal(np.unique(cells), np.arange(len(x))),
                f"{name}.{prefix}cells must use each of the {len(x)} nodes",
            )
        radial = np.abs(np.linalg.norm(x[:, :2], axis=1) - bore.radius)
        off = np.maximum(radial, np.abs(x[:, 2]) - 0.5 * bore.width)
        _require(
            off.max() <= CYLINDER_TOLERANCE * bore.radius,
            f"{name}.{prefix}coordinates: node {np.argmax(off)} lies {off.max():.1e} m off the "
            f"cylinder of radius {bore.radius:.6g} m and width {bore.width:.6g} m about z, centred "
            f"at z = 0, limit {CYLINDER_TOLERANCE:.0e} radii",
        )
        if family:
            bore_holes(x, cells, family)  # refuses a mesh with missing faces


def _check_nodes(structure: Structure, bore: Bore, name: str) -> None:
    """Node numbers must be those of nodes at these positions; the mean motion is checked too."""
    lowest = bore.nodes.min()
    highest = bore.nodes.max()
    last = structure.size // 3 - 1
    _require(
        bore.nodes.dtype.kind in "iu" and 0 <= lowest <= highest <= last,
        f"{name}.nodes: {lowest} to {highest}, they must be whole numbers of 0 to {last}",
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
            f"m from where {name}.coordinates has it: do the numbers begin at 0?"
        )
    agree(structure.comm, problem)
    if bore.reference is None:
        return
    moved = rigid_fields(bore.coordinates).reshape(bore.reference.shape)
    motion = np.einsum("ick,icl->kl", bore.reference, moved)
    # Rotations are compared by displacements of the bore's surface.
    lever = np.r_[np.ones(3), np.full(3, bore.radius)]
    defect = np.abs(motion * lever[:, None] / lever - np.eye(6)).max()
    _require(
        defect <= REFERENCE_TOLERANCE,
        f"{name}.reference: the mean motion of a rigidly moved bore is off by {defect:.1e}, limit "
        f"{REFERENCE_TOLERANCE:.0e}",
    )


def _check_load(structure: Structure, bore: Bore, name: str) -> None:
    """The work of a uniform pressure on a growing bore must be that of its area, on bore nodes."""
    columns = bore.load.size[1]
    pressures = len(bore.pressure_coordinates)
    _require(
        columns == pressures,
        f"{name}.load has {columns} columns, there are {pressures} pressure nodes",
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
    _require(
        elsewhere <= ROUND_OFF * largest,
        f"{name}.load has forces on nodes that are not in {name}.nodes",
    )
    _require(
        abs(swept - 1) <= SWEPT_TOLERANCE,
        f"{name}.load: a uniform pressure pushes the bore outward with {swept:.3g} times the "
        "force of radius, width and 2 pi: it must push outward, and units must agree",
    )


def _check_centres(structure: Structure) -> None:
    """The first bore must be at the origin, and every node must belong to one bore."""
    first = structure.every_bore()[0]
    _require(
        np.abs(first.centre).max() <= CYLINDER_TOLERANCE * first.radius,
        f"{next(iter(structure.bores))}.centre: the first bore's must be the origin of the part",
    )
    numbers, uses = np.unique(structure.bore_nodes, return_counts=True)
    _require(
        uses.max() == 1,
        f"{', '.join(structure.bores)}: node {numbers[np.argmax(uses)]} is named {uses.max()} "
        "times among the nodes of the bores",
    )
