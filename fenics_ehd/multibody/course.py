"""Where a mechanism was at points in time: what a run left, and what is solved beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.columns import joint_prefix
from fenics_ehd.multibody.between_nodes import BetweenNodes, extremes
from fenics_ehd.multibody.system import System


@dataclass(frozen=True, eq=False)
class Course:
    """Solutions at ascending times.

    Attributes
    ----------
    times
        shape (k,) [s].
    x
        Coordinates and amplitudes of residual patterns, shape (k, n + r).
    pressures
        Of every film at its nodes, shape (k, nodes) each [Pa].
    voids
        Void fractions of films that keep account of their oil, by the film's number.
    peaks, films
        Largest pressure and thinnest film of every joint, between its nodes, shape (k, joints)
        [Pa], [m].
    multipliers
        shape (k, 2 m); none where they are not known.
    accelerations
        Of x, shape (k, n + r); none where they are not known.
    sampled
        Of a run: what it says of `peaks` and `films`, at nodes and Gauss points alone.
    """

    times: np.ndarray
    x: np.ndarray
    pressures: list[np.ndarray]
    voids: Mapping[int, np.ndarray]
    peaks: np.ndarray
    films: np.ndarray
    multipliers: np.ndarray
    accelerations: np.ndarray
    sampled: tuple[np.ndarray, np.ndarray] | None = None

    def repeated(self, period: float, start: np.ndarray, angles: list[int], share: float) -> Course:
        """The course of a cycle, and the beginning of the cycle after it.

        Parameters
        ----------
        period
            Of the cycle [s].
        start
            State it began at, shape (n + r,).
        angles
            Places of angles, which go on by whole turns.
        share
            Of the next cycle.
        """
        began = self.times[-1] - period
        again = np.flatnonzero(self.times - began <= share * period)
        turns = np.zeros(self.x.shape[1])
        over = self.x[-1, angles] - start[angles]
        turns[angles] = 2 * np.pi * np.round(over / (2 * np.pi))

        def twice(values: np.ndarray) -> np.ndarray:
            return np.concatenate([values, values[again]]) if len(values) else values

        return Course(
            np.concatenate([self.times, self.times[again] + period]),
            np.concatenate([self.x, self.x[again] + turns]),
            [twice(pressure) for pressure in self.pressures],
            {i: twice(void) for i, void in self.voids.items()},
            twice(self.peaks),
            twice(self.films),
            twice(self.multipliers),
            twice(self.accelerations),
        )

    def halved(self, began: float, start: np.ndarray) -> Course:
        """Its points and those halfway between, from a state at a time before them on [s]."""
        before = np.maximum(np.arange(len(self.times)) - 1, 0)

        def between(values: np.ndarray, first: np.ndarray | float | None = None) -> np.ndarray:
            if not len(values):
                return values
            middles = 0.5 * (values[before] + values)
            if first is not None:
                middles[0] = 0.5 * (first + values[0])
            return np.stack([middles, values], axis=1).reshape(-1, *values.shape[1:])

        return Course(
            between(self.times, began),
            between(self.x, start),
            [between(pressure) for pressure in self.pressures],
            {i: between(void) for i, void in self.voids.items()},
            between(self.peaks),
            between(self.films),
            between(self.multipliers),
            between(self.accelerations),
        )

    def at(self, rows: np.ndarray) -> Course:
        """Some of its points."""
        return Course(
            self.times[rows],
            self.x[rows],
            [pressure[rows] for pressure in self.pressures],
            {i: void[rows] for i, void in self.voids.items()},
            self.peaks[rows],
            self.films[rows],
            self.multipliers[rows] if len(self.multipliers) else self.multipliers,
            self.accelerations[rows] if len(self.accelerations) else self.accelerations,
        )


def course_of(
    system: System, columns: Mapping[str, np.ndarray], fields: Mapping[str, np.ndarray]
) -> Course:
    """Of a history's rows, see `Tracker.add`, one a step."""
    prefixes = [joint_prefix(place.name, system.films) for place in system.films]
    states = ("state/coordinates", "state/quasi_static")
    x = np.hstack([fields[name] for name in states if name in fields])
    paths = [f"joints/{place.name}/film" for place in system.films]
    voids = {
        i: 1.0 - fields[f"{path}/fluid_fraction"]
        for i, path in enumerate(paths)
        if f"{path}/fluid_fraction" in fields
    }

    def curves(name: str) -> np.ndarray:
        return np.column_stack([columns[f"{prefix}{name}"] for prefix in prefixes])

    between = [BetweenNodes(place.film.film.parameters.grid) for place in system.films]
    pressures = [fields[f"{path}/pressure"] for path in paths]
    gaps = [fields[f"{path}/gap"] for path in paths]
    return Course(
        columns["time_s"],
        x,
        pressures,
        voids,
        *extremes(between, pressures, gaps),
        np.zeros((0, 2 * system.m)),
        np.zeros((0, x.shape[1])),
        (curves("max_pressure_Pa"), curves("min_film_thickness_m")),
    )
