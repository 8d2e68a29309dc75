"""Tables of the report."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fenics_ehd.study.report.study_data import (
    LIMITING,
    NORMS,
    QUANTITIES,
    JointData,
    Quantity,
    StudyData,
    StudyRow,
)
from fenics_ehd.study.report.style import COLOURS, family

#: Errors that the table of costs asks for.
LIMITS = (0.1, 0.05, 0.02, 0.01, 0.005)

#: What can be wrong with a reference, and how it is named.
REFERENCE_ERRORS = {"step": "step size", "film": "film mesh", "basis": "basis"}

#: Figures in the table of all runs: column, head, factor to the head's unit, format.
FIGURES = (
    ("offline_s", "reduction [s]", 1.0, ".1f"),
    ("online_s", "integration [s]", 1.0, ".2f"),
    ("steps", "steps", 1.0, "g"),
    ("newton_iterations", "Newton iterations", 1.0, "g"),
    ("highest_frequency_Hz", "highest frequency [kHz]", 1e-3, ".3g"),
    ("estimated_gap_error_m", "estimate [µm]", 1e6, ".3g"),
    ("true_gap_error_m", "true gap error [µm]", 1e6, ".3g"),
)


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes
    ----------
    heads, rows
        Cells are text.
    words
        Number of leading columns that hold words; the others hold figures and are set right.
    """

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int = 1


def percent(value: float) -> str:
    """A share with two digits that mean something."""
    if not math.isfinite(value):
        return "?"
    return f"{100 * value:.0f} %" if abs(value) >= 0.995 else f"{100 * value:.2g} %"


def bounded(row: StudyRow, quantity: Quantity, norm: str = "max") -> str:
    """One error; where the reference's own is larger, that one as an upper limit."""
    words = percent(row.visible_error(quantity, norm))
    return f"≤ {words}" if row.bounded(quantity, norm) else words


def cost_table(joint: JointData) -> Table:
    """Fastest run of each method within given errors of both curves."""
    runs = {method: joint.measured("methods", "tolerance", method=method) for method in COLOURS}
    runs = {method: rows for method, rows in runs.items() if rows}
    table = [
        (percent(limit), *(_fastest(rows, limit) for rows in runs.values())) for limit in LIMITS
    ]
    return Table(
        ("largest error of both curves", *map(str.upper, runs)), tuple(table), 1 + len(runs)
    )


def _fastest(rows: list[StudyRow], limit: float) -> str:
    good = [row for row in rows if row.worst_error <= limit]
    if not good:
        return f"none, best {percent(min(row.worst_error for row in rows))}"
    row = min(good, key=lambda row: row["online_s"])
    words = [family(row)[3:].strip(), f"{row['coordinates']:.0f} coordinates"]
    told = ", ".join([*filter(None, words), f"tolerance {row['tolerance']:g}"])
    return f"{row['online_s']:.1f} s: {told}"


def run_table(study: StudyData) -> Table:
    """Every run of the study with its figures; the failed ones with their reason."""
    errors = (f"{q.key} error, {words}" for q in QUANTITIES for words in NORMS.values())
    heads = ("run", "joint", "method", "tolerance", "coordinates", *errors,
             *(head for _, head, _, _ in FIGURES))  # fmt: skip
    return Table(heads, tuple(_run_cells(row, len(heads)) for row in study.rows), words=3)


def _run_cells(row: StudyRow, length: int) -> tuple[str, ...]:
    about = (row["run"], row["joint"], family(row), _figure(row["tolerance"]))
    if not row.complete:
        return (*about, row["status"], *[""] * (length - 5))
    errors = (bounded(row, q, norm) if row.measured else "" for q in QUANTITIES for norm in NORMS)
    figures = (_figure(factor * row[column], form) for column, _, factor, form in FIGURES)
    return (*about, _figure(row["coordinates"]), *errors, *figures)


def _figure(value: float, form: str = "g") -> str:
    return format(value, form) if math.isfinite(value) else ""


def unknown_floors(study: StudyData) -> list[str]:
    """Which of the reference's own errors that limit a comparison were not taken, in words."""
    return [
        REFERENCE_ERRORS[kind]
        for kind in LIMITING
        if any(math.isnan(joint.own_error(kind, q)) for joint in study.joints for q in QUANTITIES)
    ]


def film_mesh_errors(joint: JointData) -> list[str]:
    """The error of the film mesh in both curves, none where it was not taken."""
    shared = [joint.own_error("film", quantity) for quantity in QUANTITIES]
    return [] if any(map(math.isnan, shared)) else [*map(percent, shared)]


def reference_table(study: StudyData) -> Table:
    """The reference's own errors."""
    norms = [(quantity, norm) for quantity in QUANTITIES for norm in NORMS]
    rows = []
    for kind, words in REFERENCE_ERRORS.items():
        entry = study.reference.get(kind) or {}
        for joint in study.joints if entry else ():
            figures = [joint.own_error(kind, *each) for each in norms]
            known = any(map(math.isfinite, figures))
            how = entry.get("how", "") if known else f"not taken: {entry.get('why')}"
            cells = map(percent, figures) if known else [""] * len(norms)
            rows.append((words, joint.name, str(how), *cells))
    heads = (f"{quantity.title}, {NORMS[norm]}" for quantity, norm in norms)
    return Table(("error of the reference", "joint", "measured by", *heads), tuple(rows), words=3)
