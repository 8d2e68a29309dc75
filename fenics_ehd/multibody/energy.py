"""Energy of a mechanism: powers, their integrals, the balance, and the heat of its joints.

Integrals over time of values that are known at the steps of a run.

Energy balance of a run, by integration of the powers.

Energy of a mechanism with films, and the powers that change it.

Heat of lubricated joints: what their films dissipate, and temperatures cycle after cycle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.base.errors import HeatError
from fenics_ehd.base.sealed_file import Stateful
from fenics_ehd.film.flow import under_pressure
from fenics_ehd.film.heat import TemperatureSearch, run_away
from fenics_ehd.film.lubricant import Oil
from fenics_ehd.multibody.mechanism import FilmPlace
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.step_equations import StepEquations


def integral(times: np.ndarray, values: np.ndarray, first: int = 0) -> np.ndarray:
    """Integral of the cubic through four points at a time, from the point of a number to the last.

    A crank lends its rod hundreds of times what is lost, and by a parabola the error of that
    integral would be ten times the defect of the integration itself.

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


def energy_row(
    former: Sequence[Mapping[str, Any]], time: float, powers: Powers, *, begins: bool = False
) -> dict[str, Any]:
    """Columns of the energy at a step: what is stored, works since the start, and the defect.

    Parameters
    ----------
    former
        Rows of the steps before, none at the first one; the last three count.
    time, powers
        Of the step [s].
    begins
        Whether works begin anew, of a cycle whose first step it is. What a move of its start has
        stored is no defect.
    """
    now = np.array([getattr(powers, name) for name in SIGNS])
    near, work, defect = former[-3:], np.zeros(len(SIGNS)), 0.0
    if near:
        times = np.array([*(row["time_s"] for row in near), time])
        work = last_interval(times) @ np.vstack([*(row["state/powers"] for row in near), now])
    if near and not begins:
        last = near[-1]
        stored = last["run/kinetic_energy_J"] + last["run/strain_energy_J"]
        gained = float(work @ [*SIGNS.values()])
        defect = last["run/energy_defect_J"] + powers.kinetic + powers.strain - stored - gained
        work += [last[f"run/{name}_work_J"] for name in SIGNS]
    return {
        "run/kinetic_energy_J": powers.kinetic,
        "run/strain_energy_J": powers.strain,
        **{f"run/{name}_work_J": own for name, own in zip(SIGNS, work.tolist(), strict=True)},
        "run/energy_defect_J": defect,
        "state/powers": now,
    }


def balance_error(columns: Mapping[str, np.ndarray]) -> float:
    """Largest defect over the largest energy exchanged, from columns of a history by path."""
    defect = columns["run/energy_defect_J"]
    work = [columns[f"run/{name}_work_J"] for name in SIGNS]
    gained = sum(sign * own for sign, own in zip(SIGNS.values(), work, strict=True))
    exchanged = np.abs([defect + gained, *work]).max()
    return float(np.abs(defect).max() / exchanged) if exchanged else 0.0


def temperatures(place: FilmPlace, means: Mapping[str, float]) -> dict[str, float]:
    """Figures of a joint whose heat is balanced, of mean power and flow; no others have any."""
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
    times, rates
        Of the steps of the cycle under way and the three before it [s], and power [W] and flow
        [m3/s] of every film there, shape (k,), (k, 2 count).
    first
        Number of the step that the cycle begins with.
    """

    carried = ("searches", "times", "rates", "first")

    def __init__(self, places: Sequence[FilmPlace]):
        self._places = {i: place for i, place in enumerate(places) if place.joint.heat is not None}
        self.searches: dict[str, TemperatureSearch] = {}
        for place in self._places.values():
            assert place.joint.heat is not None
            self.searches[place.name] = TemperatureSearch(place.joint.heat, _oil(place))
        self.count = len(self.searches)
        self.times, self.rates, self.first = np.zeros(0), np.zeros((0, 2 * self.count)), 0
        self.thinning = np.zeros(self.count)
        self._resume()

    def _resume(self) -> None:
        """Have the films as warm as the searches say."""
        for place in self._places.values():
            place.film.film.warm(self.searches[place.name].temperature)

    def add(self, step: MechanismStep) -> None:
        """Account for an accepted step of the cycle under way."""
        films = [step.solution.integrals[i] for i in self._places]
        rates = [rate for film in films for rate in (film.dissipated, film.flows.leaving)]
        self.times = np.append(self.times, step.time)
        self.rates = np.vstack([self.rates, rates])

    def _balances(self) -> Iterator[tuple[str, TemperatureSearch, list[float]]]:
        """Name and search of every film, mean power and flow over the cycle."""
        whole = integral(self.times, self.rates, self.first)
        means = (whole / (self.times[-1] - self.times[self.first])).reshape(-1, 2)
        for (name, search), own in zip(self.searches.items(), means.tolist(), strict=True):
            yield name, search, own

    def unsettled(self) -> str:
        """Message about the first temperature that is off its balance; else empty."""
        for name, search, means in self._balances():
            defect = search.defect(*means)
            if not abs(defect) <= search.heat.tolerance:
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
        for i, (name, search, means) in enumerate(self._balances()):
            self.thinning[i] = 0.0
            if abs(search.defect(*means)) <= search.heat.tolerance:
                continue
            before = search.viscosity
            if not search.move(*means):
                raise run_away(f"joints.{name}.heat", search)
            self.thinning[i] = 0.5 * np.log(before / search.viscosity)
        self.times, self.rates = self.times[-3:], self.rates[-3:]
        self.first = len(self.times) - 1
        self._resume()

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
        self._resume()

    def failed(self, error: Exception) -> HeatError | None:
        """The error behind that of a cycle whose film the heat has thinned; None: it has not."""
        for name, search in self.searches.items():
            if search.without_balance:
                return run_away(f"joints.{name}.heat", search, error)
        return None


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
