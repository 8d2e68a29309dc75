# # A rotor in a flexible housing
#
# An elastic shaft of one metre turns at 600 rad/s. At its middle it runs in a lubricated bearing,
# whose housing is elastic as well. At three quarters of its length a force of 3.6 kN rotates with
# it. This is section 5 of Krinner and Rixen. The shaft bends and tilts in the bearing, so the film
# is thinnest at an edge. Run it with
#
#     python demos/rotor.py [revolutions]

# +
import sys

import numpy as np
from mpi4py import MPI

import fenics_ehd as ehd

SPEED = 600.0  # rad/s
STEEL = ehd.Material(youngs_modulus=210e9, poissons_ratio=0.3, density=7850.0)
# -

# ## The shaft
#
# Twenty Bernoulli beam elements on end springs, with a disk in the middle, are reduced to the 20
# lowest modes of the shaft without its bearing, ten in each plane.


def shaft() -> ehd.ShaftBody:
    """The paper's shaft; bearing and force are given by shares of its length."""
    found = ehd.ShaftBody(
        length=1.0,
        diameter=0.045,
        youngs_modulus=210e9,
        density=7446.0,
        support_stiffness=1.58e8,
        elements=20,
        modes=20,
        damping_ratio=1e-3,
        disks=[(0.5, 0.8, 1e-3, 5e-4)],  # place, mass, polar and diametral inertia
        points={"bearing": 0.5, "force": 0.75},
    )
    frequencies = found.rotor.angular[:3] / (2 * np.pi)
    print("shaft without oil:", ", ".join(f"{f:.1f}" for f in frequencies), "Hz")
    return found


# ## The housing
#
# The housing is a ring on a web and a foot, clamped at the foot. It has no rigid modes, but the
# code is that of a rod. M4 keeps ten modes and follows the film pressure by the remaining
# flexibility.


def housing() -> ehd.ReducedBody:
    """Mesh, assemble and reduce the clamped housing."""
    mesh = ehd.build_mesh(ehd.model_path("housing"), comm=MPI.COMM_SELF)
    structure = ehd.assemble_structure(mesh, STEEL, attachments=(), clamped="foot")
    body = ehd.residual_flexibility(structure, 10, centrifugal=False)
    print(f"housing: {body.modes} modes, first at {body.frequencies[0]:.0f} Hz")
    return body


# ## From rest
#
# The force acts from the start, and the shaft swings out. The tolerance is a hundred times the
# default, which makes the run fast but damps the vibration after the sudden start.


def main(revolutions: float = 0.25) -> ehd.History:
    """Run the rotor, and print where the film is thinnest."""
    part = housing()
    grid = ehd.film_grid(part.pressure_nodes)
    film = ehd.Film(
        ehd.FilmParameters(grid, clearance=17e-6, lubricant=ehd.Lubricant(0.01), rate=SPEED)
    )
    mechanism = ehd.Mechanism(
        bodies={"shaft": shaft(), "housing": ehd.FlexibleBody(part)},
        joints={"bearing": ehd.LubricatedJoint("shaft.bearing", "housing.bore", film)},
        drives={"shaft": ehd.Speed(SPEED)},
        forces={"unbalance": ehd.RotatingForce("shaft.force", 3600.0, SPEED)},
    )
    end = revolutions * 2 * np.pi / SPEED
    result = ehd.simulate(
        mechanism, end, tolerance=1e-3, order=2, first=1e-6, largest=0.02 / revolutions
    )
    bearing = result.joints["bearing"]
    print(f"{len(result.time)} steps, maximum pressure {bearing.max_pressure.max() / 1e6:.2f} MPa")
    print(f"minimum film thickness {bearing.min_film_thickness.min() * 1e6:.3f} um")
    return result


if __name__ == "__main__":
    main(*(float(argument) for argument in sys.argv[1:]))
