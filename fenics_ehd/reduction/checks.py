"""Is this a part? Checks of matrices that any program may have made, before work is spent on them.

Cheap: 15 to 35 products with a matrix on one rank, twice as many on several, no factorisation.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.petsc_options import configured
from fenics_ehd.reduction.bore_checks import check_bores
from fenics_ehd.reduction.distributed import inner, multiply
from fenics_ehd.reduction.rigid_body import FREE_TOLERANCE
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.row_blocks import agree, before
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

#: Largest speed of waves from a node to the next [m/s]: beryllium has 3e4, a part of steel whose
#: nodes are in millimetres 7e6 and more, of polymer 2e6.
FASTEST = 1.5e6

#: Smallest energy of any rigid motion of a clamped part, relative to that node by node.
_HELD = 1e-12

#: Largest defect of the mean displacement that a boundary point has under unit translations.
WEIGHT_TOLERANCE = 1e-8

#: Smallest eigenvalue of the Gram matrix of two boundary points' unit vectors.
INDEPENDENT = 1e-10

_MOTIONS = (
    *(f"translation along {axis}" for axis in "xyz"),
    *(f"rotation about {a}" for a in "xyz"),
)


def check_structure(structure: Structure) -> None:
    """Check that matrices, coordinates, bores and boundary points make one part.

    Collective. A motion without energy beyond the rigid ones, of a loose piece say, is not
    found here but by `StaticSolver`.

    Raises
    ------
    StructureError
        Sizes do not fit; a value is not finite; K or M is not symmetric, has an empty row or
        a diagonal entry that is not positive; M is singular or not positive definite; some
        rigid motions cost energy and others do not; degrees of freedom go component by component;
        matrices and coordinates are of different units; bore nodes are not on the bore, or its
        load matrix is not one of a pressure that pushes outward; the first bore is not at the
        origin, or two share a node; a boundary point is no mean
        displacement, or two of them are one.
    """
    _check_sizes(structure)
    _check_finite(structure)
    for name, matrix in (("stiffness", structure.stiffness), ("mass", structure.mass)):
        _check_diagonal(matrix, name)
        _check_symmetric(matrix, name)
    _check_order(structure)
    _check_rigid_motions(structure)
    _check_definite(structure.mass)
    _check_units(structure)
    check_bores(structure)
    _check_attachments(structure)


def _check_sizes(structure: Structure) -> None:
    comm, stiffness = structure.comm, structure.stiffness
    size, owned = stiffness.size[0], stiffness.local_size[0]
    for name, matrix in (("stiffness", stiffness), ("mass", structure.mass)):
        if matrix.size != (size, size):
            raise StructureError(f"{name} has shape {matrix.size}, not {(size, size)}")
    for name, bore in structure.bores.items():
        rows = bore.load.size[0]
        if rows != size:
            raise StructureError(f"{name}.load has {rows} rows, the stiffness matrix has {size}")
    for name, three in structure.attachments.items():
        for vector in three:
            if vector.size != size:
                raise StructureError(
                    f"attachment {name!r} has {vector.size} rows, the stiffness matrix has {size}"
                )
    layouts = [("stiffness", stiffness.local_size[1]), ("mass", structure.mass.local_size[0])]
    for name, three in structure.attachments.items():
        layouts += [(f"attachment {name!r}", vector.local_size) for vector in three]
    layouts += [(f"{name}.load", b.load.local_size[0]) for name, b in structure.bores.items()]
    problem = None
    for name, rows in layouts:
        if rows != owned:
            problem = f"{name}: a rank owns {rows} rows, and {owned} of the stiffness matrix"
    agree(comm, problem)


def _check_finite(structure: Structure) -> None:
    matrices = {"stiffness": structure.stiffness, "mass": structure.mass}
    matrices |= {f"{name}.load": bore.load for name, bore in structure.bores.items()}
    for name, matrix in matrices.items():
        if not np.isfinite(matrix.norm(PETSc.NormType.FROBENIUS)):
            raise StructureError(f"{name} holds a value that is not finite")
    node = _first(~np.isfinite(structure.coordinates).all(axis=1), structure.comm)
    if node is not None:
        raise StructureError(f"the coordinates of node {node} are not finite")
    for name, three in structure.attachments.items():
        if not all(np.isfinite(vector.norm()) for vector in three):
            raise StructureError(f"attachment {name!r} holds a value that is not finite")


def _first(wrong: np.ndarray, comm: MPI.Comm) -> int | None:
    """Global number of the first True of an array distributed over the ranks."""
    start = before(len(wrong), comm)
    mine = start + int(np.argmax(wrong)) if wrong.any() else np.iinfo(np.int64).max
    found = comm.allreduce(mine, op=MPI.MIN)
    return None if found == np.iinfo(np.int64).max else found


def _place(row: int) -> str:
    return f"node {row // 3}, component {'xyz'[row % 3]}"


def _check_diagonal(matrix: PETSc.Mat, name: str) -> None:
    comm = matrix.comm.tompi4py()
    diagonal = matrix.getDiagonal().array
    row = _first(~(diagonal > 0), comm)
    if row is None:
        return
    first, last = matrix.getOwnershipRange()
    problem = None
    if first <= row < last:
        empty = not matrix.getRow(row)[1].any()
        what = "an empty row" if empty else f"the diagonal entry {diagonal[row - first]:.3g}"
        problem = f"{name} has {what} at {_place(row)}, it must be positive there"
    agree(comm, problem)


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
    """Stiffness, mass and the distance of nodes make a speed of waves that a solid may have.

    It takes absolute figures: in any consistent system of units a part is one.
    """
    from scipy.spatial import cKDTree

    comm = structure.comm
    nodes = np.vstack(comm.allgather(structure.coordinates))
    matrices = structure.stiffness, structure.mass
    stiffness, mass = (
        np.concatenate(comm.allgather(matrix.getDiagonal().array)) for matrix in matrices
    )
    apart = np.median(cKDTree(nodes).query(nodes, k=2)[0][:, 1])
    speed = apart * np.sqrt(np.median(stiffness / mass))
    if speed > FASTEST:
        raise StructureError(
            f"stiffness, mass and nodes {apart:.3g} m apart make waves of {speed:.2g} m/s, above "
            f"{FASTEST:.2g}: give N/m, kg and m; are the coordinates in millimetres?"
        )


def _check_rigid_motions(structure: Structure) -> None:
    """All six rigid motions or none without energy, as `rigid_body_modes` asks."""
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
        names = ", ".join(motion for motion, is_free in zip(_MOTIONS, free, strict=True) if is_free)
        raise StructureError(
            f"{free.sum()} of 6 rigid motions store no energy ({names}), a part must be free or "
            f"clamped (largest relative energy {ratios.max():.1e}, limit {FREE_TOLERANCE:.0e}): "
            "are the coordinates in the order of the degrees of freedom?"
        )
    softest = np.linalg.eigvalsh(energy)[0]
    if not free.any() and not softest > _HELD:
        raise StructureError(
            f"a rigid motion other than about the axes stores no energy (relative {softest:.1e}, "
            f"limit {_HELD:.0e}): the supports do not clamp the part"
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
    rows = structure.stiffness.local_size[0]
    vectors = {
        name: np.column_stack([v.array for v in three]).reshape(rows, 3)
        for name, three in structure.attachments.items()
    }
    translations = rigid_fields(structure.coordinates)[:, :3]
    comm = structure.comm
    for name, columns in vectors.items():
        mean = inner(columns, translations, comm)
        worst = np.unravel_index(np.argmax(np.abs(mean - np.eye(3))), (3, 3))
        if not np.abs(mean - np.eye(3)).max() <= WEIGHT_TOLERANCE:
            raise StructureError(
                f"attachment {name!r}: a unit translation along {'xyz'[worst[1]]} moves it by "
                f"{mean[worst]:.6g} along {'xyz'[worst[0]]}, not {float(worst[0] == worst[1]):g}: "
                "the weights of each component must sum to one"
            )
    _check_independent(vectors, comm)


def _check_independent(vectors: dict[str, np.ndarray], comm: MPI.Comm) -> None:
    names = list(vectors)
    columns = np.hstack([vectors[name] for name in names]) if names else np.zeros((0, 0))
    gram = inner(columns, columns, comm)
    sizes = np.sqrt(np.diag(gram))
    gram /= np.outer(sizes, sizes)
    for i, first in enumerate(names):
        for j, second in enumerate(names[:i]):
            both = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            if not np.linalg.eigvalsh(gram[np.ix_(both, both)])[0] > INDEPENDENT:
                raise StructureError(
                    f"attachments {second!r} and {first!r} are the same point: their load vectors "
                    "depend on each other"
                )
