"""Run a loaded journal, cycle after cycle, until its orbit repeats."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from fenics_ehd.errors import InputError, PeriodicityError
from fenics_ehd.film import FilmState
from fenics_ehd.film.forces import film_forces
from fenics_ehd.multibody.bdf import IntegratorState, Step, StepControl, advance
from fenics_ehd.multibody.cycles import Cycle, PeriodicSearch
from fenics_ehd.multibody.massless_journal import JournalState, MasslessJournal
from fenics_ehd.scenes.load_history import LoadHistory
from fenics_ehd.scenes.loaded_journal import build_journal, build_load, start_of, step_control
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.scenes.oil_history import OilAccount, oil_row
from fenics_ehd.sealed_file import named

#: Largest distance of nodes, as a share of the angle over which the film is thin. There the load
#: of a fixed position is 2 % off on quadratic cells and 6 % on bilinear ones, and the thinnest film
#: of an orbit by less; at 0.8 it is 15 %.
NODE_SPACING = 0.5


@dataclass
class OrbitTotals:
    """Figures of a run so far.

    Extremes, the error of the force balance and what was `exchanged` are those of
    the cycle under way: integrals of friction torque [N m s], of the power put into
    the film and of what it dissipates [J], and their latest `powers`.
    """

    cycle: int = 0
    cycle_time: float = 0.0
    time: float = 0.0
    steps: int = 0
    cycle_steps: int = 0
    newton_iterations: int = 0
    rejected_steps: int = 0
    film_solves: int = 0
    shooting_updates: int = 0
    max_pressure: float = 0.0
    max_pressure_time: float = 0.0
    min_film_thickness: float = np.inf
    min_film_thickness_time: float = 0.0
    max_eccentricity_ratio: float = 0.0
    force_balance_error: float = 0.0
    powers: np.ndarray | None = None
    exchanged: np.ndarray = field(default_factory=lambda: np.zeros(3))
    periodicity_defect: float = float("nan")
    largest_multiplier: float = float("nan")
    period: float = float("nan")
    wall_time: float = 0.0
    oil: OilAccount = field(default_factory=OilAccount)

    def begin_cycle(self) -> None:
        """Forget the extremes of the cycle before."""
        self.cycle += 1
        self.cycle_time, self.cycle_steps = 0.0, 0
        self.max_pressure, self.max_eccentricity_ratio = 0.0, 0.0
        self.min_film_thickness, self.force_balance_error = np.inf, 0.0
        self.powers, self.exchanged = None, np.zeros(3)
        self.oil = self.oil.next_cycle()

    @property
    def means(self) -> np.ndarray:
        """Mean friction torque [N m], power loss and dissipation [W], shape (3,)."""
        return self.exchanged / self.cycle_time if self.cycle_time else np.full(3, np.nan)

    @property
    def energy_error(self) -> float:
        """Difference of power loss and dissipation, relative, where no oil is pumped in."""
        _, work, dissipated = self.exchanged
        return abs(work - dissipated) / dissipated if dissipated else float("nan")


@dataclass
class OrbitRun:
    """All that a run carries from step to step.

    Attributes
    ----------
    journal, search
        See there.
    totals
        Figures so far.
    integrator
        See `IntegratorState`.
    """

    journal: MasslessJournal
    search: PeriodicSearch
    totals: OrbitTotals
    integrator: IntegratorState = field(init=False)

    def begin_cycle(self, start: np.ndarray, load: LoadHistory, control: StepControl) -> None:
        """Begin the next cycle at an eccentricity [m]."""
        self.totals.begin_cycle()
        self.search.begin(start)
        rate = self.journal.starting_rate(0.0, start, load.largest)
        self.integrator = IntegratorState.begin(self.journal, 0.0, start, rate, control)

    def memory(self) -> dict[str, Any]:
        """The same after a step, as nested dictionaries of arrays and numbers, for `restore`."""
        state = self.integrator
        return {
            "integrator": {n: getattr(state, n) for n in ("times", "x", "rate", "watched", "step")},
            "film": state.memory.film.memory(),
            "journal": self.journal.memory(),
            "search": self.search.memory(),
            "totals": asdict(self.totals),
        }

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on where another run of the same journal was.

        Raises
        ------
        InputError
            The memory is not of such a run.
        """
        with named(InputError, "the checkpoint's memory"):
            film = FilmState.as_guess(memory["film"])
            guess = JournalState.as_guess(film)
            self.integrator = IntegratorState(**memory["integrator"], memory=guess)
            self.journal.restore(memory["journal"], film)
            self.search.restore(memory["search"])
            for name, value in memory["totals"].items():
                setattr(self.totals, name, OilAccount(**value) if name == "oil" else value)


