"""Errors of a study's runs, once the runs that they are relative to are complete."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fenics_ehd.history_file import read_history
from fenics_ehd.reduction import ReducedBody, load_body
from fenics_ehd.study.curves import Errors, Reference, RunCurves
from fenics_ehd.study.folder import StudyFolder
from fenics_ehd.study.plan import REFERENCE, Row, Study
from fenics_ehd.sweeps.work import Outcome

#: The reference's own errors that limit a comparison with runs on its own film mesh.
LIMITING = ("step", "basis")


class Comparison:
    """Compares runs of a study and remembers what it found.

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

    def errors(self, run: str, against: str) -> Errors | None:
        """Of a run relative to another one; None: one of them is not complete, or they are one."""
        if run == against or not (self.complete(run) and self.complete(against)):
            return None
        if (run, against) not in self._errors:
            reference = self._reference(against)
            self._errors[run, against] = reference.errors(self._curves(run), self._study.start)
        return self._errors[run, against]

    def estimate(self, run: str) -> float:
        """Largest error of the gap that a run itself estimates, while errors count [m]."""
        history = read_history(self._folder.run(run))
        later = history["time_s"] >= self._study.start
        return float(history["basis_error_estimate_m"][later].max(initial=0.0))

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

        On the film mesh of the reference its step and basis error; on other meshes the error of
        the last mesh but the finest one.
        """
        if row.against == REFERENCE:
            own = [self.own_error(kind) for kind in LIMITING]
        else:
            last = [r.run for r in self._study.rows if r.against == row.against and row.against]
            own = [self.errors(last[-1], row.against)] if last else []
        known = [errors for errors in own if errors is not None]
        if not known or len(known) < len(own):
            return None, None
        return max(e.pressure_max for e in known), max(e.film_max for e in known)

    def _curves(self, name: str) -> RunCurves:
        return RunCurves(*self._files(name))

    def _reference(self, name: str) -> Reference:
        if name not in self._references:
            self._references[name] = Reference(*self._files(name))
        return self._references[name]

    def _files(self, name: str) -> tuple[Path, Any, ReducedBody]:
        """Folder, settings and body of a run."""
        run = self._study.runs[name]
        return self._folder.run(name), run.case.settings, load_body(self._folder.body(run.body))
