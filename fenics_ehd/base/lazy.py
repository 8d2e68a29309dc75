"""Public names of a package that import their module when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazily(package: str, modules: Mapping[str, tuple[str, ...]]) -> Callable[[str], Any]:
    """Function ``__getattr__`` of a package.

    Parameters
    ----------
    package
        Its name.
    modules
        Public names by the module that defines them, relative to the package.

    Raises
    ------
    AttributeError
        From that function: the package has no such name.
    """
    homes = {name: f"{package}.{module}" for module, names in modules.items() for name in names}

    def found(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    return found
