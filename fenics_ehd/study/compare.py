"""Errors of a study's runs, once the runs that they are relative to are complete."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fenics_ehd.errors import EhdError
from fenics_ehd.history_file import read_history
from fenics_ehd.reduction import ReducedBody, load_body
from fenics_ehd.study.curves import Errors, Reference, RunCurves
from fenics_ehd.study.errors_file import errors_path, write_errors
from fenics_ehd.study.folder import StudyFolder, store_outcome
from fenics_ehd.study.plan import REFERENCE, Row, Study
from fenics_ehd.sweeps.work import Outcome, failed

T = TypeVar("T")

#: The reference's own errors that limit a comparison with runs on its own film mesh.
LIMITING = ("step", "basis")

#: What damaged files lead to: the last two where something is missing, or numbers do not fit.
DAMAGE = (EhdError, KeyError, ValueError)


class Comparison:
    """Compares runs of a study and remembers what it found.

    A run whose files turn out unusable has failed from then on, here and on the disk: it ends
    nothing, and is run again by the next call of the program.

    Parameters
    ----------
    study, folder
        The study and its results.
    """

    def __init__(self, study: Study, folder: StudyFolder):
        self._study, self._folder = study, folder
        self._outcomes: dict[str, Outcome] = {}
        self._references: dict[str, Reference] = {}
        self._errors: dict[tuple[str, str], Errors] = {}
        self._estimates: dict[str, float] = {}
        self._bodies: dict[str, ReducedBody] = {}

    def add(self, name: str, outcome: Outcome | None) -> None:
        """Account for a run that ended; None: it did not."""
        if outcome is not None:
            self._outcomes[name] = outcome

    def outcome(self, name: str) -> Outcome | None:
        """What came of a run, None before it ended."""
        return self._outcomes.get(name)

    def complete(self, name: str) -> bool:
        """Whether a run ended well."""
        outcome = self._outcomes.get(name)
        return outcome is not None and outcome.status == "complete"

    def compare(self, check: Callable[[], None] = lambda: None) -> None:
        """Find all errors that can be found so far: which runs are unusable is known afterwards.

        Parameters
        ----------
        check
            Called between two runs; may raise `KeyboardInterrupt`.
        """
        for row in self._study.rows:
            check()
            self.body(row.run)
            self.estimate(row.run)
            for against in filter(None, (row.against, row.own)):
                self.errors(row.run, against)

    def errors(self, run: str, against: str) -> Errors | None:
        """Of a run relative to another one; None: one of them is not complete, or they are one."""
        if run == against or not (self.complete(run) and self.complete(against)):
            return None
        if (run, against) not in self._errors:
            found = self._compared(run, against)
            if found is None:
                return None
            self._errors[run, against] = found
        return self._errors[run, against]

    def _compared(self, run: str, against: str) -> Errors | None:
        """Errors of two complete runs, kept in a file as well; None: one of them failed."""
        start = self._study.start
        reference = self._reference(against)
        curves = self._unless_damaged(run, lambda: RunCurves(*self._files(run)).prepare(start))
        if reference is None or curves is None:
            return None
        found = self._unless_damaged(run, lambda: reference.differences(curves, start))
        if found is None:
            return None
        write_errors(errors_path(self._folder.run(run), against), found)
        return found.errors

    def estimate(self, run: str) -> float | None:
        """Largest error of the gap that a run itself estimates, while errors count [m]."""
        if not self.complete(run):
            return None
        if run not in self._estimates:
            found = self._unless_damaged(run, lambda: self._estimated(run))
            if found is None:
                return None
            self._estimates[run] = found
        return self._estimates[run]

    def _estimated(self, run: str) -> float:
        history = read_history(self._folder.run(run))
        later = history["time_s"] >= self._study.start
        return float(history["basis_error_estimate_m"][later].max(initial=0.0))

    def body(self, run: str) -> ReducedBody | None:
        """Reduced body of a complete run, without the flexibility that it misses."""
        if not self.complete(run):
            return None
        name = self._study.runs[run].body
        if name not in self._bodies:
            path = self._folder.body(name)
            found = self._unless_damaged(run, lambda: load_body(path))
            if found is None:
                return None
            self._bodies[name] = replace(found, missing_flexibility=np.zeros((0, 0)))
        return self._bodies[name]

    def _unless_damaged(self, name: str, make: Callable[[], T]) -> T | None:
        """What is made of a run's files; None: they are unusable, and the run has failed."""
        try:
            return make()
        except DAMAGE as error:
            self.fail(name, error)
            return None

    def fail(self, name: str, error: Exception) -> None:
        """Account for a complete run whose files are unusable, or its body's."""
        outcome = failed(error)
        self._outcomes[name] = outcome
        self._folder.forget_errors(name)
        store_outcome(self._folder.run(name), self._study.runs[name].identity, outcome)

    def why_not(self, run: str, against: str) -> str:
        """Why two runs cannot be compared."""
        for name in (run, against):
            if not self.complete(name):
                outcome = self.outcome(name)
                return f"{name}: {outcome.status if outcome else 'not run'}"
        return ""

    def own_error(self, kind: str) -> Errors | None:
        """One of the reference's own errors."""
        check = self._study.checks[kind]
        return self.errors(check.run, REFERENCE)

    def floor(self, row: Row) -> tuple[float | None, float | None]:
        """Errors of pressure and film below which this row's mean nothing; None: unknown.

        On the film mesh of the reference its step and basis error, and that of the pressure
        between its steps; on other meshes the error of the last mesh but the finest one.
        """
        if row.against == REFERENCE:
            own = [self.own_error(kind) for kind in LIMITING]
        else:
            last = [r.run for r in self._study.rows if r.against == row.against and row.against]
            own = [self.errors(last[-1], row.against)] if last else []
        known = [errors for errors in own if errors is not None]
        if not known or len(known) < len(own):
            return None, None
        between = self.interpolation_error() if row.against == REFERENCE else 0.0
        return max(between, *(e.pressure_max for e in known)), max(e.film_max for e in known)

    def interpolation_error(self) -> float:
        """Of the reference's peak pressure between its steps, relative; 0: negligible, or none."""
        reference = self._reference(REFERENCE) if self.complete(REFERENCE) else None
        return reference.interpolation_error(self._study.start) if reference else 0.0

    def _reference(self, name: str) -> Reference | None:
        """A run to compare with; None: it is unusable."""
        if name not in self._references:
            start = self._study.start
            made = self._unless_damaged(name, lambda: Reference(*self._files(name)).prepare(start))
            if made is None:
                return None
            self._references[name] = made
        return self._references[name]

    def _files(self, name: str) -> tuple[Path, Any, ReducedBody]:
        """Folder, settings and body of a run."""
        run = self._study.runs[name]
        return self._folder.run(name), run.case.settings, load_body(self._folder.body(run.body))
