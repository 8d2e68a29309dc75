"""What a run answers, as an object in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fenics_ehd.multibody.bdf import Step
from fenics_ehd.multibody.energy import EnergyBalance
from fenics_ehd.multibody.powers import step_powers
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm


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
    newton_iterations, rejected_steps
        In all.
    energy_balance_error
        See `EnergyBalance.error`.
    cycles, periodicity_defect
        Of a periodic solution, which the steps are the last cycle of: cycles in all, and the
        largest change of a film from the cycle's start to its end, relative to the film.
    """

    time: np.ndarray
    joints: Mapping[str, JointResult]
    bodies: Mapping[str, np.ndarray]
    body_rates: Mapping[str, np.ndarray]
    newton_iterations: int
    rejected_steps: int
    energy_balance_error: float
    cycles: int = 0
    periodicity_defect: float = float("nan")


class Recorder:
    """Collects the steps of a run, or of one of its cycles.

    Parameters
    ----------
    equations, norm
        Of the mechanism.
    """

    def __init__(self, equations: StepEquations, norm: StepNorm):
        self._equations, self._norm = equations, norm
        self._steps: list[Step] = []
        self._joints: list[list[tuple]] = [[] for _ in equations.system.films]
        self._balance: EnergyBalance | None = None

    def add(self, step: Step) -> None:
        """Account for an accepted step."""
        powers = step_powers(self._equations, step)
        if self._balance is None:
            self._balance = EnergyBalance(step.time, powers)
        else:
            self._balance.add(step.time, powers)
        self._steps.append(step)
        for found, figures in zip(self._joints, self._figures(step), strict=True):
            found.append(figures)

    def _figures(self, step: Step) -> Iterator[tuple]:
        """Fields of `JointResult`, joint by joint."""
        state = step.auxiliary
        gaps = self._norm.film_gaps(step.watched)
        films = self._equations.system.films
        for place, film, gap in zip(films, state.films, gaps, strict=True):
            force = state.motion.multipliers[place.rows][:2]
            yield film.pressure.max(), gap.min(), step.x[place.xi[:2]], force

    def result(self, cycles: int = 0, defect: float = float("nan")) -> Result:
        """Of all steps so far."""
        system, steps = self._equations.system, self._steps
        z, rates = (
            np.array([values[: system.n] for values in rows])
            for rows in ([s.x for s in steps], [s.rate for s in steps])
        )
        return Result(
            np.array([step.time for step in steps]),
            {
                place.name: JointResult(*map(np.array, zip(*found, strict=True)))
                for place, found in zip(system.films, self._joints, strict=True)
            },
            {name: z[:, places] for name, places in system.bodies.items()},
            {name: rates[:, places] for name, places in system.bodies.items()},
            sum(step.newton_iterations for step in steps),
            sum(sum(step.rejected.values()) for step in steps),
            self._balance.error if self._balance is not None else 0.0,
            cycles,
            defect,
        )
