"""Cases of a sweep or a study: a scene with some keys replaced, and the bodies that it needs.

Keys are dotted names of a scene's settings; values are written as on the command line. The identity
of a case is a checksum of all data on which its results depend.
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
    """Full key of an abbreviated one, which must be the end of exactly one key.

    Raises
    ------
    SettingsError
        No key or several keys end with the name, or the key is a table with free names and the name
        of an entry is missing.
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
    """The key of that name, or all keys that end with the name."""
    return [name] if name in keys else [key for key in keys if key.endswith(f".{name}")]


def with_values(scene: Scene, values: Mapping[str, Any], optional: Collection[str] = ()) -> Scene:
    """A scene with values of full keys replaced, checked, and in the form of its file.

    Parameters
    ----------
    scene
        Scene as stored.
    values
        Values by full key; file names are relative to the working directory.
    optional
        Keys that may have no effect, see `changed`.

    Raises
    ------
    SettingsError
        The message names the key that cannot be used.
    """
    return stored(changed(scene, values, optional))


#: Largest number of cases of a sweep, and so of values of a key.
MOST_CASES = 10_000


def parse_values(key: str, text: str, like: object) -> tuple[Any, ...]:
    """Values for a key, in the order given.

    Parameters
    ----------
    key
        Key, for messages.
    text
        ``a:b:n``, `n` numbers from `a` to `b` with equal distances, ``a:b:n:log`` with
        equal ratios; numbers and ranges, or words, with commas between; lists with
        semicolons between.
    like
        A value of the type of the key. A text of another type is returned unchanged, so that the
        check of the setting refuses it.

    Raises
    ------
    SettingsError
        A range or list is malformed, or a value is missing or repeated.
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
    """A value as text in a table: words unchanged, others as JSON, floats with all digits."""
    return value if isinstance(value, str) else json.dumps(value)


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a table; the file is complete or absent. Missing values give empty cells."""
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
        The table has other columns.
    """
    reader = csv.DictReader(io.StringIO(read_text(path)))
    if tuple(reader.fieldnames or ()) != tuple(columns):
        raise ValueError("its columns are others")
    return list(reader)


def finite(value: Any) -> Any:
    """The value itself; None for a number that is not finite."""
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
    """Number of a text; None if the text is no number."""
    with suppress(ValueError):
        return parse_number(item)
    return None


def _plain(number: float, like: object) -> float | int:
    """The number, as an int if it is whole and the key has whole numbers."""
    return int(number) if isinstance(like, int) and number.is_integer() else number


def _range(key: str, item: str) -> list[float]:
    """Numbers of ``a:b:n`` or ``a:b:n:log``; both ends are included exactly."""
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
    # Numbers are rounded to the digits that a scene file stores: 2e-05, not its neighbour.
    return [first, *(float(f"{number:.12g}") for number in numbers[1:-1]), last]


@dataclass(frozen=True, eq=False)
class Case:
    """A case of a sweep or study.

    Attributes
    ----------
    name
        Name in the sweep or study.
    scene
        Scene to be run.
    bodies
        Bodies to be reduced, by their names in the scene.
    values
        Values of the swept keys.
    """

    name: str
    scene: Scene
    bodies: Mapping[str, NeededBody]
    values: tuple[Any, ...] = ()

    @functools.cached_property
    def identity(self) -> str:
        """Checksum of all data on which the results depend."""
        bodies = {name: body.name for name, body in self.bodies.items()}
        return checksum(identity(self.scene) | bodies)


def make_case(
    name: str, scene: Scene, values: Mapping[str, Any], optional: Collection[str] = ()
) -> Case:
    """A case of a scene with full keys replaced, see `with_values`.

    Raises
    ------
    SettingsError, MeshError
        A value cannot be used, or the model does not exist.
    """
    varied = with_values(scene, values, optional)
    if varied.output.accuracy:
        raise SettingsError(
            f"output.accuracy = {varied.output.accuracy:g}: cases are compared with the settings "
            "that they have: drop it"
        )
    return Case(name, varied, needed_bodies(varied), tuple(values.values()))


def identity(scene: Scene) -> dict[str, str]:
    """All data on which results depend, as text by dotted key."""
    values = {
        key: described(value) if _names_file(key, value) else as_text(value)
        for key, value in by_key(scene.tables)
    }
    return {"version": __version__} | values


def _names_file(key: str, value: object) -> bool:
    """True if a value names a file or a run's folder; a word such as ``hex`` is no file name."""
    return key.endswith(".snapshots") or Path(str(value)).suffix in FILES


def described(value: object) -> str:
    """A value as text; for a file, or the history in a run's folder, name and checksum."""
    content = content_of(value) if isinstance(value, str) else None
    return content or as_text(value)
