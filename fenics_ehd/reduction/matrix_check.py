"""Checks of the matrices of a part: symmetry, rigid motions, order of nodes, units, digits.

`require_matrices` checks distributed matrices before a reduction (`check_structure`).
`check_matrices` makes the same checks of matrices of another program, and reports mass, centre,
digits and units.

A free part has no elastic forces in a rigid motion: ``K R = 0`` with the columns of R the unit
translations and rotations about the coordinates' origin. If coordinates and matrices have different
orders of nodes, translations remain without force, but not rotations. Forces in a translation are
those of a part that is held, or of damaged rows: the check cannot distinguish them. Forces at every
node are suspicious, because a sparse K couples only nodes near supports with them: such a part is
reported, and has the diagonal twice, for instance. M gives mass
and centre by the same motions, ``R^T M R``.

Values that a file has rounded to d digits differ from those of the program by at most
``u |K_ij|``, ``u = 0.5 10^(1 - d)``, since d digits of a number begin with a digit of 1 to 9.
The forces in a rigid motion are then, in every row,

    |K R| <= u |K| |R|.

The bound cannot be exceeded by rounding; forces above it have another cause. It is not pessimistic:
on rings of hexahedra that were rounded to 6 to 14 digits, the largest forces were 0.25 to 0.5 of
it. Forces within the bound are accepted, others count as those of damaged values.

Two estimates show units that do not belong together. The speed of elastic waves follows from the
mean stiffness and mass of a node and from the distance h to the nearest node,

    c = h sqrt(tr K / tr M),

and the mean density in the convex hull of the nodes from the mass. In SI units the first is 0.1 to
3 times sqrt(E / rho), by the shape and order of the cells, and the second is below the density.
Matrices in N, mm and t have the same ``tr K / tr M`` in 1/s^2 as in SI units: with coordinates in
mm, c is 1000 times too large; with coordinates in m, the density is 1000 times too small.

Imports inside functions: scipy.spatial is needed only for a report.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike
from petsc4py import PETSc

from fenics_ehd.base.arguments import require_count
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.petsc_options import configured
from fenics_ehd.reduction.bore import rigid_fields
from fenics_ehd.reduction.matrices import agree, as_matrix, inner, multiply, norm

#: Largest strain energy of a rigid motion of a free part, relative to the energy of the same nodal
#: displacements with the diagonal of K.
FREE_TOLERANCE = 1e-9

#: Strain energy above which every rigid motion of a clamped part counts as held, relative to the
#: energy with the diagonal of K.
HELD = 1e-12

#: Largest elastic force in a rigid motion of a free part, relative to the terms ``|K| |R|`` that
#: cancel. Two nodes in the wrong order cause 1e-2.
RIGID_LIMIT = 1e-6

#: Elastic forces in rigid motions, relative to the terms that cancel, below which K counts as free
#: of rounding. Assembled matrices have 1e-15, files with 12 digits 1e-12.
ROUND_OFF_FORCES = 1e-13

#: Fewest digits of K with which forces in rigid motions are accepted as those of rounding; single
#: precision has 7. With fewer, stiffness and frequencies would be wrong by per cents.
FEWEST_DIGITS = 7

#: Elastic force at a node in a translation, relative to that of its diagonal entries, above which
#: supports or damage act on the node. Rounding to 7 digits causes 1e-6.
FORCED = 1e-3

#: Share of entries that are not zero above which K counts as dense, as that of a condensed part.
DENSE = 0.5

#: Rounding above which values count as simple numbers, not as rounded ones (4 digits).
_SIMPLE = 1e-3

#: Energy of a rigid motion above which it is not that of rounding, relative to the energy with the
#: diagonal of K: rounding to 5 digits causes 5e-5 at most.
_ROUNDED_ENERGY = 1e-4

#: Most digits that `decimal_digits` counts. A conversion by a power of ten changes the 16th digit.
MOST_DIGITS = 14

#: Number of values of a rank in which digits are counted.
_SAMPLE = 2000

#: Factor of the bound of forces for digits that were stated, not counted: a rotation of a node's
#: directions mixes three entries, and its rows have absolute sums of sqrt(3) at most, on both
#: sides.
_ROTATED = 3.0

#: Largest difference between the masses of a free part along x, y and z, relative to the largest.
#: Files with 7 digits have 1e-7.
SAME_MASS = 1e-5

#: Largest relative antisymmetric part of K or M, evaluated with random vectors that are scaled by
#: the diagonal. It is below the tolerance of static responses, 1e-8.
SYMMETRY_TOLERANCE = 1e-9

#: Largest relative excess of an entry of K over the geometric mean of its two diagonal entries.
#: Rounding to `FEWEST_DIGITS` digits causes half as much.
MINOR_TOLERANCE = 1e-6

#: Smallest accepted eigenvalue of M, scaled by its diagonal, relative to the largest eigenvalue. It
#: is 1e-2 for elements of degree 2, and 1e-16 for round-off.
MASS_TOLERANCE = 1e-8

#: Smallest component of a null vector of M in a random load that is detected, relative to the mean
#: component. It is also the probability that a null vector is missed.
_MISSED = 1e-2

#: Largest force due to a translation on a node without support, relative to the diagonal entry.
_UNLOADED = 1e-6

#: Mass over the volume of a box around the nodes that is impossible for a part in SI units, lower
#: and upper limit [kg/m3]. A frame of thin bars has 10 kg/m3. With numbers in millimetres and
#: kilograms, a solid block of steel has 8e-6; with millimetres and tonnes, which are consistent
#: with N/mm, gold has 2e-8.
IMPOSSIBLE = (3e-8, 0.1)

#: Estimated speeds of elastic waves that are usual [m/s]. Solids have 300 (soft plastics), 5000
#: (steel) to 12 000 (ceramics); the estimate is 0.1 times as much on a shaft of long cells, and 3
#: times on quadratic cells.
SPEEDS = (400.0, 40e3)

#: Densities in the convex hull of a part [kg/m^3]: from a thin frame of magnesium to tungsten.
DENSITIES = (30.0, 20e3)

#: Conversions from usual mixtures of units: factors of coordinates, K and M, and their text.
_CONVERSIONS = (
    (1.0, 1e3, 1e3, "multiply K and M by 1000 (N, mm and t)"),
    (1.0, 1.0, 1e3, "multiply M by 1000 (t)"),
    (1.0, 1e3, 1.0, "multiply K by 1000 (N/mm)"),
    (1.0, 1.0, 1e-3, "multiply M by 0.001 (g)"),
    (1e-3, 1e3, 1e3, "multiply coordinates by 0.001, K and M by 1000 (N, mm and t)"),
    (1e-3, 1.0, 1.0, "multiply coordinates by 0.001 (mm)"),
)

#: What to do about coordinates and rows of K in different orders.
_ORDER = "coordinates and rows of K are not in the same order of nodes, or of x, y, z"

#: Names of the six rigid motions in messages.
_MOTIONS = tuple(
    f"{motion} {axis}" for motion in ("translation along", "rotation about") for axis in "xyz"
)

#: Notice on forces at every node.
FORCED_EVERYWHERE = (
    "translations have elastic forces at every node, but only nodes next to supports of a held "
    "part can have them: is the diagonal of K counted twice (U + U.T of an upper triangle U in "
    "place of U + U.T - diag(U)), or are rows missing or in another order?"
)


@dataclass(frozen=True)
class Rounding:
    """Rounding of the values of a matrix in a file.

    Attributes
    ----------
    label
        Digits for messages, for instance "10 digits".
    unit
        Largest relative error u of a value.
    factor
        Factor of the bound of forces in rigid motions: 1 if the digits were counted in the values.
    """

    label: str
    unit: float
    factor: float = 1.0

    @staticmethod
    def to_digits(digits: int, factor: float = 1.0) -> Rounding:
        """Rounding to a number of decimal digits."""
        return Rounding(f"{digits} digits", 0.5 * 10.0 ** (1 - digits), factor)


#: Rounding of values in single precision, with 24 bits.
SINGLE = Rounding("single precision", 2.0**-24)


@dataclass(frozen=True, eq=False)
class RigidMotions:
    """Rigid motions of a part.

    Attributes
    ----------
    fields
        Displacements of six rigid motions, rows of this rank, shape (owned dofs, 6). They are
        scaled so that their energy with the diagonal of K is 1.
    free
        True if no rigid motion stores energy, False if all do.
    rounding
        Rounding that causes the elastic forces in rigid motions of a free part; None if these
        forces are those of double precision, or have another cause.
    forced_everywhere
        Whether translations have elastic forces at every node, though K is sparse.
    """

    fields: np.ndarray
    free: bool
    rounding: Rounding | None = None
    forced_everywhere: bool = False


def decimal_digits(values: np.ndarray) -> int | None:
    """Count the decimal digits of values, in a sample of them; None for more than `MOST_DIGITS`.

    The most digits of a value count: 0.5 has one digit in every file.
    """
    sample = values[:: max(1, len(values) // _SAMPLE)]
    texts = (f"{abs(value):.14e}"[:16].rstrip("0").replace(".", "") for value in sample)
    digits = max(map(len, texts), default=1)
    return digits if digits <= MOST_DIGITS else None


def is_single(values: np.ndarray) -> bool:
    """Whether values are those of single precision."""
    return bool(np.array_equal(values.astype(np.float32), values))


def rounding_of(matrix: PETSc.Mat) -> Rounding | None:
    """Find the rounding of the values of a matrix; None if they have all digits; collective."""
    values = matrix.getValuesCSR()[2]
    comm = matrix.comm.tompi4py()
    counts = comm.allgather(decimal_digits(values))
    most = max((MOST_DIGITS + 1 if count is None else count) for count in counts)
    if comm.allreduce(is_single(values), op=MPI.LAND) and most > FEWEST_DIGITS:
        return SINGLE
    return None if most > MOST_DIGITS else Rounding.to_digits(most)


def absolute(matrix: PETSc.Mat) -> PETSc.Mat:
    """Matrix of the absolute values of the entries."""
    pointers, columns, values = matrix.getValuesCSR()
    return PETSc.Mat().createAIJ(
        matrix.getSizes(), csr=(pointers, columns, np.abs(values)), comm=matrix.comm
    )


def _forces(stiffness: PETSc.Mat, fields: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Magnitudes of the elastic forces of motions, and of the terms that cancel in them."""
    magnitudes = absolute(stiffness)
    terms = multiply(magnitudes, np.abs(fields))
    magnitudes.destroy()
    return np.abs(multiply(stiffness, fields)), terms


