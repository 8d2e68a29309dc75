"""Cases of a sweep or a study: a scene with some of its keys replaced, and the bodies it needs.

Keys are dotted names of a scene's settings, values are written as on the command line; a case's
identity is a checksum of all that its results depend on.
"""

from __future__ import annotations

import csv
import functools
import io
import json
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd import __version__
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import read_text, write_whole
from fenics_ehd.base.printed import key_hint
from fenics_ehd.base.settings import walk
from fenics_ehd.base.units import parse_number
from fenics_ehd.scenes.needed_bodies import NeededBody, checksum, content_of, needed_bodies
from fenics_ehd.scenes.scene import FILES, Scene, by_key, changed, stored, today


def scene_values(scene: Scene) -> tuple[dict[str, Any], list[str]]:
    """Values by dotted key, ``joints.big_end.clearance``, and keys of tables with free names."""
    values: dict[str, Any] = {}
    free: list[str] = []
    for key, attribute, value in walk(scene):
        if "table" in attribute.metadata:
            free.append(key)
            values |= {f"{key}.{name}": entry for name, entry in value.items()}
        else:
            values[key] = value
    return values, free


def resolve_key(scene: Scene, name: str) -> str:
    """Full key of one that may be given by its end, where that is the end of one key only.

    Raises
    ------
    SettingsError
        No key or more than one ends so, or it is a table with free names and the name in it is
        missing.
    """
    values, free = scene_values(scene)
    name = today(name)
    candidates = _ending(values, name)
    if not candidates and _ending(free, name):
        table = _ending(free, name)[0]
        raise SettingsError(f"key {name} is a table: write {table}.NAME for a name in it")
    table, _, entry = name.rpartition(".")
    if not candidates and entry:
        candidates = [f"{key}.{entry}" for key in _ending(free, table)]
    if not candidates:
        raise SettingsError(f"unknown key {name}: {key_hint(values, name)}")
    if len(candidates) > 1:
        raise SettingsError(f"key {name} is ambiguous: {' or '.join(candidates)}")
    return candidates[0]


def _ending(keys: Any, name: str) -> list[str]:
    """The key of that name, or all that end with it."""
    return [name] if name in keys else [key for key in keys if key.endswith(f".{name}")]


def with_values(scene: Scene, values: Mapping[str, Any], optional: Collection[str] = ()) -> Scene:
    """A scene with full keys replaced, checked and as its file would keep it.

    Parameters
    ----------
    scene
        As stored.
    values
        By key; files are relative to the working directory.
    optional
        As of `changed`.

    Raises
    ------
    SettingsError
        Naming the key that cannot be used.
    """
    return stored(changed(scene, values, optional))


#: Cases of one sweep, and so values of one key.
MOST_CASES = 10_000


def parse_values(key: str, text: str, like: object) -> tuple[Any, ...]:
    """Values for a key, in the order given.

    Parameters
    ----------
    key
        Named in errors.
    text
        ``a:b:n``, `n` numbers from `a` to `b` with equal distances, ``a:b:n:log`` with
        equal ratios; numbers and ranges, or words, with commas between; lists with
        semicolons between.
    like
        A value of the kind that the key takes. What does not fit stays text, which the
        settings then refuse with their own words.

    Raises
    ------
    SettingsError
        A range or list is malformed, a value is missing or given twice.
    """
    items = [item.strip() for item in text.split(";" if isinstance(like, tuple) else ",")]
    if not all(items):
        raise SettingsError(f"{key} = {text!r}: a value is missing")
    values: list[Any] = []
    for item in items:
        if isinstance(like, tuple):
            values.append(_list(key, item))
        elif isinstance(like, bool):
            values.append({"true": True, "false": False}.get(item.lower(), item))
        elif isinstance(like, str):
            values.append(item)
        elif ":" in item:
            values += [_plain(number, like) for number in _range(key, item)]
        else:
            number = _number(item)
            values.append(item if number is None else _plain(number, like))
    value, times = Counter(map(as_text, values)).most_common(1)[0]
    if times > 1:
        raise SettingsError(f"{key} = {value}: the value is given twice")
    return tuple(values)


def as_text(value: object) -> str:
    """A value in a table: words as they are, all else as JSON, floats with every digit."""
    return value if isinstance(value, str) else json.dumps(value)


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a table, whole or not at all; what is not known is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: as_text(v) for k, v in row.items() if v is not None} for row in rows)
    write_whole(path, text.getvalue())


