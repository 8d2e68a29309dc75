"""Lengths in settings, with limits that catch a slip.

A length written in millimetres or micrometres is a thousand times too large or more: the limits
are generous, and still below that.
"""

from __future__ import annotations

from typing import Any

from fenics_ehd.settings import number

#: Largest bearing radius, bearing width or crank radius [m].
LARGEST_LENGTH = 5.0

#: Largest radial clearance [m].
LARGEST_CLEARANCE = 5e-3

#: Smallest clearance over bore radius; bearings have 100 times that, so that a smaller one is a
#: radius in millimetres or a clearance that nobody can make.
SMALLEST_RATIO = 1e-5

#: Rounding of a ratio that is meant to be the limit itself.
_ROUNDING = 1e-9


def metres(default: float, help_text: str, *, below: float = LARGEST_LENGTH) -> Any:
    """Length of a machine [m]."""
    return number(default, help_text, above=0, below=below, example="0.025 for 25 mm")


def radial_clearance(default: float) -> Any:
    """Radial clearance of a bearing [m]."""
    return number(
        default, "radial clearance [m]", above=0, below=LARGEST_CLEARANCE, example="30e-6 for 30 um"
    )


def too_narrow(clearance: float, radius: float) -> bool:
    """Whether a clearance is too small a part of the bore's radius to be in the same unit."""
    return clearance < SMALLEST_RATIO * (1 - _ROUNDING) * radius
