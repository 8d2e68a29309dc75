"""One sweep from the folders of its parts, which ran on several computers.

A row of the merged table is the row of the part that has the case. Folders of kept runs are linked
or copied. The merged folder is that of the uninterrupted sweep: the command without ``--part`` runs
the cases that are missing or not complete.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.base.files import (
    claim,
    clear,
    listed,
    locked,
    made_by,
    read_json,
    read_text,
    require_made_by,
    require_writable,
    to_json,
    write_whole,
)
from fenics_ehd.multibody.verdict import COMPLETE
from fenics_ehd.study.cases import changed_text, difference, write_table
from fenics_ehd.study.pool import OUTCOMES, OtherFolderError, read_records, share
from fenics_ehd.study.sweep import ABOUT, OWN, PART, TABLE, Part, SweepFolder


@dataclass(frozen=True, eq=False)
class PartFolder:
    """Folder of one part of a sweep, as it was read.

    Attributes
    ----------
    path
        Path of the folder.
    about
        Content of ``sweep.json``.
    columns
        Columns of ``sweep.csv``.
    rows
        Texts by column, by number of the case.
    records
        Lines of the file of outcomes by name of the case.
    """

    path: Path
    about: dict[str, Any]
    columns: tuple[str, ...]
    rows: dict[int, dict[str, str]]
    records: dict[str, dict[str, Any]]

    @property
    def identity(self) -> dict[str, Any]:
        """Identity of the sweep, which all of its parts have in common."""
        return {key: text for key, text in self.about.items() if key != PART}

    @classmethod
    def read(cls, path: Path) -> PartFolder:
        """Read the folder of a sweep.

        Raises
        ------
        InputError
            The folder is not that of a sweep, or a file of it cannot be read.
        """
        if not path.is_dir() or made_by(path) != SweepFolder.command:
            raise InputError(f"--merge: {path} is not the folder of a sweep")
        try:
            about = dict(read_json(path / ABOUT))
            reader = csv.DictReader(io.StringIO(read_text(path / TABLE)), strict=True)
            rows = {int(row["case"]): row for row in reader}
            columns = tuple(reader.fieldnames or ())
            if "cases" not in about or "status" not in columns:
                raise ValueError("another version made it: run the sweep again")
            records = read_records(path / OUTCOMES)
        except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
            raise InputError(f"--merge: {path} cannot be read: {error}") from None
        return cls(path, about, columns, rows, records)


@dataclass(frozen=True)
class MergedSweep:
    """Table of a merged sweep.

    Attributes
    ----------
    table
        Path of ``sweep.csv``.
    keys, joints
        Swept keys, and names of the lubricated joints.
    rows
        Values of the rows by column, in the order of the cases.
    missing
        Numbers of the cases without a row.
    """

    table: Path
    keys: tuple[str, ...]
    joints: tuple[str, ...]
    rows: list[dict[str, Any]]
    missing: list[int]


def merge_sweeps(
    folders: Sequence[str | Path], directory: str | Path, *, overwrite: bool = False
) -> MergedSweep:
    """Merge the folders of the parts of a sweep into one folder.

    If several folders have a case, the first one in which it is complete is used. Rows that the
    merged folder has from before are kept for cases that no part has.

    Parameters
    ----------
    folders
        Paths of the folders of the parts.
    directory
        Path of the merged folder.
    overwrite
        Whether another sweep in the merged folder is replaced.

    Raises
    ------
    SettingsError
        The merged folder is one of the parts.
    InputError, InUseError
        A folder is not that of a sweep, has another sweep, or is used by another process.
    """
    target = Path(directory)
    paths = [Path(folder) for folder in folders]
    if target.resolve() in {path.resolve() for path in paths}:
        raise SettingsError(f"--merge: {target} is one of the parts: give another folder with -o")
    twice = [path for path in paths if paths.count(path) > 1]
    if twice:
        raise SettingsError(f"--merge: {twice[0]} is given twice: name each part once")
    with ExitStack() as held:
        parts = []
        for path in paths:
            # A part that is still running is refused before it is read.
            if path.is_dir():
                held.enter_context(locked(path))
            parts.append(PartFolder.read(path))
        _require_same_sweep(parts)
        about = {**parts[0].identity, PART: str(Part())}
        require_made_by(target, SweepFolder.command)
        require_writable(target)
        target.mkdir(parents=True, exist_ok=True)
        held.enter_context(locked(target))
        claim(target, (*OWN, OUTCOMES), SweepFolder.command)
        if reason := "" if overwrite else difference(target / ABOUT, about):
            raise OtherFolderError(target / ABOUT, reason)
        if not overwrite and (target / TABLE).exists():
            former = PartFolder.read(target)  # rows of a former merge are kept
            _require_same_sweep([parts[0], former])
            parts.append(former)
        else:
            clear(target, (*OWN, OUTCOMES))
            claim(target, (*OWN, OUTCOMES), SweepFolder.command)
        return _write(target, parts, about)


def _require_same_sweep(parts: Sequence[PartFolder]) -> None:
    """Refuse parts of different sweeps."""
    first = parts[0]
    for part in parts[1:]:
        keys = dict.fromkeys((*first.identity, *part.identity))
        for key in keys:
            if first.identity.get(key) != part.identity.get(key):
                texts = first.identity.get(key), part.identity.get(key)
                reason = changed_text(key, *texts, f"in {first.path}", f"in {part.path}")
                raise InputError(
                    f"--merge: {part.path} has another sweep than {first.path}: {reason}: merge "
                    "parts of one sweep"
                )
        if part.columns != first.columns:
            raise InputError(
                f"--merge: the table of {part.path} has other columns than that of {first.path}: "
                "merge folders that one version made"
            )


def _write(target: Path, parts: Sequence[PartFolder], about: dict[str, Any]) -> MergedSweep:
    """Write the files of the merged sweep."""
    sources: dict[int, PartFolder] = {}
    for part in parts:
        for number, row in part.rows.items():
            former = sources.get(number)
            if former is None or (
                former.rows[number]["status"] != COMPLETE and row["status"] == COMPLETE
            ):
                sources[number] = part
    numbers = sorted(sources)
    for number in numbers:
        if sources[number].path != target:
            _copy_run(sources[number].path, target, f"{number:04d}")
    names = {number: f"{number:04d}" for number in numbers}
    records = [
        sources[number].records[name]
        for number, name in names.items()
        if name in sources[number].records
    ]
    lines = "".join(f"{to_json(record, indent=None)}\n" for record in records)
    write_whole(target / OUTCOMES, lines)
    write_whole(target / ABOUT, to_json(about) + "\n")
    columns = parts[0].columns
    rows = [sources[number].rows[number] for number in numbers]
    write_table(target / TABLE, columns, rows)
    end = columns.index("status")
    joints = [name.rpartition(".")[0] for name in columns if name.endswith(".max_pressure_Pa")]
    return MergedSweep(
        target / TABLE,
        columns[1:end],
        tuple(joints),
        [{column: _value_of(text) for column, text in row.items()} for row in rows],
        sorted(set(range(1, int(about["cases"]) + 1)) - set(numbers)),
    )


def _copy_run(part: Path, target: Path, name: str) -> None:
    """Link or copy the files of a kept run into the merged folder; other runs have no files."""
    source = part / "runs" / name
    files = [file for file in listed(source) if (source / file).is_file()]
    if not files:
        return
    copy = target / "runs" / name
    claim(target / "runs", [f"{name}/"], SweepFolder.command)
    claim(copy, files, SweepFolder.command)
    for file in files:
        share(source / file, copy / file)


def _value_of(text: str) -> Any:
    """Value of a cell of ``sweep.csv``: a number, a list, or a word; None for an empty cell."""
    if not text:
        return None
    try:
        return json.loads(text)
    except ValueError:
        return text
