"""Energy balance of a run, by integration of the powers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Powers:
    """Energy and the powers that change it [J], [W].

    ``d(kinetic + strain)/dt = drive + drag - film - damping``: the crank's work on
    the rod through the film, the shaft's drag on the oil, the loss in the film's
    pressure flow and in the rod's structure.
    """

    kinetic: float
    strain: float
    drive: float
    drag: float
    film: float
    damping: float

    @property
    def stored(self) -> float:
        """Kinetic and strain energy [J]."""
        return self.kinetic + self.strain


class EnergyBalance:
    """Defect of the balance and the energies exchanged so far [J].

    Work is the integral of the parabola through the last three powers: the
    trapezoidal rule's error would exceed the defect of the integration itself.
    """

    def __init__(self, time: float, powers: Powers):
        self._points = [(time, powers)]
        self._start = powers.stored
        self._work = {"drive": 0.0, "drag": 0.0, "film": 0.0, "damping": 0.0}
        self.defect = 0.0
        self.largest_defect = 0.0
        self.largest_exchange = 0.0

    def add(self, time: float, powers: Powers) -> None:
        """Account for one accepted step."""
        self._points = [*self._points[-2:], (time, powers)]
        times = [point[0] for point in self._points]
        for name in self._work:
            values = [getattr(point[1], name) for point in self._points]
            self._work[name] += last_interval(times, values)
        change = powers.stored - self._start
        work = self._work
        self.defect = change - (work["drive"] + work["drag"] - work["film"] - work["damping"])
        self.largest_defect = max(self.largest_defect, abs(self.defect))
        exchanged = max(abs(change), *(abs(value) for value in work.values()))
        self.largest_exchange = max(self.largest_exchange, exchanged)

    @property
    def error(self) -> float:
        """Largest defect over the largest energy exchanged."""
        return self.largest_defect / self.largest_exchange if self.largest_exchange else 0.0


def last_interval(times: Sequence[float], values: Sequence[float]) -> float:
    """Integral over the last interval of the polynomial through two or three points."""
    step = times[-1] - times[-2]
    integral = 0.5 * step * (values[-1] + values[-2])
    if len(times) == 2:
        return integral
    before = times[-2] - times[-3]
    slopes = (values[-1] - values[-2]) / step, (values[-2] - values[-3]) / before
    second_difference = (slopes[0] - slopes[1]) / (step + before)
    return integral - second_difference * step**3 / 6
