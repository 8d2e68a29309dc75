"""Largest Floquet multiplier of a periodic solution: growth of a small change over a cycle.

A small change of the state at the start of a cycle causes a change at its end, by a linear map. The
eigenvalues of this map are the multipliers: a change along an eigenvector is multiplied by its
multiplier in each cycle. The solution is stable if all multipliers lie within the unit circle.
Arnoldi's method finds the largest multiplier from a few cycles with changed starts (Saad, Numerical
Methods for Large Eigenvalue Problems, chapter 6). All these cycles have the same time steps, so
that their ends differ by the changed starts only, not by the step control.

Temperatures of heat balances over a cycle are kept constant. If no drive imposes the speed of a
machine, a shift of its phase is one of the possible changes.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.analysis.replay import Replay, RunState, recorded, solved_run
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.progress import Progress, chosen_progress
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.mechanism import assemble
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tabulated import extrapolation_weights

#: Size of the changes of the start, relative to the gaps. It is large compared with Newton's
#: tolerance; the curvature of the map causes an error of about this size.
SIZE = 1e-3

#: Tolerance of Newton's last update in the simulated cycles.
NEWTON = 1e-8

#: Largest number of cycles with changed starts.
MOST = 12

#: Residual of the largest Ritz value, over its magnitude, at which the iteration ends.
RESIDUAL = 5e-3

#: Multiplier below which a change is smaller than Newton's tolerance after a cycle.
LEAST = 1e-4


@dataclass(frozen=True)
class Multiplier(Described):
    """The largest Floquet multiplier of a periodic solution.

    Attributes
    ----------
    value
        Complex multiplier [-]; the imaginary part is positive if there is a conjugate pair.
    residual
        Residual of the eigenvalue equation, which estimates the error of the multiplier [-].
    cycles
        Number of cycles that were simulated.
    """

    value: complex
    residual: float
    cycles: int

    def figures(self) -> dict[str, float]:
        """Entries of ``summary.json``: magnitude, angle, residual and cycles of the multiplier."""
        return {
            "largest_multiplier": abs(self.value),
            "largest_multiplier_angle_deg": float(np.degrees(np.angle(self.value))),
            "largest_multiplier_residual": self.residual,
            "multiplier_cycles": self.cycles,
        }


def largest_multiplier(
    run: Run, period: float, between: Callable[[], object] = lambda: None
) -> Multiplier:
    """Largest multiplier of a run's periodic solution; the state of the run is not changed.

    Parameters
    ----------
    run
        Run at the end of a cycle of the periodic solution.
    period
        Period of the solution [s].
    between
        Function that is called after each step.

    Raises
    ------
    StepSizeError
        A cycle with a changed start has no solution at the steps of the unchanged cycle.
    """
    cycle = _Cycle(copy(run), period, between)
    basis = [cycle.first()]
    hessenberg = np.zeros((MOST + 1, MOST))
    for j in range(MOST):
        image = cycle.after(basis[j])
        for i, vector in enumerate(basis):
            hessenberg[i, j] = cycle.product(vector, image)
            image = image - hessenberg[i, j] * vector
        norm = np.sqrt(cycle.product(image, image))
        hessenberg[j + 1, j] = norm
        values, vectors = np.linalg.eig(hessenberg[: j + 1, : j + 1])
        largest = int(np.argmax(np.abs(values) + 1e-9 * values.imag))
        value = complex(values[largest])
        residual = float(norm * abs(vectors[-1, largest]))
        if residual <= RESIDUAL * max(abs(value), LEAST) or norm <= LEAST:
            break
        basis.append(image / norm)
    # The cycle of the solution itself was simulated twice.
    return Multiplier(value, residual, j + 3)


def multiplier(history: History, *, progress: Progress | bool = True) -> Multiplier:
    """Largest multiplier of the periodic solution that `simulate` returned.

    Parameters
    ----------
    history
        History of the periodic solution.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the cycles
        are a stage.

    Raises
    ------
    InputError
        The history was read from a folder, or the solution is not periodic.
    """
    solved = solved_run(history)
    if solved.cycles is None:
        raise InputError("multiplier needs a periodic solution: simulate(mechanism, period=...)")
    with chosen_progress(progress).stage("largest multiplier") as stage:
        return largest_multiplier(solved.run, solved.cycles.period, stage.add)


class _Cycle:
    """Linear map from a change at the start of a cycle to the resulting change at its end.

    The past points of the integrator are states x and their rates. A change is added to all of
    them; its shape is (2, points, n), with x and its rate along the first axis.
    """

    def __init__(self, run: Run, period: float, between: Callable[[], object]):
        self._run = run
        self._period = period
        self._between = between
        self._start: RunState = run.state

        def look(_: MechanismStep) -> dict[str, float]:
            between()
            return {}

        self._course = recorded(run, self._start.time + period, look=look)
        norm = run.norm
        gaps = norm.gaps(self._start.observed[0])
        self._clearance = min(film.film.clearance for film in run.equations.system.films)
        # Lengths that changes of the observed quantities, and of their rates, are relative to.
        scales = np.full(len(self._start.observed[0]), self._clearance)
        scales[: len(gaps)] = norm.lengths(gaps) * np.sqrt(len(gaps))
        self._scales = np.stack([scales, 2 * np.pi / period * scales])
        self._end = self._through(self._start)

    def _through(self, start: RunState) -> RunState:
        """Simulate a cycle from the state `start`; return the state at its end."""
        replay = Replay(self._run, self._course, NEWTON, start=start)
        for _ in replay.until(start.time + self._period):
            self._between()
        return replay.state

    def first(self) -> np.ndarray:
        """First change at the start of a cycle, from which Arnoldi's method starts.

        It changes all coordinates, and satisfies the constraints of all joints. Its scalar product
        with itself is 1.
        """
        system = self._run.equations.system
        start = self._start
        measure = np.abs(system.error_measure).max(axis=0, initial=0.0)
        lengths = np.full(system.n, self._clearance)
        largest = 1.0 / measure[measure > 0.0].min(initial=1.0)
        np.divide(self._clearance / largest, measure, out=lengths, where=measure > 0.0)
        # The numbers are arbitrary, but the same in every run.
        rough = SIZE * lengths * np.cos(1.0 + 2.0 * np.arange(system.n))
        z = start.x[0][: system.n]
        v = start.rate[0][: system.n]
        moved = np.array(assemble(system, start.time, z + rough, v))
        moved -= assemble(system, start.time, z, v)
        change = np.zeros((2, len(start.times), start.x.shape[1]))
        change[:, :, : system.n] = moved[:, None]
        past = start.times - start.time
        change[0, :, : system.n] += np.multiply.outer(past, moved[1])
        return change / np.sqrt(self.product(change, change))

    def product(self, one: np.ndarray, other: np.ndarray) -> float:
        """Scalar product of two changes, computed from their values at the newest point."""
        return float(np.sum(self._measured(one) * self._measured(other)))

    def _measured(self, change: np.ndarray) -> np.ndarray:
        """Relative changes of the k observed quantities, and of their rates, shape (2, k).

        The observed quantities are gaps and other quantities, see `StepNorm`. `change` is evaluated
        at the newest point.
        """
        norm = self._run.norm
        newest = self._start.x[0]
        observed = [norm.observe(newest + part) - norm.observe(newest) for part in change[:, 0]]
        return np.array(observed) / self._scales

    def after(self, change: np.ndarray) -> np.ndarray:
        """Change at the end of the cycle due to a change at its start."""
        run = self._run
        start = self._start
        x = start.x + SIZE * change[0]
        rate = start.rate + SIZE * change[1]
        observed = np.array([run.norm.observe(point) for point in x])
        run.equations.keep_within(x, run.norm.film_gaps(observed[0]))
        end = self._through(replace(start, x=x, rate=rate, observed=observed))
        difference = np.stack([end.x - self._end.x, end.rate - self._end.rate]) / SIZE
        # The points at the end of this cycle and at the start of the next have other distances.
        known = end.times - end.time
        weights = extrapolation_weights(known, (start.times - start.time)[:, None])
        return np.einsum("kp,dkn->dpn", weights, difference)
