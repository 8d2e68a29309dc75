"""Derivatives of what a scene answers along its numbers, by the way that each of them has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from time import process_time

import attrs
import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import SensitivityError, SettingsError
from fenics_ehd.base.fields import unit_of
from fenics_ehd.base.oil import NO_TEMPERATURE
from fenics_ehd.base.units import SCALES
from fenics_ehd.multibody.cycle_derivative import curves_of
from fenics_ehd.multibody.cycle_record import CycleRecord
from fenics_ehd.multibody.held_run import recorded_again
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.sensitivity import (
    AMOUNT,
    Derivatives,
    Figure,
    Number,
    check_periods,
    figure_of,
)
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.given import changed
from fenics_ehd.scenes.scene import Scene
from fenics_ehd.study.keys import resolve_key, scene_values

#: How a derivative was found.
THROUGH, DIFFERENCES = "through the steps", "differences in the same steps"

#: Change of a number in differences, over its scale.
STEP = 0.01

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
        """Whether a share of it means something: zero is not a matter of a scale, as 0 C is."""
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
    derivatives, methods
        By figure and key, and by key how they were found.
    reach
        By key, of derivatives through the steps: share of the number that changes a film somewhere
        by a tenth.
    sweeps, seconds
        Times that the steps were gone through; processor time of the run, of derivatives through
        the steps, of differences [s].
    record
        Of the scene's run.
    """

    figures: Sequence[Figure]
    values: Mapping[Figure, float]
    numbers: Sequence[Along]
    derivatives: Mapping[tuple[Figure, str], float]
    methods: Mapping[str, str]
    reach: Mapping[str, float]
    sweeps: int
    seconds: Mapping[str, float]
    record: CycleRecord

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
    component = COMPONENTS.index(last) if last in COMPONENTS else None
    try:
        key = resolve_key(scene, name)
        component = None
    except SettingsError:
        if component is None:
            raise
        key = resolve_key(scene, stem)
    value = scene_values(scene)[0][key]
    if key.partition(".")[0] in ("time", "output"):
        raise SensitivityError(
            f"{key} says how the scene is run, not what it is of: ask along numbers of bodies, "
            "joints, drives, forces or lubricants"
        )
    pair = isinstance(value, (tuple, list)) and len(value) == len(COMPONENTS)
    if pair and all(isinstance(own, float) for own in value):
        if component is None:
            raise SensitivityError(f"{key} = {list(value)} is a pair: ask along {key}.x or {key}.y")
        scale = float(np.hypot(*value))
        own = f"{key}.{COMPONENTS[component]}", float(value[component])
    elif isinstance(value, float) and component is None:
        scale, own = abs(value), (key, value)
    else:
        raise SensitivityError(
            f"{key} = {value!r} is no number that changes a little: there is no derivative along it"
        )
    unit = _unit(scene, key)
    if not scale or (unit in SCALES and value == NO_TEMPERATURE):
        raise SensitivityError(
            f"{key} = {value!r} stands for what is off or not given, and says no size of a "
            "small change: give it another value"
        )
    return Along(own[0], own[1], scale, key, component, unit)


def _unit(scene: Scene, key: str) -> str:
    """Of a setting; empty of a ratio."""
    table, name, *rest = key.split(".")
    owner, told = getattr(scene, table)[name], ""
    for part in rest:
        if isinstance(owner, Mapping):
            owner = owner[part]
        else:
            told = attrs.fields_dict(type(owner))[part].metadata.get("help", "")
            owner = getattr(owner, part)
    return unit_of(told)


def goes_through(scene: Scene, number: Along) -> bool:
    """Whether a number leaves every reduced body as it is."""
    table, _, rest = number.setting.partition(".")
    if table != "bodies":
        return True
    name, _, setting = rest.partition(".")
    elastic = isinstance(scene.bodies[name], (schema.FlexibleSettings, schema.ShaftSettings))
    return not elastic or setting in MOVING


