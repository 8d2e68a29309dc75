"""Run: time integration of a mechanism, step by step."""

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

#: Damping ratio above which the formula of order 3, which is A(82)-stable, damps a mode for every
#: length of the step.
DAMPED = float(np.cos(np.radians(82.0)))


class Run:
    """Time integration of a mechanism, with the state after the last accepted step.

    Parameters
    ----------
    mechanism
        Mechanism in its rough pose, from which it is assembled.
    steps
        Options of the integrator. Order 3 is reduced to 2 if modes have too little damping or
        cavitation conserves mass.
    span
        Time to which `IntegratorOptions.largest` is relative [s].

    Attributes
    ----------
    equations, norm
        Equations of a step of the mechanism, and norm of its errors.
    solve, control
        Solver of a step, and options of the integrator.
    state
        State of the integration after the last accepted step.

    Raises
    ------
    SettingsError
        If the mechanism cannot be assembled, the span is not above 0, or the shape of a bore or
        journal closes the gap at the start.
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
        # Order 3 amplifies modes with little damping, by 5 to 10 % in a step of one radian of their
        # phase: for a full interface without damping the error was 71 % (`docs/extremes.md`). With
        # mass-conserving cavitation it overshoots at a node that has just filled
        # (`docs/real-films.md`), and compressible oil acts like a spring without damping.
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
        """Set the solver of steps, the norm of their errors, the options and the state."""
        self.solve = solve
        self.equations = solve.equations
        self._system = solve.system
        self.norm = norm
        self.control = control
        self.state = state

    def with_mechanism(self, mechanism: Mechanism) -> Run:
        """Make a run of another mechanism, with the options and temperatures of this run."""
        run = Run(mechanism, self.control, 1.0)
        run.control = self.control
        for binding, former in zip(run._system.films, self._system.films, strict=True):
            temperature = former.film.film.equation.lubricant.temperature
            if binding.joint.heat is not None and temperature is not None:
                binding.film.film.set_temperature(temperature)
        return run

    def until(self, end: float) -> Iterator[MechanismStep]:
        """Yield the accepted steps up to a time [s].

        Raises
        ------
        StepSizeError
            If no step is short enough.
        FilmTooThinError
            If the film between smooth surfaces is too thin, after the step is returned.
        ContactError
            If rough surfaces overlap too far, after the step is returned.
        """
        while self.state.time < end:
            step, self.state = advance(
                self.norm, self.state, end, self.control, self.solve, self._system.tables
            )
            yield step
            for joint in step.solution.joints:
                _check_film(joint.binding, float(joint.gap.min()), step.time)


def _check_density(film: FilmModel[Any]) -> None:
    # With compressible oil, the storage term of the first steps is a mass matrix, with which the
    # active sets of the Reynolds condition cycle.
    if not (film.conserves_oil or film.film.parameters.lubricant.density_law.constant):
        raise SettingsError(
            f"joints.{film.binding.name}: density_law = 'dowson-higginson' (compressible oil) "
            "needs cavitation = 'mass-conserving'"
        )


def _check_start(binding: FilmBinding, thickness: float) -> None:
    if not thickness > 0.0:
        raise SettingsError(
            f"joints.{binding.name}.bore_shape, journal_shape: the smallest film thickness at the "
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
                f"{surfaces.roughness * 1e6:.3g} um, the limit of joints.{binding.name}.contact: "
                "lower the load"
            )
        return
    limit, reason = touching_film(binding.name, binding.joint.smallest_film, binding.film.clearance)
    if thickness < limit:
        raise FilmTooThinError(
            f"the film of {binding.name} is {thickness * 1e6:.3g} um thin at t = {time:.6g} s, "
            f"below {reason}, {limit * 1e6:.3g} um: surfaces would touch: lower the load"
        )


#: Film thickness at which surfaces without a given roughness touch [m], for every clearance: three
#: times a combined roughness of 0.07 um. For surfaces with a roughness a contact model is used.
TOUCHING = 0.2e-6

#: Largest `smallest_film` of a joint, over the clearance, which `TOUCHING` limits. Larger values
#: are assumed to be intended.
MEANT = 0.01


def touching_film(name: str, share: float, clearance: float) -> tuple[float, str]:
    """Film thickness between smooth surfaces below which a run ends [m], and name of this limit.

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
        return TOUCHING, "the smallest film of surfaces without a roughness"
    return thickness, f"joints.{name}.smallest_film = {share:g} of the clearance"
