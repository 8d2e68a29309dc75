"""A point in the middle of motion, for derivatives of a step's equations."""

import numpy as np

from fenics_ehd.multibody.assembly import assemble
from fenics_ehd.multibody.implicit_step import ImplicitStep
from fenics_ehd.multibody.step_equations import StepEquations


def moving_point(system, shift, rate):
    """Equations of a step of one film, its pressures at free nodes, and the other unknowns.

    Values are random; rates of a size given.
    """
    equations = StepEquations(system, dense_limit=700)
    (nodes,) = equations.sizes
    rng = np.random.default_rng(1)
    z, _ = assemble(system)
    z = z + 1e-7 * rng.uniform(-1, 1, system.n)
    nothing = np.zeros(system.n)
    past = rate * rng.uniform(-1, 1, system.n) - shift * z
    equations.begin(
        ImplicitStep(1e-4, shift, past, nothing, nothing, nothing, (nothing, nothing), 1e-6)
    )
    pressure = rng.uniform(0.5, 1.0, nodes)
    forces = 100.0 * rng.uniform(-1, 1, system.m)
    return equations, pressure, np.concatenate([z, forces, np.zeros(system.m)])
