"""Cases of a sweep or a study: a scene with some values replaced, and the bodies that it needs.

Keys are dotted names of a scene's settings; values are written as on the command line. The identity
of a case is a checksum of all data on which its results depend.
"""

from __future__ import annotations

import csv
import functools
import io
import json
import os
import re
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
from fenics_ehd.base.files import read_json, read_text, write_whole
from fenics_ehd.base.printed import key_hint
from fenics_ehd.base.settings import walk
from fenics_ehd.base.units import WRITTEN, in_unit, parse_number
from fenics_ehd.scenes.kept_bodies import checksum, content_of
from fenics_ehd.scenes.needed_bodies import NeededBody, needed_bodies
from fenics_ehd.scenes.scene import FILES, Scene, by_key, changed, check_time, stored, today


def scene_values(scene: Scene) -> tuple[dict[str, Any], list[str]]:
    """Values of a scene's settings by full key, and keys of tables whose entries the user names."""
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
    """Full key of the setting whose key ends with `name`, if there is only one.

    Raises
    ------
    SettingsError
        No key or several keys end with the name; or the key is that of a table, without the name of
        an entry in the table.
    """
    values, free = scene_values(scene)
    name = today(name)
    candidates = _ending(values, name)
    if not candidates and _ending(free, name):
        table = _ending(free, name)[0]
        raise SettingsError(f"key {name} is a table: write {table}.NAME, the name of an entry")
    table, _, entry = name.rpartition(".")
    if not candidates and entry:
        candidates = [f"{key}.{entry}" for key in _ending(free, table)]
    if not candidates:
        raise SettingsError(f"unknown key {name}: {_shortened(key_hint(values, name))}")
    if len(candidates) > 1:
        raise SettingsError(f"key {name} is ambiguous: {' or '.join(candidates)}")
    return candidates[0]


#: Largest number of known keys in a message.
MOST_KEYS = 8


def _shortened(hint: str) -> str:
    """Hint with the first of all known keys, if it lists them."""
    keys = hint.split(", ")
    hidden = len(keys) - MOST_KEYS
    if hidden <= 0:
        return hint
    listed = ", ".join(keys[:MOST_KEYS])
    return f"{listed} and {hidden} more: 'fenics-ehd init' prints scenes with all keys"


def _ending(keys: Any, name: str) -> list[str]:
    """List with the key that is equal to `name`; if there is none, all keys that end with it."""
    return [name] if name in keys else [key for key in keys if key.endswith(f".{name}")]


def with_values(scene: Scene, values: Mapping[str, Any], optional: Collection[str] = ()) -> Scene:
    """Replace some values of a scene, check them, and round all as the text of a scene file does.

    Parameters
    ----------
    scene
        Scene as stored.
    values
        New values by full key; file names are relative to the working directory.
    optional
        Keys that are dropped instead of refused if they have no effect, see `changed`.

    Raises
    ------
    SettingsError
        A key or value cannot be used; the message names the key.
    """
    return stored(changed(scene, values, optional))


#: Largest number of cases of a sweep, and of values in a range.
MOST_CASES = 10_000


def parse_values(key: str, text: str, like: object, *, repeated: bool = False) -> tuple[Any, ...]:
    """Values for a swept key from a text, in the order of the text.

    Parameters
    ----------
    key
        The key, for messages.
    text
        Numbers, ranges or words with commas between them; lists with semicolons between them. A
        range ``a:b:n`` has `n` numbers from `a` to `b` at equal distances, ``a:b:n:log`` at equal
        ratios; `a` and `b` may have the same unit, ``10um:30um:5``.
    like
        A value of the key's type. A text of another type is returned unchanged, so that the check
        of the setting refuses it.
    repeated
        Whether a value may occur several times.

    Raises
    ------
    SettingsError
        A range or list is malformed, a value is missing or repeated, or only some values have a
        unit; the message has the text.
    """
    items = [item.strip() for item in text.split(";" if isinstance(like, tuple) else ",")]
    if not all(items):
        raise SettingsError(f"{key} = {text!r}: a value is missing between separators")
    values: list[Any] = []
    for item in items:
        if ":" in item and not isinstance(like, (tuple, bool, str)):
            numbers, symbol = _without_unit(key, item)
            between = [_plain(number, like) for number in _range(key, numbers)]
            values += [f"{as_text(number)} {symbol}" for number in between] if symbol else between
        else:
            values.append(parse_value(key, item, like))
    if not isinstance(like, (tuple, str)):
        _require_same_units(key, text)
    if not repeated:
        require_different(key, values)
    return tuple(values)


