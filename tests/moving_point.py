"""A point in the middle of motion, and derivatives of a step's equations there."""

import numpy as np

from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.mechanism import assemble
from fenics_ehd.multibody.step_equations import StepEquations


def moving_point(system, shift, rate):
    """Equations of a step of one film, the number of its nodes, and the unknowns.

    Values are random; rates of a size given.
    """
    equations = StepEquations(system)
    nodes = len(equations.films[0].nodes)
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
    return equations, nodes, np.concatenate([pressure, z, forces, np.zeros(system.m)])


def assert_derivatives(system, shift, rate, size):
    """Film and motion by pressures and coordinates: exact, by central differences of a size.

    That of elastic coordinates is 1e-9; of pressures, which are of one, 1e-3.
    """
    equations, nodes, unknowns = moving_point(system, shift, rate)
    n = system.n

    def residual(values):
        return equations.evaluate(values).residual

    found = equations.linearise(equations.evaluate(unknowns))
    (film,), every = found.films, np.arange(nodes)
    forces = np.zeros((len(unknowns) - nodes, nodes))
    forces[film.rows] = film.outputs
    inner = film.block(every, every)
    exact = np.block([[inner, film.inputs @ film.spread], [forces, found.core]])
    steps = np.concatenate([np.full(nodes, 1e-3), np.where(system.weights == 1.0, size, 1e-9)[:n]])
    columns = [
        (residual(unknowns + h) - residual(unknowns - h)) / (2 * h.max())
        for h in np.pad(np.diag(steps), ((0, 0), (0, len(unknowns) - len(steps))))
    ]
    expected = np.column_stack(columns)
    for rows in (slice(0, nodes), slice(nodes, None)):
        for part in (slice(0, nodes), slice(nodes, nodes + n)):
            difference = expected[rows, part]
            largest = np.abs(difference).max(axis=0, keepdims=True)
            error = np.abs(exact[rows, part] - difference)
            assert (error / np.maximum(largest, 1e-6 * largest.max())).max() < 2e-5