def scene_sensitivity(
    scene: Scene,
    of: Sequence[str],
    to: Sequence[str],
    *,
    bodies: Mapping[str, ReducedBody] | None = None,
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

    Raises
    ------
    SettingsError, SensitivityError
        Of keys, before anything is reduced; of figures, after the first step.
    SolverError
        From runs and derivatives.
    """
    numbers = [number_of(scene, name) for name in dict.fromkeys(to)]
    seconds: dict[str, float] = {}
    clock = process_time()
    first, bodies = _run(scene, bodies, steps=1)
    curves = curves_of(first)
    figures = [figure_of(name, curves) for name in dict.fromkeys(of)]
    ways = []
    for number in numbers:
        if goes_through(scene, number):
            there = number.change(scene, AMOUNT)
            built = build_mechanism(there, MPI.COMM_SELF, bodies=bodies)
            span = there.span / scene.span
            ways.append(Number(number.key, number.value, number.scale, built.mechanism, span))
    check_periods(first.run.equations.system.mechanism, first.period, ways)
    record, _ = _run(scene, bodies)
    if record.period is not None:
        # In its own steps, until what is left of the way there is nothing beside a derivative.
        record = recorded_again(record, _begin(scene, bodies)[0], 1.0, alike=True)
    seconds["run"] = process_time() - clock
    clock = process_time()
    derivatives = Derivatives(record, ways)
    found = derivatives.of(figures)
    seconds["through the steps"] = process_time() - clock
    through = {way.name for way in ways} - {*derivatives.refused}
    slopes: dict[tuple[Figure, str], float] = {}
    clock = process_time()
    for number in numbers:
        if number.key in through:
            own = {figure: found.derivatives[figure][number.key] for figure in figures}
        else:
            own = differences(scene, number, figures, record=record)
        slopes |= {(figure, number.key): slope for figure, slope in own.items()}
    seconds["differences"] = process_time() - clock
    methods = {n.key: THROUGH if n.key in through else DIFFERENCES for n in numbers}
    return SceneSensitivity(
        figures,
        found.values,
        numbers,
        slopes,
        methods,
        derivatives.reach,
        derivatives.sweeps,
        seconds,
        record,
    )


def differences(
    scene: Scene,
    number: Along,
    figures: Sequence[Figure],
    share: float = STEP,
    bodies: Mapping[str, ReducedBody] | None = None,
    record: CycleRecord | None = None,
) -> dict[Figure, float]:
    """Derivatives of figures by two whole runs, the number on either side.

    Parameters
    ----------
    scene, number, figures
        Of which, along which, what.
    share
        Change over the number's scale.
    bodies
        Reduced bodies that the number leaves as they are; None: all are reduced anew.
    record
        Of the scene's run, whose steps both take; None: each chooses its own, and figures have the
        noise of that, some of the tolerance.
    """
    ends = []
    for sign in (1, -1):
        there = number.change(scene, sign * share)
        if record is None:
            found = _run(there, bodies)[0]
        else:
            run, _ = _begin(there, bodies)
            span = there.span / scene.span
            found = recorded_again(record, run, span, alike=bodies is not None)
        curves = curves_of(found)
        ends.append([figure.value(found, curves) for figure in figures])
    return {
        figure: (above - below) / (2 * share * number.scale)
        for figure, above, below in zip(figures, *ends, strict=True)
    }


def _begin(
    scene: Scene, bodies: Mapping[str, ReducedBody] | None
) -> tuple[Run, Mapping[str, ReducedBody]]:
    """A scene's run at its start, and its reduced bodies."""
    built = build_mechanism(scene, MPI.COMM_SELF, bodies=bodies)
    return Run(built.mechanism, built.steps, scene.span), built.parts


def _run(
    scene: Scene, bodies: Mapping[str, ReducedBody] | None, steps: int | None = None
) -> tuple[CycleRecord, Mapping[str, ReducedBody]]:
    """The record of a scene's run, or of its first steps, and its reduced bodies."""
    (run, parts), time = _begin(scene, bodies), scene.time
    cycles = Cycles(run, scene.span, time.periodicity, time.cycles) if time.periodic else None
    record = CycleRecord(run, cycles)
    for _ in islice(record.follow(run.until(scene.span) if cycles is None else cycles), steps):
        pass
    return record, parts
