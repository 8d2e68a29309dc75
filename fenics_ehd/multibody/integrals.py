"""Integrals over time of values that are known at the steps of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


class Integrals:
    """Integrals since the first point, of the cubic through the last four.

    A crank lends its rod hundreds of times what is lost, and by a parabola the error of that
    integral would be ten times the defect of the integration itself.

    Parameters
    ----------
    time
        Of the first point [s].
    values
        There, by name.
    """

    def __init__(self, time: float, values: Mapping[str, float]):
        self._names = tuple(values)
        self._start = time
        self._times, self._rows = np.array([time]), np.array([[*values.values()]], dtype=float)
        self._totals = np.zeros(len(self._names))

    def add(self, time: float, values: Mapping[str, float]) -> None:
        """Account for the next point: a value of every name."""
        row = np.array([values[name] for name in self._names])
        self._times = np.append(self._times[-3:], time)
        self._rows = np.vstack([self._rows[-3:], row])
        self._totals = self._totals + last_interval(self._times) @ self._rows

    def restart(self) -> None:
        """Integrate from the last point on."""
        self._start, self._totals = float(self._times[-1]), np.zeros(len(self._names))

    @property
    def duration(self) -> float:
        """From the first point to the last [s]."""
        return float(self._times[-1] - self._start)

    @property
    def totals(self) -> dict[str, float]:
        """Integrals by name."""
        return dict(zip(self._names, map(float, self._totals), strict=True))

    @property
    def means(self) -> dict[str, float]:
        """Integrals over the duration, by name; of one point its values."""
        found = self._totals / self.duration if self.duration else self._rows[-1]
        return dict(zip(self._names, map(float, found), strict=True))

    def stored_state(self) -> dict[str, np.ndarray]:
        """All that it knows, as arrays, for `of`."""
        return {
            "start": np.array(self._start),
            "times": self._times,
            "rows": self._rows,
            "totals": self._totals,
        }

    @classmethod
    def of(cls, names: tuple[str, ...], stored: Mapping[str, np.ndarray]) -> Integrals:
        """Where another one of the same names was."""
        found = cls(float(stored["start"]), dict.fromkeys(names, 0.0))
        found._times, found._rows = np.array(stored["times"]), np.array(stored["rows"])
        found._totals = np.array(stored["totals"])
        return found


class JointIntegrals(dict[str, Integrals]):
    """Integrals of what joints tell, by their names; none of a joint that tells nothing."""

    def follow(self, joint: str, time: float, values: Mapping[str, float]) -> None:
        """Account for the next point of a joint, or its first."""
        if joint in self:
            self[joint].add(time, values)
        elif values:
            self[joint] = Integrals(time, values)

    def restart(self) -> None:
        """Integrate from the last points on."""
        for own in self.values():
            own.restart()

    def stored_state(self) -> dict[str, Any]:
        """All that they know, for `load_state`."""
        return {
            joint: {"names": tuple(own.totals), **own.stored_state()} for joint, own in self.items()
        }

    def load_state(self, stored: Mapping[str, Any]) -> None:
        """Go on where others were."""
        self.clear()
        for joint, found in stored.items():
            self[joint] = Integrals.of(tuple(found["names"]), found)


def last_interval(times: np.ndarray) -> np.ndarray:
    """Weights of the integral, over the last interval, of the polynomial through all points."""
    step = times[-1] - times[-2]
    powers = np.vander((times - times[-2]) / step, increasing=True)
    return step * np.linalg.solve(powers.T, 1.0 / np.arange(1, len(times) + 1))
