"""``reference.json``: what all runs are measured against, and how good that is itself."""

from __future__ import annotations

from typing import Any

from fenics_ehd.reduction import ReducedBody
from fenics_ehd.reduction.residual_modes import RANK_TOLERANCE
from fenics_ehd.study.compare import Comparison
from fenics_ehd.study.film_check import finer
from fenics_ehd.study.plan import REFERENCE, Check, Study
from fenics_ehd.study.table import cells_of, film_cells

#: Names of `Errors.relative`.
ERRORS = ("pressure_max", "pressure_l2", "film_max", "film_l2")


def describe_reference(study: Study, comparison: Comparison) -> dict[str, object]:
    """Method, basis, steps and own errors of the reference.

    Parameters
    ----------
    study, comparison
        The study and its errors so far.
    """
    run = study.runs[REFERENCE]
    settings = run.case.settings
    outcome = comparison.outcome(REFERENCE)
    found: dict[str, object] = {
        "run": REFERENCE,
        "method": settings.reduction.method,
        "status": outcome.status if outcome else "not run",
        "tolerance": settings.time.tolerance,
        "order": settings.time.order,
        "errors_count_from_s": study.start,
    }
    reduced = comparison.body(REFERENCE)
    if reduced is not None:
        found |= {"film_cells": film_cells(settings, reduced), **_basis(reduced)}
        between = comparison.interpolation_error()
        found |= {"pressure_interpolation_error": between} if between else {}
    kinds = ("step", "film", "basis")
    return found | {kind: _own_error(study, comparison, kind) for kind in kinds}


def _basis(body: ReducedBody) -> dict[str, object]:
    """Coordinates, and the static columns that were left out with the reason."""
    dropped = int(body.accuracy.get("static_dropped", 0.0))
    reason = f"they depend on the others to {RANK_TOLERANCE:g} of the largest strain energy"
    return {
        "coordinates": body.modes,
        "pressure_columns": len(body.pressure_nodes),
        "dropped_columns": dropped,
        "dropped_because": reason if dropped else "",
    }


def _own_error(study: Study, comparison: Comparison, kind: str) -> dict[str, Any]:
    check = study.checks[kind]
    errors = comparison.own_error(kind)
    if errors is None:
        missing = comparison.why_not(check.run, REFERENCE)
        return dict.fromkeys(ERRORS) | {"why": missing}
    if kind == "film" and (coarse := _too_coarse(study, check, comparison)):
        return dict.fromkeys(ERRORS) | {"why": coarse}
    about = {"run": check.run, "against": REFERENCE, "how": check.meaning}
    return errors.relative() | about


def _too_coarse(study: Study, check: Check, comparison: Comparison) -> str:
    """Why a mesh shows nothing of the film's error; empty: it does."""
    cells = []
    for name in (check.run, REFERENCE):
        body = comparison.body(name)
        assert body is not None  # it was compared
        cells.append(cells_of(study.runs[name].case.settings, body))
    if finer(*cells):
        return ""
    fine, own = ("x".join(map(str, each)) for each in cells)
    return f"{check.run}: its film of {fine} cells is not finer than {own}"
