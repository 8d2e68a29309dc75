"""Newton's method for one implicit step of films and motion, by SNES-VI.

Pressures of all films are bounded below by zero, coordinates are free: complementarity and motion
converge in one iteration, quadratically on the active set that SNES-VI settles on. It stops when
what is left of the Newton update changes the gaps by less than the tolerance of the step, relative,
the coordinates by less than that in the norm of the step control, and every film's complementarity
holds to the same tolerance, relative to its source, or to round-off of its flow; all in the
maximum norm.

A factorisation serves as long as the active set stays, the updates shrink fast, and balances of
conserved oil hold, whose transport is not linear: near the solution it is only the films' own
matrices that are made anew, not the derivatives along the gaps. Films whose active set changes by
few nodes are bordered (`ChangedSystem`), and residual patterns that the derivatives leave out are
found by repeated substitution.

Full updates may lead from one active set to another and back: few residual patterns, hardly
damped, resist a short step far more than the oil does. A step that failed is tried again with
half of every update as long as the active set changes.

Oil that thickens under pressure without bound is told apart from other failures. Between rigid
surfaces a film of Barus' oil can bear no more than a finite load however fast they close: with
``dq = dp / r(p)``, r the ratio of viscosities, Reynolds' equation is that of constant viscosity
for q, which stays below ``int_0^inf dp / r(p)``, 1 / alpha. On the way there pressures rise without
bound in a moment, and no step is short enough. What the solver says of it differs from step to
step. A coarse mesh does not see the peak and goes on with pressures that are its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from fenics_ehd.base.errors import CavitationError, SolverError, ViscosityError
from fenics_ehd.base.layout import Group, Value
from fenics_ehd.film.cavitation import SnesVi
from fenics_ehd.film.film import MOST_WITHIN_A_CELL, FilmState
from fenics_ehd.film.lubricant import PressureLaw
from fenics_ehd.multibody.bdf import (
    BOUNDARY_FRACTION,
    INTEGRATOR,
    Attempt,
    ImplicitStep,
    Solved,
    Step,
)
from fenics_ehd.multibody.border import BorderedSystem, ChangedSystem
from fenics_ehd.multibody.film_models import FilmModel
from fenics_ehd.multibody.mechanism import FilmBinding, Motion, System
from fenics_ehd.multibody.quantities import JointStep, joint_steps
from fenics_ehd.multibody.step_equations import Derivative, GapChanges, Point, StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.tabulated import extrapolation_weights


@dataclass(frozen=True, eq=False)
class CoupledState:
    """Films and motion at the end of a step.

    Attributes
    ----------
    joints
        Lubricated ones, in the order of `System.films`.
    motion
        See `Motion`.
    """

    joints: list[JointStep]
    motion: Motion

    @property
    def films(self) -> list[FilmState]:
        """Solution of every film."""
        return [joint.state for joint in self.joints]


#: An accepted step of a mechanism.
MechanismStep = Step[CoupledState]


@dataclass(frozen=True, eq=False)
class SolverState:
    """Start values that one step leaves to the next.

    Attributes
    ----------
    times, values
        Unknowns u (`StepEquations`) at the last one or two steps, newest first.
    patterns
        Residual patterns to take into the derivatives.
    """

    times: np.ndarray
    values: np.ndarray
    patterns: int

    layout: ClassVar = Group(
        {
            "times": Value("float", ("STEPS",)),
            "values": Value("float", ("STEPS", "unknowns")),
            "patterns": Value("integer", least=0),
        },
        required=False,
    )

    @classmethod
    def after(
        cls, former: SolverState | None, time: float, values: np.ndarray, patterns: int
    ) -> SolverState:
        """With one more step."""
        if former is None:
            return cls(np.array([time]), values[None], patterns)
        times = np.array([time, former.times[0]])
        return cls(times, np.stack([values, former.values[0]]), patterns)


#: Layout of a stored state of a mechanism's integration.
INTEGRATOR_STATE = Group({**INTEGRATOR, "solver": SolverState.layout}, scoped=True)


#: Nodes that may fill and empty, over the number of full ones, before all is factorised anew; and
#: free nodes of a film beyond which it always is: the border would cost a tenth more iterations.
LARGEST_BORDER, MOST_NODES = 0.25, 700

#: Residual patterns in the factorised derivatives of a sparse film, at first and at least. What the
#: others add to an update is found by repeated substitution, until it changes by less than this
#: share. Where that shrinks changes by less than `SLOW`, twice the patterns are taken, by more
#: than `FAST` half of them in the next step.
FEWEST_PATTERNS = 30
REFINED = 0.02
MAX_REFINEMENTS = 8
SLOW, FAST = 0.4, 0.02


class Update(NamedTuple):
    """Newton update that SNES takes away in one iteration.

    Attributes
    ----------
    films, rest
        Of every film at its nodes, pressures where the film is full; and of ``(z, l, m)``.
    gap_reduction
        Largest gap_reduction of a gap, relative.
    size
        Largest change of a gap, relative, or of a coordinate in the norm of the steps.
    """

    films: list[np.ndarray]
    rest: np.ndarray
    gap_reduction: float
    size: float


class StepFactors:
    """Factors of the equations of one step after another.

    Parameters
    ----------
    equations
        Of the mechanism.
    options_prefix
        Of the factorisations.

    Attributes
    ----------
    patterns
        Residual patterns in the derivatives.
    """

    def __init__(self, equations: StepEquations, *, options_prefix: str):
        self._equations = equations
        self._blocks = [film.system(options_prefix) for film in equations.films]
        self.retain_patterns(FEWEST_PATTERNS)

    def retain_patterns(self, patterns: int) -> None:
        """Take so many residual patterns into the derivatives."""
        self.patterns = max(patterns, FEWEST_PATTERNS)
        self._reduction = 0.0
        self._equations.retain_patterns(self.patterns)

    @property
    def patterns_wanted(self) -> int:
        """Residual patterns for the next step: half, where few would have done."""
        patterns = self.patterns // 2 if self._reduction < FAST else self.patterns
        return max(patterns, FEWEST_PATTERNS)

    def begin(self, norm: StepNorm, patterns: int) -> None:
        """Take another step, whose errors `norm` judges."""
        self._norm = norm
        if patterns != self.patterns:
            self.retain_patterns(patterns)
        self._reduction = 0.0
        self.forget()

    def forget(self) -> None:
        """Keep no factors."""
        self._base: BorderedSystem | None = None
        self._factored: BorderedSystem | ChangedSystem | None = None
        self._derivative: Derivative | None = None
        self._full: Sequence[np.ndarray] = ()

    @property
    def known(self) -> bool:
        """True once there are factors."""
        return self._factored is not None

    def change(self, full: Sequence[np.ndarray]) -> bool:
        """Take other full nodes, derivatives as they are; False: better factorise."""
        derivative = self._derivative
        changes = []
        border = 0
        if derivative is None or self._base is None:
            return False
        for film, then, now in zip(derivative.films, self._base_full, full, strict=True):
            added = np.setdiff1d(now, then, assume_unique=True)
            emptied = np.setdiff1d(then, now, assume_unique=True)
            border += len(added) + len(emptied)
            most = LARGEST_BORDER * (len(then) + 1)
            if film.weights is not None or len(film.inputs) > MOST_NODES or border > most:
                return False
            changes.append((added, emptied))
        self._factored = ChangedSystem(self._base, changes) if border else self._base
        self._full = full
        return True

    def factorise(self, point: Point, full: Sequence[np.ndarray], *, near: bool = False) -> None:
        """Derivatives at a point, factorised for the full nodes of every film.

        `near` the solution only the films' own matrices are made anew.
        """
        derivative = self._derivative = self._equations.linearise(
            point, self._derivative if near else None
        )
        for block, film, nodes in zip(self._blocks, derivative.films, full, strict=True):
            block.prepare(film.entries, film.weights, nodes)
        self._base_full = self._full = full
        films = [film.on(nodes) for film, nodes in zip(derivative.films, full, strict=True)]
        self._base = self._factored = BorderedSystem(self._blocks, films, derivative.core)

    def update(
        self,
        point: Point,
        full: Sequence[np.ndarray],
        films: Sequence[np.ndarray],
        rest: np.ndarray,
    ) -> Update:
        """As `solve`, with more patterns in the derivatives if substitution is slow."""
        found = self.solve(point, films, rest)
        while self._reduction > SLOW and self.patterns < self._equations.most_patterns:
            self.retain_patterns(2 * self.patterns)
            self.factorise(point, full)
            found = self.solve(point, films, rest)
        return found

    def solve(self, point: Point, films: Sequence[np.ndarray], rest: np.ndarray) -> Update:
        """Solve for right-hand sides of the films and of the rest."""
        factored = self._factored
        assert factored is not None
        given = np.zeros(factored.size)
        given[: len(rest)] = rest
        pressures, x = factored.solve(films, given)
        changes, left = self._gap_change(factored, pressures, x)
        gap_reduction, size = self._measure(point, changes, x)
        former = size
        for _ in range(MAX_REFINEMENTS):
            if left is None or not size:
                break
            more, x_more = factored.solve([-film for film in left], np.zeros(factored.size))
            further, left = self._gap_change(factored, more, x_more)
            pressures = [p + q for p, q in zip(pressures, more, strict=True)]
            changes = [c + d for c, d in zip(changes, further, strict=True)]
            x = x + x_more
            changed = self._measure(point, further, x_more)[1]
            gap_reduction, size = self._measure(point, changes, x)
            self._reduction = changed / former
            former = changed
            if changed <= REFINED * size or self._reduction > SLOW:
                break
        return Update(pressures, x[: len(rest)], gap_reduction, size)

    def _gap_change(
        self, factored: BorderedSystem | ChangedSystem, pressures: list[np.ndarray], x: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray] | None]:
        """Changes as of `StepEquations.gap_change`; what is no pressure moves no bore."""
        each = zip(self._equations.films, pressures, self._full, strict=True)
        nodal = [film.nodal_change(values, full) for film, values, full in each]
        return self._equations.gap_change(factored.borders, nodal, x)

    def _measure(
        self, point: Point, changes: list[np.ndarray], x: np.ndarray
    ) -> tuple[float, float]:
        """Largest relative gap_reduction of a gap, and largest change in the norm of the steps.

        SNES takes changes away: one that opens a gap closes it.
        """
        n = self._equations.system.n
        gap_reduction = 0.0
        size = self._norm.coordinate_error(x[:n])
        places = self._equations.system.films
        for binding, change, film in zip(places, changes, point.films, strict=True):
            relative = change / binding.film.lengths(film.gap.thickness.ravel())
            gap_reduction = max(gap_reduction, float(relative.max()))
            size = max(size, float(np.abs(relative).max()))
        return gap_reduction, size


#: Ratio of viscosities at the last accepted step beyond which it is the oil that failed. Films that
#: go on reach 1e3 and more in runs, but rarely fail a step there.
THICKENED = 1e2


def unresolved(binding: FilmBinding, steepest: float) -> str:
    """Message about an oil that thickens too much within a cell; usually empty."""
    if steepest <= MOST_WITHIN_A_CELL:
        return ""
    return (
        f"untrustworthy: the oil in {binding.name} thickens {steepest:.2g} times within a cell, "
        f"above {MOST_WITHIN_A_CELL:g}: use more joints.{binding.name}.cells; where that does not "
        "help the viscosity runs away, lower the load or the pressure coefficient (barus, roelands)"
    )


def classify_failure(
    error: SolverError, equations: StepEquations, former: SolverState | None
) -> SolverError:
    """The error, or the one of a viscosity that runs away, by the films at the former step."""
    if former is None or isinstance(error, ViscosityError):
        return error
    for film, own in zip(equations.films, equations.places, strict=True):
        highest = film.pressure(former.values[0][own]).max()
        ratio = _ratio(film.film.equation.lubricant.viscosity_law, highest)
        if ratio > THICKENED:
            return ViscosityError(
                f"the viscosity of the oil in {film.place.name} runs away with the pressure: at "
                f"{highest * 1e-6:.4g} MPa it is {ratio:.2g} times that at ambient pressure: lower "
                "the load or the pressure coefficient (barus, roelands)"
            )
    return error


def _ratio(law: PressureLaw, pressure: float) -> float:
    """Ratio of viscosities at a pressure [Pa], infinite beyond all that is computed."""
    try:
        return 1.0 if law.constant else float(law(np.array([pressure]))[0])
    except ViscosityError:
        return np.inf


#: Iterations of one step. Those that converge need one to five.
MAX_ITERATIONS = 25

#: A factorisation is kept for another iteration when the last update shrank by this.
CONTRACTION = 0.1

#: Derivatives are kept for another active set when the last update changed the gaps by no more
#: than this, relative, and shrank by this.
NEAR, SHRINKING = 0.05, 0.3

#: Derivatives along the gaps of films that are not nearly linear are kept when the square of the
#: last update, over the tolerance, is below this: of that order is what they then miss.
SQUARED = 0.3

#: Iterations of a step that failed so, and the part of an update that they take as long as the
#: active set changes.
PATIENT_ITERATIONS, DAMPING = 100, 0.5

#: Iterations after which the sheared share of the films stays as it is, if it does not before.
FREE_SHEAR = 4

#: Tolerance below which round-off is met.
FINEST = 1e-11


class CoupledSteps:
    """Solves the steps of one mechanism: a `StepSolver`.

    Parameters
    ----------
    system
        The mechanism.
    weights, gap_changes
        See `StepEquations`.
    options_prefix
        Of SNES-VI.
    """

    def __init__(
        self,
        system: System,
        *,
        weights: np.ndarray | None = None,
        gap_changes: Callable[[float], GapChanges] | None = None,
        options_prefix: str = "motion_",
    ):
        self.system = system
        self._prefix = options_prefix
        self.equations = StepEquations(system, weights=weights, gap_changes=gap_changes)
        self._factors = StepFactors(self.equations, options_prefix=options_prefix)
        self._snes = self._solver(MAX_ITERATIONS)

    @cached_property
    def _patient(self) -> SnesVi:
        return self._solver(PATIENT_ITERATIONS)

    def _solver(self, iterations: int) -> SnesVi:
        return SnesVi(
            self,
            self.equations.lower,
            options_prefix=self._prefix,
            tolerance=None,
            max_iterations=iterations,
        )

    def __call__(
        self, problem: StepNorm, step: ImplicitStep, former: SolverState | None
    ) -> Attempt:
        """Solve one step; `problem` judges errors."""
        self._problem = problem
        self._tolerance = max(step.tolerance, FINEST)
        self._iterations = 0
        self._factors.begin(problem, FEWEST_PATTERNS if former is None else former.patterns)
        self.equations.begin(step)
        try:
            iterations = self._solve(self._start(step, former))
            films = [film.end(point, self._tolerance) for film, point, _ in self._films]
        except SolverError as caught:
            error = classify_failure(caught, self.equations, former)
            return Attempt(max(1, self._iterations), cause=error)
        patterns = self._factors.patterns_wanted
        kept = SolverState.after(former, step.time, self._solution, patterns)
        x, rate = self.equations.state(self._point)
        observed = problem.observe(x)
        motion = self._point.motion
        gaps = problem.film_gaps(observed)
        joints = joint_steps(self.equations, films, motion.multipliers, x, rate, gaps)
        return Attempt(iterations, Solved(x, rate, observed, CoupledState(joints, motion), kept))

    def response_to_forces(
        self, x: np.ndarray, rate: np.ndarray, shift: float, forces: np.ndarray
    ) -> np.ndarray:
        """Changes of z with which the solution found last answers generalised forces, shape (n, k).

        Parameters
        ----------
        x, rate
            State of the solution.
        shift
            Of the changes: ``x' = shift x + ...``.
        forces
            shape (n, k).
        """
        past = rate - shift * x, -shift * rate
        step = ImplicitStep(0.0, shift, *past, x, x, (x, x), self._tolerance)
        self.equations.begin(step)
        self.function(self._solution)
        self._factors.forget()
        self._factors.factorise(self._point, self._full)
        films = [np.zeros(len(film.nodes)) for film in self.equations.films]
        found = []
        for force in forces.T:
            given = np.zeros(self.equations.rest_size)
            given[: len(force)] = force
            found.append(self._factors.solve(self._point, films, given).rest[: len(force)])
        return np.stack(found, axis=-1)

    def _solve(self, start: np.ndarray) -> int:
        """Iterations to a solution, by full updates and else by damped ones."""
        self._begin(damping=1.0)
        try:
            self._solution, _, iterations = self._snes.solve(start)
            return iterations
        except CavitationError:
            self._begin(damping=DAMPING)
        self._solution = self._patient.solve(start)[0]
        return self._iterations

    def _begin(self, damping: float) -> None:
        self._full = [np.empty(0, dtype=np.int32) for _ in self.system.films]
        self._factors.forget()
        self._close = False
        self._size = np.inf
        self._fraction = 1.0
        self._contracts = False
        self._damping = damping
        self._settled = False

    def _start(self, step: ImplicitStep, former: SolverState | None) -> np.ndarray:
        """First iterate: extrapolated, as far as the gaps stay open."""
        before, predicted = (self._problem.gaps(observed) for observed in step.observed)
        gap_reduction = self._problem.gap_reduction(before, predicted)
        fraction = min(1.0, BOUNDARY_FRACTION / gap_reduction) if gap_reduction > 0.0 else 1.0
        x = step.start + fraction * (step.predicted - step.start)
        rest = self.equations.rest
        n = self.system.n
        if former is None:
            gaps = self._problem.film_gaps(step.observed[0])
            start = self.equations.unknowns_at(step.start, gaps)
        else:
            # On the line through the last two steps.
            start = extrapolation_weights(former.times, step.time) @ former.values
            start[: rest.start] = np.maximum(start[: rest.start], 0.0)
        start[rest][:n] = x[:n]
        return start

    # --- Called by SNES-VI during a solve.

    def function(self, x: np.ndarray) -> np.ndarray:
        """Residual of all equations, see `VariationalInequality`."""
        # PETSc writes to its array again; a point lasts.
        self._point: Point = self.equations.evaluate(x.copy())
        return self._point.residual

    def linearise(self, x: np.ndarray) -> None:
        """Nothing yet: derivatives are made for an active set, when it is known."""

    def factorise(self, nodes: np.ndarray) -> None:
        """Derivatives for an active set, see `VariationalInequality`."""
        self._nodes = nodes
        full = []
        for film, own in zip(self.equations.films, self.equations.places, strict=True):
            last = own.start + len(film.nodes)
            full.append(nodes[(nodes >= own.start) & (nodes < last)] - own.start)
        self._settled = all(
            np.array_equal(now, then) for now, then in zip(full, self._full, strict=True)
        )
        self._full = full
        if self._settled or self._iterations >= FREE_SHEAR:
            self.equations.freeze_sheared_fraction()
        if self._contracts and self._settled and self._factors.known:
            known = (f.nearly_linear or f.settled(p, self._tolerance) for f, p, _ in self._films)
            if all(known):
                return
        curved = not all(film.nearly_linear for film in self.equations.films)
        if curved or not (self._close and self._factors.change(full)):
            near = curved and self._size**2 <= SQUARED * self._tolerance
            self._factors.factorise(self._point, full, near=near)

    @property
    def _films(self) -> list[tuple[FilmModel[Any], Any, np.ndarray]]:
        """Model, point and full nodes of every film."""
        return list(zip(self.equations.films, self._point.films, self._full, strict=True))

    def _given(self) -> list[np.ndarray]:
        """Right-hand sides of all films."""
        return [film.given(point, full) for film, point, full in self._films]

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Newton update, see `VariationalInequality`; shortened where it would close a gap."""
        del rhs  # the residual of the last point
        self._iterations += 1
        former = self._size
        rest = self._point.rest
        found = self._factors.update(self._point, self._full, self._given(), rest)
        self._size = found.size
        gap_reduction = found.gap_reduction
        self._contracts = self._size <= CONTRACTION * former
        self._close = self._size <= min(NEAR, SHRINKING * former)
        self._fraction = min(1.0, BOUNDARY_FRACTION / gap_reduction) if gap_reduction > 0 else 1.0
        if not self._settled:
            self._fraction *= self._damping
        each = zip(self._films, found.films, strict=True)
        films = [film.update(point, full, own) for (film, point, full), own in each]
        return self._fraction * np.concatenate([*films, found.rest])[self._nodes]

    def converged(self, iteration: int) -> bool:
        """True if the rest of the update is small by the last derivatives."""
        if not iteration or self._fraction < 1.0:
            return False
        if not all(film.settled(point, self._tolerance) for film, point, _ in self._films):
            return False
        return self._factors.solve(self._point, self._given(), self._point.rest).size <= (
            self._tolerance
        )
