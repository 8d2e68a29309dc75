"""Heat of lubricated joints: what their films dissipate, and temperatures cycle after cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fenics_ehd.base.errors import HeatError
from fenics_ehd.film.heat import TemperatureSearch, run_away
from fenics_ehd.film.temperature import Oil
from fenics_ehd.multibody.film_integrals import FilmIntegrals
from fenics_ehd.multibody.integrals import JointIntegrals
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.system import FilmPlace


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


def balanced_temperature(place: FilmPlace, now: float, power: float, flow: float) -> float:
    """Temperature that power [W] and flow [m3/s] at another one, `now`, stand for [C]."""
    assert place.joint.heat is not None
    return place.joint.heat.balanced(_oil(place), now, power, flow)


def _oil(place: FilmPlace) -> Oil:
    oil = place.film.film.parameters.lubricant.oil
    assert oil is not None  # `LubricatedJoint` has seen to it
    return oil


class FilmTemperatures:
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

    def __init__(self, places: Sequence[FilmPlace]):
        self._places = {i: place for i, place in enumerate(places) if place.joint.heat is not None}
        self._searches = {}
        self._rates = JointIntegrals()
        for place in self._places.values():
            assert place.joint.heat is not None
            self._searches[place.name] = TemperatureSearch(place.joint.heat, _oil(place))
        self.thinning = np.zeros(self.count)
        self._warm()

    @property
    def count(self) -> int:
        """Number of temperatures."""
        return len(self._searches)

    def _warm(self) -> None:
        for place in self._places.values():
            place.film.film.warm(self._searches[place.name].temperature)

    def add(self, step: MechanismStep) -> None:
        """Account for an accepted step of the cycle under way."""
        for i, place in self._places.items():
            self._rates.follow(place.name, step.time, heat_rates(step.solution.integrals[i]))

    def _means(self, name: str) -> tuple[float, float]:
        """Power and flow over the cycle."""
        power, flow = self._rates[name].means.values()
        return power, flow

    def _settled(self, name: str) -> bool:
        search = self._searches[name]
        return abs(search.defect(*self._means(name))) <= search.heat.tolerance

    def unsettled(self) -> str:
        """What is to be said of the first temperature that is off its balance; else nothing."""
        for name, search in self._searches.items():
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
        for i, (name, search) in enumerate(self._searches.items()):
            self.thinning[i] = 0.0
            if self._settled(name):
                continue
            before = search.viscosity
            if not search.move(*self._means(name)):
                raise run_away(f"joints.{name}.heat", search)
            self.thinning[i] = 0.5 * np.log(before / search.viscosity)
        self._rates.restart()
        self._warm()

    def end(self) -> np.ndarray:
        """Temperatures as coordinates and their rates, shape (2, count)."""
        temperatures = [search.temperature for search in self._searches.values()]
        return np.stack([temperatures, np.zeros(self.count)])

    def shift(self, change: np.ndarray) -> None:
        """Change the temperatures that have moved once more, shape (count,) [K]."""
        found = zip(self._searches.values(), change, self.thinning, strict=True)
        for search, own, moved in found:
            if moved:
                search.shift(float(own))
        self._warm()

    def failed(self, error: Exception) -> HeatError | None:
        """The error behind that of a cycle whose film the heat has thinned; None: it has not."""
        for name, search in self._searches.items():
            if search.without_balance:
                return run_away(f"joints.{name}.heat", search, error)
        return None

    def stored_state(self) -> dict[str, Any]:
        """As nested dictionaries of arrays, for `load_state`."""
        return {
            "searches": {name: found.stored_state() for name, found in self._searches.items()},
            "rates": self._rates.stored_state(),
        }

    def load_state(self, stored: Mapping[str, Any]) -> None:
        """Go on where others were."""
        for name, found in stored["searches"].items():
            self._searches[name].load_state(np.array(found))
        self._rates.load_state(stored["rates"])
        self._warm()
