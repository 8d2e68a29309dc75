"""Parameter sweeps: one scene is run for all combinations of given values.

``sweep.csv`` has a row for every case that has ended, in the order of the combinations. It is
rewritten once a second. ``sweep.json`` has the scene and the values of the sweep. Complete cases
are not run again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.scenes.scene import Scene, as_stored
from fenics_ehd.study.cases import (
    MOST_CASES,
    Case,
    as_text,
    described,
    finite,
    identity,
    make_case,
    parse_values,
    resolve_key,
    scene_values,
    write_table,
)
from fenics_ehd.study.pool import RunsFolder, run_cases


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep of a scene over values of some keys.

    Attributes
    ----------
    scene
        Name of the scene.
    keys
        Full keys of the swept settings.
    joints
        Names of the lubricated joints.
    cases
        Cases in the order of the combinations; the last key changes fastest.
    identity
        All data on which the rows depend, as text by name; equal for equal sweeps.
    """

    scene: str
    keys: tuple[str, ...]
    joints: tuple[str, ...]
    cases: tuple[Case, ...]
    identity: Mapping[str, str]


def make_sweep(source: str, assignments: Sequence[str]) -> Sweep:
    """Make a sweep of a scene from assignments ``key=values``; the last key changes fastest.

    Raises
    ------
    SettingsError
        Keys or values cannot be used; the message names all of them.
    """
    scene = as_stored(source)
    axes = _axes(scene, assignments)
    size = math.prod(len(values) for values in axes.values())
    if size > MOST_CASES:
        raise SettingsError(
            f"the sweep has {size} cases, above the limit of {MOST_CASES}: give fewer values"
        )
    swept = {key: ", ".join(map(described, values)) for key, values in axes.items()}
    swept["swept"] = ", ".join(axes)
    return Sweep(
        scene.name,
        tuple(axes),
        tuple(scene.films),
        tuple(_cases(scene, axes)),
        identity(scene) | swept,
    )


def _axes(scene: Scene, assignments: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """Values of each swept key from the assignments, by full key."""
    axes: dict[str, tuple[Any, ...]] = {}
    like, _ = scene_values(scene)
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise SettingsError(
                f"--set {assignment!r} must be KEY=VALUES, for instance clearance=1e-5,2e-5"
            )
        key = resolve_key(scene, name.strip())
        if key in axes:
            raise SettingsError(f"--set {assignment}: {key} is given twice")
        axes[key] = parse_values(key, text, like.get(key, 0.0))
    return axes


def _cases(scene: Scene, axes: Mapping[str, tuple[Any, ...]]) -> list[Case]:
    """Cases for all combinations of values.

    A combination may contain values without effect, if each has an effect in another combination.

    Raises
    ------
    SettingsError
        Some combinations cannot run; the message has the reasons.
    """
    combinations = [
        dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())
    ]
    made = [_made(f"{n:04d}", scene, values) for n, values in enumerate(combinations, 1)]
    accepted = [
        values for values, case in zip(combinations, made, strict=True) if isinstance(case, Case)
    ]
    effective = {key: {as_text(values[key]) for values in accepted} for key in axes}
    for n, values in enumerate(combinations):
        if isinstance(made[n], str):
            optional = [key for key, value in values.items() if as_text(value) in effective[key]]
            made[n] = _made(f"{n + 1:04d}", scene, values, optional)
    complaints = [case for case in made if isinstance(case, str)]
    if complaints:
        # A section reports only its first invalid value; checks of single values show the others.
        alone = [_made("", scene, {key: v}) for key, values in axes.items() for v in values]
        every = dict.fromkeys([*complaints, *(case for case in alone if isinstance(case, str))])
        raise SettingsError(
            f"{len(complaints)} of {len(made)} cases cannot run: {'; '.join(every)}"
        )
    return [case for case in made if isinstance(case, Case)]


def _made(
    name: str, scene: Scene, values: Mapping[str, Any], optional: Sequence[str] = ()
) -> Case | str:
    """Make a case of a sweep; if the case cannot run, return the reason as text."""
    try:
        return make_case(name, scene, values, optional)
    except InputError as error:
        return str(error)


#: Columns of a sweep's table from ``summary.json``: for every lubricated joint, and for the run.
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


#: Files of a sweep that --overwrite removes; reduced bodies, named by checksum, are kept.
OWN = ("sweep.json", "sweep.csv", "runs/")


def figure_columns(joints: Sequence[str]) -> tuple[str, ...]:
    """Names of the result columns in a sweep's table: ``JOINT.COLUMN``, and columns of the run."""
    return (*(f"{joint}.{name}" for joint in joints for name in JOINT_FIGURES), *FIGURES)


class SweepFolder(RunsFolder):
    """Folder of a sweep; its table is written once a second.

    Parameters
    ----------
    directory
        Path of the folder; it is created if it does not exist.
    sweep
        Sweep to run.
    resume
        Whether the folder must have rows of a former attempt.
    overwrite
        Whether the files of a former sweep are replaced.

    Raises
    ------
    OtherFolderError
        The folder has the rows of another sweep.
    InUseError
        Another process uses the folder.
    InputError
        The folder cannot be written to, or `resume` is set and it has no rows.
    """

    command = "sweep"

    def __init__(
        self, directory: str | Path, sweep: Sweep, *, resume: bool = False, overwrite: bool = False
    ):
        self.sweep = sweep
        self.table = Path(directory) / "sweep.csv"
        if resume and not self.table.is_file():
            raise InputError(f"--resume: {self.table} does not exist: there is nothing to resume")
        super().__init__(directory, sweep.cases, OWN, sweep.identity, overwrite=overwrite)

    def rows(self) -> list[dict[str, Any]]:
        """Rows of the cases that have ended, by column, in the order of the cases."""
        return [self._row(case) for case in self.sweep.cases if case.name in self.outcomes]

    def _row(self, case: Case) -> dict[str, Any]:
        """Row of a case by column; a result that is missing or not finite is None."""
        outcome = self.outcomes[case.name]
        figures = dict(outcome.figures)
        for joint, joint_figures in outcome.figures.get("joints", {}).items():
            figures |= {f"{joint}.{name}": value for name, value in joint_figures.items()}
        row = {"case": int(case.name), **dict(zip(self.sweep.keys, case.values, strict=True))}
        row["status"] = outcome.status
        columns = figure_columns(self.sweep.joints)
        return row | {name: finite(figures.get(name)) for name in columns}

    def write_tables(self) -> None:
        """Write ``sweep.json``, and then ``sweep.csv``."""
        self.write("sweep.json", self.sweep.identity)
        columns = "case", *self.sweep.keys, "status", *figure_columns(self.sweep.joints)
        write_table(self.table, columns, self.rows())


def run_sweep(
    folder: SweepFolder, executor: Executor, *, keep: bool = False
) -> list[dict[str, Any]]:
    """Run every case that is not complete, and write its row.

    Parameters
    ----------
    folder
        Folder of the sweep.
    executor
        Executor that does the reductions and runs the cases, see `run_cases`.
    keep
        Whether the results of every case are kept, in ``runs/0001`` and so on.

    Returns
    -------
    list of dict
        Rows of all cases, by column.
    """
    missing = folder.take_stock()
    folder.write_tables()
    run_cases(folder, missing, executor, keep=keep)
    return folder.rows()
