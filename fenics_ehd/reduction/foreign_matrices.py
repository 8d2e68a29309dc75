"""K and M of a part in the text files of Abaqus and CalculiX, in the order of this package.

Abaqus writes them with ``*MATRIX GENERATE`` and ``*MATRIX OUTPUT``. ``FORMAT=MATRIX INPUT`` is
rows of node, degree of freedom, node, degree of freedom, value, separated by commas, which is what
``*MATRIX INPUT`` reads, one triangle or both (Abaqus 2016, Keywords Reference Guide, that keyword).
``FORMAT=COORDINATE`` is rows of row, column, value, separated by spaces, as Exudyn reads it
(jgerstmayr/EXUDYN, exudyn/FEM.py, ``ReadStiffnessMatrixFromAbaqus``). Not tried with Abaqus.

CalculiX writes them with ``*FREQUENCY, SOLVER=MATRIXSTORAGE``: ``JOB.sti`` and ``JOB.mas``, rows of
row, column, value, the upper triangle with 14 digits, and ``JOB.dof``, the node and the direction
of each row as ``node.direction`` (ccx 2.20, tried).

The mass of 10-node tetrahedra, which CalculiX integrates with too few points, is made anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.sealed_file import named, require_file
from fenics_ehd.reduction.elements import SOLIDS, summed
from fenics_ehd.reduction.matrices import reorder

if TYPE_CHECKING:
    from scipy import sparse

#: A diagonal entry so much larger than the smallest holds its degree of freedom: what its
#: neighbours add to it is lost in rounding.
_PENALTY = 1e15

#: Largest entry that may lack its mirror image in a file of both triangles, relative to the
#: largest: round-off that one of the two programs has dropped.
_ONE_SIDED = 1e-10


@dataclass(frozen=True, eq=False)
class ForeignMatrices:
    """K and M of a part, degree of freedom ``3 * place + component``.

    Attributes
    ----------
    stiffness, mass
        SciPy matrices, shape (3 n, 3 n), in the units of the other program.
    numbers
        The other program's number of the node at each place, shape (n,).
    """

    stiffness: sparse.csr_matrix
    mass: sparse.csr_matrix
    numbers: np.ndarray

    def places(self, numbers: ArrayLike) -> np.ndarray:
        """Places of nodes, of faces say, by the other program's numbers; of the same shape.

        Raises
        ------
        StructureError
            A node has no row in the matrices.
        """
        places, missing = _looked_up(self.numbers, np.asarray(numbers))
        if len(missing):
            raise StructureError(
                f"node {missing[0]} has no row in the matrices: if it is held, name all nodes "
                "of the part with numbers= when reading them"
            )
        return places

    def turned(self, turn: ArrayLike) -> ForeignMatrices:
        """Matrices of the part turned, whose point x is at ``turn @ x``; shape (3, 3)."""
        from scipy import sparse

        whole = sparse.kron(sparse.identity(len(self.numbers)), np.asarray(turn), format="csr")
        k, m = ((whole @ matrix @ whole.T).tocsr() for matrix in (self.stiffness, self.mass))
        return ForeignMatrices(k, m, self.numbers)


def read_calculix(job: str | Path, numbers: ArrayLike | None = None) -> ForeignMatrices:
    """K and M that CalculiX has stored, ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.

    Parameters
    ----------
    job
        Name of the job, with its folder: ``JOB.sti``, ``JOB.mas`` and ``JOB.dof`` are read.
    numbers
        Numbers of all nodes, in the order they shall have; None: of those with rows, ascending.
        Held degrees of freedom have no rows: see `reorder`.

    Raises
    ------
    StructureError
        A file cannot be read, or does not fit the others.
    """
    dof_file = Path(f"{job}.dof")
    table = _table(dof_file, separator=".")
    if table.shape[1] != 2:
        raise StructureError(f"{dof_file}: rows of {table.shape[1]} numbers, not node.direction")
    labels = _whole(dof_file, table)
    _check_labels(dof_file, labels)
    size = len(labels)
    stiffness, mass = (
        _square(file, *_triples(file, _table(file)), size)
        for file in (Path(f"{job}.sti"), Path(f"{job}.mas"))
    )
    return _in_order(stiffness, mass, labels - [0, 1], numbers, str(dof_file))


def read_abaqus(
    stiffness: str | Path, mass: str | Path, numbers: ArrayLike | None = None
) -> ForeignMatrices:
    """K and M that Abaqus has written, ``*MATRIX OUTPUT, STIFFNESS, MASS``.

    Parameters
    ----------
    stiffness, mass
        Files, ``JOB_STIF1.mtx`` and ``JOB_MASS1.mtx`` say, both of ``FORMAT=MATRIX INPUT`` or both
        of ``FORMAT=COORDINATE``. One or both triangles.
    numbers
        Numbers of all nodes, in the order they shall have; None: of those with rows, ascending.
        The second format does not have them: there it is the order of the nodes in the file, None
        for 1, 2, ...

    Raises
    ------
    StructureError
        A file cannot be read; nodes have other degrees of freedom than 1, 2, 3, or are internal.
    """
    files = Path(stiffness), Path(mass)
    tables = [_table(file) for file in files]
    widths = {table.shape[1] for table in tables}
    if not widths <= {3, 5} or len(widths) != 1:
        found = " and ".join(str(table.shape[1]) for table in tables)
        raise StructureError(
            f"{files[0]}, {files[1]}: rows of {found} numbers; Abaqus writes 5 with "
            "FORMAT=MATRIX INPUT, 3 with FORMAT=COORDINATE"
        )
    if widths == {3}:
        triples = [_triples(file, table) for file, table in zip(files, tables, strict=True)]
        size = int(max(max(rows.max(), columns.max()) for rows, columns, _ in triples)) + 1
        count = -(-size // 3) if numbers is None else len(np.asarray(numbers))
        nodes = np.arange(1, count + 1) if numbers is None else np.asarray(numbers)
        labels = np.column_stack([np.repeat(nodes, 3), np.tile([0, 1, 2], count)])
        if size != len(labels):
            raise StructureError(f"{files[0]} has {size} rows, not 3 for each of {count} nodes")
    else:
        whole = [_whole(file, table[:, :4]) for file, table in zip(files, tables, strict=True)]
        for file, label in zip(files, whole, strict=True):
            _check_labels(file, label.reshape(-1, 2))
        pairs = np.concatenate([label.reshape(-1, 2) for label in whole]) - [0, 1]
        labels, rows = np.unique(pairs, axis=0, return_inverse=True)
        split = np.split(rows.reshape(-1, 2), [len(whole[0])])
        triples = [(*r.T, table[:, 4]) for r, table in zip(split, tables, strict=True)]
    made = [_square(f, *t, len(labels)) for f, t in zip(files, triples, strict=True)]
    return _in_order(made[0], made[1], labels, numbers, str(files[0]))


def _table(file: Path, separator: str | None = None) -> np.ndarray:
    """Numbers of a text file, of which all lines have as many."""
    with named(StructureError, str(file)):
        require_file(file)
        with open(file, encoding="ascii") as lines:
            first = next((line for line in lines if line.strip() and line[:2] != "**"), "")
        if not first:
            raise StructureError(f"{file} is empty")
        separator = "," if "," in first else separator
        table = np.loadtxt(file, delimiter=separator, comments="**", ndmin=2)
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise StructureError(f"{file}, entry {row + 1}: a number is not finite")
    return table


def _whole(file: Path, table: np.ndarray) -> np.ndarray:
    """Whole numbers, as such."""
    whole = table.astype(np.int64)
    wrong = np.flatnonzero((whole != table).any(axis=1))
    if len(wrong):
        raise StructureError(f"{file}, entry {wrong[0] + 1}: {table[wrong[0]]} are no places")
    return whole


def _triples(file: Path, table: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns from 0, and values."""
    if table.shape[1] != 3:
        raise StructureError(f"{file}: rows of {table.shape[1]} numbers, not of row, column, value")
    places = _whole(file, table[:, :2])
    if places.min() < 1:
        raise StructureError(
            f"{file} has row {places.min()}, the first is 1: internal nodes of elements (hybrid, "
            "incompatible modes) cannot be used"
        )
    return places[:, 0] - 1, places[:, 1] - 1, table[:, 2]


