"""Text and table that describe an object: what Python and notebooks show of public objects.

A class that derives from `Described` is shown by its `described` lines: as text of at most
`MOST_LINES` lines in Python, as a table in Jupyter. By default, these lines have the name of the
class, the first line of its documentation, and the values of its fields with their units. The
unit of a field is in brackets in its help text, or in its lines of the class's documentation:
``Bore radius R [m].`` Classes with results define lines of their own, with figures and errors.

Imports inside functions: the settings of ``--help`` need no NumPy.
"""

from __future__ import annotations

import dataclasses
import html
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from fenics_ehd.base.errors import UnknownNameError
from fenics_ehd.base.printed import near_names, shown
from fenics_ehd.base.units import unit, unit_of

#: Attribute with the fields of a class of attrs, read here because the reduction module and its
#: objects do without attrs.
ATTRS_FIELDS = "__attrs_attrs__"

#: Largest numbers of lines, and of characters of a line's text.
MOST_LINES = 10
LONGEST_TEXT = 100

#: Largest number of entries of a sequence or array that are shown one by one.
MOST_ENTRIES = 4


class Described:
    """Base class of objects that are shown by a few lines instead of all their arrays."""

    __slots__ = ()

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Give the class a `__repr__` of its own, which decorators of attrs do not replace."""
        super().__init_subclass__(**keywords)
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = lambda self: self._text()  # type: ignore[method-assign]

    def described(self) -> Iterable[tuple[str, str]]:
        """Names and texts of the lines that describe the object; the first names the object."""
        cls = type(self)
        yield cls.__name__, first_sentence(cls)
        units = units_of(cls)
        common = _known_unit(unit_of(first_sentence(cls)))
        for name, value in _values(self):
            yield name, value_text(value, units.get(name, common))

    def _lines(self) -> list[tuple[str, str]]:
        """At most `MOST_LINES` lines of `described`, each of them shortened."""
        lines = [(name, _shortened(text)) for name, text in self.described()]
        if len(lines) > MOST_LINES:
            hidden = len(lines) - MOST_LINES + 1
            lines = [*lines[: MOST_LINES - 1], ("", f"and {hidden} more")]
        return lines

    def _text(self) -> str:
        """Text of the lines, with the texts in one column."""
        lines = self._lines()
        width = max((len(name) for name, _ in lines), default=0)
        return "\n".join(f"{name:{width}}  {text}".rstrip() for name, text in lines)

    def __repr__(self) -> str:
        return self._text()

    def _repr_html_(self) -> str:
        """Table of the lines, which Jupyter shows."""
        rows = (
            f'<tr><th style="text-align:left">{html.escape(name)}</th>'
            f'<td style="text-align:left">{html.escape(text)}</td></tr>'
            for name, text in self._lines()
        )
        return f"<table>{''.join(rows)}</table>"


class Named(dict[str, Any], Described):
    """Objects by name; an unknown name is refused, with similar names in the message.

    Parameters
    ----------
    entries
        Objects by name.
    label
        How a Python program writes the dictionary, ``"result.joints"``, for messages.
    """

    def __init__(self, entries: Mapping[str, Any] | None = None, label: str = "") -> None:
        super().__init__(entries or {})
        self.label = label

    def __missing__(self, name: object) -> Any:
        raise unknown_name(self.label, name, self)

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield the number of the objects, and each name with a short text of its object."""
        yield self.label or "names", f"{len(self)} by name" if self else "none"
        for name, value in self.items():
            yield name, value_text(value)


def unknown_name(
    label: str, name: object, known: Iterable[str], where: str = ""
) -> UnknownNameError:
    """Make the error about a name that does not exist, with similar names.

    Parameters
    ----------
    label
        What the name was looked up in, as written in Python: ``"result.joints"``.
    name
        The unknown name.
    known
        Names that exist.
    where
        Where all names are listed, such as ``"result.names"``; by default the message lists them.
    """
    names = [str(each) for each in known]
    near = near_names(names, name) if isinstance(name, str) else []
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    listed = f"{where} lists all names" if where else f"its names: {names_or_none(names)}"
    return UnknownNameError(f"{label}[{shown(name)}]: there is no such name: {hint}{listed}")


def first_sentence(cls: type) -> str:
    """First line of a class's documentation, without its full stop; else empty."""
    lines = inspect.cleandoc(cls.__doc__ or "").split("\n")
    return lines[0].rstrip(".")


#: Sections of a class's documentation that list its fields.
SECTIONS = re.compile(r"^(?:Attributes|Parameters)\n-+\n((?:(?!^\S.*\n-+$).*\n?)*)", re.MULTILINE)

#: Names of fields in such a section, and the indented lines about them.
ENTRY = re.compile(r"^(\w[\w, ]*)\n((?:[ ]+.*\n?|\n)+)", re.MULTILINE)


