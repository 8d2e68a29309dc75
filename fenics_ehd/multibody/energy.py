"""Energy balance of a run, by integration of the powers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from fenics_ehd.multibody.integrals import Integrals

#: What adds to the energy and what takes from it.
SIGNS = {"drive": 1, "applied": 1, "drag": 1, "film": -1, "damping": -1}

#: What a balance is measured by, and no part of it.
MEASURE = "unfelt"

#: What a balance knows beside its last powers and its work.
FIGURES = ("_start", "defect", "largest_defect", "largest_exchange", "_peak", "_kept")

#: Largest energy balance error of a run that may be trusted.
ENERGY_LIMIT = 0.05

#: The same over the energy put in for good, most of it dissipated by film and damping, which is
#: what errors of the film are to be compared with. Below `RESOLVED` of the energy exchanged the
#: defect is that of the inertia forces of long steps, beside which a slow crank dissipates little:
#: 0.3 % at steps of a fiftieth of a revolution, which leave the film of the paper's machine 1 to
#: 2 % off at most; at 0.8 % it is 4 % off, at 2 % 14 %. Both stand for errors of the film as long
#: as nobody knows these.
NET_LIMIT, RESOLVED = 0.2, 4e-3


@dataclass(frozen=True)
class Powers:
    """Energy and the powers that change it [J], [W].

    ``d(kinetic + strain)/dt = drive + applied + drag - film - damping``: the power of what imposes
    angles over time, that of forces and gravity, that of the surfaces' drag on the oil, the losses
    in the films and in the bodies' structure.

    Without friction the films lose what drives their pressure flow, and the drag comes from
    outside. With friction they lose all that they dissipate; the drag is internal, and zero. Oil
    that is let in and out under pressure brings its work with the drag. What shear would dissipate
    were it felt, in gaps full of oil, is ``unfelt``, and no part of the balance.
    """

    kinetic: float
    strain: float
    drive: float
    drag: float
    film: float
    damping: float
    applied: float = 0.0
    unfelt: float = 0.0

    @property
    def stored(self) -> float:
        """Kinetic and strain energy [J]."""
        return self.kinetic + self.strain


class EnergyBalance:
    """Defect of the balance and the energies exchanged so far [J]."""

    def __init__(self, time: float, powers: Powers):
        self._integrals = Integrals(time, _exchanged(powers))
        self._start = powers.stored
        self.defect = 0.0
        self.largest_defect = 0.0
        self.largest_exchange = 0.0
        self._peak = self._kept = 0.0

    def restart(self) -> None:
        """Begin another cycle at the last step, but for what a move of its start has stored."""
        self._integrals.restart()
        self._start = np.nan
        self.defect = self.largest_defect = self.largest_exchange = self._peak = self._kept = 0.0

    def add(self, time: float, powers: Powers) -> None:
        """Account for one accepted step."""
        self._integrals.add(time, _exchanged(powers))
        work = self.work
        gained = sum(sign * work[name] for name, sign in SIGNS.items())
        if np.isnan(self._start):
            self._start = powers.stored - gained
        change = powers.stored - self._start
        self.defect = change - gained
        self.largest_defect = max(self.largest_defect, abs(self.defect))
        exchanged = max(abs(change), *(abs(value) for value in work.values()))
        self.largest_exchange = max(self.largest_exchange, exchanged)
        if abs(change) >= self._peak:
            self._peak = self._kept = abs(change)
        self._kept = min(self._kept, abs(change))

    @property
    def work(self) -> Mapping[str, float]:
        """Work of every power since the start [J], by the names of `SIGNS`."""
        totals = self._integrals.totals
        return {name: totals[name] for name in SIGNS}

    def stored_state(self) -> dict[str, np.ndarray]:
        """All that the balance knows, as arrays, for `of`."""
        figures = np.array([getattr(self, name) for name in FIGURES])
        return {**self._integrals.stored_state(), "figures": figures}

    @classmethod
    def pattern(cls) -> dict[str, np.ndarray]:
        """Names, types and shapes of what a balance knows, for `require_like`."""
        return cls(0.0, Powers(*np.zeros(len(fields(Powers))))).stored_state()

    @classmethod
    def of(cls, stored: Mapping[str, np.ndarray]) -> EnergyBalance:
        """Where another balance of the same mechanism was."""
        balance = cls(0.0, Powers(*np.zeros(len(fields(Powers)))))
        balance._integrals = Integrals.of((*SIGNS, MEASURE), stored)
        for name, value in zip(FIGURES, stored["figures"], strict=True):
            setattr(balance, name, float(value))
        return balance

    @property
    def error(self) -> float:
        """Largest defect over the largest energy exchanged."""
        return self.largest_defect / self.largest_exchange if self.largest_exchange else 0.0

    @property
    def net_error(self) -> float:
        """Largest defect over the energy that was put in for good.

        That is what film and damping have dissipated, or would have with friction, and what is
        still stored of it: the least since most was stored. What a crank lends and takes back is a
        hundred times as much and says little of the film. Where no film loses anything there is
        none to be judged, and what stays may be nothing at all: it is `error` then.
        """
        work = self.work
        if work["film"] == 0.0:
            return self.error
        net = work["film"] + self._integrals.totals[MEASURE] + work["damping"] + self._kept
        if net > 0.0:
            return self.largest_defect / net
        return np.inf if self.largest_defect else 0.0


def _exchanged(powers: Powers) -> dict[str, float]:
    """Powers by the names of `SIGNS`, and what they are measured by."""
    return {name: getattr(powers, name) for name in (*SIGNS, MEASURE)}


def trusted(error: float, net_error: float) -> str:
    """``"complete"``, or why the figures of a run with such errors cannot be trusted.

    Parameters
    ----------
    error, net_error
        See `EnergyBalance`.
    """
    if error > ENERGY_LIMIT:
        found = error, "the energy exchanged", ENERGY_LIMIT
    elif error > RESOLVED and net_error > NET_LIMIT:
        found = net_error, "the energy put in for good", NET_LIMIT
    else:
        return "complete"
    share, whole, limit = found
    return (
        f"untrustworthy: energy balance error {100 * share:.2g} % of {whole}, above "
        f"{100 * limit:g} %: lower time.tolerance or time.largest_step"
    )
