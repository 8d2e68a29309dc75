"""Compiled libraries: paths, versions, and a test that they work together.

SciPy, h5py and dolfinx of Debian are compiled for Debian's NumPy. If pip or PYTHONPATH puts another
NumPy first, they fail at any point with obscure messages. The test of this module detects that.
"""

from __future__ import annotations

import io
import os
import sys
from contextlib import redirect_stderr, suppress
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

#: Libraries in the order of their dependencies.
ARRAYS = ("numpy", "scipy", "scipy.linalg", "h5py")

#: Modules of this package that import a library without options of the current folder.
STARTS = {
    "dolfinx": "fenics_ehd.base.compat",
    "gmsh": "fenics_ehd.base.gmsh_start",
    "matplotlib": "fenics_ehd.base.matplotlib_start",
    "petsc4py": "fenics_ehd.base.petsc_start",
    "slepc4py": "fenics_ehd.base.petsc_start",
}


def origin(name: str) -> str:
    """Path of the file from which Python imports a library; empty if there is none."""
    with suppress(ImportError, ValueError):
        spec = find_spec(name)
        return "" if spec is None else str(spec.origin)
    return ""


def version_of(name: str) -> str:
    """Version of a library; "missing" if it is not installed, "broken" if it cannot be imported.

    Some libraries of Debian have no metadata for pip; they are imported to get their versions.
    """
    source = origin(name)
    if not source:
        return "missing"
    with suppress(metadata.PackageNotFoundError):
        distribution = metadata.distribution(name)
        # The first metadata on the path may belong to another copy of the library.
        if Path(source).is_relative_to(str(distribution.locate_file(""))):
            return distribution.version
    try:
        import_module(STARTS.get(name, name))
        return str(getattr(import_module(name), "__version__", "unknown"))
    except Exception:  # a broken library may raise any exception
        return "broken"


def library_fault() -> str:
    """Message about the first library that does not work, with its path; empty if all are sound."""
    for name in ARRAYS:
        try:
            with redirect_stderr(io.StringIO()):  # NumPy 2 prints a page there
                _tried(import_module(name))
        except Exception as error:  # a broken library may raise any exception
            return _described(name, error)
    return ""


def _tried(module: ModuleType) -> None:
    """If a library is NumPy, call a function that other libraries use at import.

    The call fails if NumPy's installation is incomplete.
    """
    if module.__name__ == "numpy":
        module.zeros(1, dtype=module.dtype(float))


def _described(name: str, error: Exception) -> str:
    """Message about a library that does not work."""
    version = version_of("numpy").replace("broken", "")
    used = f"numpy {version} of {origin('numpy')}".replace("  ", " ")
    library = used if name == "numpy" else f"{name} of {origin(name)} with {used}"
    reason = " ".join(str(error).split())[:200]
    path = os.environ.get("PYTHONPATH")
    remedy = f"see PYTHONPATH = {path}" if path else "see 'pip list' for a second one"
    return (
        f"{library} does not work in {sys.executable}: {type(error).__name__}: {reason}: Debian's "
        f"packages need Debian's numpy, {remedy}"
    )


def foreign_numpy() -> bool:
    """Whether NumPy and SciPy are in different folders, a combination that may fail."""
    folders = {Path(source).parents[1] for source in map(origin, ("numpy", "scipy")) if source}
    return len(folders) > 1
