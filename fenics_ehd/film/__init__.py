"""The oil film of a bore: Reynolds equation with cavitation."""

from importlib import import_module
from typing import Any

#: Module that defines a name: settings of a film are read without its equations.
HOMES = {
    "Film": "film",
    "FilmGrid": "grid",
    "FilmParameters": "parameters",
    "FilmState": "film",
    "Gap": "kinematics",
    "Lubricant": "lubricant",
    "ShaftMotion": "kinematics",
    "shaft_gap": "kinematics",
    "uniform_grid": "grid",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is."""
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{HOMES[name]}"), name)
