"""A mechanism on its way in time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.base.errors import ContactError, FilmTooThinError, InputError, SettingsError
from fenics_ehd.base.sealed_file import named, require_like
from fenics_ehd.film.rough_surfaces import DEEPEST_CONTACT
from fenics_ehd.multibody.assembly import assemble, check_inertia
from fenics_ehd.multibody.bdf import IntegratorState, StepControl, advance, follow
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.solver_state import MechanismStep, SolverState
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.step_solver import CoupledSteps
from fenics_ehd.multibody.system import FilmPlace, System

#: Damping ratio above which the formula of order 3 damps a mode at every step: it is A(82)-stable.
DAMPED = float(np.cos(np.radians(82.0)))


@dataclass(frozen=True)
class Steps:
    """How to step.

    Attributes
    ----------
    tolerance
        Local error of a step: relative change of every gap, and of coordinates as
        `Body.error_measure` has them.
    order
        Of the backward differentiation formula, 1 to 3; 2 for 3 where modes lack damping or
        oil is conserved.
    first, smallest
        [s].
    largest
        Share of the time to simulate, or of a cycle.
    """

    tolerance: float = 1e-5
    order: int = 3
    first: float = 1e-8
    smallest: float = 1e-13
    largest: float = 0.02


class Run:
    """A mechanism and the state it is in, step by step.

    Parameters
    ----------
    mechanism
        It is assembled from its rough pose.
    steps, span
        How to step, and the time that `Steps.largest` is a share of [s].

    Attributes
    ----------
    equations, norm
        Of the mechanism.
    solve, control
        Solver and control of its steps.
    state
        Of the integration.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, the span is not above 0, or a bore or journal that is not
        round closes its gap at the start.
    """

    def __init__(self, mechanism: Mechanism, steps: Steps, span: float):
        if not span > 0.0:
            raise SettingsError(f"end or period = {span:g} s must be above 0")
        self._system = system = System(mechanism)
        self.solve = CoupledSteps(system)
        self.equations = self.solve.equations
        self.norm = StepNorm(self.equations)
        # Order 3 feeds modes of little damping, by 5 to 10 % a step where a step is a radian of
        # theirs: a full interface without damping was 71 % off (`docs/extremes.md`). Past a node of
        # conserved oil that has just filled it overshoots (`docs/real-films.md`), and oil that
        # pressure makes denser is a spring without damping.
        damped = system.least_damping >= DAMPED and not self.equations.voids
        order = steps.order if damped else min(steps.order, 2)
        self.control = StepControl(
            steps.tolerance, steps.first, steps.smallest, steps.largest * span, order
        )
        start = initial_state(self.equations)
        check_inertia(system, start[0][: system.n])
        self.state: IntegratorState[SolverState] = IntegratorState.begin(
            self.norm, 0.0, *start, self.control
        )
        for place, gap in zip(
            system.films, self.norm.film_gaps(self.state.observed[0]), strict=True
        ):
            if place.film.shape is not None:
                _check_start(place, float(gap.min()))

    def stored_state(self) -> dict[str, Any]:
        """The state as nested dictionaries of arrays and numbers, for `load_state`."""
        state, solver = self.state, self.state.solver
        return {"integrator": state.points(), "solver": {} if solver is None else vars(solver)}

    def load_state(self, stored: Mapping[str, Any]) -> None:
        """Go on where another run of the same mechanism was.

        Raises
        ------
        InputError
            It is not the state of such a run.
        """
        with named(InputError, "the checkpoint's state"):
            require_like(stored, self.stored_state())
            solver = None
            if stored["solver"]:
                require_like(stored["solver"], self.solve.pattern(), "solver/")
                solver = SolverState(**stored["solver"])
            state = IntegratorState(**stored["integrator"], solver=solver)
            _require_sound(state)
        self.state = state

    def until(self, end: float) -> Iterator[MechanismStep]:
        """Accepted steps up to a time [s].

        Raises
        ------
        StepSizeError
            No step is short enough.
        FilmTooThinError
            After the step whose film is too thin, between smooth surfaces.
        ContactError
            After the step whose rough surfaces overlap too far.
        """
        while self.state.time < end:
            step, self.state = advance(
                self.norm, self.state, end, self.control, self.solve, self._system.tables
            )
            yield step
            gaps = self.norm.film_gaps(step.observed)
            for place, gap in zip(self._system.films, gaps, strict=True):
                _check_film(place, float(gap.min()), step.time)

    def along(
        self,
        state: IntegratorState[SolverState],
        times: Sequence[tuple[float, bool]],
        tolerance: float,
        between: Callable[[], None],
    ) -> IntegratorState[SolverState]:
        """Through given steps from a state, see `follow`; the run stays where it is."""
        for time, corner in times:
            between()
            state = follow(self.norm, state, time, corner, self.control, self.solve, tolerance)[1]
        return state


def initial_state(equations: StepEquations) -> tuple[np.ndarray, np.ndarray]:
    """State and its rate before the first step of a mechanism, assembled from its rough pose.

    Raises
    ------
    SettingsError
        It cannot be assembled.
    """
    z, rates = assemble(equations.system)
    resting = equations.resting(z)
    return np.concatenate([z, resting]), np.concatenate([rates, np.zeros(len(resting))])


def _require_sound(state: IntegratorState[SolverState]) -> None:
    """Past points of one length, finite, newest first, and a step."""
    for name, past in (("integrator", state), ("solver", state.solver)):
        if past is None:
            continue
        for key, values in vars(past).items():
            if key != "solver" and not np.isfinite(values).all():
                raise ValueError(f"{name}/{key} holds a value that is not finite")
            if np.ndim(values) and len(values) != len(past.times):
                raise ValueError(
                    f"{name}/{key} has {len(values)} rows, times has {len(past.times)}"
                )
        if not ((np.diff(past.times) < 0).all() and past.times[0] == state.time):
            raise ValueError(f"{name}/times must descend from {state.time:.9g} s")
    if not state.step > 0:
        raise ValueError(f"integrator/step = {state.step} s must be positive")


def _check_start(place: FilmPlace, thickness: float) -> None:
    if not thickness > 0.0:
        raise SettingsError(
            f"joints.{place.name}.bore_shape, journal_shape: the film is {thickness * 1e6:.3g} um "
            "thin somewhere at the start, it must be above 0: deviations must leave some of the "
            f"clearance of {place.film.clearance * 1e6:.3g} um, or give another eccentricity"
        )


def _check_film(place: FilmPlace, thickness: float, time: float) -> None:
    surfaces = place.film.film.parameters.surfaces
    if surfaces is not None:
        least = DEEPEST_CONTACT * surfaces.roughness
        if thickness < least:
            raise ContactError(
                f"the surfaces of {place.name} overlap by {-thickness * 1e6:.3g} um at "
                f"t = {time:.6g} s, beyond {-DEEPEST_CONTACT:g} times their combined roughness of "
                f"{surfaces.roughness * 1e6:.3g} um: no asperities are left that "
                f"joints.{place.name}.contact describes; the history up to there is kept"
            )
        return
    smallest = place.joint.smallest_film * place.film.clearance
    if thickness < smallest:
        raise FilmTooThinError(
            f"the film of {place.name} is {thickness * 1e6:.3g} um thin at t = {time:.6g} s, below "
            f"joints.{place.name}.smallest_film of the clearance, {smallest * 1e6:.3g} um: "
            "surfaces would touch; the history up to there is kept"
        )