def _check_labels(file: Path, labels: np.ndarray) -> None:
    """Nodes from 1, degrees of freedom 1, 2, 3."""
    if labels[:, 0].min() < 1:
        raise StructureError(
            f"{file} has node {labels[:, 0].min()}: internal nodes of elements (hybrid, "
            "incompatible modes) cannot be used"
        )
    wrong = np.flatnonzero((labels[:, 1] < 1) | (labels[:, 1] > 3))
    if len(wrong):
        node, direction = labels[wrong[0]]
        raise StructureError(
            f"{file}: node {node} has degree of freedom {direction}: only displacements, 1 to 3, "
            "of solid elements can be used"
        )


def _square(
    file: Path, rows: np.ndarray, columns: np.ndarray, values: np.ndarray, size: int
) -> sparse.csr_matrix:
    """Symmetric matrix of one triangle, in whatever order, or of both."""
    from scipy import sparse

    if max(rows.max(), columns.max()) >= size:
        raise StructureError(
            f"{file} has row {max(rows.max(), columns.max()) + 1}, there are {size}"
        )
    keys = rows * size + columns
    sorted_keys = np.sort(keys)
    twice = np.flatnonzero(sorted_keys[1:] == sorted_keys[:-1])
    if len(twice):
        row, column = divmod(int(sorted_keys[twice[0]]), size)
        raise StructureError(
            f"{file}: the entry of row {row + 1}, column {column + 1} stands twice"
        )
    matrix = sparse.coo_matrix((values, (rows, columns)), shape=(size, size)).tocsr()
    off = rows != columns
    alone = off & ~np.isin(keys, columns * size + rows)
    if alone.sum() == off.sum():
        return (matrix + matrix.T - sparse.diags(matrix.diagonal())).tocsr()
    worst = int(np.argmax(np.abs(values) * alone))
    if alone[worst] and abs(values[worst]) > _ONE_SIDED * np.abs(values).max():
        raise StructureError(
            f"{file} has row {rows[worst] + 1}, column {columns[worst] + 1}, but not its mirror "
            "image, while others have theirs: write one triangle or both"
        )
    return matrix


