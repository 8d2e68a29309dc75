"""Derivatives of extremes and means of a scene's results with respect to its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import process_time

import numpy as np

from fenics_ehd.analysis.replay import Trajectory, recorded
from fenics_ehd.analysis.sensitivity import (
    Objective,
    Parameter,
    check_periods,
    columns_of,
    derivatives,
    objective_of,
    settled,
)
from fenics_ehd.base.errors import EhdError, SensitivityError, SettingsError
from fenics_ehd.base.needs import NO_TEMPERATURE
from fenics_ehd.base.settings import walk
from fenics_ehd.base.units import SCALES, unit_of
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.shaft import ShaftBody
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.build import build
from fenics_ehd.scenes.scene import Scene, changed
from fenics_ehd.study.cases import resolve_key, scene_values

#: Keys of an elastic body that affect neither its mesh nor its reduction.
MOVING = ("damping_time", "position", "angle", "velocity", "speed")

#: Components of a pair.
COMPONENTS = ("x", "y")


@dataclass(frozen=True)
class ParameterPath:
    """A parameter: one number of a scene, identified by its key.

    Attributes
    ----------
    key
        Full key; the key of a pair's component ends with ``.x`` or ``.y``.
    value
        Value in the scene.
    scale
        Reference for relative changes, in the unit of the value.
    setting
        Key of the setting, without a component.
    component
        Index of the component of a pair; None: the setting is one number.
    unit
        Unit of the value; empty for a ratio.
    """

    key: str
    value: float
    scale: float
    setting: str
    component: int | None = None
    unit: str = ""

    @property
    def relative(self) -> bool:
        """True if relative changes of the value have a meaning: not those of temperatures in C."""
        return self.unit not in SCALES

    def change(self, scene: Scene, share: float) -> Scene:
        """The scene with the number changed by `share` times its scale."""
        value = self.value + share * self.scale
        if self.component is None:
            return changed(scene, {self.setting: value})
        pair = list(scene_values(scene)[0][self.setting])
        pair[self.component] = value
        return changed(scene, {self.setting: pair})


@dataclass(frozen=True, eq=False)
class SceneSensitivity:
    """Derivatives of objectives of a scene.

    Attributes
    ----------
    objectives
        Extremes and means that are differentiated.
    values
        Values of the objectives in the run.
    parameters
        Numbers of the scene with respect to which the objectives are differentiated.
    derivatives
        Derivatives by objective and key, on the scene's film meshes.
    finer
        Derivatives on finer film meshes; values that do not exist are missing.
    reduced
        Keys for which a body was reduced again.
    seconds
        Processor time of the run and of the derivatives [s].
    trajectory
        Trajectory of the scene's run, or of its last cycle.
    """

    objectives: Sequence[Objective]
    values: Mapping[Objective, float]
    parameters: Sequence[ParameterPath]
    derivatives: Mapping[tuple[Objective, str], float]
    finer: Mapping[tuple[Objective, str], float]
    reduced: Sequence[str]
    seconds: Mapping[str, float]
    trajectory: Trajectory

    def elasticity(self, objective: Objective, parameter: ParameterPath) -> float | None:
        """``d ln q / d ln p``; None if a value is 0, or the parameter is a temperature."""
        value = self.values[objective]
        if not value or not parameter.value or not parameter.relative:
            return None
        return self.derivatives[objective, parameter.key] * parameter.value / value


def parameter_path(scene: Scene, name: str) -> ParameterPath:
    """Parameter of a scene, by its key or by the end of its key.

    Raises
    ------
    SettingsError
        No key, or several, end with the name.
    SensitivityError
        No derivative exists: the value is a word, a whole number, a switch, a run setting, or 0.
    """
    stem, _, last = name.rpartition(".")
    try:
        key = resolve_key(scene, name)
        component = None
    except SettingsError:
        if last not in COMPONENTS:
            raise
        key = resolve_key(scene, stem)
        component = COMPONENTS.index(last)
    value = scene_values(scene)[0][key]
    if key.partition(".")[0] in ("time", "output"):
        raise SensitivityError(
            f"{key} is a setting of the run, not of the machine: ask along numbers of bodies, "
            "joints, drives, forces or lubricants"
        )
    pair = isinstance(value, tuple | list) and len(value) == len(COMPONENTS)
    numbers = list(value) if pair else [value]
    small = all(isinstance(number, float) for number in numbers)
    if pair and small and component is None:
        raise SensitivityError(f"{key} = {numbers} is a pair: ask along {key}.x or {key}.y")
    if not small or pair != (component is not None):
        raise SensitivityError(
            f"{key} = {value!r} is not a continuous parameter: no derivative exists along it"
        )
    scale = float(np.linalg.norm(numbers))
    unit = _unit(scene, key)
    if not scale or (unit in SCALES and value == NO_TEMPERATURE):
        raise SensitivityError(
            f"{key} = {value!r} means that the setting is off or not given, and has no size that a "
            "small change could be a share of: give it another value"
        )
    full = key if component is None else f"{key}.{last}"
    return ParameterPath(full, numbers[component or 0], scale, key, component, unit)


def _unit(scene: Scene, key: str) -> str:
    """Unit of a setting, or of all values in its table; empty for a ratio."""
    helps = {name: field.metadata.get("help", "") for name, field, _ in walk(scene)}
    return unit_of(helps.get(key) or helps.get(key.rpartition(".")[0], ""))


def reduced_anew(scene: Scene, parameter: ParameterPath) -> str:
    """Name of the elastic body whose reduction depends on a parameter; empty: none."""
    table, _, rest = parameter.setting.partition(".")
    name, _, setting = rest.partition(".")
    if table != "bodies" or setting in MOVING:
        return ""
    elastic = isinstance(scene.bodies[name], (schema.FlexibleSettings, ShaftBody))
    return name if elastic else ""


def scene_sensitivity(
    scene: Scene,
    of: Sequence[str],
    to: Sequence[str],
    *,
    bodies: Mapping[str, ReducedBody] | None = None,
    finer: bool = False,
) -> SceneSensitivity:
    """Run a scene, and compute derivatives of its objectives; on one rank only.

    Parameters
    ----------
    scene
        Scene as read.
    of
        Names of objectives, ``big_end.min_film_thickness``.
    to
        Keys of the parameters.
    bodies
        Reduced bodies of the scene that exist already.
    finer
        Whether derivatives are also computed on finer film meshes.

    Raises
    ------
    SettingsError, SensitivityError
        A key is invalid, before any reduction; or an objective, after the first step.
    SolverError
        A run or a derivative fails.
    """
    paths = [parameter_path(scene, name) for name in dict.fromkeys(to)]
    clock = process_time()
    built = build(scene, bodies=bodies)
    run = Run(built.mechanism, built.steps, scene.span)
    columns = columns_of(next(run.until(scene.span)))
    objectives = [objective_of(name, columns) for name in dict.fromkeys(of)]
    parameters = [mechanism_parameter(scene, path, built.bodies) for path in paths]
    time = scene.time
    period = scene.span if time.periodic else None
    check_periods(built.mechanism, period, [each for each in parameters if each.same_coordinates])
    run = Run(built.mechanism, built.steps, scene.span)
    cycles = (
        PeriodicSolver(run, scene.span, time.periodicity, time.cycles) if time.periodic else None
    )
    trajectory = settled(recorded(run, scene.span, cycles, columns_of))
    seconds = {"run": process_time() - clock}
    clock = process_time()
    slopes: dict[tuple[Objective, str], float] = {}
    fine: dict[tuple[Objective, str], float] = {}
    for parameter in parameters:
        name = parameter.name
        computed = derivatives(trajectory, parameter, objectives)
        slopes |= {(objective, name): slope for objective, slope in computed.items()}
        if finer:
            with suppress(EhdError):  # no finer film exists, or its run has no cycle
                computed = derivatives(trajectory, parameter, objectives, finer=True)
                fine |= {(objective, name): slope for objective, slope in computed.items()}
    seconds["derivatives"] = process_time() - clock
    values = {objective: objective.value(trajectory) for objective in objectives}
    reduced = [each.name for each in parameters if not each.same_coordinates]
    return SceneSensitivity(objectives, values, paths, slopes, fine, reduced, seconds, trajectory)


def mechanism_parameter(
    scene: Scene, path: ParameterPath, parts: Mapping[str, ReducedBody]
) -> Parameter:
    """Parameter of the scene's mechanism; bodies that do not depend on it are reused."""
    touched = reduced_anew(scene, path)
    kept = {name: body for name, body in parts.items() if name != touched}

    def make(share: float) -> tuple[Mechanism, float]:
        other = path.change(scene, share)
        return build(other, bodies=kept).mechanism, other.span / scene.span

    return Parameter(path.key, path.scale, make, not touched)
