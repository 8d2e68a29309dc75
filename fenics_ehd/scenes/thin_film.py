"""A limit that all scenes have."""

from __future__ import annotations

from fenics_ehd.errors import SettingsError

#: Largest clearance over bore radius; the film's equations neglect terms of that order.
THIN_FILM = 0.05


def check_thin_film(clearance: float, radius: float) -> None:
    """Refuse a clearance that is no small part of the bore's radius [m].

    Raises
    ------
    SettingsError
        Naming both.
    """
    if not clearance < THIN_FILM * radius:
        raise SettingsError(
            f"bearing.clearance = {clearance:g} m must be below {THIN_FILM:g} of the bore radius "
            f"{radius:g} m: the film is taken as thin"
        )
