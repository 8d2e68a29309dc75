"""Parameter sweeps: one scene is run for many combinations of values.

``sweep.csv`` has a row for every case that has ended, in the order of the combinations. It is
rewritten once a second. ``sweep.json`` has the scene and the values of the sweep. Complete cases
are not run again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fenics_ehd.base.arguments import require_class, require_count
from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.base.files import require_kept, require_made_by
from fenics_ehd.base.needs import NoEffectError
from fenics_ehd.base.progress import Progress, chosen_progress
from fenics_ehd.scenes.scene import Scene, as_stored, input_files, stored
from fenics_ehd.study.case_table import CaseTable
from fenics_ehd.study.cases import (
    MOST_CASES,
    Case,
    as_text,
    finite,
    identity,
    make_case,
    write_table,
)
from fenics_ehd.study.combinations import (
    Axis,
    axes_of_options,
    axes_of_values,
    combinations,
    origins_of,
)
from fenics_ehd.study.pool import RunsFolder, open_pool, require_importable_main, run_cases

#: Key of ``sweep.json`` with the part of the sweep in the folder.
PART = "part"


@dataclass(frozen=True)
class Part:
    """Part of the cases of a sweep, for one of several computers.

    Attributes
    ----------
    number, of
        Number of the part, from 1, and number of all parts. Part 3 of 16 has the cases 3, 19, ...
    """

    number: int = 1
    of: int = 1

    @classmethod
    def read(cls, text: str) -> Part:
        """Read a part from a text such as ``3/16``.

        Raises
        ------
        SettingsError
            The text is malformed, or there is no such part.
        """
        match = re.fullmatch(r"\s*([0-9]{1,9})\s*/\s*([0-9]{1,9})\s*", text, re.ASCII)
        if match is None:
            raise SettingsError(
                f"--part {text} must be K/N, the number of the part and the number of parts, 3/16 "
                "for instance"
            )
        number, of = map(int, match.groups())
        if not 1 <= of <= MOST_CASES:
            raise SettingsError(
                f"--part {text}: the number of parts, {of}, must be from 1 to {MOST_CASES}"
            )
        if not 1 <= number <= of:
            raise SettingsError(
                f"--part {text}: the number of the part, {number}, must be from 1 to {of}"
            )
        return cls(number, of)

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


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
        Cases of the part in the order of the combinations; the last key changes fastest.
    identity
        All data on which the rows depend, as text by name; equal for all parts of a sweep.
    part
        Part of the cases that is run.
    """

    scene: str
    keys: tuple[str, ...]
    joints: tuple[str, ...]
    cases: tuple[Case, ...]
    identity: Mapping[str, str]
    part: Part = Part()

    @property
    def about(self) -> dict[str, str]:
        """Content of ``sweep.json``: the identity of the sweep, and the part."""
        return {**self.identity, PART: str(self.part)}


def make_sweep(
    source: str | Path | Scene,
    assignments: Sequence[str] = (),
    *,
    zipped: bool = False,
    table: str | None = None,
    part: Part = Part(),
) -> Sweep:
    """Make a sweep of a scene from the options of the command line.

    Parameters
    ----------
    source
        Scene, or the source of a scene.
    assignments, zipped, table
        See `axes_of_options`.
    part
        Part of the cases that is run.

    Raises
    ------
    SettingsError
        Keys or values cannot be used; the message names all of them.
    """
    scene = _as_stored(source)
    axes = axes_of_options(scene, assignments, zipped=zipped, table=table)
    return _sweep_of(scene, axes, part)


def _as_stored(source: str | Path | Scene) -> Scene:
    """Scene with its values rounded as in the text that is stored with a run."""
    return stored(source) if isinstance(source, Scene) else as_stored(source)


def _sweep_of(scene: Scene, axes: Sequence[Axis], part: Part) -> Sweep:
    """Sweep of a stored scene over axes; all cases are checked, also those of other parts."""
    cases = _cases(scene, axes)
    if part.of > len(cases):
        raise SettingsError(
            f"--part {part}: the sweep has {len(cases)} cases: give at most {len(cases)} parts"
        )
    swept = {key: text for axis in axes for key, text in axis.described().items()}
    swept |= {"swept": ", ".join(axis.name for axis in axes), "cases": str(len(cases))}
    return Sweep(
        scene.name,
        tuple(key for axis in axes for key in axis.keys),
        tuple(scene.films),
        tuple(cases[part.number - 1 :: part.of]),
        identity(scene) | swept,
        part,
    )


#: Largest number of reasons in the message about cases that cannot run.
MOST_REASONS = 5


def _cases(scene: Scene, axes: Sequence[Axis]) -> list[Case]:
    """Cases for all combinations of values.

    A combination may contain values without effect, if each has an effect in another combination.

    Raises
    ------
    SettingsError
        Some combinations cannot run; the message has the reasons. A key without effect is named
        once.
    """
    combined = combinations(axes)
    made = [_made(f"{n:04d}", scene, values) for n, values in enumerate(combined, 1)]
    accepted = [
        values for values, case in zip(combined, made, strict=True) if isinstance(case, Case)
    ]
    keys = [key for axis in axes for key in axis.keys]
    effective = {key: {as_text(values[key]) for values in accepted} for key in keys}
    for n, values in enumerate(combined):
        if isinstance(made[n], InputError):
            optional = [key for key, value in values.items() if as_text(value) in effective[key]]
            made[n] = _made(f"{n + 1:04d}", scene, values, optional)
    refused = [
        (origin, case)
        for origin, case in zip(origins_of(axes), made, strict=True)
        if isinstance(case, InputError)
    ]
    if refused:
        raise SettingsError(
            f"{len(refused)} of {len(made)} cases cannot run: "
            f"{_reasons([*refused, *_refused_alone(scene, axes)])}"
        )
    return [case for case in made if isinstance(case, Case)]


