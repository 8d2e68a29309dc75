"""Newton's method for one implicit step of films and motion, by SNES-VI.

Pressures of all films are bounded below by zero, and coordinates are not bounded: one iteration
solves complementarity and motion together. It converges quadratically once the active set does not
change. The iteration ends when three conditions hold in the maximum norm. The next Newton update
changes the gaps, relatively, by less than the tolerance of the step. It changes the coordinates by
less than the tolerance in the norm of the step control. Every film's complementarity holds to the
tolerance relative to its source, or to round-off of its flow.

Factors are reused as long as the active set does not change, the updates shrink fast, and the oil
balances of mass-conserving films hold, whose transport is not linear. Near the solution only the
films' own matrices are computed again, not the derivatives with respect to the gaps. If the active
set of a film changes by few nodes, its factors are bordered (`ChangedSystem`). Residual patterns
that the derivatives do not retain are treated by repeated substitution.

Full updates may cycle between two active sets: a few residual patterns with little damping resist a
short step far more than the oil does. A failed step is repeated with half of every update as long
as the active set changes.

Failures with an oil whose viscosity grows with pressure without bound have an error of their own,
`ViscosityError`. Between rigid surfaces a film of Barus' oil carries only a finite load, however
fast the gap closes: with the ratio r of viscosities and ``dq = dp / r(p)``, Reynolds' equation for
q is that of a constant viscosity, and q remains below ``int_0^inf dp / r(p) = 1 / alpha``. Close to
this limit pressures grow without bound within a short time, no step is short enough, and the solver
fails with another error at every step. A coarse mesh does not resolve the peak, and the run
continues with wrong pressures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.film_models import FilmModel
from fenics_ehd.multibody.mechanism import Motion, System
from fenics_ehd.multibody.quantities import JointStep, joint_steps
from fenics_ehd.multibody.step_equations import Derivative, GapChanges, Point, StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.tabulated import extrapolation_weights


@dataclass(frozen=True, eq=False)
class CoupledState:
    """Films and motion of a mechanism at the end of a step.

    Attributes
    ----------
    joints
        State of every lubricated joint, in the order of `System.films`.
    motion
        Coordinates, rates, accelerations and multipliers.
    """

    joints: list[JointStep]
    motion: Motion

    @property
    def films(self) -> list[FilmState]:
        """Solution of every film, in the order of `System.films`."""
        return [joint.state for joint in self.joints]


#: Type of an accepted step of a mechanism.
MechanismStep = Step[CoupledState]


@dataclass(frozen=True, eq=False)
class SolverState:
    """State of the solver between steps, to extrapolate the first iterate of the next step.

    Attributes
    ----------
    times, values
        Times [s] and unknowns u (`StepEquations`) at the last one or two steps, newest first.
    patterns
        Number of residual patterns to retain in the derivatives of the next step.
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
        """Make the state after a step, from the former state, and the step's end and unknowns."""
        if former is None:
            return cls(np.array([time]), values[None], patterns)
        times = np.array([time, former.times[0]])
        return cls(times, np.stack([values, former.values[0]]), patterns)


#: Layout of the stored state of a mechanism's time integration.
INTEGRATOR_STATE = Group({**INTEGRATOR, "solver": SolverState.layout}, scoped=True)


#: Largest number of nodes that fill or empty, over the number of full nodes, for which factors are
#: bordered instead of computed again.
LARGEST_BORDER = 0.25

#: Largest number of nodes of a film whose factors are bordered: for more nodes, borders would cost
#: a tenth more iterations.
MOST_NODES = 700

#: Smallest number of residual patterns that the factorised derivatives retain, with which a run
#: starts. The contribution of the others to an update is computed by repeated substitution, at most
#: `MAX_REFINEMENTS` times, until it changes by less than `REFINED` of the update. If a substitution
#: reduces the change to more than `SLOW` of the one before, the number of retained patterns is
#: doubled; if to less than `FAST`, it is halved in the next step. Substitutions that follow are
#: taken to change an update by at most `MARGIN` times the sum of a geometric series.
FEWEST_PATTERNS = 30
REFINED = 0.02
MAX_REFINEMENTS = 8
SLOW = 0.4
FAST = 0.02
MARGIN = 2.0


