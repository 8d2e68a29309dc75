"""``reference.json``: what all runs are measured against, and how good that is itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fenics_ehd.reduction.residual_modes import RANK_TOLERANCE
from fenics_ehd.study.compare import Comparison
from fenics_ehd.study.curves import Errors
from fenics_ehd.study.outcome import Outcome
from fenics_ehd.study.plan import REFERENCE, Study

#: Names of `Errors.relative`.
ERRORS = ("pressure_max", "pressure_l2", "film_max", "film_l2")

#: Why static columns are left out.
DROPPED = f"they depend on the others to {RANK_TOLERANCE:g} of the largest strain energy"

#: By how much more cells, in both directions, a film mesh shows the error of another one.
FINER = 1.2


def describe_reference(study: Study, comparison: Comparison) -> dict[str, Any]:
    """Method, basis, steps and own errors of the reference; these are the largest of all joints.

    Parameters
    ----------
    study, comparison
        The study and its errors so far.
    """
    case = study.cases[REFERENCE]
    outcome = comparison.outcome(REFERENCE)
    settings = next(iter(case.bodies.values())).settings.reduction
    found: dict[str, Any] = {
        "run": REFERENCE,
        "method": settings.method,
        "status": outcome.status if outcome else "not run",
        "tolerance": case.scene.time.tolerance,
        "order": case.scene.time.order,
        "start": study.start,
    }
    if outcome is not None and outcome.complete:
        cells = outcome.figures["film_cells"]
        found["film_cells"] = cells if len(cells) > 1 else next(iter(cells.values()))
        names = ("coordinates", "pressure_columns", "dropped_columns")
        found |= {name: outcome.figures[name] for name in names}
        found["dropped_because"] = DROPPED if found["dropped_columns"] else ""
    return found | {kind: _own_error(study, comparison, kind) for kind in ("step", "film", "basis")}


def _own_error(study: Study, comparison: Comparison, kind: str) -> dict[str, Any]:
    check = study.checks[kind]
    errors = comparison.own_error(kind)
    if errors is None:
        return dict.fromkeys(ERRORS) | {"why": comparison.why_not(check.run, REFERENCE)}
    if kind == "film" and (coarse := _too_coarse(study, comparison)):
        return dict.fromkeys(ERRORS) | {"why": coarse}
    joints = {joint: found.relative() for joint, found in errors.items()}
    about = {"run": check.run, "against": REFERENCE, "how": check.meaning}
    return _largest(errors) | about | ({"joints": joints} if len(joints) > 1 else {})


def _largest(errors: Mapping[str, Errors]) -> dict[str, float]:
    return {name: max(e.relative()[name] for e in errors.values()) for name in ERRORS}


def _too_coarse(study: Study, comparison: Comparison) -> str:
    """Why a mesh shows nothing of the films' error; empty: it does."""
    check = study.checks["film"].run
    fine, own = (_cells(comparison.outcome(run)) for run in (check, REFERENCE))
    for joint in study.joints:
        numbers = zip(fine[joint].split("x"), own[joint].split("x"), strict=True)
        if not all(int(more) >= FINER * int(few) for more, few in numbers):
            return (
                f"{check}: the film of {joint}, {fine[joint]} cells, is not finer than {own[joint]}"
            )
    return ""


def _cells(outcome: Outcome | None) -> Mapping[str, str]:
    assert outcome is not None  # it was compared
    return outcome.figures["film_cells"]
