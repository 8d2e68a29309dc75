"""A machine step by step: its figures, its energy, what is recorded, where it can go on from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from time import perf_counter, process_time
from typing import Any, Protocol

import numpy as np

from fenics_ehd.errors import FilmTooThinError, InputError, StepSizeError
from fenics_ehd.multibody.basis_error import BasisErrorEstimate
from fenics_ehd.multibody.bdf import IntegratorState, Step, StepControl, advance
from fenics_ehd.multibody.coupled import CoupledState, CoupledSteps, PressureMemory
from fenics_ehd.multibody.energy import EnergyBalance, Powers
from fenics_ehd.multibody.equations import Mechanism
from fenics_ehd.multibody.neglected_inertia import neglected_inertia, slowest_pattern
from fenics_ehd.multibody.tabulated import TabulatedLoad
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.sealed_file import named, require_like

#: Takes the history row and the fields of a step.
Record = Callable[[dict[str, Any], dict[str, np.ndarray]], None]

#: Residual patterns of M4 so few that they may be why no step is short enough.
FEW_PATTERNS = 30

#: Largest energy balance error of a run that may be trusted.
ENERGY_LIMIT = 0.05

#: The same over the energy put in for good, most of it dissipated by film and damping, which is
#: what errors of the film are to be compared with: 0.1 to 3 % at usual tolerances, 32 % where long
#: steps leave the film 12 % off. Below `RESOLVED` of the energy exchanged the defect may be that of
#: the power's integral, 0.02 % at default steps.
NET_LIMIT, RESOLVED = 0.2, 5e-4


class Machine(Mechanism, Protocol):
    """A mechanism that can be run.

    Attributes
    ----------
    size
        Length of its state.
    tables
        Loads whose rows no step may jump over.
    """

    size: int
    tables: Sequence[TabulatedLoad]

    def watch(self, x: np.ndarray) -> np.ndarray:
        """Gap at the watched points [m], see `fenics_ehd.multibody.bdf.Watched`."""

    def error_norm(self, watched: np.ndarray, error: np.ndarray) -> float:
        """See `fenics_ehd.multibody.bdf.Watched`."""

    def powers(self, x: np.ndarray, rate: np.ndarray, state: CoupledState) -> Powers:
        """Energy and powers at an accepted step."""


@dataclass
class Totals:
    """Figures of a run so far."""

    time: float = 0.0
    steps: int = 0
    newton_iterations: int = 0
    rejected_steps: int = 0
    film_solves: int = 0
    max_pressure: float = 0.0
    max_pressure_time: float = 0.0
    min_film_thickness: float = np.inf
    min_film_thickness_time: float = 0.0
    basis_error: float = float("nan")
    energy_error: float = 0.0
    net_energy_error: float = 0.0
    wall_time: float = 0.0
    processor_time: float = 0.0
    rejections: dict[str, int] = field(default_factory=dict)

    def add(self, row: Mapping[str, Any], step: Step) -> None:
        """Account for an accepted step and its row of the history."""
        self.time = step.time
        self.steps += 1
        self.newton_iterations += step.newton_iterations
        self.rejected_steps += row["rejected_steps"]
        for reason, count in step.rejected.items():
            self.rejections[reason] = self.rejections.get(reason, 0) + count
        if row["max_pressure_Pa"] > self.max_pressure:
            self.max_pressure, self.max_pressure_time = row["max_pressure_Pa"], step.time
        if row["min_film_thickness_m"] < self.min_film_thickness:
            self.min_film_thickness = row["min_film_thickness_m"]
            self.min_film_thickness_time = step.time

    def figures(self) -> dict[str, object]:
        """What every machine's ``summary.json`` has of them."""
        return {
            "max_pressure_Pa": float(self.max_pressure),
            "max_pressure_time_s": self.max_pressure_time,
            "min_film_thickness_m": float(self.min_film_thickness),
            "min_film_thickness_time_s": self.min_film_thickness_time,
            "basis_error_estimate_m": self.basis_error,
            "energy_balance_error": self.energy_error,
            "net_energy_balance_error": self.net_energy_error,
            "simulated_time_s": self.time,
            "steps": self.steps,
            "rejected_steps": self.rejected_steps,
            "rejected_because": self.rejections,
            "newton_iterations": self.newton_iterations,
            "film_solves": self.film_solves,
            "processor_time_s": self.processor_time,
        }


