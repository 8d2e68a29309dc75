"""What the solution of a mechanism's step is, and what it leaves to that of the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.film import FilmState
from fenics_ehd.multibody.bdf import Step
from fenics_ehd.multibody.film_integrals import FilmIntegrals
from fenics_ehd.multibody.motion import Motion


@dataclass(frozen=True, eq=False)
class CoupledState:
    """Films and motion at the end of a step.

    Attributes
    ----------
    films
        Solution of every film, in the order of `System.films`.
    motion
        See `Motion`.
    integrals
        Of every film.
    """

    films: list[FilmState]
    motion: Motion
    integrals: list[FilmIntegrals]


#: An accepted step of a mechanism.
MechanismStep = Step[CoupledState]


@dataclass(frozen=True, eq=False)
class SolverState:
    """What one step leaves to the next.

    Attributes
    ----------
    times, values
        Pressures at all nodes [Pa] and multipliers at the last one or two steps, newest first.
    patterns
        Residual patterns to take into the derivatives.
    """

    times: np.ndarray
    values: np.ndarray
    patterns: int

    def extrapolated(self, time: float) -> np.ndarray:
        """On the line through the last two steps."""
        if len(self.times) == 1:
            return self.values[0]
        share = (time - self.times[0]) / (self.times[0] - self.times[1])
        return (1 + share) * self.values[0] - share * self.values[1]

    @classmethod
    def after(
        cls, former: SolverState | None, time: float, values: np.ndarray, patterns: int
    ) -> SolverState:
        """With one more step."""
        if former is None:
            return cls(np.array([time]), values[None], patterns)
        times, before = np.array([time, former.times[0]]), former.values[0]
        return cls(times, np.stack([values, before]), patterns)
