"""A whole part in one HDF5 file, to travel between programs.

Written and read by row ranges: no rank ever holds a whole matrix. Keys:

    /                       attributes format = "fenics_ehd structure", format_version = 2
    /stiffness, /mass       K [N/m] and M [kg] in CSR form: datasets data, indices and
                            indptr, attribute shape = (3 n, 3 n); both triangles
    /coordinates            positions of the nodes, shape (n, 3) [m]
    /attachments/NAME       a boundary point: the load vectors of unit forces along x, y, z
                            as columns of a CSR matrix of shape (3 n, 3); or datasets nodes
                            and weights, shape (k,)
    /bores                  attribute names: of the bores, the first with its centre in the origin
    /bores/NAME             attributes radius, width [m], and family, pressure_family where known
    /bores/NAME/centre      shape (3,) [m]
    /bores/NAME/nodes       node numbers from 0, shape (m,)
    /bores/NAME/coordinates, /bores/NAME/pressure_coordinates
                            from the bore's centre, shapes (m, 3) and (p, 3) [m]
    /bores/NAME/load        J [m2], CSR as above, shape (3 n, p)
    /bores/NAME/cells, /bores/NAME/pressure_cells, /bores/NAME/reference
                            optional, as in `Bore`

What `save_structure` writes is sealed (`fenics_ehd.base.sealed_file`), and refused once it changed;
other programs' files need no seal.

Degrees of freedom are ``3 * node + component``, nodes in the order of the rows, which is
that of the ranks when several wrote the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.sealed_file import open_hdf5, open_sealed, values
from fenics_ehd.reduction.bore import Bore
from fenics_ehd.reduction.boundary_points import PointWeights
from fenics_ehd.reduction.row_blocks import append, before, even_range, sealed_by_ranks, together
from fenics_ehd.reduction.structure import Structure

FORMAT = "fenics_ehd structure"
FORMAT_VERSION = 2

_BORE_ARRAYS = ("nodes", "coordinates", "pressure_coordinates", "centre")
_OPTIONAL_ARRAYS = ("cells", "pressure_cells", "reference")
_BORE_SIZES = ("radius", "width")
_OPTIONAL_NAMES = ("family", "pressure_family")


def save_structure(structure: Structure, path: str | Path) -> None:
    """Write a part; an existing file is replaced only once the new one is whole.

    Collective, rank after rank. Elements for drawing (`Structure.recovery`) are left out.

    Raises
    ------
    StructureError
        The file cannot be written, or a boundary point's name holds a slash.
    """
    comm = structure.comm
    path = Path(path)
    for name in (*structure.attachments, *structure.bores):
        if not name or "/" in name or name == ".":
            raise StructureError(f"name {name!r}: a file needs one without a slash")

    def begin(file: h5py.File) -> None:
        file.attrs.update(format=FORMAT, format_version=FORMAT_VERSION)
        # Their order is that of the columns of a basis.
        file.create_group("attachments", track_order=True)
        bores = file.create_group("bores")
        bores.attrs["names"] = list(structure.bores)
        for name, bore in structure.bores.items():
            _write_bore(bores.create_group(name), bore)

    held = [value for bore in structure.bores.values() for value in vars(bore).values()]
    size = sum(getattr(array, "nbytes", 0) for array in held)
    with sealed_by_ranks(path, comm, begin, size) as partial:
        append(partial, comm, {"coordinates": structure.coordinates})
        matrices = {"stiffness": structure.stiffness, "mass": structure.mass}
        matrices |= {f"bores/{name}/load": bore.load for name, bore in structure.bores.items()}
        for name, matrix in matrices.items():
            _append_matrix(partial, comm, name, matrix.getValuesCSR(), matrix.size)
        for name, three in structure.attachments.items():
            columns = np.column_stack([v.array for v in three])
            row, column = np.nonzero(columns)
            pointers = np.searchsorted(row, np.arange(len(columns) + 1))
            csr = (pointers, column, columns[row, column])
            _append_matrix(partial, comm, f"attachments/{name}", csr, (structure.size, 3))


def _write_bore(group: h5py.Group, bore: Bore) -> None:
    for name in (*_BORE_SIZES, *_OPTIONAL_NAMES):
        group.attrs[name] = getattr(bore, name)
    for name in (*_BORE_ARRAYS, *_OPTIONAL_ARRAYS):
        if getattr(bore, name) is not None:
            group[name] = getattr(bore, name)


def _append_matrix(
    path: Path,
    comm: MPI.Comm,
    name: str,
    csr: tuple[np.ndarray, np.ndarray, np.ndarray],
    shape: tuple[int, int],
) -> None:
    """Owned rows of a matrix, each rank's after those of the ranks before it."""
    indptr, indices, data = csr
    # The end of every row; the first rank also writes where the first one begins.
    pointers = indptr[min(comm.rank, 1) :].astype(np.int64) + before(len(data), comm)
    arrays = {"data": data, "indices": indices, "indptr": pointers}
    append(path, comm, {f"{name}/{key}": array for key, array in arrays.items()})

    def write() -> None:
        if comm.rank == 0:
            with h5py.File(path, "r+") as file:
                file[name].attrs["shape"] = shape

    together(comm, f"file {path}", write)


def load_structure(path: str | Path, comm: MPI.Comm = MPI.COMM_WORLD) -> Structure:
    """Read a part written by `save_structure` or by another program; on any number of ranks.

    Parameters
    ----------
    path
        The file, keys as above.
    comm
        Ranks that share the nodes evenly.

    Raises
    ------
    StructureError
        The file cannot be read, or does not hold a part of this format.
    """
    contents: dict[str, Any] = together(comm, f"structure file {path}", lambda: _read(path, comm))
    return Structure(
        stiffness=f"{path}:/stiffness",
        mass=f"{path}:/mass",
        coordinates=contents["coordinates"],
        bores={
            name: Bore(**bore, load=f"{path}:/bores/{name}/load")
            for name, bore in contents["bores"].items()
        },
        attachments=contents["attachments"],
        comm=comm,
    )


def _read(path: str | Path, comm: MPI.Comm) -> dict[str, Any]:
    """Everything but the large matrices; of the coordinates this rank's."""
    with _opened(path, comm) as file:
        nodes = len(file["coordinates"])
        names = file["bores"].attrs["names"] if "bores" in file else ()
        attachments = {
            name: PointWeights(values(group["nodes"]), values(group["weights"]))
            if "nodes" in group
            else f"{path}:/attachments/{name}"
            for name, group in file.get("attachments", {}).items()
        }
        return {
            "coordinates": values(file["coordinates"], slice(*even_range(nodes, comm))),
            "attachments": attachments,
            "bores": {str(name): _read_bore(file["bores"][name]) for name in names},
        }


def _opened(path: str | Path, comm: MPI.Comm) -> h5py.File:
    """The file; one rank reads all of it, for the digest."""
    if comm.rank:
        return open_hdf5(path)
    return open_sealed(path, FORMAT, FORMAT_VERSION, remedy="write it again", foreign=True)


def _read_bore(group: h5py.Group) -> dict[str, Any]:
    bore: dict[str, Any] = {name: values(group[name]) for name in _BORE_ARRAYS}
    bore |= {name: values(group[name]) for name in _OPTIONAL_ARRAYS if name in group}
    bore |= {name: float(group.attrs[name]) for name in _BORE_SIZES}
    bore |= {name: str(group.attrs[name]) for name in _OPTIONAL_NAMES if name in group.attrs}
    return bore
