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

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.base.sealed_file import named, require_file
from fenics_ehd.reduction.elements import SOLIDS, summed
from fenics_ehd.reduction.matrices import reorder

#: Ratio of a diagonal entry to the smallest one above which its degree of freedom counts as held by
#: a penalty: contributions of neighbours are then lost in rounding.
_PENALTY = 1e15

#: Largest entry without its mirror image in a file of both triangles, relative to the largest
#: entry: round-off that one of the two programs has dropped.
_ONE_SIDED = 1e-10


#: Rows and columns of entries, shape (n, 2) from 0, and their values, shape (n,).
Entries = tuple[np.ndarray, np.ndarray]


@renamed_attributes(places="indices")
@dataclass(frozen=True, eq=False)
class ForeignMatrices:
    """K and M of a part, with degrees of freedom ``3 * index + component``.

    Attributes
    ----------
    stiffness, mass
        SciPy matrices, shape (3 n, 3 n), in the units of the other program.
    numbers
        Number of every node in the other program, shape (n,).
    """

    stiffness: sparse.csr_matrix
    mass: sparse.csr_matrix
    numbers: np.ndarray

    def indices(self, numbers: ArrayLike) -> np.ndarray:
        """Indices of nodes from their numbers in the other program, of the same shape.

        Raises
        ------
        StructureError
            A node has no row in the matrices.
        """
        indices, missing = _looked_up(self.numbers, np.asarray(numbers))
        if len(missing):
            raise StructureError(
                f"node {missing[0]} has no row in the matrices: if it is held, list all nodes "
                "of the part with numbers= when reading them"
            )
        return indices

    def turned(self, turn: ArrayLike) -> ForeignMatrices:
        """Matrices of the rotated part: point x of the part is at ``turn @ x``, shape (3, 3)."""
        rotation = sparse.kron(sparse.identity(len(self.numbers)), np.asarray(turn), format="csr")
        k, m = ((rotation @ matrix @ rotation.T).tocsr() for matrix in (self.stiffness, self.mass))
        return ForeignMatrices(k, m, self.numbers)


def read_calculix(job: str | Path, numbers: ArrayLike | None = None) -> ForeignMatrices:
    """K and M that CalculiX has stored, ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.

    Parameters
    ----------
    job
        Name of the job, with its folder: ``JOB.sti``, ``JOB.mas`` and ``JOB.dof`` are read.
    numbers
        Numbers of all nodes in the wanted order; None: nodes with rows, in ascending order. Held
        degrees of freedom have no rows, see `reorder`.

    Raises
    ------
    StructureError
        A file cannot be read, or does not fit the others.
    """
    require_class("job", job, str, Path)
    dof_file = Path(f"{job}.dof")
    labels = _labels(dof_file, _table(dof_file, (2,), separator="."))
    files = [Path(f"{job}.sti"), Path(f"{job}.mas")]
    entries = [_entries(file, _table(file, (3,))) for file in files]
    return _in_order(files, entries, labels, numbers)


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
        Numbers of all nodes in the wanted order; None: nodes with rows, in ascending order. The
        second format has no numbers: there it is the order of the nodes in the file, None for
        1, 2, ...

    Raises
    ------
    StructureError
        A file cannot be read; nodes have other degrees of freedom than 1, 2, 3, or are internal.
    """
    require_class("stiffness", stiffness, str, Path)
    require_class("mass", mass, str, Path)
    files = [Path(stiffness), Path(mass)]
    tables = [_table(file, (3, 5)) for file in files]
    width = tables[0].shape[1]
    if tables[1].shape[1] != width:
        raise StructureError(
            f"{files[0]}, {files[1]}: rows of {width} and {tables[1].shape[1]} numbers; write both "
            "with FORMAT=MATRIX INPUT, or both with FORMAT=COORDINATE"
        )
    if width == 3:
        entries = [_entries(file, table) for file, table in zip(files, tables, strict=True)]
        size = 1 + max(indices.max() for indices, _ in entries)
        nodes = np.arange(1, -(-size // 3) + 1) if numbers is None else np.asarray(numbers)
        if size != 3 * len(nodes):
            raise StructureError(
                f"{files[0]} has {size} rows, not 3 for each of {len(nodes)} nodes"
            )
        labels = np.column_stack([np.repeat(nodes, 3), np.tile([0, 1, 2], len(nodes))])
    else:
        named_pairs = [
            _labels(file, table[:, :4].reshape(-1, 2))
            for file, table in zip(files, tables, strict=True)
        ]
        labels, rows = np.unique(np.concatenate(named_pairs), axis=0, return_inverse=True)
        split = np.split(rows.reshape(-1, 2), [len(tables[0])])
        entries = [(indices, table[:, 4]) for indices, table in zip(split, tables, strict=True)]
    return _in_order(files, entries, labels, numbers)


def _table(file: Path, widths: tuple[int, ...], separator: str | None = None) -> np.ndarray:
    """Numbers of a text file whose lines all have the same number of columns."""
    with named(StructureError, str(file)):
        require_file(file)
        with open(file, encoding="ascii") as lines:
            first = next((line for line in lines if line.strip() and line[:2] != "**"), "")
        if not first:
            raise StructureError(f"{file} is empty")
        separator = "," if "," in first else separator
        table = np.loadtxt(file, delimiter=separator, comments="**", ndmin=2)
    if table.shape[1] not in widths:
        wanted = " or ".join(map(str, widths))
        raise StructureError(f"{file}: rows of {table.shape[1]} numbers, they must have {wanted}")
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise StructureError(f"{file}, entry {row + 1}: a number is not finite")
    return table


def _whole(file: Path, table: np.ndarray) -> np.ndarray:
    """Column of whole numbers from 1 on: nodes, directions or rows."""
    numbers = table.astype(np.int64)
    wrong = np.flatnonzero((numbers != table).any(axis=1))
    if len(wrong):
        raise StructureError(
            f"{file}, entry {wrong[0] + 1}: {table[wrong[0]]} are no numbers of nodes, directions "
            "or rows"
        )
    if numbers.min() < 1:
        raise StructureError(
            f"{file} has node or row {numbers.min()}, the first is 1: internal nodes of elements "
            "(hybrid, incompatible modes) cannot be used"
        )
    return numbers


def _entries(file: Path, table: np.ndarray) -> Entries:
    """Rows, columns and values of a table with three columns."""
    return _whole(file, table[:, :2]) - 1, table[:, 2]


def _labels(file: Path, table: np.ndarray) -> np.ndarray:
    """Nodes and components (from 0) of a table of nodes and degrees of freedom."""
    labels = _whole(file, table)
    wrong = np.flatnonzero(labels[:, 1] > 3)
    if len(wrong):
        node, direction = labels[wrong[0]]
        raise StructureError(
            f"{file}: node {node} has degree of freedom {direction}: only displacements, 1 to 3, "
            "of solid elements can be used"
        )
    return labels - [0, 1]


def _square(file: Path, indices: np.ndarray, values: np.ndarray, size: int) -> sparse.csr_matrix:
    """Symmetric matrix from one triangle or both, in any order."""
    if indices.max() >= size:
        raise StructureError(f"{file} has row {indices.max() + 1}, there are {size}")
    rows, columns = indices.T
    keys, uses = np.unique(rows * size + columns, return_counts=True)
    if uses.max() > 1:
        row, column = divmod(int(keys[np.argmax(uses)]), size)
        raise StructureError(
            f"{file}: the entry of row {row + 1}, column {column + 1} is there twice"
        )
    matrix = sparse.coo_matrix((values, (rows, columns)), shape=(size, size)).tocsr()
    off = rows != columns
    alone = off & ~np.isin(columns * size + rows, keys)
    if alone.sum() == off.sum():
        return (matrix + matrix.T - sparse.diags(matrix.diagonal())).tocsr()
    worst = int(np.argmax(np.abs(values) * alone))
    if alone[worst] and abs(values[worst]) > _ONE_SIDED * np.abs(values).max():
        raise StructureError(
            f"{file} has row {rows[worst] + 1}, column {columns[worst] + 1}, but not its mirror "
            "image, as other entries have: write one triangle or both"
        )
    return matrix


def _looked_up(numbers: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of wanted numbers among others, and the wanted numbers that are missing."""
    order = np.argsort(numbers)
    positions = np.searchsorted(numbers, wanted, sorter=order)
    indices = order[np.minimum(positions, len(order) - 1)]
    return indices, wanted[numbers[indices] != wanted]


