"""Gmsh models: paths of shipped models, checks of files, and data stored at the end of meshes.

A ``.geo`` model is a program that Gmsh executes, system commands included. This module does not
import Gmsh.
"""

from __future__ import annotations

import json
import re
from base64 import b64decode, b64encode
from collections.abc import Collection, Sequence
from importlib import resources
from pathlib import Path

import attrs
import numpy as np

from fenics_ehd.base.errors import MeshError, SettingsError
from fenics_ehd.base.files import Kind
from fenics_ehd.base.shared_settings import Material
from fenics_ehd.reduction.mesh_error import SMOOTH, point_columns

#: First bytes of a ``.msh`` file; Gmsh executes a file with other first bytes as a program.
MESH_BEGINS = b"$MeshFormat"


#: Begin of the section of a ``.msh`` file with the mesh error of its bores. Gmsh and other programs
#: skip sections that they do not know ("MSH file format" in Gmsh's manual).
MESH_ERROR = b"\n$FlexibilityMeshError\n"

#: End of this section.
MESH_ERROR_ENDS = b"\n$EndFlexibilityMeshError\n"

#: Begin of the section with the material of the part, before the mesh error.
MATERIAL = b"\n$PartMaterial\n"

#: End of this section.
MATERIAL_ENDS = b"\n$EndPartMaterial\n"

#: Largest total size of these sections at the end of a file [bytes].
MOST_STORED = 2**24


#: Comment that identifies meshes of this program ("MSH file format" in Gmsh's manual).
MARK = b"\n$Comments\nfenics_ehd part\n$EndComments\n"


def mark_model(path: Path) -> None:
    """Append the comment that identifies a ``.msh`` file of this program."""
    with open(path, "ab") as file:
        file.write(MARK)


def _is_model(path: Path) -> bool:
    """Whether this program wrote a ``.msh`` file: it has the program's comment or a mesh error.

    Files of version 0.3 have a mesh error but no comment.
    """
    with open(path, "rb") as file:
        if file.read(len(MESH_BEGINS)) != MESH_BEGINS:
            return False
    text = _tail(path)
    return MARK in text or MESH_ERROR in text


#: Kind of files that commands may replace by a model.
MODEL_KIND = Kind("a model that this program wrote", _is_model)


def model_path(name: str) -> Path:
    """Path of a Gmsh model that is shipped with the package, such as ``"conrod"``."""
    return Path(str(resources.files("fenics_ehd.meshes") / f"{name}.geo"))


def is_shipped(path: Path) -> bool:
    """Whether a model is shipped with the package, so that it may run in this process."""
    return path.absolute().parent == model_path("conrod").parent


def check_model(path: Path) -> None:
    """Refuse a file that is neither a ``.geo`` model nor a mesh.

    Raises
    ------
    MeshError
        If the name has another extension, or if a ``.msh`` file is not a mesh.
    """
    if path.suffix not in (".geo", ".msh"):
        raise MeshError(f"model {path}: must be a .geo model or a .msh file")
    if path.suffix == ".msh":
        with open(path, "rb") as file:
            if file.read(len(MESH_BEGINS)) != MESH_BEGINS:
                raise MeshError(f"model {path} is not a mesh: it must begin with $MeshFormat")


def store_material(path: Path, material: Material) -> None:
    """Append the material of a part to its ``.msh`` file."""
    with open(path, "ab") as file:
        file.write(MATERIAL + json.dumps(attrs.asdict(material)).encode() + MATERIAL_ENDS)


def stored_material(path: Path) -> dict[str, float]:
    """Read the values of the material that `store_material` wrote, by name.

    The result is empty if the file has no material.

    Raises
    ------
    MeshError
        If the section is damaged.
    """
    begin = re.escape(MATERIAL)
    end = re.escape(MATERIAL_ENDS)
    section = re.search(begin + rb"(.{1,1000}?)" + end, _tail(path))
    if section is None:
        return {}
    try:
        return attrs.asdict(Material(**json.loads(section[1])))
    except (ValueError, TypeError, RecursionError, SettingsError):
        raise MeshError(
            f"model {path}: its $PartMaterial is damaged: make the model again"
        ) from None


def _tail(path: Path) -> bytes:
    """Read the end of a file, which contains the sections that this program appends."""
    with open(path, "rb") as file:
        file.seek(max(0, file.seek(0, 2) - MOST_STORED))
        return file.read()


def store_mesh_error(
    path: Path, bores: Sequence[str], points: Sequence[str], error: float, moved: np.ndarray
) -> None:
    """Append the mesh error of the bores to a ``.msh`` file.

    Parameters
    ----------
    path
        Path of the file.
    bores, points
        Names of the bores and of the boundary points.
    error
        Estimated relative error of the flexibility of the bores.
    moved
        Mesh error of displacements (`fenics_ehd.reduction.body.ReducedBody.mesh_flexibility`) times
        Young's modulus, shape (p, s + 2 a): columns for s smooth unit pressures [m], then for unit
        forces along x and y on each of the a points [m Pa/N]. This product hardly depends on the
        material.
    """
    section = {"bores": list(bores), "points": list(points), "error": error}
    text = json.dumps(section | {"moved": b64encode(moved.astype("<f4").tobytes()).decode()})
    with open(path, "ab") as file:
        file.write(MESH_ERROR + text.encode() + MESH_ERROR_ENDS)


def stored_mesh_error(
    path: Path, bores: Sequence[str], points: Collection[str]
) -> tuple[float, np.ndarray]:
    """Read `error` and `moved` that `store_mesh_error` wrote, with the columns of some points only.

    Raises
    ------
    MeshError
        If the file has no mesh error, if this error is for other bores, or if a point is missing.
    """
    text = _tail(path).rpartition(MESH_ERROR)[2].removesuffix(MESH_ERROR_ENDS)
    try:
        section = json.loads(text)
        if section["bores"] == list(bores):
            smooth = SMOOTH * len(bores)
            moved = np.frombuffer(b64decode(section["moved"]), "<f4").astype(float)
            moved = moved.reshape(-1, smooth + 2 * len(section["points"]))
            columns = point_columns(section["points"], points, smooth)
            return float(section["error"]), moved[:, columns]
    except (LookupError, ValueError, TypeError, RecursionError):
        pass
    raise MeshError(
        f"model {path} has no mesh error for the bores {', '.join(bores)} and the requested points"
    )