def _largest(columns: np.ndarray, comm: MPI.Comm) -> np.ndarray:
    """Largest value of each column, over the rows of all ranks."""
    return np.max(comm.allgather(columns.max(axis=0, initial=0.0)), axis=0)


@dataclass(frozen=True, eq=False)
class _Excess:
    """Elastic forces in rigid motions, and whether rounding explains them.

    Attributes
    ----------
    defects
        Largest force in each motion, relative to the terms that cancel, shape (6,).
    rounded
        Whether the forces of each motion are within the bound of rounding, shape (6,).
    rounding
        Rounding of the values of K, None if they have all digits.
    """

    defects: np.ndarray
    rounded: np.ndarray
    rounding: Rounding | None


def _excess(stiffness: PETSc.Mat, fields: np.ndarray, digits: int | None) -> _Excess:
    """Compare the elastic forces in rigid motions with those that rounding of K can cause.

    Raises
    ------
    StructureError
        If the forces are those of rounding to fewer than `FEWEST_DIGITS` digits.
    """
    comm = stiffness.comm.tompi4py()
    forces, terms = _forces(stiffness, fields)
    scale = _largest(terms, comm)
    defects = _largest(forces, comm) / scale
    rounding = Rounding.to_digits(digits, _ROTATED) if digits else rounding_of(stiffness)
    if rounding is None or rounding.unit > _SIMPLE:
        return _Excess(defects, np.zeros(6, dtype=bool), None)
    limit = rounding.factor * rounding.unit * terms + ROUND_OFF_FORCES * scale
    rounded = np.all(comm.allgather((forces <= limit).all(axis=0)), axis=0)
    if rounded.any() and rounding.unit > 0.5 * 10.0 ** (1 - FEWEST_DIGITS):
        raise StructureError(
            f"K has {rounding.label}, at least {FEWEST_DIGITS} are needed: rigid motions have "
            f"elastic forces of {defects.max():.1e} of their terms"
        )
    return _Excess(defects, rounded, rounding)


