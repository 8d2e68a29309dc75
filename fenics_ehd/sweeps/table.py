"""``sweep.csv``: one row for every case that ended, in the order in which they ended."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from fenics_ehd.errors import InputError
from fenics_ehd.lock import locked
from fenics_ehd.output import require_writable, write_whole
from fenics_ehd.sweeps.errors import OtherSweepError
from fenics_ehd.sweeps.plan import Case, Plan
from fenics_ehd.sweeps.values import as_text

#: Figures of a row, named as in ``summary.json``.
FIGURES = (
    "max_pressure_Pa",
    "min_film_thickness_m",
    "max_pressure_time_s",
    "min_film_thickness_time_s",
    "steps",
    "newton_iterations",
    "rejected_steps",
    "energy_balance_error",
    "basis_error_estimate_m",
    "reduction_time_s",
    "wall_time_s",
)


class SweepTable:
    """Rows of a sweep in a folder, on disk as soon as they are added.

    A case may have several rows, failed ones of former attempts: its last one counts.
    ``sweep.json`` beside them says which sweep they belong to.

    Parameters
    ----------
    directory
        Created when missing.
    plan
        The sweep.
    resume
        Insist on rows of a former attempt.
    overwrite
        Begin anew, whatever the folder holds.

    Raises
    ------
    OtherSweepError
        The folder holds the rows of another sweep.
    InUseError
        Another process is adding rows.
    InputError
        The folder cannot be written to, or has nothing to resume.
    """

    def __init__(
        self, directory: str | Path, plan: Plan, *, resume: bool = False, overwrite: bool = False
    ):
        self.directory = Path(directory)
        self.path = self.directory / "sweep.csv"
        self._plan = plan
        self._columns = ("case", *plan.keys, "status", *FIGURES)
        require_writable(self.directory)
        if resume and not self.path.is_file():
            raise InputError(f"--resume: {self.path} does not exist, there is nothing to resume")
        self.directory.mkdir(parents=True, exist_ok=True)
        self._file = locked(self.path)
        try:
            if overwrite:
                self._clear()
            self._rows = self._former_rows()
        except BaseException:
            self._file.close()
            raise

    def _clear(self) -> None:
        """Forget rows and histories; reduced bodies are named by what they are and stay."""
        self._file.truncate(0)
        for folder in self.directory.glob("runs/[0-9]*"):
            shutil.rmtree(folder)

    def _former_rows(self) -> dict[int, dict[str, str]]:
        """Rows by case, once it is sure that they are of this sweep; a new file gets its header."""
        self._file.seek(0)
        content = self._file.read()
        if content:
            self._require_same_sweep()
            # Whoever was killed in the middle of a row leaves the beginning of one.
            whole = content[: content.rfind(b"\n") + 1]
            self._file.truncate(len(whole))
            content = whole
        if not content:
            self._write_identity()
            self._append(self._columns)
            return {}
        return self._read(content.decode())

    def _require_same_sweep(self) -> None:
        try:
            theirs = json.loads((self.directory / "sweep.json").read_text())
        except (OSError, ValueError):
            theirs = None
        ours = dict(self._plan.identity)
        if not isinstance(theirs, dict):
            raise self._other("its sweep.json is missing or unreadable")
        for name in sorted({*ours, *theirs}):
            if ours.get(name) != theirs.get(name):
                raise self._other(f"{name} = {theirs.get(name)} there, {ours.get(name)} here")

    def _other(self, reason: str) -> OtherSweepError:
        return OtherSweepError(
            f"{self.path} belongs to another sweep ({reason}): "
            "choose another folder, or --overwrite"
        )

    def _write_identity(self) -> None:
        path = self.directory / "sweep.json"
        write_whole(path, json.dumps(dict(self._plan.identity), indent=2) + "\n")

    def _read(self, text: str) -> dict[int, dict[str, str]]:
        header, *lines = csv.reader(io.StringIO(text))
        if tuple(header) != self._columns:
            raise self._other("its columns are others")
        cases = {str(case.number): case for case in self._plan.cases}
        rows = {}
        for line in lines:
            case = cases.get(line[0]) if len(line) == len(header) else None
            if case is None or line[1 : 1 + len(case.values)] != [*map(as_text, case.values)]:
                raise self._other(f"the row {','.join(line)[:60]!r} is none of its cases")
            rows[case.number] = dict(zip(header, line, strict=True))
        return rows

    def _append(self, cells: tuple[str, ...]) -> None:
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(cells)
        self._file.write(line.getvalue().encode())
        self._file.flush()
        os.fsync(self._file.fileno())

    def add(self, case: Case, status: str, figures: Mapping[str, Any]) -> None:
        """Append the row of a case that ended; a figure that is no finite number is empty."""
        values = [figures.get(name) for name in FIGURES]
        cells = ["" if v is None or not math.isfinite(v) else as_text(v) for v in values]
        row = (str(case.number), *map(as_text, case.values), status, *cells)
        self._append(row)
        self._rows[case.number] = dict(zip(self._columns, row, strict=True))

    def complete(self, case: Case) -> bool:
        """Whether a case need not run again."""
        return self._rows.get(case.number, {}).get("status") == "complete"

    def rows(self) -> list[dict[str, Any]]:
        """The last row of every case that has one, by number; None for what is empty."""
        return [
            {"case": case.number}
            | dict(zip(self._plan.keys, case.values, strict=True))
            | {"status": self._rows[case.number]["status"]}
            | {name: _figure(self._rows[case.number][name]) for name in FIGURES}
            for case in self._plan.cases
            if case.number in self._rows
        ]

    def __enter__(self) -> SweepTable:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()


def _figure(cell: str) -> Any:
    return json.loads(cell) if cell else None