def read_table(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """Rows of a table.

    Raises
    ------
    ValueError
        It has other columns.
    """
    reader = csv.DictReader(io.StringIO(read_text(path)))
    if tuple(reader.fieldnames or ()) != tuple(columns):
        raise ValueError("its columns are others")
    return list(reader)


def finite(value: Any) -> Any:
    """The value, None for a number that is not finite."""
    return None if isinstance(value, float) and not isfinite(value) else value


def _list(key: str, item: str) -> list[Any]:
    with suppress(json.JSONDecodeError, RecursionError):
        value = json.loads(item)
        if isinstance(value, list):
            return value
    raise SettingsError(
        f"{key} = {item!r} must be a list, [20, 5] say; put semicolons between several"
    )


def _number(item: str) -> float | None:
    """Number of a text, None where it holds none."""
    with suppress(ValueError):
        return parse_number(item)
    return None


def _plain(number: float, like: object) -> float | int:
    """The number, as an int where the key takes whole numbers and this is one."""
    return int(number) if isinstance(like, int) and number.is_integer() else number


def _range(key: str, item: str) -> list[float]:
    """Numbers of ``a:b:n`` or ``a:b:n:log``; both ends are among them exactly."""
    first_text, last_text, *counted = [part.strip() for part in item.split(":")]
    logarithmic = counted[1:] == ["log"]
    if len(counted) != 1 and not logarithmic:
        raise SettingsError(f"{key} = {item!r} must be first:last:count or first:last:count:log")
    first = _number(first_text)
    last = _number(last_text)
    if first is None or last is None or not (isfinite(first) and isfinite(last)):
        raise SettingsError(f"{key} = {item!r}: first and last must be finite numbers")
    is_whole = counted[0].isascii() and counted[0].isdecimal() and len(counted[0]) < 10
    count = int(counted[0]) if is_whole else 0
    if not 2 <= count <= MOST_CASES:
        raise SettingsError(
            f"{key} = {item!r}: count = {counted[0]} must be a whole number from 2 to {MOST_CASES}"
        )
    if logarithmic and not (first > 0 and last > 0):
        raise SettingsError(f"{key} = {item!r}: first and last must be above 0 for log")
    numbers = (np.geomspace if logarithmic else np.linspace)(first, last, count)
    # With the digits that a scene file keeps: 2e-05 and not a neighbour of it.
    return [first, *(float(f"{number:.12g}") for number in numbers[1:-1]), last]


@dataclass(frozen=True, eq=False)
class Case:
    """A case.

    Attributes
    ----------
    name
        In its sweep or study.
    scene
        What is run.
    bodies
        Bodies to be reduced, by their names in the scene.
    values
        Of the swept keys.
    """

    name: str
    scene: Scene
    bodies: Mapping[str, NeededBody]
    values: tuple[Any, ...] = ()

    @functools.cached_property
    def identity(self) -> str:
        """Checksum of all that its results depend on."""
        bodies = {name: body.name for name, body in self.bodies.items()}
        return checksum(identity(self.scene) | bodies)


def make_case(
    name: str, scene: Scene, values: Mapping[str, Any], optional: Collection[str] = ()
) -> Case:
    """A case of a scene with full keys replaced, see `with_values`.

    Raises
    ------
    SettingsError, MeshError
        A value that cannot be used, or there is no such model.
    """
    varied = with_values(scene, values, optional)
    if varied.output.accuracy:
        raise SettingsError(
            f"output.accuracy = {varied.output.accuracy:g}: cases are compared with the settings "
            "that they have: drop it"
        )
    return Case(name, varied, needed_bodies(varied), tuple(values.values()))


def identity(scene: Scene) -> dict[str, str]:
    """Everything that results depend on, as text by dotted key."""
    values = {
        key: described(value) if _names_file(key, value) else as_text(value)
        for key, value in by_key(scene.tables)
    }
    return {"version": __version__} | values


def _names_file(key: str, value: object) -> bool:
    """True of a file or a run's folder; a file called ``hex`` is no word's."""
    return key.endswith(".snapshots") or Path(str(value)).suffix in FILES


def described(value: object) -> str:
    """A value as text; of a file, or the history of a run's folder, name and checksum."""
    content = content_of(value) if isinstance(value, str) else None
    return content or as_text(value)
