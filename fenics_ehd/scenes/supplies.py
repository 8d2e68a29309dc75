"""Supplies of a scene's films."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.feed import Feed
from fenics_ehd.film.feed_region import FeedGroove, FeedHole, FeedRegion, check_region
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.reduction.bore import BoreSurface
from fenics_ehd.reduction.bore_holes import BoreHole, bore_holes
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.loads import table_file
from fenics_ehd.scenes.scene import Scene
from fenics_ehd.scenes.supply_settings import (
    AxialGrooveSettings,
    CircumferentialGrooveSettings,
    HoleSettings,
    SupplySettings,
)


def holes_of(bore: BoreSurface | None) -> list[BoreHole]:
    """Holes in the mesh of a bore; a rigid one, or a mesh that is not known, has none."""
    if bore is None or not bore.cells.size:
        return []
    return bore_holes(bore.coordinates, bore.cells, bore.family)


def feeds(scene: Scene, name: str, holes: Sequence[BoreHole] = ()) -> tuple[Feed, ...]:
    """Supplies of a lubricated joint.

    Parameters
    ----------
    scene, name
        Which joint.
    holes
        In the mesh of its bore.

    Raises
    ------
    SettingsError
        A pressure that is given twice, a table that cannot be used, or a hole that the mesh should
        have and has not.
    """
    found = []
    for own, settings in scene.joints[name].supply.items():
        key = f"joints.{name}.supply.{own}"
        found.append(
            Feed(
                own,
                region(settings, key, holes),
                _pressure(settings, key, periodic=scene.time.periodic),
                settings.resistance,
                settings.on == "journal",
            )
        )
    return tuple(found)


def recesses(fed: Sequence[Feed], holes: Sequence[BoreHole]) -> tuple[FeedHole, ...]:
    """Holes in the mesh of a bore that no supply is at: they are closed."""
    at = [feed.region for feed in fed if not feed.on_journal]
    places = [(r.angle, r.height) for r in at if isinstance(r, FeedHole)]
    return tuple(
        FeedHole(hole.angle, hole.height, hole.diameter)
        for hole in holes
        if not any(hole.contains(np.array([a]), np.array([z]))[0] for a, z in places)
    )


def check_supply(scene: Scene, name: str, grid: FilmGrid, holes: Sequence[BoreHole]) -> None:
    """Refuse supplies, and holes in the mesh, that the film of a joint or its mesh cannot hold.

    Raises
    ------
    SettingsError
        Naming key, value and limit.
    """
    fed = feeds(scene, name, holes)
    for feed in fed:
        check_region(f"joints.{name}.supply.{feed.name}", feed.region, grid)
    for hole in recesses(fed, holes):
        told = f"at {np.degrees(hole.angle):.4g} degrees, z = {1e3 * hole.height:.4g} mm"
        check_region(f"joints.{name}: the hole in the mesh of the bore {told},", hole, grid)


def region(settings: SupplySettings, key: str, holes: Sequence[BoreHole]) -> FeedRegion:
    """Place and shape."""
    angle = float(np.radians(settings.angle))
    if isinstance(settings, HoleSettings):
        if not settings.diameter:
            return _hole_in_mesh(settings, key, holes)
        return FeedHole(angle, settings.height, settings.diameter)
    assert isinstance(settings, (AxialGrooveSettings, CircumferentialGrooveSettings))
    extent = float(np.radians(settings.extent))
    width = settings.length if isinstance(settings, AxialGrooveSettings) else settings.width
    return FeedGroove(angle, settings.height, extent, width)


def _hole_in_mesh(settings: HoleSettings, key: str, holes: Sequence[BoreHole]) -> FeedHole:
    """The hole in the mesh nearest to angle and height."""
    if not holes or settings.on != "bore":
        raise SettingsError(
            f"{key}.diameter is missing [m]: only a flexible bore may have a hole in its mesh, and "
            f"this {settings.on} has none"
        )

    def distance(hole: BoreHole) -> float:
        turn = np.mod(hole.angle - np.radians(settings.angle) + np.pi, 2 * np.pi) - np.pi
        return float(np.hypot(hole.radius * turn, hole.height - settings.height))

    nearest = min(holes, key=distance)
    return FeedHole(nearest.angle, nearest.height, nearest.diameter)


def _pressure(
    settings: SupplySettings, key: str, *, periodic: bool
) -> float | Callable[[float], tuple[float, float]]:
    """Constant, or a curve over the time, over and over where the scene is periodic."""
    if settings.table == NONE:
        return settings.pressure
    if settings.pressure:
        raise SettingsError(f"{key}: give a pressure or a table, one of them")
    # SciPy's splines are for mechanisms that have a table.
    from fenics_ehd.scenes.csv_table import require_closed
    from fenics_ehd.scenes.time_table import read_time_table

    path = table_file(settings.table, f"{key}.table")
    curve = read_time_table(path, f"{key}.table", {"pressure": {"Pa": 1.0, "bar": 1e5}})
    values = np.array([curve(row)[0] for row in curve.curve.x])
    if values.min() < 0.0:
        raise SettingsError(
            f"{key}.table {path}: a pressure of {values.min():g} Pa, it must be at least 0, that "
            "at which the film cavitates"
        )
    if periodic:
        ends = values[[0, -1]][:, None]
        require_closed(f"{key}.table {path}", ends, "a periodic run needs a table that closes")
    return replace(curve, periodic=periodic)