class Update(NamedTuple):
    """Newton update that SNES subtracts in one iteration.

    Attributes
    ----------
    films
        Solution of every film's linear system: updates of pressures at full nodes.
    rest
        Update of the coordinates and multipliers ``(z, l, m)``, shape (n + 2 m,).
    gap_reduction
        Largest relative reduction of a gap.
    size
        Largest relative change of a gap or, if larger, of a coordinate in the norm of the step
        control.
    """

    films: list[np.ndarray]
    rest: np.ndarray
    gap_reduction: float
    size: float


class StepFactors:
    """Factorised derivatives of the equations of a step, reused from iteration to iteration.

    Parameters
    ----------
    equations
        Equations of a step of the mechanism.
    options_prefix
        Prefix of the PETSc options of the factorisations.

    Attributes
    ----------
    patterns
        Number of residual patterns retained in the derivatives.
    """

    #: Names of the counts in `work`.
    WORK = ("film_factorisations", "triangular_solves")

    def __init__(self, equations: StepEquations, *, options_prefix: str):
        self._equations = equations
        self._blocks = [film.linear_system(options_prefix) for film in equations.films]
        self.retain_patterns(FEWEST_PATTERNS)

    def retain_patterns(self, patterns: int) -> None:
        """Set the number of residual patterns that the derivatives retain."""
        self.patterns = max(patterns, FEWEST_PATTERNS)
        self._reduction = 0.0
        self._equations.retain_patterns(self.patterns)

    @property
    def work(self) -> dict[str, int]:
        """Factorisations of film matrices, and right-hand sides solved with them, so far."""
        counts = (
            sum(block.factorisations for block in self._blocks),
            sum(block.solved_columns for block in self._blocks),
        )
        return dict(zip(self.WORK, counts, strict=True))

    @property
    def patterns_wanted(self) -> int:
        """Number of residual patterns to retain next: half as many if substitution is fast."""
        patterns = self.patterns // 2 if self._reduction < FAST else self.patterns
        return max(patterns, FEWEST_PATTERNS)

    def begin(self, norm: StepNorm, patterns: int) -> None:
        """Start a step whose errors are measured by `norm`."""
        self._norm = norm
        if patterns != self.patterns:
            self.retain_patterns(patterns)
        self._reduction = 0.0
        self.forget()

    def forget(self) -> None:
        """Discard all factors of the derivatives."""
        self._base: BorderedSystem | None = None
        self._factored: BorderedSystem | ChangedSystem | None = None
        self._derivative: Derivative | None = None
        self._full: Sequence[np.ndarray] = ()

    @property
    def known(self) -> bool:
        """Whether factors of the derivatives exist."""
        return self._factored is not None

    def change(self, full: Sequence[np.ndarray]) -> bool:
        """Change the full nodes of every film: border the factors, and keep the derivatives.

        If this is impossible, or a new factorisation is cheaper, change nothing and return False.
        """
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
        """Compute and factorise the derivatives at a point, for the full nodes of every film.

        If `near` is true, the point is near the solution, and only the matrices A and W of the
        films are computed again.
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
        """Compute the Newton update like `solve`; retain more patterns if substitution is slow."""
        update = self.solve(point, films, rest)
        while self._reduction > SLOW and self.patterns < self._equations.most_patterns:
            self.retain_patterns(2 * self.patterns)
            self.factorise(point, full)
            update = self.solve(point, films, rest)
        return update

    def solve(
        self,
        point: Point,
        films: Sequence[np.ndarray],
        rest: np.ndarray,
        *,
        limit: float = np.nan,
    ) -> Update:
        """Compute the Newton update for right-hand sides of films, coordinates and multipliers.

        Repeated substitution adds the contribution of residual patterns that are not retained. With
        a `limit`, it ends as soon as it is known whether the size of the update exceeds the limit.
        """
        factored = self._factored
        assert factored is not None
        right_side = np.zeros(factored.size)
        right_side[: len(rest)] = rest
        pressures, x = factored.solve(films, right_side)
        changes, residuals = self._gap_change(factored, pressures, x)
        gap_reduction, size = self._measure(point, changes, x)
        former = size
        for _ in range(MAX_REFINEMENTS):
            if residuals is None or not size:
                break
            right_sides = [-film for film in residuals]
            pressures_more, x_more = factored.solve(right_sides, np.zeros(factored.size))
            changes_more, residuals = self._gap_change(factored, pressures_more, x_more)
            pressures = [p + q for p, q in zip(pressures, pressures_more, strict=True)]
            changes = [c + d for c, d in zip(changes, changes_more, strict=True)]
            x = x + x_more
            changed = self._measure(point, changes_more, x_more)[1]
            gap_reduction, size = self._measure(point, changes, x)
            self._reduction = changed / former
            former = changed
            if changed <= REFINED * size or self._reduction > SLOW:
                break
            remaining = changed * self._reduction / (1.0 - self._reduction)
            if abs(size - limit) > MARGIN * remaining:
                break
        return Update(pressures, x[: len(rest)], gap_reduction, size)

    def _gap_change(
        self, factored: BorderedSystem | ChangedSystem, pressures: list[np.ndarray], x: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray] | None]:
        """Gap changes and residuals due to an update, see `StepEquations.gap_change`.

        Only pressures of full nodes deform bores.
        """
        each = zip(self._equations.films, pressures, self._full, strict=True)
        nodal = [film.pressure_update(values, full) for film, values, full in each]
        return self._equations.gap_change(factored.borders, nodal, x)

    def _measure(
        self, point: Point, changes: list[np.ndarray], x: np.ndarray
    ) -> tuple[float, float]:
        """Largest relative reduction of a gap by an update, and size of the update (`Update.size`).

        SNES subtracts updates from the unknowns: a positive change reduces the gap.
        """
        n = self._equations.system.n
        gap_reduction = 0.0
        size = self._norm.coordinate_error(x[:n])
        bindings = self._equations.system.films
        for binding, change, film in zip(bindings, changes, point.films, strict=True):
            relative = change / binding.film.lengths(film.gap.thickness.ravel())
            gap_reduction = max(gap_reduction, float(relative.max()))
            size = max(size, float(np.abs(relative).max()))
        return gap_reduction, size


#: Ratio of viscosities, at the last accepted step, above which the failure of a step is attributed
#: to the oil. Films of successful runs reach 1e3 and more, but steps rarely fail there.
THICKENED = 1e2


def unresolved(binding: FilmBinding, steepest: float) -> str:
    """Message about a viscosity that varies too much within a cell; empty if it does not.

    `steepest` is the largest ratio of viscosities within a cell.
    """
    if steepest <= MOST_WITHIN_A_CELL:
        return ""
    return (
        f"untrustworthy: the viscosity in {binding.name} varies by a factor of {steepest:.2g} "
        f"within a cell, above {MOST_WITHIN_A_CELL:g}: use more joints.{binding.name}.cells; if "
        "the factor remains, the viscosity runs away: lower the load or the pressure coefficient "
        "(barus, roelands)"
    )


def classify_failure(
    error: SolverError, equations: StepEquations, former: SolverState | None
) -> SolverError:
    """Return the error, or a `ViscosityError` if the viscosity was too high at the last step."""
    if former is None or isinstance(error, ViscosityError):
        return error
    for film, indices in zip(equations.films, equations.film_indices, strict=True):
        highest = film.pressure(former.values[0][indices]).max()
        ratio = _ratio(film.film.equation.lubricant.viscosity_law, highest)
        if ratio > THICKENED:
            return ViscosityError(
                f"the viscosity of the oil in {film.binding.name} runs away with the pressure: at "
                f"{highest * 1e-6:.4g} MPa it is {ratio:.2g} times that at ambient pressure: lower "
                "the load or the pressure coefficient (barus, roelands)"
            )
    return error


def _ratio(law: PressureLaw, pressure: float) -> float:
    """Ratio of the viscosity at a pressure [Pa] to that at ambient pressure, or infinity.

    It is infinite above the limit of the law.
    """
    try:
        return 1.0 if law.constant else float(law(np.array([pressure]))[0])
    except ViscosityError:
        return np.inf


#: Largest number of iterations of a step; most steps need one to five.
MAX_ITERATIONS = 25

#: Largest ratio of the last update to the one before for which factors are reused.
CONTRACTION = 0.1

#: Derivatives are reused for another active set if the size of the last update is at most `NEAR`,
#: and at most `SHRINKING` times that of the one before.
NEAR = 0.05
SHRINKING = 0.3

#: Derivatives with respect to the gaps of films that are not nearly linear are reused if the square
#: of the last update is below this share of the tolerance. The error of the next iterate is of the
#: order of this square.
SQUARED = 0.3

#: Largest number of iterations of the second attempt at a step.
PATIENT_ITERATIONS = 100

#: Share of an update that the second attempt uses as long as the active set changes.
DAMPING = 0.5

#: Number of iterations after which the sheared fraction of the films is frozen at the latest.
FREE_SHEAR = 4

#: Smallest tolerance of a step's iteration, below which round-off dominates.
FINEST = 1e-11


class CoupledSteps:
    """Solver of the steps of one mechanism; calling it solves one step (`StepSolver`).

    Parameters
    ----------
    system
        The mechanism.
    weights
        Weights of velocity multipliers on coordinates, see `StepEquations`.
    options_prefix
        Prefix of the PETSc options of SNES-VI.
    """

    #: Names of the counts in `Attempt.work`.
    WORK = ("evaluations", *StepFactors.WORK)

    def __init__(
        self,
        system: System,
        *,
        weights: np.ndarray | None = None,
        options_prefix: str = "motion_",
    ):
        self.system = system
        self._prefix = options_prefix
        self.equations = StepEquations(system, weights=weights)
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
        self,
        problem: StepNorm,
        step: ImplicitStep,
        former: SolverState | None,
        gap_changes: GapChanges = (),
    ) -> Attempt:
        """Solve the equations of one time step of the mechanism.

        Parameters
        ----------
        problem
            Norm of the errors that control the time step.
        step
            Time integration formula of the step.
        former
            State of the solver after the last step; None to start from films without pressure.
        gap_changes
            Changes imposed on all gaps, see `StepEquations.begin`.
        """
        self._problem = problem
        self._tolerance = max(step.tolerance, FINEST)
        self._iterations = 0
        self._evaluations = 0
        before = self._factors.work
        self._factors.begin(problem, FEWEST_PATTERNS if former is None else former.patterns)
        self.equations.begin(step, gap_changes)
        try:
            iterations = self._solve(self._start(step, former))
            films = [film.end(point, self._tolerance) for film, point, _ in self._films]
        except SolverError as caught:
            error = classify_failure(caught, self.equations, former)
            return Attempt(max(1, self._iterations), cause=error, work=self._work_since(before))
        patterns = self._factors.patterns_wanted
        kept = SolverState.after(former, step.time, self._solution, patterns)
        x, rate = self.equations.state(self._point)
        observed = problem.observe(x)
        motion = self._point.motion
        gaps = problem.film_gaps(observed)
        joints = joint_steps(self.equations, films, motion.multipliers, x, rate, gaps)
        solved = Solved(x, rate, observed, CoupledState(joints, motion), kept)
        return Attempt(iterations, solved, work=self._work_since(before))

    def _work_since(self, before: Mapping[str, int]) -> dict[str, int]:
        """Counts of the work in the current step; `before` are the factors' counts at its start."""
        done = {name: count - before[name] for name, count in self._factors.work.items()}
        return {"evaluations": self._evaluations, **done}

    def response_to_forces(
        self, x: np.ndarray, rate: np.ndarray, shift: float, forces: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Changes of coordinates and multipliers due to small generalised forces.

        Changes are those from the last solution, for each of k sets of forces.

        Parameters
        ----------
        x, rate
            State x of the time integration, and its rate, at the last solution.
        shift
            Rate of a change over the change, in ``x' = shift x + ...`` [1/s].
        forces
            Generalised forces, shape (n, k).

        Returns
        -------
        coordinates, multipliers : numpy.ndarray
            Changes of the coordinates z, shape (n, k), and of the multipliers on position level,
            shape (m, k).
        """
        past = rate - shift * x, -shift * rate
        step = ImplicitStep(0.0, shift, *past, x, x, (x, x), self._tolerance)
        self.equations.begin(step)
        self.function(self._solution)
        self._factors.forget()
        self._factors.factorise(self._point, self._full)
        films = [np.zeros(film.pattern.size) for film in self.equations.films]
        responses = []
        for force in forces.T:
            rest = np.zeros(self.equations.rest_size)
            rest[: len(force)] = force
            responses.append(self._factors.solve(self._point, films, rest).rest)
        changes = np.stack(responses, axis=-1)
        n = self.system.n
        return changes[:n], changes[n : n + self.system.m]

    def _solve(self, start: np.ndarray) -> int:
        """Solve with full updates, or with damped updates if they fail; return the iterations."""
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
        """First iterate, extrapolated from the last steps as far as no gap closes."""
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
            # Linear extrapolation from the last two steps.
            start = extrapolation_weights(former.times, step.time) @ former.values
            for film, indices in zip(
                self.equations.films, self.equations.film_indices, strict=True
            ):
                start[indices] = film.admissible(start[indices])
        start[rest][:n] = x[:n]
        return start

    # --- SNES-VI calls the following methods during a solve.

    def function(self, x: np.ndarray) -> np.ndarray:
        """Residual of all equations of the step at unknowns x, see `VariationalInequality`."""
        self._evaluations += 1
        # PETSc overwrites its array, but the point keeps the values: they are copied.
        self._point: Point = self.equations.evaluate(x.copy())
        return self._point.residual

    def linearise(self, x: np.ndarray) -> None:
        """Do nothing, because `factorise` computes the derivatives when the active set is known."""

    def factorise(self, nodes: np.ndarray) -> None:
        """Factorise derivatives for an active set, or reuse factors, see `VariationalInequality`.

        `nodes` are the indices of all unknowns that are not at their bounds.
        """
        self._nodes = nodes
        full = []
        each = zip(self.equations.films, self.equations.film_indices, strict=True)
        for film, indices in each:
            inside = (nodes >= indices.start) & (nodes < indices.stop)
            free = nodes[inside] - indices.start
            full.append(film.full_nodes(free))
        self._settled = all(
            np.array_equal(now, then) for now, then in zip(full, self._full, strict=True)
        )
        self._full = full
        if self._settled or self._iterations >= FREE_SHEAR:
            self.equations.freeze_sheared_fraction()
        if self._contracts and self._settled and self._factors.known:
            valid = (f.nearly_linear or f.settled(p, self._tolerance) for f, p, _ in self._films)
            if all(valid):
                return
        curved = not all(film.nearly_linear for film in self.equations.films)
        if curved or not (self._close and self._factors.change(full)):
            near = curved and self._size**2 <= SQUARED * self._tolerance
            self._factors.factorise(self._point, full, near=near)

    @property
    def _films(self) -> list[tuple[FilmModel[Any], Any, np.ndarray]]:
        """Model, data at the last iterate, and full nodes of every film."""
        return list(zip(self.equations.films, self._point.films, self._full, strict=True))

    def _right_sides(self) -> list[np.ndarray]:
        """Right-hand side of every film's linear system at the last iterate."""
        return [film.right_side(point, full) for film, point, full in self._films]

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Newton update, shortened if it would close a gap, see `VariationalInequality`."""
        del rhs  # the residual of the last iterate, which is known
        self._iterations += 1
        former = self._size
        rest = self._point.rest
        update = self._factors.update(self._point, self._full, self._right_sides(), rest)
        self._size = update.size
        gap_reduction = update.gap_reduction
        self._contracts = self._size <= CONTRACTION * former
        self._close = self._size <= min(NEAR, SHRINKING * former)
        self._fraction = min(1.0, BOUNDARY_FRACTION / gap_reduction) if gap_reduction > 0 else 1.0
        if not self._settled:
            self._fraction *= self._damping
        each = zip(self._films, update.films, strict=True)
        films = [film.update(point, full, solution) for (film, point, full), solution in each]
        return self._fraction * np.concatenate([*films, update.rest])[self._nodes]

    def converged(self, iteration: int) -> bool:
        """Whether the next update, computed with the last derivatives, is below the tolerance."""
        if not iteration or self._fraction < 1.0:
            return False
        if not all(film.settled(point, self._tolerance) for film, point, _ in self._films):
            return False
        update = self._factors.solve(
            self._point, self._right_sides(), self._point.rest, limit=self._tolerance
        )
        return update.size <= self._tolerance
