"""Public names of a package whose modules are imported when a name is first used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from fenics_ehd.base.renamed import warn_renamed


def lazily(
    package: str, modules: Mapping[str, tuple[str, ...]], former: Mapping[str, str] | None = None
) -> Callable[[str], Any]:
    """Make a function ``__getattr__`` for a package.

    Parameters
    ----------
    package
        Name of the package.
    modules
        Public names by module; the names of modules are relative to the package.
    former
        New name of every former name, which is still accepted with a warning.

    Returns
    -------
    callable
        Function from a name to the object; it raises AttributeError if the package has no such
        name.
    """
    homes = {name: f"{package}.{module}" for module, names in modules.items() for name in names}
    present = dict(former or {})

    def public_name(name: str) -> Any:
        if name in present:
            warn_renamed(f"{package}.{name}", f"{package}.{present[name]}", depth=2)
            name = present[name]
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    return public_name
