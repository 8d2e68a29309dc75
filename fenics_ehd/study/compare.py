"""Comparison of the runs of a study: differences of curves, files and tables.

Two runs are compared at the steps of one of them; the other, which has far more steps, is
interpolated. Fields are interpolated point by point before extremes are computed, because curves of
extremes have kinks where the extreme moves from one point to another. Periodic runs are compared
over their last cycles, as functions of the time within the cycle.

Bodies are reduced first. Then the reference is run, then all other runs. ``study.json`` has the
settings, versions and machine of the study; ``errors-AGAINST.npz`` in the folder of a run has its
errors over time; ``reference.json`` has the errors of the reference itself; ``table.csv`` has a row
for every run, joint and group.
"""

from __future__ import annotations

import io
import os
import platform
import re
from collections.abc import Collection, Mapping
from concurrent.futures import Executor
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import trapezoid

from fenics_ehd import __version__
from fenics_ehd.base.columns import TIME
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.base.files import claim, clear, read_json, versions, write_whole
from fenics_ehd.base.processes import interrupt_kept
from fenics_ehd.base.progress import Progress, chosen_progress
from fenics_ehd.multibody.history import History, load_history
from fenics_ehd.reduction.load_dependent_basis import RANK_TOLERANCE
from fenics_ehd.results.motion import RecordedMotion, between_steps
from fenics_ehd.scenes.build import build
from fenics_ehd.scenes.part_settings import method_keys
from fenics_ehd.scenes.run import stored_bodies
from fenics_ehd.scenes.scene import Scene, changed
from fenics_ehd.study.cases import Case, finite, write_table
from fenics_ehd.study.plan import REFERENCE, Row, Study
from fenics_ehd.study.pool import RunsFolder, run_cases

#: Names of the errors of a run: of peak pressure and minimum film thickness. The largest errors
#: over time are relative to the reference's largest peak, and to the film thickness. The errors in
#: root mean square are relative to the root mean square of the reference's curve.
ERRORS = ("pressure_max", "pressure_l2", "film_max", "film_l2")

#: Name of the largest error of the gap, over all points and times [m].
GAP = "gap"

#: Type for the errors of two runs: values of `ERRORS` and `GAP` by joint.
Errors = Mapping[str, Mapping[str, float]]


