"""The obvious way: explicit first-order form, derivatives by differences, for SciPy's integrators.

Accelerations follow from a solved film and a solved mass matrix; derivatives of the right side are
differences, a film for every unknown. SciPy's own are so short that they see the tolerance of the
film; the others are of a length chosen with care.
"""

from __future__ import annotations

import warnings

import numpy as np
from integrators_case import FIRST_STEP, Case, Trajectory, Window
from integrators_scaled import PROBE, ScaledFilm
from scipy.integrate import solve_ivp

from fenics_ehd.errors import SolverError

#: Velocities are controlled as positions are, over this time [s].
VELOCITY_TIME = 2e-3

#: Length of a difference, of the scaled unknowns.
DIFFERENCE = 1e-6


def integrate(method: str, own: bool, case: Case, window: Window, tolerance: float) -> Trajectory:
    """Integrate a machine without residual patterns, with SciPy's own differences or ours.

    Raises
    ------
    RuntimeError
        SciPy did not reach the end.
    """
    system = ScaledFilm(case)
    n, mechanism = system.size, case.machine
    rest, nothing = np.zeros(n), np.zeros(system.film.assembly.size)

    def slopes(time: float, state: np.ndarray) -> np.ndarray:
        x, rate = state[:n] * system.length, state[n:] * system.length / VELOCITY_TIME
        try:
            pressure = system.film_at(time, x, rate).pressure
        except SolverError:
            return np.full(2 * n, np.nan)
        at = mechanism.equations(time, x, rate, rest, (0.0, 0.0), pressure)
        probed = mechanism.equations(time, x, rate, rest, (0.0, PROBE**2), nothing)
        still = mechanism.equations(time, x, rate, rest, (0.0, 0.0), nothing)
        mass = (probed.slope - still.slope) / PROBE**2
        acceleration = -np.linalg.solve(mass, at.residual)
        return np.concatenate(
            [state[n:] / VELOCITY_TIME, acceleration * VELOCITY_TIME / system.length]
        )

    def jacobian(time: float, state: np.ndarray) -> np.ndarray:
        base = slopes(time, state)
        columns = [
            (slopes(time, state + DIFFERENCE * unit) - base) / DIFFERENCE for unit in np.eye(2 * n)
        ]
        return np.nan_to_num(np.column_stack(columns))

    start = np.concatenate([window.x, VELOCITY_TIME * window.rate]) / np.tile(system.length, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = solve_ivp(
            slopes,
            (window.start, window.end),
            start,
            method,
            jac=None if own else jacobian,
            rtol=tolerance,
            atol=tolerance,
            first_step=min(FIRST_STEP, window.end - window.start),
            max_step=case.largest_step,
        )
    if not found.success:
        raise RuntimeError(f"{found.message} (t = {found.t[-1]:.6g} s)")
    states = [(y[:n] * system.length, y[n:] * system.length / VELOCITY_TIME) for y in found.y.T[1:]]
    return Trajectory(
        list(found.t[1:]),
        states=states,
        iterations=found.nlu,
        evaluations=system.evaluations,
    )