def units_of(cls: type) -> dict[str, str]:
    """Units of the fields of a class by name, see the module; empty for fields with ``[-]``."""
    units: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        for section in SECTIONS.findall(inspect.cleandoc(base.__doc__ or "")):
            for listed, text in ENTRY.findall(section):
                names = [name.strip() for name in listed.split(",")]
                known = ", ".join(re.findall(r"\[([^\]]*[^\W\d][^\]]*|-|%)\]", text)).split(", ")
                known = [_known_unit(symbol) for symbol in known]
                if len(known) != len(names):
                    known = known[-1:] * len(names)
                units |= {name: symbol for name, symbol in zip(names, known, strict=True) if symbol}
        for field in getattr(base, ATTRS_FIELDS, ()):
            if symbol := _known_unit(unit_of(field.metadata.get("help", ""))):
                units[field.name] = symbol
    return {name: "" if symbol == "-" else symbol for name, symbol in units.items()}


def _known_unit(symbol: str) -> str:
    """Return a unit or ``-`` as it is, and an empty text for other words in brackets."""
    return symbol if symbol == "-" or unit(symbol) is not None else ""


def _values(source: object) -> Iterator[tuple[str, Any]]:
    """Yield names and values of an object's fields; default values are omitted, unless all are."""
    fields: Iterable[Any] = getattr(source, ATTRS_FIELDS, ())
    if dataclasses.is_dataclass(source):
        fields = dataclasses.fields(source)
    if not fields:
        yield from ((k, v) for k, v in vars(source).items() if not k.startswith("_"))
        return
    shown_fields = [field for field in fields if not field.name.startswith("_")]
    values = [(field.name, getattr(source, field.name), field.default) for field in shown_fields]
    chosen = [(name, value) for name, value, default in values if not _is_default(value, default)]
    yield from chosen or [(name, value) for name, value, _ in values]


def _is_default(value: Any, default: Any) -> bool:
    """Whether a value is the default of its field, or an empty collection."""
    if _is_array(value):
        return not value.size
    if isinstance(value, tuple | list | dict) and not value:
        return True
    return value is default or (type(value) is type(default) and bool(value == default))


def value_text(value: Any, unit: str = "") -> str:
    """Short text of a value with its unit: numbers, shapes of arrays, names, or the class."""
    unit = getattr(value, "units", "") or unit
    text = _short(value)
    measured = isinstance(value, int | float | complex | tuple | list) or _is_array(value)
    plain = isinstance(value, bool) or unit in ("", "1")
    return text if plain or not measured else f"{text} {unit}"


def _short(value: Any) -> str:
    """Short text of a value without a unit."""
    if isinstance(value, bool | str) or value is None:
        return str(value) if value != "" else "none"
    if isinstance(value, int | float | complex):
        return f"{value:.6g}"
    if _is_array(value):
        return _array_text(value)
    if isinstance(value, Named) or not isinstance(value, Described):
        if isinstance(value, Mapping):
            return names_or_none(str(name) for name in value)
        if isinstance(value, tuple | list):
            if len(value) <= MOST_ENTRIES:
                return ", ".join(_short(entry) for entry in value) or "none"
            return f"{len(value)} entries"
        if isinstance(value, Callable):  # type: ignore[arg-type]
            return getattr(value, "__name__", type(value).__name__)
        shape = " x ".join(map(str, getattr(value, "shape", ())))
        return f"{type(value).__name__} {shape}".rstrip()
    if type(value).described is Described.described:
        return type(value).__name__
    return " ".join(next(iter(value.described())))


def _is_array(value: Any) -> bool:
    """Whether a value is an array or a number of NumPy."""
    return hasattr(value, "dtype") and hasattr(value, "tolist")


def _array_text(values: Any) -> str:
    """Numbers of a small array; shape and range of a larger one."""
    import numpy as np

    if not values.ndim:
        return _short(values.tolist())
    if values.ndim == 1 and values.size <= MOST_ENTRIES:
        return ", ".join(_short(entry) for entry in values.tolist()) or "none"
    text = f"{' x '.join(map(str, values.shape))} values"
    if values.size and values.dtype.kind in "fi" and np.isfinite(values).any():
        text += f" from {np.nanmin(values):.4g} to {np.nanmax(values):.4g}"
    return text


def _shortened(text: str) -> str:
    """Shorten a text to at most `LONGEST_TEXT` characters, in one line."""
    text = " ".join(text.split())
    return text if len(text) <= LONGEST_TEXT else f"{text[: LONGEST_TEXT - 4]} ..."


def names_or_none(names: Iterable[str]) -> str:
    """Names separated by commas; "none" if there are none."""
    return ", ".join(names) or "none"
