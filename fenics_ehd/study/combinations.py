"""Combinations of the values of a sweep: from the command line, from a CSV file, or from Python.

An axis of a sweep has one key, or several keys whose values are used together, row by row. Cases
are all combinations of the rows of all axes; the rows of the last axis change fastest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.needs import no_effect
from fenics_ehd.base.printed import shown
from fenics_ehd.scenes.scene import Scene
from fenics_ehd.study.case_file import read_case_file
from fenics_ehd.study.cases import (
    MOST_CASES,
    described,
    parse_values,
    require_different,
    resolve_key,
    scene_values,
)


@dataclass(frozen=True)
class Axis:
    """Keys of a sweep whose values are used together.

    Attributes
    ----------
    keys
        Full keys of the settings.
    rows
        Values of the keys, row by row.
    origins
        Line of each row in a file, for messages: ``--cases cases.csv: line 7``; empty for lists.
    """

    keys: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    origins: tuple[str, ...] = ()

    def described(self) -> dict[str, str]:
        """Texts of the values by key; for a file, its name and checksum."""
        columns = zip(*self.rows, strict=True)
        return {
            key: ", ".join(map(described, values))
            for key, values in zip(self.keys, columns, strict=True)
        }

    @property
    def name(self) -> str:
        """Keys with commas between them, in parentheses if there are several."""
        return self.keys[0] if len(self.keys) == 1 else f"({', '.join(self.keys)})"


def combinations(axes: Sequence[Axis]) -> list[dict[str, Any]]:
    """Values by key for all combinations of the rows of axes.

    Raises
    ------
    SettingsError
        There are more than `MOST_CASES` combinations.
    """
    size = math.prod(len(axis.rows) for axis in axes)
    if size > MOST_CASES:
        raise SettingsError(
            f"the sweep has {size} cases, above the limit of {MOST_CASES}: give fewer values"
        )
    keys = [key for axis in axes for key in axis.keys]
    products = itertools.product(*(axis.rows for axis in axes))
    return [dict(zip(keys, itertools.chain(*rows), strict=True)) for rows in products]


def origins_of(axes: Sequence[Axis]) -> list[str]:
    """Lines of all combinations in a file, in the order of `combinations`; empty for lists."""
    texts = (axis.origins or ("",) * len(axis.rows) for axis in axes)
    return ["".join(each) for each in itertools.product(*texts)]


def axes_of_options(
    scene: Scene, assignments: Sequence[str], *, zipped: bool = False, table: str | None = None
) -> list[Axis]:
    """Axes of a sweep from the options of the command line.

    Parameters
    ----------
    scene
        Scene as stored.
    assignments
        Texts ``key=values`` of the options ``--set``.
    zipped
        Whether all lists, and the rows of the table, are used together.
    table
        Path of a CSV file with a column for each key, and a row for each case.

    Raises
    ------
    SettingsError
        A key or value cannot be used, a key is given twice, or lists that are used together have
        different lengths.
    """
    axes = [] if table is None else [read_cases(scene, table, f"--cases {table}")]
    like, _ = scene_values(scene)
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise SettingsError(
                f"--set {assignment!r} must be KEY=VALUES, for instance clearance=1e-5,2e-5"
            )
        key = resolve_key(scene, name.strip())
        values = parse_values(key, text, like.get(key, 0.0), repeated=zipped)
        _require_new(axes, key, f"--set {assignment}")
        axes.append(Axis((key,), tuple((value,) for value in values)))
    if zipped:
        if len(axes) == 1:
            raise no_effect("--zip", True, "without a second list")
        return [_together(axes, "--zip")]
    return axes


def read_cases(scene: Scene, path: str, label: str) -> Axis:
    """Cases of a file as an axis; `label` names the file in messages, see `read_case_file`."""
    file = read_case_file(scene, path, label)
    return Axis(file.keys, file.rows, tuple(f"{label}: line {line}" for line in file.lines))


def axes_of_values(
    scene: Scene, values: Mapping[str, Any] | str | Path, *, zipped: bool = False
) -> list[Axis]:
    """Axes of a sweep from Python: values by key, or the path of a CSV file as for ``--cases``.

    Values of a key are an iterable, or a text as for ``--set``.

    Raises
    ------
    SettingsError
        As `axes_of_options`.
    """
    if isinstance(values, (str, Path)):
        if zipped:
            raise no_effect("zipped", True, "with a file of cases")
        return [read_cases(scene, str(values), f"values = {str(values)!r}")]
    axes: list[Axis] = []
    like, _ = scene_values(scene)
    for name, entry in values.items():
        require_class("name of a key in values", name, str)
        key = resolve_key(scene, name)
        _require_new(axes, key, repr(name))
        if isinstance(entry, str):
            listed: Sequence[Any] = parse_values(key, entry, like.get(key, 0.0), repeated=zipped)
        else:
            listed = _listed(key, entry)
            if not zipped:
                require_different(key, listed)
        axes.append(Axis((key,), tuple((value,) for value in listed)))
    if not axes:
        raise SettingsError("values = {}: give at least one key with its values")
    if zipped and len(axes) == 1:
        raise no_effect("zipped", True, "without a second list")
    return [_together(axes, "zipped=True")] if zipped else axes


def _listed(key: str, values: Any) -> list[Any]:
    """Values of an iterable as plain Python values."""
    if not isinstance(values, Iterable) or isinstance(values, Mapping):
        raise SettingsError(f"{key} = {shown(values)} must be a list of values")
    listed = [_as_plain(key, value) for value in values]
    if not listed:
        raise SettingsError(f"{key} = []: give at least one value")
    return listed


def _as_plain(key: str, value: Any) -> Any:
    """Value of a setting without types of NumPy, tuples and paths.

    Raises
    ------
    SettingsError
        The value is an object that a scene file cannot have, such as settings of a joint.
    """
    plain = value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value
    if isinstance(plain, (list, tuple)):
        return [_as_plain(key, entry) for entry in plain]
    if isinstance(plain, Path):
        return str(plain)
    if plain is None or isinstance(plain, (bool, int, float, str, Mapping)):
        return plain
    raise SettingsError(
        f"{key} = {shown(plain)} must be a value of a scene file: a number, a text or a list"
    )


def _require_new(axes: Iterable[Axis], key: str, written: str) -> None:
    """Refuse a key that an axis has."""
    if any(key in axis.keys for axis in axes):
        raise SettingsError(f"{written}: {key} is given twice")


def _together(axes: Sequence[Axis], option: str) -> Axis:
    """One axis with all keys of several axes, whose rows are used together."""
    first = axes[0]
    for axis in axes[1:]:
        if len(axis.rows) != len(first.rows):
            raise SettingsError(
                f"{option}: {axis.name} has {len(axis.rows)} values, but {first.name} has "
                f"{len(first.rows)}: give lists of the same length"
            )
    rows = zip(*(axis.rows for axis in axes), strict=True)
    keys = tuple(key for axis in axes for key in axis.keys)
    origins = next((axis.origins for axis in axes if axis.origins), ())
    return Axis(keys, tuple(tuple(itertools.chain(*row)) for row in rows), origins)