def rigid_motions(
    stiffness: PETSc.Mat, coordinates: np.ndarray, digits: int | None = None
) -> RigidMotions:
    """Compute the rigid motions of a part, and whether it is free or clamped; collective.

    Parameters
    ----------
    stiffness
        Stiffness matrix K.
    coordinates
        Positions of the nodes of this rank, shape (owned nodes, 3) [m].
    digits
        Digits of the file from which K was read; None to count them in the values if needed.

    Raises
    ------
    StructureError
        If all nodes lie at the origin or on one axis, if only some rigid motions store energy, or
        if rigid motions of a free part have elastic forces above `RIGID_LIMIT` that are not those
        of rounding.
    """
    fields = rigid_fields(coordinates)
    comm = stiffness.comm.tompi4py()
    diagonal = stiffness.getDiagonal().array
    bound = np.sqrt(comm.allreduce(np.sum(fields**2 * diagonal[:, None], axis=0)))
    if not bound.all():
        raise StructureError("all nodes lie at the origin or on one axis: were coordinates given?")
    fields /= bound
    products = multiply(stiffness, fields)
    energy = inner(fields, products, comm)
    ratios = np.diag(energy)
    rough = _largest(np.abs(products), comm) / _largest(diagonal[:, None] * np.abs(fields), comm)
    excess = _Excess(np.zeros(6), np.zeros(6, dtype=bool), None)
    if rough.max() > ROUND_OFF_FORCES and np.abs(ratios).min() <= _ROUNDED_ENERGY:
        excess = _excess(stiffness, fields, digits)
    free = (ratios <= FREE_TOLERANCE) | excess.rounded
    unexplained = np.where(excess.rounded, 0.0, ratios)
    if unexplained.min() < -FREE_TOLERANCE:
        raise StructureError(
            f"stiffness is not positive semidefinite: {_MOTIONS[int(np.argmin(unexplained))]} has "
            f"a relative energy of {unexplained.min():.1e}, limit {-FREE_TOLERANCE:.0e}: "
            "were all digits written?"
        )
    if free.any() and not free.all():
        names = ", ".join(itertools.compress(_MOTIONS, free))
        cause = _ORDER if free[:3].all() else "supports leave motions free, or rows are damaged"
        raise StructureError(
            f"{free.sum()} of 6 rigid motions store no energy ({names}), but a part must be free "
            f"or clamped (largest relative energy {ratios.max():.1e}, limit {FREE_TOLERANCE:.0e}): "
            f"{cause}"
        )
    defects = np.where(excess.rounded, 0.0, excess.defects)
    if free.all() and defects.max() > RIGID_LIMIT:
        raise StructureError(
            f"{_MOTIONS[int(np.argmax(defects))]} of the part has elastic forces of "
            f"{defects.max():.1e} of their terms, above {RIGID_LIMIT:.0e}: "
            f"{'values of K are damaged' if defects[:3].max() > RIGID_LIMIT else _ORDER}"
        )
    softest = np.linalg.eigvalsh(energy)[0]
    if not free.any() and not softest > HELD:
        raise StructureError(
            "a combination of rigid motions stores no energy (relative energy "
            f"{softest:.1e}, limit {HELD:.0e}): the supports do not clamp the part"
        )
    return RigidMotions(
        fields,
        bool(free.all()),
        excess.rounding if excess.rounded.all() else None,
        not free.any() and _forced_everywhere(stiffness, fields, products),
    )


