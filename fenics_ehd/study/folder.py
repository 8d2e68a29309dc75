"""The folder of a study: which run is where, and which of them need not run again."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from fenics_ehd.errors import InputError
from fenics_ehd.history_file import CSV_NAME
from fenics_ehd.output import require_writable, to_json, write_whole
from fenics_ehd.study.plan import Study, StudyRun
from fenics_ehd.sweeps.lock import locked
from fenics_ehd.sweeps.work import Outcome

#: Beside the files of an ordinary run: what came of it, and of which settings.
OUTCOME = "outcome.json"


class StudyFolder:
    """Folder of one study, held by one process at a time.

    Parameters
    ----------
    directory
        Created when missing.
    study
        What it is for.
    overwrite
        Forget all runs and tables; reduced bodies are named by what they are and stay.

    Raises
    ------
    InputError
        It cannot be written to, or holds the study of another scene.
    SweepInUseError
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
            shutil.rmtree(self.path / "runs", ignore_errors=True)
            (self.path / "study.json").unlink(missing_ok=True)

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

    def outcome(self, run: StudyRun) -> Outcome | None:
        """What came of a run; None: it did not run, or with other settings or another version."""
        try:
            found = json.loads((self.run(run.name) / OUTCOME).read_text())
            whole = (self.run(run.name) / CSV_NAME).exists() or found["status"] != "complete"
            if found["identity"] == run.identity and whole:
                return Outcome(found["status"], found["figures"])
        except (OSError, ValueError, KeyError, TypeError):
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


def store_outcome(directory: Path, identity: str, outcome: Outcome) -> None:
    """Leave in a run's folder what came of it."""
    directory.mkdir(parents=True, exist_ok=True)
    values = {"identity": identity, "status": outcome.status, "figures": dict(outcome.figures)}
    write_whole(directory / OUTCOME, json.dumps(values, indent=2) + "\n")
