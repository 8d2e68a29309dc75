"""Stiffness and mass matrices of a part from text files of Abaqus, CalculiX and Ansys.

Abaqus writes the matrices with ``*MATRIX GENERATE`` and ``*MATRIX OUTPUT``. With
``FORMAT=MATRIX INPUT``, a line has node, degree of freedom, node, degree of freedom and value,
separated by commas, for one triangle or both (Abaqus 2016, Keywords Reference Guide,
``*MATRIX INPUT``). With ``FORMAT=COORDINATE``, a line has row, column and value, separated by
spaces (jgerstmayr/EXUDYN, exudyn/FEM.py, ``ReadStiffnessMatrixFromAbaqus``). Both formats were
implemented from these sources, without a test on files from Abaqus.

CalculiX writes the matrices with ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` (tested with ccx 2.20).
``JOB.sti`` and ``JOB.mas`` have lines of row, column and value, for the upper triangle with 14
digits. ``JOB.dof`` has the node and the direction of each row as ``node.direction``.

Ansys writes the matrices of ``file.full`` in Matrix Market form, and the numbers of the nodes in
the order of the equations (matrices and nodes tested with files of Ansys in the test data of
jgerstmayr/EXUDYN; the commands are from Ansys' description of *VEC and *EXPORT)::

    *SMAT,MatK,D,IMPORT,FULL,file.full,STIFF
    *EXPORT,MatK,MMF,K.txt
    *SMAT,MatM,D,IMPORT,FULL,file.full,MASS
    *EXPORT,MatM,MMF,M.txt
    *VEC,Nodes,I,IMPORT,FULL,file.full,BACK
    *EXPORT,Nodes,MMF,nodes.txt

``HBMAT`` with a mapping writes lines of equation, node and direction instead (implemented from the
command's description, without a test on a file from Ansys).

CalculiX integrates the mass of 10-node tetrahedra with too few points; `tetrahedron_mass` computes
it exactly.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.base.sealed_file import named, require_file
from fenics_ehd.reduction.elements import SOLIDS, summed
from fenics_ehd.reduction.matrices import read_matrix_market, reorder
from fenics_ehd.reduction.matrix_check import (
    FEWEST_DIGITS,
    MatrixCheck,
    check_matrices,
    decimal_digits,
    is_single,
)

#: Diagonal entry of K over their median above which the degree of freedom counts as held by a
#: penalty: the stiffness of the part is then lost in round-off.
_PENALTY = 1e15

#: Largest entry, relative to the largest of all, that may lack its mirror image in a file of both
#: triangles: it is round-off that the program has dropped on one side.
_ONE_SIDED = 1e-10


#: Row and column numbers from 0 of the entries of a matrix, shape (n, 2), and values, shape (n,).
Entries = tuple[np.ndarray, np.ndarray]


@renamed_attributes(places="indices")
@dataclass(frozen=True, eq=False)
class ForeignMatrices(Described):
    """Stiffness and mass matrices of a part from another program.

    Degrees of freedom are in the order of this package, ``3 * index + component``.

    Attributes
    ----------
    stiffness, mass
        SciPy matrices K and M, shape (3 n, 3 n), in the units of the other program.
    numbers
        Number that every node has in the other program, shape (n,).
    digits
        Digits of K in its file, if K was rotated since; None if they can be counted in its values.
    """

    stiffness: sparse.csr_matrix
    mass: sparse.csr_matrix
    numbers: np.ndarray
    digits: int | None = None

    def indices(self, numbers: ArrayLike) -> np.ndarray:
        """Indices of nodes, for an array of their numbers in the other program.

        Raises
        ------
        StructureError
            If a node has no row in the matrices.
        """
        indices, missing = _looked_up(self.numbers, np.asarray(numbers))
        if len(missing):
            raise StructureError(
                f"node {missing[0]} has no row in the matrices: if this node is held, read the "
                "matrices with numbers = the numbers of all nodes of the part"
            )
        return indices

    def check(self, coordinates: ArrayLike) -> MatrixCheck:
        """Check order of nodes and units against the nodes' positions, see `check_matrices`.

        `coordinates` have shape (n, 3) [m].
        """
        return check_matrices(self.stiffness, self.mass, coordinates, digits=self.digits)

    def turned(self, turn: ArrayLike) -> ForeignMatrices:
        """Matrices of the rotated part: `turn`, shape (3, 3), maps points x to ``turn @ x``.

        The digits of K cannot be counted in the result; its attribute `digits` has them. Single
        precision counts as `FEWEST_DIGITS`.
        """
        rotation = sparse.kron(sparse.identity(len(self.numbers)), np.asarray(turn), format="csr")
        k, m = ((rotation @ matrix @ rotation.T).tocsr() for matrix in (self.stiffness, self.mass))
        digits = self.digits or decimal_digits(self.stiffness.data)
        if self.digits is None and is_single(self.stiffness.data):
            digits = min(digits or FEWEST_DIGITS, FEWEST_DIGITS)
        return ForeignMatrices(k, m, self.numbers, digits)


def read_calculix(job: str | Path, numbers: ArrayLike | None = None) -> ForeignMatrices:
    """Read K and M that CalculiX wrote with ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.

    Parameters
    ----------
    job
        Name of the job with its folder: ``JOB.sti``, ``JOB.mas`` and ``JOB.dof`` are read.
    numbers
        Numbers of all nodes in the wanted order; None for only the nodes that have rows in the
        files, in ascending order. Held degrees of freedom have no rows, see `reorder`.

    Raises
    ------
    StructureError
        If a file cannot be read or does not fit the others.
    """
    require_class("job", job, str, Path)
    dof_file = Path(f"{job}.dof")
    labels = labels_of(dof_file, _table(dof_file, (2,), separator="."))
    files = [Path(f"{job}.sti"), Path(f"{job}.mas")]
    entries = [_entries(file, _table(file, (3,))) for file in files]
    return in_order(files, entries, labels, numbers)


def read_abaqus(
    stiffness: str | Path, mass: str | Path, numbers: ArrayLike | None = None
) -> ForeignMatrices:
    """Read K and M that Abaqus wrote with ``*MATRIX OUTPUT, STIFFNESS, MASS``.

    Parameters
    ----------
    stiffness, mass
        Paths of the files, for instance ``JOB_STIF1.mtx`` and ``JOB_MASS1.mtx``, both with
        ``FORMAT=MATRIX INPUT`` or both with ``FORMAT=COORDINATE``, one triangle or both.
    numbers
        Numbers of all nodes. With ``FORMAT=MATRIX INPUT``, their order is the wanted order; None
        means the nodes that have rows, in ascending order. Files with ``FORMAT=COORDINATE`` have no
        node numbers; here `numbers` are in the order of the rows, and None means 1, 2, ...

    Raises
    ------
    StructureError
        If a file cannot be read, or if nodes are internal or have other degrees of freedom than
        1, 2 and 3.
    """
    require_class("stiffness", stiffness, str, Path)
    require_class("mass", mass, str, Path)
    files = [Path(stiffness), Path(mass)]
    tables = [_table(file, (3, 5)) for file in files]
    width = tables[0].shape[1]
    if tables[1].shape[1] != width:
        raise StructureError(
            f"{files[0]} and {files[1]} have lines of {width} and {tables[1].shape[1]} numbers: "
            "write both with FORMAT=MATRIX INPUT, or both with FORMAT=COORDINATE"
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
            labels_of(file, table[:, :4].reshape(-1, 2))
            for file, table in zip(files, tables, strict=True)
        ]
        labels, rows = np.unique(np.concatenate(named_pairs), axis=0, return_inverse=True)
        split = np.split(rows.reshape(-1, 2), [len(tables[0])])
        entries = [(indices, table[:, 4]) for indices, table in zip(split, tables, strict=True)]
    return in_order(files, entries, labels, numbers)


def read_ansys(
    stiffness: str | Path,
    mass: str | Path,
    mapping: str | Path,
    numbers: ArrayLike | None = None,
) -> ForeignMatrices:
    """Read K and M that Ansys wrote with ``*EXPORT, , MMF``, or in Matrix Market form otherwise.

    Parameters
    ----------
    stiffness, mass
        Paths of the two matrices in Matrix Market form, with any extension.
    mapping
        Path of the nodes in the order of the equations: an array of node numbers in Matrix Market
        form, with three equations for a node, or the ``.mapping`` file of ``HBMAT``.
    numbers
        Numbers of all nodes in the wanted order; None for the nodes that have rows, ascending.

    Raises
    ------
    StructureError
        If a file cannot be read, or if the files do not fit each other: held displacements have no
        equations, so that an array of node numbers is not enough for a part that is held.
    """
    for name, path in (("stiffness", stiffness), ("mass", mass), ("mapping", mapping)):
        require_class(name, path, str, Path)
    labels = _ansys_labels(Path(mapping))
    files = [Path(stiffness), Path(mass)]
    entries = []
    for file in files:
        with named(StructureError, str(file)):
            require_file(file)
            matrix = sparse.coo_matrix(read_matrix_market(file))
        if matrix.shape != (len(labels), len(labels)):
            raise StructureError(
                f"{mapping} names the nodes of {len(labels)} equations, but {file} has the shape "
                f"{matrix.shape}: write the mapping of HBMAT for a part that is held"
            )
        entries.append((np.column_stack([matrix.row, matrix.col]), matrix.data))
    return in_order(files, entries, labels, numbers)


#: Directions of displacements in Ansys.
_DIRECTIONS = {"UX": 1, "UY": 2, "UZ": 3}


def _ansys_labels(file: Path) -> np.ndarray:
    """Node number and component (0 to 2) of every equation, shape (rows, 2).

    Raises
    ------
    StructureError
        If the file cannot be read, or has other directions than displacements.
    """
    with named(StructureError, str(file)):
        require_file(file)
        text = file.read_text(encoding="ascii", errors="replace")
        if text[:14].lower() == "%%matrixmarket":
            nodes = np.asarray(read_matrix_market(file)).ravel()
            return np.column_stack([np.repeat(nodes, 3), np.tile([0, 1, 2], len(nodes))])
        lines = re.findall(r"^\s*(\d+)\s+(\d+)\s+([A-Z]+)\s*$", text, re.M | re.I)
        if not lines:
            raise ValueError(
                "neither an array in Matrix Market form nor lines of equation, node, direction"
            )
        unknown = [name for _, _, name in lines if name.upper() not in _DIRECTIONS]
        if unknown:
            raise ValueError(
                f"direction {unknown[0]}: only displacements, {', '.join(_DIRECTIONS)}, can be used"
            )
    equations = np.array([int(number) for number, _, _ in lines])
    if not np.array_equal(np.sort(equations), np.arange(1, len(lines) + 1)):
        raise StructureError(f"{file} must have each equation from 1 to {len(lines)} once")
    pairs = np.array([(int(node), _DIRECTIONS[name.upper()]) for _, node, name in lines])
    return labels_of(file, pairs[np.argsort(equations)])


def _table(file: Path, widths: tuple[int, ...], separator: str | None = None) -> np.ndarray:
    """Read a text file of numbers, whose lines all have the same number of columns.

    Exponents of Fortran are accepted (``1.5D+03``), if the first line has one.

    Raises
    ------
    StructureError
        If the file cannot be read or is empty, if the number of columns is not one of `widths`,
        or if a number is not finite.
    """
    with named(StructureError, str(file)):
        require_file(file)
        with open(file, encoding="ascii") as lines:
            first = next((line for line in lines if line.strip() and line[:2] != "**"), "")
        if not first:
            raise StructureError(f"{file} is empty")
        separator = "," if "," in first else separator
        with open(file, encoding="ascii") as lines:
            text = (line.replace("D", "e").replace("d", "e") for line in lines)
            source = text if re.search(r"\d\.?[dD][+-]?\d", first) else lines
            table = np.loadtxt(source, delimiter=separator, comments="**", ndmin=2)
    if table.shape[1] not in widths:
        wanted = " or ".join(map(str, widths))
        raise StructureError(f"{file} has lines of {table.shape[1]} numbers, not {wanted}")
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise StructureError(f"{file}, entry {row + 1}: a number is not finite")
    return table


def _whole(file: Path, table: np.ndarray) -> np.ndarray:
    """Convert columns of node, direction or row numbers to integers, which begin at 1.

    Raises
    ------
    StructureError
        If a value is not a whole number above 0.
    """
    numbers = table.astype(np.int64)
    wrong = np.flatnonzero((numbers != table).any(axis=1))
    if len(wrong):
        raise StructureError(
            f"{file}, entry {wrong[0] + 1}: {table[wrong[0]]} must be whole numbers of nodes, "
            "directions or rows"
        )
    if numbers.min() < 1:
        raise StructureError(
            f"{file} has the node or row {numbers.min()}, but numbers begin at 1: internal nodes "
            "of elements (hybrid, incompatible modes) cannot be used"
        )
    return numbers


def _entries(file: Path, table: np.ndarray) -> Entries:
    """Entries of a matrix from a table with the columns row, column and value."""
    return _whole(file, table[:, :2]) - 1, table[:, 2]


def labels_of(file: Path, table: np.ndarray) -> np.ndarray:
    """Node numbers and components (0 to 2) from a table of nodes and degrees of freedom (1 to 3).

    Raises
    ------
    StructureError
        If a degree of freedom is above 3.
    """
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
    """Assemble a symmetric matrix from the entries of one triangle or of both, in any order.

    Raises
    ------
    StructureError
        If a row number is above `size`, if an entry is repeated, or if some entries have a mirror
        image and others do not.
    """
    if indices.max() >= size:
        raise StructureError(f"{file} has row {indices.max() + 1}, but there are {size} rows")
    # Products of row numbers exceed 32 bits from 46 000 rows on.
    rows, columns = indices.T.astype(np.int64)
    keys, uses = np.unique(rows * size + columns, return_counts=True)
    if uses.max() > 1:
        row, column = divmod(int(keys[np.argmax(uses)]), size)
        raise StructureError(
            f"{file} has the entry of row {row + 1}, column {column + 1} more than once"
        )
    matrix = sparse.coo_matrix((values, (rows, columns)), shape=(size, size)).tocsr()
    off = rows != columns
    alone = off & ~np.isin(columns * size + rows, keys)
    if alone.sum() == off.sum():
        return (matrix + matrix.T - sparse.diags(matrix.diagonal())).tocsr()
    worst = int(np.argmax(np.abs(values) * alone))
    if alone[worst] and abs(values[worst]) > _ONE_SIDED * np.abs(values).max():
        raise StructureError(
            f"{file} has an entry of row {rows[worst] + 1}, column {columns[worst] + 1} without "
            "its mirror image, which other entries have: write one triangle or both"
        )
    return matrix


def _looked_up(numbers: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices in `numbers` of the `wanted` numbers, and the wanted numbers that are missing."""
    order = np.argsort(numbers)
    positions = np.searchsorted(numbers, wanted, sorter=order)
    indices = order[np.minimum(positions, len(order) - 1)]
    return indices, wanted[numbers[indices] != wanted]