def _forced_everywhere(stiffness: PETSc.Mat, fields: np.ndarray, forces: np.ndarray) -> bool:
    """Whether translations have elastic forces at every node of a part with a sparse K; collective.

    `fields` and `forces` are displacements of the rigid motions, and their elastic forces, in the
    rows of this rank, shape (owned dofs, 6).
    """
    rows = stiffness.size[0]
    if stiffness.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"] > DENSE * rows**2:
        return False
    displacements = np.abs(fields[:, :3]).max(axis=0)
    terms = stiffness.getDiagonal().array[:, None] * displacements
    forced = np.abs(forces[:, :3]) > FORCED * terms
    at_every_node = bool(forced.reshape(-1, 9).any(axis=1).all())
    return bool(min(stiffness.comm.tompi4py().allgather(at_every_node)))


def require_matrices(
    stiffness: PETSc.Mat, mass: PETSc.Mat, coordinates: np.ndarray, digits: int | None = None
) -> RigidMotions:
    """Check K, M and coordinates of a part; collective. For the parameters see `rigid_motions`.

    Raises
    ------
    StructureError
        If a value is not finite; if K or M is not symmetric, or has an empty row or a diagonal
        entry that is not positive; if degrees of freedom are ordered by component, not by node; if
        `rigid_motions` refuses the part; if K has an entry that is impossible in a positive
        semidefinite matrix; if M is not positive definite; or if the units of mass and coordinates
        do not fit.
    """
    require_finite({"stiffness": stiffness, "mass": mass})
    sums = np.concatenate(stiffness.comm.tompi4py().allgather(coordinates.sum(axis=1)))
    worst = np.argmin(np.isfinite(sums))
    require(np.isfinite(sums[worst]), f"the coordinates of node {worst} are not finite")
    for name, matrix in (("stiffness", stiffness), ("mass", mass)):
        _check_diagonal(matrix, name)
        _check_symmetric(matrix, name)
    _check_order(stiffness)
    _check_minors(stiffness)
    motions = rigid_motions(stiffness, coordinates, digits)
    _check_definite(mass)
    _check_density(mass, coordinates)
    return motions


