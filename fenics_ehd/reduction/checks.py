"""Checks of a part whose matrices any program may have made, before work is spent on them.

Cheap: 15 to 35 products with a matrix on one rank, twice as many on several, no factorisation.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.petsc_options import configured
from fenics_ehd.reduction.bore import Bore, BoreSurface, rigid_fields
from fenics_ehd.reduction.distributed import inner, load_columns, multiply
from fenics_ehd.reduction.elements import ELEMENTS
from fenics_ehd.reduction.faces import CYLINDER_TOLERANCE
from fenics_ehd.reduction.matrices import agree, before
from fenics_ehd.reduction.static import rigid_motions
from fenics_ehd.reduction.structure import Structure

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

#: Mass over the volume of a box around the nodes that no part has: in SI units a frame of thin
#: bars has 10 kg/m3, in millimetres and tonnes gold has 2e-8; in millimetres and kilograms a solid
#: block of steel has 8e-6.
IMPOSSIBLE = (3e-8, 0.1)

#: Largest defect of the mean displacement that a boundary point has under unit translations.
WEIGHT_TOLERANCE = 1e-8

#: Smallest eigenvalue of the Gram matrix of two boundary points' unit vectors.
INDEPENDENT = 1e-10

#: Largest distance of a bore's node from that of the part, relative to the radius: in files whose
#: numbers are rounded the one is on the cylinder, the other where K has it. Others are far away.
PLACE_TOLERANCE = 1e-4

#: Largest difference of the volume that a uniform pressure sweeps from that of a cylinder,
#: relative: a hexagon with its corners on the circle has 9 % less.
SWEPT_TOLERANCE = 0.2

#: Largest defect of the mean motion of a rigidly moved bore.
REFERENCE_TOLERANCE = 1e-8

#: Largest force on a node off the bore, relative to the largest on it.
ROUND_OFF = 1e-9

_BORE_NODES = ("coordinates", "pressure_coordinates")


def check_structure(structure: Structure) -> None:
    """Check that matrices, coordinates, bores and boundary points make one part.

    Collective. A motion without energy beyond the rigid ones, of a loose piece say, is not
    found here but by `StaticSolver`.

    Raises
    ------
    StructureError
        A value is not finite; K or M is not symmetric, has an empty row or
        a diagonal entry that is not positive; M is singular or not positive definite; some
        rigid motions cost energy and others do not; degrees of freedom go component by component;
        mass and coordinates are of different units; bore nodes are not on the bore, or its
        load matrix is not one of a pressure that pushes outward; the first bore is not at the
        origin, or two share a node; a boundary point is no mean
        displacement, or two of them are one.
    """
    _check_finite(structure)
    for name, matrix in (("stiffness", structure.stiffness), ("mass", structure.mass)):
        _check_diagonal(matrix, name)
        _check_symmetric(matrix, name)
    _check_order(structure)
    rigid_motions(structure)
    _check_definite(structure.mass)
    _check_units(structure)
    _check_bores(structure)
    _check_attachments(structure)


def _members(structure: Structure) -> Iterator[tuple[str, PETSc.Mat | PETSc.Vec]]:
    """Matrices and vectors that have a row for every degree of freedom, by name."""
    yield "stiffness", structure.stiffness
    yield "mass", structure.mass
    yield from ((f"{name}.load", bore.load) for name, bore in structure.bores.items())
    for name, three in structure.attachments.items():
        yield from ((f"attachment {name!r}", vector) for vector in three)


def _check_finite(structure: Structure) -> None:
    for name, member in _members(structure):
        if not np.isfinite(member.norm()):
            raise StructureError(f"{name} holds a value that is not finite")
    node = _first(~np.isfinite(structure.coordinates).all(axis=1), structure.comm)
    if node is not None:
        raise StructureError(f"the coordinates of node {node} are not finite")


def _first(wrong: np.ndarray, comm: MPI.Comm) -> int | None:
    """Global number of the first True of an array distributed over the ranks."""
    start = before(len(wrong), comm)
    mine = start + int(np.argmax(wrong)) if wrong.any() else np.iinfo(np.int64).max
    found = comm.allreduce(mine, op=MPI.MIN)
    return None if found == np.iinfo(np.int64).max else found


def _place(row: int) -> str:
    return f"node {row // 3}, component {'xyz'[row % 3]}"


def _check_diagonal(matrix: PETSc.Mat, name: str) -> None:
    diagonal, comm = matrix.getDiagonal().array, matrix.comm.tompi4py()
    row = _first(~(diagonal > 0), comm)
    if row is not None:
        values = np.concatenate(comm.allgather(diagonal))
        raise StructureError(
            f"{name} has the diagonal entry {values[row]:.3g} at {_place(row)}, it must be "
            "positive there: is the row empty?"
        )


def _random(matrix: PETSc.Mat) -> np.ndarray:
    """Owned rows of a random vector of unit variance."""
    rank = matrix.comm.tompi4py().rank
    return np.random.default_rng([3, rank]).standard_normal(matrix.local_size[0])


def _check_symmetric(matrix: PETSc.Mat, name: str) -> None:
    scale = 1.0 / np.sqrt(matrix.getDiagonal().array)
    x, product = matrix.createVecs()
    transposed = product.duplicate()
    x.array = scale * _random(matrix)
    matrix.mult(x, product)
    matrix.multTranspose(x, transposed)
    transposed.aypx(-1.0, product)
    for vector in (product, transposed):
        vector.array *= scale
    defect = transposed.norm() / product.norm()
    if not defect <= SYMMETRY_TOLERANCE:
        raise StructureError(
            f"{name} is not symmetric: relative defect {defect:.1e}, limit "
            f"{SYMMETRY_TOLERANCE:.0e}; both triangles must be given, with the same digits"
        )


def _check_order(structure: Structure) -> None:
    """Translations load only the nodes at supports, unless the degrees of freedom have no nodes."""
    stiffness, comm = structure.stiffness, structure.comm
    limit = _UNLOADED * stiffness.getDiagonal().array
    rows = np.arange(*stiffness.getOwnershipRange())
    along = np.sqrt([[1.0], [2.0], [3.0]])  # no plane of symmetry has it
    by_node, by_component = (
        comm.allreduce(int((np.abs(multiply(stiffness, along[order])[:, 0]) <= limit).sum()))
        for order in (rows % 3, rows // (stiffness.size[0] // 3))
    )
    if by_component > by_node:
        raise StructureError(
            "the degrees of freedom go component by component: those of all nodes along x, then y, "
            "then z; they must go node by node, as reorder(matrix, dofs) brings them with "
            "dofs = numpy.arange(matrix.shape[0]).reshape(3, -1).T"
        )


def _check_units(structure: Structure) -> None:
    """Mass and nodes make a density that a part may have; in any units motions are rigid ones."""
    comm = structure.comm
    x = structure.coordinates
    low = np.min(comm.allgather(x.min(axis=0, initial=np.inf)), axis=0)
    high = np.max(comm.allgather(x.max(axis=0, initial=-np.inf)), axis=0)
    along = rigid_fields(x)[:, :1]
    mass = float(inner(along, multiply(structure.mass, along), comm)[0, 0])
    density = mass / max(float(np.prod(high - low)), 1e-300)
    if IMPOSSIBLE[0] < density < IMPOSSIBLE[1]:
        raise StructureError(
            f"the part weighs {mass:.3g} kg and its nodes lie in a box of "
            f"{' x '.join(f'{side:.3g}' for side in high - low)} m, {density:.1g} kg/m3: give "
            "coordinates in m where K is in N/m and M in kg"
        )


def _check_definite(mass: PETSc.Mat) -> None:
    """No hidden null vector: ``M x = f`` is solved for a random f by conjugate gradients.

    A null vector is a part of f that no iterate removes, and until it does the
    Ritz values close in on the eigenvalue zero, negative ones too.
    """
    scale = np.sqrt(mass.getDiagonal().array)
    x, force = mass.createVecs()
    force.array = scale * _random(mass)
    ksp = PETSc.KSP().create(mass.comm)
    ksp.setOperators(mass)
    ksp.setComputeEigenvalues(True)
    options = {
        "ksp_type": "cg",
        "ksp_rtol": _MISSED / np.sqrt(mass.size[0]),
        "ksp_max_it": 300,
        # Symmetric Gauss-Seidel, included in the price of a product on one rank; on several
        # PETSc 3.18 has no such arrangement.
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
    if not indefinite and ratio > MASS_TOLERANCE:
        return
    # The last iterate has grown along the null vector.
    size = np.abs(x.array)
    comm = mass.comm.tompi4py()
    row = _first(size == comm.allreduce(size.max(initial=0.0), op=MPI.MAX), comm)
    raise StructureError(
        f"mass is singular or not positive definite: relative eigenvalue {ratio:.1e}, limit "
        f"{MASS_TOLERANCE:.0e}, its vector is largest at {_place(row or 0)}"
    )


def _check_attachments(structure: Structure) -> None:
    """Mean displacements, and no two of them the same."""
    translations, comm = rigid_fields(structure.coordinates)[:, :3], structure.comm
    units: dict[str, np.ndarray] = {}
    for name, three in structure.attachments.items():
        columns = np.column_stack([vector.array for vector in three])
        mean = inner(columns, translations, comm)
        worst = np.unravel_index(np.argmax(np.abs(mean - np.eye(3))), (3, 3))
        if not np.abs(mean - np.eye(3)).max() <= WEIGHT_TOLERANCE:
            raise StructureError(
                f"attachment {name!r}: a unit translation along {'xyz'[worst[1]]} moves it by "
                f"{mean[worst]:.6g} along {'xyz'[worst[0]]}, not {float(worst[0] == worst[1]):g}: "
                "the weights of each component must sum to one"
            )
        unit = columns / np.sqrt(comm.allreduce(np.sum(columns**2, axis=0)))
        for other, theirs in units.items():
            both = np.hstack([theirs, unit])
            if not np.linalg.eigvalsh(inner(both, both, comm))[0] > INDEPENDENT:
                raise StructureError(
                    f"attachments {other!r} and {name!r} are the same point: their load vectors "
                    "depend on each other"
                )
        units[name] = unit


# Bores


def _check_bores(structure: Structure) -> None:
    """Surfaces, nodes, load matrix and mean motion of every bore; the first is at the origin."""
    for name, bore in structure.bores.items():
        for defect in chain(_array_defects(bore), _cell_defects(bore), _cylinder_defects(bore)):
            raise StructureError(f"{name}.{defect}")
    for name, bore in list(structure.bores.items())[:1]:
        if not np.abs(bore.centre).max() <= CYLINDER_TOLERANCE * bore.radius:
            raise StructureError(f"{name}.centre: the first bore's must be the origin of the part")
    for name, bore in structure.bores.items():
        for defect in chain(_node_defects(bore, structure.size // 3), _motion_defects(bore)):
            raise StructureError(f"{name}.{defect}")
        _check_numbers(structure, bore, name)
        _check_load(structure, bore, name)
    if structure.bores and len(np.unique(structure.bore_nodes)) < len(structure.bore_nodes):
        raise StructureError(f"the bores {', '.join(structure.bores)} share a node")


def _node_defects(bore: Bore, count: int) -> Iterator[str]:
    nodes, columns, pressures = bore.nodes, bore.load.size[1], len(bore.pressure_coordinates)
    if columns != pressures:
        yield f"load has {columns} columns, there are {pressures} pressure nodes"
    if nodes.shape != (len(bore.coordinates),):
        yield f"nodes has shape {nodes.shape}, not {(len(bore.coordinates),)}"
    outside = nodes[(nodes < 0) | (nodes >= count)]
    if nodes.dtype.kind not in "iu" or not len(nodes) or len(outside):
        which = f"node {outside[0]} is" if len(outside) else "they are"
        yield f"nodes: {which} not among the whole numbers 0 to {count - 1}"
    numbers, uses = np.unique(nodes, return_counts=True)
    if (uses > 1).any():
        yield f"nodes names node {numbers[np.argmax(uses > 1)]} {uses.max()} times"


def _motion_defects(bore: Bore) -> Iterator[str]:
    if bore.reference is None:
        return
    shape = (len(bore.coordinates), 3, 6)
    if bore.reference.shape != shape:
        yield f"reference has shape {bore.reference.shape}, not {shape}"
    moved = rigid_fields(bore.coordinates).reshape(shape)
    motion = np.einsum("ick,icl->kl", bore.reference, moved)
    # Rotations are small where lengths are, so compare them at the bore's surface.
    lever = np.r_[np.ones(3), np.full(3, bore.radius)]
    defect = np.abs(motion * lever[:, None] / lever - np.eye(6)).max()
    if not defect <= REFERENCE_TOLERANCE:
        yield (
            f"reference: the mean motion of a rigidly moved bore is off by {defect:.1e}, limit "
            f"{REFERENCE_TOLERANCE:.0e}"
        )


def _check_numbers(structure: Structure, bore: Bore, label: str) -> None:
    """The bore's nodes lie where the part has them: numbers from 1 or of another mesh do not."""
    local = bore.nodes - structure.node_range[0]
    mine = np.flatnonzero((local >= 0) & (local < len(structure.coordinates)))
    there = bore.centre + bore.coordinates[mine]
    apart = np.linalg.norm(structure.coordinates[local[mine]] - there, axis=1)
    problem = None
    if apart.max(initial=0.0) > PLACE_TOLERANCE * bore.radius:
        worst = int(np.argmax(apart))
        problem = (
            f"{label}.nodes: node {bore.nodes[mine[worst]]} of the part lies {apart[worst]:.1e} m "
            f"from where {label}.coordinates has it: do the numbers begin at 0?"
        )
    agree(structure.comm, problem)