def _without_unit(key: str, item: str) -> tuple[str, str]:
    """Range without the unit of its first and last value, and this unit; empty without a unit.

    Raises
    ------
    SettingsError
        The two values have different units.
    """
    first, last, *others = [part.strip() for part in item.split(":")]
    matches = [
        None if _number(end) is not None else WRITTEN.fullmatch(end) for end in (first, last)
    ]
    if None in matches:
        return item, ""
    (first, unit), (last, other) = [match.groups()[:2] for match in matches if match is not None]
    if unit != other:
        raise SettingsError(f"{key} = {item!r}: give first and last the same unit")
    return ":".join([first, last, *others]), unit


def parse_value(key: str, item: str, like: object) -> Any:
    """Value from a text that is neither a range nor a list of values; see `parse_values`."""
    if isinstance(like, tuple):
        return _list(key, item)
    if isinstance(like, bool):
        return {"true": True, "false": False}.get(item.lower(), item)
    number = None if isinstance(like, str) else _number(item)
    return item if number is None else _plain(number, like)


def require_different(key: str, values: Iterable[Any]) -> None:
    """Refuse values of a key of which two are equal.

    Raises
    ------
    SettingsError
        A value is given twice; the message has the value.
    """
    value, times = Counter(map(as_text, values)).most_common(1)[0]
    if times > 1:
        raise SettingsError(f"{key} = {value}: the value is given twice: drop one of them")


def parse_quantities(option: str, text: str, unit: str) -> tuple[float, ...]:
    """Values of an option of the command line, in its unit, in the order of the text.

    Parameters
    ----------
    option
        Name of the option, for messages.
    text
        Numbers and ranges with commas between them, as for `parse_values`. A number may have a
        unit: ``1000rpm:12000rpm:45``.
    unit
        Unit of the values, and of numbers without a unit.

    Raises
    ------
    SettingsError
        A value is missing, malformed, repeated, or has a unit of another kind; or only some values
        have a unit.
    """
    values: list[float] = []
    for item in (item.strip() for item in text.split(",")):
        if not item:
            raise SettingsError(f"{option} = {text!r}: a value is missing between separators")
        values += _range(option, item, unit) if ":" in item else [_measured(option, item, unit)]
    _require_same_units(option, text)
    value, times = Counter(values).most_common(1)[0]
    if times > 1:
        raise SettingsError(f"{option} = {value:g}: the value is given twice: drop one of them")
    return tuple(values)


def _require_same_units(key: str, text: str) -> None:
    """Refuse a list of numbers and ranges of which only some have a unit."""
    parts = [part for item in text.split(",") for part in item.split(":")[:2]]
    without = [part for part in parts if _number(part) is not None]
    with_unit = [part for part in parts if part not in without and WRITTEN.fullmatch(part)]
    if with_unit and without:
        raise SettingsError(
            f"{key} = {text!r}: only some values have a unit: give all of them a unit, or none"
        )


def _measured(option: str, item: str, unit: str) -> float:
    """Convert a text with or without a unit to a number in a unit.

    Raises
    ------
    SettingsError
        The text is not a number, or its unit is of another kind; the message has the text.
    """
    number = _number(item)
    if number is not None and isfinite(number):
        return number
    try:
        return in_unit(item, unit)
    except SettingsError as error:
        raise SettingsError(f"{option} = {item!r} {error}") from None


