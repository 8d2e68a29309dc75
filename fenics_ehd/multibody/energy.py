"""Energy of a mechanism: powers, their integrals, the balance, and the heat of its joints.

Integrals over time of values that are known at the steps of a run.

Energy balance of a run, by integration of the powers.

Energy of a mechanism with films, and the powers that change it.

Heat of lubricated joints: what their films dissipate, and temperatures cycle after cycle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.errors import HeatError
from fenics_ehd.base.sealed_file import Stateful
from fenics_ehd.film.flow import under_pressure
from fenics_ehd.film.heat import TemperatureSearch, run_away
from fenics_ehd.film.lubricant import Oil
from fenics_ehd.multibody.mechanism import FilmPlace
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.step_equations import FilmIntegrals, StepEquations


@dataclass(frozen=True, eq=False)
class Integrals:
    """Integrals since the first point, of the cubic through the last four.

    A crank lends its rod hundreds of times what is lost, and by a parabola the error of that
    integral would be ten times the defect of the integration itself.

    Attributes
    ----------
    names
        Of the integrands.
    start
        First point [s].
    times, rows
        Last points [s] and values there, shape (k,), (k, names).
    totals
        shape (names,).
    """

    names: tuple[str, ...]
    start: float
    times: np.ndarray
    rows: np.ndarray
    totals: np.ndarray

    @classmethod
    def begin(cls, time: float, values: Mapping[str, float]) -> Integrals:
        """At the first point."""
        row = np.array([[*values.values()]], dtype=float)
        return cls(tuple(values), time, np.array([time]), row, np.zeros(len(values)))

    def after(self, time: float, values: Mapping[str, float]) -> Integrals:
        """With the next point: a value of every name."""
        row = np.array([values[name] for name in self.names])
        times = np.append(self.times[-3:], time)
        rows = np.vstack([self.rows[-3:], row])
        totals = self.totals + last_interval(times) @ rows
        return replace(self, times=times, rows=rows, totals=totals)

    def restarted(self) -> Integrals:
        """From the last point on."""
        return replace(self, start=float(self.times[-1]), totals=np.zeros(len(self.names)))

    @property
    def by_name(self) -> dict[str, float]:
        """Integrals by name."""
        return dict(zip(self.names, map(float, self.totals), strict=True))

    @property
    def means(self) -> dict[str, float]:
        """Integrals over the duration, by name; of one point its values."""
        duration = float(self.times[-1] - self.start)
        found = self.totals / duration if duration else self.rows[-1]
        return dict(zip(self.names, map(float, found), strict=True))


def integral(times: np.ndarray, values: np.ndarray, first: int = 0) -> np.ndarray:
    """Integral as of `Integrals`, from the point of a number to the last.

    Parameters
    ----------
    times, values
        shape (k,) [s], (k, names).
    """
    total = np.zeros(values.shape[1])
    for last in range(first + 1, len(times)):
        near = slice(max(0, last - 3), last + 1)
        total += last_interval(times[near]) @ values[near]
    return total


def last_interval(times: np.ndarray) -> np.ndarray:
    """Weights of the integral, over the last interval, of the polynomial through all points."""
    step = times[-1] - times[-2]
    powers = np.vander((times - times[-2]) / step, increasing=True)
    return step * np.linalg.solve(powers.T, 1.0 / np.arange(1, len(times) + 1))


#: What adds to the energy and what takes from it.
SIGNS = {"drive": 1, "applied": 1, "drag": 1, "film": -1, "damping": -1}

#: Largest energy balance error of a run that may be trusted, where no larger one of the steps is
#: known. Steps of a crank or four-bar that leave as much leave extremes of its film some 5 % off;
#: beside what a film dissipates, a hundredth of what a crank lends, the same defect says nothing.
ENERGY_LIMIT = 0.05


@dataclass(frozen=True)
class Powers:
    """Energy and the powers that change it [J], [W].

    ``d(kinetic + strain)/dt = drive + applied + drag - film - damping``: the power of what imposes
    angles over time, that of forces and gravity, that of the surfaces' drag on the oil, the losses
    in the films and in the bodies' structure.

    Without friction the films lose what drives their pressure flow, and the drag comes from
    outside. With friction they lose all that they dissipate; the drag is internal, and zero. Oil
    that is let in and out under pressure brings its work with the drag.
    """

    kinetic: float
    strain: float
    drive: float
    drag: float
    film: float
    damping: float
    applied: float = 0.0

    @property
    def stored(self) -> float:
        """Kinetic and strain energy [J]."""
        return self.kinetic + self.strain


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Defect of the balance [J].

    Attributes
    ----------
    integrals
        Of the powers.
    start
        Energy stored at the start of the run or cycle; nan until it is known.
    defect
        At the last step.
    """

    integrals: Integrals
    start: float
    defect: float = 0.0

    @classmethod
    def begin(cls, time: float, powers: Powers) -> EnergyBalance:
        """At the first step."""
        return cls(Integrals.begin(time, _exchanged(powers)), powers.stored)

    def restarted(self) -> EnergyBalance:
        """From the last step on, but for what a move of its start has stored."""
        return EnergyBalance(self.integrals.restarted(), np.nan)

    def after(self, time: float, powers: Powers) -> EnergyBalance:
        """With one more accepted step."""
        integrals = self.integrals.after(time, _exchanged(powers))
        work = integrals.by_name
        gained = sum(sign * work[name] for name, sign in SIGNS.items())
        start = powers.stored - gained if np.isnan(self.start) else self.start
        return EnergyBalance(integrals, start, powers.stored - start - gained)

    @property
    def work(self) -> Mapping[str, float]:
        """Work of every power since the start [J], by the names of `SIGNS`."""
        return self.integrals.by_name


