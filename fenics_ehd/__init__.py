"""Mechanisms with elastohydrodynamically lubricated revolute joints.

Importing the package imports nothing heavy: `fenics_ehd.reduction` works
without dolfinx, and ``fenics-ehd --help`` answers without either.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fenics_ehd.results.load import load_results

__version__ = "0.2.0"
__all__ = ["__version__", "load_results"]


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is."""
    if name == "load_results":
        from fenics_ehd.results.load import load_results

        return load_results
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
