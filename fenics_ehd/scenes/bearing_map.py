"""Map of one rigid bearing: operating points with dynamic coefficients over speeds and loads.

Every point is computed separately, see `fenics_ehd.scenes.bearing`. A point without an equilibrium,
or without coefficients, is listed with the reason.

The table of a map has the columns that ROSS (github.com/petrobras/ross) reads for a bearing:
``frequency``, the speed of the shaft [rad/s], stiffness ``kxx``, ``kxy``, ``kyx``, ``kyy`` [N/m]
and damping ``cxx``, ``cxy``, ``cyx``, ``cyy`` [N s/m]. The axis x is along the load, and y is a
quarter turn from x in the direction of rotation. Further columns have names with units.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import attrs
import numpy as np

from fenics_ehd.analysis.bearing import BearingResult
from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.base.arguments import require_number
from fenics_ehd.base.errors import EhdError, SettingsError
from fenics_ehd.base.progress import SILENT, Progress
from fenics_ehd.scenes.bearing import solve_bearing


@dataclass(frozen=True)
class FailedPoint:
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
class BearingMap:
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

    def rows(self) -> list[dict[str, float | None]]:
        """Rows of the table of the map, each as values by column; None for a missing value."""
        return [_row(result) for result in self.results]


def bearing_map(
    settings: BearingSettings,
    *,
    speeds: Sequence[float],
    loads: Sequence[float] = (),
    eccentricity: float | None = None,
    progress: Progress = SILENT,
) -> BearingMap:
    """Compute a bearing with its dynamic coefficients at all combinations of speeds and loads.

    Parameters
    ----------
    settings
        Settings of the bearing, whose speed is replaced by each of the `speeds`.
    speeds
        Speeds of the shaft [rad/s].
    loads, eccentricity
        Loads [N], or an eccentricity ratio in 0..1; exactly one of both must be given.
    progress
        Progress in which the points are a stage.

    Raises
    ------
    SettingsError
        Neither loads nor an eccentricity are given, or both; a speed cannot be used with the
        other settings; or a load is not above 0; or the film has no pressure at a speed.
    """
    if (eccentricity is None) == (len(loads) == 0):
        raise SettingsError("exactly one of loads and eccentricity must be given")
    at_speeds = [attrs.evolve(settings, speed=speed) for speed in speeds]
    for size in loads:
        require_number("load", size, above=0.0)
    for changed in at_speeds:
        _require_pressure(changed)
    points = list(product(at_speeds, loads if len(loads) else (None,)))
    results = []
    failed = []
    with progress.stage("bearing map", len(points), "points") as stage:
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
