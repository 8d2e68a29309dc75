"""The error budget of a run, printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

#: Words of the table, by key.
COMPONENTS = {
    "basis": "basis",
    "film_mesh": "film mesh",
    "part_mesh": "part mesh",
    "step_size": "step size",
    "start": "start",
    "total": "total",
}
ROWS = {"max_pressure": "peak pressure", "min_film_thickness": "thinnest film"}


def share(value: float | str) -> str:
    """A relative error in per cent, or why there is none in a word."""
    if isinstance(value, str):
        return "-" if value == "not applicable" else value
    return f"{100 * value:.2g} %"


def beside(joint: Mapping[str, Any], quantity: str) -> str:
    """What stands beside a result: ``+- 1.9 %``; nothing without a budget."""
    budget = joint.get("error_budget")
    return "" if budget is None else f"+- {share(budget[quantity]['total'])} "


def budget_table(joints: Mapping[str, Mapping[str, Any]], summary: Mapping[str, Any]) -> list[str]:
    """Lines of all joints' budgets, extremes and the largest over the cycle."""
    known = {name: own["error_budget"] for name, own in joints.items() if "error_budget" in own}
    if not known:
        return []
    header = ["estimated errors", *COMPONENTS.values()]
    rows = []
    for name, budget in known.items():
        largest = budget["largest_over_cycle"]
        for where, errors in (("", budget), (", over the cycle", largest)):
            for quantity, words in ROWS.items():
                values = [share(errors[quantity][key]) for key in COMPONENTS]
                rows.append([f"{name}: {words}{where}", *values])
    notes = summary.get("error_budget_notes", {})
    lines = aligned([header, *rows])
    return lines + [f"  {COMPONENTS[key]} not estimated: {why}" for key, why in notes.items()]


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table, names to the left, figures to the right, the first row its heads."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  " + "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])])
        for row in rows
    ]