class StoredRun:
    """A run that is read from its folder, for comparison with other runs.

    Parameters
    ----------
    directory
        Folder of the run.
    scene
        Scene of the run.
    start
        Time after which errors are evaluated [s].

    Raises
    ------
    InputError
        A file is missing or damaged, or the run has fewer than two steps after `start`.
    """

    def __init__(self, directory: Path, scene: Scene, start: float):
        self.directory = directory
        self.scene = scene
        self.result = load_history(directory, films=False)
        self.times = self.result.time
        self.joints = tuple(scene.films)
        self.counted = self.times >= start
        if np.count_nonzero(self.counted) < 2:
            raise InputError(f"{directory}: the run has fewer than two steps after {start:g} s")

    @cached_property
    def filmed(self) -> History:
        """History of the run, including the pressure fields of the films."""
        return load_history(self.directory)

    def estimates(self) -> dict[str, float]:
        """Largest estimated gap error due to the reduction basis, by joint, after `start` [m]."""
        joints = self.result.joints
        return {
            joint: float(joints[joint].basis_error_estimate[self.counted].max(initial=0.0))
            for joint in self.joints
            if "basis_error_estimate" in joints[joint]
        }

    def gaps(self, motion: History, films: Scene) -> dict[str, np.ndarray]:
        """Gaps of all joints during a motion, at the observed points of film meshes [m].

        `motion` is a history with the coordinates of this run's mechanism. The film meshes are
        those of the scene `films`. Every joint has an array of shape (steps, points).
        """
        meshes: dict[str, Any] = {}
        for name in self.joints:
            joint = films.joints[name]
            key = f"joints.{name}"
            meshes |= {f"{key}.cells": list(joint.cells), f"{key}.element": joint.element}
        scene = changed(self.scene, meshes)
        bodies = stored_bodies(scene, self.directory)
        built = build(scene, bodies=bodies)
        return RecordedMotion(built.mechanism, motion).observed

    def differences(
        self, run: StoredRun
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, float]]]:
        """Errors of another run relative to this run, at the other run's steps after `start`.

        Returns
        -------
        curves
            Times and errors over time by column, as `read_errors` returns them.
        errors
            Errors by joint and name, see `Errors`.
        """
        known = (run.times >= self.times[0]) & (run.times <= self.times[-1])
        inside = known & run.counted
        times = run.times[inside]
        # Times in a periodic run's history are measured from the start of the cycle.
        exact = between_steps(self.filmed, times + (self.result.run.time[0] - self.times[0]))
        right = self.gaps(exact, self.scene)
        ours = run.gaps(run.result.each(lambda values: values[inside]), self.scene)
        curves = {TIME: times}
        errors = {}
        for joint in self.joints:
            joint_result = run.result.joints[joint]
            peak = self.result.joints[joint].max_pressure[self.counted].max()
            film = exact.joints[joint].film
            # The gap is observed at the Gauss points first, and at the nodes last.
            nodal_gap = right[joint][:, -len(film.angle) :]
            rows = FilmRows.of(film.angle, film.height)
            peaks, thinnest = rows.film_extremes(film.pressure, nodal_gap)
            pairs = {
                "pressure": (joint_result.max_pressure[inside], peaks),
                "film": (joint_result.min_film_thickness[inside], thinnest),
            }
            errors[joint] = {GAP: float(np.abs(ours[joint] - right[joint]).max())}
            for name, (values, true) in pairs.items():
                off = (values - true) / (peak if name == "pressure" else true)
                curves[f"{joint}.{name}_error"] = off
                errors[joint][f"{name}_max"] = float(np.abs(off).max())
                sizes = [_root_mean_square(times, each) for each in (values - true, true)]
                errors[joint][f"{name}_l2"] = sizes[0] / sizes[1]
        return curves, errors


def _root_mean_square(times: np.ndarray, values: np.ndarray) -> float:
    """Root mean square over time of values at given times, whose distances may differ."""
    return float(np.sqrt(trapezoid(values**2, times) / (times[-1] - times[0])))


def errors_path(directory: Path, against: str) -> Path:
    """Path of the file with the errors of a run relative to the run `against`."""
    return directory / f"errors-{against}.npz"


def write_errors(path: Path, curves: Mapping[str, np.ndarray]) -> None:
    """Write the errors of a run over time to a file, which is complete or absent.

    Equal errors give equal files.
    """
    content = io.BytesIO()
    np.savez(content, **curves)
    claim(path.parent, [path.name])
    write_whole(path, content.getbuffer())


def read_errors(path: Path) -> dict[str, np.ndarray]:
    """Read the errors of a run over time, by column.

    The columns are the times [s], and for each joint the signed relative errors of peak pressure
    and minimum film thickness.

    Raises
    ------
    InputError
        The file does not exist or cannot be read.
    """
    try:
        with np.load(path) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:  # a damaged archive may raise any exception
        raise InputError(f"{path}: not a file with the errors of a run ({error})") from None


#: Files of a study and its report, except reduced bodies; the first one identifies the folder.
STUDY = "study.json"
MADE = (STUDY, "table.csv", "reference.json", "report.html", "report.md", "figures/", "runs/")

#: Largest relative difference of the end of a complete history from the simulated time; rounding.
ROUND_OFF = 1e-9


#: Errors of the reference below which errors of runs on the same film mesh have no meaning.
LIMITING = ("step", "basis")


