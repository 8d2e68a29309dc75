"""Gmsh sessions: models and drawings are meshed, and meshes read that no other reader accepts.

A model is a program, and an invalid one leaves text in Gmsh's parser that the next session reads. A
drawing with a missing line ends the process. Files of users are therefore opened in a separate
process, which returns arrays or a mesh in Gmsh's format. Neither MPI nor dolfinx is imported here.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.processes import in_child, interrupt_kept
from fenics_ehd.fem.models import check_model, is_shipped
from fenics_ehd.fem.solid import GMSH_HEX, GMSH_TET

with interrupt_kept():
    import gmsh

T = TypeVar("T")

#: Beginnings of the names of Gmsh's own parameters, which are listed with those of a model.
_GMSH_OWN = ("Gmsh/", "0Gmsh/", "1Gmsh/")

#: Parameter of models that can be meshed with hexahedra or with tetrahedra.
SWITCH = "tetrahedra"

#: Gmsh's numbers of second-order cells and of their facets.
HEXAHEDRON_27 = 12
TETRAHEDRON_10 = 11
QUADRILATERAL_9 = 10
TRIANGLE_6 = 9

#: Names in meshio of Gmsh's cells.
CELL_NAMES = {
    **{4: "tetra", 11: "tetra10", 5: "hexahedron", 17: "hexahedron20", 12: "hexahedron27"},
    **{6: "wedge", 18: "wedge15", 13: "wedge18", 7: "pyramid", 19: "pyramid13", 14: "pyramid14"},
    **{2: "triangle", 9: "triangle6", 3: "quad", 16: "quad8", 10: "quad9"},
    **{15: "vertex", 1: "line", 8: "line3"},
}

#: Orders of the nodes of second-order cells that Gmsh numbers differently.
_ORDERS = {
    TETRAHEDRON_10: GMSH_TET,
    17: np.argsort(GMSH_HEX).tolist(),
    HEXAHEDRON_27: np.argsort(GMSH_HEX).tolist(),
}


@contextmanager
def session() -> Iterator[None]:
    """Context of a silent Gmsh session without the user's options."""
    with interrupt_kept():
        gmsh.initialize([""], readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield
    finally:
        with interrupt_kept():
            gmsh.finalize()


def called(what: str, function: Callable[..., T], path: Path, *arguments: Any) -> T:
    """Call a function of a file; in a separate process unless the package ships the file.

    Raises
    ------
    MeshError
        Gmsh raises an error or crashes.
    """
    try:
        if is_shipped(path):
            return function(path, *arguments)
        lost = MeshError(f"Gmsh crashes when it is to {what} {path}: is the file complete?")
        return in_child(function, path, *arguments, lost=lost)
    except MeshError:
        raise
    except Exception as error:  # Gmsh raises plain Exception
        raise MeshError(f"Gmsh cannot {what} {path}: {error}") from None


@contextmanager
def by_itself(path: Path) -> Iterator[str]:
    """Name of a link to a file in a folder without option files, which Gmsh would read.

    The extension is in lower case: Gmsh runs a file with an unknown extension as a model. Errors of
    Gmsh are given the path of the user's file.
    """
    with TemporaryDirectory() as folder:
        alone = Path(folder, f"model{path.suffix.lower()}")
        if alone.suffix == ".geo":
            if set(str(path.absolute())) & set('"\\\n'):
                raise MeshError(f"model {path}: rename it, without quotes and backslashes")
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
    """Nodes of the current model, shape (n, 3), and the row of each by Gmsh's number."""
    tags, x, _ = gmsh.model.mesh.getNodes()
    row = np.zeros(int(tags.max(initial=0)) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    return x.reshape(-1, 3), row


def nodes_of_cells(number: int, entity: int = -1) -> np.ndarray:
    """Gmsh's numbers of the nodes of all cells of a type, in the node order of `SOLIDS`."""
    return _ordered(number, gmsh.model.mesh.getElementsByType(number, entity)[1])


def _ordered(number: int, nodes: np.ndarray) -> np.ndarray:
    """Nodes of cells of a type, flat in Gmsh's order, one row per cell in the order of `SOLIDS`."""
    cells = nodes.reshape(-1, gmsh.model.mesh.getElementProperties(number)[3])
    return cells[:, _ORDERS[number]] if number in _ORDERS else cells


# Models


def model_parameters(path: Path) -> dict[str, float]:
    """Parameters of a model with their default values, by name; empty for a mesh.

    The function must be called on one rank only.

    Raises
    ------
    MeshError
        Gmsh cannot read the model.
    """
    return {} if path.suffix == ".msh" else called("read", _values, path)


def _values(path: Path) -> dict[str, float]:
    check_model(path)
    with session(), by_itself(path) as model:
        return {name: entry["values"][0] for name, entry in _parameters(model).items()}


def _parameters(model: str) -> dict[str, Any]:
    """Entries of ONELAB (Gmsh's database) of number parameters, by the last part of the name."""
    gmsh.onelab.clear()
    gmsh.open(model)
    names = [name for name in gmsh.onelab.getNames() if not name.startswith(_GMSH_OWN)]
    entries = {name.rsplit("/", 1)[-1]: json.loads(gmsh.onelab.get(name)) for name in names}
    gmsh.clear()
    # Values survive in ONELAB: those of a former model would override the values of this one.
    gmsh.onelab.clear()
    return {name: entry for name, entry in entries.items() if entry["type"] == "number"}


def _set_parameter(model: Path, known: Mapping[str, Any], name: str, value: float) -> None:
    """Set a parameter to a value within the limits that the model declares."""
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
    """Open a session with a meshed model; the numbers of its groups by name.

    Raises
    ------
    MeshError
        Gmsh cannot mesh the model.
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
    """Write the mesh of a model to a file; the numbers of its groups by name."""
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
        # Nodes without a cell are saved as well: otherwise Gmsh would renumber the nodes.
        for option, value in (("Binary", 1), ("SaveAll", 1), ("MshFileVersion", 4.1)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write(str(target))
        return {
            gmsh.model.getPhysicalName(*group): group[1] for group in gmsh.model.getPhysicalGroups()
        }


# Meshes


def read_by_gmsh(path: Path) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """Points and cells of all kinds, by meshio's names.

    Raises
    ------
    MeshError
        Gmsh cannot read the file.
    """
    return called("read", _read, path)


def _read(path: Path) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
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
    """Meshio's name of Gmsh's cells of a type, and their nodes in the order of `SOLIDS`.

    Cells without a fixed number of nodes, such as polyhedra, are counted: the array has no columns.
    """
    if not gmsh.model.mesh.getElementProperties(number)[3]:
        return cell_name(number), np.empty((count, 0), dtype=np.int64)
    return cell_name(number), _ordered(number, nodes)


def cell_name(number: int) -> str:
    """Meshio's name of Gmsh's cells of a type; Gmsh's own in lower case if meshio has none."""
    return CELL_NAMES.get(number) or str(gmsh.model.mesh.getElementProperties(number)[0]).lower()
