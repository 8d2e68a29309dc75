"""Tables of the report."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from typing import Any

from fenics_ehd.report.document import Table
from fenics_ehd.report.nested import flat
from fenics_ehd.report.statement import Statement, bounded, percent
from fenics_ehd.report.study_data import LIMITING, NORMS, QUANTITIES, Study, StudyRun
from fenics_ehd.report.style import family

#: Errors that the table of costs asks for.
LIMITS = (0.1, 0.05, 0.02, 0.01, 0.005)

METHODS = ("m1", "m2", "m3", "m4")

#: What can be wrong with a reference, and how it is named.
REFERENCE_ERRORS = {
    "step": "step size",
    "film": "film mesh",
    "basis": "basis",
}


def cost_table(study: Study) -> Table:
    """Fastest run of each method within given errors of both curves."""
    runs = study.group("methods", "tolerance")
    present = [name for name in METHODS if any(run.method == name for run in runs)]
    rows = []
    for limit in LIMITS:
        cells = []
        for method in present:
            own = [run for run in runs if run.method == method]
            good = [run for run in own if run.worst_error <= limit]
            fastest = min(good, key=lambda run: run.online_s, default=None)
            best = percent(min(run.worst_error for run in own))
            cells.append(f"none, best {best}" if fastest is None else _cost(fastest))
        rows.append((percent(limit), *cells))
    heads = ("largest error of both curves", *(name.upper() for name in present))
    caption = (
        "Fastest run of each method within an error: processor time of the integration, and with "
        "what it was reached."
    )
    return Table(heads, tuple(rows), caption, words=1 + len(present))


def _cost(run: StudyRun) -> str:
    named = family(run)[3:].strip()
    variant = f"{named}, " if named else ""
    return (
        f"{run.online_s:.1f} s: {variant}{run.coordinates:.0f} coordinates, tolerance "
        f"{run.tolerance:g}, reduction {run.offline_s:.1f} s"
    )


def run_table(study: Study) -> Table:
    """Every run of the study with its figures; the failed ones with their reason."""
    heads = ("run", "method", "tolerance", "coordinates",
             *(f"{q.key} error, {words}" for q in QUANTITIES for words in NORMS.values()),
             "reduction [s]", "integration [s]", "steps", "Newton iterations",
             "highest frequency [kHz]", "estimate [µm]", "true gap error [µm]")  # fmt: skip
    rows = [_run_row(run) for run in study.runs]
    return Table(heads, tuple(rows), "Every run; relative errors.", words=2, folded=True)


def _run_row(run: StudyRun) -> tuple[str, ...]:
    if not run.complete:
        return (run.run, family(run), _figure(run.tolerance), run.status, *[""] * 11)
    compared = [
        bounded(run, quantity, norm) if run.measured else ""
        for quantity in QUANTITIES
        for norm in NORMS
    ]
    return (
        run.run, family(run), _figure(run.tolerance), _figure(run.coordinates), *compared,
        _figure(run.offline_s, ".1f"), _figure(run.online_s, ".2f"), _figure(run.steps),
        _figure(run.newton_iterations), _figure(1e-3 * run.highest_frequency_hz, ".3g"),
        _figure(1e6 * run.estimated_gap_error_m, ".3g"), _figure(1e6 * run.true_gap_error_m, ".3g"),
    )  # fmt: skip


def _figure(value: float, form: str = "g") -> str:
    return format(value, form) if math.isfinite(value) else ""


def reference_name(study: Study) -> str:
    """What all runs are compared with."""
    found = study.reference
    name = {"full": "the full interface", "m4": "M4"}.get(str(found.get("method")), "not there yet")
    if found.get("tolerance") is None or name == "not there yet":
        return name
    return f"{name} at tolerance {found['tolerance']:g}, order {found.get('order', '?')}"


def floor_remark(study: Study) -> str:
    """Below what no error is shown, and what of it is not known."""
    unknown = [REFERENCE_ERRORS[kind] for kind in study.unknown_floors]
    if not unknown:
        return (
            "No error below the reference's own, by its steps and its basis, is shown: grey bands "
            "are that error."
        )
    missing = f"The reference's own error by its {' and '.join(unknown)} is not known"
    if len(unknown) == len(LIMITING):
        return f"{missing}: small errors may mean nothing, and none is held back."
    return f"{missing}: grey bands, below which nothing is shown, are the other part of it alone."


def film_mesh_remark(study: Study) -> str:
    """The error that all runs share, in a sentence; empty where it was not taken."""
    shared = [study.own_error("film", quantity) for quantity in QUANTITIES]
    if not all(shared):
        return ""
    words = " and ".join(percent(value) for value in shared)
    return f"The film mesh, which all methods have in common, adds {words} to both curves."


def reference_table(study: Study) -> Table | None:
    """The reference's own errors, None before it is there."""
    norms = [f"{quantity.key}_{norm}" for quantity in QUANTITIES for norm in NORMS]
    rows = []
    for key, words in REFERENCE_ERRORS.items():
        entry = study.reference.get(key)
        if not isinstance(entry, Mapping):
            continue
        if entry.get("pressure_max") is None:
            rows.append((words, f"not taken: {entry.get('why')}", *[""] * len(norms)))
        else:
            figures = (percent(_number(entry.get(norm))) for norm in norms)
            rows.append((words, str(entry.get("how", "")), *figures))
    if not rows:
        return None
    heads = ("error of the reference", "measured by", *(
        f"{quantity.title}, {words}" for quantity in QUANTITIES for words in NORMS.values()
    ))  # fmt: skip
    return Table(heads, tuple(rows), "What the reference itself may be wrong by.", words=2)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def statement_table(
    study: Study, statements: Iterable[Statement], *, folded: bool = False
) -> Table:
    """Statements of the paper, what was measured, the verdict."""
    rows = []
    for statement in statements:
        finding = statement.judge(study)
        rows.append(
            (statement.place, statement.says, statement.rule, finding.measured, finding.verdict)
        )
    heads = ("where", "what it says", "we call it true if", "measured", "verdict")
    caption = "Errors are the largest ones of peak pressure / minimum film."
    return Table(heads, tuple(rows), caption, words=5, folded=folded)


def properties_table(title: str, values: Mapping[str, Any], *, folded: bool = False) -> Table:
    """Names and values, nested ones with a dot."""
    rows = tuple((name.replace("_", " "), _plain(value)) for name, value in flat(values))
    return Table(("", title), rows, words=2, folded=folded)


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(_plain, value))
    return "" if value is None else str(value)


def mesh_table(study: Study) -> Table | None:
    """Mesh of the part and of the film, as the reduced bodies tell; None without any."""
    bodies = study.bodies
    if not bodies:
        return None
    body = max(bodies, key=lambda body: len(body.pressure_nodes))
    told = body.provenance
    names = ("model", "cells", "element", "degrees_of_freedom", "film_element")
    values: dict[str, Any] = {name.replace("_", " "): told[name] for name in names if name in told}
    values |= {
        "bore radius [mm]": 1e3 * body.bore_radius,
        "bore width [mm]": 1e3 * body.bore_width,
        "nodes of the bore": len(body.bore_nodes),
        "pressure nodes": len(body.pressure_nodes),
        "mass [kg]": body.inertia.total_mass,
    }
    return properties_table("mesh", values)


def as_csv(table: Table) -> str:
    """A table as CSV text."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([table.heads, *table.rows])
    return text.getvalue()
