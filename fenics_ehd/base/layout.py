"""Layouts of stored data: kind and shape of every value, declared once and checked on reading.

The size of an axis is a whole number or a symbol that several values share, as in
``("m", 3, "n")``. The first value with a symbol, in the order of the declaration, determines the
size. ``"n + 3"``, ``"3 n"`` and ``"3 n + 1"`` are linear in one symbol. Symbols in capitals are
numbers of rows that increase during a run; symbols in small letters have the same size in all
states of a model (`sizes_of`).

Headers of all values are checked before the first value is read, so that no memory is allocated for
data of another shape. Values are checked when they are read.

Names in files are the keys of a layout. An entry has `member` if the name of the attribute differs
from the key, so that an attribute can be renamed without a change of files.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

import h5py
import numpy as np

from fenics_ehd.base.sealed_file import is_text, require_stored, values

#: Kinds of values by name. Each one has NumPy's kinds of type, the size in bytes (0: any size), and
#: a description for messages.
KINDS: Mapping[str, tuple[str, int, str]] = {
    "float": ("f", 8, "numbers (float64)"),
    "real": ("fiu", 0, "numbers"),
    "number": ("fiuc", 0, "numbers"),
    "integer": ("iu", 0, "whole numbers"),
    "truth": ("b", 0, "truth values"),
    "text": ("", 0, "text"),
}

#: Sizes of axes by symbol.
Sizes = dict[str, int]

#: Pattern of the size of an axis: factor, symbol, constant.
_AXIS = re.compile(r"(?:(\d+) )?([A-Za-z_]\w*)(?: \+ (\d+))?")


@dataclass(frozen=True)
class Value:
    """Layout of a number, a text, or an array of numbers or texts.

    Attributes
    ----------
    kind
        A key of `KINDS`.
    axes
        Size of every axis; empty for a single value.
    required
        Whether a file without the value is refused.
    finite
        Whether numbers must be finite.
    least
        Smallest number allowed.
    empty
        Whether the value may be unknown; an array with an axis of size 0 is an unknown value.
    attribute
        Whether the value is an HDF5 attribute of its group, not a dataset.
    member
        Name of the Python attribute that has the value; if empty, the name is the key.
    """

    kind: str
    axes: tuple[str | int, ...] = ()
    required: bool = True
    finite: bool = True
    least: float = -math.inf
    empty: bool = False
    attribute: bool = False
    member: str = ""

    def check(self, item: Any, path: str, sizes: Sizes) -> None:
        """Check kind and shape of a dataset or value, and add the sizes of new symbols to `sizes`.

        Raises
        ------
        ValueError
            If kind or shape differs from the declared one; the message has both, and `path`.
        """
        if isinstance(item, Mapping | h5py.Group | h5py.Empty) or item is None:
            raise ValueError(f"{path} is no array")
        if not hasattr(item, "dtype"):
            item = np.asarray(item)
        if item.shape is None:
            raise ValueError(f"{path} is no array")
        kinds, size, words = KINDS[self.kind]
        fits = item.dtype.kind in kinds and item.dtype.itemsize == (size or item.dtype.itemsize)
        if self.kind == "text":  # an empty array may have another type
            fits = is_text(item.dtype) or 0 in item.shape
        if not fits:
            raise ValueError(f"{path} holds {item.dtype}, not {words}")
        unknown = self.empty and len(item.shape) == len(self.axes) and 0 in item.shape
        if not unknown and not _fit(item.shape, self.axes, sizes):
            raise ValueError(f"{path} has shape {item.shape}, not {self._shape(sizes)}")
        if isinstance(item, h5py.Dataset):
            require_stored(item)

    def _shape(self, sizes: Sizes) -> str:
        """Text of the declared shape of the value, with numbers in place of known symbols."""
        axes = (_number(axis, sizes) for axis in self.axes)
        shown = [
            str(axis) if size is None else str(size)
            for axis, size in zip(self.axes, axes, strict=True)
        ]
        return f"({', '.join(shown)}{',' * (len(shown) == 1)})"

    def require_content(self, content: Any, path: str) -> None:
        """Refuse numbers that are not finite or below the smallest number allowed.

        Raises
        ------
        ValueError
            If there is such a number; the message has `path`.
        """
        if self.kind == "text" or np.size(content) == 0:
            return
        if self.finite and not np.isfinite(content).all():
            raise ValueError(f"{path} holds a value that is not finite")
        smallest = np.min(content) if self.least > -math.inf else self.least
        if smallest < self.least:
            raise ValueError(f"{path} holds {smallest:g}, below {self.least:g}")


@dataclass(frozen=True)
class Group:
    """Layout of a group: values and other groups by name.

    Attributes
    ----------
    entries
        Layouts of values and groups by name.
    each
        Layout of every entry that is not in `entries`; each of them has symbols of its own. None:
        such entries are refused.
    required
        Whether a file without the group is refused.
    foreign
        Whether other programs may add entries, which are not read.
    scoped
        Whether symbols that first occur in the group are unknown outside it.
    member
        Name of the Python attribute that has the object of the group; if empty, the name is the
        key.
    """

    entries: Mapping[str, Entry] = field(default_factory=lambda: MappingProxyType({}))
    each: Entry | None = None
    required: bool = True
    foreign: bool = False
    scoped: bool = False
    member: str = ""

    def tree(self, record: Any, **others: Any) -> dict[str, Any]:
        """Collect the values of an object by the keys of this layout, to be stored or checked.

        Parameters
        ----------
        record
            Object whose attributes have the values, or a mapping with the keys of the layout.
            Attributes that are None, and missing keys of a mapping, are omitted.
        others
            Values of keys for which the object has no attribute.
        """
        values = dict(others)
        for key, entry in self.entries.items():
            if key in others:
                continue
            if isinstance(record, Mapping):
                value = record.get(key)
            else:
                value = getattr(record, entry.member or key)
            if value is not None:
                values[key] = _tree(entry, value)
        if isinstance(record, Mapping):
            for key in self._others(record):
                values[key] = _tree(self.each, record[key])
        return values

    def arguments(self, tree: Mapping[str, Any]) -> dict[str, Any]:
        """Keyword arguments for the constructor of the group's object, from the group's content."""
        return {self.entries[key].member or key: value for key, value in tree.items()}

    def check(self, item: Any, path: str, sizes: Sizes) -> None:
        """Check a group and all its entries, see `Value.check`.

        Raises
        ------
        ValueError
            If an entry is missing, unknown, or of another kind or shape; the message has its path.
        """
        if not isinstance(item, Mapping | h5py.Group):
            raise ValueError(f"{path or '/'} is no group")
        for name, entry in self.entries.items():
            holder = _holder(item, entry)
            value = holder[name] if name in holder else None
            if value is not None and isinstance(entry, Group) and entry.scoped:
                _check_scoped(entry, value, f"{path}/{name}", sizes)
            elif value is not None:
                entry.check(value, f"{path}/{name}", sizes)
            elif entry.required:
                raise ValueError(f"{path}/{name} is missing")
        for name in self._others(item):
            if self.each is not None:
                _check_scoped(self.each, item[name], f"{path}/{name}", sizes)
            elif not self.foreign:
                raise ValueError(f"{path}/{name} is not known")

    def value_at(self, path: str) -> Value:
        """Layout of the value at a path in the group, such as ``state/rates``.

        The path must exist in the layout: the group of the file was checked before.
        """
        entry: Entry | None = self
        for name in path.split("/"):
            assert isinstance(entry, Group)
            entry = entry.entries.get(name, entry.each)
        assert isinstance(entry, Value)
        return entry

    def _others(self, item: Any) -> Iterator[str]:
        """Names of the entries that are not in `entries`; their layout is `each`."""
        return (name for name in item if name not in self.entries)

    def read(self, item: Any, path: str = "") -> dict[str, Any]:
        """Read a checked group as a dictionary; single numbers and texts have Python's types.

        Raises
        ------
        ValueError
            If `Value.require_content` refuses a value.
        """
        layouts = {name: e for name, e in self.entries.items() if name in _holder(item, e)}
        if self.each is not None:
            layouts |= dict.fromkeys(self._others(item), self.each)
        contents: dict[str, Any] = {}
        for name, entry in layouts.items():
            label = f"{path}/{name}"
            stored = _holder(item, entry)[name]
            if isinstance(entry, Group):
                contents[name] = entry.read(stored, label)
            else:
                data = isinstance(stored, h5py.Dataset)
                contents[name] = values(stored) if data else _plain(stored)
                if entry.kind == "text" and isinstance(contents[name], np.ndarray):
                    contents[name] = ()
                entry.require_content(contents[name], label)
        return contents


Entry = Value | Group


def _tree(entry: Entry | None, value: Any) -> Any:
    """Convert an object whose layout is a group to its tree; return other values unchanged."""
    return entry.tree(value) if isinstance(entry, Group) else value


def _check_scoped(entry: Entry, item: Any, path: str, sizes: Sizes) -> None:
    """Check an entry in which a new symbol of an axis size has no meaning outside the entry.

    The sizes of such symbols are added to `sizes` by names that begin with the path of the entry.
    """
    if isinstance(item, h5py.Group | h5py.Dataset):
        entry.check(item, path, dict(sizes))
        return
    owner = f"{path} "
    known = {name.removeprefix(owner): n for name, n in sizes.items() if name.startswith(owner)}
    inside = sizes | known
    entry.check(item, path, inside)
    sizes.update({owner + name: n for name, n in inside.items() if name not in sizes})


def _holder(item: Any, entry: Entry) -> Any:
    """Container that has an entry: the group itself, or the HDF5 attributes of the group."""
    return item.attrs if isinstance(entry, Value) and entry.attribute else item


def _plain(value: Any) -> Any:
    """Convert the content of an HDF5 attribute to the types that `values` returns."""
    if isinstance(value, np.ndarray) and value.ndim and (is_text(value.dtype) or not value.size):
        return tuple(text.decode() if isinstance(text, bytes) else str(text) for text in value)
    if isinstance(value, bytes):
        return value.decode()
    return value.item() if isinstance(value, np.generic) else value


def attribute(item: Any, name: str, value: Value) -> Any:
    """Read an attribute of a group or dataset, and check it.

    Raises
    ------
    ValueError
        If the attribute is missing, or has another kind or shape than its layout.
    """
    label = f"attribute {name} of {item.name}"
    if name not in item.attrs:
        raise ValueError(f"{label} is missing")
    value.check(item.attrs[name], label, {})
    content = _plain(item.attrs[name])
    value.require_content(content, label)
    return content


def read_declared(group: h5py.Group, layout: Group) -> dict[str, Any]:
    """Read a group of an HDF5 file, after a check of all headers against its layout.

    Raises
    ------
    ValueError
        If an entry is missing, unknown, of another kind or shape, or not finite.
    """
    layout.check(group, _root(group), {})
    return layout.read(group, _root(group))


def _root(group: h5py.Group) -> str:
    """Path of a group for messages, empty for the root of the file."""
    return "" if group.name == "/" else str(group.name)


def sizes_of(layout: Group, tree: Mapping[str, Any]) -> Sizes:
    """From the tree of one state, the axis sizes that are the same in all states of its model."""
    sizes: Sizes = {}
    layout.check(tree, "", sizes)
    return {name: n for name, n in sizes.items() if not name.rpartition(" ")[2].isupper()}


def _fit(shape: tuple[int, ...], axes: tuple[str | int, ...], sizes: Sizes) -> bool:
    """Whether a shape fits its declaration; sizes of new symbols are added to `sizes`."""
    if len(shape) != len(axes):
        return False
    for size, axis in zip(shape, axes, strict=True):
        known = _number(axis, sizes)
        if known is None:
            assert isinstance(axis, str)
            factor, symbol, constant = _parsed(axis)
            count, rest = divmod(size - constant, factor)
            if rest or count < 0:
                return False
            sizes[symbol] = count
        elif size != known:
            return False
    return True


def _number(axis: str | int, sizes: Sizes) -> int | None:
    """Size of an axis; None if the size of its symbol is still unknown."""
    if isinstance(axis, int):
        return axis
    factor, symbol, constant = _parsed(axis)
    return None if symbol not in sizes else factor * sizes[symbol] + constant


def _parsed(axis: str) -> tuple[int, str, int]:
    """Factor, symbol and constant of the size of an axis: 3, "n" and 1 of ``"3 n + 1"``."""
    match = _AXIS.fullmatch(axis)
    assert match is not None, axis
    return int(match[1] or 1), match[2], int(match[3] or 0)


class Stateful:
    """Base class of objects with a state: attributes that are carried from step to step.

    The state is a dictionary with the keys of `carried`. An attribute that is itself a stateful
    object, or a dictionary of stateful objects, is represented by its state. A state remains
    constant after it is read: the object does not modify its arrays in a step, but makes new ones.
    """

    #: Layout of the state, by key, in memory and in files.
    carried: ClassVar[Mapping[str, Entry]]

    def require_fitting(self, state: Mapping[str, Any]) -> None:
        """Refuse a state that belongs to another model.

        Raises
        ------
        ValueError
            If a value has another kind or shape than in this object; the message names the value.
        """
        layout = Group(self.carried)
        start = self.state
        for name, entry in self.carried.items():
            if isinstance(entry, Group) and (start[name] is None) != (state.get(name) is None):
                raise ValueError(
                    f"/{name} must be in both or none of the stored state and the initial state "
                    "of the run, but is in one of them"
                )
        sizes = sizes_of(layout, layout.tree(start)) | self.known_sizes()
        layout.check(layout.tree(state), "", sizes)

    def known_sizes(self) -> Sizes:
        """Sizes of symbols in `carried`, for symbols that the initial state does not determine."""
        return {}

    @property
    def state(self) -> dict[str, Any]:
        """Values from which a resumed run continues: attributes that `carried` lists, by key."""
        return {
            key: _state_of(getattr(self, entry.member or key))
            for key, entry in self.carried.items()
        }

    @state.setter
    def state(self, state: dict[str, Any]) -> None:
        for key, layout in self.carried.items():
            name = layout.member or key
            part = getattr(self, name)
            value: Any = state.get(key)
            if isinstance(part, Stateful):
                part.state = value
            elif isinstance(part, dict) and any(isinstance(x, Stateful) for x in part.values()):
                for label, member in part.items():
                    member.state = value[label]
            else:
                setattr(self, name, dict(value) if isinstance(value, dict) else value)
        self._resume()

    def _resume(self) -> None:
        """Update attributes that depend on the state; called after the state is set."""


def _state_of(value: Any) -> Any:
    """Copy a value for a state; stateful objects are replaced by their states."""
    if isinstance(value, dict):
        return {name: _state_of(entry) for name, entry in value.items()}
    return value.state if isinstance(value, Stateful) else value
