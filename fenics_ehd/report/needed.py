"""What a statement is judged by: runs that must all have ended before anything is said."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

from fenics_ehd.report.curves import REFERENCE_RUN, History
from fenics_ehd.report.study_data import Study, StudyRun

T = TypeVar("T")

#: Numbers of coordinates this close count as equal.
EQUAL_COORDINATES = 0.1

#: Coordinates that a basis may have beside the modes asked for.
RIGID_MOTION = 6

#: Missing runs that are named.
NAMED = 3


class MissingRunsError(LookupError):
    """The study does not hold, or not yet, what a statement is judged by."""


def need(found: Sequence[T], what: str) -> list[T]:
    """What was found.

    Raises
    ------
    MissingRunsError
        Nothing was.
    """
    if not found:
        raise MissingRunsError(what)
    return list(found)


def ended(study: Study, **wanted: Any) -> list[StudyRun]:
    """Measured runs of the comparison of methods with these values, by coordinates.

    Runs whose steps or film broke down are left out: they are no better than the others.

    Raises
    ------
    MissingRunsError
        One of them has not ended, or failed for a reason that says nothing about its model.
    """
    planned = study.planned(**wanted)
    _refuse([run for run in planned if not (run.measured or run.broke_down)])
    _refuse_unnamed(study)
    return study.pick(**wanted)


def every(study: Study, **wanted: Any) -> list[StudyRun]:
    """The same where a run that broke down leaves a hole: `MissingRunsError` for it as well."""
    found = ended(study, **wanted)
    _refuse([run for run in study.planned(**wanted) if not run.measured])
    return found


def runs_of(study: Study, what: str, **wanted: Any) -> list[StudyRun]:
    """Every run with these values, at least one, or `MissingRunsError`."""
    return need(every(study, **wanted), what)


def of_size(study: Study, coordinates: float, **wanted: Any) -> list[StudyRun]:
    """The run with about so many coordinates, the nearest; none where none was planned.

    Raises
    ------
    MissingRunsError
        One that may have so many is not measured.
    """
    planned = [run for run in study.planned(**wanted) if _may_have(run, coordinates)]
    _refuse([run for run in planned if not run.measured])
    _refuse_unnamed(study)
    return near(planned, coordinates)[:1]


def _refuse_unnamed(study: Study) -> None:
    """A table of an older version does not tell which runs are missing: any may be needed."""
    if study.unnamed:
        raise MissingRunsError(f"what is still to come, {study.unnamed} of the study's runs")


def _refuse(missing: Sequence[StudyRun]) -> None:
    if missing:
        words = [f"{run.run} ({_state(run)})" for run in missing[:NAMED]]
        words += [f"{len(missing) - NAMED} more"] if len(missing) > NAMED else []
        raise MissingRunsError(", ".join(words))


def _state(run: StudyRun) -> str:
    return "not compared with the reference" if run.complete else run.status


def _may_have(run: StudyRun, coordinates: float) -> bool:
    """Whether a run has about so many coordinates, or may turn out to have."""
    if math.isfinite(run.coordinates):
        return bool(near([run], coordinates))
    if not math.isfinite(run.modes):
        return True
    least, most = (1 - EQUAL_COORDINATES) * coordinates, (1 + EQUAL_COORDINATES) * coordinates
    return run.modes <= most and run.modes + RIGID_MOTION >= least


def near(runs: Iterable[StudyRun], coordinates: float) -> list[StudyRun]:
    """Runs with about this many coordinates, the nearest first."""
    distance = {run: abs(run.coordinates / coordinates - 1) for run in runs}
    close = [run for run, value in distance.items() if value <= EQUAL_COORDINATES]
    return sorted(close, key=lambda run: (distance[run], run.run))


def reference_history(study: Study, until: float = 0.0) -> History:
    """History of a reference that came to its end, and that at this time [s] or later.

    Raises
    ------
    MissingRunsError
        There is none.
    """
    history = study.history(REFERENCE_RUN) if study.judged else None
    if history is None:
        raise MissingRunsError("the reference, complete")
    # Steps end at sums of binary fractions.
    if history["time_s"][-1] < until * (1 - 1e-9):
        raise MissingRunsError(f"a reference that reaches {1e3 * until:g} ms")
    return history


def history_of(study: Study, run: StudyRun) -> History:
    """History of a run, or `MissingRunsError`."""
    history = study.history(run.run)
    if history is None:
        raise MissingRunsError(f"the history of {run.run}")
    return history
