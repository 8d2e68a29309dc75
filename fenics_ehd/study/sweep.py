"""Parameter sweeps: one scene over the product of given values.

``sweep.csv`` has a row for every case that ended, in the order of the product, and is written again
whenever one ends. ``sweep.json`` beside it says which sweep they belong to. Cases with a complete
row are not run again.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fenics_ehd.base.columns import joint_prefix
from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.base.files import let_go
from fenics_ehd.scenes.scene import Scene, as_stored, lubricated_joints
from fenics_ehd.study.cases import (
    MOST_CASES,
    Case,
    described,
    finite,
    identity,
    make_case,
    parse_values,
    read_table,
    resolve_key,
    scene_values,
    write_table,
)
from fenics_ehd.study.pool import (
    COMPLETE,
    CaseTask,
    OtherFolderError,
    Outcome,
    ProcessPool,
    RunsFolder,
    run_cases,
)


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep: its scene, swept keys, lubricated joints, cases in the order of the product.

    `identity` is everything the rows depend on, as text by name; two sweeps are the same
    when it is.
    """

    scene: str
    keys: tuple[str, ...]
    joints: tuple[str, ...]
    cases: tuple[Case, ...]
    identity: Mapping[str, str]


def make_sweep(source: str, assignments: Sequence[str]) -> Sweep:
    """Sweep of a scene and of assignments ``key=values``; the last key changes fastest.

    Raises
    ------
    SettingsError
        A key or value that cannot be used: all of them are named.
    """
    scene = as_stored(source)
    axes = _axes(scene, assignments)
    size = math.prod(len(values) for values in axes.values())
    if size > MOST_CASES:
        raise SettingsError(f"the sweep has {size} cases, at most {MOST_CASES}: give fewer values")
    swept = {key: ", ".join(map(described, values)) for key, values in axes.items()}
    return Sweep(
        scene.name,
        tuple(axes),
        lubricated_joints(scene),
        tuple(_cases(scene, axes)),
        identity(scene) | swept,
    )


def _axes(scene: Scene, assignments: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """Values by full key."""
    axes: dict[str, tuple[Any, ...]] = {}
    like, _ = scene_values(scene)
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise SettingsError(f"--set {assignment!r} must be key=values, clearance=1e-5,2e-5 say")
        key = resolve_key(scene, name.strip())
        if key in axes:
            raise SettingsError(f"--set {assignment}: {key} is given twice")
        axes[key] = parse_values(key, text, like.get(key, 0.0))
    return axes


def _cases(scene: Scene, axes: Mapping[str, tuple[Any, ...]]) -> list[Case]:
    combinations = enumerate(itertools.product(*axes.values()), 1)
    made = [_made(str(n), scene, dict(zip(axes, v, strict=True))) for n, v in combinations]
    complaints = [case for case in made if isinstance(case, str)]
    if complaints:
        # A section stops at its first bad value: each value on its own names the others as well.
        alone = [_made("", scene, {key: v}) for key, values in axes.items() for v in values]
        every = dict.fromkeys([*complaints, *(case for case in alone if isinstance(case, str))])
        raise SettingsError(
            f"{len(complaints)} of {len(made)} cases cannot run: {'; '.join(every)}"
        )
    return [case for case in made if isinstance(case, Case)]


def _made(name: str, scene: Scene, values: Mapping[str, Any]) -> Case | str:
    """A case, or why it cannot run."""
    try:
        return make_case(name, scene, values)
    except InputError as error:
        return str(error)


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


def figure_columns(joints: Sequence[str]) -> tuple[str, ...]:
    """Columns of figures; with several lubricated joints theirs bear the joint's name."""
    own = (joint_prefix(joint, joints) + name for joint in joints for name in JOINT_FIGURES)
    return (*own, *FIGURES)


def folder_of(case: Case) -> str:
    """Name of the folder of a case's results, in ``runs``."""
    return f"{int(case.name):04d}"


class SweepTable(RunsFolder):
    """Rows of a sweep in a folder, on disk as soon as they are added.

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
    OtherFolderError
        The folder holds the rows of another sweep.
    InUseError
        Another process is adding rows.
    InputError
        The folder cannot be written to, or has nothing to resume.
    """

    def __init__(
        self, directory: str | Path, sweep: Sweep, *, resume: bool = False, overwrite: bool = False
    ):
        self.table, self.sweep = Path(directory) / "sweep.csv", sweep
        self._figures = figure_columns(sweep.joints)
        self._columns = ("case", *sweep.keys, "status", *self._figures)
        if resume and not self.table.is_file():
            raise InputError(f"--resume: {self.table} does not exist, there is nothing to resume")
        super().__init__(directory, OWN, map(folder_of, sweep.cases), overwrite=overwrite)

    def _begin(self) -> None:
        """Read the rows that are there, once it is sure that they are of this sweep."""
        self._rows: dict[str, dict[str, Any]] = {}
        if not (self.table.is_file() and self.table.stat().st_size):
            self.write("sweep.json", self.sweep.identity)
            write_table(self.table, self._columns, [])
            return
        self.require_same("sweep.json", self.sweep.identity)
        try:
            found = {row["case"]: row for row in read_table(self.table, self._columns)}
        except ValueError as error:
            raise OtherFolderError(self.table, str(error)) from None
        for case in self.sweep.cases:
            row = found.get(case.name, {})
            if None not in row.values() and row:
                figures = {name: json.loads(row[name] or "null") for name in self._figures}
                self._rows[case.name] = self._row(case, row["status"], figures)

    def _row(self, case: Case, status: str, figures: Mapping[str, Any]) -> dict[str, Any]:
        swept = dict(zip(self.sweep.keys, case.values, strict=True))
        own = {name: finite(figures.get(name)) for name in self._figures}
        return {"case": int(case.name), **swept, "status": status, **own}

    def add(self, case: Case, outcome: Outcome) -> None:
        """Add the row of a case that ended; a figure that is no finite number is empty."""
        joints = outcome.figures.get("joints", {})
        own = {f"{j}.{name}": value for j, found in joints.items() for name, value in found.items()}
        self._rows[case.name] = self._row(case, outcome.status, {**outcome.figures, **own})
        write_table(self.table, self._columns, self.rows())

    def complete(self, case: Case) -> bool:
        """True of a case that need not run again."""
        return self._rows.get(case.name, {}).get("status") == COMPLETE

    def rows(self) -> list[dict[str, Any]]:
        """Rows of the cases that ended, by number; None for what is empty."""
        return [self._rows[case.name] for case in self.sweep.cases if case.name in self._rows]


def run_sweep(table: SweepTable, pool: ProcessPool, *, keep: bool = False) -> list[dict[str, Any]]:
    """Run every case that has no complete row, and add its row.

    Parameters
    ----------
    table
        The sweep's rows.
    pool
        Workers.
    keep
        Keep the results of every case in ``runs/0001`` and so on.

    Returns
    -------
    list of dict
        The row of every case.
    """
    cases = table.sweep.cases
    tasks = [
        CaseTask(case, table.bodies, table.run(folder_of(case)), keep)
        for case in cases
        if not table.complete(case)
    ]
    run_cases(tasks, table.bodies, pool, table.add, len(cases) - len(tasks))
    let_go(table.path / "runs")
    return table.rows()