class StudyFolder(RunsFolder):
    """Folder of a study, with methods that compare its runs and store their errors.

    Parameters
    ----------
    directory
        Path of the folder; it is created if it does not exist.
    study
        Study to which the folder belongs.
    overwrite
        Whether to remove all runs, tables and the report; reduced bodies are kept.

    Attributes
    ----------
    runs
        Complete runs by name.

    Raises
    ------
    InputError
        The folder cannot be written to, or has the study of another scene.
    InUseError
        Another process uses the folder.
    """

    command = "study"

    def __init__(self, directory: str | Path, study: Study, *, overwrite: bool = False):
        self.study = study
        self.runs: dict[str, StoredRun] = {}
        self._errors: dict[tuple[str, str], Errors] = {}
        about = {"scene": study.scene.name}
        super().__init__(directory, study.cases.values(), MADE, about, overwrite=overwrite)

    def take_stock(self) -> list[Case]:
        """Read the complete runs, and remove former errors; return the cases still to be run."""
        self.runs.clear()
        self._errors.clear()
        for name in self.cases:
            error_files = [path.name for path in self.run(name).glob(errors_path(Path(), "*").name)]
            clear(self.run(name), error_files)
        return super().take_stock()

    def read(self, name: str) -> None:
        """Read a complete run; refuse it if files or its last steps are missing."""
        scene = self.cases[name].scene
        stored_bodies(scene, self.run(name))
        run = StoredRun(self.run(name), scene, self.study.start)
        if abs(run.times[-1] - scene.span) > ROUND_OFF * scene.span:
            raise InputError(
                f"{self.run(name)}: the history ends at {run.times[-1]:g} s, but the run ends at "
                f"{scene.span:g} s"
            )
        self.runs[name] = run

    def status(self, name: str) -> str:
        """Status of a run, ``"not run"`` if it has not ended."""
        return self.outcomes[name].status if name in self.outcomes else "not run"

    def errors(self, run: str, against: str) -> Errors | None:
        """Errors of the run `run` relative to the run `against`; they are also stored in a file.

        The result is None if one of the runs is not complete, or if both are the same run.
        """
        if run == against or not {run, against} <= self.runs.keys():
            return None
        if (run, against) not in self._errors:
            curves, largest = self.runs[against].differences(self.runs[run])
            write_errors(errors_path(self.run(run), against), curves)
            self._errors[run, against] = largest
        return self._errors[run, against]

    def why_not(self, run: str, against: str) -> str:
        """Reason why two runs cannot be compared; empty if both are complete."""
        missing = (name for name in (run, against) if name not in self.runs)
        return next((f"{name}: {self.status(name)}" for name in missing), "")

    def own_error(self, kind: str) -> Errors | None:
        """Error of the reference itself; `kind` is ``"step"``, ``"film"`` or ``"basis"``."""
        return self.errors(self.study.checks[kind][0], REFERENCE)

    def rows(self) -> list[dict[str, Any]]:
        """Rows of ``table.csv``, by column."""
        return [table_row(row, j, self) for row in self.study.rows for j in self.study.joints]

    def write_tables(self) -> None:
        """Write ``table.csv`` and ``reference.json`` for the runs that have ended."""
        write_table(self.path / "table.csv", COLUMNS, self.rows())
        self.write("reference.json", describe_reference(self))

    def floor(self, row: Row, joint: str) -> tuple[float | None, float | None]:
        """Limits below which pressure and film errors of a row have no meaning; None if unknown.

        For errors relative to the reference, a limit is the largest known step or basis error of
        the reference itself. For errors relative to the finest film mesh, it is the error of the
        second finest mesh.
        """
        if row.against == REFERENCE:
            candidates = [self.own_error(kind) for kind in LIMITING]
        else:
            last = [r.run for r in self.study.rows if r.against == row.against and row.against]
            candidates = [self.errors(last[-1], row.against)] if last else []
        known = [errors[joint] for errors in candidates if errors is not None]
        if not known:
            return None, None
        return max(e["pressure_max"] for e in known), max(e["film_max"] for e in known)