def require(holds: bool | np.bool_, problem: str) -> None:
    """Raise `problem` as a `StructureError` unless a condition holds."""
    if not holds:
        raise StructureError(problem)


def require_finite(matrices: dict[str, PETSc.Mat]) -> None:
    """Refuse matrices, by their names, with values that are not finite."""
    for name, matrix in matrices.items():
        require(np.isfinite(matrix.norm()), f"{name} has a value that is not finite")


def _row_label(row: int) -> str:
    """Text for messages about a row of a matrix: its node and its component."""
    return f"node {row // 3}, component {'xyz'[row % 3]}"


def _random(matrix: PETSc.Mat, count: int = 1) -> np.ndarray:
    """Random vectors of unit variance, rows of this rank, shape (owned dofs, count)."""
    rank = matrix.comm.tompi4py().rank
    return np.random.default_rng([3, rank]).standard_normal((matrix.local_size[0], count))


def _check_diagonal(matrix: PETSc.Mat, name: str) -> None:
    """Refuse a matrix with a diagonal entry that is not positive."""
    diagonal = np.concatenate(matrix.comm.tompi4py().allgather(matrix.getDiagonal().array))
    row = int(np.argmin(diagonal))
    require(
        diagonal[row] > 0,
        f"{name} has the diagonal entry {diagonal[row]:.3g} at {_row_label(row)}, which must be "
        "positive: is the row empty?",
    )


