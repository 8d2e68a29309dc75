"""The folder of a study: which run is where, and which of them need not run again."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from fenics_ehd.errors import BodyFileError, InputError
from fenics_ehd.history_file import read_fields, read_history
from fenics_ehd.lock import locked
from fenics_ehd.output import require_writable, to_json, write_whole
from fenics_ehd.reduction import load_body
from fenics_ehd.study.errors_file import errors_path
from fenics_ehd.study.plan import Study, StudyRun
from fenics_ehd.sweeps.work import Outcome

#: Beside the files of an ordinary run: what came of it, and of which settings.
OUTCOME = "outcome.json"

#: What a study and its report leave in its folder, beside runs and reduced bodies.
TABLES = ("table.csv", "reference.json", "statements.csv", "report.html", "report.md")
FIGURES = "figures"

#: What a comparison reads of a run's fields; the second ones not every body has.
FIELDS, MORE_FIELDS = ("coordinates", "rates", "pressure_Pa"), ("quasi_static",)


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
        self.path = Path(directory)
        require_writable(self.path)
        if not overwrite:
            self._require_same_scene(study)
        self.path.mkdir(parents=True, exist_ok=True)
        self._lock = locked(self.path / "study.lock")
        if overwrite:
            self._forget()

    def _forget(self) -> None:
        shutil.rmtree(self.path / "runs", ignore_errors=True)
        if (self.path / "study.json").exists():  # else the figures are not of a study
            shutil.rmtree(self.path / FIGURES, ignore_errors=True)
        # The one that makes the folder a study last, in case this is interrupted.
        for name in (*TABLES, "study.json"):
            (self.path / name).unlink(missing_ok=True)

    def forget_errors(self, run: str = "*") -> None:
        """Remove what is kept of the errors of a run, and of others relative to it; of all."""
        for pattern in (errors_path(Path(run), "*"), errors_path(Path("*"), run)):
            for path in (self.path / "runs").glob(str(pattern)):
                path.unlink(missing_ok=True)

    def _require_same_scene(self, study: Study) -> None:
        path = self.path / "study.json"
        if not path.exists():
            return
        try:
            theirs = json.loads(path.read_text())["scene"]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(f"{path}: unreadable, choose another folder or --overwrite") from None
        if theirs != study.scene:
            raise InputError(
                f"{path}: scene = {theirs} there, {study.scene} here: "
                "choose another folder or --overwrite"
            )

    def run(self, name: str) -> Path:
        """Folder of a run."""
        return self.path / "runs" / name

    def body(self, name: str) -> Path:
        """File of a reduced body."""
        return self.path / "bodies" / f"{name}.h5"

    def has_body(self, name: str) -> bool:
        """Whether there is such a reduced body, and its file can be read."""
        try:
            load_body(self.body(name))
        except BodyFileError:
            return False
        return True

    def outcome(self, run: StudyRun) -> Outcome | None:
        """What came of a run; None: it did not run, with other settings or version, or is damaged.

        The history of a run that is complete must have all its steps, in both of its files.
        """
        try:
            found = json.loads((self.run(run.name) / OUTCOME).read_text())
            outcome = Outcome(found["status"], found["figures"])
            known = found["identity"] == run.identity
            if known and (outcome.status != "complete" or _whole(self.run(run.name), outcome)):
                return outcome
        except (OSError, ValueError, KeyError, TypeError, InputError):
            pass
        return None

    def write(self, name: str, values: Mapping[str, Any]) -> None:
        """Write a JSON file, whole or not at all."""
        write_whole(self.path / name, to_json(values) + "\n")

    def __enter__(self) -> StudyFolder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._lock.close()


def _whole(directory: Path, outcome: Outcome) -> bool:
    """Whether the history of a complete run has all its steps."""
    fields = read_fields(directory, FIELDS) | read_fields(directory, MORE_FIELDS, optional=True)
    found = {len(values) for values in (read_history(directory)["time_s"], *fields.values())}
    return found == {outcome.figures["steps"]}


def store_outcome(directory: Path, identity: str, outcome: Outcome) -> None:
    """Leave in a run's folder what came of it."""
    directory.mkdir(parents=True, exist_ok=True)
    values = {"identity": identity, "status": outcome.status, "figures": dict(outcome.figures)}
    write_whole(directory / OUTCOME, json.dumps(values, indent=2) + "\n")
