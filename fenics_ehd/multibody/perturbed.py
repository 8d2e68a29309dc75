"""The equations of a step in a mechanism of which one number is a little different.

Same unknowns, same active sets, same steps: what the equations then lack is the derivative along
that number. Steps keep their share of the time to simulate, or of the period, where the number
changes that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.errors import SensitivityError
from fenics_ehd.film import FilmState
from fenics_ehd.film.shear import in_full_film
from fenics_ehd.multibody.bdf import Step
from fenics_ehd.multibody.cycle_record import Unknowns, implicit_step
from fenics_ehd.multibody.film_extremes import FilmRows, FilmStencils
from fenics_ehd.multibody.implicit_step import ImplicitStep
from fenics_ehd.multibody.joint_columns import joint_columns
from fenics_ehd.multibody.joint_rates import joint_rates
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.run import initial_state
from fenics_ehd.multibody.solver_state import CoupledState, MechanismStep
from fenics_ehd.multibody.step_equations import Point, StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.system import System

#: Columns of a history at one step, by joint and name.
Columns = dict[str, dict[str, float]]

#: Values at points of some films, by the film's number.
Masks = Mapping[int, np.ndarray]


@dataclass(frozen=True, eq=False)
class Held:
    """What columns are differentiated with, as it is.

    Attributes
    ----------
    full
        Gauss points in full film, of the films in `StepView.sheared`.
    extremes
        Where every film has its extremes.
    """

    full: Masks
    extremes: Sequence[FilmStencils]


class StepView:
    """Equations of steps that are known, and what a history has of them.

    Parameters
    ----------
    equations, norm
        Of a mechanism.
    """

    def __init__(self, equations: StepEquations, norm: StepNorm):
        self.equations, self.norm = equations, norm
        self._rows = [FilmRows(place) for place in equations.system.films]
        size = equations.system.n + equations.responses.size
        self._none = norm.observe(np.zeros(size))

    def observed(self, direction: np.ndarray) -> np.ndarray:
        """What the steps observe of a derivative of the state, shape of `StepNorm.observe`."""
        return self.norm.observe(direction) - self._none

    def contents(self, x: np.ndarray) -> np.ndarray:
        """Oil in a state of the films that keep account of it, over what a round one holds."""
        equations, voids = self.equations, self.equations.voids
        if not voids:
            return np.zeros(0)
        gaps = self.norm.film_gaps(self.norm.observe(x))
        balances = [equations.oil(i).balance for i in voids]
        rounds = [own.volume_scale * own.assembly.area.sum() for own in balances]
        return np.array(equations.contents(x, gaps)) / rounds

    @property
    def sheared(self) -> list[int]:
        """Numbers of the films of which columns depend on the share of the oil that is sheared."""
        places = enumerate(self.equations.system.films)
        return [i for i, own in places if own.film.friction or own.joint.heat is not None]

    def full(self, pressures: Masks) -> Masks:
        """Gauss points in full film of the films in `sheared`, by pressures of all their nodes."""
        films = self.equations.system.films
        return {
            i: in_full_film(films[i].film.film.assembly.at_points(pressures[i])[0])
            for i in self.sheared
        }

    def held(self, point: Point) -> Held:
        """What is kept of a step."""
        gaps = self.norm.film_gaps(self.norm.observe(self.equations.state(point)[0]))
        extremes = []
        for rows, own, gap in zip(self._rows, point.films, gaps, strict=True):
            contact = None if own.touch is None else own.touch.pressure
            extremes.append(rows.stencils(own.nodal, gap, contact))
        return Held(self.full({i: point.films[i].nodal for i in self.sheared}), extremes)

    def columns(self, asked: ImplicitStep, point: Point, held: Held) -> Columns:
        """Columns of every lubricated joint at the end of a step, by the joint's name.

        Extremes over a film are those of parabolas (`film_extremes`).

        Parameters
        ----------
        asked, point
            The step, and its equations.
        held
            See there: the oil that is sheared jumps where a point fills.
        """
        equations = self.equations
        x, rate = equations.state(point)
        films = self._films(point)
        for i, mask in held.full.items():
            films[i] = replace(films[i], full=mask)
        step: MechanismStep = Step(
            asked.time,
            x,
            rate,
            asked.acceleration(rate),
            self.norm.observe(x),
            CoupledState(films, point.motion, equations.integrals(films)),
            0,
        )
        gaps = self.norm.film_gaps(step.observed)
        found = {}
        for place, own, gap, extremes in zip(
            equations.system.films, step.solution.integrals, gaps, held.extremes, strict=True
        ):
            columns = joint_columns(place, step, own.state, gap)
            columns["max_pressure_Pa"] = extremes.pressure.of(own.state.pressure)
            columns["min_film_thickness_m"] = extremes.gap.of(gap)
            if extremes.contact is not None:
                columns["max_contact_pressure_Pa"] = extremes.contact.of(own.touch.pressure)
            found[place.name] = columns | joint_rates(place, step, own)
        return found

    def _films(self, point: Point) -> list[FilmState]:
        """States of the films, whatever is left of their complementarity."""
        films: list[FilmState] = []
        for i, (place, own) in enumerate(
            zip(self.equations.system.films, point.films, strict=True)
        ):
            if own.oil is None:
                films.append(self.equations.film_state(place, own))
            else:
                full = np.flatnonzero(own.oil.values > 0.0)
                films.append(self.equations.oil(i).state(own, own.oil, (full, 0), np.inf))
        return films


class Perturbed(StepView):
    """A mechanism with one number changed a little.

    Parameters
    ----------
    mechanism
        With the number changed.
    amount
        By which it is, over its scale.
    span
        Time to simulate or period, over that of the unchanged mechanism.
    base
        Equations of the unchanged mechanism.
    temperatures
        Of films whose heat is balanced, by the joint's name [C].

    Raises
    ------
    SensitivityError
        It has not the unknowns of the unchanged mechanism.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        amount: float,
        span: float,
        base: StepEquations,
        temperatures: Mapping[str, float],
    ):
        system = System(mechanism)
        for place in system.films:
            if place.name in temperatures:
                place.film.film.warm(temperatures[place.name])
        equations = StepEquations(system, dense_limit=0)
        if _structure(equations) != _structure(base):
            raise SensitivityError("the mechanism has other unknowns")
        super().__init__(equations, StepNorm(equations))
        self.amount, self.span = amount, span
        pairs = zip(base.system.films, system.films, strict=True)
        self._scales = [
            a.film.film.parameters.pressure_scale / b.film.film.parameters.pressure_scale
            for a, b in pairs
        ]

    def start(self, start: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of x and its rate at the start of a run along the number, over its scale."""
        moved = initial_state(self.equations)
        x, rate = ((own - former) / self.amount for own, former in zip(moved, start, strict=True))
        return x, rate

    def begin(
        self,
        asked: ImplicitStep,
        past: tuple[np.ndarray, np.ndarray],
        filled: Mapping[str, np.ndarray],
    ) -> None:
        """Take a step of the unchanged mechanism, its past moved along two directions.

        Parameters
        ----------
        asked
            Of the unchanged mechanism.
        past
            Derivatives of ``past_x`` and ``past_rate`` along the number, over its scale.
        filled
            See `StepEquations.hold_filled`.
        """
        self._asked = implicit_step(
            asked.time * self.span,
            asked.shift / self.span,
            (asked.past_x + self.amount * past[0]) / self.span,
            (asked.past_rate + self.amount * past[1]) / self.span,
        )
        self.equations.begin(self._asked)
        self.equations.hold_filled(filled)

    def evaluate(self, unknowns: Unknowns, direction: Unknowns) -> Point:
        """All equations, the unknowns moved with the number along a direction."""
        there = unknowns.moved(direction, self.amount)
        films = [scale * own for scale, own in zip(self._scales, there.films, strict=True)]
        return self.equations.evaluate(films, there.rest, there.voids)

    def columns_at(self, point: Point, held: Held) -> Columns:
        """See `StepView.columns`."""
        return self.columns(self._asked, point, held)


def _structure(equations: StepEquations) -> tuple:
    """All numbers of unknowns, and what each of them is."""
    system = equations.system
    return (
        system.n,
        system.m,
        equations.responses.size,
        tuple(equations.sizes),
        tuple(equations.voids),
        tuple(place.film.film.assembly.size for place in system.films),
        tuple(tuple(place.xi) for place in system.films),
        equations.contacts is None,
    )