def _check_symmetric(matrix: PETSc.Mat, name: str) -> None:
    """Refuse a matrix that is not symmetric, by the products ``a^T A b`` and ``b^T A a``."""
    comm = matrix.comm.tompi4py()
    scale = 1.0 / np.sqrt(matrix.getDiagonal().array)[:, None]
    vectors = scale * _random(matrix, 2)
    product = multiply(matrix, vectors)
    work = inner(vectors, product, comm)
    defect = abs(work[0, 1] - work[1, 0]) / norm(scale * product, comm)
    require(
        defect <= SYMMETRY_TOLERANCE,
        f"{name} is not symmetric: relative defect {defect:.1e}, limit "
        f"{SYMMETRY_TOLERANCE:.0e}; both triangles must be given, with the same digits (from one "
        "triangle A: A + A.T - scipy.sparse.diags(A.diagonal()))",
    )


def _check_minors(stiffness: PETSc.Mat) -> None:
    """Refuse a stiffness matrix with a negative principal minor of two degrees of freedom.

    The check passes over all entries once. A matrix that passes may still have a negative
    eigenvalue; the factorisation refuses it (`fenics_ehd.reduction.static.LinearSolver`).
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
            f"{_row_label(rows[worst])} and {_row_label(columns[worst])} is {ratios[worst]:.3g} "
            "times the geometric mean of their diagonal entries, but at most 1 is possible"
        )
    agree(comm, problem)


def _check_order(stiffness: PETSc.Mat) -> None:
    """Refuse degrees of freedom that are numbered component by component, not node by node.

    With the right numbering, a translation causes elastic forces only at nodes with supports.
    """
    comm = stiffness.comm.tompi4py()
    limit = _UNLOADED * stiffness.getDiagonal().array
    rows = np.arange(*stiffness.getOwnershipRange())
    along = np.sqrt([[1.0], [2.0], [3.0]])  # a direction outside every plane of symmetry
    by_node, by_component = (
        comm.allreduce(int((np.abs(multiply(stiffness, along[order])[:, 0]) <= limit).sum()))
        for order in (rows % 3, rows // (stiffness.size[0] // 3))
    )
    require(
        by_component <= by_node,
        "the degrees of freedom are numbered component by component (all nodes along x, then y, "
        "then z), but must be numbered node by node: use reorder(matrix, dofs) with "
        "dofs = numpy.arange(matrix.shape[0]).reshape(3, -1).T",
    )


def _check_density(mass: PETSc.Mat, coordinates: np.ndarray) -> None:
    """Refuse impossible densities: other checks do not detect inconsistent units.

    The density is the mass along x over the volume of a box around the nodes.
    """
    comm = mass.comm.tompi4py()
    along = rigid_fields(coordinates)[:, :1]
    total = inner(along, multiply(mass, along), comm)[0, 0]
    sides = np.ptp(np.vstack(comm.allgather(coordinates)), axis=0)
    density = total / max(float(np.prod(sides)), 1e-300)
    require(
        not IMPOSSIBLE[0] < density < IMPOSSIBLE[1],
        f"the part has a mass of {total:.3g} kg in a box of "
        f"{' x '.join(f'{side:.3g}' for side in sides)} m, {density:.1g} kg/m3, which is "
        "impossible: give coordinates in m, K in N/m and M in kg",
    )


def _check_definite(mass: PETSc.Mat) -> None:
    """Refuse a mass matrix that is singular or not positive definite.

    ``M x = f`` is solved for a random f by conjugate gradients. If M has a null vector, the
    component of f along it remains in the residual, and the Ritz values approach the eigenvalue
    zero. They also approach negative eigenvalues.
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
        # On one rank, "eisenstat" is symmetric Gauss-Seidel at the cost of one product; PETSc 3.18
        # does not have it for several ranks.
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
    require(
        ratio > MASS_TOLERANCE and not indefinite,
        f"mass is singular or not positive definite: relative eigenvalue {ratio:.1e}, limit "
        f"{MASS_TOLERANCE:.0e}; the eigenvector is largest at {_row_label(largest)}",
    )


