"""Map of one rigid bearing: operating points with dynamic coefficients over speeds and loads.

Every point is computed separately, see `fenics_ehd.scenes.bearing`. A point without an equilibrium,
or without coefficients, is listed with the reason.

The table of a map has the columns that ROSS (github.com/petrobras/ross) reads for a bearing:
``frequency``, the speed of the shaft [rad/s], stiffness ``kxx``, ``kxy``, ``kyx``, ``kyy`` [N/m]
and damping ``cxx``, ``cxy``, ``cyx``, ``cyy`` [N s/m]. The axis x is along the load, and y is a
quarter turn from x in the direction of rotation. Further columns have names with units.

Imports inside functions: figures need matplotlib, which is loaded when one is drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from fenics_ehd.analysis.bearing import BearingResult
from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.base.arguments import (
    require_class,
    require_list,
    require_names,
    require_number,
)
from fenics_ehd.base.described import Described, unknown_name
from fenics_ehd.base.errors import EhdError, SettingsError
from fenics_ehd.base.progress import Progress, chosen_progress
from fenics_ehd.scenes.bearing import solve_bearing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Columns of the table that describe a map: name, factor to the unit, and unit.
DESCRIBED = (
    ("frequency", 1.0, "rad/s"),
    ("load_N", 1.0, "N"),
    ("eccentricity_ratio", 1.0, ""),
    ("min_film_thickness_m", 1e6, "um"),
    ("stiffness_scatter_N_per_m", 1e-6, "MN/m"),
    ("whirl_frequency_ratio", 1.0, ""),
    ("critical_mass_kg", 1.0, "kg"),
)


@dataclass(frozen=True)
class FailedPoint(Described):
    """A point of a bearing map for which there is no result.

    Attributes
    ----------
    speed, load
        Speed of the shaft [rad/s], and load [N]; the load is None if an eccentricity is given.
    reason
        Message of the error.
    """

    speed: float
    load: float | None
    reason: str

    @property
    def name(self) -> str:
        """Text with speed and load of the point, for messages."""
        load = "" if self.load is None else f", load {self.load:g} N"
        return f"speed {self.speed:g} rad/s{load}"


@dataclass(frozen=True, eq=False)
class BearingMap(Described):
    """Results of a bearing over speeds and loads.

    Attributes
    ----------
    results
        Results with dynamic coefficients: for each speed in order, all loads in order.
    failed
        Points without a result, with reasons.
    """

    results: tuple[BearingResult, ...]
    failed: tuple[FailedPoint, ...]

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield points, ranges of speed, load, film and coefficients, and points without result."""
        total = len(self.results) + len(self.failed)
        yield "BearingMap", f"{len(self.results)} of {total} points have a result"
        rows = self.rows()
        for name, factor, unit in DESCRIBED if rows else ():
            values = [factor * value for row in rows if (value := row[name]) is not None]
            if values:
                yield name, f"{min(values):.4g} to {max(values):.4g} {unit}".rstrip()
        for point in self.failed[:1]:
            yield f"failed ({len(self.failed)})", f"{point.name}: {point.reason}"

    def __getitem__(self, name: str) -> np.ndarray:
        """Column of the map's table, shape (points,), by its name in `rows`; NaN if missing."""
        rows = self.rows()
        if not rows or name not in rows[0]:
            where = "map.rows()[0]" if rows else ""
            raise unknown_name("map", name, rows[0] if rows else (), where)
        values = [row[name] for row in rows]
        return np.array([np.nan if value is None else value for value in values], dtype=float)

    def plot(self) -> Figure:
        """Draw stiffness, damping, whirl ratio and critical mass over speed or load.

        Raises
        ------
        SettingsError
            The map has no result, or has several speeds and several loads.
        """
        from fenics_ehd import plot

        return plot(self)

    def rows(self) -> list[dict[str, float | None]]:
        """Rows of the table of the map, each as values by column; None for a missing value."""
        return [_row(result) for result in self.results]