def _check_load(structure: Structure, bore: Bore, label: str) -> None:
    """A uniform pressure sweeps the lateral area when the bore grows, and loads nothing else."""
    x = structure.coordinates - bore.centre
    force = load_columns(bore.load, np.ones((bore.load.size[1], 1))).reshape(-1, 3)
    on_bore = np.isin(np.arange(*structure.node_range), bore.nodes)
    work = np.sum(force[on_bore, :2] * x[on_bore, :2]) / bore.radius
    comm = structure.comm
    there, elsewhere = (
        comm.allreduce(np.abs(force[rows]).max(initial=0.0), op=MPI.MAX)
        for rows in (on_bore, ~on_bore)
    )
    swept = comm.allreduce(work) / (2 * np.pi * bore.radius * bore.width)
    if not elsewhere <= ROUND_OFF * there:
        raise StructureError(f"{label}.load has forces on nodes that are not in {label}.nodes")
    if not abs(swept - 1) <= SWEPT_TOLERANCE:
        raise StructureError(
            f"{label}.load: a uniform pressure pushes the bore outward with {swept:.3g} times the "
            "force of radius, width and 2 pi: it must push outward, and units must agree"
        )


def _array_defects(bore: BoreSurface) -> Iterator[str]:
    for key in (*_BORE_NODES, "centre"):
        array = getattr(bore, key)
        shape = (3,) if key == "centre" else (len(array), 3)
        if array.shape != shape:
            yield f"{key} has shape {array.shape}, not {shape}"
        elif array.dtype.kind != "f" or not np.isfinite(array).all():
            yield f"{key} holds a value that is not finite, or no number"
    if not (0 < bore.radius < np.inf and 0 < bore.width < np.inf):
        yield f"radius {bore.radius:g} m or width {bore.width:g} m is not above 0"