def _looked_up(numbers: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of wanted numbers among others, of the same shape, and those that are not there."""
    order = np.argsort(numbers)
    found = np.searchsorted(numbers, wanted, sorter=order)
    places = order[np.minimum(found, len(order) - 1)]
    return places, wanted[numbers[places] != wanted]


def _in_order(
    stiffness: sparse.csr_matrix,
    mass: sparse.csr_matrix,
    labels: np.ndarray,
    numbers: ArrayLike | None,
    name: str,
) -> ForeignMatrices:
    """Rows of labels (node, component) in the order of this package."""
    nodes = np.unique(labels[:, 0]) if numbers is None else np.asarray(numbers)
    if nodes.ndim != 1 or nodes.dtype.kind not in "iu" or len(np.unique(nodes)) != len(nodes):
        raise StructureError("numbers: give the number of every node once, as whole numbers")
    places, unknown = _looked_up(nodes, labels[:, 0])
    if len(unknown):
        raise StructureError(f"{name}: node {unknown[0]} is not among the numbers given")
    diagonal = stiffness.diagonal()
    smallest = diagonal.min(initial=np.inf, where=diagonal > 0)
    free = np.flatnonzero(diagonal <= _PENALTY * smallest)
    dofs = np.full((len(nodes), 3), -1)
    dofs[places[free], labels[free, 1]] = np.arange(len(free))
    if (dofs >= 0).sum() != len(free):
        raise StructureError(f"{name}: a node's direction has two rows")
    return ForeignMatrices(
        reorder(stiffness[free][:, free], dofs), reorder(mass[free][:, free], dofs), nodes
    )


# Mass of 10-node tetrahedra

#: Gauss points a direction: on a curved cell the integrand is of degree 4 + 3, and collapsing
#: the cube adds 2.
_POINTS = 5


def tetrahedron_mass(nodes: np.ndarray, cells: np.ndarray, density: float) -> sparse.csr_matrix:
    """Consistent mass matrix of curved 10-node tetrahedra, integrated exactly.

    Parameters
    ----------
    nodes
        Positions, shape (n, 3) [m].
    cells
        Places of the nodes of each cell, shape (c, 10): corners, then the edges 12, 23, 31, 14,
        24, 34, as in Abaqus, CalculiX and VTK.
    density
        [kg/m^3].

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (3 n, 3 n) [kg], degree of freedom ``3 * node + component``.

    Raises
    ------
    StructureError
        `cells` are no 10-node tetrahedra of these nodes, or one is turned inside out.
    """
    from scipy import sparse

    nodes, cells = np.asarray(nodes, dtype=float), np.asarray(cells)
    if cells.ndim != 2 or cells.shape[1] != 10 or cells.dtype.kind not in "iu" or not len(cells):
        raise StructureError(
            f"cells of shape {cells.shape}: (cells, 10) of whole numbers is needed"
        )
    if not 0 <= cells.min() <= cells.max() < len(nodes):
        raise StructureError(
            f"cells name nodes {cells.min()} to {cells.max()}, there are 0 to {len(nodes) - 1}"
        )
    points, weights = SOLIDS["tet"].rule(_POINTS)
    values, slopes = SOLIDS["tet"].tabulate(points)
    jacobians = np.einsum("dqi,cix->cqdx", slopes, nodes[cells])
    volumes = np.linalg.det(jacobians)
    # The sign is that of the numbering; within a cell it must not change.
    signs = np.sign(volumes[:, :1])
    folded = np.flatnonzero((volumes * signs <= 0).any(axis=1))
    if len(folded):
        raise StructureError(f"cell {folded[0]} with nodes {cells[folded[0]]} is folded")
    blocks = density * np.einsum("q,cq,qi,qj->cij", weights, volumes * signs, values, values)
    scalar = summed(blocks, cells[:, :, None], cells[:, None], (len(nodes),) * 2)
    return sparse.kron(scalar, sparse.eye(3), format="csr")
