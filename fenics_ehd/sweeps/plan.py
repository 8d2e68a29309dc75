"""What a sweep consists of: its cases, checked before the first of them runs."""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import attrs

from fenics_ehd import __version__
from fenics_ehd.errors import InputError, SettingsError
from fenics_ehd.reduction.body_file import FORMAT_VERSION
from fenics_ehd.sweeps.keys import resolve_key, value_like, with_values
from fenics_ehd.sweeps.scenes import SCENES, read_settings
from fenics_ehd.sweeps.values import MOST_CASES, as_text, parse_values


@dataclass(frozen=True)
class Case:
    """One run: its number from 1, its values, its settings, the name of its reduced body."""

    number: int
    values: tuple[Any, ...]
    settings: Any
    body: str | None


@dataclass(frozen=True)
class Plan:
    """A sweep: kind of scene, swept keys, cases in the order of the product.

    `identity` is everything the rows depend on, as text by name; two sweeps are the same
    when it is.
    """

    scene: str
    keys: tuple[str, ...]
    cases: tuple[Case, ...]
    identity: Mapping[str, str]


def make_plan(scene: str, assignments: Sequence[str]) -> Plan:
    """Plan of a scene and of assignments ``key=values``; the last key changes fastest.

    Raises
    ------
    SettingsError
        A key or value that cannot be used: all of them are named.
    """
    base = read_settings(scene)
    axes = _axes(type(base), assignments)
    size = math.prod(len(values) for values in axes.values())
    if size > MOST_CASES:
        raise SettingsError(f"the sweep has {size} cases, at most {MOST_CASES}: give fewer values")
    cases = tuple(_cases(base, axes))
    return Plan(base.scene, tuple(axes), cases, settings_identity(base, axes))


def _axes(cls: type, assignments: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """Values by resolved key."""
    axes: dict[str, tuple[Any, ...]] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise SettingsError(f"--set {assignment!r} must be key=values, clearance=1e-5,2e-5 say")
        key = resolve_key(cls, name.strip())
        if key in axes:
            raise SettingsError(f"--set {assignment}: {key} is given twice")
        axes[key] = parse_values(key, text, value_like(cls, key))
    return axes


def _cases(base: Any, axes: Mapping[str, tuple[Any, ...]]) -> list[Case]:
    cases, complaints = [], []
    combinations = list(itertools.product(*axes.values()))
    for number, values in enumerate(combinations, 1):
        try:
            settings = with_values(base, dict(zip(axes, values, strict=True)))
            cases.append(Case(number, values, settings, body_name(settings)))
        except InputError as error:
            complaints.append(str(error))
    if complaints:
        # A section stops at its first bad value: each value on its own names the others as well.
        every = dict.fromkeys(complaints + _alone(base, axes))
        raise SettingsError(
            f"{len(complaints)} of {len(combinations)} cases cannot run: {'; '.join(every)}"
        )
    return cases


def _alone(base: Any, axes: Mapping[str, tuple[Any, ...]]) -> list[str]:
    """What the settings say against single values."""
    complaints = []
    for key, values in axes.items():
        for value in values:
            try:
                with_values(base, {key: value})
            except SettingsError as error:
                complaints.append(str(error))
    return complaints


def body_name(settings: Any) -> str | None:
    """Name of the reduced body that a case needs, the same for equal bodies; None: no body.

    Raises
    ------
    SettingsError
        The part's model does not exist.
    """
    part = SCENES[settings.scene].part
    if part is None:
        return None
    reduction = settings.reduction
    origin = part.origin(settings) | {
        "scene": settings.scene,
        "version": f"{__version__} {FORMAT_VERSION}",
        "solver": reduction.solver,
        "estimate_error": str(reduction.estimate_error),
        # The pressures of a former run, not where they are kept.
        "snapshots": _described(reduction.snapshots),
    }
    return hashlib.sha256(json.dumps(origin, sort_keys=True).encode()).hexdigest()[:16]


def settings_identity(base: Any, axes: Mapping[str, tuple[Any, ...]]) -> dict[str, str]:
    """What results depend on: settings as text by key, the swept ones with all their values."""
    identity = {"scene": base.scene, "version": __version__}
    for section, table in attrs.asdict(base, filter=lambda a, _: a.name != "scene").items():
        identity |= {f"{section}.{name}": _described(value) for name, value in table.items()}
    swept = {key: ", ".join(map(_described, values)) for key, values in axes.items()}
    return identity | swept


def _described(value: object) -> str:
    """A value as text; of a file, or the history of a run's folder, name and checksum."""
    if isinstance(value, str):
        path = Path(value, "history.h5") if Path(value).is_dir() else Path(value)
        if path.is_file():
            state = path.stat()
            return f"{Path(value).name} {_checksum(path, state.st_mtime_ns, state.st_size)}"
    return as_text(value)


@functools.cache
def _checksum(path: Path, _changed: int, _size: int) -> str:
    """Beginning of a file's checksum: many cases name the same file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:12]
