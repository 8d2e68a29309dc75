# # The main bearing of an engine
#
# A rigid shaft in a rigid bearing, under a load that repeats with every working cycle: how near
# does it come to the wall? The shaft's mass is small against the load W(t), so the film's force
# and the load balance at every instant,
#
#     F(e, e') + W(t) = 0,    F = - int p n dA,
#
# where p solves Reynolds' equation with cavitation for the gap of two cylinders,
#
#     div(h^3 / (12 eta) grad p) = U/2 dh/dx + dh/dt,    h = c - e . n,    p >= 0.
#
# This is an implicit differential equation of first order for the eccentricity e. Run it with
#
#     python demos/loaded_journal.py [LOAD.csv]

# +
import sys
from pathlib import Path

import attrs

from fenics_ehd.scenes.loaded_journal_run import OrbitTotals, simulate
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings

LOAD = Path(__file__).parent / "loads" / "single_cylinder.csv"
# -

# ## The scene
#
# The load is that of a single-cylinder four-stroke engine at 300 rad/s: a file of
# `time_s,Fx_N,Fy_N`. The film has 20 x 5 cells with 9 nodes.


def scene(load: str | Path, tolerance: float) -> LoadedJournalSettings:
    """The default bearing under a load, with one tolerance for steps and for the repetition."""
    settings = LoadedJournalSettings()
    return attrs.evolve(
        settings,
        load=attrs.evolve(settings.load, file=str(load)),
        film=attrs.evolve(settings.film, cells=(20, 5)),
        time=attrs.evolve(settings.time, tolerance=tolerance, periodicity=tolerance),
    )


# ## The periodic orbit
#
# What an engine bearing does, cycle after cycle, is the solution with `e(T) = e(0)`. Newton's
# method finds its start. The monodromy matrix, d e(T) / d e(0), comes with it, and its largest
# eigenvalue says how fast the bearing forgets: a journal without mass hardly remembers one
# stroke.


def main(load: str | Path = LOAD, tolerance: float = 1e-4) -> OrbitTotals:
    """Find the orbit and print what a designer asks for first."""
    totals = OrbitTotals()
    cycle = simulate(scene(load, tolerance), totals)
    print(f"periodic after {totals.cycle} cycles, {totals.steps} steps")
    print(f"largest Floquet multiplier {cycle.largest_multiplier:.1e}")
    print(f"maximum pressure {totals.max_pressure / 1e6:.2f} MPa")
    print(f"minimum film thickness {totals.min_film_thickness * 1e6:.3f} um")
    return totals


if __name__ == "__main__":
    main(*sys.argv[1:])
