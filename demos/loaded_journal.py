"""Main bearing of an engine: the orbit of the shaft under a load history.

The shaft is rigid and its mass is small against the load W(t), so film force and
load balance at every instant,

    F(e, e') + W(t) = 0,    F = - int p n dA,

where p solves Reynolds' equation with cavitation for the gap of two cylinders,

    div(h^3 / (12 eta) grad p) = U/2 dh/dx + dh/dt,    h = c - e . n,    p >= 0.

This is an implicit differential equation of first order for the eccentricity e. Its
periodic solution is what an engine bearing does, cycle after cycle; Newton's method
finds its start from ``e(T) = e(0)``. The monodromy matrix, ``d e(T) / d e(0)``, says
how fast the bearing forgets: a journal without mass hardly remembers one stroke.

The load, demos/loads/single_cylinder.csv, is that of a single-cylinder four-stroke
engine at 300 rad/s. Run it with

    python demos/loaded_journal.py [LOAD.csv]
"""

import sys
from pathlib import Path

import attrs

from fenics_ehd.scenes.loaded_journal_run import OrbitTotals, simulate
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings

LOAD = Path(__file__).parent / "loads" / "single_cylinder.csv"


def main(load: str | Path = LOAD, tolerance: float = 1e-4) -> OrbitTotals:
    """Find the orbit and print what a designer asks for first."""
    settings = LoadedJournalSettings()
    settings = attrs.evolve(
        settings,
        load=attrs.evolve(settings.load, file=str(load)),
        film=attrs.evolve(settings.film, cells=(20, 5)),
        time=attrs.evolve(settings.time, tolerance=tolerance, periodicity=tolerance),
    )
    totals = OrbitTotals()
    cycle = simulate(settings, totals)
    print(f"periodic after {totals.cycle} cycles, {totals.steps} steps")
    print(f"largest Floquet multiplier {cycle.largest_multiplier:.1e}")
    print(f"maximum pressure {totals.max_pressure / 1e6:.2f} MPa")
    print(f"minimum film thickness {totals.min_film_thickness * 1e6:.3f} um")
    return totals


if __name__ == "__main__":
    main(*sys.argv[1:])
