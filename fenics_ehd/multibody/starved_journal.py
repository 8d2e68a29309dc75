"""A massless journal whose film keeps account of its oil.

The film remembers: what it holds after a step is what the next one starts from. The
force balance is that of `MasslessJournal`, with the pressure at the end of a step of
implicit Euler for the oil (`fenics_ehd.film.mass_conserving`), from the content after
the last accepted step. Squeeze is the change of that content, so that time enters
through the oil alone: the integration is of first order, whatever formula the
integrator uses for e', which is left in the surface's tangential velocity only. For an
error estimate that means what it says it must integrate with order 1.

Where a gap has emptied nothing resists, and a shaft without mass crosses it at once
when the load turns. A little damping makes that a fast motion that steps can follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fenics_ehd.film import Film, FilmState, ShaftMotion
from fenics_ehd.film.kinematics import Gap, GapSlopes
from fenics_ehd.film.mass_conserving import MassConservingFilm
from fenics_ehd.film.oil_state import OilState
from fenics_ehd.multibody.bdf import Step, StepControl
from fenics_ehd.multibody.cycles import PeriodicSearch
from fenics_ehd.multibody.marching import Marching
from fenics_ehd.multibody.massless_journal import JournalState, MasslessJournal

#: Damping of the empty gap, as a share of that of a centred shaft in a full one; that of air is
#: larger. Between 1e-6 and 1e-4 the largest eccentricity of a starved engine bearing changes by
#: 3e-5.
EMPTY_DAMPING = 1e-5


class StarvedJournal(MasslessJournal):
    """Force balance of the shaft on a film that conserves its oil.

    The journal remembers oil and time of the last accepted step: call `begin` at
    the start of every cycle and `accept` after every accepted step.

    Parameters
    ----------
    film, load, speeds
        As for `MasslessJournal`, the film on a bilinear mesh.

    Attributes
    ----------
    content
        Oil at the nodes, shape (nodes,) [m^3]; empty before the first `begin`.

    Raises
    ------
    SettingsError
        From `MassConservingFilm`.
    """

    def __init__(self, film: Film, load: Callable[[float], np.ndarray], speeds: ShaftMotion):
        super().__init__(film, load, speeds)
        self.oil = MassConservingFilm(film)
        self.content = np.empty(0)
        self._time = 0.0
        self._rate: np.ndarray | None = None
        self._film: FilmState | None = None

    @property
    def film_solves(self) -> int:
        """See `MasslessJournal.film_solves`; those of the first velocity included."""
        return self.oil.cavitation.solves + super().film_solves

    def search(self, control: StepControl) -> PeriodicSearch:
        """Cycle after cycle, the oil of former runs forgotten.

        Newton's method would have to correct the oil at every node too.
        """
        self.content, self._rate, self._film = np.empty(0), None, None
        return Marching(self)

    def begin(self, x: np.ndarray) -> None:
        """A cycle begins at time zero with the oil that there is: at first, all that fits in."""
        self._time = 0.0
        if not len(self.content):
            self.content = self.oil.filled(self.gap(self.motion(x, np.zeros(2))))

    def accept(self, step: Step) -> None:
        """Keep the oil of a step."""
        self.content, self._time = step.auxiliary.film.content, step.time
        self._rate, self._film = step.rate, step.auxiliary.film

    def memory(self) -> dict[str, Any]:
        """What it remembers of the last accepted step beside its film."""
        return {"content": self.content, "time": self._time, "rate": self._rate}

    def restore(self, memory: Mapping[str, Any], film: FilmState) -> None:
        """See `MasslessJournal.restore`."""
        self.content, self._time, self._rate = (memory[n] for n in ("content", "time", "rate"))
        self._film = film

    def starting_rate(self, time: float, x: np.ndarray, largest: float) -> np.ndarray:
        """Velocity at the start of a cycle, shape (2,) [m/s].

        That of the last step. Before it that of `MasslessJournal`: a film that is
        full resists as under Reynolds' condition.
        """
        if self._rate is not None:
            return self._rate
        full = MasslessJournal(self.film, self._load, self._speeds)
        return full.starting_rate(time, x, largest)

    def state(
        self, time: float, x: np.ndarray, rate: np.ndarray, guess: FilmState | None
    ) -> JournalState:
        """See `MasslessJournal.state`; the time is after that of the last accepted step."""
        state = super().state(time, x, rate, guess)
        damping = EMPTY_DAMPING * self.centred_damping
        return replace(
            state,
            force=state.force - damping * rate,
            damping=state.damping - damping * np.eye(2),
        )

    def _solve(self, time: float, gap: Gap, guess: FilmState | None) -> FilmState:
        return self.oil.solve(gap, self.content, time - self._time, guess or self._film)

    def _sensitivity(self, state: FilmState, slopes: GapSlopes) -> np.ndarray:
        assert isinstance(state, OilState)
        return self.oil.sensitivity(state, slopes)[0]
