"""Elastic rotor in the lubricated bore of a flexible housing (section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.multibody.bdf import relative_error
from fenics_ehd.multibody.coupled import CoupledState
from fenics_ehd.multibody.dry_system import DrySystem
from fenics_ehd.multibody.energy import Powers
from fenics_ehd.multibody.equations import Equations
from fenics_ehd.multibody.shaft_journal import ShaftJournal
from fenics_ehd.multibody.tabulated import TabulatedLoad


@dataclass(frozen=True)
class RotorState:
    """What the last evaluation of the rotor knows, for output: when it was [s]."""

    time: float


class Rotor:
    """The equations of motion, a `Mechanism`.

        M xi'' + C xi' + K xi = f(t) + load p

    A housing with residual flexibility adds the amplitudes of its patterns to the state.

    Parameters
    ----------
    dry
        Rotor and housing without the film.
    journal
        The film between them, in the same coordinates.
    speed
        Of the shaft, constant [rad/s].
    """

    def __init__(self, dry: DrySystem, journal: ShaftJournal, speed: float):
        self.dry, self.journal, self.speed = dry, journal, speed
        self.size = journal.size
        self.tables: Sequence[TabulatedLoad] = ()

    def equations(
        self,
        time: float,
        xi: np.ndarray,
        rate: np.ndarray,
        acceleration: np.ndarray,
        shifts: tuple[float, float],
        pressure: np.ndarray,
    ) -> Equations:
        """Equations of motion, see `Mechanism`."""
        load = self.journal.load[1:]
        return Equations(
            residual=self.dry.residual(time, xi, rate, acceleration) - load @ pressure,
            shaft_rate=self.speed,
            shaft_rate_slope=np.zeros(len(xi)),
            linearise=lambda: (self.dry.derivative(shifts), load),
            state=RotorState(time),
        )

    def watch(self, x: np.ndarray) -> np.ndarray:
        """Gap at the watched points [m], see `fenics_ehd.multibody.bdf.Watched`."""
        return self.journal.gap(x)

    def error_norm(self, watched: np.ndarray, error: np.ndarray) -> float:
        """See `relative_error`."""
        return relative_error(watched, error)

    def initial_powers(self) -> Powers:
        """Energy at the start: all at rest beside the steady rotation, no pressure yet."""
        rest = np.zeros(self.dry.size)
        return self.dry.powers(0.0, rest, rest)

    def powers(self, x: np.ndarray, rate: np.ndarray, state: CoupledState) -> Powers:
        """Energy and powers at an accepted step.

        The drive is the power of the rotating force. The drag of the oil is what the motor
        that keeps the speed constant puts into the motion of the film's surfaces; the rest of
        its power is sheared away in the oil. Energies are those of the motion beside the
        steady rotation.
        """
        n, compliance = self.journal.coordinates, self.journal.compliance
        loss, drag = self.journal.film.powers(state.film)
        powers = self.dry.powers(state.mechanism.time, x[:n], rate[:n], loss, drag)
        if compliance is None:
            return powers
        return replace(
            powers,
            strain=powers.strain + compliance.energy(x[n:]),
            damping=powers.damping + compliance.dissipation(rate[n:]),
        )