def in_order(
    files: list[Path], entries: list[Entries], labels: np.ndarray, numbers: ArrayLike | None
) -> ForeignMatrices:
    """Bring K and M into the order of this package.

    Parameters
    ----------
    files
        Paths of the stiffness and mass files, for messages.
    entries
        Entries of the two matrices.
    labels
        Node number and component of every row of the files, shape (rows, 2).
    numbers
        Numbers of all nodes in the wanted order; None for the labelled nodes, ascending.

    Raises
    ------
    StructureError
        If `numbers` are not distinct whole numbers or lack a labelled node, or if the files do
        not make symmetric matrices.
    """
    for file, (_, values) in zip(files, entries, strict=True):
        if np.iscomplexobj(values) or not len(values) or not np.isfinite(values).all():
            raise StructureError(
                f"{file}: the matrix is empty, complex, or has a number that is not finite"
            )
    stiffness, mass = (
        _square(file, indices, values, len(labels))
        for file, (indices, values) in zip(files, entries, strict=True)
    )
    nodes = np.unique(labels[:, 0]) if numbers is None else node_numbers(numbers)
    rows, unknown = _looked_up(nodes, labels[:, 0])
    if len(unknown):
        raise StructureError(f"{files[0]}: node {unknown[0]} is not in `numbers`")
    diagonal = stiffness.diagonal()
    usual = float(np.median(diagonal[diagonal > 0])) if (diagonal > 0).any() else 0.0
    free = np.flatnonzero(diagonal <= _PENALTY * usual)
    dofs = np.full((len(nodes), 3), -1)
    dofs[rows[free], labels[free, 1]] = np.arange(len(free))
    if (dofs >= 0).sum() != len(free):
        raise StructureError(f"{files[0]}: a degree of freedom of a node has two rows")
    return ForeignMatrices(
        reorder(stiffness[free][:, free], dofs), reorder(mass[free][:, free], dofs), nodes
    )


