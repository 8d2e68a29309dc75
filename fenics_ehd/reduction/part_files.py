"""HDF5 files of parts and of their bases; each rank writes and reads only its own rows.

The file of a basis has displacements and stresses due to unit modal coordinates. The file of a
structure has a complete part, for exchange between programs. Its keys are:

    /                       attributes format = "fenics_ehd structure", format_version = 2;
                            digits, if those of K were stated
    /stiffness, /mass       K [N/m] and M [kg] in CSR form: datasets data, indices and
                            indptr, attribute shape = (3 n, 3 n); both triangles
    /coordinates            positions of the nodes, shape (n, 3) [m]
    /attachments/NAME       a boundary point: the load vectors of unit forces along x, y, z
                            as columns of a CSR matrix of shape (3 n, 3); or datasets nodes
                            and weights, shape (k,)
    /bores                  attribute names: names of the bores; the first has its centre at
                            the origin
    /bores/NAME             attributes radius, width [m]; family, pressure_family if known
    /bores/NAME/centre      centre of the bore, shape (3,) [m]
    /bores/NAME/nodes       node numbers from 0, shape (m,)
    /bores/NAME/coordinates, /bores/NAME/pressure_coordinates
                            positions relative to the bore's centre, shapes (m, 3), (p, 3) [m]
    /bores/NAME/load        load matrix J [m2] in CSR form as above, shape (3 n, p)
    /bores/NAME/cells, /bores/NAME/pressure_cells, /bores/NAME/reference
                            optional, as in `Bore`

Files that `save_structure` writes are sealed (`fenics_ehd.base.sealed_file`) and are refused after
a change. Files from other programs need no seal.

Degrees of freedom are ``3 * node + component``. If several ranks wrote the file, the nodes of each
rank follow those of the rank before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from mpi4py import MPI
from scipy import sparse

from fenics_ehd.base.errors import BodyFileError, SettingsError, StructureError
from fenics_ehd.base.files import BOOKKEEPING, new_part, require_room
from fenics_ehd.base.layout import Group, Value, attribute
from fenics_ehd.base.sealed_file import (
    HEAD,
    named,
    open_hdf5,
    open_sealed,
    seal,
    stored_as,
    values,
)
from fenics_ehd.reduction.bore import Bore, surface_layout
from fenics_ehd.reduction.matrices import (
    before,
    csr_layout,
    even_range,
    together,
)
from fenics_ehd.reduction.structure import PointWeights, Structure

#: Name of the file format of structures.
FORMAT = "fenics_ehd structure"
FORMAT_VERSION = 2

#: Layout of a `Bore` in a file, without its load matrix.
BORE_VALUES = Group(
    {
        **surface_layout("real", attribute=True),
        "nodes": Value("integer", ("nodes",), least=0),
        "reference": Value("real", ("nodes", 3, 6), required=False),
    },
    foreign=True,
)

#: Layout of a bore in a file.
BORE_LAYOUT = Group(
    {**BORE_VALUES.entries, "load": csr_layout("3 part_nodes", "load_entries")}, foreign=True
)

_MATRIX = csr_layout("3 part_nodes", "point_entries").entries

#: Layout of a boundary point in a file: a matrix, or nodes and weights.
ATTACHMENT_LAYOUT = Group(
    {
        "nodes": Value("integer", ("nodes",), required=False),
        "weights": Value("real", ("nodes",), required=False),
        **{name: replace(value, required=False) for name, value in _MATRIX.items()},
    },
    foreign=True,
)

#: Layout of the stated digits of K, an attribute of the file.
_DIGITS = Value("integer", least=1)

#: Layout of a complete part in a file.
LAYOUT = Group(
    {
        "coordinates": Value("real", ("part_nodes", 3)),
        "stiffness": csr_layout("3 part_nodes", "stiffness_entries"),
        "mass": csr_layout("3 part_nodes", "mass_entries"),
        "bores": Group(each=BORE_LAYOUT, required=False),
        "attachments": Group(each=ATTACHMENT_LAYOUT, required=False),
    },
    foreign=True,
)


class Rows(NamedTuple):
    """Rows of a dataset that a rank computes block by block while it writes them.

    Attributes
    ----------
    shape
        Shape of the array of all rows that this rank writes.
    blocks
        Consecutive blocks of these rows.
    """

    shape: tuple[int, ...]
    blocks: Iterable[np.ndarray]


def save_by_ranks(
    path: Path,
    comm: MPI.Comm,
    begin: Callable[[h5py.File], None],
    tables: Mapping[str, np.ndarray | Rows],
) -> None:
    """Write a sealed file whose rows are distributed; collective, one rank after the other.

    Parameters
    ----------
    path
        Path of the file, the same on every rank. An existing file is replaced by a complete one.
    comm
        Communicator of the ranks that write to the file.
    begin
        Function that the first rank calls with the new file, to write attributes and groups.
    tables
        Rows of this rank for every dataset by name: an array, or blocks of float64.

    Raises
    ------
    StructureError
        If a rank cannot write. The error is raised on every rank; an existing file is kept.
    """
    rows = {n: a if isinstance(a, Rows) else Rows(a.shape, [a]) for n, a in tables.items()}
    counts = comm.allgather({name: owned.shape[0] for name, owned in rows.items()})
    label = f"file {path} cannot be written"

    def on_first(act: Callable[[], Any]) -> Any:
        """Call a function on the first rank; raise its error on all ranks."""
        return together(comm, label, lambda: None if comm.rank else act())

    def write_first() -> None:
        """Make the file with empty datasets."""
        shapes = {
            name: (sum(count[name] for count in counts), *owned.shape[1:])
            for name, owned in rows.items()
        }
        require_room(partial, BOOKKEEPING + sum(8 * int(np.prod(s)) for s in shapes.values()))
        with h5py.File(partial, "w", userblock_size=HEAD) as file:
            begin(file)
            for name, shape in shapes.items():
                file.create_dataset(name, shape, getattr(tables[name], "dtype", float))

    def write_owned() -> None:
        """Write the rows of this rank."""
        with h5py.File(partial, "r+") as file:
            for name, owned in rows.items():
                first = sum(count[name] for count in counts[: comm.rank])
                for block in owned.blocks:
                    file[name][first : first + len(block)] = block
                    first += len(block)

    partial = comm.bcast(on_first(lambda: new_part(path)))
    try:
        on_first(write_first)
        for turn in range(comm.size):
            together(comm, label, write_owned if turn == comm.rank else lambda: None)
        on_first(lambda: seal(partial, path))
    except BaseException:
        if not comm.rank:
            with suppress(OSError):
                partial.unlink()
        raise


def save_structure(structure: Structure, path: str | Path) -> None:
    """Write a part to a file atomically: an existing file is replaced by a complete one.

    Collective: ranks write one after the other. Elements (`Structure.recovery`) are not stored.

    Raises
    ------
    StructureError
        If the file cannot be written, or if the name of a bore or boundary point has a slash.
    """
    for name in (*structure.attachments, *structure.bores):
        if not name or "/" in name or name == ".":
            raise StructureError(
                f"name {name!r}: in a file, names of bores and points must not be empty or have a "
                "slash"
            )
    comm = structure.comm
    matrices = {"stiffness": structure.stiffness, "mass": structure.mass}
    matrices |= {f"bores/{name}/load": bore.load for name, bore in structure.bores.items()}
    shapes = {name: matrix.size for name, matrix in matrices.items()}
    blocks = {name: matrix.getValuesCSR() for name, matrix in matrices.items()}
    for name, three in structure.attachments.items():
        columns = sparse.csr_matrix(np.column_stack([v.array for v in three]))
        shapes[f"attachments/{name}"] = structure.size, 3
        blocks[f"attachments/{name}"] = columns.indptr, columns.indices, columns.data

    def begin(file: h5py.File) -> None:
        file.attrs.update(format=FORMAT, format_version=FORMAT_VERSION)
        if structure.digits is not None:
            file.attrs["digits"] = structure.digits
        # Points keep their order, on which the order of the columns of a basis depends.
        file.create_group("attachments", track_order=True)
        file.create_group("bores").attrs["names"] = list(structure.bores)
        for name, shape in shapes.items():
            file.create_group(name).attrs["shape"] = shape
        for name, bore in structure.bores.items():
            group = file["bores"][name]
            for key, value in BORE_VALUES.tree(bore).items():
                (group if isinstance(value, np.ndarray) else group.attrs)[key] = value

    tables = {"coordinates": structure.coordinates}
    for name, (indptr, indices, data) in blocks.items():
        # Each rank writes where its rows end; the first rank also where the first row begins.
        ends = indptr[min(comm.rank, 1) :].astype(np.int64) + before(len(data), comm)
        tables |= {f"{name}/data": data, f"{name}/indices": indices, f"{name}/indptr": ends}
    save_by_ranks(Path(path), comm, begin, tables)


def load_structure(path: str | Path, comm: MPI.Comm = MPI.COMM_WORLD) -> Structure:
    """Read a part that `save_structure` or another program wrote, on any number of ranks.

    Parameters
    ----------
    path
        Path of the file; `fenics_ehd.reduction.part_files` lists its keys.
    comm
        Communicator of the ranks, which share the nodes evenly.

    Raises
    ------
    StructureError
        If the file cannot be read or does not contain a part in this format.
    """
    contents: dict[str, Any] = together(comm, f"structure file {path}", lambda: _read(path, comm))
    return Structure(f"{path}:/stiffness", f"{path}:/mass", **contents, comm=comm)


def _read(path: str | Path, comm: MPI.Comm) -> dict[str, Any]:
    """Read the arguments of `Structure` from a file; matrices are represented by their paths.

    The coordinates are those of the nodes of this rank.

    Raises
    ------
    ValueError
        If the file does not have the layout.
    """
    with _opened(path, comm) as file:
        LAYOUT.check(file, "", {})
        nodes = len(file["coordinates"])
        groups = file.get("bores", {})
        each = Value("text", ("bores",))
        names = attribute(groups, "names", each) if "bores" in file else ()
        if sorted(names) != sorted(groups):
            raise ValueError(
                f"names of /bores are {', '.join(names)}, but its groups are {', '.join(groups)}"
            )
        return {
            "digits": attribute(file, "digits", _DIGITS) if "digits" in file.attrs else None,
            "coordinates": values(file["coordinates"], slice(*even_range(nodes, comm))),
            "attachments": {
                name: _attachment(f"{path}:/attachments/{name}", group)
                for name, group in file.get("attachments", {}).items()
            },
            "bores": {name: _bore(path, name, groups[name]) for name in names},
        }


def _attachment(matrix: str, group: h5py.Group) -> PointWeights | str:
    """Nodes and weights of a boundary point from its HDF5 group.

    If the group has none, the result is `matrix`, the path of the point's matrix in the file.
    """
    if "nodes" not in group:
        return matrix
    if "weights" not in group:
        raise ValueError(f"{group.name}/weights is missing")
    return PointWeights(values(group["nodes"]), values(group["weights"]))


def _opened(path: str | Path, comm: MPI.Comm) -> h5py.File:
    """Open the file of a structure; only the first rank checks its seal."""
    if comm.rank:
        return open_hdf5(path)
    return open_sealed(path, FORMAT, FORMAT_VERSION, remedy="write it again", foreign=True)


def _bore(path: str | Path, name: str, group: h5py.Group) -> Bore:
    """Read a bore, with the path of its load matrix in place of the matrix."""
    values = BORE_VALUES.arguments(BORE_VALUES.read(group, group.name))
    return Bore(**values, load=f"{path}:/bores/{name}/load")


#: Name of the file format of bases.
BASIS_FORMAT = "fenics_ehd part basis"
BASIS_VERSION = 2

#: Kind of files that commands recognise as bases, and may replace by a new basis.
BASIS_KIND = stored_as("a basis of a part", BASIS_FORMAT)

#: Layout of the file of a basis, with n modal coordinates and p sampling points of stresses.
BASIS_LAYOUT = Group(
    {
        "nodes": Value("float", ("nodes", 3)),
        "basis": Value("float", ("nodes", 3, "n")),
        "cells": Value("integer", ("cells", "vertices"), least=0),
        "stress_points": Value("float", ("p", 3), required=False),
        "stress": Value("float", ("p", 6, "n"), required=False),
    }
)

#: Accepted numbers of nodes of a stored cell; 0 if elements are unknown.
_VERTICES = (0, 10, 20)

#: Stress components in the order of files.
VOIGT = ("xx", "yy", "zz", "yz", "xz", "xy")

#: Size of the rows read or written at once [bytes]; stresses need five times as much memory.
_BLOCK_BYTES = 1 << 22

_ROOT3 = np.sqrt(3.0)


def deviatoric(stress: np.ndarray) -> np.ndarray:
    """Map stresses linearly to vectors whose Euclidean norm is the von Mises stress.

    Parameters
    ----------
    stress
        Stress components in the order of `VOIGT`, shape (..., 6) [Pa].

    Returns
    -------
    numpy.ndarray
        Vectors of five deviatoric coordinates, shape (..., 5) [Pa].
    """
    xx, yy, zz = (stress[..., i] for i in range(3))
    plane = [xx - 0.5 * (yy + zz), 0.5 * _ROOT3 * (yy - zz)]
    return np.stack([*plane, *(_ROOT3 * stress[..., i] for i in range(3, 6))], axis=-1)


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Von Mises stress, shape (...) [Pa], of stresses in the order of `VOIGT`, (..., 6) [Pa]."""
    return np.linalg.norm(deviatoric(np.asarray(stress)), axis=-1)


