"""``sweep.csv``: one row for every case that ended, in the order in which they ended."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from fenics_ehd.base.columns import joint_prefix
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.folder import claim, clear, locked
from fenics_ehd.base.output import require_writable, write_whole
from fenics_ehd.base.text_file import read_json
from fenics_ehd.study.case import Case
from fenics_ehd.study.outcome import COMPLETE
from fenics_ehd.study.sweep import Sweep
from fenics_ehd.study.values import as_text

#: Figures of every lubricated joint, and of the run, named as in ``summary.json``.
JOINT_FIGURES = (
    "max_pressure_Pa",
    "min_film_thickness_m",
    "max_pressure_time_s",
    "min_film_thickness_time_s",
    "basis_error_estimate_m",
)
FIGURES = (
    "steps",
    "newton_iterations",
    "rejected_steps",
    "energy_balance_error",
    "reduction_time_s",
    "wall_time_s",
)


#: What a sweep leaves beside reduced bodies, which are named by what they are and stay.
OWN = ("sweep.csv", "sweep.json", "runs/")


class OtherSweepError(InputError):
    """The folder holds the rows of another sweep, or of none that this program wrote."""


def figure_columns(joints: Sequence[str]) -> tuple[str, ...]:
    """Columns of figures; with several lubricated joints theirs bear the joint's name."""
    own = (joint_prefix(joint, joints) + name for joint in joints for name in JOINT_FIGURES)
    return (*own, *FIGURES)


def folder_of(case: Case) -> str:
    """Name of the folder of a case's results, in ``runs``."""
    return f"{int(case.name):04d}"


def _figures(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of a summary by column."""
    joints = summary.get("joints", {})
    named = {f"{j}.{name}": value for j, found in joints.items() for name, value in found.items()}
    return {**summary, **named}


class SweepTable:
    """Rows of a sweep in a folder, on disk as soon as they are added.

    A case may have several rows, failed ones of former attempts: its last one counts.
    ``sweep.json`` beside them says which sweep they belong to.

    Parameters
    ----------
    directory
        Created when missing.
    sweep
        Whose rows they are.
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
        self, directory: str | Path, sweep: Sweep, *, resume: bool = False, overwrite: bool = False
    ):
        self.directory = Path(directory)
        self.path = self.directory / "sweep.csv"
        self.sweep = sweep
        self._figures = figure_columns(sweep.joints)
        self._columns = ("case", *sweep.keys, "status", *self._figures)
        require_writable(self.directory)
        if resume and not self.path.is_file():
            raise InputError(f"--resume: {self.path} does not exist, there is nothing to resume")
        self.directory.mkdir(parents=True, exist_ok=True)
        with ExitStack() as held:
            held.enter_context(locked(self.directory))
            claim(self.directory, (*OWN, "bodies/"))
            if overwrite:
                clear(self.directory, OWN)
            claim(self.directory / "runs", [f"{folder_of(case)}/" for case in sweep.cases])
            self._file = held.enter_context(open(self.path, "a+b"))
            self._rows = self._former_rows()
            self._held = held.pop_all()

    def _former_rows(self) -> dict[str, dict[str, str]]:
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
            theirs = read_json(self.directory / "sweep.json")
        except (OSError, ValueError):
            theirs = None
        ours = dict(self.sweep.identity)
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
        write_whole(path, json.dumps(dict(self.sweep.identity), indent=2) + "\n")

    def _read(self, text: str) -> dict[str, dict[str, str]]:
        header, *lines = csv.reader(io.StringIO(text))
        if tuple(header) != self._columns:
            raise self._other("its columns are others")
        cases = {case.name: case for case in self.sweep.cases}
        rows = {}
        for line in lines:
            case = cases.get(line[0]) if len(line) == len(header) else None
            if case is None or line[1 : 1 + len(case.values)] != [*map(as_text, case.values)]:
                raise self._other(f"the row {','.join(line)[:60]!r} is none of its cases")
            rows[case.name] = dict(zip(header, line, strict=True))
        return rows

    def _append(self, cells: tuple[str, ...]) -> None:
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(cells)
        self._file.write(line.getvalue().encode())
        self._file.flush()
        os.fsync(self._file.fileno())

    def add(self, case: Case, status: str, figures: Mapping[str, Any]) -> None:
        """Append the row of a case that ended; a figure that is no finite number is empty."""
        values = map(_figures(figures).get, self._figures)
        cells = ["" if v is None or not math.isfinite(v) else as_text(v) for v in values]
        row = (case.name, *map(as_text, case.values), status, *cells)
        self._append(row)
        self._rows[case.name] = dict(zip(self._columns, row, strict=True))

    def complete(self, case: Case) -> bool:
        """Whether a case need not run again."""
        return self._rows.get(case.name, {}).get("status") == COMPLETE

    def rows(self) -> list[dict[str, Any]]:
        """The last row of every case that has one, by number; None for what is empty."""
        return [
            {"case": int(case.name)}
            | dict(zip(self.sweep.keys, case.values, strict=True))
            | {"status": self._rows[case.name]["status"]}
            | {name: _figure(self._rows[case.name][name]) for name in self._figures}
            for case in self.sweep.cases
            if case.name in self._rows
        ]

    def __enter__(self) -> SweepTable:
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()


def _figure(cell: str) -> Any:
    return json.loads(cell) if cell else None