def simulate(
    settings: LoadedJournalSettings,
    totals: OrbitTotals,
    record: Callable[[dict[str, Any], dict[str, np.ndarray]], None] | None = None,
    progress: Callable[[OrbitTotals], None] | None = None,
    journal: MasslessJournal | None = None,
    load: LoadHistory | None = None,
    *,
    checkpoint: Callable[[OrbitRun], None] | None = None,
    memory: Mapping[str, Any] | None = None,
) -> Cycle:
    """Run cycles until the orbit repeats.

    Parameters
    ----------
    settings
        The scene.
    totals
        Updated step by step, so that an interrupted run keeps its figures.
    record
        Called with the history row and the fields of every accepted step of every
        cycle, so that the last one is the orbit. ``time_s`` runs on from cycle to
        cycle; the eccentricity jumps between two where Newton's method chose the start.
    progress
        Called after every accepted step.
    journal, load
        As `build_journal` and `build_load` make them; None: made here.
    checkpoint
        Called after every accepted step with the run, which can be stored.
    memory
        `OrbitRun.memory` of a run to go on with.

    Returns
    -------
    Cycle
        The last one, which repeats.

    Raises
    ------
    PeriodicityError
        No orbit repeats within the allowed number of cycles.
    """
    load = load or build_load(settings)
    journal = journal or build_journal(settings, load)
    control = step_control(settings, load.period)
    run, began = OrbitRun(journal, journal.search(control), totals), perf_counter()
    if memory is None:
        run.begin_cycle(start_of(settings), load, control)
    else:
        run.restore(memory)
    began, solved = began - totals.wall_time, totals.film_solves
    totals.period, tables = load.period, [load.tabulated]
    while True:
        while run.integrator.time < load.period:
            state = run.integrator
            step, run.integrator = advance(journal, state, load.period, control, tables=tables)
            run.search.add(step)
            row = _row(journal, step, totals)
            _account(totals, row, step, load.largest)
            totals.film_solves = solved + journal.film_solves
            totals.wall_time = perf_counter() - began
            if record is not None:
                record(row, _fields(step))
            if checkpoint is not None:
                checkpoint(run)
            if progress is not None:
                progress(totals)
        cycle = run.search.finish()
        totals.periodicity_defect = cycle.defect
        totals.largest_multiplier = cycle.largest_multiplier
        if cycle.repeats(settings.time.periodicity):
            return cycle
        if totals.cycle >= settings.time.cycles:
            raise PeriodicityError(_not_periodic(settings, totals))
        totals.shooting_updates += cycle.corrected
        run.begin_cycle(cycle.next_start, load, control)


def _not_periodic(settings: LoadedJournalSettings, totals: OrbitTotals) -> str:
    return (
        f"after time.cycles = {totals.cycle} cycles the film still changes by "
        f"{totals.periodicity_defect:.2e} from cycle to cycle, above time.periodicity = "
        f"{settings.time.periodicity:g} (largest Floquet multiplier "
        f"{totals.largest_multiplier:.3g}, eccentricity ratio up to "
        f"{totals.max_eccentricity_ratio:.4g}): allow more cycles or check the load"
    )