def _refused_alone(scene: Scene, axes: Sequence[Axis]) -> list[tuple[str, InputError]]:
    """Errors of single values: a section of a scene reports only its first invalid value."""
    single: dict[tuple[str, str], tuple[str, Any]] = {}
    for axis in axes:
        for origin, row in zip(origins_of([axis]), axis.rows, strict=True):
            for key, value in zip(axis.keys, row, strict=True):
                single.setdefault((key, as_text(value)), (origin, value))
    alone = (
        (origin, _made("", scene, {key: value})) for (key, _), (origin, value) in single.items()
    )
    return [(origin, case) for origin, case in alone if isinstance(case, InputError)]


def _reasons(errors: Iterable[tuple[str, InputError]]) -> str:
    """Different messages of errors in one line; a key without effect is named once.

    The first error of each message has its line in the file of cases.
    """
    by_reason: dict[str, str] = {}
    for origin, error in errors:
        reason = error.key if isinstance(error, NoEffectError) else str(error)
        by_reason.setdefault(reason, f"{origin}: {error}" if origin else str(error))
    reasons = list(by_reason.values())
    hidden = len(reasons) - MOST_REASONS
    return "; ".join(reasons[:MOST_REASONS]) + (f"; and {hidden} more" if hidden > 0 else "")


def _made(
    name: str, scene: Scene, values: Mapping[str, Any], optional: Sequence[str] = ()
) -> Case | InputError:
    """Make a case of a sweep; if the case cannot run, return the error."""
    try:
        return make_case(name, scene, values, optional)
    except InputError as error:
        return error


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
ABOUT = "sweep.json"
TABLE = "sweep.csv"
OWN = (ABOUT, TABLE, "runs/")


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
        self.table = Path(directory) / TABLE
        if resume and not self.table.is_file():
            raise InputError(f"--resume: {self.table} does not exist: there is nothing to resume")
        super().__init__(directory, sweep.cases, OWN, sweep.about, overwrite=overwrite)

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
        """Write ``sweep.csv``."""
        write_table(self.table, self.columns, self.rows())

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of ``sweep.csv``."""
        return "case", *self.sweep.keys, "status", *figure_columns(self.sweep.joints)


def run_sweep(
    folder: SweepFolder,
    executor: Executor,
    *,
    keep: bool = False,
    progress: Progress | bool = True,
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
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the cases are
        a stage.

    Returns
    -------
    list of dict
        Rows of all cases, by column.
    """
    missing = folder.take_stock()
    folder.write(ABOUT, folder.sweep.about)
    folder.write_tables()
    run_cases(folder, missing, executor, keep=keep, progress=chosen_progress(progress))
    return folder.rows()


def sweep(
    scene: Scene | str | Path,
    values: Mapping[str, Any] | str | Path,
    *,
    zipped: bool = False,
    executor: Executor | None = None,
    workers: int | None = None,
    folder: str | Path | None = None,
    keep: bool = False,
    overwrite: bool = False,
    progress: Progress | bool = True,
) -> CaseTable:
    """Run a scene for many combinations of values, as ``fenics-ehd sweep`` does; one rank.

    Parameters
    ----------
    scene
        Scene as read, or the source of a scene, as for `read_scene`.
    values
        Values by key, the full key or a unique end of it: an iterable of values, or a text as for
        ``--set``, such as ``"10e-6:30e-6:5"``. Or the path of a CSV file as for ``--cases``.
    zipped
        Whether the lists are used together, value by value; by default, all combinations are run.
    executor
        Executor that runs the cases: of the standard library, of Dask (``client.get_executor()``),
        or ``MPIPoolExecutor``. By default, processes on this machine run the cases.
    workers
        Number of these processes; by default one for each core.
    folder
        Folder of the results, whose complete cases are not run again; by default nothing is stored.
    keep
        Whether the history of every case is kept in the folder.
    overwrite
        Whether the rows of another sweep in the folder are replaced.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the cases are
        a stage.

    Returns
    -------
    CaseTable
        Table with a row for each case. The row of a case that failed has the reason.

    Raises
    ------
    SettingsError
        Keys or values cannot be used; the message names all of them.
    InputError, InUseError
        The folder cannot be used, or another process uses it.
    """
    require_class("scene", scene, Scene, str, Path)
    require_class("values", values, Mapping, str, Path)
    if executor is not None:
        require_class("executor", executor, Executor)
    if executor is not None and workers is not None:
        raise SettingsError(f"workers = {workers} has no effect with an executor: drop workers")
    if keep and folder is None:
        raise SettingsError("keep = True needs a folder: give folder, or drop keep")
    if workers is not None:
        require_count("workers", workers, 1)
    if folder is not None:
        require_class("folder", folder, str, Path)
    shown = chosen_progress(progress)
    start = _as_stored(scene)
    plan = _sweep_of(start, axes_of_values(start, values, zipped=zipped), Part())
    with ExitStack() as held:
        target = Path(
            held.enter_context(TemporaryDirectory(prefix="fenics-ehd-"))
            if folder is None
            else folder
        )
        require_made_by(target, SweepFolder.command)
        require_kept(target, input_files("", start), OWN)
        opened = held.enter_context(SweepFolder(target, plan, overwrite=overwrite))
        if executor is None:
            executor = held.enter_context(open_pool(workers))
            require_importable_main(executor)
        rows = run_sweep(opened, executor, keep=keep, progress=shown)
        return CaseTable(opened.columns, rows)
