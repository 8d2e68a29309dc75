# # The slider-crank
#
# A crank turns at 500 rad/s and drives a piston through a connecting rod with a lubricated big end.
# The rod is elastic: its bore widens under the pressure of the film, which changes the film. This
# is section 4 of Krinner and Rixen in Python, with every object at hand. Run it with
#
#     python demos/slider_crank.py [revolutions]

# +
import sys

import numpy as np
from mpi4py import MPI

import fenics_ehd as ehd

CRANK, ROD, SPEED = 0.048, 0.16, 500.0  # m, m, rad/s
STEEL = ehd.Material(youngs_modulus=210e9, poissons_ratio=0.3, density=7850.0)
# -

# ## Offline: a rod becomes 39 modes
#
# Gmsh meshes the rod (600 hexahedra with 20 nodes), dolfinx assembles K and M, and the
# load-dependent method M3 keeps 6 vibration modes, 2 attachment modes at the piston's pin and 31
# residual modes that follow the pressures of short and long bearings. The reduced body has no array
# of the part's size; its inventory lists the modes that were kept, and their frequencies.


def reduce() -> ehd.ReducedBody:
    """Mesh, assemble and reduce the connecting rod."""
    structure = ehd.assemble_structure(
        ehd.build_mesh(ehd.model_path("conrod"), comm=MPI.COMM_SELF), STEEL
    )
    body = ehd.load_dependent(structure, 6, 31)
    print(f"{body.modes} modes, first elastic frequency {body.frequencies[0]:.0f} Hz")
    for mode in body.inventory[:3]:
        share = f"{mode.participation:.1%} of the bore's flexibility"
        print(f"  {mode.kind}, {mode.frequency:.0f} Hz, {share}")
    return body


# ## The mechanism
#
# The mechanism has bodies with their points, joints between points, and a drive for a body's angle.
# Positions are approximate: assembly closes the joints. The film has the cells of the rod's bore.


def mechanism(rod: ehd.ReducedBody) -> ehd.Mechanism:
    """Mechanism of the paper."""
    grid = ehd.film_grid(rod.pressure_nodes)
    film = ehd.Film(
        ehd.FilmParameters(grid, clearance=17e-6, lubricant=ehd.Lubricant(0.01), rate=SPEED)
    )
    return ehd.Mechanism(
        bodies={
            "crank": ehd.RigidBody(mass=1.0, inertia=1e-3, points={"pin": (CRANK, 0.0)}),
            "rod": ehd.FlexibleBody(rod, damping_time=1e-3, position=(CRANK, 0.0)),
            "piston": ehd.RigidBody(mass=0.5, inertia=1e-3, position=(CRANK + ROD, 0.0)),
        },
        joints={
            "main": ehd.Revolute(("ground", "crank")),
            "big_end": ehd.LubricatedJoint(journal="crank.pin", bore="rod.bore", film=film),
            "gudgeon": ehd.Revolute(("rod.pin", "piston")),
            "cylinder": ehd.Slider("ground", "piston"),
        },
        drives={"crank": ehd.Speed(SPEED)},
    )


# ## Online: one revolution
#
# Every step solves for the film pressures and all coordinates together. The shaft starts in the
# middle of the bore. The film builds up within the first tenth of a millisecond, in steps of 10 ns;
# later steps are a hundred thousand times longer.
#
# Is the run trustworthy? The energies that drive, oil and structure exchange must balance.
# (The command line also prints the error of the gap by the reduction, and a verdict.)


def main(revolutions: float = 1.0) -> ehd.History:
    """Reduce the rod, run the mechanism, and print the results."""
    end = revolutions * 2 * np.pi / SPEED
    result = ehd.simulate(mechanism(reduce()), end, largest=0.02 / revolutions)
    film = result.joints["big_end"]
    print(f"{len(result.time)} steps, maximum pressure {film.max_pressure.max() / 1e6:.2f} MPa")
    print(f"minimum film thickness {film.min_film_thickness.min() * 1e6:.3f} um")
    print(f"energy balance closes to {result.summary()['energy_balance_error']:.1e}")
    return result


if __name__ == "__main__":
    main(*(float(argument) for argument in sys.argv[1:]))
