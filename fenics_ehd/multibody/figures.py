"""Figures of a run: its printed results, each with unit and estimated error.

``summary.json`` has an entry ``errors`` for every joint whose errors were estimated. It has, for
each figure of the joint, the estimated absolute error in the unit of the figure, or a word: the
reason why the figure has no error. `figures_of` lists the figures of a summary with both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.base.columns import DIMENSIONLESS, split_unit
from fenics_ehd.multibody.trust import COMPONENTS, NOT_ESTIMATED, QUANTITIES

#: Reasons why a figure has no estimated error: it is a setting; it is counted or chosen; it is the
#: angle, the height or the time of an extreme; it is itself an error.
GIVEN = "given"
EXACT = "exact"
POSITION = "position"
ERROR_ITSELF = "is an error"

#: Reasons by the end of a figure's name; the first matching end is used.
REASONS_BY_END = {
    "supply_temperature_C": GIVEN,
    "basis_error_estimate_m": ERROR_ITSELF,
    "oil_balance_defect": ERROR_ITSELF,
    "contact_sliding_Pa_m": "not recorded",
    "_time_s": POSITION,
    "_angle_deg": POSITION,
    "_height_m": POSITION,
}

#: Figures of a run by their reason; the largest multiplier has an error of its own.
RUN_REASONS = {
    "energy_balance_error": ERROR_ITSELF,
    "periodicity_defect": ERROR_ITSELF,
    "largest_multiplier": "",
    "simulated_time_s": EXACT,
    "cycle_start_s": EXACT,
    "cycle_end_s": EXACT,
    "cycles": EXACT,
    "steps": EXACT,
    "newton_iterations": EXACT,
    "rejected_steps": EXACT,
}

#: Name of the entry with the error of the largest multiplier.
MULTIPLIER_ERROR = "largest_multiplier_residual"


@dataclass(frozen=True)
class Figure:
    """A result of a run with its estimated error.

    Attributes
    ----------
    joint
        Name of the joint; empty for a figure of the run.
    name
        Name of the entry in ``summary.json``, with unit.
    value
        Value in the unit of the name.
    error
        Estimated absolute error in the same unit; None if it is not estimated.
    reason
        Reason why the error is not estimated, or the error components that it does not include,
        ``part mesh not included``; else empty.
    """

    joint: str
    name: str
    value: float
    error: float | None
    reason: str

    @property
    def unit(self) -> str:
        """Unit of value and error, ``"1"`` if dimensionless."""
        return split_unit(self.name)[1]

    @property
    def known(self) -> bool:
        """Whether the figure has an estimated error."""
        return self.error is not None

    @property
    def relative(self) -> float | None:
        """Error over the size of the value [-]; None without an error, and for angles and zero."""
        if self.error is None or self.unit in ("deg", "C") or not self.value:
            return None
        return self.error / abs(self.value)

    @property
    def bound(self) -> str:
        """Text of the error, ``+- 0.5 %`` or ``+- 0.2 deg``; without an error, the reason."""
        if self.error is None:
            return self.reason
        if self.relative is not None:
            return f"+- {100 * self.relative:.2g} %"
        unit = "" if self.unit == DIMENSIONLESS else f" {self.unit}"
        return f"+- {self.error:.2g}{unit}"


def figures_of(summary: Mapping[str, Any]) -> list[Figure]:
    """Figures of a run from its ``summary.json``: those of all joints, then those of the run."""
    figures = []
    for name, joint in summary.get("joints", {}).items():
        lacking = missing_components(joint)
        errors = joint.get("errors") or _errors_of_budget(joint)
        for key, value in numbers(joint):
            error = errors.get(key, reason_of(key))
            if isinstance(error, str):
                figures.append(Figure(name, key, value, None, error))
            else:
                figures.append(Figure(name, key, value, float(error), lacking))
    for key, value in numbers(summary):
        if key in RUN_REASONS:
            residual = summary.get(MULTIPLIER_ERROR)
            known = key == "largest_multiplier" and residual is not None
            figures.append(Figure("", key, value, residual if known else None, RUN_REASONS[key]))
    return figures


def _errors_of_budget(joint: Mapping[str, Any]) -> dict[str, float]:
    """Errors of the extremes of a joint whose summary has an error budget only, as in version 0.3.

    `joint` has the entries of the joint in ``summary.json``.
    """
    errors = {}
    for quantity, entry in (
        ("max_pressure", "max_pressure_Pa"),
        ("min_film_thickness", "min_film_thickness_m"),
    ):
        total = joint.get("error_budget", {}).get(quantity, {}).get("total")
        for name in (entry, f"cycle_{entry}"):
            if isinstance(total, float) and isinstance(joint.get(name), int | float):
                errors[name] = total * abs(joint[name])
    return errors


def numbers(entries: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Entries of a summary that are finite numbers, by name."""
    for key, value in entries.items():
        if isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value):
            yield key, float(value)


def reason_of(name: str) -> str:
    """Reason why a figure of a joint has no error, by its `name` in ``summary.json``."""
    matching = (reason for end, reason in REASONS_BY_END.items() if name.endswith(end))
    return next(matching, NOT_ESTIMATED)


def reported_errors(
    entries: Mapping[str, Any], errors: Mapping[str, float | str]
) -> dict[str, float | str]:
    """Entry ``errors`` of a joint: the error of each figure in `entries`, or the reason for none.

    `errors` are the estimated absolute errors by figure.
    """
    return {key: errors.get(key, reason_of(key)) for key, _ in numbers(entries)}


def missing_components(joint: Mapping[str, Any]) -> str:
    """Text with the error components of a joint that are not estimated; empty if all are.

    `joint` has the entries of the joint in ``summary.json``.
    """
    budget = joint.get("error_budget", {})
    lacking = [
        component.replace("_", " ")
        for component in COMPONENTS
        if any(budget.get(name, {}).get(component) == NOT_ESTIMATED for name in QUANTITIES)
    ]
    return f"{' and '.join(lacking)} not included" if lacking else ""
