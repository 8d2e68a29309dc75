"""Given changes of the films' gaps over time: errors whose consequences are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.kinematics import Gap

#: Of every film: change of the gap at the Gauss points and its rate [m], [m/s], or None.
GapChanges = Sequence[tuple[np.ndarray, np.ndarray] | None]


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Along a course.

    Attributes
    ----------
    times
        shape (k,) [s].
    observed
        Of every film where its gap is observed, Gauss points first, shape (k, w) [m], or None.
    points
        Gauss points of every film.

    Raises
    ------
    SettingsError
        Of a single time, of which no rate is known.
    """

    times: np.ndarray
    observed: Sequence[np.ndarray | None]
    points: Sequence[int]

    def __post_init__(self) -> None:
        if len(self.times) < 2:
            raise SettingsError("a run of one step is too short to tell: raise time.end")
        inside = [
            None if change is None else change[:, :count]
            for change, count in zip(self.observed, self.points, strict=True)
        ]
        rates = [
            None if change is None else np.gradient(change, self.times, axis=0) for change in inside
        ]
        object.__setattr__(self, "_inside", inside)
        object.__setattr__(self, "_rates", rates)

    def at(self, row: int) -> GapChanges:
        """Changes at one of the times."""
        pairs = zip(self._inside, self._rates, strict=True)  # type: ignore[attr-defined]
        return [None if gap is None else (gap[row], rate[row]) for gap, rate in pairs]

    def observed_at(self, row: int) -> list[np.ndarray | float]:
        """Changes where gaps are observed."""
        return [0.0 if change is None else change[row] for change in self.observed]


def disturb(gaps: list[Gap], changes: GapChanges) -> None:
    """Change the gaps of films."""
    for i, change in enumerate(changes):
        if change is not None:
            gap, shape = gaps[i], gaps[i].thickness.shape
            gaps[i] = replace(
                gap,
                thickness=gap.thickness + change[0].reshape(shape),
                thickness_rate=gap.thickness_rate + change[1].reshape(shape),
            )
