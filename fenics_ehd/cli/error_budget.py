"""The error budget of a run, printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fenics_ehd.multibody.error_shares import NOT_APPLICABLE, NOT_ESTIMATED

#: Words of the table, by key.
COMPONENTS = {
    "basis": "basis",
    "film_mesh": "film mesh",
    "part_mesh": "part mesh",
    "step_size": "step size",
    "start": "start",
}
ROWS = {"max_pressure": "peak pressure", "min_film_thickness": "thinnest film"}

#: What the figures of a budget are.
MEANING = (
    "  +- beside a value: how far that one may be off; over the cycle: how far the curve is off\n"
    "  where it is worst, in per cent of the peak pressure, or of the film at that moment"
)


def share(value: float | str) -> str:
    """A relative error in per cent, or why there is none in a word."""
    if isinstance(value, str):
        return "-" if value == NOT_APPLICABLE else value
    return f"{100 * value:.2g} %"


def total(errors: Mapping[str, Any]) -> str:
    """All errors together, ``1.9 %``; ``> 0.5 %`` where one of them is not known."""
    lacking = isinstance(errors["total"], str) and not isinstance(errors["known"], str)
    return "> " * lacking + share(errors["known"])


def beside(joint: Mapping[str, Any], quantity: str, value: float, unit: str) -> str:
    """What stands beside a result in its unit; nothing without a budget.

    ``+- 28 %, too high by about 13 MPa``: of most of the error the sign is known. A sum that lacks
    a component says so.
    """
    budget = joint.get("error_budget")
    if budget is None:
        return ""
    errors = budget[quantity]
    words = [f"+- {share(errors['known'])}"]
    lacking = [COMPONENTS[key] for key in COMPONENTS if errors[key] == NOT_ESTIMATED]
    if lacking and not isinstance(errors["known"], str):
        words.append(f"{' and '.join(lacking)} not included")
    elif not lacking and abs(errors["bias"]) > 0.5 * errors["known"]:
        way = "high" if errors["bias"] > 0 else "low"
        words.append(f"too {way} by about {abs(errors['bias']) * value:.2g} {unit}")
    return ", ".join([*words, ""]) if words[1:] else f"{words[0]} "


def budget_table(joints: Mapping[str, Mapping[str, Any]], summary: Mapping[str, Any]) -> list[str]:
    """Lines of all joints' budgets, extremes and the largest over the cycle."""
    known = {name: own["error_budget"] for name, own in joints.items() if "error_budget" in own}
    if not known:
        return []
    header = ["estimated errors", *COMPONENTS.values(), "total"]
    rows = []
    for name, budget in known.items():
        largest = budget["largest_over_cycle"]
        for where, errors in (("", budget), (", over the cycle", largest)):
            for quantity, words in ROWS.items():
                values = [share(errors[quantity][key]) for key in COMPONENTS]
                rows.append([f"{name}: {words}{where}", *values, total(errors[quantity])])
    notes = summary.get("error_budget_notes", {})
    lines = [*aligned([header, *rows]), MEANING]
    return lines + [f"  {COMPONENTS[key]} not estimated: {why}" for key, why in notes.items()]


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table, names to the left, figures to the right, the first row its heads."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  " + "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])])
        for row in rows
    ]
