"""Where the Gmsh models are that come with the package; Gmsh itself is not imported."""

from __future__ import annotations

from importlib import resources
from pathlib import Path


def model_path(name: str) -> Path:
    """Path of a Gmsh model shipped with the package, ``"conrod"`` for instance."""
    return Path(str(resources.files("fenics_ehd.meshes") / f"{name}.geo"))
