"""Runs as pictures show them: the last cycle of every joint, and the motion of the mechanism.

The mechanism is read from the run's folder, without meshing, reduction or compilation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import trapezoid

from fenics_ehd.base.columns import split_unit
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import ERROR_BUDGET, read_json
from fenics_ehd.base.sealed_file import named
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.multibody.cycle import CRANK, TURN_ROUNDING, angle_before, angle_name
from fenics_ehd.multibody.history import History, load_history
from fenics_ehd.multibody.recorded_quantities import FilmResult
from fenics_ehd.multibody.summary import EXTREMES, extreme_of
from fenics_ehd.results.motion import RecordedMotion
from fenics_ehd.results.recorded_run import SCENE_NAME
from fenics_ehd.scenes.run import stored_scene


def recorded(directory: Path, result: History | None = None) -> RecordedMotion:
    """Motion of a run's mechanism at its recorded steps, also for a run in progress or killed.

    Parameters
    ----------
    directory
        Folder of the run.
    result
        History of the run, or a part of this history; by default it is read from the folder.

    Raises
    ------
    InputError
        The folder has no scene, or the run has no step.
    SettingsError, BodyFileError
        The scene or a body in the folder cannot be read.
    """
    scene = directory / SCENE_NAME
    if not scene.is_file():
        raise InputError(f"{scene} does not exist: {directory} is not the folder of a run")
    # The recorded motion needs no forces, whose tables may be missing.
    _, built = stored_scene(directory, forces=False)
    return RecordedMotion(built.mechanism, result or load_history(directory))


def moving_part(history: History) -> History:
    """Steps to animate: the last cycle of a periodic run, or all steps of another run."""
    return history.last_cycle() if history.cycle.periodic else history


#: Columns for the horizontal axis of a cycle: the reference angle, or the time if no body turns.
ANGLE = "crank_angle_deg"
TIME = "time_s"

#: Share of a revolution that may be missing in a cycle of one, because of its first step.
START_STEP = 0.05

#: Column of the kinetic and strain energy minus that at the start.
STORED = "stored_energy_J"

#: Entries of each component in the stored error budget of a joint.
BUDGET = (
    "time_s",
    "max_pressure_Pa",
    "min_film_thickness_m",
    "more_max_pressure_Pa",
    "more_min_film_thickness_m",
)


class ShownRun:
    """The last cycle of a run, with the columns that pictures show.

    Parameters
    ----------
    name
        Name of the run in legends.
    source
        Folder of the run, or its history.

    Attributes
    ----------
    directory
        Folder of the run; None for a history of `simulate`.
    cycle
        History of the cycle. If the cycle starts between two steps, its first row is interpolated
        at the start.
    time, angle
        Times since the start of the cycle [s], and reference angles [degrees] (0 if no body turns),
        both of shape (t,).
    angle_name
        Words for the reference angle, ``"crank angle"`` or ``"angle of the shaft"``.
    starts
        Whether the cycle is the first of the run, in which the films build up.
    time_name
        Words for `time`: ``"time in the cycle"``, or ``"time"`` if the cycle is the complete run.
    figures
        Results of every joint in the summary, by the name of the joint.
    current
        Whether figures without the prefix ``cycle_`` are those of the cycle that is shown.
    label
        Label of an incomplete cycle for the horizontal axis; empty for a complete cycle.

    Raises
    ------
    InputError
        The folder has no history.
    """

    def __init__(self, name: str, source: str | Path | History):
        self.name = name
        result = source if isinstance(source, History) else load_history(source)
        self.directory = result.folder
        self.figures: Mapping[str, Mapping[str, Any]] = result.figures
        self.angle_name = angle_name(result.entries.get("reference_body", CRANK))
        self._solved = result.solved
        time = result.run.time
        cycle = result.cycle
        start = cycle.start
        self.label = "" if cycle.complete else cycle.label
        # In its first cycle, a search for a periodic solution builds up the films like any other
        # run.
        self.starts = start <= 0.0
        self._start = 0.0 if cycle.periodic else start
        rows = cycle.rows(np.asarray(time))
        first = rows.start
        behind = rows.stop
        self.time_name = "time in the cycle" if cycle.periodic or start > 0.0 else "time"
        self.current = behind == len(time) and (cycle.periodic or start <= 0.0)
        if first:
            # The cycle starts between two steps.
            last = first - 1
            share = np.interp(start, time, np.arange(len(time))) - first + 1
            result = result.each(
                lambda v: np.concatenate(
                    [(1 - share) * v[last:first] + share * v[first : first + 1], v[first:behind]]
                )
            )
        else:
            result = result.each(lambda v: v[:behind])
        self.cycle = result
        self.time = self.cycle.run.time - start
        angle = np.array(self.cycle.run.get("crank_angle", np.zeros(len(self.cycle))))
        # The angle at the end of the previous cycle is larger by a number of turns.
        angle[:1] -= 360.0 * np.round((angle[:1] - angle[1:2]) / 360.0)
        self.angle = angle - angle_before(angle)

    @cached_property
    def joints(self) -> dict[str, ShownJoint]:
        """Lubricated joints of the run, by name."""
        return {
            name: ShownJoint(self, name, joint.columns | self._cycle_columns | self._errors(name))
            for name, joint in self.cycle.joints.items()
        }

    @property
    def whole(self) -> ShownJoint:
        """Columns of the run as a whole: energies, and works since the first step."""
        columns = self.cycle.run.columns
        stored = columns["kinetic_energy_J"] + columns["strain_energy_J"]
        return ShownJoint(self, "", columns | self._cycle_columns | {STORED: stored - stored[0]})

    @property
    def _cycle_columns(self) -> dict[str, np.ndarray]:
        """Columns for the horizontal axis: time, and crank angle if a body turns."""
        return {TIME: self.time} | ({ANGLE: self.angle} if np.ptp(self.angle) else {})

    @property
    def origin(self) -> str:
        """Folder of the run, or its name if it has no folder, for messages."""
        return str(self.directory or self.name or "the history")

    def journal_angle(self, joint: str) -> np.ndarray | None:
        """Angle of the body with the journal of a joint over the cycle [rad], shape (t,).

        It is None if the body does not turn through a revolution, or if the bore's body turns.
        """
        if self._solved is not None:
            settings = vars(self._solved.system.mechanism.joints[joint])
        else:
            settings = self.cycle.scene.get("joints", {}).get(joint, {})
        journal, bore = (
            self.cycle.bodies.get(str(settings.get(side, "")).partition(".")[0])
            for side in ("journal", "bore")
        )
        if journal is None or "angle" not in journal:
            return None
        if bore is not None and "angle" in bore and np.ptp(bore["angle"]) > TURN_ROUNDING:
            return None
        angle = np.unwrap(journal["angle"])
        return angle if np.ptp(angle) >= 2 * np.pi * (1 - START_STEP) else None

    @cached_property
    def motion(self) -> RecordedMotion:
        """Motion of the mechanism over the cycle.

        Raises
        ------
        InputError
            The folder has no scene; or there is no folder, and the history has no mechanism.
        """
        if self.directory is not None:
            return recorded(self.directory, self.cycle)
        if self._solved is None:
            raise InputError(
                f"{self.origin}: the history has no mechanism: give the folder of the run, or the "
                "history that simulate returned"
            )
        return RecordedMotion(self._solved.system.mechanism, self.cycle)

    def _errors(self, joint: str) -> dict[str, np.ndarray]:
        """Estimated relative errors of a joint over time, by component of the error budget.

        The result is empty if the run has no error budget.
        """
        if self.directory is None:
            return {}
        path = self.directory / ERROR_BUDGET
        if not path.is_file():
            return {}
        errors = {}
        with named(InputError, f"{path}: not the error budget of a run"):
            for component, over in read_json(path).get(joint, {}).items():
                time, pressure, film, more_pressure, more_film = (np.array(over[k]) for k in BUDGET)
                for name, error in (
                    ("pressure_error", more_pressure / pressure.max()),
                    ("film_error", more_film / film),
                ):
                    errors[f"{component}.{name}"] = np.interp(
                        self._start + self.time, time, error, left=np.nan
                    )
        return errors


@dataclass(frozen=True, eq=False)
class ShownJoint:
    """A lubricated joint of a run; with an empty name, the run as a whole.

    Attributes
    ----------
    run, name
        The run, and the name of the joint.
    columns
        Columns of the history over the cycle, by name.
    """

    run: ShownRun
    name: str
    columns: Mapping[str, np.ndarray]

    @cached_property
    def journal_angle(self) -> np.ndarray | None:
        """Angle of the journal's body, see `ShownRun.journal_angle`."""
        return self.run.journal_angle(self.name)

    def extreme(self, column: str, over: str) -> tuple[float, float] | None:
        """Position on the axis `over` [degrees] or [ms] and value of an extreme of a column.

        The value is that of the summary, interpolated between the steps. The result is None if the
        summary does not have the extreme.
        """
        figures = self.run.figures.get(self.name, {})
        name, prefix = next(
            ((name, prefix) for name, source, prefix, _ in EXTREMES if source == column), ("", "")
        )
        value = figures.get(f"cycle_{prefix}{column}")
        if value is None and self.run.current:
            value = figures.get(column)
        if not isinstance(value, int | float):
            return None
        angle = figures.get(f"cycle_{name}_crank_angle_deg")
        if over == ANGLE and angle is not None:
            return angle, value
        time = figures.get(f"{split_unit(column)[0]}_time_s") if self.run.current else None
        if time is None:
            _, time = extreme_of(column, self.columns[TIME], self.columns[column], None)
        if over == TIME:
            return 1e3 * time, value
        return float(np.interp(time, self.columns[TIME], self.columns[ANGLE])), value

    def mean(self, column: str) -> float:
        """Mean of a column over the cycle: that of the summary, else that of the shown steps."""
        figures = self.run.figures.get(self.name, {})
        value = figures.get(f"cycle_mean_{column}")
        if value is None and self.run.current:
            value = figures.get(f"mean_{column}")
        if isinstance(value, int | float):
            return float(value)
        return float(mean(self.columns[column], self.columns[TIME]))

    @cached_property
    def film(self) -> FilmResult:
        """Recorded fields of the joint's film over the cycle."""
        return self.run.cycle.joints[self.name].film

    @cached_property
    def grid(self) -> FilmGrid:
        """Mesh of the joint's film."""
        return film_grid(self.film)

    @cached_property
    def contact(self) -> np.ndarray | None:
        """Contact pressure at the film's nodes [Pa], shape (t, k); None for smooth surfaces."""
        run = self.run
        if "contact_force" not in run.cycle.joints[self.name]:
            return None
        films = run.motion.system.films
        binding = next(binding for binding in films if binding.name == self.name)
        surfaces = binding.film.film.parameters.surfaces
        assert surfaces is not None
        gap = np.asarray(self.film.gap)
        return np.where(binding.film.film.supplied_nodes, 0.0, surfaces.contact(gap).pressure)


def mean(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Mean over time of values at all instants, shape (t, ...)."""
    return trapezoid(values, time, axis=0) / np.ptp(time) if len(time) > 1 else values[0]


def film_grid(film: FilmResult) -> FilmGrid:
    """Film mesh of a recorded film; the first node of a cell is at its least angle and height."""
    corners = film.cells[:, :4]
    angles = np.unique(np.asarray(film.angle)[corners[:, 0]])
    heights = np.unique(np.asarray(film.height)[corners])
    return FilmGrid(film.radius, np.append(angles, angles[0] + 2 * np.pi), heights, film.family)