def _in_order(
    files: list[Path], entries: list[Entries], labels: np.ndarray, numbers: ArrayLike | None
) -> ForeignMatrices:
    """K and M in this package's order, from rows with labels (node, component)."""
    stiffness, mass = (
        _square(file, indices, values, len(labels))
        for file, (indices, values) in zip(files, entries, strict=True)
    )
    nodes = np.unique(labels[:, 0]) if numbers is None else np.asarray(numbers)
    if nodes.ndim != 1 or nodes.dtype.kind not in "iu" or len(np.unique(nodes)) != len(nodes):
        raise StructureError("numbers: give the number of every node once, as whole numbers")
    rows, unknown = _looked_up(nodes, labels[:, 0])
    if len(unknown):
        raise StructureError(f"{files[0]}: node {unknown[0]} is not in `numbers`")
    diagonal = stiffness.diagonal()
    smallest = diagonal.min(initial=np.inf, where=diagonal > 0)
    free = np.flatnonzero(diagonal <= _PENALTY * smallest)
    dofs = np.full((len(nodes), 3), -1)
    dofs[rows[free], labels[free, 1]] = np.arange(len(free))
    if (dofs >= 0).sum() != len(free):
        raise StructureError(f"{files[0]}: a node's direction has two rows")
    return ForeignMatrices(
        reorder(stiffness[free][:, free], dofs), reorder(mass[free][:, free], dofs), nodes
    )


# Mass of 10-node tetrahedra

#: Gauss points in each direction: on a curved cell the integrand is of degree 4 + 3, and the map
#: from the cube adds 2.
_POINTS = 5


def tetrahedron_mass(nodes: np.ndarray, cells: np.ndarray, density: float) -> sparse.csr_matrix:
    """Consistent mass matrix of curved 10-node tetrahedra, integrated exactly.

    Parameters
    ----------
    nodes
        Positions, shape (n, 3) [m].
    cells
        Indices of the nodes of each cell, shape (c, 10): corners, then the edges 12, 23, 31, 14,
        24, 34, as in Abaqus, CalculiX and VTK.
    density
        Density [kg/m^3].

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (3 n, 3 n) [kg], degree of freedom ``3 * node + component``.

    Raises
    ------
    StructureError
        `cells` are no 10-node tetrahedra of these nodes, or one is turned inside out.
    """
    nodes = np.asarray(nodes, dtype=float)
    cells = np.asarray(cells)
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
    # The sign depends on the numbering; it must not change within a cell.
    signs = np.sign(volumes[:, :1])
    folded = np.flatnonzero((volumes * signs <= 0).any(axis=1))
    if len(folded):
        raise StructureError(f"cell {folded[0]} with nodes {cells[folded[0]]} is folded")
    blocks = density * np.einsum("q,cq,qi,qj->cij", weights, volumes * signs, values, values)
    scalar = summed(blocks, cells[:, :, None], cells[:, None], (len(nodes),) * 2)
    return sparse.kron(scalar, sparse.eye(3), format="csr")
