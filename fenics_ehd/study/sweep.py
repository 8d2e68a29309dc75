"""Parameter sweeps: one scene over the product of given values, one row for each run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.scenes.scene import Scene, lubricated_joints
from fenics_ehd.scenes.scene_text import as_stored
from fenics_ehd.study.case import Case, described, identity, make_case
from fenics_ehd.study.keys import resolve_key, scene_values, with_values
from fenics_ehd.study.values import MOST_CASES, parse_values


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep: its scene, swept keys, lubricated joints, cases in the order of the product.

    `identity` is everything the rows depend on, as text by name; two sweeps are the same
    when it is.
    """

    scene: str
    keys: tuple[str, ...]
    joints: tuple[str, ...]
    cases: tuple[Case, ...]
    identity: Mapping[str, str]


def make_sweep(source: str, assignments: Sequence[str]) -> Sweep:
    """Sweep of a scene and of assignments ``key=values``; the last key changes fastest.

    Raises
    ------
    SettingsError
        A key or value that cannot be used: all of them are named.
    """
    scene = as_stored(source)
    axes = _axes(scene, assignments)
    size = math.prod(len(values) for values in axes.values())
    if size > MOST_CASES:
        raise SettingsError(f"the sweep has {size} cases, at most {MOST_CASES}: give fewer values")
    swept = {key: ", ".join(map(described, values)) for key, values in axes.items()}
    return Sweep(
        scene.name,
        tuple(axes),
        lubricated_joints(scene),
        tuple(_cases(scene, axes)),
        identity(scene) | swept,
    )


def _axes(scene: Scene, assignments: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """Values by full key."""
    axes: dict[str, tuple[Any, ...]] = {}
    like, _ = scene_values(scene)
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise SettingsError(f"--set {assignment!r} must be key=values, clearance=1e-5,2e-5 say")
        key = resolve_key(scene, name.strip())
        if key in axes:
            raise SettingsError(f"--set {assignment}: {key} is given twice")
        axes[key] = parse_values(key, text, like.get(key, 0.0))
    return axes


def _cases(scene: Scene, axes: Mapping[str, tuple[Any, ...]]) -> list[Case]:
    cases, complaints = [], []
    combinations = list(itertools.product(*axes.values()))
    for number, values in enumerate(combinations, 1):
        try:
            cases.append(make_case(str(number), scene, dict(zip(axes, values, strict=True))))
        except InputError as error:
            complaints.append(str(error))
    if complaints:
        # A section stops at its first bad value: each value on its own names the others as well.
        every = dict.fromkeys(complaints + _alone(scene, axes))
        raise SettingsError(
            f"{len(complaints)} of {len(combinations)} cases cannot run: {'; '.join(every)}"
        )
    return cases


def _alone(scene: Scene, axes: Mapping[str, tuple[Any, ...]]) -> list[str]:
    """What the scene says against single values."""
    complaints = []
    for key, values in axes.items():
        for value in values:
            try:
                with_values(scene, {key: value})
            except SettingsError as error:
                complaints.append(str(error))
    return complaints
