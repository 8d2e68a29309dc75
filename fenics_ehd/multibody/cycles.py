"""Cycles of a periodically driven system, and what a search for the periodic one offers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from fenics_ehd.multibody.bdf import Step


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle and what follows from it.

    Attributes
    ----------
    start, end
        shape (n,).
    defect
        Distance of the end from the start, in the problem's norm.
    remaining
        Estimated distance from the periodic orbit, in the same norm.
    largest_multiplier
        Modulus of the largest Floquet multiplier; below 1 the orbit attracts.
    next_start
        Where the next cycle should start, shape (n,).
    corrected
        Whether that is not just the end of this one.
    """

    start: np.ndarray
    end: np.ndarray
    defect: float
    remaining: float
    largest_multiplier: float
    next_start: np.ndarray
    corrected: bool

    def repeats(self, tolerance: float) -> bool:
        """Whether the cycle is the periodic one.

        A small defect alone may belong to an orbit that still creeps towards it.
        """
        return max(self.defect, self.remaining) <= tolerance


class PeriodicSearch(Protocol):
    """Goes along with the integration, cycle after cycle."""

    def begin(self, start: np.ndarray) -> None:
        """A cycle begins, at time zero."""

    def add(self, step: Step) -> None:
        """Account for an accepted step."""

    def finish(self) -> Cycle:
        """The whole cycle."""

    def memory(self) -> dict[str, Any]:
        """All that it carries from step to step, for `restore`."""

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on in the middle of a cycle."""
