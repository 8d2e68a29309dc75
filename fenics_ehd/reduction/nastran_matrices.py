"""Matrices of Nastran: OUTPUT4 files (``.op4``), text or binary, and DMIG cards.

An OUTPUT4 file has one or more matrices, each column by column (NX Nastran, DMAP Programmer's
Guide, "OUTPUT4"). A column record begins with the column, the row of its first value and the number
of words; without columns of zeros. Row 0 announces a sparse column: strings of values follow, each
after its first row and its length. In a file with BIGMAT, whose number of rows is negative, the
string header has two integers, length + 1 and row; otherwise one integer,
``row + 65536 (length + 1)``. The record of a column after the last one ends the matrix. Integers
and reals of binary files have 4 or 8 bytes in either byte order, in Fortran's records.

DMIG cards (MSC Nastran, Quick Reference Guide, "DMIG") name the rows and columns of a matrix by
grid point and component; a symmetric matrix has one triangle.

Both readers were tested on files that other programs wrote, and their results are equal for text
and binary forms of the same matrix.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.nastran_cards import cards_of, real_number, whole_number
from fenics_ehd.base.sealed_file import named, require_file
from fenics_ehd.reduction.foreign_matrices import (
    Entries,
    ForeignMatrices,
    in_order,
    labels_of,
    node_numbers,
)

#: Number of columns of an integer in a text file.
_INTEGER = 8

#: Bytes of Fortran's mark before and after a record.
_MARK = 4

#: Integers in the head of a matrix in a binary file; its name takes two words more.
_HEAD = 4

#: Factor of the length in the header of a string of a file without BIGMAT.
_PACKED = 65536

#: Size of a real number in words of 4 bytes, by the type of the matrix.
_WORDS = {1: 1, 2: 2, 3: 1, 4: 2}

#: Most rows for a value, above which the head of a matrix counts as damaged.
_EMPTY_ROWS = 100

#: Types of complex matrices, whose values are pairs of real numbers.
_COMPLEX = (3, 4)

#: Reason for which K and M are refused.
_NOT_REAL = "its numbers are complex, but real numbers are needed"


@dataclass(frozen=True)
class _Head:
    """Head of a matrix in an OUTPUT4 file.

    Attributes
    ----------
    name
        Name of the matrix.
    rows, columns
        Size of the matrix.
    bigmat
        Whether string headers have two integers.
    kind
        Type of the values: 1 and 3 single, 2 and 4 double precision; 3 and 4 complex.
    """

    name: str
    rows: int
    columns: int
    bigmat: bool
    kind: int

    @staticmethod
    def of(name: str, columns: int, rows: int, kind: int) -> _Head:
        """Head from the integers of a file.

        Raises
        ------
        ValueError
            If the size or the type is none of a matrix.
        """
        if kind not in _WORDS or columns < 1 or rows == 0:
            raise ValueError(f"{columns} columns, {rows} rows, type {kind}: no matrix of OUTPUT4")
        return _Head(name, abs(rows), columns, rows < 0, kind)


@dataclass(frozen=True, eq=False)
class _Column:
    """Values of one column, or a part of it.

    Attributes
    ----------
    column, row
        Column, and row of the first value, both from 1.
    values
        Real numbers in successive rows, two for each row of a complex matrix.
    """

    column: int
    row: int
    values: np.ndarray


def read_op4_matrices(path: str | Path) -> dict[str, sparse.csr_matrix]:
    """Read all matrices of an OUTPUT4 file of Nastran, text or binary.

    Parameters
    ----------
    path
        Path of the file.

    Returns
    -------
    dict
        Matrices by name, as stored: of a symmetric matrix, the file has both triangles or one.

    Raises
    ------
    StructureError
        If the file cannot be read.
    """
    require_class("path", path, str, Path)
    file = Path(path)
    matrices: dict[str, sparse.csr_matrix] = {}
    with named(StructureError, str(file)):
        require_file(file)
        with open(file, "rb") as stream:
            start = stream.read(2 * _INTEGER)
        text = re.fullmatch(rb"[ \d\-]+", start) is not None
        for name, matrix in _text_matrices(file) if text else _binary_matrices(file):
            if name in matrices:
                raise ValueError(f"there are two matrices {name}: write each to a file of its own")
            matrices[name] = matrix
    return matrices


def read_op4(
    stiffness: str | Path,
    mass: str | Path | None = None,
    numbers: ArrayLike | None = None,
    *,
    names: tuple[str, str] = ("KGG", "MGG"),
) -> ForeignMatrices:
    """Read K and M from OUTPUT4 files of Nastran.

    An OUTPUT4 file has no numbers of nodes. Its rows are those of a displacement set in the order
    of the node numbers, with six degrees of freedom for a node (the g-set) or three, if the
    rotations are constrained and no displacement is held (an a-set). Rows of rotations must be
    empty: nodes of solid elements have none.

    Parameters
    ----------
    stiffness, mass
        Paths of the files with K and with M; `mass` is None if both are in the first one.
    numbers
        Numbers of all nodes, in ascending order as in the result of ``read_mesh``; None for 1,
        2, ...
    names
        Names of the two matrices. A file with a single matrix needs none.

    Raises
    ------
    StructureError
        If a file cannot be read, if it has no such matrix, or if its rows do not fit the nodes.
    """
    files = _two_files(stiffness, mass, names)
    matrices = [
        _named_matrix(file, name, alone=mass is not None)
        for file, name in zip(files, names, strict=True)
    ]
    size = matrices[0].shape[0]
    if numbers is None:
        if size % 6 or not _rotations_empty(matrices[0]):
            raise StructureError(
                f"{files[0]} has a matrix of shape {matrices[0].shape}, not six rows for a node "
                "with empty ones of its rotations: give the numbers of all nodes"
            )
        nodes = np.arange(1, size // 6 + 1)
    else:
        nodes = node_numbers(numbers)
    each = 6 if size == 6 * len(nodes) else 3
    for file, matrix in zip(files, matrices, strict=True):
        if matrix.shape != (each * len(nodes),) * 2:
            raise StructureError(
                f"{file} has a matrix of shape {matrix.shape}, but {len(nodes)} nodes have 3 or 6 "
                "rows each: write K and M of the g-set, and give the numbers of all its nodes"
            )
    order = np.argsort(nodes, kind="stable")
    labels = np.column_stack([np.repeat(nodes[order], 3), np.tile([0, 1, 2], len(nodes))])
    entries = []
    for file, matrix in zip(files, matrices, strict=True):
        _require_empty(file, matrix, each, nodes[order])
        rows = np.flatnonzero(np.arange(size) % each < 3)
        kept = matrix[rows][:, rows].tocoo()
        entries.append((np.column_stack([kept.row, kept.col]), kept.data))
    return in_order(files, entries, labels, numbers)


def _two_files(
    stiffness: str | Path, mass: str | Path | None, names: tuple[str, str]
) -> list[Path]:
    """Paths of the files with K and M, which may be one file.

    Raises
    ------
    StructureError
        If `names` are not two different names.
    """
    require_class("stiffness", stiffness, str, Path)
    if mass is not None:
        require_class("mass", mass, str, Path)
    if (
        not isinstance(names, tuple | list)
        or len(names) != 2
        or not all(isinstance(name, str) for name in names)
    ):
        raise StructureError(f"names = {names!r} must be the names of K and of M")
    if mass is None and names[0] == names[1]:
        raise StructureError(f"names = {names!r}: K and M have one name, in one file")
    return [Path(stiffness), Path(stiffness if mass is None else mass)]


def _named_matrix(file: Path, name: str, *, alone: bool) -> sparse.csr_matrix:
    """Matrix of a file by its name; with `alone`, the only matrix of a file needs no name.

    Raises
    ------
    StructureError
        If the file has no such matrix.
    """
    matrices = {key.upper(): matrix for key, matrix in read_op4_matrices(file).items()}
    name = next(iter(matrices)) if alone and len(matrices) == 1 else name.upper()
    if name not in matrices:
        raise StructureError(
            f"{file} has no matrix {name}, but {', '.join(matrices)}: give names = those of K and M"
        )
    if np.iscomplexobj(matrices[name].data):
        raise StructureError(f"{file}, matrix {name}: {_NOT_REAL}")
    return matrices[name]


def _rotations_empty(matrix: sparse.csr_matrix) -> bool:
    """Whether the last three of every six rows of a matrix are zero, but not the first three."""
    filled = np.asarray(abs(matrix).sum(axis=1)).reshape(-1, 6) > 0
    return bool(filled[:, :3].any() and not filled[:, 3:].any())


def _require_empty(file: Path, matrix: sparse.csr_matrix, each: int, nodes: np.ndarray) -> None:
    """Refuse a matrix of six rows for a node with values in a row of a rotation.

    Raises
    ------
    StructureError
        If there is such a value.
    """
    entries = matrix.tocoo()
    turning = (entries.row % each > 2) | (entries.col % each > 2)
    wrong = np.flatnonzero(turning & (entries.data != 0.0))
    if len(wrong):
        row = max(entries.row[wrong[0]], entries.col[wrong[0]], key=lambda r: r % each)
        raise StructureError(
            f"{file}: the rotation {row % each + 1} of node {nodes[row // each]} has stiffness or "
            "mass: only displacements, 1 to 3, of solid elements can be used"
        )


def _text_matrices(file: Path) -> Iterator[tuple[str, sparse.csr_matrix]]:
    """Matrices of a text file, with their names."""
    with open(file, encoding="ascii") as text:
        lines = (line.rstrip("\n") for line in text)
        for line in lines:
            if line.strip():
                head, width = _text_head(line)
                yield head.name, _assembled(head, _text_columns(lines, head, width))


def _text_head(line: str) -> tuple[_Head, int]:
    """Head of a matrix in a text file, and the number of characters of a value.

    Raises
    ------
    ValueError
        If the line is no head of a matrix.
    """
    fixed = re.fullmatch(r"([ \d-]{32})(.{8})\s*(?:1P,?)?\s*\d*[ED](\d+)\.\d+.*", line, re.I)
    if not fixed:
        raise ValueError(f"{line[:48]!r} is no head of a matrix of OUTPUT4")
    fields = [fixed[1][i : i + _INTEGER].strip() for i in range(0, 32, _INTEGER)]
    width = int(fixed[3])
    if width < 8 or not all(re.fullmatch(r"-?\d+", field) for field in fields):
        raise ValueError(f"{line[:48]!r} is no head of a matrix of OUTPUT4")
    columns, rows, _, kind = map(int, fields)
    return _Head.of(fixed[2].strip(), columns, rows, kind), width


def _text_columns(lines: Iterator[str], head: _Head, width: int) -> Iterator[_Column]:
    """Columns of a matrix in a text file, to the record after the last column.

    Lines of values have a decimal point, and lines of integers have none.

    Raises
    ------
    ValueError
        If the file ends within the matrix, or if a column has more or fewer values than stated.
    """
    column = row = words = stated = total = repeated = 0
    # Some programs count the words of a text file, some its values: words of a value.
    sizes = {1, _WORDS[head.kind]}
    values: list[float] = []
    for line in lines:
        if "." in line:
            cut = line.rstrip()
            if len(cut) % width:
                raise ValueError(f"{cut[-width:]!r} of {head.name} is not {width} characters wide")
            values += [real_number(cut[i : i + width].strip()) for i in range(0, len(cut), width)]
            continue
        if values or words:
            known = {size for size in sizes if words == size * len(values)}
            # pyNastran states the count of the whole column for each of its strings.
            if not known and stated and words in (stated, stated - 1):
                repeated = words
            elif not known:
                raise ValueError(
                    f"column {column} of {head.name} has {len(values)} values from row {row}, but "
                    f"{words} words are announced"
                )
            sizes = known or sizes
            total += len(values)
            yield _Column(column, row, np.array(values))
            values = []
            words = 0
        fields = line.split()
        if len(line.rstrip()) == 3 * _INTEGER:
            fields = [line[i : i + _INTEGER].strip() for i in range(0, 3 * _INTEGER, _INTEGER)]
        if not all(re.fullmatch(r"-?\d+", field) for field in fields):
            raise ValueError(f"{line[:48]!r} is no record of matrix {head.name}")
        integers = [int(field) for field in fields]
        if len(integers) == 3:
            if repeated and repeated not in (total, 2 * total):
                raise ValueError(
                    f"column {column} of {head.name} has {total} values, but {repeated} words are "
                    "announced"
                )
            column, row, words = integers
            if row:
                stated = 0
            else:
                stated = words
                words = 0  # until the header of a string
            total = repeated = 0
        elif len(integers) == 2 and head.bigmat:
            words = integers[0] - 1
            row = integers[1]
        elif len(integers) == 1 and not head.bigmat:
            words = integers[0] // _PACKED - 1
            row = integers[0] % _PACKED
        else:
            raise ValueError(f"{line[:48]!r} is no record of matrix {head.name}")
        if column > head.columns:
            # A value follows the record after the last column.
            next(lines, "")
            return
    raise ValueError(f"the file ends in column {column} of {head.columns} of {head.name}")


def _binary_matrices(file: Path) -> Iterator[tuple[str, sparse.csr_matrix]]:
    """Matrices of a binary file, with their names.

    Raises
    ------
    ValueError
        If the file does not begin with the head of a matrix.
    """
    content = file.read_bytes()
    length = content[:_MARK]
    for order in "<>":
        size = int(np.frombuffer(length, f"{order}i4")[0]) if len(length) == _MARK else 0
        if size in (24, 48):
            integer = np.dtype(f"{order}i{size // 6}")
            break
    else:
        raise ValueError("neither a text nor a binary file of OUTPUT4")
    records = _records(content, integer)
    for record in records:
        head = _binary_head(record, integer)
        yield head.name, _assembled(head, _binary_columns(records, head, integer))


def _records(content: bytes, integer: np.dtype) -> Iterator[bytes]:
    """Records of a Fortran file.

    Raises
    ------
    ValueError
        If the file ends within a record.
    """
    mark = np.dtype(integer.str[0] + "i4")
    start = 0
    while start < len(content):
        marked = content[start : start + _MARK]
        size = int(np.frombuffer(marked, mark)[0]) if len(marked) == _MARK else -1
        end = start + _MARK + size
        if size < 0 or content[end : end + _MARK] != marked:
            raise ValueError(f"the record at byte {start} is damaged or cut off")
        yield content[start + _MARK : end]
        start = end + _MARK


def _binary_head(record: bytes, integer: np.dtype) -> _Head:
    """Head of a matrix in a binary file.

    Raises
    ------
    ValueError
        If the record is no head of a matrix.
    """
    if len(record) != 6 * integer.itemsize:
        raise ValueError(f"a record of {len(record)} bytes is no head of a matrix of OUTPUT4")
    columns, rows, _, kind = map(int, np.frombuffer(record, integer, _HEAD))
    name = record[_HEAD * integer.itemsize :].decode("ascii", "replace").strip("\0 ")
    return _Head.of(name, columns, rows, kind)


def _binary_columns(records: Iterator[bytes], head: _Head, integer: np.dtype) -> Iterator[_Column]:
    """Columns of a matrix in a binary file, to the record after the last column.

    Raises
    ------
    ValueError
        If the file ends within the matrix, or if a record is longer or shorter than stated.
    """
    column = 0
    word = integer.itemsize
    # Integers of 8 bytes are those of a program whose words have 8 bytes: so do all reals.
    size = 4 * _WORDS[head.kind] if word == 4 else 8
    real = np.dtype(f"{integer.str[0]}f{size}")
    for record in records:
        if len(record) < 3 * word or len(record) % word:
            raise ValueError(f"a record of {len(record)} bytes is no column of {head.name}")
        column, row, _ = map(int, np.frombuffer(record, integer, 3))
        if column > head.columns:
            return
        content = record[3 * word :]
        if row:
            if len(content) % size:
                raise ValueError(f"column {column} of {head.name} ends within a value")
            yield _Column(column, row, np.frombuffer(content, real).astype(float))
            continue
        skipped = 2 * word if head.bigmat else word
        while content:
            if len(content) < skipped:
                raise ValueError(f"column {column} of {head.name} has a string that does not fit")
            if head.bigmat:
                length, row = map(int, np.frombuffer(content, integer, 2))
            else:
                length, row = divmod(int(np.frombuffer(content, integer, 1)[0]), _PACKED)
            end = skipped + (length - 1) * word
            if length < 2 or end > len(content) or (end - skipped) % size:
                raise ValueError(f"column {column} of {head.name} has a string that does not fit")
            yield _Column(column, row, np.frombuffer(content[skipped:end], real).astype(float))
            content = content[end:]
    raise ValueError(f"the file ends in column {column} of {head.columns} of {head.name}")


def _assembled(head: _Head, columns: Iterator[_Column]) -> sparse.csr_matrix:
    """Matrix from its columns.

    Raises
    ------
    ValueError
        If a value is outside the matrix, or not finite.
    """
    parts = list(columns)
    if not parts:
        return sparse.csr_matrix((head.rows, head.columns))
    values = np.concatenate([part.values for part in parts])
    lengths = np.array([len(part.values) for part in parts])
    if head.kind in _COMPLEX:
        if (lengths % 2).any():
            raise ValueError(f"matrix {head.name} is complex, but has a column of half a value")
        values = values[::2] + 1j * values[1::2]
        lengths //= 2
    # Memory for the rows of a damaged head is not taken.
    if max(head.rows, head.columns) > _EMPTY_ROWS * (1 + len(values)):
        raise ValueError(
            f"matrix {head.name} has {head.rows} rows and {head.columns} columns, but only "
            f"{len(values)} values: its head is damaged"
        )
    indices = np.concatenate(
        [np.arange(part.row - 1, part.row - 1 + n) for part, n in zip(parts, lengths, strict=True)]
    )
    columns_of = np.repeat([part.column - 1 for part in parts], lengths)
    if indices.min() < 0 or columns_of.min() < 0 or indices.max() >= head.rows:
        row = indices.min() if indices.min() < 0 else indices.max()
        raise ValueError(
            f"matrix {head.name} has a value in row {row + 1} of column "
            f"{columns_of[np.argmax(indices == row)] + 1}, but {head.rows} rows, from 1"
        )
    if not np.isfinite(values).all():
        raise ValueError(f"matrix {head.name} has a number that is not finite")
    shape = (head.rows, head.columns)
    return sparse.coo_matrix((values, (indices, columns_of)), shape=shape).tocsr()


# DMIG


def read_dmig(
    stiffness: str | Path,
    mass: str | Path | None = None,
    numbers: ArrayLike | None = None,
    *,
    names: tuple[str, str] = ("KAAX", "MAAX"),
) -> ForeignMatrices:
    """Read K and M from DMIG cards of Nastran, for instance a ``.pch`` of ``EXTSEOUT``.

    Parameters
    ----------
    stiffness, mass
        Paths of the files with K and with M; `mass` is None if both are in the first one.
    numbers
        Numbers of all nodes in the wanted order; None for the nodes that have rows, ascending.
    names
        Names of the two matrices on the cards.

    Raises
    ------
    StructureError
        If a file cannot be read, if it has no such matrix, if the matrix is complex or
        rectangular, or if a row is that of a rotation or of a scalar point.
    """
    files = _two_files(stiffness, mass, names)
    tables = [_dmig(file, name) for file, name in zip(files, names, strict=True)]
    pairs = [
        labels_of(file, names.reshape(-1, 2))
        for file, (names, _) in zip(files, tables, strict=True)
    ]
    labels, rows = np.unique(np.concatenate(pairs), axis=0, return_inverse=True)
    split = np.split(rows.reshape(-1, 2), [len(tables[0][1])])
    entries = [(indices, values) for indices, (_, values) in zip(split, tables, strict=True)]
    return in_order(files, entries, labels, numbers)


def _dmig(file: Path, name: str) -> Entries:
    """Entries of a DMIG matrix: node and component of row and column, shape (n, 4), and values.

    Raises
    ------
    StructureError
        If the file cannot be read, or has no such real, square matrix.
    """
    labels: list[tuple[int, int, int, int]] = []
    values: list[float] = []
    others = set()
    header = None
    with named(StructureError, str(file)):
        require_file(file)
        text = file.read_text(encoding="ascii", errors="replace")
        _require_end(text)
        for card, fields in cards_of(text.splitlines()):
            if card.startswith("ENDDATA"):
                break
            if card != "DMIG":
                continue
            if fields[0].upper() != name.upper():
                others.add(fields[0])
            elif fields[1] == "0":
                header = _checked_header(name, fields)
            else:
                column = whole_number(fields[1]), whole_number(fields[2] or "0")
                for row in range(4, len(fields) - 2, 4):
                    node, component, value = fields[row : row + 3]
                    if not (node or component or value):
                        continue
                    if not (node and component and value):
                        raise ValueError(
                            f"matrix {name}, column {fields[1]} {fields[2]}: a term has node "
                            f"{node!r}, component {component!r}, value {value!r}: all are needed"
                        )
                    labels.append((whole_number(node), whole_number(component), *column))
                    values.append(real_number(value))
        if 0 in [component for label in labels for component in label[1::2]]:
            raise ValueError(
                f"matrix {name} has a component 0, that of a scalar point: only displacements, 1 "
                "to 3, of solid elements can be used"
            )
        if header is None and values:
            raise ValueError(
                f"matrix {name} has columns, but no card 'DMIG {name} 0 ...' with its form"
            )
        if header is None or not values:
            known = ", ".join(sorted(others)) or "none"
            raise ValueError(
                f"no DMIG matrix {name}; there are: {known}; give names = those of K and M"
            )
    return np.array(labels), np.array(values)


def _require_end(text: str) -> None:
    """Refuse a file that is cut off within its last line.

    Raises
    ------
    ValueError
        If the last line is not complete.
    """
    last = text.rpartition("\n")[2]
    if last.strip() and last.strip().upper() != "ENDDATA":
        raise ValueError(f"the file ends within a line, {last[:72]!r}: it is cut off")


def _checked_header(name: str, fields: list[str]) -> int:
    """Form of a DMIG matrix from its header.

    Raises
    ------
    ValueError
        If the matrix is rectangular or complex.
    """
    form, kind = (whole_number(field or "0") for field in fields[2:4])
    if form not in (1, 6):
        raise ValueError(
            f"matrix {name} has form {form}, but must have 1 (square) or 6 (symmetric)"
        )
    if kind not in (1, 2):
        raise ValueError(f"matrix {name}: {_NOT_REAL}")
    return form