def save_basis(
    path: str | Path, structure: Structure, columns: np.ndarray, *, stress: bool = True
) -> None:
    """Write the basis of a part atomically: an existing file is replaced by a complete one.

    Collective: ranks write one after the other.

    Parameters
    ----------
    path
        Path of the file, the same on every rank.
    structure
        Part with its nodes and, if known, cells.
    columns
        Displacements of unit modal coordinates, rows of this rank, shape (owned dofs, n) [m].
    stress
        Whether to write the stresses of unit modal coordinates, too, if the elements are known.
        Stresses are larger than displacements.

    Raises
    ------
    SettingsError
        If the shape of the columns does not fit the structure.
    BodyFileError
        If the file cannot be written; the error is raised on every rank.
    """
    comm = structure.comm
    nodes = len(structure.coordinates)
    modes = columns.shape[-1]
    shapes = comm.allgather((columns.shape, 3 * nodes))
    for shape, owned in shapes:
        if len(shape) != 2 or shape != (owned, shapes[0][0][-1]):
            raise SettingsError(
                f"columns have shape {shape} on a rank: one row for each of its {owned} dofs is "
                "needed, and the same number of columns on every rank"
            )
    recovery = structure.recovery
    tables: dict[str, np.ndarray | Rows] = {
        "nodes": structure.coordinates,
        "basis": columns.reshape(nodes, 3, modes),
        "cells": recovery.cells if recovery else np.zeros((0, 0), dtype=np.int64),
    }
    if stress and recovery and recovery.stress:
        tables |= _stresses(recovery.stress(columns))

    def begin(file: h5py.File) -> None:
        file.attrs.update(format=BASIS_FORMAT, format_version=BASIS_VERSION)
        file.attrs["stress_components"] = " ".join(VOIGT)

    try:
        save_by_ranks(Path(path), comm, begin, tables)
    except StructureError as error:
        raise BodyFileError(f"basis {error}") from error