def node_numbers(numbers: ArrayLike) -> np.ndarray:
    """Numbers of nodes as an array.

    Raises
    ------
    StructureError
        If they are not distinct whole numbers.
    """
    nodes = np.asarray(numbers)
    if nodes.ndim != 1 or nodes.dtype.kind not in "iu" or len(np.unique(nodes)) != len(nodes):
        raise StructureError("numbers must be distinct whole numbers, one for every node")
    return nodes


# Mass of 10-node tetrahedra

#: Number of Gauss points in each direction. On a curved cell the integrand has degree 4 + 3, and
#: the map from the cube to the tetrahedron adds 2: the rule is exact up to degree 9.
_POINTS = 5


def tetrahedron_mass(nodes: np.ndarray, cells: np.ndarray, density: float) -> sparse.csr_matrix:
    """Consistent mass matrix of curved 10-node tetrahedra, integrated exactly.

    Parameters
    ----------
    nodes
        Positions of the nodes, shape (n, 3) [m].
    cells
        Indices of the nodes of each cell, shape (c, 10): corners, then midpoints of the edges 12,
        23, 31, 14, 24, 34, as in Abaqus, CalculiX and VTK.
    density
        Mass density of the part [kg/m^3].

    Returns
    -------
    scipy.sparse.csr_matrix
        Mass matrix, shape (3 n, 3 n) [kg], with degrees of freedom ``3 * node + component``.

    Raises
    ------
    StructureError
        If `cells` are not 10-node tetrahedra of these nodes, or if a cell is folded.
    """
    nodes = np.asarray(nodes, dtype=float)
    cells = np.asarray(cells)
    if cells.ndim != 2 or cells.shape[1] != 10 or cells.dtype.kind not in "iu" or not len(cells):
        raise StructureError(
            f"cells have shape {cells.shape} and type {cells.dtype}: whole numbers of shape "
            "(number of cells, 10) are needed"
        )
    if not 0 <= cells.min() <= cells.max() < len(nodes):
        raise StructureError(
            f"cells refer to nodes {cells.min()} to {cells.max()}, but nodes are numbered 0 to "
            f"{len(nodes) - 1}"
        )
    points, weights = SOLIDS["tet"].rule(_POINTS)
    values, slopes = SOLIDS["tet"].tabulate(points)
    jacobians = np.einsum("dqi,cix->cqdx", slopes, nodes[cells])
    volumes = np.linalg.det(jacobians)
    # The sign of a volume depends on the numbering; it must not change within a cell.
    signs = np.sign(volumes[:, :1])
    folded = np.flatnonzero((volumes * signs <= 0).any(axis=1))
    if len(folded):
        raise StructureError(f"cell {folded[0]} with nodes {cells[folded[0]]} is folded")
    blocks = density * np.einsum("q,cq,qi,qj->cij", weights, volumes * signs, values, values)
    scalar = summed(blocks, cells[:, :, None], cells[:, None], (len(nodes),) * 2)
    return sparse.kron(scalar, sparse.eye(3), format="csr")
