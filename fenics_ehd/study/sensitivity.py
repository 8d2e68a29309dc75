"""Derivatives of what a scene answers along its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import process_time

import numpy as np

from fenics_ehd.analysis.replay import Course, recorded
from fenics_ehd.analysis.sensitivity import (
    Figure,
    Number,
    check_periods,
    derivatives,
    figure_of,
    look,
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

#: Keys of an elastic body that no mesh and no reduction reads.
MOVING = ("damping_time", "position", "angle", "velocity", "speed")

#: Components of a pair.
COMPONENTS = ("x", "y")


@dataclass(frozen=True)
class Along:
    """A number of a scene.

    Attributes
    ----------
    key
        Full key, of a component of a pair with ``.x`` or ``.y`` behind.
    value, scale
        And what changes of it are shares of.
    setting, component
        The setting's own key, and which of its numbers it is, None for the only one.
    unit
        Empty of a ratio.
    """

    key: str
    value: float
    scale: float
    setting: str
    component: int | None = None
    unit: str = ""

    @property
    def relative(self) -> bool:
        """True where a share of it means something: zero is not a matter of a scale, as 0 C is."""
        return self.unit not in SCALES

    def change(self, scene: Scene, share: float) -> Scene:
        """The scene with the number changed by a share of its scale."""
        value = self.value + share * self.scale
        if self.component is None:
            return changed(scene, {self.setting: value})
        pair = list(scene_values(scene)[0][self.setting])
        pair[self.component] = value
        return changed(scene, {self.setting: pair})


@dataclass(frozen=True, eq=False)
class SceneSensitivity:
    """Derivatives of a scene's figures.

    Attributes
    ----------
    figures, values
        What was asked for, and its value.
    numbers
        Along which.
    derivatives, finer
        By figure and key, on the films as they are and on finer ones; where there are none, the
        latter has nothing.
    reduced
        Keys along which a body was reduced anew.
    seconds
        Processor time of the run and of the derivatives [s].
    course
        Of the scene's run, or its last cycle.
    """

    figures: Sequence[Figure]
    values: Mapping[Figure, float]
    numbers: Sequence[Along]
    derivatives: Mapping[tuple[Figure, str], float]
    finer: Mapping[tuple[Figure, str], float]
    reduced: Sequence[str]
    seconds: Mapping[str, float]
    course: Course

    def elasticity(self, figure: Figure, number: Along) -> float | None:
        """``d ln q / d ln p``; None where one of them is 0, or the number a temperature."""
        value = self.values[figure]
        if not value or not number.value or not number.relative:
            return None
        return self.derivatives[figure, number.key] * number.value / value


def number_of(scene: Scene, name: str) -> Along:
    """The number of a key, which may be given by its end.

    Raises
    ------
    SettingsError
        There is no such key, or more than one.
    SensitivityError
        It has no derivative: a word, a whole number, a switch, a setting of the run, or 0.
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
            f"{key} says how the scene is run, not what it is of: ask along numbers of bodies, "
            "joints, drives, forces or lubricants"
        )
    pair = isinstance(value, tuple | list) and len(value) == len(COMPONENTS)
    numbers = list(value) if pair else [value]
    small = all(isinstance(number, float) for number in numbers)
    if pair and small and component is None:
        raise SensitivityError(f"{key} = {numbers} is a pair: ask along {key}.x or {key}.y")
    if not small or pair != (component is not None):
        raise SensitivityError(
            f"{key} = {value!r} is no number that changes a little: there is no derivative along it"
        )
    scale = float(np.linalg.norm(numbers))
    unit = _unit(scene, key)
    if not scale or (unit in SCALES and value == NO_TEMPERATURE):
        raise SensitivityError(
            f"{key} = {value!r} stands for what is off or not given, and says no size of a "
            "small change: give it another value"
        )
    full = key if component is None else f"{key}.{last}"
    return Along(full, numbers[component or 0], scale, key, component, unit)


def _unit(scene: Scene, key: str) -> str:
    """Unit of a setting, or of all in its table; empty of a ratio."""
    told = {name: field.metadata.get("help", "") for name, field, _ in walk(scene)}
    return unit_of(told.get(key) or told.get(key.rpartition(".")[0], ""))


def reduced_anew(scene: Scene, number: Along) -> str:
    """The elastic body that a number changes the reduction of; none: empty."""
    table, _, rest = number.setting.partition(".")
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
    """Run a scene, and find derivatives of its figures; serial.

    Parameters
    ----------
    scene
        As read.
    of
        Figures: ``big_end.min_film_thickness``.
    to
        Keys.
    bodies
        Reduced bodies of the scene that are there already.
    finer
        Whether they are found on finer films, too.

    Raises
    ------
    SettingsError, SensitivityError
        Of keys, before anything is reduced; of figures, after the first step.
    SolverError
        From runs and derivatives.
    """
    asked = [number_of(scene, name) for name in dict.fromkeys(to)]
    clock = process_time()
    built = build(scene, bodies=bodies)
    run = Run(built.mechanism, built.steps, scene.span)
    time = scene.time
    columns = look(next(run.until(scene.span)))
    figures = [figure_of(name, columns) for name in dict.fromkeys(of)]
    numbers = [mechanism_number(scene, along, built.bodies) for along in asked]
    period = scene.span if scene.time.periodic else None
    check_periods(built.mechanism, period, [number for number in numbers if number.alike])
    run = Run(built.mechanism, built.steps, scene.span)
    cycles = (
        PeriodicSolver(run, scene.span, time.periodicity, time.cycles) if time.periodic else None
    )
    course = settled(recorded(run, scene.span, cycles, look))
    seconds = {"run": process_time() - clock}
    clock = process_time()
    slopes: dict[tuple[Figure, str], float] = {}
    fine: dict[tuple[Figure, str], float] = {}
    for number in numbers:
        own = derivatives(course, number, figures)
        slopes |= {(figure, number.name): slope for figure, slope in own.items()}
        if finer:
            with suppress(EhdError):  # there is no finer film, or no cycle on it
                own = derivatives(course, number, figures, finer=True)
                fine |= {(figure, number.name): slope for figure, slope in own.items()}
    seconds["derivatives"] = process_time() - clock
    values = {figure: figure.value(course) for figure in figures}
    reduced = [number.name for number in numbers if not number.alike]
    return SceneSensitivity(figures, values, asked, slopes, fine, reduced, seconds, course)


def mechanism_number(scene: Scene, along: Along, parts: Mapping[str, ReducedBody]) -> Number:
    """Maker of the scene's mechanism with a number changed, of bodies that it leaves alone."""
    touched = reduced_anew(scene, along)
    kept = {name: body for name, body in parts.items() if name != touched}

    def make(share: float) -> tuple[Mechanism, float]:
        there = along.change(scene, share)
        return build(there, bodies=kept).mechanism, there.span / scene.span

    return Number(along.key, along.scale, make, not touched)