#: Reason why static columns of a basis are dropped.
DROPPED = f"they depend on the others to {RANK_TOLERANCE:g} of the largest strain energy"


def describe_reference(folder: StudyFolder) -> dict[str, Any]:
    """Content of ``reference.json``: method, steps and own errors of the reference.

    Parameters
    ----------
    folder
        Folder of the study.
    """
    case = folder.study.cases[REFERENCE]
    outcome = folder.outcomes.get(REFERENCE)
    settings = next(iter(case.bodies.values())).settings.reduction
    description: dict[str, Any] = {
        "run": REFERENCE,
        "method": settings.method,
        "status": folder.status(REFERENCE),
        "tolerance": case.scene.time.tolerance,
        "order": case.scene.time.order,
        "start": folder.study.start,
    }
    if outcome is not None and outcome.complete:
        names = ("film_cells", "coordinates", "pressure_columns", "dropped_columns")
        description |= {name: outcome.figures[name] for name in names}
        description["dropped_because"] = DROPPED if description["dropped_columns"] else ""
    return description | {kind: _own_error(folder, kind) for kind in OWN_KINDS}


#: Kinds of the reference's own errors.
OWN_KINDS = ("step", "film", "basis")


def _own_error(folder: StudyFolder, kind: str) -> dict[str, Any]:
    if kind not in folder.study.checks:
        return dict.fromkeys(ERRORS) | {
            "why": f"this study computes no {kind} error of the reference"
        }
    (run, meaning) = folder.study.checks[kind]
    errors = folder.own_error(kind)
    if errors is None:
        return dict.fromkeys(ERRORS) | {"why": folder.why_not(run, REFERENCE)}
    joints = {joint: {name: values[name] for name in ERRORS} for joint, values in errors.items()}
    largest = {name: max(values[name] for values in joints.values()) for name in ERRORS}
    about = {"run": run, "against": REFERENCE, "how": meaning}
    return largest | about | {"joints": joints}


#: Columns of the table: errors, errors of the reference, and results of the run.
ERROR_COLUMNS = ("pressure_error_max", "pressure_error_l2", "film_error_max", "film_error_l2")
FLOORS = ("pressure_floor", "film_floor")
STEPS = ("steps", "rejected_steps", "newton_iterations")
EXTREMES = ("max_pressure_Pa", "min_film_thickness_m")
FIGURES = ("coordinates", "offline_s", "highest_frequency_Hz", *STEPS, *EXTREMES)
OWN = tuple(f"own_{name}" for name in ERROR_COLUMNS)

COLUMNS = (
    "run",
    "group",
    "joint",
    "method",
    "pressure_set",
    "selection",
    "vibration_modes",
    "residual_modes",
    "interior_modes",
    "film_cells",
    "tolerance",
    "order",
    "status",
    "coordinates",
    *ERROR_COLUMNS,
    *FLOORS,
    "offline_s",
    "online_s",
    *STEPS,
    "highest_frequency_Hz",
    "estimated_gap_error_m",
    "true_gap_error_m",
    *EXTREMES,
    "against",
    *OWN,
    "flexibility_tolerance",
    "body",
    "online_wall_s",
)