# Report


@dataclass(frozen=True)
class MatrixCheck(Described):
    """Mass, centre, elastic defects and estimates from a part's K and M; printed as lines of text.

    Attributes
    ----------
    nodes
        Number of nodes.
    mass
        Mass of the part, mean of the three directions [kg].
    centre
        Centre of mass, shape (3,) [m].
    translation_defect, rotation_defect
        Largest elastic force in a translation and in a rotation, relative to the terms that cancel.
    wave_speed
        Estimated speed of elastic waves [m/s].
    density
        Mass over the volume of the nodes' convex hull [kg/m^3].
    held
        Whether the part is held, so that rigid motions have elastic forces.
    digits
        Text on the digits of K that cause the elastic forces of a free part, empty if there is no
        such cause.
    forced_everywhere
        Whether translations have elastic forces at every node, though K is sparse.
    """

    nodes: int
    mass: float
    centre: tuple[float, float, float]
    translation_defect: float
    rotation_defect: float
    wave_speed: float
    density: float
    held: bool = False
    digits: str = ""
    forced_everywhere: bool = False

    @property
    def notices(self) -> list[str]:
        """Lines about a part that is not free, about damaged values, and about mixed units."""
        lines = []
        defect = max(self.translation_defect, self.rotation_defect)
        if self.forced_everywhere:
            lines.append(FORCED_EVERYWHERE)
        elif self.held:
            lines.append(
                f"translations have elastic forces of {self.translation_defect:.1e} of their "
                "terms: the part is held, or rows of K are damaged, missing or in another order"
            )
        elif defect > ROUND_OFF_FORCES and not self.digits:
            lines.append(
                f"rigid motions have elastic forces of {defect:.1e} of their terms, more than the "
                "digits of K explain, and a verified reduction may fail: write coordinates, K and "
                "M with all digits; for K that was rotated or converted after reading, state the "
                "digits of its file, digits=10"
            )
        wrong = [
            f"{text} {value:.3g} {unit}, outside {limits[0]:g} to {limits[1]:g}"
            for text, value, unit, limits in (
                ("elastic waves of", self.wave_speed, "m/s", SPEEDS),
                ("a mean density of", self.density, "kg/m^3", DENSITIES),
            )
            if not limits[0] <= value <= limits[1]
        ]
        if wrong:
            lines.append(f"{' and '.join(wrong)}: {self._conversion()}")
        return lines

    def _conversion(self) -> str:
        """Text of the conversion to SI units that makes wave speed and density usual."""
        for length, force, mass, text in _CONVERSIONS:
            speed = length * (force / mass) ** 0.5 * self.wave_speed
            density = mass / length**3 * self.density
            if SPEEDS[0] <= speed <= SPEEDS[1] and DENSITIES[0] <= density <= DENSITIES[1]:
                return f"SI units follow if you {text}"
        return "give coordinates in m, K in N/m, M in kg"

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield the printed lines, the first with the name of the class."""
        first, *others = str(self).split("\n")
        yield "MatrixCheck", first
        for line in others:
            yield "", line

    def __repr__(self) -> str:
        return str(self)  # whole notices

    def __str__(self) -> str:
        x, y, z = self.centre
        state = "held" if self.held else "free"
        lines = [
            f"{self.nodes} nodes, {state}; mass {self.mass:.6g} kg, "
            f"centre ({x:.6g}, {y:.6g}, {z:.6g}) m",
            f"elastic forces in translations {self.translation_defect:.1e}, in rotations "
            f"{self.rotation_defect:.1e} of their terms",
            f"elastic waves {self.wave_speed:.4g} m/s, density in the convex hull "
            f"{self.density:.4g} kg/m^3",
        ]
        if self.digits:
            defect = max(self.translation_defect, self.rotation_defect)
            lines.insert(2, f"rigid motions to {defect:.0e}, as accurate as {self.digits}")
        return "\n".join([*lines, *(f"notice: {line}" for line in self.notices)])


def check_matrices(
    stiffness: Any, mass: Any, coordinates: ArrayLike, *, digits: int | None = None
) -> MatrixCheck:
    """Check K and M against the positions of the nodes; report mass, centre, digits and units.

    The checks are those of `check_structure`.

    Parameters
    ----------
    stiffness, mass
        K [N/m] and M [kg] as SciPy matrices or files, see `as_matrix`. Degrees of freedom are
        ``3 * node + component``.
    coordinates
        Positions of the nodes, shape (n, 3) [m].
    digits
        Digits of the file from which K was read, if K was rotated or converted since; None to
        count them in the values.

    Returns
    -------
    MatrixCheck
        Mass, centre, defects and estimates; its `notices` are lines about units and digits.

    Raises
    ------
    StructureError
        If the numbers of nodes or the masses of a free part along x, y and z differ, or see
        `require_matrices`.
    SettingsError
        If `digits` is no whole number from 1 to `MOST_DIGITS`.
    """
    if digits is not None:
        require_count("digits", digits, 1, MOST_DIGITS)
    try:
        points = np.asarray(coordinates, dtype=float)
    except (TypeError, ValueError):
        raise StructureError(f"coordinates = {coordinates!r:.60} are no numbers") from None
    matrices = [
        as_matrix(source, MPI.COMM_SELF, name)
        for name, source in (("stiffness", stiffness), ("mass", mass))
    ]
    for name, matrix in zip(("stiffness", "mass"), matrices, strict=True):
        if points.ndim != 2 or points.shape[1:] != (3,) or matrix.size != (3 * len(points),) * 2:
            raise StructureError(
                f"the {name} matrix has shape {matrix.size}, but coordinates of shape "
                f"{points.shape} need 3 rows for each node"
            )
    k, m = matrices
    motions = require_matrices(k, m, points, digits)
    # About the mean position: about a distant origin, terms would be larger than those of the part.
    fields = rigid_fields(points - points.mean(axis=0))
    forces, terms = _forces(k, fields)
    defects = forces.max(axis=0) / terms.max(axis=0)
    along = fields[:, :3]
    masses = np.diag(along.T @ multiply(m, along))
    # Of a held part, degrees of freedom without rows may lack their masses.
    require(
        not motions.free or np.ptp(masses) <= SAME_MASS * masses.max(),
        f"the masses along x, y and z are {masses[0]:.6g}, {masses[1]:.6g}, {masses[2]:.6g} kg, "
        "but must be equal: entries of M are missing or damaged",
    )
    total = float(masses.mean())
    centre = (along.T @ multiply(m, points.reshape(-1, 1))).ravel() / total
    traces = [matrix.getDiagonal().sum() for matrix in matrices]
    file = "" if digits else "the file's "
    return MatrixCheck(
        nodes=len(points),
        mass=total,
        centre=(float(centre[0]), float(centre[1]), float(centre[2])),
        translation_defect=float(defects[:3].max()),
        rotation_defect=float(defects[3:].max()),
        wave_speed=_spacing(points) * float(np.sqrt(traces[0] / traces[1])),
        density=total / _hull_volume(points),
        held=not motions.free,
        digits=f"{file}{motions.rounding.label}" if motions.rounding else "",
        forced_everywhere=motions.forced_everywhere,
    )


def _spacing(points: np.ndarray) -> float:
    """Mean distance of a node to the nearest other node [m]."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, k=2)
    return float(distances[:, 1].mean())


def _hull_volume(points: np.ndarray) -> float:
    """Volume of the convex hull of nodes [m^3].

    Raises
    ------
    StructureError
        If all nodes are in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        raise StructureError(f"the {len(points)} nodes of the part are in one plane") from None
