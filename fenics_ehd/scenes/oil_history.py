"""Oil in the history of a loaded journal whose film conserves it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.film.flow import flow_balance
from fenics_ehd.film.oil_state import OilState
from fenics_ehd.multibody.massless_journal import MasslessJournal
from fenics_ehd.multibody.starved_journal import StarvedJournal


def oil_row(journal: MasslessJournal, state: object) -> dict[str, float]:
    """Columns of the history for one step; none for a film that keeps no account of its oil.

    ``supply_m3_per_s`` is what grooves give, ``side_flow_m3_per_s`` what leaves through
    both sides, less than zero where oil under ambient pressure comes in.
    """
    if not (isinstance(journal, StarvedJournal) and isinstance(state, OilState)):
        return {}
    flow, content = flow_balance(journal.film, state), float(state.content.sum())
    return {
        "oil_content_m3": content,
        "mean_fluid_fraction": content / float(journal.oil.filled(state.gap).sum()),
        "min_fluid_fraction": float(state.fluid_fraction.min()),
        "supply_m3_per_s": flow.supply,
        "side_flow_m3_per_s": flow.side,
    }


@dataclass
class OilAccount:
    """Oil over the cycle under way.

    Contents before the cycle and now [m^3], volumes supplied and lost through the sides
    [m^3], the least fluid fraction and the integral of its mean over time [s].
    """

    before: float = np.nan
    content: float = np.nan
    supplied: float = 0.0
    lost: float = 0.0
    least: float = np.inf
    filled: float = 0.0
    time: float = 0.0

    def next_cycle(self) -> OilAccount:
        """Account of the cycle that follows."""
        return OilAccount(before=self.content, content=self.content)

    def add(self, row: dict[str, float]) -> None:
        """Account for the history row of a step: flows are those of its end, as integrated."""
        step = row["step_s"]
        self.content = row["oil_content_m3"]
        self.supplied += step * row["supply_m3_per_s"]
        self.lost += step * row["side_flow_m3_per_s"]
        self.least = min(self.least, row["min_fluid_fraction"])
        self.filled += step * row["mean_fluid_fraction"]
        self.time += step

    def summary(self) -> dict[str, float]:
        """Figures of the cycle; ``oil_balance_error`` relative to the content."""
        gained = self.content - self.before
        return {
            "min_fluid_fraction": self.least,
            "mean_fluid_fraction": self.filled / self.time if self.time else np.nan,
            "mean_supply_m3_per_s": self.supplied / self.time if self.time else np.nan,
            "mean_side_flow_m3_per_s": self.lost / self.time if self.time else np.nan,
            "oil_content_m3": self.content,
            "oil_balance_error": abs(gained + self.lost - self.supplied) / self.content,
        }
