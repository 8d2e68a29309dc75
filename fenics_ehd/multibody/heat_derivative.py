"""Temperatures of films, whose heat is balanced over the cycle, as functions of other numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_ehd.multibody.cycle_derivative import Curves
from fenics_ehd.multibody.joint_heat import balanced_temperature
from fenics_ehd.multibody.system import FilmPlace, System

#: What a small change of a temperature is a share of [K].
SCALE = 20.0

#: Columns whose means are balanced.
POWER, FLOW = "dissipated_power_W", "leaving_flow_m3_per_s"


class Balances:
    """Balances of the films' heat, as far as a run has come to them.

    Parameters
    ----------
    system
        Of the run, films at their temperatures.
    amount
        Small change over `SCALE`.

    Attributes
    ----------
    temperatures
        By joint [C].
    warmer
        The same with one of them higher, each.
    """

    def __init__(self, system: System, amount: float):
        self._places = [place for place in system.films if place.joint.heat is not None]
        self._amount = amount
        self.temperatures = {place.name: temperature_of(place) for place in self._places}
        self.warmer = [
            self.temperatures | {name: value + amount * SCALE}
            for name, value in self.temperatures.items()
        ]

    def total(
        self,
        systems: Sequence[System],
        curves: Curves,
        along: Sequence[Curves],
        means: np.ndarray,
    ) -> list[Curves]:
        """Derivatives along numbers with their temperatures, which balance the heat.

        Parameters
        ----------
        systems
            With one number changed each.
        curves
            Columns at the steps.
        along
            Their derivatives along every number, then along every temperature, over its scale.
        means
            Weights of the steps in a mean over the cycle.
        """
        count = len(systems)
        numbers, temperatures = along[:count], along[count:]
        here = self._defects([], curves, means, np.zeros(len(self._places)))
        matrix = np.column_stack(
            [
                (self._defects([], _moved(curves, own, self._amount), means, shift) - here)
                for own, shift in zip(
                    temperatures, self._amount * SCALE * np.eye(len(self._places)), strict=True
                )
            ]
        )
        totals = []
        for system, own in zip(systems, numbers, strict=True):
            places = [system.films[i] for i in self._numbers_in(system)]
            moved = _moved(curves, own, self._amount)
            change = self._defects(places, moved, means, np.zeros(len(self._places))) - here
            total = own
            for share, warmer in zip(-np.linalg.solve(matrix, change), temperatures, strict=True):
                total = _moved(total, warmer, float(share))
            totals.append(total)
        return totals

    def _numbers_in(self, system: System) -> list[int]:
        names = [place.name for place in system.films]
        return [names.index(place.name) for place in self._places]

    def _defects(
        self, places: Sequence[FilmPlace], curves: Curves, means: np.ndarray, shift: np.ndarray
    ) -> np.ndarray:
        """What temperatures, shifted, are off their balances [K]."""
        found = []
        for place, moved in zip(places or self._places, shift, strict=True):
            now = self.temperatures[place.name] + moved
            columns = curves[place.name]
            power, flow = (float(means @ columns[name]) for name in (POWER, FLOW))
            found.append(balanced_temperature(place, now, power, flow) - now)
        return np.array(found)


def temperature_of(place: FilmPlace) -> float:
    """Of a film whose heat is balanced [C]."""
    now = place.film.film.equation.lubricant.temperature
    assert now is not None
    return float(now)


def _moved(curves: Curves, direction: Curves, amount: float) -> Curves:
    return {
        joint: {name: own + amount * direction[joint][name] for name, own in columns.items()}
        for joint, columns in curves.items()
    }
