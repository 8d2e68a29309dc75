"""Gmsh models: where those are that come with the package, and what may be one.

A model is a program: Gmsh runs what a ``.geo`` file says, commands of the system included. Gmsh
itself is not imported here.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from fenics_ehd.base.errors import MeshError

#: How a mesh begins; any other content Gmsh takes for a program, whatever the file's name.
MESH_BEGINS = b"$MeshFormat"


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
