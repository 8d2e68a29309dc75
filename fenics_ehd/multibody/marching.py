"""From cycle to cycle of a journal that remembers its oil, until both repeat."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from fenics_ehd.multibody.bdf import Step
from fenics_ehd.multibody.cycles import Cycle


class RemembersOil(Protocol):
    """What the search asks of the journal."""

    @property
    def content(self) -> np.ndarray:
        """Oil at the nodes, shape (nodes,) [m^3]."""

    def begin(self, x: np.ndarray) -> None:
        """A cycle begins."""

    def accept(self, step: Step) -> None:
        """Keep the oil of a step."""

    def norm(self, x: np.ndarray, change: np.ndarray) -> float:
        """See `fenics_ehd.multibody.newton.SecondOrderProblem`."""


class Marching:
    """Search for the periodic cycle, see `PeriodicSearch`.

    The defect of a cycle is the larger one of two: that of the gap, in the
    problem's norm, and the change of the oil at the nodes, its sum without sign
    over the oil. Its ratio from cycle to cycle tends to the largest Floquet multiplier
    m, so that ``defect m / (1 - m)`` is still to come. The first cycle, which has
    no ratio, never counts as the periodic one.
    """

    def __init__(self, journal: RemembersOil):
        self._journal = journal
        self._former_defect = np.nan

    def begin(self, start: np.ndarray) -> None:
        """A cycle begins, at time zero."""
        self._journal.begin(start)
        self._start = self._end = start
        self._content = self._journal.content

    def add(self, step: Step) -> None:
        """Account for an accepted step."""
        self._journal.accept(step)
        self._end = step.x

    def memory(self) -> dict[str, Any]:
        """See `PeriodicSearch`; the journal's is its own."""
        names = ("start", "end", "content", "former_defect")
        return {name: getattr(self, f"_{name}") for name in names}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """See `PeriodicSearch`."""
        for name, value in memory.items():
            setattr(self, f"_{name}", value)

    def finish(self) -> Cycle:
        """The whole cycle."""
        content = self._journal.content
        oil = float(np.abs(content - self._content).sum() / content.sum())
        defect = max(oil, self._journal.norm(self._end, self._end - self._start))
        multiplier = defect / self._former_defect if self._former_defect else 0.0
        self._former_defect = defect
        return Cycle(
            start=self._start,
            end=self._end,
            defect=defect,
            remaining=defect * multiplier / (1 - multiplier) if multiplier < 1 else np.inf,
            largest_multiplier=multiplier,
            next_start=self._end,
            corrected=False,
        )
