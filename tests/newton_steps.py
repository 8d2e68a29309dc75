"""Small dense systems in time: steps by Newton's method, from a start to an end."""

import numpy as np

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import BOUNDARY_FRACTION, Attempt, IntegratorState, Solved, advance

MAX_NEWTON = 12


def newton(problem, step, solution):
    """Solve one step, with iterates that stay in the admissible set."""
    change = step.predicted - step.start
    limit = BOUNDARY_FRACTION * problem.admissible_fraction(step.start, change)
    x = step.start + min(1.0, limit) * change
    for iteration in range(1, MAX_NEWTON + 1):
        rate = step.shift * x + step.past_x
        try:
            residual, jacobian, solution = problem.linearise(
                step.time, x, rate, step.acceleration(rate), (step.shift, step.shift**2), solution
            )
            update = -np.linalg.solve(jacobian, residual)
        except (ehd.errors.SolverError, np.linalg.LinAlgError) as error:
            return Attempt(iteration, cause=error)
        if not np.isfinite(update).all():
            return Attempt(iteration, cause=ehd.errors.SolverError("Newton's update is not finite"))
        fraction = min(1.0, BOUNDARY_FRACTION * problem.admissible_fraction(x, update))
        x = x + fraction * update
        # One iteration would leave the solution that of the prediction.
        if iteration > 1 and fraction == 1.0 and problem.norm(x, update) <= step.tolerance:
            rate = step.shift * x + step.past_x
            return Attempt(iteration, Solved(x, rate, problem.observe(x), solution, solution))
    failure = ehd.errors.SolverError(f"Newton did not converge in {MAX_NEWTON} iterations")
    return Attempt(MAX_NEWTON, cause=failure)


def integrate(problem, span, x, rate, control, tables=()):
    """Every accepted step."""
    time, end = span
    state = IntegratorState.begin(problem, time, x, rate, control)
    while state.time < end:
        step, state = advance(problem, state, end, control, newton, tables)
        yield step
