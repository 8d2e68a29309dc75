# # The slider-crank
#
# A crank turns at 500 rad/s and drives a piston through a connecting rod whose big end runs in
# oil. The rod is elastic: its bore opens under the film's pressure, and the film answers. This is
# section 4 of Krinner and Rixen, from Python; every object of the way is at hand. Run it with
#
#     python demos/slider_crank.py [revolutions]

# +
import sys

import attrs

from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.rod import reduce_rod
from fenics_ehd.scenes.run import Totals, simulate
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

# -

# ## The scene
#
# The defaults are Table 1 of the paper. Settings are frozen; a change makes a new object, and a
# value outside its limits is refused here, not in the middle of the run.


def scene(revolutions: float) -> SliderCrankSettings:
    """The paper's machine for a number of crank revolutions."""
    settings = SliderCrankSettings()
    mechanism = attrs.evolve(settings.mechanism, revolutions=revolutions)
    return attrs.evolve(settings, mechanism=mechanism)


# ## Offline: a rod becomes 39 modes
#
# Gmsh meshes the rod (600 hexahedra with 20 nodes), dolfinx assembles K and M, and the
# load-dependent method M3 keeps 6 vibration modes, 2 attachment modes at the piston's pin and 31
# residual modes that follow the pressures of short and long bearings. The body that comes back
# holds no array of the size of the part any more; its inventory says what was kept, and where in
# frequency.


def reduce(settings: SliderCrankSettings) -> ReducedBody:
    """Mesh, assemble, reduce."""
    body = reduce_rod(settings).body
    print(f"{body.modes} modes, first elastic frequency {body.frequencies[0]:.0f} Hz")
    for mode in body.inventory[:3]:
        share = f"{mode.participation:.1%} of the bore's flexibility"
        print(f"  {mode.kind}, {mode.frequency:.0f} Hz, {share}")
    return body


# ## Online: one revolution
#
# Every step solves the film's pressures and the machine's coordinates together. What is
# integrated is the place of the shaft in its bore, ten micrometres, and not the rod's large
# motion. The shaft starts in the middle of the bore; the film builds up within the first tenth of
# a millisecond, which takes steps of 10 ns, later they are a hundred thousand times longer.


def run(settings: SliderCrankSettings, body: ReducedBody) -> Totals:
    """Integrate and print the figures that a designer asks for first."""
    totals = simulate(settings, body, Totals())
    print(f"maximum pressure {totals.max_pressure / 1e6:.2f} MPa")
    print(f"minimum film thickness {totals.min_film_thickness * 1e6:.3f} um")
    return totals


# ## Can it be believed?
#
# Two figures come with every run. The energy that drive, oil and structure exchange must add up;
# and the reduction knows what flexibility it left out, so that the run can say how wrong its gap
# is, within a factor of two or three.


def judge(totals: Totals) -> None:
    """Print what the run thinks of itself."""
    print(f"energy balance closes to {totals.energy_error:.1e}")
    print(f"gap error of the reduction about {totals.basis_error * 1e6:.3f} um")


def main(revolutions: float = 1.0) -> Totals:
    """The whole way."""
    settings = scene(revolutions)
    totals = run(settings, reduce(settings))
    judge(totals)
    return totals


if __name__ == "__main__":
    main(*(float(argument) for argument in sys.argv[1:]))
