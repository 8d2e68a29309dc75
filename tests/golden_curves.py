"""Golden curves of whole machines: made, read, and run again in the same steps.

A golden is the history of a scene of `tests/golden/house` or of a shipped one as the program gave
it when the file was made: times of all its steps, and at some of them extremes, forces, torques,
flows and contents of every film, solved to 1e-9; the last step's pressures; and what a run in steps
of its own found. It is a record of computed values, not a reference solution.

This module is the only one of these tests that looks below the public names.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import Step
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.scenes.build import build

FOLDER = Path(__file__).parent / "golden" / "house"

#: Scenes of `FOLDER`, which together have every model.
SMALL = (
    "slider-crank-small", "slider-crank-plain", "four-bar-oil", "slider-crank-rough",
    "slider-crank-shapes", "journal-starved", "slider-crank-conserved", "slider-crank-both",
    "rotor-tilt", "slider-crank-torque", "slider-crank-full",
)  # fmt: skip

#: Shipped ones, whose parts are meshed and reduced first.
SHIPPED = (
    "slider-crank", "slider-crank-paper", "slider-crank-both-ends", "four-bar", "loaded-journal",
    "loaded-journal-starved", "rotor", "rotor-paper", "rotor-two-bearings", "engine",
)  # fmt: skip

#: Steps of a golden at most, and rows of its columns.
STEPS, ROWS = 300, 100

#: Of Newton's last update in held steps.
NEWTON = 1e-9

#: Columns of a joint that a golden keeps, where the joint has them.
COLUMNS = (
    "max_pressure_Pa", "min_film_thickness_m", "force_x_N", "force_y_N", "friction_torque_Nm",
    "bore_friction_torque_Nm", "dissipated_power_W", "side_flow_m3_per_s", "supply_flow_m3_per_s",
    "oil_content_m3", "contact_force_N", "contact_share",
)  # fmt: skip

#: Digits of columns: the finest tolerance is 1e-6 of a column's largest value.
DIGITS = 8


@dataclass(frozen=True, eq=False)
class Curve:
    """Columns at the rows of a golden and the last pressures of every film, by path."""

    columns: Mapping[str, np.ndarray]
    pressures: Mapping[str, np.ndarray]

    def deviation(self, other: Curve) -> dict[str, float]:
        """Largest difference of every column over its own largest value."""
        found = {}
        for name, own in {**self.columns, **self.pressures}.items():
            largest = max(float(np.abs(own).max()), np.finfo(float).tiny)
            expected = (other.columns | other.pressures)[name]
            found[name] = float(np.abs(own - expected).max()) / largest
        return found


@dataclass(frozen=True, eq=False)
class Golden:
    """What a file has: steps that are held, a curve, and what a run in its own steps found."""

    times: np.ndarray
    corners: np.ndarray
    curve: Curve
    own: Mapping[str, float]

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        found = {
            "times": self.times.tolist(),
            "corners": np.flatnonzero(self.corners).tolist(),
            "own": dict(self.own),
            "columns": {name: _rounded(values) for name, values in self.curve.columns.items()},
            "pressures": {name: _rounded(values) for name, values in self.curve.pressures.items()},
        }
        lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in found.items()]
        path.write_text("{" + ",\n".join(lines) + "}\n")

    @classmethod
    def load(cls, name: str) -> Golden:
        """Of a scene."""
        found = json.loads((FOLDER / f"{name}.json").read_text())
        times = np.array(found["times"])
        corners = np.isin(np.arange(len(times)), found["corners"])
        arrays = (
            {key: np.array(values) for key, values in found[part].items()}
            for part in ("columns", "pressures")
        )
        return cls(times, corners, Curve(*arrays), found["own"])


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]


def built(name: str) -> ehd.Machine:
    """Mechanism of a scene."""
    path = FOLDER / f"{name}.toml"
    scene = ehd.read_scene(path if path.exists() else name)
    return build(scene)


def run_of(machine: ehd.Machine) -> Run:
    """At the start."""
    span = machine.period or machine.end
    assert span is not None
    return Run(machine.mechanism, machine.steps, span)


def first_steps(machine: ehd.Machine) -> tuple[np.ndarray, np.ndarray]:
    """Times of the first steps that a run takes by itself, and which end at corners of tables."""
    run, span = run_of(machine), machine.period or machine.end
    found: list[tuple[float, bool]] = []
    for step in run.until(float(span or 0.0)):
        found.append((step.time, len(run.state.times) == 1))
        if len(found) == STEPS:
            break
    times, corners = zip(*found, strict=True)
    return np.array(times), np.array(corners)


def held(machine: ehd.Machine, times: np.ndarray, corners: np.ndarray) -> Curve:
    """Curve of a run through given steps, from its start."""
    run = run_of(machine)
    tracker = Recorder(run, float(times[-1]))
    samples = []
    for step in _follow(run, times, corners):
        tracker.add(step)
        samples.append(at_nodes(step))
    history = with_samples(tracker.history(), samples)
    columns, fields = history.columns, history.pressures
    rows = np.unique(np.linspace(0, len(times) - 1, min(ROWS, len(times))).astype(int))
    kept = {
        name: values[rows] for name, values in columns.items() if name.rpartition(".")[2] in COLUMNS
    }
    pressures = {f"joints/{name}/film/pressure": values[-1] for name, values in fields.items()}
    return Curve(kept, pressures)


def with_samples(history: ehd.History, samples: Sequence[Mapping[str, float]]) -> ehd.History:
    """History whose columns of the samples' paths have the samples' values."""
    return history.changed({path: np.array([row[path] for row in samples]) for path in samples[0]})


def at_nodes(step: MechanismStep) -> dict[str, float]:
    """Largest nodal pressure, and least gap at nodes and Gauss points, of every joint by path.

    A golden has these in place of the extremes between nodes: they do not depend on a rule.
    """
    values = {}
    for joint in step.solution.joints:
        path = f"joints/{joint.binding.name}"
        values[f"{path}/max_pressure"] = float(joint.pressure.max())
        values[f"{path}/min_film_thickness"] = float(joint.gap.min())
    return values


def _follow(run: Run, times: np.ndarray, corners: np.ndarray) -> Iterator[MechanismStep]:
    for time, corner in zip(times, corners, strict=True):
        order = run.state.usable_order(run.control.order)
        blend = run.control.blend
        asked = run.state.implicit_step(run.norm, float(time), order, blend, NEWTON)
        attempt = run.solve(run.norm, asked, run.state.solver)
        solved = attempt.solved
        assert solved is not None, attempt.cause
        moved = solved.x, solved.rate, asked.acceleration(solved.rate), solved.observed
        step = Step(float(time), *moved, solved.solution, attempt.iterations)
        keep = 1 if corner else run.control.order + 2
        run.state = run.state.after(step, run.state.step, solved.solver, keep)
        yield step


def own_run(machine: ehd.Machine, periodicity: float = 1e-3) -> dict[str, float]:
    """Extremes, temperatures, steps and iterations of a run in its own steps."""
    run = run_of(machine)
    cycles = None
    if machine.period is not None:
        cycles = PeriodicSolver(run, machine.period, periodicity)
    tracker = Recorder(run, float(machine.end or 0.0), cycles)
    samples: list[tuple[int, dict[str, float]]] = []
    for step, _ in tracker.steps():
        samples.append((0 if cycles is None else cycles.number, at_nodes(step)))
    last = [row for number, row in samples if number == samples[-1][0]]
    figures = RunSummary(tracker).entries()
    found = {key: figures[key] for key in ("steps", "newton_iterations")}
    for joint, values in replace(tracker.history(), entries=figures).figures.items():
        peaks = [row[f"joints/{joint}/max_pressure"] for row in last]
        films = [row[f"joints/{joint}/min_film_thickness"] for row in last]
        found[f"{joint}.max_pressure_Pa"] = max(peaks)
        found[f"{joint}.min_film_thickness_m"] = min(films)
        if "effective_temperature_C" in values:
            found[f"{joint}.effective_temperature_C"] = values["effective_temperature_C"]
    return found


def make(name: str) -> Golden:
    """Golden of a scene as the program gives it now."""
    machine = built(name)
    times, corners = first_steps(machine)
    return Golden(times, corners, held(machine, times, corners), own_run(machine))


def compared(name: str, *, own: bool = True) -> dict[str, Any]:
    """Deviations of today's program from a golden: held, and in its own steps if wanted."""
    golden, machine = Golden.load(name), built(name)
    curve = held(machine, golden.times, golden.corners)
    found: dict[str, Any] = {"held": golden.curve.deviation(curve), "own": {}}
    if own:
        now = own_run(machine)
        found["own"] = {key: now[key] / value - 1.0 for key, value in golden.own.items()}
    return found
