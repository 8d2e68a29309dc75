"""A run: a mechanism, its state and the integration of its motion, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import attrs
import numpy as np

from fenics_ehd.base.errors import ContactError, FilmTooThinError, SettingsError
from fenics_ehd.film.rough_surfaces import DEEPEST_CONTACT
from fenics_ehd.multibody.bdf import IntegratorOptions, IntegratorState, advance
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.film_models import FilmModel
from fenics_ehd.multibody.mechanism import Mechanism, System, assemble, check_inertia
from fenics_ehd.multibody.newton import CoupledSteps, MechanismStep, SolverState
from fenics_ehd.multibody.step_norm import StepNorm

#: Damping ratio above which the formula of order 3 damps a mode at every step: it is A(82)-stable.
DAMPED = float(np.cos(np.radians(82.0)))


class Run:
    """A mechanism and its state, which each accepted step changes.

    Parameters
    ----------
    mechanism
        Assembled from its rough pose.
    steps
        Step control. Order 3 becomes 2 if modes lack damping or cavitation conserves mass.
    span
        Time that `IntegratorOptions.largest` is a share of [s].

    Attributes
    ----------
    equations, norm
        Equations of a step of the mechanism, and norm of the errors of its gaps.
    solve, control
        Solver and control of the steps.
    state
        State of the integration after the last accepted step.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, the span is not above 0, or a bore or journal that is not
        round closes its gap at the start.
    """

    def __init__(self, mechanism: Mechanism, steps: IntegratorOptions, span: float):
        if not span > 0.0:
            raise SettingsError(f"end or period = {span:g} s must be above 0")
        system = System(mechanism)
        solve = CoupledSteps(system)
        equations = solve.equations
        for film in equations.films:
            _check_density(film)
        norm = StepNorm(equations)
        # Order 3 amplifies modes of little damping, by 5 to 10 % a step of one radian of their
        # phase: a full interface without damping was 71 % off (`docs/extremes.md`). With
        # mass-conserving cavitation it overshoots at a node that has just filled
        # (`docs/real-films.md`), and compressible oil is a spring without damping.
        damped = system.least_damping >= DAMPED and not equations.conserves_oil
        order = steps.order if damped else min(steps.order, 2)
        control = attrs.evolve(steps, order=order, largest=steps.largest * span)
        z, rates = assemble(system)
        check_inertia(system, z)
        resting = equations.resting(z)
        x = np.concatenate([z, resting])
        rate = np.concatenate([rates, np.zeros(len(resting))])
        self._begin(solve, norm, control, IntegratorState.begin(norm, 0.0, x, rate, control))
        gaps = norm.film_gaps(self.state.observed[0])
        for binding, gap in zip(system.films, gaps, strict=True):
            if not binding.film.plain:
                _check_start(binding, float(gap.min()))

    def _begin(
        self,
        solve: CoupledSteps,
        norm: StepNorm,
        control: IntegratorOptions,
        state: IntegratorState[SolverState],
    ) -> None:
        """Begin in a state; a solver takes the steps, a norm measures their errors."""
        self.solve = solve
        self.equations = solve.equations
        self._system = solve.system
        self.norm = norm
        self.control = control
        self.state = state

    def with_mechanism(self, mechanism: Mechanism) -> Run:
        """Run of another mechanism at its start, with the formula and temperatures of this run."""
        run = Run(mechanism, self.control, 1.0)
        run.control = self.control
        for binding, former in zip(run._system.films, self._system.films, strict=True):
            temperature = former.film.film.equation.lubricant.temperature
            if binding.joint.heat is not None and temperature is not None:
                binding.film.film.set_temperature(temperature)
        return run

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
            for joint in step.solution.joints:
                _check_film(joint.binding, float(joint.gap.min()), step.time)


def _check_density(film: FilmModel[Any]) -> None:
    # The storage term of the first steps is a mass matrix, with which active sets cycle.
    if not (film.conserves_oil or film.film.parameters.lubricant.density_law.constant):
        raise SettingsError(
            f"joints.{film.binding.name}: the oil is denser under pressure: density_law = "
            "'dowson-higginson' needs cavitation = 'mass-conserving'"
        )


def _check_start(binding: FilmBinding, thickness: float) -> None:
    if not thickness > 0.0:
        raise SettingsError(
            f"joints.{binding.name}.bore_shape, journal_shape: the least film thickness at the "
            f"start is {thickness * 1e6:.3g} um and must be above 0: give smaller deviations, "
            f"below the clearance of {binding.film.clearance * 1e6:.3g} um, or another eccentricity"
        )


def _check_film(binding: FilmBinding, thickness: float, time: float) -> None:
    surfaces = binding.film.film.parameters.surfaces
    if surfaces is not None:
        least = DEEPEST_CONTACT * surfaces.roughness
        if thickness < least:
            raise ContactError(
                f"the surfaces of {binding.name} overlap by {-thickness * 1e6:.3g} um at "
                f"t = {time:.6g} s, beyond {-DEEPEST_CONTACT:g} times their combined roughness of "
                f"{surfaces.roughness * 1e6:.3g} um: no asperities are left that "
                f"joints.{binding.name}.contact describes; the history up to there is kept"
            )
        return
    limit, reason = touching_film(binding.name, binding.joint.smallest_film, binding.film.clearance)
    if thickness < limit:
        raise FilmTooThinError(
            f"the film of {binding.name} is {thickness * 1e6:.3g} um thin at t = {time:.6g} s, "
            f"below {reason}, {limit * 1e6:.3g} um: surfaces would touch; "
            "the history up to there is kept"
        )


#: Film thickness at which surfaces without a given roughness touch, for every clearance [m]: three
#: times a combined roughness of 0.07 um. Surfaces with a roughness have a model of contact instead.
TOUCHING = 0.2e-6

#: Share of the clearance up to which a joint's `smallest_film` counts as a default, which
#: `TOUCHING` limits. Larger values hold as they are.
MEANT = 0.01


def touching_film(name: str, share: float, clearance: float) -> tuple[float, str]:
    """Film thickness between smooth surfaces at which a run ends [m], and the origin of the limit.

    Parameters
    ----------
    name
        Name of the joint.
    share
        `smallest_film` of the joint, relative to the clearance.
    clearance
        Radial clearance of the joint [m].
    """
    thickness = share * clearance
    if share <= MEANT and thickness > TOUCHING:
        return TOUCHING, "the least film of surfaces without a roughness"
    return thickness, f"joints.{name}.smallest_film of the clearance"
