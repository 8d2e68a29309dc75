"""HDF5 files of this program: sealed, written whole or not at all, read with suspicion.

The seal is the SHA-256 digest of all that follows it, in the 512 bytes that HDF5 leaves to its
users at the head of a file (``head -n 1 body.h5`` shows it). What a disk, a transfer or an editor
changed is found before HDF5 sees the file. It protects against accidents, not against forgers:
whoever changes a file on purpose can seal it again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import Kind, put_in_place, write_whole

#: Bytes before the HDF5 superblock, and how they begin.
HEAD = 512
_MARK = b"fenics_ehd sha256 "

#: Most bytes that a byte of a file can stand for: the ratio of deflate.
_DEFLATE = 1032


@contextmanager
def sealed_hdf5(path: str | Path, kind: str, version: int) -> Iterator[h5py.File]:
    """A file to fill, made in memory, sealed, and on the disk whole before it replaces another.

    Parameters
    ----------
    path
        File.
    kind, version
        Name and version of the format.

    Raises
    ------
    OutputError
        It cannot be written; a former file stays.
    """
    image = BytesIO()
    with h5py.File(image, "w", userblock_size=HEAD) as file:
        file.attrs.update(format=kind, format_version=version)
        yield file
    content = image.getvalue()[HEAD:]
    write_whole(Path(path), _head(hashlib.sha256(content)) + content)


def save_tree(path: str | Path, tree: Mapping[str, Any], kind: str, version: int) -> None:
    """Write a tree as a file of its own, see `sealed_hdf5` and `put_tree`."""
    with sealed_hdf5(path, kind, version) as file:
        put_tree(file, tree)


def put_tree(group: h5py.Group, tree: Mapping[str, Any]) -> None:
    """Store a tree in a group.

    Parameters
    ----------
    group
        Empty.
    tree
        Dictionaries of the same, arrays, numbers, text and tuples of text; see `Group.tree` in
        `fenics_ehd.base.layout`.
    """
    for name, value in _flat(tree):
        if isinstance(value, Mapping):
            group.create_group(name)
        else:
            text = isinstance(value, tuple)
            group[name] = np.array(value, dtype=h5py.string_dtype()) if text else value


def _flat(tree: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    """Every group, empty, and every value but None of a tree by its path, in order of the names."""
    for name, value in sorted(tree.items()):
        if value is None:
            continue
        if isinstance(value, Mapping):
            yield place + name, {}
            yield from _flat(value, f"{place}{name}/")
        else:
            yield place + name, value


def digest(tree: Mapping[str, Any]) -> str:
    """SHA-256 of the values of a tree, whatever program or version of HDF5 stored it."""
    found = hashlib.sha256()
    for name, value in _flat(tree):
        array = np.asarray(value)
        if not array.dtype.hasobject:
            found.update(f"{name} {array.dtype.str} {array.shape} ".encode() + array.tobytes())
    return found.hexdigest()


def seal(partial: Path, path: Path) -> None:
    """Seal a file written with ``userblock_size=HEAD``, and rename it over a former one."""
    with open(partial, "r+b") as file:
        file.seek(HEAD)
        head = _head(hashlib.file_digest(file, "sha256"))  # type: ignore[arg-type]
        file.seek(0)
        file.write(head)
    put_in_place(partial, path)


def _head(found: Any) -> bytes:
    return (_MARK + found.hexdigest().encode() + b"\n").ljust(HEAD, b"\0")


def require_file(path: str | Path) -> None:
    """Refuse a folder, a pipe, which would be waited for, or a device; what is missing is not."""
    if Path(path).exists() and not Path(path).is_file():
        raise ValueError("not a regular file")


def open_hdf5(path: str | Path, **options: Any) -> h5py.File:
    """Open an HDF5 file for reading, `options` as h5py has them.

    Raises
    ------
    ValueError, OSError
        It is none, or data of it lie in other files: what these hold is in no digest, and may be
        any file of the reader's.
    """
    require_file(path)
    file = h5py.File(path, "r", **options)

    def linked(name: bytes, link: Any) -> str | None:
        return None if link.type in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT) else name.decode()

    def stored(name: str, item: Any) -> str | None:
        outside = isinstance(item, h5py.Dataset) and (item.is_virtual or item.external)
        return name if outside else None

    try:
        outside = file.id.links.visit(linked, info=True) or file.visititems(stored)
        if outside:
            raise ValueError(f"{outside} lies in another file, which is not followed")
    except BaseException:
        file.close()
        raise
    return file


#: Bytes that datasets of a foreign file may claim beyond what it can hold: variables of netCDF
#: that were never written take no room.
_UNWRITTEN = 1 << 26


def require_own_data(path: str | Path) -> None:
    """Refuse an HDF5 file for another library to read: data elsewhere, more than it can hold.

    Raises
    ------
    ValueError, OSError
        See `open_hdf5`; or its datasets together claim more than the file can hold.
    """
    claimed = 0

    def count(_: str, item: Any) -> None:
        nonlocal claimed
        if isinstance(item, h5py.Dataset) and item.shape is not None:
            claimed += int(item.nbytes)

    with open_hdf5(path) as file:
        file.visititems(count)
    most = Path(path).stat().st_size * _DEFLATE + _UNWRITTEN
    if claimed > most:
        raise ValueError(f"{path} claims {claimed} bytes, it can hold {most}")


def _sealed(path: str | Path) -> bool:
    """True for a file that has a seal.

    Raises
    ------
    ValueError
        It has one, and is not what was sealed; or it is no regular file.
    """
    require_file(path)
    with open(path, "rb") as file:
        head = file.read(HEAD)
        if not head.startswith(_MARK[:8]):
            return False
        if head != _head(hashlib.file_digest(file, "sha256")):
            raise ValueError("its digest is not that of its content: it changed after it was made")
    return True


#: What reading a file may raise that is damaged, of another kind, or out of reach.
UNREADABLE = (
    OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, MemoryError,
)  # fmt: skip


def stored_as(words: str, kind: str) -> Kind:
    """Kind of the output files of a format, of any version; a broken seal makes a file of none."""

    def holds(path: Path) -> bool:
        try:
            _sealed(path)  # HDF5 may crash on a file that changed
            with open_hdf5(path) as file:
                label = file.attrs.get("format")
        except UNREADABLE:
            return False
        return isinstance(label, str) and label == kind

    return Kind(words, holds)


@contextmanager
def named(error: type[InputError], label: str) -> Iterator[None]:
    """Turn what reading a file may raise into one line of an error of this package."""
    try:
        yield
    except FileNotFoundError:
        raise error(f"{label}: no such file") from None
    except UNREADABLE as cause:
        reason = next(iter(str(cause).splitlines()), type(cause).__name__)
        raise error(f"{label}: {reason.strip(chr(34))}") from cause


def open_sealed(
    path: str | Path, kind: str, version: int, *, remedy: str, foreign: bool = False
) -> h5py.File:
    """Open a file of a format for reading, once its seal is found whole.

    Parameters
    ----------
    path, kind, version
        As in `save_tree`.
    remedy
        What to do about another version.
    foreign
        Other programs write such files, too: they may do without the seal.

    Raises
    ------
    ValueError, OSError
        See `named`.
    """
    sealed = _sealed(path)
    file = open_hdf5(path)
    try:
        label = file.attrs.get("format")
        # Bytes in histories of version 0.2.
        if not isinstance(label, str | bytes) or label not in (kind, kind.encode()):
            raise ValueError(f"not a {kind}")
        found = file.attrs.get("format_version")
        if not np.isscalar(found) or found != version:
            raise ValueError(f"format version {found}, this program reads {version}; {remedy}")
        if not (sealed or foreign):
            raise ValueError(f"it has no digest: {remedy}")
    except BaseException:
        file.close()
        raise
    return file


def values(item: Any, part: slice | tuple[()] = ()) -> Any:
    """A dataset, or rows of one of numbers: an array of numbers, a tuple of text, or one of them.

    Raises
    ------
    ValueError
        It holds something else, or more than its file can.
    """
    require_numbers(item, "fiub", text=True)
    if item.dtype.kind in "fiub":
        found = item[part]
        return found.item() if isinstance(found, np.generic) else found
    return _texts(item)


#: Texts read at a time.
_TEXTS = 256


def _texts(item: h5py.Dataset) -> str | tuple[str, ...]:
    """A text, or a tuple of them; many that share their characters are refused.

    Raises
    ------
    ValueError
        They have more characters than their file has bytes.
    """
    if not item.shape:
        return str(item.asstr()[()])
    if len(item.shape) != 1:
        raise ValueError(f"{item.name} has shape {item.shape}, texts have one axis")
    most = Path(item.file.filename).stat().st_size
    texts: list[str] = []
    total = 0
    for start in range(0, len(item), _TEXTS):
        some = [str(text) for text in item.asstr()[start : start + _TEXTS]]
        total += sum(map(len, some))
        if total > most:
            raise ValueError(f"{item.name} has more characters than its file has bytes")
        texts += some
    return tuple(texts)


def is_text(kind: np.dtype) -> bool:
    """True of the type of text, of fixed length or any."""
    return kind.kind in "SU" or h5py.check_string_dtype(kind) is not None


def require_numbers(item: Any, kinds: str = "fiu", *, text: bool = False) -> None:
    """Refuse a dataset by its header, before memory is taken for it.

    Raises
    ------
    ValueError
        It is no dataset, holds no numbers of these kinds (f, i, u), or claims more than is stored.
    """
    if not isinstance(item, h5py.Dataset) or item.shape is None:
        raise ValueError(f"{item.name} is no array")
    if item.dtype.kind not in kinds and not (text and h5py.check_string_dtype(item.dtype)):
        raise ValueError(f"{item.name} holds {item.dtype}, not numbers of the kind it must")
    require_stored(item)


#: Filters that make data smaller, by their number in HDF5: deflate, szip, nbit, scale-offset, LZF.
_PACKING = (1, 4, 5, 6, 32000)


def require_stored(item: h5py.Dataset) -> None:
    """Refuse a dataset whose shape has more bytes than those stored for it can hold, unpacked.

    Data that were never written take no room in a file, at any shape.

    Raises
    ------
    ValueError
        Naming the dataset, its claim and what is stored.
    """
    filters = item.id.get_create_plist()
    numbers = [filters.get_filter(i)[0] for i in range(filters.get_nfilters())]
    packings = sum(number in _PACKING for number in numbers)
    if packings > 1:
        raise ValueError(f"{item.name} is packed {packings} times")
    most = item.id.get_storage_size() * (_DEFLATE if packings else 1)
    if item.nbytes > most:
        raise ValueError(f"{item.name} claims {item.nbytes} bytes, its file can hold {most}")
