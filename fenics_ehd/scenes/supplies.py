"""Supplies of a scene's films."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.feed import Feed
from fenics_ehd.film.feed_region import FeedGroove, FeedHole, FeedRegion, check_region
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.loads import table_file
from fenics_ehd.scenes.scene import Scene
from fenics_ehd.scenes.supply_settings import (
    AxialGrooveSettings,
    CircumferentialGrooveSettings,
    HoleSettings,
    SupplySettings,
)


def feeds(scene: Scene, name: str) -> tuple[Feed, ...]:
    """Supplies of a lubricated joint.

    Raises
    ------
    SettingsError
        A pressure that is given twice, or a table that cannot be used.
    """
    found = []
    for own, settings in scene.joints[name].supply.items():
        key = f"joints.{name}.supply.{own}"
        found.append(
            Feed(
                own,
                region(settings),
                _pressure(settings, key, periodic=scene.time.periodic),
                settings.resistance,
                settings.on == "journal",
            )
        )
    return tuple(found)


def check_supply(scene: Scene, name: str, grid: FilmGrid) -> None:
    """Refuse supplies that the film of a joint, or its mesh, cannot hold.

    Raises
    ------
    SettingsError
        Naming key, value and limit.
    """
    for feed in feeds(scene, name):
        check_region(f"joints.{name}.supply.{feed.name}", feed.region, grid)


def region(settings: SupplySettings) -> FeedRegion:
    """Place and shape."""
    angle = float(np.radians(settings.angle))
    if isinstance(settings, HoleSettings):
        return FeedHole(angle, settings.height, settings.diameter)
    assert isinstance(settings, (AxialGrooveSettings, CircumferentialGrooveSettings))
    extent = float(np.radians(settings.extent))
    width = settings.length if isinstance(settings, AxialGrooveSettings) else settings.width
    return FeedGroove(angle, settings.height, extent, width)


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
