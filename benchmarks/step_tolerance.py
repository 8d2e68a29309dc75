"""Error of the slider-crank's curves against step tolerance and run time.

    python benchmarks/step_tolerance.py [revolutions]

Runs the default scene at falling tolerances and compares the peak-pressure and
minimum-film curves with the tightest of them: pressure relative to its peak,
film thickness pointwise, both as maxima over the revolution.
"""

from __future__ import annotations

import sys

import attrs
import numpy as np
from scipy.interpolate import PchipInterpolator
from tqdm import tqdm

from fenics_ehd.scenes.rod import reduce_rod
from fenics_ehd.scenes.run import Totals, simulate
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)
REFERENCE = 1e-7

#: The first film build-up, from no pressure at all, is left out of the comparison [s].
START = 2e-4


def curves(settings: SliderCrankSettings, body, tolerance: float):
    """Times, peak pressures, film thicknesses and totals of one run."""
    time = attrs.evolve(settings.time, tolerance=tolerance)
    rows: list[tuple[float, float, float]] = []

    def record(row, _fields):
        rows.append((row["time_s"], row["max_pressure_Pa"], row["min_film_thickness_m"]))

    totals = simulate(attrs.evolve(settings, time=time), body, Totals(), record)
    return np.array(rows).T, totals


def main(revolutions: float = 1.0) -> None:
    """Print the table."""
    settings = SliderCrankSettings()
    mechanism = attrs.evolve(settings.mechanism, revolutions=revolutions)
    settings = attrs.evolve(settings, mechanism=mechanism)
    body = reduce_rod(settings).body
    runs = {t: curves(settings, body, t) for t in tqdm((*TOLERANCES, REFERENCE))}
    (times, pressure, film), _ = runs[REFERENCE]
    grid = np.linspace(START, times[-1], 4000)
    exact_pressure = PchipInterpolator(times, pressure)(grid)
    exact_film = PchipInterpolator(times, film)(grid)
    print("tolerance   steps  Newton  time [s]  p_max [MPa]  h_min [um]  "
          "pressure [%]  film [%]  energy")  # fmt: skip
    for tolerance in TOLERANCES:
        (times, pressure, film), totals = runs[tolerance]
        pressure_error = np.abs(PchipInterpolator(times, pressure)(grid) - exact_pressure).max()
        film_error = np.abs(PchipInterpolator(times, film)(grid) / exact_film - 1).max()
        print(
            f"{tolerance:9.0e} {totals.steps:7d} {totals.newton_iterations:7d} "
            f"{totals.wall_time:9.2f} {totals.max_pressure / 1e6:12.3f} "
            f"{totals.min_film_thickness * 1e6:11.4f} "
            f"{100 * pressure_error / exact_pressure.max():13.3f} {100 * film_error:9.3f} "
            f"{totals.energy_error:9.1e}"
        )


if __name__ == "__main__":
    main(*(float(argument) for argument in sys.argv[1:]))
