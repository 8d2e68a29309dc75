# # The main bearing of an engine
#
# A rigid shaft runs in a rigid bearing, under a load that repeats with every working cycle: how
# close does the shaft come to the bore? The shaft's mass is small, so the force of the film
# balances the load W(t) at every instant,
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

import fenics_ehd as ehd

LOAD = Path(__file__).parent / "loads" / "single_cylinder.csv"
SPEED = 300.0  # rad/s
# -

# ## The mechanism
#
# The load is that of a single-cylinder four-stroke engine at 300 rad/s, from a file with the
# columns `time_s,Fx_N,Fy_N`. The film has 20 x 5 cells with 9 nodes; the journal has no mass.


def mechanism(load: str | Path) -> tuple[ehd.Mechanism, float]:
    """Mechanism of a journal under a load from a file, and the period of the load [s]."""
    grid = ehd.uniform_grid(radius=0.025, width=0.02, cells=(20, 5))
    film = ehd.Film(
        ehd.FilmParameters(grid, clearance=25e-6, lubricant=ehd.Lubricant(0.01), rate=SPEED)
    )
    along_x, along_y = ehd.read_load(Path(load))
    journal = ehd.Mechanism(
        bodies={"ground": ehd.ground({"bearing": (0.0, 0.0)}), "journal": ehd.MasslessBody()},
        joints={"film": ehd.LubricatedJoint("journal", "ground.bearing", film, smallest_film=1e-4)},
        drives={"journal": ehd.Speed(SPEED)},
        forces={
            "x": ehd.PointForce("journal", (1.0, 0.0), along_x),
            "y": ehd.PointForce("journal", (0.0, 1.0), along_y),
        },
    )
    return journal, along_x.period


# ## The periodic orbit
#
# In operation, cycle after cycle, the bearing follows the solution with `e(T) = e(0)`. Cycles are
# integrated until no film changes from one to the next. A journal without mass forgets its start
# within a stroke, so that two or three cycles are enough. The steps of two cycles differ, so their
# films differ by about the tolerance; a cycle counts as periodic if it differs by no more.


def main(load: str | Path = LOAD, tolerance: float = 1e-4) -> ehd.History:
    """Compute the periodic orbit and print its main results."""
    journal, period = mechanism(load)
    result = ehd.simulate(
        journal, period=period, periodicity=5 * tolerance, tolerance=tolerance, order=2, first=1e-6
    )
    film = result.joints["film"]
    print(f"periodic after {result.cycles} cycles, the last one in {len(result.time)} steps")
    print(f"maximum pressure {film.max_pressure.max() / 1e6:.2f} MPa")
    print(f"minimum film thickness {film.min_film_thickness.min() * 1e6:.3f} um")
    return result


if __name__ == "__main__":
    main(*sys.argv[1:])
