"""What a run answers, as an object in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.tracking import Tracker


@dataclass(frozen=True, eq=False)
class JointResult:
    """A lubricated joint over the steps of a run.

    Attributes
    ----------
    max_pressure, min_film_thickness
        shape (steps,) [Pa], [m].
    eccentricity
        Of the journal in the undeformed bore's frame, shape (steps, 2) [m].
    force
        Of the film on the journal in the frame at rest, shape (steps, 2) [N].
    """

    max_pressure: np.ndarray
    min_film_thickness: np.ndarray
    eccentricity: np.ndarray
    force: np.ndarray


@dataclass(frozen=True, eq=False)
class Result:
    """A run.

    Attributes
    ----------
    time
        Of the accepted steps, shape (steps,) [s].
    joints
        Lubricated joints by name.
    bodies, body_rates
        Coordinates of every body by name and their rates, shape (steps, n).
    figures
        What a summary has of every lubricated joint, by its name: extremes, and of its models means
        over the run, or the cycle.
    columns
        All that a history holds, by name with its unit, shape (steps,).
    newton_iterations, rejected_steps
        In all.
    energy_balance_error, net_energy_balance_error
        See `EnergyBalance`.
    status
        ``"complete"``, or why the figures cannot be trusted.
    cycles, periodicity_defect
        Of a periodic solution, which the steps are the last cycle of: cycles in all, and the
        largest change of a film from the cycle's start to its end, relative to the film.
    cycle_used
        Which part of the run `figures` whose names begin with ``cycle_`` are of.
    """

    time: np.ndarray
    joints: Mapping[str, JointResult]
    figures: Mapping[str, Mapping[str, float]]
    bodies: Mapping[str, np.ndarray]
    body_rates: Mapping[str, np.ndarray]
    columns: Mapping[str, np.ndarray]
    newton_iterations: int
    rejected_steps: int
    energy_balance_error: float
    net_energy_balance_error: float
    status: str
    cycles: int = 0
    periodicity_defect: float = float("nan")
    cycle_used: str = ""


class Recorder:
    """Collects the steps of a run, or of its last cycle.

    Parameters
    ----------
    run
        At its start.
    """

    def __init__(self, run: Run):
        self._system = run.equations.system
        self._tracker = Tracker(run.equations, run.norm)
        self._rows: list[dict[str, float]] = []
        self._states: list[tuple[np.ndarray, np.ndarray]] = []

    def add(self, step: MechanismStep, cycles: Cycles | None = None) -> None:
        """Account for an accepted step, of a periodic search in its current cycle."""
        if self._tracker.begins(cycles):
            self._rows, self._states = [], []
        row, _ = self._tracker.add(step)
        self._rows.append(row)
        self._states.append((step.x, step.rate))

    def result(self, cycles: Cycles | None = None) -> Result:
        """Of the steps so far, or of the last cycle of a search."""
        columns = {name: np.array([row[name] for row in self._rows]) for name in self._rows[0]}
        figures, system = self._tracker.figures(), self._system
        x, rates = map(np.array, zip(*self._states, strict=True))
        answer = self._tracker.answer(columns, cycles)
        return Result(
            columns["time_s"] - (cycles.start if cycles else 0.0),
            {place.name: self._joint(place.name, columns) for place in system.films},
            self._tracker.joint_figures(answer),
            {name: x[:, places] for name, places in system.bodies.items()},
            {name: rates[:, places] for name, places in system.bodies.items()},
            columns,
            figures["newton_iterations"],
            figures["rejected_steps"],
            figures["energy_balance_error"],
            figures["net_energy_balance_error"],
            self._tracker.verdict(),
            cycles.number if cycles else 0,
            cycles.defect if cycles else float("nan"),
            answer.used.told,
        )

    def _joint(self, name: str, columns: Mapping[str, np.ndarray]) -> JointResult:
        prefix = self._tracker.prefix(name)
        pressure, film, *pairs = (
            columns[prefix + column]
            for column in (
                "max_pressure_Pa",
                "min_film_thickness_m",
                "eccentricity_x_m",
                "eccentricity_y_m",
                "force_x_N",
                "force_y_N",
            )
        )
        return JointResult(pressure, film, np.column_stack(pairs[:2]), np.column_stack(pairs[2:]))
