"""A limit that all scenes have."""

from __future__ import annotations

from fenics_ehd.errors import SettingsError
from fenics_ehd.lengths import SMALLEST_RATIO, too_narrow

#: Largest clearance over bore radius; the film's equations neglect terms of that order.
THIN_FILM = 0.05


def check_thin_film(clearance: float, radius: float, key: str = "bearing.clearance") -> None:
    """Refuse a clearance that is no small part of the bore's radius [m], or hardly any.

    Raises
    ------
    SettingsError
        Naming both.
    """
    both = f"{key} = {clearance:g} m must be {{}} of the bore radius {radius:g} m"
    if not clearance < THIN_FILM * radius:
        raise SettingsError(f"{both.format(f'below {THIN_FILM:g}')}: the film is taken as thin")
    if too_narrow(clearance, radius):
        raise SettingsError(f"{both.format(f'at least {SMALLEST_RATIO:g}')}: lengths are in metres")
