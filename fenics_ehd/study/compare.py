"""Errors of a study's runs, once the runs that they are relative to are complete."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from fenics_ehd.base.errors import EhdError
from fenics_ehd.scenes.scene import Scene
from fenics_ehd.study.curves import Errors, Reference, StoredRun
from fenics_ehd.study.errors_file import errors_path, write_errors
from fenics_ehd.study.folder import StudyFolder
from fenics_ehd.study.outcome import Outcome, failed
from fenics_ehd.study.plan import REFERENCE, Row, Study

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
        self._errors: dict[tuple[str, str], Mapping[str, Errors]] = {}
        self._estimates: dict[str, Mapping[str, float]] = {}

    def add(self, name: str, outcome: Outcome) -> None:
        """Account for a run that ended."""
        self._outcomes[name] = outcome

    def outcome(self, name: str) -> Outcome | None:
        """What came of a run, None before it ended."""
        return self._outcomes.get(name)

    def complete(self, name: str) -> bool:
        """Whether a run ended well."""
        outcome = self._outcomes.get(name)
        return outcome is not None and outcome.complete

    def compare(self, check: Callable[[], None] = lambda: None) -> None:
        """Find all errors that can be found so far: which runs are unusable is known afterwards.

        Parameters
        ----------
        check
            Called between two runs; may raise `KeyboardInterrupt`.
        """
        for row in self._study.rows:
            check()
            self.estimates(row.run)
            for against in filter(None, (row.against, row.own)):
                self.errors(row.run, against)

    def errors(self, run: str, against: str) -> Mapping[str, Errors] | None:
        """Of a run relative to another, by joint; None: one is not complete, or they are one."""
        if run == against or not (self.complete(run) and self.complete(against)):
            return None
        if (run, against) not in self._errors:
            if against not in self._references:
                made = self._unless_damaged(against, lambda: Reference(*self._files(against)))
                if made is None:
                    return None
                self._references[against] = made
            found = self._unless_damaged(run, lambda: self._compared(run, against))
            if found is None:
                return None
            self._errors[run, against] = found
        return self._errors[run, against]

    def _compared(self, run: str, against: str) -> Mapping[str, Errors]:
        """Errors by joint, kept in a file as well."""
        curves = StoredRun(*self._files(run))
        times, found = self._references[against].differences(curves)
        write_errors(errors_path(self._folder.run(run), against), times, found)
        return {joint: differences.errors for joint, differences in found.items()}

    def _files(self, name: str) -> tuple[Path, Scene, float]:
        return self._folder.run(name), self._study.cases[name].scene, self._study.start

    def estimates(self, run: str) -> Mapping[str, float]:
        """Largest errors of gaps that a complete run estimates itself, by joint [m]."""
        if run not in self._estimates and self.complete(run):
            found = self._unless_damaged(run, lambda: StoredRun(*self._files(run)).estimates())
            self._estimates[run] = found or {}
        return self._estimates.get(run, {})

    def _unless_damaged(self, name: str, make: Callable[[], T]) -> T | None:
        """What is made of a run's files; None: they are unusable, and the run has failed."""
        try:
            return make()
        except DAMAGE as error:
            self._outcomes[name] = failed(error)
            self._folder.forget_errors(name)
            self._folder.store(name, self._outcomes[name])
            return None

    def why_not(self, run: str, against: str) -> str:
        """Why two runs cannot be compared."""
        for name in (run, against):
            if not self.complete(name):
                outcome = self.outcome(name)
                return f"{name}: {outcome.status if outcome else 'not run'}"
        return ""

    def own_error(self, kind: str) -> Mapping[str, Errors] | None:
        """One of the reference's own errors, by joint."""
        return self.errors(self._study.checks[kind].run, REFERENCE)

    def floor(self, row: Row, joint: str) -> tuple[float | None, float | None]:
        """Errors of pressure and film below which this row's mean nothing; None: unknown.

        On the film mesh of the reference its step and basis error; on other meshes the error of
        the last mesh but the finest one.
        """
        if row.against == REFERENCE:
            own = [self.own_error(kind) for kind in LIMITING]
        else:
            last = [r.run for r in self._study.rows if r.against == row.against and row.against]
            own = [self.errors(last[-1], row.against)] if last else []
        known = [errors[joint] for errors in own if errors is not None]
        if not known or len(known) < len(own):
            return None, None
        return max(e.pressure_max for e in known), max(e.film_max for e in known)
