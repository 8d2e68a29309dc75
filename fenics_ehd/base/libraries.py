"""Compiled libraries: paths, versions, and a test that they work together.

SciPy, h5py and dolfinx of Debian are compiled for Debian's NumPy. If pip or PYTHONPATH puts another
NumPy first, they fail at any point with obscure messages. The test of this module detects that.

PyPI's dolfinx, petsc4py and slepc4py need an MPI library that is already loaded: without it, their
import fails. This module makes their import load MPI first.

Imports inside functions: the package looks for a conflict whenever it is imported, and must be
imported quickly. The metadata of distributions are needed only after a conflict.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, suppress
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
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
    from importlib import metadata

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


#: Folder of Debian's packages for Python, and folder of all of Debian's libraries: petsc4py and
#: dolfinx of several versions are elsewhere in it.
DEBIAN = Path("/usr/lib/python3/dist-packages")
DEBIAN_LIBRARIES = Path("/usr/lib")

#: Libraries that Debian compiles for its NumPy.
COMPILED = ("dolfinx", "petsc4py", "h5py", "scipy")


def numpy_conflict() -> str:
    """Message about a NumPy for which Debian's compiled libraries were not built; or empty.

    A library that is compiled for one version of NumPy works with later versions, except for those
    with another first number. The versions are compared without importing NumPy. There is no
    conflict if NumPy is Debian's, or if none of the compiled libraries is. No library is looked for
    if Debian's folder is not on the path.
    """
    if str(DEBIAN) not in sys.path:
        return ""
    source = origin("numpy")
    if not source or Path(source).is_relative_to(DEBIAN):
        return ""
    compiled = [name for name in COMPILED if Path(origin(name)).is_relative_to(DEBIAN_LIBRARIES)]
    folder = Path(source).parents[1]
    present, built = (_numpy_in(each) for each in (folder, DEBIAN))
    if not (compiled and present and built):
        return ""
    numbers, needed = (list(map(int, text.split(".")[:2])) for text in (present, built))
    if numbers[0] == needed[0] and numbers >= needed:
        return ""
    return (
        f"numpy {present} in {folder} hides Debian's numpy {built}, for which "
        f"{', '.join(compiled)} of Debian are compiled: {_without(folder)}"
    )


def require_matching_numpy() -> None:
    """Refuse a NumPy that would make Debian's libraries crash; commands report it themselves.

    Raises
    ------
    ImportError
        There is such a NumPy, see `numpy_conflict`.
    """
    command = os.path.basename("".join(sys.argv[:1]))
    if command not in ("-m", "fenics-ehd") and (conflict := numpy_conflict()):
        raise ImportError(conflict)


#: Modules of PyPI's dolfinx wheel that need MPI at their import, and the module that only this
#: wheel has.
WITH_MPI = ("dolfinx", "petsc4py.lib", "slepc4py.lib")
WHEEL = "dolfinx_solver"


class LoadedFirst:
    """Finder of modules whose import first imports another module.

    Looking for a module imports nothing; only the execution of its code does.

    Attributes
    ----------
    names
        Full names of the modules.
    first
        Full name of the module that is imported before the code of each of them is executed.
    """

    def __init__(self, names: Sequence[str], first: str) -> None:
        self.names = names
        self.first = first

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Specification of a module among `names`; None for all others, see `sys.meta_path`."""
        spec = PathFinder.find_spec(name, path, target) if name in self.names else None
        if spec is None or spec.loader is None:
            return None
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            import_module(self.first)
            execute(module)

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def load_mpi_first() -> None:
    """Make later imports of PyPI's dolfinx, petsc4py and slepc4py load MPI first."""
    if origin(WHEEL):
        sys.meta_path.insert(0, LoadedFirst(WITH_MPI, "mpi4py.MPI"))


def _numpy_in(folder: Path) -> str:
    """Version of NumPy in a folder of packages, from its metadata; empty if there are none."""
    from importlib import metadata

    distributions = metadata.distributions(name="numpy", path=[str(folder)])
    return next((each.version for each in distributions), "")


def _without(folder: Path) -> str:
    """Remedy for a NumPy in a folder that hides another one."""
    path = os.environ.get("PYTHONPATH", "")
    if str(folder) in path.split(os.pathsep):
        return f"remove the folder from PYTHONPATH = {path}"
    if folder.is_relative_to(Path(sys.prefix)):
        return f"remove it by {sys.executable} -m pip uninstall numpy"
    return (
        "remove it by /usr/bin/python3 -m pip uninstall --break-system-packages numpy, or set "
        "PYTHONNOUSERSITE=1 if the folder is in your home"
    )


def library_fault() -> str:
    """Message about the first library that does not work, with its path; empty if all are sound."""
    if conflict := numpy_conflict():
        return conflict
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
    debian = Path(origin(name)).is_relative_to(DEBIAN_LIBRARIES)
    need = "Debian's packages need Debian's numpy" if debian else "it needs another numpy"
    return (
        f"{library} does not work in {sys.executable}: {type(error).__name__}: {reason}: {need}, "
        f"{remedy}"
    )


def foreign_numpy() -> bool:
    """Whether NumPy and SciPy are in different folders, a combination that may fail."""
    folders = {Path(source).parents[1] for source in map(origin, ("numpy", "scipy")) if source}
    return len(folders) > 1