def balance_error(columns: Mapping[str, np.ndarray]) -> float:
    """Largest defect over the largest energy exchanged, from columns of a history by path."""
    defect = columns["run/energy_defect_J"]
    work = [columns[f"run/{name}_work_J"] for name in SIGNS]
    gained = sum(sign * own for sign, own in zip(SIGNS.values(), work, strict=True))
    exchanged = np.abs([defect + gained, *work]).max()
    return float(np.abs(defect).max() / exchanged) if exchanged else 0.0


def _exchanged(powers: Powers) -> dict[str, float]:
    """Powers by the names of `SIGNS`."""
    return {name: getattr(powers, name) for name in SIGNS}


def heat_rates(film: FilmIntegrals) -> dict[str, float]:
    """Columns that the balance is made of: means over a cycle are P and Q."""
    return {
        "dissipated_power_W": film.dissipated,
        "leaving_flow_m3_per_s": film.flows.leaving,
    }


def temperatures(place: FilmPlace, means: Mapping[str, float]) -> dict[str, float]:
    """Figures of a joint whose heat is balanced, of mean `heat_rates`; no others have any."""
    heat, now = place.joint.heat, place.film.film.equation.lubricant.temperature
    if heat is None or now is None or not means:
        return {}
    power, flow = (means[name] for name in ("dissipated_power_W", "leaving_flow_m3_per_s"))
    return {
        "supply_temperature_C": heat.supply_temperature,
        "effective_temperature_C": now,
        "outlet_temperature_C": heat.outlet(_oil(place), now, power, flow),
    }


def _oil(place: FilmPlace) -> Oil:
    oil = place.film.film.parameters.lubricant.oil
    assert oil is not None  # `LubricatedJoint` has seen to it
    return oil


