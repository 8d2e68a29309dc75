"""Settings classes with checked fields: reading from TOML, writing to TOML, and notices."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import read_text
from fenics_ehd.base.needs import Setting, no_effect
from fenics_ehd.base.printed import key_hint


def declared(cls: type) -> list[attrs.Attribute]:
    """Fields of a settings class that are keys of scene files: fields with metadata."""
    return [attribute for attribute in attrs.fields(cls) if attribute.metadata]


def setting_names(cls: type, path: str = "") -> dict[str, attrs.Attribute]:
    """Fields of a settings class by full key, such as ``section.key`` or ``table.NAME.key``."""
    names = {}
    for attribute in declared(cls):
        name = f"{path}{attribute.name}"
        names[name] = attribute
        if "section" in attribute.metadata:
            names |= setting_names(attribute.metadata["section"], f"{name}.")
        for kind in attribute.metadata.get("kinds", {}).values():
            names |= setting_names(kind, f"{name}.NAME.")
    return names


T = TypeVar("T", bound=attrs.AttrsInstance)

#: Largest number of characters of a key or number in a scene file. Time and memory to parse a key
#: grow with the square of the number of its dots, and Python does not print numbers of thousands of
#: digits.
LONGEST = 300


class UnknownKeyError(SettingsError):
    """A scene has a key that does not exist; the message is the full key."""


def build(cls: type[T], table: Mapping[str, Any], path: str = "") -> T:
    """Make a settings object from nested tables.

    Parameters
    ----------
    cls
        Settings class.
    table
        Values by key; the values of a section are in a nested table.
    path
        Key of the table, followed by a dot, such as ``"rod."``; empty for the complete scene.

    Raises
    ------
    UnknownKeyError
        If a key does not exist.
    SettingsError
        If a key is missing, or a value is outside its limits; the message begins with the key.
    """
    if not isinstance(table, Mapping):
        raise SettingsError(f"{path.rstrip('.')} = {table!r} must be a table")
    known = {a.name: a for a in declared(cls)}
    values = {}
    for key, value in table.items():
        if key not in known:
            raise UnknownKeyError(path + key)
        about = known[key].metadata
        name = f"{path}{key}"
        if "table" in about and not isinstance(value, Mapping):
            named = f"tables: [{name}.NAME]" if "kinds" in about else "a table"
            raise SettingsError(f"{name} = {value!r} must be {named}")
        values[key] = value
        if "section" in about and value == {} and path and not _required(about["section"]):
            raise SettingsError(f"table [{name}] is empty: give one of its keys, or drop the table")
        if "section" in about:
            values[key] = build(about["section"], value, f"{name}.")
        elif "kinds" in about:
            values[key] = {entry: _entry(about, name, entry, value[entry]) for entry in value}
    for key, attribute in known.items():
        if attribute.default is attrs.NOTHING and key not in values:
            raise SettingsError(f"{path}{key} is missing: {attribute.metadata['help']}")
    try:
        return cls(**values)
    except SettingsError as error:
        raise SettingsError(f"{path}{error}") from None


def _required(cls: type) -> list[str]:
    """Keys of a settings class that have no default."""
    return [field.name for field in declared(cls) if field.default is attrs.NOTHING]


def _entry(about: Mapping[str, Any], section: str, name: str, table: Any) -> Any:
    """Make the settings object of a named table; the key ``kind`` selects its class, see `entries`.

    Raises
    ------
    SettingsError
        If the name has a character that is no letter, digit, _ or -, if the table or its kind is
        missing or wrong, or if `build` refuses the table.
    """
    path = f"{section}.{name}"
    kinds = about["kinds"]
    if not name.replace("_", "").replace("-", "").isalnum():
        raise SettingsError(f"[{path}]: a name must consist of letters, digits, _ and -")
    if not isinstance(table, Mapping):
        raise SettingsError(f"{path} = {table!r} must be a table: [{path}]")
    if name in about["named"]:
        return build(about["named"][name], table, f"{path}.")
    if "kind" not in table:
        raise SettingsError(f"{path}.kind is missing: one of {', '.join(kinds)}")
    kind = table["kind"]
    if not isinstance(kind, str) or kind not in kinds:
        raise SettingsError(f"{path}.kind = {kind!r}: {key_hint(kinds, str(kind))}")
    return build(kinds[kind], {k: v for k, v in table.items() if k != "kind"}, f"{path}.")


def walk(settings: Any, path: str = "") -> Iterator[tuple[str, attrs.Attribute, Any]]:
    """Iterate over full key, field and value of all settings, also in sections and named tables."""
    for attribute in declared(type(settings)):
        name = f"{path}{attribute.name}"
        value = getattr(settings, attribute.name)
        if "kinds" in attribute.metadata:
            for key, entry in value.items():
                yield from walk(entry, f"{name}.{key}.")
        elif "section" not in attribute.metadata:
            yield name, attribute, value
        elif value is not None:
            yield from walk(value, f"{name}.")


def idle_settings(
    settings: Any, path: str = "", around: tuple[tuple[str, Any], ...] = ()
) -> Iterator[tuple[str, Any, str, bool]]:
    """Iterate over settings without effect.

    Parameters
    ----------
    settings
        Object of a settings class.
    path
        Key of its table, followed by a dot.
    around
        Keys and objects of the enclosing tables, the innermost first.

    Yields
    ------
    tuple
        Full key, value, reason, and whether the setting is only reported, not refused.
    """
    tables = ((path, settings), *around)
    look_up = partial(_setting, tables)
    for attribute in declared(type(settings)):
        name = f"{path}{attribute.name}"
        value = getattr(settings, attribute.name)
        about = attribute.metadata
        needs = about.get("needs", ())
        if needs and value == _default(attribute):
            needs = ()
        failed = next((need for need in needs if need.failure(look_up)), None)
        if failed is not None:
            yield name, value, failed.failure(look_up), failed.notice
        elif "kinds" in about:
            for key, entry in value.items():
                yield from idle_settings(entry, f"{name}.{key}.", tables)
        elif "section" in about and value is not None:
            yield from idle_settings(value, f"{name}.", tables)


def _default(attribute: attrs.Attribute) -> Any:
    """Default value of a field."""
    default: Any = attribute.default
    return default.factory() if isinstance(default, attrs.Factory) else default  # type: ignore[arg-type]


def _setting(tables: tuple[tuple[str, Any], ...], key: str) -> Setting | None:
    """Setting of a key, from the first table that has the key; None if no table has it."""
    for path, table in tables:
        value = table
        for name in key.split("."):
            value = getattr(value, name, None)
        if value is not None:
            return Setting(f"{path}{key}", value)
    return None


def keys_excluded_by(cls: type, key: str) -> tuple[str, ...]:
    """Keys of a settings class that have no effect if `key` is set."""

    def is_excluded(attribute: attrs.Attribute) -> bool:
        needs = attribute.metadata.get("needs", ())
        return any(condition.absent and key in condition.keys for condition in needs)

    return tuple(attribute.name for attribute in declared(cls) if is_excluded(attribute))


def require_effects(settings: Any, path: str = "") -> None:
    """Refuse settings without effect, except defaults and settings that are only reported.

    Raises
    ------
    SettingsError
        If there is such a setting; the message has its value and the reason.
    """
    for name, value, why, notice in idle_settings(settings, path):
        if not notice:
            raise no_effect(name, value, why)


def without_effect(settings: Any) -> list[str]:
    """Notices about settings that have no effect and are not refused, one line each."""
    idle = idle_settings(settings)
    return [str(no_effect(name, value, why)) for name, value, why, notice in idle if notice]


def unusual(settings: Any, path: str = "") -> list[str]:
    """Notices about numbers of unusual magnitude, which may be in another unit, one line each."""
    notices = []
    for name, attribute, value in walk(settings, path):
        usual, hint = attribute.metadata.get("usual", (None, ""))
        if usual and value and not usual[0] <= abs(value) <= usual[1]:
            notices.append(
                f"{name} = {value:g} is outside the usual {usual[0]:g} to {usual[1]:g}{hint}"
            )
    return notices


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read the tables of a TOML file.

    Raises
    ------
    SettingsError
        If the file cannot be read or is not TOML.
    """
    try:
        content = read_text(path)
        if max(map(len, _bare_words(content))) > LONGEST:
            raise ValueError(f"a key or a number has more than {LONGEST} characters")
        return tomllib.loads(content)
    except OSError as error:
        raise SettingsError(f"scene file {path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"scene file {path}: {error}") from None


def _bare_words(content: str) -> list[str]:
    """Dotted keys and unquoted values of a TOML text; quoted texts and comments are removed."""
    bare = re.sub(r"\"[^\"\n]*\"|'[^'\n]*'|#.*|[ \t]", "", content)
    return re.split(r"[][{}=,\n]", bare)


def toml_string(text: str) -> str:
    """Quote a text and escape it as TOML requires.

    Raises
    ------
    SettingsError
        If the text cannot be encoded in UTF-8, for instance the name of a file with other bytes.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        raise SettingsError(f"{text!a} is not in UTF-8: rename the file or folder") from None
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_key(name: str) -> str:
    """Write a key in TOML, in quotes if it has other characters than letters, digits, _ and -."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_string(name)


def _literal(value: Any) -> str:
    """Write a value in TOML."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_literal, value))}]"
    if isinstance(value, str):
        return toml_string(value)
    return json.dumps(float(format(value, ".12g")) if isinstance(value, float) else value)


def to_toml(settings: Any, path: str = "") -> str:
    """Write a settings object as TOML text with a help text for every key; `build` reads it.

    Keys that the object lists in its attribute ``idle`` are omitted.

    Parameters
    ----------
    settings
        Object of a settings class.
    path
        Key of its table, followed by a dot.
    """
    lines = []
    nested = []
    for attribute in declared(type(settings)):
        value = getattr(settings, attribute.name)
        about = attribute.metadata
        if value is None or attribute.name in getattr(settings, "idle", ()):
            continue
        name = f"{path}{attribute.name}"
        help_text = about.get("help", "")
        if "section" in about:
            nested.append(f"\n[{name}]\n{to_toml(value, name + '.')}")
        elif "kinds" in about and value:
            words = {cls: f'kind = "{kind}"\n' for kind, cls in about["kinds"].items()}
            for key, entry in value.items():
                header = f"{name}.{toml_key(key)}"
                text = words.get(type(entry), "") + to_toml(entry, f"{header}.")
                nested.append(f"\n[{header}]\n{text}")
        elif "table" in about:
            rows = [f"{toml_key(key)} = {_literal(entry)}\n" for key, entry in value.items()]
            nested.append(f"\n# {help_text}\n[{name}]\n{''.join(rows)}")
        else:
            lines.append(f"{attribute.name} = {_literal(value)}  # {help_text}\n")
    return "".join(lines) + "".join(nested)
