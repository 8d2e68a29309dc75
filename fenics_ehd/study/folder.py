"""The folder of a study: which run is where, and which of them need not run again."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.folder import claim, clear, listed, locked
from fenics_ehd.base.output import require_writable, to_json, write_whole
from fenics_ehd.base.text_file import read_json
from fenics_ehd.reduction import load_body
from fenics_ehd.results.run_folder import BODY_FILE
from fenics_ehd.study.curves import Reference
from fenics_ehd.study.errors_file import errors_path
from fenics_ehd.study.outcome import Outcome
from fenics_ehd.study.plan import Study

#: Beside the files of an ordinary run: what came of it, and of which settings.
OUTCOME = "outcome.json"

#: What makes a folder a study, and what study and report leave there beside reduced bodies.
STUDY = "study.json"
MADE = ("table.csv", "reference.json", "report.html", "report.md", "figures/", "runs/", STUDY)

#: Share of the simulated time that the last step of a complete run may lack.
ROUND_OFF = 1e-9


class StudyFolder:
    """Folder of one study, held by one process at a time.

    Parameters
    ----------
    directory
        Created when missing.
    study
        What it is for.
    overwrite
        Forget all runs, tables and the report; reduced bodies are named by what they are and stay.

    Raises
    ------
    InputError
        It cannot be written to, or holds the study of another scene.
    InUseError
        Another process works in it.
    """

    def __init__(self, directory: str | Path, study: Study, *, overwrite: bool = False):
        self.path, self.study = Path(directory), study
        require_writable(self.path)
        if not overwrite:
            self._require_same_scene(study.scene.name)
        self.path.mkdir(parents=True, exist_ok=True)
        self._lock = locked(self.path)
        try:
            claim(self.path, (*MADE, "bodies/"))
            if overwrite:
                clear(self.path, MADE)
            claim(self.path / "runs", [f"{name}/" for name in study.cases])
        except BaseException:
            self._lock.close()
            raise

    def forget_errors(self, run: str | None = None) -> None:
        """Remove what is kept of the errors of a run, and of others relative to it; of all."""
        for name in self.study.cases:
            own = errors_path(self.run(name), "*" if run in (None, name) else str(run))
            clear(own.parent, fnmatch.filter(listed(own.parent), own.name))

    def _require_same_scene(self, ours: str) -> None:
        path = self.path / STUDY
        if not path.exists():
            return
        try:
            theirs = read_json(path)["scene"]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(f"{path}: unreadable, choose another folder or --overwrite") from None
        if theirs != ours:
            raise InputError(
                f"{path}: scene = {theirs} there, {ours} here: choose another folder or --overwrite"
            )

    def run(self, name: str) -> Path:
        """Folder of a run."""
        return self.path / "runs" / name

    @property
    def bodies(self) -> Path:
        """Folder of the reduced bodies."""
        return self.path / "bodies"

    def outcome(self, name: str) -> Outcome | None:
        """What came of a run; None: it did not run, with other settings or version, or is damaged.

        The files of a run that is complete must be there, all its steps in them.
        """
        try:
            found = read_json(self.run(name) / OUTCOME)
            outcome = Outcome(found["status"], found["figures"])
            known = found["identity"] == self.study.identities[name]
            if known and (not outcome.complete or self._whole(name)):
                return outcome
        except (OSError, ValueError, KeyError, TypeError, InputError):
            pass
        return None

    def _whole(self, name: str) -> bool:
        """Whether the files of a complete run can be read and reach its end."""
        scene = self.study.cases[name].scene
        for body in self.study.cases[name].bodies:
            load_body(self.run(name) / BODY_FILE.format(body))
        run = Reference(self.run(name), scene, self.study.start)
        return bool(abs(run.times[-1] - scene.span) <= ROUND_OFF * scene.span)

    def store(self, name: str, outcome: Outcome) -> None:
        """Leave in a run's folder what came of it."""
        claim(self.run(name), [OUTCOME])
        values = {
            "identity": self.study.identities[name],
            "status": outcome.status,
            "figures": dict(outcome.figures),
        }
        write_whole(self.run(name) / OUTCOME, to_json(values) + "\n")

    def write(self, name: str, values: Mapping[str, Any]) -> None:
        """Write a JSON file, whole or not at all."""
        write_whole(self.path / name, to_json(values) + "\n")

    def __enter__(self) -> StudyFolder:
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()
