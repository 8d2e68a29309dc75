"""What a run says of its mechanism's motion, at any instants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline, interp1d

from fenics_ehd.multibody.result import Result


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """Recorded steps, or instants between them.

    Attributes
    ----------
    time
        Ascending, shape (t,) [s].
    coordinates, rates
        Of the mechanism, shape (t, n).
    quasi_static
        Amplitudes of the residual patterns of M4, shape (t, r) [Pa]; r = 0 for other methods.
    pressures
        At the film nodes of every lubricated joint by name, shape (t, k) [Pa].
    """

    time: np.ndarray
    coordinates: np.ndarray
    rates: np.ndarray
    quasi_static: np.ndarray
    pressures: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, result: Result) -> RecordedMotion:
        """All steps of a run whose films were read, over the time since its start."""
        return cls(
            np.asarray(result.run.time),
            result.coordinates,
            result.rates,
            result.quasi_static,
            {name: np.asarray(joint.film.pressure) for name, joint in result.joints.items()},
        )

    def each(self, change: Callable[[np.ndarray], np.ndarray]) -> RecordedMotion:
        """Its values with their first axis changed."""
        return RecordedMotion(
            change(self.time),
            change(self.coordinates),
            change(self.rates),
            change(self.quasi_static),
            {name: change(values) for name, values in self.pressures.items()},
        )

    def at(self, time: np.ndarray) -> RecordedMotion:
        """Instants [s] within the recorded ones.

        Coordinates follow the cubics of values and rates, or joints would come apart between
        two steps; all else follows straight lines.
        """
        cubics = CubicHermiteSpline(self.time, self.coordinates, self.rates)
        straight = self.each(lambda values: interp1d(self.time, values, axis=0)(time))
        return replace(straight, coordinates=cubics(time))


def nearest_steps(time: np.ndarray, count: int) -> np.ndarray:
    """At most `count` steps, spread as evenly as they lie, by their number."""
    wanted = np.linspace(time[0], time[-1], count)
    return np.unique(np.abs(time[:, None] - wanted).argmin(axis=0))