def bearing_map(
    settings: BearingSettings | None = None,
    *,
    speeds: Sequence[float | str],
    loads: Sequence[float | str] = (),
    eccentricity: float | None = None,
    progress: Progress | bool = True,
    **changes: Any,
) -> BearingMap:
    """Compute a bearing with its dynamic coefficients at all combinations of speeds and loads.

    Parameters
    ----------
    settings
        Settings of the bearing, whose speed is replaced by each of the `speeds`; by default those
        of `BearingSettings`.
    speeds
        Speeds of the shaft [rad/s], or with a unit: ``"3000 rpm"``.
    loads, eccentricity
        Loads [N], or with a unit: ``"5 kN"``; or an eccentricity ratio in 0..1; exactly one of both
        must be given.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the points are
        a stage.
    changes
        Further settings of the bearing by name, as for `bearing`: ``clearance=25e-6``.

    Raises
    ------
    SettingsError
        Neither loads nor an eccentricity are given, or both; a speed cannot be used with the
        other settings; or a load is not above 0; or the film has no pressure at a speed.
    """
    require_class("settings", settings, BearingSettings, optional=True)
    names = [name for name in attrs.fields_dict(BearingSettings) if name != "speed"]
    require_names("bearing_map", changes, names)
    if eccentricity is not None:
        require_number("eccentricity", eccentricity, least=0.0, below=1.0)
    every_load = [
        require_number("load", load, unit="N", above=0.0)
        for load in require_list("loads", loads, "loads [N]")
    ]
    if (eccentricity is None) == (not every_load):
        raise SettingsError("exactly one of loads and eccentricity must be given")
    start = attrs.evolve(settings or BearingSettings(), **changes)
    every_speed = require_list("speeds", speeds, "speeds [rad/s]")
    if not every_speed:
        raise SettingsError("speeds: give at least one speed")
    at_speeds = [attrs.evolve(start, speed=speed) for speed in every_speed]
    for changed in at_speeds:
        _require_pressure(changed)
    points = list(product(at_speeds, every_load or (None,)))
    results = []
    failed = []
    with chosen_progress(progress).stage("bearing map", len(points), "points") as stage:
        for changed, load in points:
            try:
                results.append(
                    solve_bearing(
                        changed, load=load, eccentricity=eccentricity, with_coefficients=True
                    )
                )
            except EhdError as error:
                failed.append(FailedPoint(changed.speed, load, str(error)))
            stage.add()
    return BearingMap(tuple(results), tuple(failed))


def _require_pressure(settings: BearingSettings) -> None:
    """Refuse a speed at which a film without a supply has no pressure.

    Such a film carries no load, and has no dynamic coefficients.

    Raises
    ------
    SettingsError
        Nothing draws the oil in, nothing squeezes it, and no groove supplies it.
    """
    if not (settings.entrainment or any(settings.squeeze) or settings.grooves):
        raise SettingsError(
            f"speed = {settings.speed:g} rad/s: a film that draws in no oil has no pressure, "
            "carries no load and has no coefficients: drop this speed"
        )


def _row(result: BearingResult) -> dict[str, float | None]:
    """Row of the table of a map for one result, as values by column."""
    linear = result.coefficients
    assert linear is not None
    attitude = result.attitude
    return {
        "frequency": result.settings.speed,
        **dict(_entries("k", linear.stiffness)),
        **dict(_entries("c", linear.damping)),
        "load_N": result.load,
        "eccentricity_ratio": result.eccentricity_ratio,
        "attitude_angle_deg": None if attitude is None else float(np.degrees(attitude)),
        "min_film_thickness_m": result.min_film_thickness,
        "whirl_frequency_ratio": linear.whirl_ratio,
        "critical_mass_kg": linear.critical_mass,
        "stability_threshold": linear.threshold,
        "stiffness_scatter_N_per_m": _largest(linear.stiffness_scatter),
        "damping_scatter_Ns_per_m": _largest(linear.damping_scatter),
        "temperature_C": None if result.heat is None else result.heat.effective_temperature,
        **dict(_entries("k", linear.stiffness_scatter, "_scatter_N_per_m")),
        **dict(_entries("c", linear.damping_scatter, "_scatter_Ns_per_m")),
        "critical_mass_scatter_kg": linear.critical_mass_scatter,
        "whirl_frequency_ratio_scatter": linear.whirl_ratio_scatter,
        "stability_threshold_scatter": linear.threshold_scatter,
    }


def _entries(
    letter: str, matrix: np.ndarray | None, ending: str = ""
) -> Iterator[tuple[str, float | None]]:
    """Entries of a matrix of coefficients, each with its name in ROSS, such as ``kxy``.

    Parameters
    ----------
    letter, ending
        First letter of the names, k or c, and text after them.
    matrix
        The matrix; its entries are None without a matrix.
    """
    for i, j in product(range(2), range(2)):
        value = None if matrix is None else float(matrix[i, j])
        yield f"{letter}{'xy'[i]}{'xy'[j]}{ending}", value


def _largest(scatter: np.ndarray | None) -> float | None:
    """Largest scatter of the entries of a matrix over film meshes; None for a single mesh."""
    return None if scatter is None else float(scatter.max())
