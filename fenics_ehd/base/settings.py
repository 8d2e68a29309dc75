"""Settings classes of checked fields, read from TOML and written as such."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.key_hints import key_hint, setting_names
from fenics_ehd.base.text_file import read_text

T = TypeVar("T", bound=attrs.AttrsInstance)

#: Characters of a key or number in a scene file. Time and memory to parse a key grow with the
#: square of its dots, and Python does not print numbers of thousands of digits.
LONGEST = 300


def build(
    cls: type[T],
    table: Mapping[str, Any],
    path: str = "",
    hint: Callable[[str], str] | None = None,
) -> T:
    """Settings object from nested tables.

    Parameters
    ----------
    cls
        Settings class.
    table
        Values by key, those of a section in a table of their own.
    path
        Sections above, ``"rod."`` for instance.
    hint
        What to say of an unknown key by its path; None: which of `cls` is meant perhaps.

    Raises
    ------
    SettingsError
        An unknown or missing key, or a value outside its limits; the message starts with the key.
    """
    if not isinstance(table, Mapping):
        raise SettingsError(f"{path.rstrip('.')} = {table!r} must be a table")
    known = {a.name: a for a in attrs.fields(cls)}
    names = setting_names(cls, path)
    hint = hint or (lambda key: f": {key_hint(names, key)}")
    values = {}
    for key, value in table.items():
        if key not in known:
            raise SettingsError(f"unknown key {path}{key}{hint(path + key)}")
        nested = known[key].metadata.get("section")
        values[key] = build(nested, value, f"{path}{key}.", hint) if nested else value
        if known[key].metadata.get("table") and not isinstance(value, Mapping):
            raise SettingsError(f"{path}{key} = {value!r} must be a table")
    for key, attribute in known.items():
        if attribute.default is attrs.NOTHING and key not in values:
            raise SettingsError(f"{path}{key} is missing: {attribute.metadata['help']}")
    try:
        return cls(**values)
    except SettingsError as error:
        raise SettingsError(f"{path}{error}") from None


def unusual(settings: Any, path: str = "") -> list[str]:
    """One line for every number whose size is not a usual one: its unit may be another."""
    found = []
    for attribute in attrs.fields(type(settings)):
        value, name = getattr(settings, attribute.name), f"{path}{attribute.name}"
        usual, hint = attribute.metadata.get("usual", (None, ""))
        if attribute.metadata.get("section") and value is None:
            continue
        if attribute.metadata.get("section"):
            found += unusual(value, f"{name}.")
        elif attribute.metadata.get("kinds"):
            for key, entry in value.items():
                found += unusual(entry, f"{name}.{key}.")
        elif usual and value and not usual[0] <= abs(value) <= usual[1]:
            found.append(
                f"{name} = {value:g} is outside the usual {usual[0]:g} to {usual[1]:g}{hint}"
            )
    return found


def read_toml(path: str | Path) -> dict[str, Any]:
    """Tables of a TOML file.

    Raises
    ------
    SettingsError
        The file cannot be read or is not TOML.
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
    """Keys, dots included, and values of a TOML text without what is quoted in them."""
    bare = re.sub(r"\"[^\"\n]*\"|'[^'\n]*'|#.*|[ \t]", "", content)
    return re.split(r"[][{}=,\n]", bare)


def toml_string(text: str) -> str:
    """Text as TOML has it in quotes.

    Raises
    ------
    SettingsError
        It is none, the name of a file with bytes that are no UTF-8 say.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        raise SettingsError(f"{text!a} is no text in UTF-8: rename that file or folder") from None
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_key(name: str) -> str:
    """A key as TOML has it, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_string(name)


def _literal(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_literal, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, int):
        return str(value)
    plain = format(value, ".12g")
    mantissa, exponent = format(value, ".11e").split("e")
    short = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    if not set(plain) & set(".en"):
        plain += ".0"
    return plain if len(plain) <= 8 else min(plain, short, key=len)


def to_toml(settings: Any, path: str = "", *, without: Sequence[str] = ()) -> str:
    """TOML text of a settings object, every key with its meaning; `build` reads it back.

    Parameters
    ----------
    settings
        Object of a settings class.
    path
        Of its table, with a dot behind.
    without
        Keys to leave out.
    """
    own, nested = [], []
    for attribute in attrs.fields(type(settings)):
        if attribute.name in without:
            continue
        value = getattr(settings, attribute.name)
        if value is None:  # an optional section
            continue
        name = f"{path}{attribute.name}"
        help_text = attribute.metadata.get("help", "")
        if attribute.metadata.get("section"):
            nested.append(f"\n[{name}]\n{to_toml(value, name + '.')}")
        elif value and (kinds := attribute.metadata.get("kinds")):
            words = {cls: kind for kind, cls in kinds.items()}
            for key, entry in value.items():
                place = f"{name}.{toml_key(key)}"
                text = to_toml(entry, f"{place}.")
                nested.append(f'\n[{place}]\nkind = "{words[type(entry)]}"\n{text}')
        elif attribute.metadata.get("table"):
            lines = [f"{toml_key(key)} = {_literal(entry)}\n" for key, entry in value.items()]
            nested.append(f"\n# {help_text}\n[{name}]\n{''.join(lines)}")
        else:
            own.append(f"{attribute.name} = {_literal(value)}  # {help_text}\n")
    return "".join(own) + "".join(nested)
