"""Energy balance of a run, by trapezoidal integration of the powers."""

from __future__ import annotations

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

    @property
    def net(self) -> float:
        """Power that should change the stored energy [W]."""
        return self.drive + self.drag - self.film - self.damping


class EnergyBalance:
    """Defect of the balance and the energies exchanged so far [J]."""

    def __init__(self, time: float, powers: Powers):
        self._time, self._last, self._start = time, powers, powers.stored
        self._work = {"drive": 0.0, "drag": 0.0, "film": 0.0, "damping": 0.0}
        self.defect = 0.0
        self.largest_defect = 0.0
        self.largest_exchange = 0.0

    def add(self, time: float, powers: Powers) -> None:
        """Account for one accepted step."""
        span = time - self._time
        for name in self._work:
            mean = 0.5 * (getattr(powers, name) + getattr(self._last, name))
            self._work[name] += span * mean
        change = powers.stored - self._start
        work = self._work
        self.defect = change - (work["drive"] + work["drag"] - work["film"] - work["damping"])
        self.largest_defect = max(self.largest_defect, abs(self.defect))
        exchanged = max(abs(change), *(abs(value) for value in work.values()))
        self.largest_exchange = max(self.largest_exchange, exchanged)
        self._time, self._last = time, powers

    @property
    def error(self) -> float:
        """Largest defect over the largest energy exchanged."""
        return self.largest_defect / self.largest_exchange if self.largest_exchange else 0.0
