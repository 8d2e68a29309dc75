"""Flexible slider-crank with a lubricated big end, from Python.

The rod is meshed, reduced with the load-dependent method (M3) and run over one
revolution; every object of the way is at hand. Run it with

    python demos/slider_crank.py [revolutions]
"""

import sys

import attrs

from fenics_ehd.scenes.rod import reduce_rod
from fenics_ehd.scenes.run import Totals, simulate
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings


def main(revolutions: float = 1.0) -> Totals:
    """Reduce the rod, run it, print the two figures a designer asks for first."""
    settings = SliderCrankSettings()
    mechanism = attrs.evolve(settings.mechanism, revolutions=revolutions)
    settings = attrs.evolve(settings, mechanism=mechanism)

    # Offline: Gmsh -> dolfinx -> 39 modes. `body` holds no part-size array any more.
    body = reduce_rod(settings).body
    print(f"{body.modes} modes, first elastic frequency {body.frequencies[0]:.0f} Hz")

    # Online: crank, film and reduced rod, step by step.
    totals = simulate(settings, body, Totals())
    print(f"maximum pressure {totals.max_pressure / 1e6:.2f} MPa")
    print(f"minimum film thickness {totals.min_film_thickness * 1e6:.3f} um")
    return totals


if __name__ == "__main__":
    main(*(float(argument) for argument in sys.argv[1:]))
