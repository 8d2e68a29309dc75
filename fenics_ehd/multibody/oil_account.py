"""What a film that keeps account of its oil tells of it, over a run or a cycle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fenics_ehd.film.oil_state import OilState
from fenics_ehd.multibody.film_integrals import FilmIntegrals
from fenics_ehd.multibody.system import FilmPlace

#: Column of the content.
CONTENT = "oil_content_m3"


def oil_rates(place: FilmPlace, film: FilmIntegrals) -> dict[str, float]:
    """Columns of one joint at an accepted step; none where oil is not conserved."""
    state, flows = film.state, film.flows
    if not isinstance(state, OilState):
        return {}
    found = {CONTENT: float(state.content.sum()), "side_flow_m3_per_s": flows.balance.side}
    if place.film.film.parameters.regions:
        found["supply_flow_m3_per_s"] = flows.balance.supply
    return found


@dataclass
class OilAccount:
    """Content at the first and the last step of a run, or of its last cycle [m^3]."""

    start: float
    end: float

    @classmethod
    def follow(cls, former: OilAccount | None, rates: Mapping[str, float]) -> OilAccount | None:
        """With one more step; None where oil is not conserved."""
        if CONTENT not in rates:
            return None
        content = rates[CONTENT]
        return cls(former.start if former else content, content)

    def figures(self, totals: Mapping[str, float]) -> dict[str, float]:
        """What ``summary.json`` has of it.

        The defect is that of the content against the integrals `totals` of the flows, over what
        there was and came in: the error of time in both, for no step loses oil.
        """
        flown = totals.get("supply_flow_m3_per_s", 0.0) - totals["side_flow_m3_per_s"]
        held = max(self.start, self.end) + abs(totals.get("supply_flow_m3_per_s", 0.0))
        return {
            "oil_content_at_start_m3": self.start,
            "oil_content_at_end_m3": self.end,
            "oil_balance_defect": abs(self.end - self.start - flown) / held if held else 0.0,
        }
