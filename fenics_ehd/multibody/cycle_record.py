"""Accepted steps of a run with all that their equations were solved from, or of its last cycle."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from fenics_ehd.multibody.implicit_step import ImplicitStep
from fenics_ehd.multibody.motion import Instant
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.step_equations import StepEquations

#: Past points that a formula reaches back to, at most.
REACH = 5


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Unknowns of one step's equations.

    Attributes
    ----------
    films
        Dimensionless pressures of every film where it has unknowns.
    rest
        ``(z, l, m)``.
    voids
        Void fractions of films that conserve their oil, by the film's number.
    """

    films: list[np.ndarray]
    rest: np.ndarray
    voids: dict[int, np.ndarray]

    def moved(self, direction: Unknowns, amount: float) -> Unknowns:
        """So far along a direction."""
        pairs = zip(self.films, direction.films, strict=True)
        return Unknowns(
            [own + amount * other for own, other in pairs],
            self.rest + amount * direction.rest,
            {i: void + amount * direction.voids[i] for i, void in self.voids.items()},
        )


@dataclass(frozen=True, eq=False)
class RecordedStep:
    """One accepted step.

    Attributes
    ----------
    time, x, rate, acceleration, weights
        Of `Step`.
    values, patterns
        Of the `SolverState` it left: pressures, void fractions, multipliers, drift.
    corner
        Whether it ends at a row of a table that forgets what was before.
    """

    time: float
    x: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    weights: np.ndarray
    values: np.ndarray
    patterns: int
    corner: bool

    def unknowns(self, equations: StepEquations) -> Unknowns:
        """What solved its equations."""
        system, films, place = equations.system, [], 0
        for film, oil in zip(system.films, equations.oils, strict=True):
            own, size = film.film.film, film.film.film.assembly.size
            nodes = own.free if oil is None else oil.nodes
            films.append(self.values[place : place + size][nodes] / own.parameters.pressure_scale)
            place += size
        voids = {}
        for i in equations.voids:
            voids[i] = self.values[place : place + equations.sizes[i]]
            place += equations.sizes[i]
        return Unknowns(films, np.concatenate([self.x[: system.n], self.values[place:]]), voids)

    def equations_of(self, equations: StepEquations) -> ImplicitStep:
        """What the formula asked for: the past follows from the end of the step and its rate."""
        system, shift = equations.system, float(self.weights[0])
        drift = self.values[-system.m :] if system.m else np.zeros(0)
        past_x = self.rate - shift * self.x
        jacobian = Instant(system, self.time, self.x[: system.n]).jacobian
        past_x[: system.n] += system.weights * (drift @ jacobian)
        past_rate = self.acceleration - shift * self.rate
        return implicit_step(self.time, shift, past_x, past_rate)


def implicit_step(
    time: float, shift: float, past_x: np.ndarray, past_rate: np.ndarray
) -> ImplicitStep:
    """A step whose solution is known: nothing is predicted, nothing to be met."""
    nothing = np.empty(0)
    return ImplicitStep(
        time, shift, past_x, past_rate, nothing, nothing, (nothing, nothing), np.inf
    )


class CycleRecord:
    """Steps of a run, of a periodic search those of its last cycle.

    Parameters
    ----------
    run
        At its start.
    cycles
        Of a periodic search.

    Attributes
    ----------
    run, period
        The period is None of an initial value problem.
    steps
        So far.
    before
        Times of the points before the first of them, newest first [s].
    start
        x and its rate at the start of the run.
    """

    def __init__(self, run: Run, cycles: Cycles | None = None):
        self.run, self._cycles = run, cycles
        self.period = None if cycles is None else cycles.period
        self.steps: list[RecordedStep] = []
        self.before = np.array(run.state.times[:REACH])
        self.start = run.state.x[0].copy(), run.state.rate[0].copy()
        self._cycle = 1 if cycles is None else cycles.number

    def follow(self, steps: Iterable[MechanismStep]) -> Iterator[MechanismStep]:
        """The same steps, recorded."""
        for step in steps:
            self._add(step)
            yield step

    def _add(self, step: MechanismStep) -> None:
        if self._cycles is not None and self._cycles.number != self._cycle:
            self._cycle = self._cycles.number
            self.before = np.array([own.time for own in self.steps[: -REACH - 1 : -1]])
            self.steps = []
        solver = self.run.state.solver
        assert solver is not None
        self.steps.append(
            RecordedStep(
                step.time,
                step.x,
                step.rate,
                step.acceleration,
                step.weights,
                solver.values[0],
                solver.patterns,
                len(self.run.state.times) == 1,
            )
        )

    @property
    def times(self) -> np.ndarray:
        """Of the steps, from the start of the run or of the cycle [s]."""
        return np.array([step.time for step in self.steps]) - self.before[0]
