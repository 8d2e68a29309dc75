"""Periodic solutions: a run is continued cycle by cycle until its films repeat.

A cycle begins at the end of the cycle before, or at an extrapolation of the ends of several cycles.
Films whose heat is balanced over a cycle begin it with new effective temperatures. This module also
collects the periods of loads and drives, of which a cycle must be a multiple, and chooses the
reference angle of a mechanism, over which curves are drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from fenics_ehd.base.errors import (
    FilmTooThinError,
    HeatError,
    PeriodicityError,
    SettingsError,
    StepSizeError,
)
from fenics_ehd.base.layout import Group, Stateful, Value
from fenics_ehd.film.heat import TemperatureSearch
from fenics_ehd.film.lubricant import TemperatureLaw
from fenics_ehd.multibody.cycle import Recurrence
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.mechanism import Mechanism, System
from fenics_ehd.multibody.newton import INTEGRATOR_STATE, MechanismStep
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tabulated import Curve
from fenics_ehd.multibody.trust import integral


def reference_angle(system: System) -> int | None:
    """Index of the reference angle among the coordinates of a mechanism; None without angles.

    It is the angle of the body that the first drive by name turns. Without drives it is that of the
    body on which the first torque acts, else that of the first journal that turns, else that of the
    first body with an angle.
    """
    mechanism = system.mechanism
    angles = system.angles

    def candidates() -> Iterator[int | None]:
        yield from (angles.get(name) for name in sorted(mechanism.drives))
        forces = (mechanism.forces[name] for name in sorted(mechanism.forces))
        yield from (angles.get(force.turned_body) for force in forces)
        yield from (journal.angle for _, journal in (film.surfaces for film in system.films))
        yield from angles.values()

    return next((index for index in candidates() if index is not None), None)


#: Largest relative change of the films over a cycle for which the next start is extrapolated.
NEAR = 0.3

#: Largest number of cycles from which the next start is extrapolated.
REMEMBERED = 6

#: Largest relative decrease of a film thickness by the extrapolation of a start.
THINNER = 0.3

#: Directions of changes, scaled to length 1, count as noise if they differ by less from the others.
NOISE = 1e-2

#: Change of the films over a cycle that may be noise, over the tolerance of the steps. The noise
#: arises because every cycle has other steps. It is up to 1 for a small journal under a load of
#: five rows, and for the pin of a four-bar.
CYCLE_NOISE = 1.0

#: Relative rounding of the time from which all loads recur.
ROUNDING = 1e-9

#: Largest multiple of the period that a message proposes if loads do not recur with the period.
LONGEST = 12

#: Numbers of cycles after which films in a subharmonic whirl may repeat.
SUBHARMONIC = (2, 3)


def repeating(mechanism: Mechanism) -> tuple[float, str]:
    """Time from which all loads and drives are periodic [s], and key of the one that is last."""
    over_time = ((key, each) for key, each in mechanism.variations() if not each.angle_of)
    return max([(0.0, ""), *((each.settled, key) for key, each in over_time)])


def recurrence_of(system: System) -> Recurrence:
    """Change of the reference angle, and time, after which all loads of a mechanism recur."""
    degrees = [360.0]
    seconds = [0.0]
    for _, each in system.mechanism.variations():
        if each.angle_of:
            degrees.append(float(np.degrees(each.period)))
        else:
            seconds.append(each.period)
    return Recurrence(max(degrees), max(seconds))


def repeats(mechanism: Mechanism, period: float) -> dict[str, float]:
    """Number of periods of every load, drive and supply in a cycle, by key.

    `period` is the length of the cycle [s]. Turns of a driven body count if it is not axisymmetric.
    """
    counts: dict[str, float] = {}
    begins = repeating(mechanism)[0]
    turned = {
        name: abs(motion(begins + period)[0] - motion(begins)[0])
        for name, motion in mechanism.drives.items()
    }
    for key, each in mechanism.variations():
        if each.period and (not each.angle_of or each.angle_of in turned):
            length = turned[each.angle_of] if each.angle_of else period
            counts[key] = length / each.period
    for name, angle in turned.items():
        body = mechanism.bodies.get(name)
        if body is not None and not body.axisymmetric:
            counts[f"drives.{name}"] = angle / (2 * np.pi)
    return counts


def check_period(
    mechanism: Mechanism,
    period: float,
    periodicity: float,
    supplies: Mapping[str, Curve] | None = None,
) -> None:
    """Refuse a cycle after which loads and drives do not recur.

    Parameters
    ----------
    mechanism, period
        The mechanism, and the length of the cycle [s].
    periodicity
        Largest difference in phase between the start and the end of the cycle [rad].
    supplies
        Supply pressures over time, by key, of films that the mechanism does not have yet.

    Raises
    ------
    SettingsError
        If a load, drive or supply does not recur; the message has its key and a factor for the
        period.
    """
    counts = repeats(mechanism, period)
    for key, pressure in (supplies or {}).items():
        counts.update((key, period / each.period) for each in pressure.variations if each.period)
    for key, count in counts.items():
        off = {n: abs(n * count - round(n * count)) / n for n in range(1, LONGEST + 1)}
        if 2 * np.pi * off[1] > periodicity:
            factor = next((n for n, error in off.items() if 2 * np.pi * error <= periodicity), 0)
            longer = f"{factor} times as long, or change" if factor else "another, or change"
            raise SettingsError(
                f"{key} repeats {count:.9g} times in the cycle of {period:g} s, but this number "
                f"must be whole: make time.revolutions or time.period {longer} the period of {key}"
            )


def temperatures(binding: FilmBinding, means: Mapping[str, float]) -> dict[str, float]:
    """Entries of the summary about the temperatures of a joint's film [C].

    They are computed from the means of power and flow. They are empty if the heat of the joint is
    not balanced.
    """
    heat = binding.joint.heat
    temperature = binding.film.film.equation.lubricant.temperature
    if heat is None or temperature is None or not means:
        return {}
    power, flow = (means[name] for name in ("dissipated_power_W", "leaving_flow_m3_per_s"))
    return {
        "supply_temperature_C": heat.supply_temperature,
        "effective_temperature_C": temperature,
        "outlet_temperature_C": heat.outlet(_oil(binding), temperature, power, flow),
    }


def _oil(binding: FilmBinding) -> TemperatureLaw:
    oil = binding.film.film.parameters.lubricant.oil
    assert oil is not None  # `LubricatedJoint` refuses heat without it
    return oil


class FilmTemperatures(Stateful):
    """Effective temperatures of the films whose heat is balanced over a cycle.

    Parameters
    ----------
    bindings
        Bindings of all films. Films of joints with `LubricatedJoint.heat` begin at the supply
        temperature; other films are not changed.

    Attributes
    ----------
    thinning
        Estimated relative decrease of the film thickness due to the last change of temperature, for
        each of the `count` films, shape (count,). The thickness is assumed to change as the square
        root of the viscosity.
    times, rates
        Times [s] of k steps, up to three of the former cycle and then those of the current cycle,
        shape (k,); power [W] and flow [m3/s] of every film at these times, shape (k, 2 count).
    first
        Index of the step at the start of the cycle in `times`.
    """

    carried: ClassVar = {
        "searches": Group(each=Group(TemperatureSearch.carried)),
        "times": Value("float", ("TIMES",)),
        "rates": Value("float", ("TIMES", "rates")),
        "first": Value("integer", least=0),
    }

    def __init__(self, bindings: Sequence[FilmBinding]):
        self._bindings = {
            i: binding for i, binding in enumerate(bindings) if binding.joint.heat is not None
        }
        self.searches: dict[str, TemperatureSearch] = {}
        for binding in self._bindings.values():
            assert binding.joint.heat is not None
            self.searches[binding.name] = TemperatureSearch(
                binding.joint.heat, _oil(binding), f"joints.{binding.name}.heat"
            )
        self.count = len(self.searches)
        self.times = np.zeros(0)
        self.rates = np.zeros((0, 2 * self.count))
        self.first = 0
        self.thinning = np.zeros(self.count)
        self._resume()

    def _resume(self) -> None:
        """Set the temperature of each film to the present estimate of its `TemperatureSearch`."""
        for binding in self._bindings.values():
            binding.film.film.set_temperature(self.searches[binding.name].temperature)

    def add(self, step: MechanismStep) -> None:
        """Add power and flow of every film in an accepted step of the current cycle."""
        joints = [step.solution.joints[i] for i in self._bindings]
        rates = [rate for joint in joints for rate in (joint.dissipated, joint.flows.leaving)]
        self.times = np.append(self.times, step.time)
        self.rates = np.vstack([self.rates, rates])

    def _balances(self) -> Iterator[tuple[str, TemperatureSearch, list[float]]]:
        """Yield the name of every film, its temperature search, and its mean power and flow.

        Means are those over the current cycle [W], [m3/s].
        """
        if not self.count:
            return
        integrals = integral(self.times, self.rates, self.first)
        means = (integrals / (self.times[-1] - self.times[self.first])).reshape(-1, 2)
        for (name, search), mean in zip(self.searches.items(), means.tolist(), strict=True):
            yield name, search, mean

    def unsettled(self) -> str:
        """Message about the first film whose heat is not balanced; empty if there is none."""
        for name, search, means in self._balances():
            if not search.settled(*means):
                return (
                    f"the effective temperature of {name}, {search.temperature:.4g} C, differs by "
                    f"{search.defect(*means):.2g} K from its balance, above "
                    f"joints.{name}.heat.tolerance = {search.heat.tolerance:g} K"
                )
        return ""

    def move(self) -> None:
        """Set new temperatures, for the next cycle, of the films whose heat is not balanced.

        Balanced temperatures are not changed, because every change leads to other time steps.

        Raises
        ------
        HeatError
            If no temperature balances the heat of a film.
        """
        for i, (_, search, means) in enumerate(self._balances()):
            self.thinning[i] = 0.0
            if search.settled(*means):
                continue
            before = search.viscosity
            search.move(*means)
            self.thinning[i] = 0.5 * np.log(before / search.viscosity)
        self.times = self.times[-3:]
        self.rates = self.rates[-3:]
        self.first = len(self.times) - 1
        self._resume()

    def end(self) -> np.ndarray:
        """Temperatures of the films at the end of a cycle [C], and zeros as their rates.

        The shape is (2, count), that of states from which the next start is extrapolated.
        """
        temperatures = [search.temperature for search in self.searches.values()]
        return np.stack([temperatures, np.zeros(self.count)])

    def shift(self, change: np.ndarray) -> None:
        """Add changes, shape (count,) [K], to those temperatures that the last `move` changed."""
        each = zip(self.searches.values(), change.tolist(), self.thinning, strict=True)
        for search, shift, moved in each:
            if moved:
                search.shift(shift)
        self._resume()

    def failed(self, error: Exception) -> HeatError | None:
        """Heat error that explains an error in a cycle; None if the heat can be balanced."""
        causes = (search.cause_of(error) for search in self.searches.values())
        return next(filter(None, causes), None)


class PeriodicSolver(Stateful):
    """Search for a periodic solution: steps of a run until no film changes over a cycle.

    If the heat of a joint is balanced, the temperature of its film changes with every cycle, and
    the search ends only when the heat is balanced. Cycles before the time from which all loads and
    drives recur cannot end the search, see `repeating`.

    A cycle maps its start to its end. If the films are near to periodic, the next start is
    extrapolated: it is the combination of earlier ends for which the same combination of the
    changes over the cycles is smallest (Anderson 1965).

    Parameters
    ----------
    run
        Run at its start.
    period
        Common period of all drives and forces [s].
    periodicity
        Largest relative change of a film thickness from the start of a cycle to its end; with
        mass-conserving cavitation, of the oil content, too.
    most
        Largest number of cycles.

    Attributes
    ----------
    periodicity, most
        Arguments of the constructor.
    number
        Number of the current cycle, from 1.
    defect
        Largest relative change of a film over the last complete cycle [-].
    angles
        Indices of the angles of all bodies among the coordinates.
    began
        State of the integration at the start of the current cycle.
    moved
        Relative difference between the gaps at the starts of the last two complete cycles, root
        mean square [-].
    left
        Relative change of the gaps over the last complete cycle, root mean square [-].
    contraction
        Difference between the gaps at the ends of the last two complete cycles, over the difference
        at their starts [-].

    Raises
    ------
    SettingsError
        If the mechanism has no film, or loads and drives do not recur (`check_period`).
    """

    carried: ClassVar = {
        "number": Value("integer", least=1),
        **dict.fromkeys(("defect", "moved", "left", "contraction"), Value("real", finite=False)),
        "gaps": Value("float", ("gaps",)),
        "contents": Value("float", ("contents",)),
        "former": Value("float", ("FORMER", "gaps")),
        "starts": Value("float", ("STARTS", "gaps")),
        "ends": Value("float", ("ENDS", 2, "ends")),
        "changes": Value("float", ("ENDS", "changes")),
        "began": INTEGRATOR_STATE,
        "heat": Group(FilmTemperatures.carried),
    }

    def __init__(self, run: Run, period: float, periodicity: float = 1e-4, most: int = 20):
        if not run.equations.system.films:
            raise SettingsError(
                "a mechanism without a lubricated joint has no film to repeat: simulate it to an "
                "end time"
            )
        self._run = run
        self.period = period
        self.periodicity = periodicity
        self.most = most
        self.number = 1
        self.defect = float("nan")
        self.began = run.state
        self.moved = self.left = self.contraction = float("nan")
        self.former = self.starts = np.zeros((0, len(self._films())))
        system = run.equations.system
        check_period(system.mechanism, period, periodicity)
        self.angles = [*system.angles.values()]
        self.gaps = self._films()
        self.contents = self._oil()
        self.heat = FilmTemperatures(system.films)
        self.ends = np.zeros((0, 2, run.state.x.shape[1] + self.heat.count))
        self.changes = np.zeros((0, len(self.gaps) + self.heat.count))
        self._repeats, self._changing = repeating(system.mechanism)
        self._counted = int(np.ceil(self._repeats * (1.0 - ROUNDING) / period)) + 1

    @property
    def start(self) -> float:
        """Time at the start of the current cycle [s]."""
        return (self.number - 1) * self.period

    def restarted(self, run: Run, period: float, periodicity: float, most: int) -> PeriodicSolver:
        """Make a search that continues with another run, and with the temperatures of this search.

        Parameters
        ----------
        run
            Run at the end of a cycle; its films are compared with those at the end of the next one.
        period, periodicity
            Arguments of `PeriodicSolver`.
        most
            Largest number of further cycles.
        """
        completed = round(run.state.time / period)
        search = PeriodicSolver(run, period, periodicity, completed + most)
        search.number = completed + 1
        search.heat.state = search.heat.state | {"searches": self.heat.state["searches"]}
        return search

    def figures(self) -> dict[str, float]:
        """Entries of ``summary.json`` about the search for a periodic solution."""
        return {"cycles": self.number, "periodicity_defect": self.defect}

    def _films(self) -> np.ndarray:
        return self._run.norm.gaps(self._run.state.observed[0])

    def _oil(self) -> np.ndarray:
        """Oil content of every film [m^3]; 0 without mass-conserving cavitation."""
        state = self._run.state
        norm = self._run.norm
        gaps = norm.film_gaps(state.observed[0])
        return self._run.equations.contents(state.x[0], gaps)

    def __iter__(self) -> Iterator[MechanismStep]:
        """Yield the accepted steps of all cycles.

        Raises
        ------
        PeriodicityError
            If films, loads or drives still change after the largest number of cycles.
        HeatError
            If no temperature balances the heat of a film.
        StepSizeError, FilmTooThinError
            If `Run.until` raises one of them.
        """
        if self._counted > self.most:
            raise PeriodicityError(
                f"{self._changing} changes until {self._repeats:g} s, so that cycle {self._counted}"
                f" is the first that can repeat (a cycle takes {self.period:g} s), "
                f"above cycles = {self.most}: allow more cycles, or let {self._changing} end sooner"
            )
        while True:
            yield from self._steps()
            gaps = self._films()
            change = gaps - self.gaps
            lengths = self._run.norm.lengths(gaps)
            self.defect = float(np.max(np.abs(change) / lengths))
            # A search that is resumed at the end of a cycle repeats this comparison: its data are
            # not changed before the next cycle begins.
            ends = np.stack([self.gaps, gaps])
            self._compare(ends, lengths)
            starts = np.concatenate([self.starts, ends[:1]])
            contents = self._oil()
            drained = np.abs(contents - self.contents) / np.maximum(contents, np.finfo(float).tiny)
            self.defect = max(self.defect, float(drained.max(initial=0.0)))
            # The films build up over the first cycle: small changes over it are a coincidence.
            off = self.heat.unsettled()
            repeats = self.number >= max(self._counted, 2) and self.defect <= self.periodicity
            if repeats and not off:
                return
            self._check_subharmonic(gaps, lengths, starts)
            if self.number >= self.most:
                still = off or (
                    f"the films still change by {self.defect:.2e} from cycle to cycle, above "
                    f"periodicity = {self.periodicity:g}"
                )
                cure = "allow more cycles or check the loads"
                tolerance = self._run.control.tolerance
                if not off and self.defect < tolerance:
                    cure = (
                        "the step-size error is of the same size: lower time.tolerance = "
                        f"{tolerance:g}"
                    )
                elif not off and tolerance > self.periodicity:
                    cure += f", or lower time.tolerance = {tolerance:g}, which is above periodicity"
                raise PeriodicityError(
                    f"after cycles = {self.number} of {self.period:g} s {still}: {cure}"
                )
            self.heat.move()
            self.former = ends
            self.starts = starts[-max(SUBHARMONIC) :]
            self._begin(change)
            self.began = self._run.state
            self.contents = self._oil()
            self.number += 1

    def _check_subharmonic(self, gaps: np.ndarray, lengths: np.ndarray, starts: np.ndarray) -> None:
        """Refuse films that repeat after two or three cycles, but not after one.

        Raises
        ------
        PeriodicityError
            If the films repeat after two or three cycles; the message has this number.
        """
        for k in SUBHARMONIC:
            if self.defect < NEAR or len(starts) < k:
                return  # a start was extrapolated within these cycles
            change = float(np.max(np.abs(gaps - starts[-k]) / lengths))
            if change <= self.periodicity:
                what = "half-frequency whirl" if k == 2 else "whirl at a third of the frequency"
                raise PeriodicityError(
                    f"the films change by {self.defect:.2g} from cycle to cycle, but repeat every "
                    f"{k} cycles of {self.period:g} s with a change of {change:.1e}, as in {what}: "
                    f"make time.revolutions or time.period {k} times as long"
                )

    def _compare(self, ends: np.ndarray, lengths: np.ndarray) -> None:
        """Set `moved`, `left` and `contraction` from the gaps at the start and end of a cycle.

        `ends` has both, shape (2, g) [m]; `lengths` are those to which changes are relative [m].
        """
        if len(self.former):
            self.moved, distance = (
                float(np.sqrt(np.mean((change / lengths) ** 2))) for change in ends - self.former
            )
            self.contraction = distance / self.moved if self.moved else 0.0
        self.left = float(np.sqrt(np.mean(((ends[1] - ends[0]) / lengths) ** 2)))

    def _steps(self) -> Iterator[MechanismStep]:
        """Yield the accepted steps up to the end of the current cycle."""
        try:
            for step in self._run.until(self.number * self.period):
                self.heat.add(step)
                yield step
        except (FilmTooThinError, StepSizeError) as error:
            heat = self.heat.failed(error)
            if heat is None:
                raise
            raise heat from error

    def _begin(self, change: np.ndarray) -> None:
        """Begin the next cycle, with an extrapolated start if earlier cycles were near to periodic.

        `change` is the change of the gaps over the last cycle [m].
        """
        state = self._run.state
        norm = self._run.norm
        heat = self.heat
        n = state.x.shape[1]
        gaps = self._films()
        end = np.stack([state.x[0], state.rate[0]])
        near = self.number >= self._counted and self.defect < NEAR
        scales = norm.lengths(gaps)
        # Temperatures are extrapolated like coordinates, and their defects like changes of films.
        end = np.hstack([end, heat.end()])
        scales = np.concatenate([scales, np.ones(heat.count)])
        change = np.concatenate([change, np.sqrt(len(gaps)) * heat.thinning])
        if not np.abs(heat.thinning).max(initial=0.0) < NEAR:
            near = False
            self.ends = self.ends[:0]
            self.changes = self.changes[:0]
        if near:
            self.ends = np.concatenate([self.ends, end[None]])[-REMEMBERED:]
            self.changes = np.concatenate([self.changes, change[None]])[-REMEMBERED:]
            self.starts = self.starts[:0]
        if len(self.ends) > 1:
            distances = np.diff(self.ends, axis=0)
            changes = np.diff(self.changes, axis=0) / scales
            sizes = np.linalg.norm(changes, axis=1)
            directions = changes.T / sizes
            shares = np.linalg.lstsq(directions, change / scales, rcond=NOISE)[0] / sizes
            # Differences of angles do not contain full turns.
            turns = distances[:, 0, self.angles] / (2 * np.pi)
            distances[:, 0, self.angles] -= 2 * np.pi * np.round(turns)
            x, rate = -np.tensordot(shares, distances, 1)
            # Earlier points are shifted with the newest one, along its rate.
            past = x[:n] + np.multiply.outer(state.times - state.time, rate[:n])
            observed = np.array([norm.observe(point) for point in state.x + past])
            if norm.gap_reduction(gaps, norm.gaps(observed[0])) < THINNER:
                moved_x = state.x + past
                self._run.equations.keep_within(moved_x, norm.film_gaps(observed[0]))
                moved = {"x": moved_x, "rate": state.rate + rate[:n], "observed": observed}
                self._run.state = replace(state, **moved)
                heat.shift(x[n:])
        self.gaps = self._films()
