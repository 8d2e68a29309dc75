"""Gmsh sessions, which mesh models and drawings, and read meshes that no other reader accepts.

Gmsh executes a model as a program. After an invalid model, text remains in Gmsh's parser that the
next session would read. A drawing in which a line is missing ends the process. Files of users are
therefore opened in a separate process, which returns arrays or a mesh in Gmsh's format. This module
imports neither MPI nor dolfinx.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import fenics_ehd.base.gmsh_start  # noqa: F401  # isort: skip
import gmsh
import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.processes import in_child, interrupt_kept
from fenics_ehd.fem.models import check_model, is_shipped
from fenics_ehd.fem.solid import GMSH_HEX, GMSH_TET

T = TypeVar("T")

#: Beginnings of the names of Gmsh's own parameters, which it lists with those of a model.
_GMSH_OWN = ("Gmsh/", "0Gmsh/", "1Gmsh/")

#: Name of the parameter of a model that selects tetrahedra (1) or hexahedra (0).
SWITCH = "tetrahedra"

#: Gmsh's type numbers of second-order cells and of their facets.
HEXAHEDRON_27 = 12
TETRAHEDRON_10 = 11
QUADRILATERAL_9 = 10
TRIANGLE_6 = 9

#: Names in meshio of cells, by Gmsh's type number.
CELL_NAMES = {
    **{4: "tetra", 11: "tetra10", 5: "hexahedron", 17: "hexahedron20", 12: "hexahedron27"},
    **{6: "wedge", 18: "wedge15", 13: "wedge18", 7: "pyramid", 19: "pyramid13", 14: "pyramid14"},
    **{2: "triangle", 9: "triangle6", 3: "quad", 16: "quad8", 10: "quad9"},
    **{15: "vertex", 1: "line", 8: "line3"},
}

#: Gmsh's order of the nodes of a cell, as indices that sort them as in `SOLIDS`, by type number.
_ORDERS = {
    TETRAHEDRON_10: GMSH_TET,
    17: np.argsort(GMSH_HEX).tolist(),
    HEXAHEDRON_27: np.argsort(GMSH_HEX).tolist(),
}


@contextmanager
def session() -> Iterator[None]:
    """Open a Gmsh session without output and without the user's options."""
    with interrupt_kept():
        gmsh.initialize([""], readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield
    finally:
        with interrupt_kept():
            gmsh.finalize()


def called(what: str, function: Callable[..., T], path: Path, *arguments: Any) -> T:
    """Call a function that opens a file in Gmsh, and return its result.

    The function is called in a separate process unless the package ships the file.

    Parameters
    ----------
    what
        Verb that describes the function in messages.
    function
        Function of the path and of `arguments`.
    path
        Path of the file.
    arguments
        Further arguments of the function.

    Raises
    ------
    MeshError
        If Gmsh raises an error or crashes.
    """
    try:
        if is_shipped(path):
            return function(path, *arguments)
        lost = MeshError(f"Gmsh crashed on the attempt to {what} {path}: is the file complete?")
        return in_child(function, path, *arguments, lost=lost)
    except MeshError:
        raise
    except Exception as error:  # Gmsh raises plain Exception
        raise MeshError(f"Gmsh cannot {what} {path}: {error}") from None


@contextmanager
def by_itself(path: Path) -> Iterator[str]:
    """Yield the path of a link to a file, in a folder without option files that Gmsh would read.

    The link has the extension of the file in lower case: Gmsh executes files with unknown
    extensions as models. In Gmsh's messages, the path of the link is replaced by that of the file.
    """
    with TemporaryDirectory() as folder:
        alone = Path(folder, f"model{path.suffix.lower()}")
        if alone.suffix == ".geo":
            if set(str(path.absolute())) & set('"\\\n'):
                raise MeshError(
                    f"model {path}: Gmsh cannot include a path with double quotes, backslashes or "
                    "line breaks: rename the file or folder"
                )
            alone.write_text(f'Include "{path.absolute()}";\n')
        else:
            alone.symlink_to(path.absolute())
        try:
            yield str(alone)
        except MeshError:
            raise
        except Exception as error:  # Gmsh raises plain Exception
            raise RuntimeError(str(error).replace(str(alone), str(path))) from None


def numbered_nodes() -> tuple[np.ndarray, np.ndarray]:
    """Positions of the nodes of the current model, shape (n, 3), and the row of each node.

    Entry i of the second array is the row, in the first array, of the node with Gmsh's number i.
    """
    tags, x, _ = gmsh.model.mesh.getNodes()
    row = np.zeros(int(tags.max(initial=0)) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    return x.reshape(-1, 3), row


def nodes_of_cells(number: int, entity: int = -1) -> np.ndarray:
    """Gmsh's node numbers of all cells of a type, in the node order of `SOLIDS`, shape (c, k)."""
    return _ordered(number, gmsh.model.mesh.getElementsByType(number, entity)[1])


def _ordered(number: int, nodes: np.ndarray) -> np.ndarray:
    """Sort the nodes of cells, a flat array in Gmsh's order, into rows in the order of `SOLIDS`."""
    cells = nodes.reshape(-1, gmsh.model.mesh.getElementProperties(number)[3])
    return cells[:, _ORDERS[number]] if number in _ORDERS else cells


# Models


def model_parameters(path: Path) -> dict[str, float]:
    """Default values of the parameters of a model, by name; empty for a mesh.

    The function must be called on one rank only.

    Raises
    ------
    MeshError
        If Gmsh cannot read the model.
    """
    return {} if path.suffix == ".msh" else called("read", _values, path)


def _values(path: Path) -> dict[str, float]:
    """Default values of the parameters of a model, by name."""
    check_model(path)
    with session(), by_itself(path) as model:
        return {name: entry["values"][0] for name, entry in _parameters(model).items()}


def _parameters(model: str) -> dict[str, Any]:
    """Entries of a model's numeric parameters in ONELAB, Gmsh's database.

    The key of an entry is the last part of the parameter's name.
    """
    gmsh.onelab.clear()
    gmsh.open(model)
    names = [name for name in gmsh.onelab.getNames() if not name.startswith(_GMSH_OWN)]
    entries = {name.rsplit("/", 1)[-1]: json.loads(gmsh.onelab.get(name)) for name in names}
    gmsh.clear()
    # ONELAB keeps values: those of a former model would override the values of this one.
    gmsh.onelab.clear()
    return {name: entry for name, entry in entries.items() if entry["type"] == "number"}


def _set_parameter(model: Path, known: Mapping[str, Any], name: str, value: float) -> None:
    """Set a parameter of a model, after a check against the limits that the model declares.

    Raises
    ------
    MeshError
        If the model has no such parameter, or if the value is outside its limits.
    """
    if name not in known:
        close = difflib.get_close_matches(name, known, n=2, cutoff=0.55)
        meant = f"did you mean {' or '.join(close)}? " if close else ""
        has = f"it has {', '.join(known)}" if known else "it has none"
        raise MeshError(f"model {model.name} has no parameter {name!r}: {meant}{has}")
    entry = known[name]
    if not entry["min"] <= value <= entry["max"]:
        limits = f"from {entry['min']:g} to {entry['max']:g}"
        raise MeshError(f"geometry.{name} = {value:g} must be {limits} in {model.name}")
    if value not in entry.get("choices", [value]):
        choices = " or ".join(f"{choice:g}" for choice in entry["choices"])
        raise MeshError(f"geometry.{name} = {value:g} must be {choices} in {model.name}")
    gmsh.onelab.setNumber(entry["name"], [float(value)])


@contextmanager
def opened_model(
    path: Path, parameters: Mapping[str, float], cells: str, size: float = 1.0
) -> Iterator[dict[str, int]]:
    """Open a session with a meshed model, and yield the numbers of its groups by name.

    Raises
    ------
    MeshError
        If Gmsh cannot mesh the model.
    """
    with TemporaryDirectory() as folder:
        mesh = Path(folder, "mesh.msh")
        groups = called("mesh", _write_mesh, path, dict(parameters), cells, size, mesh)
        with session():
            gmsh.open(str(mesh))
            yield groups


def _write_mesh(
    path: Path, parameters: Mapping[str, float], cells: str, size: float, target: Path
) -> dict[str, int]:
    """Mesh a model and write the mesh to a file; return the numbers of its groups by name."""
    check_model(path)
    with session():
        with by_itself(path) as model:
            known = {} if path.suffix == ".msh" else _parameters(model)
            for name, value in parameters.items():
                _set_parameter(path, known, name, value)
            if SWITCH in known and SWITCH not in parameters:
                _set_parameter(path, known, SWITCH, cells == "tet")
            gmsh.open(model)
        if not gmsh.model.mesh.getNodes()[0].size:
            size *= gmsh.option.getNumber("Mesh.MeshSizeFactor")
            gmsh.option.setNumber("Mesh.MeshSizeFactor", size)
            gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        # Nodes without a cell are saved, too, as Gmsh would otherwise renumber the nodes.
        for option, value in (("Binary", 1), ("SaveAll", 1), ("MshFileVersion", 4.1)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write(str(target))
        return {
            gmsh.model.getPhysicalName(*group): group[1] for group in gmsh.model.getPhysicalGroups()
        }


# Meshes


def read_by_gmsh(path: Path) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """Read the points of a mesh and its blocks of cells of all kinds, with meshio's names.

    Raises
    ------
    MeshError
        If Gmsh cannot read the file.
    """
    return called("read", _read, path)


def _read(path: Path) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """Read a mesh in this process, see `read_by_gmsh`."""
    with session(), by_itself(path) as alone:
        gmsh.merge(alone)
        points, row = numbered_nodes()
        blocks = []
        # Entities are read one by one: getElementsByType of Gmsh 4.8 writes beyond its arrays if an
        # entity has cells of several types.
        for entity in gmsh.model.getEntities():
            types, numbers, nodes = gmsh.model.mesh.getElements(*entity)
            for number, tags, own_nodes in zip(types, numbers, nodes, strict=True):
                blocks.append(_block(number, len(tags), row[own_nodes]))
        return points, blocks


def _block(number: int, count: int, nodes: np.ndarray) -> tuple[str, np.ndarray]:
    """Meshio's name of the cells of a type, and their nodes in the order of `SOLIDS`, shape (c, k).

    Cells without a fixed number of nodes, such as polyhedra, have an array of shape (c, 0).
    """
    if not gmsh.model.mesh.getElementProperties(number)[3]:
        return cell_name(number), np.empty((count, 0), dtype=np.int64)
    return cell_name(number), _ordered(number, nodes)


def cell_name(number: int) -> str:
    """Meshio's name of cells of a type, or Gmsh's name in lower case if meshio has none."""
    return CELL_NAMES.get(number) or str(gmsh.model.mesh.getElementProperties(number)[0]).lower()