def table_row(row: Row, joint: str, folder: StudyFolder) -> dict[str, Any]:
    """Row of the table for a run and joint; None for unknown values."""
    outcome = folder.outcomes.get(row.run)
    values: dict[str, Any] = dict.fromkeys(COLUMNS)
    values |= {"run": row.run, "group": row.group, "joint": joint, "against": row.against or None}
    values |= _settings(folder.study.cases[row.run], joint)
    values["status"] = folder.status(row.run)
    if outcome is None or not outcome.complete:
        return values
    figures = {**outcome.figures, **outcome.figures.get("joints", {}).get(joint, {})}
    values |= {name: figures[name] for name in FIGURES}
    values |= {
        "film_cells": figures["film_cells"][joint],
        "online_s": figures["processor_time_s"],
        "online_wall_s": figures["wall_time_s"],
        "estimated_gap_error_m": folder.runs[row.run].estimates().get(joint),
    }
    for names, other in ((ERROR_COLUMNS, row.against), (OWN, row.fine_run)):
        if (errors := folder.errors(row.run, other)) is not None:
            values |= {
                column: errors[joint][name] for column, name in zip(names, ERRORS, strict=True)
            }
    if (errors := folder.errors(row.run, row.against)) is not None:
        values["true_gap_error_m"] = errors[joint][GAP]
    values |= zip(FLOORS, folder.floor(row, joint), strict=True)
    return {name: finite(value) for name, value in values.items()}


def _settings(case: Case, joint: str) -> dict[str, Any]:
    """Columns of the table with settings of a case, except settings that its method ignores."""
    reduction = next(iter(case.bodies.values())).settings.reduction
    time = case.scene.time
    cells = case.scene.joints[joint].cells
    values = {"method": reduction.method, "tolerance": time.tolerance, "order": time.order}
    for name in method_keys(reduction.method):
        values["vibration_modes" if name == "modes" else name] = getattr(reduction, name)
    values.pop("snapshots", None)
    if cells:
        values["film_cells"] = "x".join(map(str, cells))
    return values | {"body": " ".join(body.name for body in case.bodies.values())}


#: Meaning of the times in the table.
CLOCK = "processor time of one core with one thread, compilation left out"


def describe_study(study: Study) -> dict[str, object]:
    """Content of ``study.json``: scene, settings, versions and machine of a study."""
    with interrupt_kept():  # Gmsh may be imported for its version
        program_versions = versions(installed=True)
    return {
        "scene": study.scene.name,
        "joints": list(study.joints),
        "quick": study.quick,
        "version": __version__,
        "machine": machine(),
        "clock": CLOCK,
        "start": study.start,
        "runs": len(study.cases),
        "versions": program_versions,
        "settings": dict(study.scene.tables),
    }


def machine() -> dict[str, object]:
    """Description of this machine: processor, cores for this process, memory [GB], system."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    model = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    return {
        "cpu": model[1] if model else platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_GB": round(memory, 1),
        "os": platform.platform(),
    }


def run_study(
    folder: StudyFolder,
    executor: Executor,
    *,
    names: Collection[str] | None = None,
    progress: Progress | bool = True,
) -> list[dict[str, Any]]:
    """Run cases that are not complete; write ``study.json``, ``reference.json``, ``table.csv``.

    If a run fails, or if its files cannot be compared, its row has the reason, and the other cases
    are run. The table has a row for every run from the beginning, and is rewritten once a second.

    Parameters
    ----------
    folder
        Folder of the study.
    executor
        Executor that does the reductions and runs the cases, see `run_cases`.
    names
        Names of the cases to run; by default all.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the cases are
        a stage.

    Returns
    -------
    list of dict
        Rows of ``table.csv``, by column.
    """
    missing = [case for case in folder.take_stock() if names is None or case.name in names]
    path = folder.path / STUDY
    calls = read_json(path)["calls"] if path.exists() else []
    if missing:
        date = datetime.now(UTC).strftime("%Y-%m-%d")
        call = {
            "date": date,
            "version": __version__,
            "workers": getattr(executor, "width", None),
            "runs": len(missing),
        }
        calls.append(call)
    folder.write(STUDY, describe_study(folder.study) | {"calls": calls})
    folder.write_tables()
    # Runs with the shortest steps take longest, and are started first.
    missing.sort(key=lambda case: (case.name != REFERENCE, case.scene.time.tolerance))
    run_cases(folder, missing, executor, progress=chosen_progress(progress))
    return folder.rows()
