"""Derivatives of extremes and means of a scene's results with respect to its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
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
from fenics_ehd.scenes.build import Machine, build
from fenics_ehd.scenes.part import Announce
from fenics_ehd.scenes.scene import Scene, changed
from fenics_ehd.study.cases import resolve_key, scene_values

#: Keys of an elastic body on which neither its mesh nor its reduction depends.
MOVING = ("damping_time", "position", "angle", "velocity", "speed")

#: Names of the components of a pair in a parameter's key.
COMPONENTS = ("x", "y")


@dataclass(frozen=True)
class ParameterPath:
    """A parameter: one number of a scene with respect to which results are differentiated.

    Attributes
    ----------
    key
        Full key of the number; for a component of a pair it ends with ``.x`` or ``.y``.
    value
        Value in the scene.
    scale
        Size to which changes are relative, in the unit of the value; for a component of a pair,
        the length of the pair as a vector.
    setting
        Full key of the setting, without a component.
    component
        Index of the component in a pair; None if the setting is one number.
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
        """False for a temperature in C, whose relative change has no meaning; else True."""
        return self.unit not in SCALES

    def change(self, scene: Scene, share: float) -> Scene:
        """Copy of a scene in which the number is larger by `share` times its scale."""
        value = self.value + share * self.scale
        if self.component is None:
            return changed(scene, {self.setting: value})
        pair = list(scene_values(scene)[0][self.setting])
        pair[self.component] = value
        return changed(scene, {self.setting: pair})


@dataclass(frozen=True, eq=False)
class SceneSensitivity:
    """Derivatives of the results of a scene with respect to some of its settings.

    Attributes
    ----------
    objectives
        Results that are differentiated: extremes and means of joints.
    values
        Values of the objectives in the run.
    parameters
        Numbers of the scene with respect to which the objectives are differentiated.
    derivatives
        Derivatives on the film meshes of the scene, by objective and key of the parameter.
    finer
        Derivatives on finer film meshes, by the same keys; a derivative that could not be computed
        is missing.
    reduced
        Keys of the parameters for which a body was reduced again.
    seconds
        Processor times [s] of the ``"run"`` and of the ``"derivatives"``.
    trajectory
        Trajectory of the scene's run, or of the last cycle of a periodic run.
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
        """Elasticity ``d ln q / d ln p``; None if q or p is 0, or if p is a temperature."""
        value = self.values[objective]
        if not value or not parameter.value or not parameter.relative:
            return None
        return self.derivatives[objective, parameter.key] * parameter.value / value


def parameter_path(scene: Scene, name: str) -> ParameterPath:
    """Parameter of a scene, from its key or the end of its key.

    Raises
    ------
    SettingsError
        No key or several keys end with the name.
    SensitivityError
        The value has no derivative: it is a word, whole number, switch, run setting, or not set.
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
            f"{key} is a setting of the run, for which no derivative exists: give a numeric "
            "setting of a body, joint, drive, force or lubricant instead"
        )
    pair = isinstance(value, tuple | list) and len(value) == len(COMPONENTS)
    numbers = list(value) if pair else [value]
    small = all(isinstance(number, float) for number in numbers)
    if pair and small and component is None:
        raise SensitivityError(f"{key} = {numbers} is a pair: give {key}.x or {key}.y")
    if not small or pair != (component is not None):
        raise SensitivityError(
            f"{key} = {value!r} is not a continuous parameter: no derivative exists"
        )
    scale = float(np.linalg.norm(numbers))
    unit = _unit(scene, key)
    if not scale or (unit in SCALES and value == NO_TEMPERATURE):
        raise SensitivityError(
            f"{key} = {value!r} means that the setting is not used: give it a value first, "
            "because derivatives vary a parameter by a small share of its value"
        )
    full = key if component is None else f"{key}.{last}"
    return ParameterPath(full, numbers[component or 0], scale, key, component, unit)


def _unit(scene: Scene, key: str) -> str:
    """Unit of a setting from its help text or from that of its table; empty for a ratio."""
    helps = {name: field.metadata.get("help", "") for name, field, _ in walk(scene)}
    return unit_of(helps.get(key) or helps.get(key.rpartition(".")[0], ""))


def reduced_anew(scene: Scene, parameter: ParameterPath) -> str:
    """Name of the elastic body that must be reduced again if a parameter changes; empty if none."""
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
    announce: Announce | None = None,
    cache: bool = True,
) -> SceneSensitivity:
    """Run a scene on one MPI rank, and compute derivatives of its results.

    Parameters
    ----------
    scene
        Scene as read.
    of
        Names of the results, for example ``big_end.min_film_thickness``.
    to
        Keys of the parameters.
    bodies
        Reduced bodies of the scene that exist already, by name.
    finer
        Whether derivatives are also computed on finer film meshes.
    announce, cache
        See `build`.

    Raises
    ------
    SettingsError, SensitivityError
        A key or the name of a result cannot be used. Keys are checked before any reduction, names
        of results after the first step.
    SolverError
        A run fails.
    """
    paths = [parameter_path(scene, name) for name in dict.fromkeys(to)]
    clock = process_time()
    make = partial(build, announce=announce, cache=cache)
    built = make(scene, bodies=bodies)
    run = Run(built.mechanism, built.steps, scene.span)
    columns = columns_of(next(run.until(scene.span)))
    objectives = [objective_of(name, columns) for name in dict.fromkeys(of)]
    parameters = [mechanism_parameter(scene, path, built.bodies, make) for path in paths]
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
            with suppress(EhdError):  # there is no finer film mesh, or its run has no cycle
                computed = derivatives(trajectory, parameter, objectives, finer=True)
                fine |= {(objective, name): slope for objective, slope in computed.items()}
    seconds["derivatives"] = process_time() - clock
    values = {objective: objective.value(trajectory) for objective in objectives}
    reduced = [each.name for each in parameters if not each.same_coordinates]
    return SceneSensitivity(objectives, values, paths, slopes, fine, reduced, seconds, trajectory)


def mechanism_parameter(
    scene: Scene,
    path: ParameterPath,
    parts: Mapping[str, ReducedBody],
    build: Callable[..., Machine] = build,
) -> Parameter:
    """Parameter of a scene's mechanism for `derivatives`, from a number in the scene.

    Parameters
    ----------
    scene, path
        The scene, and the number in it.
    parts
        Reduced bodies of the scene by name; a body that does not depend on the number is reused.
    build
        Function that builds the mechanism of a changed scene.
    """
    touched = reduced_anew(scene, path)
    kept = {name: body for name, body in parts.items() if name != touched}

    def make(share: float) -> tuple[Mechanism, float]:
        other = path.change(scene, share)
        return build(other, bodies=kept).mechanism, other.span / scene.span

    return Parameter(path.key, path.scale, make, not touched)