@dataclass
class Progress:
    """All that a run carries from step to step.

    Attributes
    ----------
    integrator
        See `IntegratorState`.
    totals, balance, estimate
        Figures so far.
    """

    integrator: IntegratorState
    totals: Totals
    balance: EnergyBalance
    estimate: BasisErrorEstimate

    @classmethod
    def begin(
        cls,
        machine: Machine,
        body: ReducedBody,
        damping_time: float,
        control: StepControl,
        initial: Powers,
        totals: Totals,
        start: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> Progress:
        """A run at time zero, its powers there, and its state and rate; None: all at rest."""
        rest = np.zeros(machine.size)
        x, rate = (rest, rest) if start is None else start
        estimate = BasisErrorEstimate(
            body.missing_flexibility, damping_time, neglected_inertia(body), slowest_pattern(body)
        )
        integrator = IntegratorState.begin(machine, 0.0, x, rate, control)
        return cls(integrator, totals, EnergyBalance(0.0, initial), estimate)

    def memory(self) -> dict[str, Any]:
        """The same as nested dictionaries of arrays and numbers, for `restore`."""
        state, memory = self.integrator, self.integrator.memory
        points = {name: getattr(state, name) for name in ("times", "x", "rate", "watched", "step")}
        return {
            "integrator": points,
            "pressures": {} if memory is None else vars(memory),
            "totals": asdict(self.totals),
            "balance": self.balance.memory(),
            "estimate": self.estimate.memory(),
        }

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on where another run of the same machine was.

        Raises
        ------
        InputError
            The memory is not of such a run.
        """
        with named(InputError, "the checkpoint's memory"):
            require_like(memory, self.memory())
            pressures = memory["pressures"]
            remembered = PressureMemory(**pressures) if pressures else None
            self.integrator = IntegratorState(**memory["integrator"], memory=remembered)
            _require_sound(self.integrator, memory["totals"]["time"])
            for name, value in memory["totals"].items():
                setattr(self.totals, name, value)
            self.balance.restore(memory["balance"])
            self.estimate.restore(memory["estimate"])


def _require_sound(state: IntegratorState, time: float) -> None:
    """Past points of one length, finite, newest first from the given time on, and a step."""
    for name, past in (("integrator", state), ("pressures", state.memory)):
        for key, values in vars(past).items() if past is not None else ():
            if key != "memory" and not np.isfinite(values).all():
                raise ValueError(f"{name}/{key} holds a value that is not finite")
            if np.ndim(values) and len(values) != len(past.times):
                raise ValueError(
                    f"{name}/{key} has {len(values)} rows, times has {len(past.times)}"
                )
        if past is not None and not ((np.diff(past.times) < 0).all() and past.times[0] == time):
            raise ValueError(f"{name}/times must descend from {time:.9g} s")
    if not state.step > 0:
        raise ValueError(f"integrator/step = {state.step} s must be positive")


@dataclass(frozen=True)
class Watchers:
    """Who wants to know of every accepted step.

    Attributes
    ----------
    record
        Called with the history row and the fields.
    progress
        Called with the figures so far and the step.
    checkpoint
        Called with the run, which can be stored.
    """

    record: Record | None = None
    progress: Callable[[Totals, Step], None] | None = None
    checkpoint: Callable[[Progress], None] | None = None


def march(
    machine: Machine,
    run: Progress,
    end: float,
    control: StepControl,
    smallest_film: float,
    describe: Callable[[Step, Powers], dict[str, Any]],
    watchers: Watchers,
) -> None:
    """Integrate a run up to a time [s].

    Parameters
    ----------
    machine, run
        The run is updated step by step, so that an interrupted one keeps its figures.
    end, control
        Step sizes.
    smallest_film
        Film thickness at which the run ends [m].
    describe
        Columns of the history that only this kind of machine has.
    watchers
        See there.

    Raises
    ------
    FilmTooThinError
        After the step that fell below the smallest film.
    StepSizeError
        From `advance`.
    """
    solve = CoupledSteps(machine)
    before, began = run.totals.film_solves, perf_counter() - run.totals.wall_time
    busy_before = process_time() - run.totals.processor_time
    n = machine.journal.coordinates
    while run.integrator.time < end:
        step, run.integrator = _advanced(machine, run.integrator, end, control, solve)
        powers = machine.powers(step.x, step.rate, step.auxiliary)
        run.balance.add(step.time, powers)
        pressure = machine.journal.bore.structure_pressure(step.auxiliary.film.pressure)
        size = step.time - run.totals.time
        row = common_columns(machine, step) | describe(step, powers)
        row |= {
            "step_s": size,
            "newton_iterations": step.newton_iterations,
            "rejected_steps": sum(step.rejected.values()),
            "kinetic_energy_J": powers.kinetic,
            "strain_energy_J": powers.strain,
            **{f"{name}_work_J": work for name, work in run.balance.work.items()},
            "energy_defect_J": run.balance.defect,
            "basis_error_estimate_m": run.estimate.add(size, pressure, step.acceleration[n:]),
        }
        totals = run.totals
        totals.add(row, step)
        totals.basis_error, totals.energy_error = run.estimate.largest, run.balance.error
        totals.net_energy_error = run.balance.net_error
        totals.film_solves = before + solve.solves
        totals.wall_time = perf_counter() - began
        totals.processor_time = process_time() - busy_before
        if watchers.record is not None:
            fields = {"coordinates": step.x[:n], "rates": step.rate[:n], "pressure_Pa": pressure}
            if machine.journal.compliance is not None:
                fields["quasi_static"] = step.x[n:]
            watchers.record(row, fields)
        if watchers.checkpoint is not None:
            watchers.checkpoint(run)
        if watchers.progress is not None:
            watchers.progress(totals, step)
        check_film(row["min_film_thickness_m"], step.time, smallest_film)


def _advanced(
    machine: Machine, state: IntegratorState, end: float, control: StepControl, solve: CoupledSteps
) -> tuple[Step, IntegratorState]:
    """One step, see `advance`; where there is none, what a truncated body has to do with it."""
    try:
        return advance(machine, state, end, control, solve, machine.tables)
    except StepSizeError as error:
        compliance = machine.journal.compliance
        if compliance is None or len(compliance.patterns) > FEW_PATTERNS:
            raise
        raise StepSizeError(
            f"{error}; or lower reduction.residual_truncation: a bore that yields in "
            f"{len(compliance.patterns)} patterns only resists a short step more than the oil"
        ) from error.__cause__


def common_columns(machine: Machine, step: Step) -> dict[str, Any]:
    """First columns of every history."""
    pressure = step.auxiliary.film.pressure
    peak = int(np.argmax(pressure))
    angle, _ = machine.journal.film.parameters.grid.node_positions[peak]
    return {
        "time_s": step.time,
        "max_pressure_Pa": pressure[peak],
        "min_film_thickness_m": step.watched.min(),
        "max_pressure_angle_deg": np.degrees(np.mod(angle + np.pi, 2 * np.pi) - np.pi),
    }


def check_film(thickness: float, time: float, smallest: float) -> None:
    """Refuse to go on with a film in which surfaces would touch.

    Raises
    ------
    FilmTooThinError
        Naming thickness, time and key.
    """
    if thickness < smallest:
        raise FilmTooThinError(
            f"the film is {thickness * 1e6:.3g} um thin at t = {time:.6g} s, below "
            f"bearing.smallest_film of the clearance, {smallest * 1e6:.3g} um: surfaces would "
            "touch; the history up to there is kept"
        )


def verdict(totals: Totals) -> str:
    """``"complete"``, or why the figures of a run that came to its end cannot be trusted."""
    if totals.energy_error > ENERGY_LIMIT:
        found = totals.energy_error, "the energy exchanged", ENERGY_LIMIT
    elif totals.energy_error > RESOLVED and totals.net_energy_error > NET_LIMIT:
        found = totals.net_energy_error, "the energy put in for good", NET_LIMIT
    else:
        return "complete"
    error, whole, limit = found
    return (
        f"untrustworthy: energy balance error {100 * error:.2g} % of {whole}, above "
        f"{100 * limit:g} %: lower time.tolerance or time.largest_step"
    )
