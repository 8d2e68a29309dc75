# # A rotor in a flexible housing
#
# An elastic shaft of one metre turns at 600 rad/s. Half way it runs in a lubricated bearing,
# whose housing is elastic too; at three quarters of its length a force of 3.6 kN turns with it.
# Section 5 of Krinner and Rixen. The shaft bends, so it tilts in the bearing, and the film is
# thinnest at an edge. Run it with
#
#     python demos/rotor.py [revolutions]

# +
import sys

import attrs
import numpy as np

from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.housing import reduce_housing
from fenics_ehd.scenes.rotor_run import build_rotor, simulate
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.transient import Totals

# -

# ## The scene
#
# M4 keeps ten modes of the housing; whatever else the bore can do answers the pressure at once.
# The tolerance is a hundred times the default, to be quick: what rings after the sudden start is
# damped by it.


def scene(revolutions: float) -> RotorSettings:
    """The paper's rotor for a number of revolutions."""
    settings = RotorSettings()
    return attrs.evolve(
        settings,
        shaft=attrs.evolve(settings.shaft, revolutions=revolutions),
        reduction=attrs.evolve(settings.reduction, method="m4"),
        time=attrs.evolve(settings.time, tolerance=1e-3),
    )


# ## The shaft
#
# Twenty Bernoulli beam elements on end springs, reduced to their 20 lowest modes, ten in either
# plane, with the bearing empty. Every frequency comes twice.


def frequencies(settings: RotorSettings) -> np.ndarray:
    """Of the shaft at rest in one plane [Hz]."""
    found = np.sort(build_rotor(settings).frequencies)
    print("shaft without oil:", ", ".join(f"{f:.1f}" for f in found[:3]), "Hz")
    return found


# ## The housing
#
# A ring on a web and a foot, held at the foot: no rigid modes, the same code as for the rod.


def reduce(settings: RotorSettings) -> ReducedBody:
    """Mesh, assemble, hold, reduce."""
    body = reduce_housing(settings).body
    print(f"housing: {body.modes} modes, first at {body.frequencies[0]:.0f} Hz")
    return body


# ## From rest
#
# The force is there at once, and the shaft swings out. `record` gets one row for each step, as
# the columns of `history.csv`, and the fields that go into `history.h5`.


def main(revolutions: float = 0.25) -> tuple[Totals, list[dict]]:
    """Run, and say where the film is thinnest and how far the shaft tilts."""
    settings = scene(revolutions)
    frequencies(settings)
    rows: list[dict] = []
    totals = simulate(settings, reduce(settings), Totals(), lambda row, fields: rows.append(row))
    tilt = max(np.hypot(row["tilt_x_rad"], row["tilt_y_rad"]) for row in rows)
    print(f"{totals.steps} steps, maximum pressure {totals.max_pressure / 1e6:.2f} MPa")
    print(f"minimum film thickness {totals.min_film_thickness * 1e6:.3f} um")
    print(f"largest tilt {1e6 * tilt:.1f} urad, {0.011e6 * tilt:.2f} um at the bearing's edges")
    return totals, rows


if __name__ == "__main__":
    main(*(float(argument) for argument in sys.argv[1:]))