def _row(journal: MasslessJournal, step: Step, totals: OrbitTotals) -> dict[str, Any]:
    """One row of the history."""
    state, parameters = step.auxiliary, journal.film.parameters
    pressure = state.film.pressure
    forces = film_forces(journal.film, state.film, journal.motion(step.x, step.rate))
    peak = int(np.argmax(pressure))
    eccentricity = float(np.hypot(*step.x))
    return {
        "time_s": totals.time + step.time - totals.cycle_time,
        "max_pressure_Pa": pressure[peak],
        "min_film_thickness_m": parameters.clearance - eccentricity,
        "max_pressure_angle_deg": np.degrees(parameters.grid.node_positions[peak, 0]),
        "cycle": totals.cycle,
        "cycle_time_s": step.time,
        "eccentricity_x_m": step.x[0],
        "eccentricity_y_m": step.x[1],
        "load_x_N": state.load[0],
        "load_y_N": state.load[1],
        "friction_torque_Nm": -forces.friction_torque,
        "power_loss_W": forces.power,
        "dissipation_W": forces.dissipation,
        "step_s": step.time - totals.cycle_time,
        "newton_iterations": step.newton_iterations,
        "rejected_steps": sum(step.rejected.values()),
        **oil_row(journal, state.film),
    }


def _fields(step: Step) -> dict[str, np.ndarray]:
    """What goes to HDF5 of one step."""
    film = step.auxiliary.film
    fields = {
        "eccentricity_m": step.x,
        "eccentricity_rate_m_per_s": step.rate,
        "pressure_Pa": film.pressure,
    }
    if film.fluid_fraction is not None:
        fields["fluid_fraction"] = film.fluid_fraction
    return fields


def _account(totals: OrbitTotals, row: dict[str, Any], step: Step, largest_load: float) -> None:
    totals.time, totals.cycle_time = row["time_s"], row["cycle_time_s"]
    totals.steps += 1
    totals.cycle_steps += 1
    totals.newton_iterations += row["newton_iterations"]
    totals.rejected_steps += row["rejected_steps"]
    thickness, eccentricity = row["min_film_thickness_m"], float(np.hypot(*step.x))
    if row["max_pressure_Pa"] > totals.max_pressure:
        totals.max_pressure, totals.max_pressure_time = row["max_pressure_Pa"], step.time
    if thickness < totals.min_film_thickness:
        totals.min_film_thickness, totals.min_film_thickness_time = thickness, step.time
        totals.max_eccentricity_ratio = eccentricity / (thickness + eccentricity)
    # By the trapezoidal rule; the first step of a cycle, a tiny one, has no left end.
    powers = np.array([row[n] for n in ("friction_torque_Nm", "power_loss_W", "dissipation_W")])
    before = powers if totals.powers is None else totals.powers
    totals.exchanged = totals.exchanged + 0.5 * row["step_s"] * (before + powers)
    totals.powers = powers
    if "oil_content_m3" in row:
        totals.oil.add(row)
    imbalance = float(np.hypot(*(step.auxiliary.force + step.auxiliary.load))) / largest_load
    totals.force_balance_error = max(totals.force_balance_error, imbalance)


def verdict(settings: LoadedJournalSettings, totals: OrbitTotals) -> str:
    """``"complete"``, or why the orbit of a run that came to its end cannot be trusted."""
    film, ratio = settings.film, totals.max_eccentricity_ratio
    spacing = 360.0 / film.cells[0] / (1 if film.element == "bilinear" else 2)
    # Where the gap is below twice its least: h = c (1 - eps cos phi).
    thin = float(np.degrees(np.sqrt(2 * (1 - ratio))))
    if spacing > NODE_SPACING * thin:
        return (
            f"untrustworthy: film.cells = {film.cells[0]} around put nodes {spacing:.3g} degrees "
            f"apart, above half of the {thin:.3g} degrees over which the film is thin at "
            f"eccentricity ratio {ratio:.4g}: use more cells"
        )
    if totals.largest_multiplier > 1:
        return (
            "untrustworthy: the periodic orbit repels, its largest Floquet multiplier is "
            f"{totals.largest_multiplier:.4g}: the shaft would leave it"
        )
    return "complete"
