"""What supplies a film with oil through a region of its bore or of its journal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.feed_region import FeedRegion


@dataclass(frozen=True, eq=False)
class Feed:
    """One supply region.

    Attributes
    ----------
    name
        Of its flow.
    region
        Its place and shape.
    pressure
        Supply pressure [Pa], or a function of the time [s] that gives it and its derivative.
    resistance
        Of the passage that leads to it [Pa s/m^3]; 0: none.
    on_journal
        Whether it turns with the journal.
    """

    name: str
    region: FeedRegion
    pressure: float | Callable[[float], tuple[float, float]] = 0.0
    resistance: float = 0.0
    on_journal: bool = False

    def __post_init__(self) -> None:
        if not callable(self.pressure) and not 0.0 <= self.pressure < np.inf:
            raise SettingsError(
                f"{self.name}.pressure = {self.pressure:g} Pa must be at least 0, the pressure at "
                "which the film cavitates"
            )
        if not 0.0 <= self.resistance < np.inf:
            raise SettingsError(
                f"{self.name}.resistance = {self.resistance:g} Pa s/m3 must be at least 0"
            )

    def pressure_at(self, time: float) -> float:
        """Supply pressure at a time [Pa]."""
        return self.pressure(time)[0] if callable(self.pressure) else self.pressure