def _stresses(field: Any) -> dict[str, Rows]:
    """Datasets of sampling points and stresses of a `StressField`, computed by blocks of cells."""
    cells, points, components, modes = field.shape
    step = max(1, _BLOCK_BYTES // max(1, 8 * points * components * modes))
    parts = [slice(start, min(start + step, cells)) for start in range(0, cells, step)]
    return {
        "stress_points": Rows(
            (cells * points, 3), (field.positions(part).reshape(-1, 3) for part in parts)
        ),
        "stress": Rows(
            (cells * points, components, modes),
            (field.block(part, slice(modes)).reshape(-1, components, modes) for part in parts),
        ),
    }


class BasisFile(AbstractContextManager["BasisFile"]):
    """Open file of a basis, from which displacements and stresses of a part are computed.

    The basis is read from the file a few MB at a time. The object is a context manager.

    Parameters
    ----------
    path
        Path of a file that `save_basis` wrote.

    Raises
    ------
    BodyFileError
        If the file is missing, is not HDF5, is cut short, or does not contain a basis in this
        format.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        with named(BodyFileError, f"basis file {self.path}"):
            self._file = open_sealed(
                self.path, BASIS_FORMAT, BASIS_VERSION, remedy="reduce the part again"
            )
            try:
                self._require_layout()
            except BaseException:
                self._file.close()
                raise

    def _require_layout(self) -> None:
        """Check the shapes of all datasets and the node numbers of cells.

        Raises
        ------
        ValueError
            If a shape or a node number is inconsistent; the message names the dataset.
        """
        BASIS_LAYOUT.check(self._file, "", {})
        if ("stress" in self._file) != ("stress_points" in self._file):
            raise ValueError("/stress or /stress_points is missing")
        cells = self._file["cells"]
        nodes = len(self._file["nodes"])
        # Of cells with 27 nodes, only 20 are stored.
        if cells.shape[1] not in _VERTICES or values(cells).max(initial=-1) >= nodes:
            raise ValueError(
                f"/cells has shape {cells.shape}: cells with 10 or 20 of the {nodes} nodes are "
                "needed"
            )

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def modes(self) -> int:
        """Number of modal coordinates n."""
        return int(self._file["basis"].shape[2])

    @property
    def nodes(self) -> np.ndarray:
        """Positions of the nodes, shape (nodes, 3) [m]."""
        return self._array("nodes")

    @property
    def basis(self) -> np.ndarray:
        """Displacements of all nodes due to unit modal coordinates, shape (nodes, 3, n) [m]."""
        return self._array("basis")

    @property
    def cells(self) -> np.ndarray:
        """Node numbers of every cell in VTK's order, shape (cells, 20 or 10); empty if unknown."""
        return self._array("cells")

    @property
    def stress_points(self) -> np.ndarray:
        """Positions of the sampling points of stresses, cell by cell, shape (points, 3) [m]."""
        return self._array("stress_points")

    def displacement(self, coordinates: np.ndarray) -> np.ndarray:
        """Compute the displacements of all nodes from modal coordinates.

        Parameters
        ----------
        coordinates
            Modal coordinates, shape (n,), or shape (t, n) for t instants. The file is read only
            once for all instants.

        Returns
        -------
        numpy.ndarray
            Displacements, shape (nodes, 3) or (t, nodes, 3) [m].

        Raises
        ------
        SettingsError
            If the number of coordinates is not that of the modes.
        """
        return self._combine("basis", coordinates)

    def stress(self, coordinates: np.ndarray) -> np.ndarray:
        """Compute stresses from modal coordinates, shape (points, 6) or (t, points, 6) [Pa].

        Components are in the order of `VOIGT`; for parameters see `displacement`.

        Raises
        ------
        SettingsError
            If the number of coordinates is not that of the modes.
        BodyFileError
            If the file has no stresses.
        """
        return self._combine("stress", coordinates)

    def _array(self, name: str) -> np.ndarray:
        """Read a complete dataset and check its values."""
        table = self._table(name)
        with named(BodyFileError, f"basis file {self.path}"):
            array = np.asarray(values(table))
            BASIS_LAYOUT.value_at(name).require_content(array, f"/{name}")
        return array

    def _table(self, name: str) -> h5py.Dataset:
        """Return a dataset of the file.

        Raises
        ------
        BodyFileError
            If the file has no stresses.
        """
        if self._file and name not in self._file:
            raise BodyFileError(
                f"basis file {self.path} has no stresses: save the basis again with stress=True"
            )
        return self._file[name]

    def _combine(self, name: str, coordinates: np.ndarray) -> np.ndarray:
        """Multiply a dataset by modal coordinates; it is read in blocks of rows."""
        table = self._table(name)
        size, components, modes = table.shape
        q = np.asarray(coordinates, dtype=float)
        if q.ndim not in (1, 2) or q.shape[-1] != modes:
            raise SettingsError(
                f"coordinates have shape {q.shape}, but the basis has {modes} modes: give "
                f"({modes},) or (number of instants, {modes})"
            )
        history = np.atleast_2d(q)
        result = np.empty((len(history), size, components))
        step = max(1, _BLOCK_BYTES // (8 * components * max(*history.shape, 1)))
        for start in range(0, size, step):
            rows = slice(start, start + step)
            result[:, rows] = np.tensordot(history, table[rows], (1, 2))
        if np.isfinite(q).all() and not np.isfinite(result).all():
            raise BodyFileError(f"basis file {self.path}: /{name} has a value that is not finite")
        return result if q.ndim == 2 else result[0]