class FilmTemperatures(Stateful):
    """Effective temperatures of the films whose heat is balanced over a cycle.

    Parameters
    ----------
    places
        Joints; those without `LubricatedJoint.heat` are left alone, the others' films begin at
        the supply's temperature.

    Attributes
    ----------
    thinning
        Relative change of each film, about, for which the last move stands: a bearing under load
        runs with a film as the square root of the viscosity.
    """

    @dataclass(frozen=True)
    class State:
        """Temperatures, and what the cycle under way says of them."""

        searches: dict[str, TemperatureSearch.State]
        rates: dict[str, Integrals]

    def __init__(self, places: Sequence[FilmPlace]):
        self._places = {i: place for i, place in enumerate(places) if place.joint.heat is not None}
        self.searches: dict[str, TemperatureSearch] = {}
        self.rates: dict[str, Integrals] = {}
        for place in self._places.values():
            assert place.joint.heat is not None
            self.searches[place.name] = TemperatureSearch(place.joint.heat, _oil(place))
        self.thinning = np.zeros(self.count)
        self._warm()

    @property
    def count(self) -> int:
        """Number of temperatures."""
        return len(self.searches)

    def _warm(self) -> None:
        for place in self._places.values():
            place.film.film.warm(self.searches[place.name].temperature)

    def add(self, step: MechanismStep) -> None:
        """Account for an accepted step of the cycle under way."""
        for i, place in self._places.items():
            rates = heat_rates(step.solution.integrals[i])
            former = self.rates.get(place.name)
            begun = former.after(step.time, rates) if former else Integrals.begin(step.time, rates)
            self.rates[place.name] = begun

    def _means(self, name: str) -> tuple[float, float]:
        """Power and flow over the cycle."""
        power, flow = self.rates[name].means.values()
        return power, flow

    def _settled(self, name: str) -> bool:
        search = self.searches[name]
        return abs(search.defect(*self._means(name))) <= search.heat.tolerance

    def unsettled(self) -> str:
        """Message about the first temperature that is off its balance; else empty."""
        for name, search in self.searches.items():
            if not self._settled(name):
                defect = search.defect(*self._means(name))
                return (
                    f"the effective temperature of {name}, {search.temperature:.4g} C, is "
                    f"{defect:.2g} K off its balance, above joints.{name}.heat.tolerance = "
                    f"{search.heat.tolerance:g} K"
                )
        return ""

    def move(self) -> None:
        """Take other temperatures for the next cycle, where they are off their balance.

        Those that are not stay: another one would change the steps of the cycle for nothing.

        Raises
        ------
        HeatError
            The heat of a film cannot leave.
        """
        for i, (name, search) in enumerate(self.searches.items()):
            self.thinning[i] = 0.0
            if self._settled(name):
                continue
            before = search.viscosity
            if not search.move(*self._means(name)):
                raise run_away(f"joints.{name}.heat", search)
            self.thinning[i] = 0.5 * np.log(before / search.viscosity)
        self.rates = {name: found.restarted() for name, found in self.rates.items()}
        self._warm()

    def end(self) -> np.ndarray:
        """Temperatures as coordinates and their rates, shape (2, count)."""
        temperatures = [search.temperature for search in self.searches.values()]
        return np.stack([temperatures, np.zeros(self.count)])

    def shift(self, change: np.ndarray) -> None:
        """Change the temperatures that have moved once more, shape (count,) [K]."""
        found = zip(self.searches.values(), change, self.thinning, strict=True)
        for search, own, moved in found:
            if moved:
                search.shift(float(own))
        self._warm()

    def failed(self, error: Exception) -> HeatError | None:
        """The error behind that of a cycle whose film the heat has thinned; None: it has not."""
        for name, search in self.searches.items():
            if search.without_balance:
                return run_away(f"joints.{name}.heat", search, error)
        return None

    def _resume(self) -> None:
        self._warm()


def step_powers(equations: StepEquations, step: MechanismStep) -> Powers:
    """Energy and the powers that change it, at an accepted step; see `Powers`."""
    system, state = equations.system, step.solution
    motion = state.motion
    z, rates = step.x[: system.n], step.rate[: system.n]
    kinetic = strain = damping = film = drag = 0.0
    for _, body, (own, own_rates) in system.each_body(z, rates):
        energies = body.energies(own, own_rates)
        kinetic, strain = kinetic + energies.kinetic, strain + energies.strain
        damping += energies.dissipated
    responses = equations.responses
    for flexibility, places in zip(responses.flexibilities, responses.amplitudes, strict=True):
        strain += flexibility.energy(step.x[places])
        damping += flexibility.dissipation(step.rate[places])
    for place, found in zip(system.films, state.integrals, strict=True):
        lost, fed = found.powers
        lost -= found.flows.refill_work
        if place.film.friction:
            lost, fed = lost + found.friction.sheared, 0.0
        if under_pressure(place.film.film):
            fed += found.flows.work
        if found.contact is not None:
            strain += found.contact.stored(found.touch)
            lost += found.rubbed if found.contact.friction else 0.0
        film, drag = film + lost, drag + fed
    return Powers(
        kinetic=kinetic,
        strain=strain,
        drive=motion.drive_power,
        drag=drag,
        film=film,
        damping=damping,
        applied=motion.applied_power,
    )