def _cell_defects(bore: BoreSurface) -> Iterator[str]:
    """Defects of the two surface meshes; having none is right."""
    for prefix, nodes in (("", bore.coordinates), ("pressure_", bore.pressure_coordinates)):
        cells, family = getattr(bore, f"{prefix}cells"), getattr(bore, f"{prefix}family")
        if not cells.size and not family:
            continue
        size = len(ELEMENTS[family].nodes) if family in ELEMENTS else 0
        if cells.ndim != 2 or not len(cells) or cells.shape[1] != size:
            need = f"needs (cells, {size})" if size else f"is not one of {', '.join(ELEMENTS)}"
            yield f"{prefix}cells has shape {cells.shape}, {prefix}family {family!r} {need}"
        elif cells.dtype.kind not in "iu" or not np.array_equal(
            np.unique(cells), np.arange(len(nodes))
        ):
            yield f"{prefix}cells must use each of the {len(nodes)} nodes"


def _cylinder_defects(bore: BoreSurface) -> Iterator[str]:
    for key in _BORE_NODES:
        x = getattr(bore, key)
        reach = np.linalg.norm(x[:, :2], axis=1), np.abs(x[:, 2])
        off = np.maximum(np.abs(reach[0] - bore.radius), reach[1] - 0.5 * bore.width)
        if not off.max(initial=0.0) <= CYLINDER_TOLERANCE * bore.radius:
            yield (
                f"{key}: node {np.argmax(off)} lies {off.max():.1e} m off the cylinder of radius "
                f"{bore.radius:.6g} m and width {bore.width:.6g} m about z, centred at z = 0, "
                f"limit {CYLINDER_TOLERANCE:.0e} radii"
            )
