"""Gmsh models: where those are that come with the package, and what may be one.

A model is a program: Gmsh runs what a ``.geo`` file says, commands of the system included. Gmsh
itself is not imported here.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.reduction.mesh_error import SMOOTH

#: How a mesh begins; any other content Gmsh takes for a program, whatever the file's name.
MESH_BEGINS = b"$MeshFormat"


#: Section of a mesh with what it misses, and its end. Gmsh and others skip those that they do not
#: know ("MSH file format" of Gmsh's manual).
MESH_ERROR, MESH_ERROR_ENDS = b"\n$FlexibilityMeshError\n", b"\n$EndFlexibilityMeshError\n"

#: Of a file's end, that such a section may take [bytes].
MOST_STORED = 2**20


def model_path(name: str) -> Path:
    """Path of a Gmsh model shipped with the package, ``"conrod"`` for instance."""
    return Path(str(resources.files("fenics_ehd.meshes") / f"{name}.geo"))


def is_shipped(path: Path) -> bool:
    """Whether a model is one of the package, which needs no suspicion."""
    return path.absolute().parent == model_path("conrod").parent


def is_program(path: Path) -> bool:
    """Whether a model is run as a script that is not of this package."""
    return path.suffix == ".geo" and not is_shipped(path)


def check_model(path: Path) -> None:
    """Refuse what is neither a ``.geo`` model nor a mesh.

    Raises
    ------
    MeshError
        The name ends otherwise, or a ``.msh`` file is no mesh.
    """
    if path.suffix not in (".geo", ".msh"):
        raise MeshError(f"model {path}: must be a .geo model or a .msh file")
    if path.suffix == ".msh":
        with open(path, "rb") as file:
            if file.read(len(MESH_BEGINS)) != MESH_BEGINS:
                raise MeshError(f"model {path} is no mesh: it must begin with $MeshFormat")


def store_mesh_error(path: Path, bores: Sequence[str], missing: np.ndarray) -> None:
    """Leave in a ``.msh`` file what its bores miss.

    Parameters
    ----------
    path
        It ends there.
    bores
        Their names.
    missing
        Compliance (`fenics_ehd.reduction.mesh_error`) times Young's modulus, which it then hardly
        depends on, shape (s, s) [m^3].
    """
    rounded = [[float(f"{value:.4g}") for value in row] for row in missing]
    text = json.dumps({"bores": list(bores), "missing": rounded})
    with open(path, "ab") as file:
        file.write(MESH_ERROR + text.encode() + MESH_ERROR_ENDS)


def stored_mesh_error(path: Path, bores: Sequence[str]) -> np.ndarray:
    """What `store_mesh_error` left in a file.

    Raises
    ------
    MeshError
        It is not there, or of other bores.
    """
    with open(path, "rb") as file:
        file.seek(max(0, file.seek(0, 2) - MOST_STORED))
        text = file.read().rpartition(MESH_ERROR)[2].removesuffix(MESH_ERROR_ENDS)
    try:
        found = json.loads(text)
        missing = np.array(found["missing"], dtype=float)
        if found["bores"] == list(bores) and missing.shape == (SMOOTH * len(bores),) * 2:
            return missing
    except (LookupError, ValueError, TypeError, RecursionError):
        pass
    raise MeshError(f"model {path} does not say what its mesh misses")