def as_text(value: object) -> str:
    """Text of a value in a table: words are unchanged, others are JSON with all digits."""
    return value if isinstance(value, str) else json.dumps(value)


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a CSV table; the file is complete or absent. Missing values give empty cells."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: as_text(v) for k, v in row.items() if v is not None} for row in rows)
    write_whole(path, text.getvalue())


def read_table(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """Read the rows of a CSV table, as texts by column.

    Raises
    ------
    ValueError
        The table has other columns than `columns`.
    """
    reader = csv.DictReader(io.StringIO(read_text(path)))
    if tuple(reader.fieldnames or ()) != tuple(columns):
        raise ValueError(
            "the columns of the table are not those of this version: run the study again"
        )
    return list(reader)


def finite(value: Any) -> Any:
    """Replace a number that is not finite by None; other values are unchanged."""
    return None if isinstance(value, float) and not isfinite(value) else value


def _list(key: str, item: str) -> list[Any]:
    with suppress(json.JSONDecodeError, RecursionError):
        value = json.loads(item)
        if isinstance(value, list):
            return value
    raise SettingsError(
        f"{key} = {item!r} must be a list, [20, 5] for instance; separate lists by semicolons"
    )


def _number(item: str) -> float | None:
    """Convert a text to a number; None if it is not a number."""
    with suppress(ValueError):
        return parse_number(item)
    return None


def _plain(number: float, like: object) -> float | int:
    """Convert a whole number to int if `like`, another value of the same setting, is an int."""
    return int(number) if isinstance(like, int) and number.is_integer() else number


def _range(key: str, item: str, unit: str | None = None) -> list[float]:
    """Numbers of a range ``a:b:n`` or ``a:b:n:log``; `a` and `b` are included exactly.

    If `unit` is given, `a` and `b` may have other units, and the numbers are returned in `unit`.
    """
    first_text, last_text, *counted = [part.strip() for part in item.split(":")]
    logarithmic = counted[1:] == ["log"]
    if len(counted) != 1 and not logarithmic:
        raise SettingsError(f"{key} = {item!r} must be first:last:count or first:last:count:log")
    if unit is None:
        first = _number(first_text)
        last = _number(last_text)
    else:
        first = _measured(key, first_text, unit)
        last = _measured(key, last_text, unit)
    if first is None or last is None or not (isfinite(first) and isfinite(last)):
        raise SettingsError(f"{key} = {item!r}: first and last must be finite numbers")
    is_whole = counted[0].isascii() and counted[0].isdecimal() and len(counted[0]) < 10
    count = int(counted[0]) if is_whole else 0
    if not 2 <= count <= MOST_CASES:
        raise SettingsError(
            f"{key} = {item!r}: count = {counted[0]} must be a whole number from 2 to {MOST_CASES}"
        )
    if logarithmic and not (first > 0 and last > 0):
        raise SettingsError(f"{key} = {item!r}: first and last must be above 0 for log ranges")
    numbers = (np.geomspace if logarithmic else np.linspace)(first, last, count)
    # Numbers are rounded to the digits that a scene file stores: 2e-05, not its neighbour.
    return [first, *(float(f"{number:.12g}") for number in numbers[1:-1]), last]


@dataclass(frozen=True, eq=False)
class Case:
    """A case of a sweep or study: one scene to run.

    Attributes
    ----------
    name
        Name of the case in the sweep or study.
    scene
        Scene to run.
    bodies
        Bodies that must be reduced for the scene, by their names in the scene.
    values
        Values of the swept keys, in the order of the keys; numbers in the units of the settings.
    """

    name: str
    scene: Scene
    bodies: Mapping[str, NeededBody]
    values: tuple[Any, ...] = ()

    @functools.cached_property
    def identity(self) -> str:
        """Checksum of all data on which the results of the case depend."""
        bodies = {name: body.name for name, body in self.bodies.items()}
        return checksum(identity(self.scene) | bodies)


def make_case(
    name: str, scene: Scene, values: Mapping[str, Any], optional: Collection[str] = ()
) -> Case:
    """Make a case: a scene with other values of some settings, by full key, see `with_values`.

    Raises
    ------
    SettingsError, MeshError
        A value cannot be used, a model does not exist, or the scene has `output.accuracy`.
    """
    varied = with_values(scene, values, optional)
    check_time(varied)
    if varied.output.accuracy:
        raise SettingsError(
            f"output.accuracy = {varied.output.accuracy:g} would choose other settings for each "
            "case, but only cases with the given settings can be compared: drop the key"
        )
    numbers = dict(by_key(varied.tables))
    converted = (_converted(value, numbers.get(key)) for key, value in values.items())
    return Case(name, varied, needed_bodies(varied), tuple(converted))


def _converted(value: Any, setting: Any) -> Any:
    """Number in the unit of its setting, if a value is a text with a unit; else the value."""
    is_number = isinstance(setting, (int, float)) and not isinstance(setting, bool)
    return setting if isinstance(value, str) and is_number else value


def identity(scene: Scene) -> dict[str, str]:
    """All data on which the results of a scene depend, as text by dotted key."""
    values = {
        key: described(value) if _names_file(key, value) else as_text(value)
        for key, value in by_key(scene.tables)
    }
    return {"version": __version__} | values


#: Difference of a stored identity that cannot be read.
UNREADABLE = "it cannot be read"


def difference(path: Path, about: Mapping[str, Any], *, more_keys: bool = True) -> str:
    """First difference between a stored identity and the present one, as text for a message.

    The text is empty if there is no difference, or no file.

    Parameters
    ----------
    path
        JSON file with the stored identity.
    about
        Present identity: values by key.
    more_keys
        Whether the file may have further keys.
    """
    if not path.exists():
        return ""
    try:
        former = dict(read_json(path))
    except (OSError, ValueError, TypeError):
        return UNREADABLE
    for key in about if more_keys else dict.fromkeys((*about, *former)):
        if former.get(key) != about.get(key):
            return changed_text(key, former.get(key), about.get(key), "in the folder", "here")
    return ""


#: Largest number of characters of a value in a message about a difference.
LONGEST_VALUE = 60

#: Pattern of the commas between the values of a key, not of those in a list.
COMMAS = re.compile(r", (?![^\[]*\])")


def changed_text(key: str, former: Any, present: Any, there: str, here: str) -> str:
    """Text of a difference between two values of a key, for a message.

    Of two long lists of values, only the first different value is in the text, or the numbers of
    values. `there` and `here` name the places of the values.
    """
    if max(len(str(former)), len(str(present))) <= LONGEST_VALUE:
        return f"{key} is {former} {there}, but {present} {here}"
    one = COMMAS.split(str(former))
    other = COMMAS.split(str(present))
    if len(one) != len(other):
        return f"{key} has {len(one)} values {there}, but {len(other)} {here}"
    pairs = enumerate(zip(one, other, strict=True), 1)
    # Values of different types may have one text.
    n, old, new = next(((n, a, b) for n, (a, b) in pairs if a != b), (1, one[0], other[0]))
    name = f"value {n} of {key}" if len(one) > 1 else key
    return f"{name} is {_cut(old)} {there}, but {_cut(new)} {here}"


def _cut(text: str) -> str:
    """Text with at most `LONGEST_VALUE` characters."""
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


def _names_file(key: str, value: object) -> bool:
    """True if a value is the path of a file or of a run's folder, and no word such as ``hex``."""
    return isinstance(value, str) and (
        key.endswith(".snapshots") or os.path.splitext(value)[1] in FILES
    )


def described(value: object) -> str:
    """Text of a value; for a file, or the folder of a run, its name and checksum."""
    content = content_of(value) if isinstance(value, str) else None
    return content or as_text(value)
