"""Versions of dolfinx with which the program was tried, and what it needs of any other version."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from types import ModuleType

from fenics_ehd.base.errors import LibraryError

#: Versions with which all tests pass.
TRIED = ("0.5", "0.9", "0.11")

#: Names in dolfinx that `fenics_ehd.base.compat` uses under every version. Alternatives are
#: separated by a bar, newest first.
NEEDED = (
    "cpp.common.IndexMap",
    "cpp.fem.DofMap",
    "cpp.fem.create_form_float64|cpp.fem.Form_float64",
    "cpp.fem.create_sparsity_pattern",
    "cpp.graph.AdjacencyList_int32",
    "cpp.la.MatrixCSR_float64",
    "fem.Constant",
    "fem.Expression",
    "fem.Function",
    "fem.functionspace|fem.FunctionSpace",
    "jit.ffcx_jit",
    "mesh.create_mesh",
)


class UntriedVersionWarning(UserWarning):
    """The installed version of dolfinx was not tried with this program."""


def require_version(dolfinx: ModuleType, needed: Iterable[str] = NEEDED) -> None:
    """Warn of a version of dolfinx that was not tried; refuse it if it lacks a needed name.

    Raises
    ------
    LibraryError
        The version was not tried, and lacks a name; the message has the version and the name.
    """
    version = str(dolfinx.__version__)
    if ".".join(version.split(".")[:2]) in TRIED:
        return
    tried = ", ".join(TRIED)
    missing = [names for names in needed if not _has_one(dolfinx, names)]
    if missing:
        first = missing[0].replace("|", " or ")
        raise LibraryError(
            f"dolfinx {version} lacks {first}, which fenics_ehd needs: install a version that was "
            f"tried, {tried}"
        )
    warnings.warn(
        f"dolfinx {version} was not tried with fenics_ehd, tried are {tried}: run fenics-ehd check "
        "before you trust results",
        UntriedVersionWarning,
        stacklevel=2,
    )


def _has_one(module: ModuleType, names: str) -> bool:
    """Whether a module has one of several dotted names, which are separated by a bar."""
    return any(_has(module, name) for name in names.split("|"))


def _has(owner: object, name: str) -> bool:
    first, _, rest = name.partition(".")
    if not hasattr(owner, first):
        return False
    return _has(getattr(owner, first), rest) if rest else True
