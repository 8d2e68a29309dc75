"""A slider-crank to integrate, what an integrator hands back, and how far off its curves are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from nested_film import NestedFilm
from scipy.interpolate import PchipInterpolator

from fenics_ehd.film import FilmState
from fenics_ehd.multibody.bdf import Step
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.run import build_mechanism, simulated_time
from fenics_ehd.scenes.slider_crank import SliderCrank
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

#: The first film build-up, from no pressure at all, is left out of the comparison [s].
START = 2e-4

FIRST_STEP, SMALLEST_STEP = 1e-8, 1e-13


@dataclass(frozen=True, eq=False)
class Window:
    """Times [s] between which is integrated, and the state at the first of them."""

    start: float
    end: float
    x: np.ndarray
    rate: np.ndarray


@dataclass
class Trajectory:
    """Accepted steps of one integration, and what it took.

    Attributes
    ----------
    times, pressure, film
        Of every step: time [s], peak pressure [Pa] and minimum film thickness [m].
    states
        Positions and velocities, of integrators that know no pressures: `Case.complete`
        makes the curves of them, outside the clock.
    failed
        Attempted steps that were given up.
    iterations
        Of Newton's method: solutions of a linear system.
    evaluations
        Solutions of a film nested in an evaluation, where there are any.
    """

    times: list[float] = field(default_factory=list)
    pressure: list[float] = field(default_factory=list)
    film: list[float] = field(default_factory=list)
    states: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    failed: int = 0
    iterations: int = 0
    evaluations: int = 0

    def add(self, step: Step) -> None:
        """Account for a step of the package's kind."""
        self.times.append(step.time)
        self.pressure.append(float(step.auxiliary.film.pressure.max()))
        self.film.append(float(step.watched.min()))
        self.iterations += step.newton_iterations
        self.failed += sum(step.rejected.values())

    def add_all(self, steps: Iterable[Step]) -> Trajectory:
        """Account for all steps of an integration."""
        for step in steps:
            self.add(step)
        return self


#: Integrates a case over a window with a tolerance.
Integrator = Callable[["Case", Window, float], Trajectory]


@dataclass(frozen=True, eq=False)
class Case:
    """One machine.

    Attributes
    ----------
    name
        Of the body.
    machine
        The mechanism.
    largest_step
        [s].
    """

    name: str
    machine: SliderCrank
    largest_step: float

    @classmethod
    def of(cls, body: ReducedBody, settings: SliderCrankSettings) -> Case:
        """Default scene with a body."""
        rank = body.residual.rank if body.residual is not None else 0
        name = f"{body.method}, {body.modes} modes"
        if rank:
            name += f" and {rank} quasi-static"
        largest = np.radians(settings.time.largest_step) / settings.mechanism.crank_speed
        return cls(name, build_mechanism(settings, body), largest)

    @property
    def nestable(self) -> bool:
        """Whether pressures are a function of coordinates and rates alone."""
        return self.machine.journal.compliance is None

    def from_rest(self, settings: SliderCrankSettings) -> Window:
        """The whole run of a scene."""
        rest = np.zeros(self.machine.size)
        return Window(0.0, simulated_time(settings), rest, rest)

    def complete(self, found: Trajectory) -> Trajectory:
        """With pressures and film thicknesses of positions and velocities."""
        if found.states:
            nested = NestedFilm(self.machine)
            film: FilmState | None = None
            for time, (x, rate) in zip(found.times, found.states, strict=True):
                film, _ = nested.solve_film(time, x, rate, film)
                found.pressure.append(float(film.pressure.max()))
                found.film.append(float(self.machine.watch(x).min()))
        return found


@dataclass(frozen=True, eq=False)
class Errors:
    """Largest differences from the reference.

    Attributes
    ----------
    pressure, film
        At the integrator's own steps: of the peak pressure over the peak of the reference, and
        of the minimum film thickness, relative.
    pressure_curve, film_curve
        The same of curves interpolated between the steps, as a reader of the history sees them.
    """

    pressure: float
    film: float
    pressure_curve: float
    film_curve: float

    @property
    def larger(self) -> float:
        """At the steps."""
        return max(self.pressure, self.film)

    @property
    def larger_curve(self) -> float:
        """Between the steps."""
        return max(self.pressure_curve, self.film_curve)


class Reference:
    """Curves that others are measured against.

    Pressures and gaps are interpolated point by point and the extremes taken afterwards: where
    the extreme moves from one point to the next its curve has a kink that no interpolation meets.

    Parameters
    ----------
    steps
        Of a much finer integration with the package's own formula.
    begin
        Time from which on errors count [s].
    """

    def __init__(self, steps: Sequence[Step], begin: float):
        self._begin = begin
        self.times = np.array([step.time for step in steps])
        pressures = np.stack([step.auxiliary.film.pressure for step in steps])
        self._peak = pressures.max()
        self._pressures = PchipInterpolator(self.times, pressures)
        self._gaps = PchipInterpolator(self.times, np.stack([step.watched for step in steps]))

    def curves(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Peak pressure [Pa] and minimum film thickness [m]."""
        return self._pressures(times).max(axis=1), self._gaps(times).min(axis=1)

    def errors(self, found: Trajectory) -> Errors:
        """Of another integration of the same window."""
        times = np.array(found.times)
        pressure, film = np.array(found.pressure), np.array(found.film)
        inside = (times >= self._begin) & (times <= self.times[-1])
        if not inside.any():
            return Errors(*(4 * [np.nan]))
        grid = np.linspace(times[inside][0], times[inside][-1], 4000)
        at_steps = self._largest(times[inside], pressure[inside], film[inside])
        between = PchipInterpolator(times, np.stack([pressure, film]), axis=1)(grid)
        return Errors(*at_steps, *self._largest(grid, *between))

    def _largest(
        self, times: np.ndarray, pressure: np.ndarray, film: np.ndarray
    ) -> tuple[float, float]:
        exact_pressure, exact_film = self.curves(times)
        return (
            float(np.abs(pressure - exact_pressure).max() / self._peak),
            float(np.abs(film / exact_film - 1).max()),
        )
