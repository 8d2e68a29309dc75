"""HDF5 files with a seal: written atomically, and checked before they are read.

The seal is the SHA-256 digest of the data behind the first 512 bytes of a file. It is stored in
these bytes, which HDF5 leaves free for other uses (``head -n 1 body.h5`` shows it). A file that a
disk, a transfer or an editor has changed is refused before HDF5 opens it. The seal protects against
accidents, not against forgery: anybody can seal a changed file again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import Kind, put_in_place, write_whole

#: Number of bytes before the HDF5 superblock.
HEAD = 512

#: First bytes of a sealed file.
_MARK = b"fenics_ehd sha256 "

#: Largest ratio by which the deflate filter of HDF5 can compress data.
_DEFLATE = 1032


@contextmanager
def sealed_hdf5(path: str | Path, kind: str, version: int) -> Iterator[h5py.File]:
    """Yield an HDF5 file in memory; after the block, seal it and write it atomically.

    Parameters
    ----------
    path
        Path of the file.
    kind, version
        Name and version of the format.

    Raises
    ------
    OutputError
        If the file cannot be written; an existing file is then unchanged.
    """
    image = BytesIO()
    with h5py.File(image, "w", userblock_size=HEAD) as file:
        file.attrs.update(format=kind, format_version=version)
        yield file
    content = image.getvalue()[HEAD:]
    write_whole(Path(path), _head(hashlib.sha256(content)) + content)


def save_tree(path: str | Path, tree: Mapping[str, Any], kind: str, version: int) -> None:
    """Write a tree as a sealed file, see `sealed_hdf5` and `put_tree`."""
    with sealed_hdf5(path, kind, version) as file:
        put_tree(file, tree)


def put_tree(group: h5py.Group, tree: Mapping[str, Any]) -> None:
    """Store a tree in an HDF5 group.

    Parameters
    ----------
    group
        Empty HDF5 group.
    tree
        Nested dictionaries of arrays, numbers, texts and tuples of texts; see `Group.tree` in
        `fenics_ehd.base.layout`.
    """
    for name, value in _flat(tree):
        if isinstance(value, Mapping):
            group.create_group(name)
        else:
            text = isinstance(value, tuple)
            group[name] = np.array(value, dtype=h5py.string_dtype()) if text else value


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Path and value of every entry of a tree, sorted by name.

    The value of a group is an empty dictionary; entries that are None are omitted.
    """
    for name, value in sorted(tree.items()):
        if value is None:
            continue
        if isinstance(value, Mapping):
            yield prefix + name, {}
            yield from _flat(value, f"{prefix}{name}/")
        else:
            yield prefix + name, value


def digest(tree: Mapping[str, Any]) -> str:
    """SHA-256 digest of the names and values of a tree, independent of the version of HDF5."""
    checksum = hashlib.sha256()
    for name, value in _flat(tree):
        array = np.asarray(value)
        if not array.dtype.hasobject:
            checksum.update(f"{name} {array.dtype.str} {array.shape} ".encode() + array.tobytes())
    return checksum.hexdigest()


def seal(partial: Path, path: Path) -> None:
    """Seal a file that was written with ``userblock_size=HEAD``, and rename it to `path`.

    An existing file is replaced.
    """
    with open(partial, "r+b") as file:
        file.seek(HEAD)
        head = _head(hashlib.file_digest(file, "sha256"))  # type: ignore[arg-type]
        file.seek(0)
        file.write(head)
    put_in_place(partial, path)


def _head(checksum: Any) -> bytes:
    """First `HEAD` bytes of a sealed file with this checksum."""
    return (_MARK + checksum.hexdigest().encode() + b"\n").ljust(HEAD, b"\0")


def require_file(path: str | Path) -> None:
    """Refuse a folder, device or pipe, whose reading may never end; a missing file is accepted.

    Raises
    ------
    ValueError
        If the path exists and is not a regular file.
    """
    if Path(path).exists() and not Path(path).is_file():
        raise ValueError("not a regular file")


def open_hdf5(path: str | Path, **options: Any) -> h5py.File:
    """Open an HDF5 file for reading; `options` are passed to h5py.

    Raises
    ------
    ValueError, OSError
        If the file is not HDF5, or if it refers to data in other files. Such data are not part of
        the seal, and may be any file of the user.
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
            raise ValueError(f"the data of {outside} are in another file, which is not read")
    except BaseException:
        file.close()
        raise
    return file


#: Number of bytes by which the datasets of a foreign file may exceed its size. Variables of netCDF
#: that were never written occupy no space in a file.
_UNWRITTEN = 1 << 26


def require_own_data(path: str | Path) -> None:
    """Check an HDF5 file before another library reads it.

    Raises
    ------
    ValueError, OSError
        If `open_hdf5` refuses the file, or if its datasets are larger than the file can hold.
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
        raise ValueError(f"{path} declares {claimed} bytes of data, but can hold at most {most}")


def _sealed(path: str | Path) -> bool:
    """Whether a file has a seal; a broken seal is refused.

    Raises
    ------
    ValueError
        If the file was changed after it was sealed, or is not a regular file.
    """
    require_file(path)
    with open(path, "rb") as file:
        head = file.read(HEAD)
        if not head.startswith(_MARK[:8]):
            return False
        if head != _head(hashlib.file_digest(file, "sha256")):
            raise ValueError(
                "the digest does not match the content: the file changed after it was written"
            )
    return True


#: Exceptions that may be raised when a file is damaged, of another kind, or not accessible.
UNREADABLE = (
    OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, MemoryError,
)  # fmt: skip


def stored_as(words: str, kind: str) -> Kind:
    """Make the `Kind` of output files in the format `kind`.

    The version of the format may be any. A file may have no seal, but its seal must not be broken.
    """

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
    """Convert exceptions from reading a file to an error of this package.

    The message of this error is one line that begins with `label`.
    """
    try:
        yield
    except FileNotFoundError:
        raise error(f"{label}: no such file") from None
    except UNREADABLE as cause:
        reason = next(iter(str(cause).splitlines()), type(cause).__name__)
        raise error(f"{label}: {reason.strip(chr(34))}") from cause


def open_sealed(
    path: str | Path,
    kind: str,
    version: int,
    *,
    remedy: str,
    former: Collection[int] = (),
    foreign: bool = False,
) -> h5py.File:
    """Open a file of a format for reading, after its seal is checked.

    Parameters
    ----------
    path, kind, version
        See `save_tree`.
    remedy
        Advice in the message about a file of another version.
    former
        Former versions of the format that are accepted, too.
    foreign
        Whether files without a seal are accepted, as other programs write them.

    Raises
    ------
    ValueError, OSError
        If the file cannot be opened, if its format or version is another, or if its seal is broken
        or missing; `named` converts these errors.
    """
    sealed = _sealed(path)
    file = open_hdf5(path)
    try:
        label = file.attrs.get("format")
        # The format is stored as bytes in histories of version 0.2.
        if not isinstance(label, str | bytes) or label not in (kind, kind.encode()):
            raise ValueError(f"not a {kind}")
        stored = file.attrs.get("format_version")
        if not np.isscalar(stored) or stored not in (version, *former):
            raise ValueError(f"format version {stored}, but this program reads {version}: {remedy}")
        if not (sealed or foreign):
            raise ValueError(f"the file has no digest: {remedy}")
    except BaseException:
        file.close()
        raise
    return file


def values(item: Any, part: slice | tuple[()] = ()) -> Any:
    """Read a dataset of numbers or a `part` of it, or a complete dataset of texts.

    The result is an array or a number, or a tuple of texts or a text.

    Raises
    ------
    ValueError
        If the dataset has neither numbers nor text, or is larger than its file can hold.
    """
    require_numbers(item, "fiub", text=True)
    if item.dtype.kind in "fiub":
        content = item[part]
        return content.item() if isinstance(content, np.generic) else content
    return _texts(item)


#: Number of texts that are read at once.
_TEXTS = 256


def _texts(item: h5py.Dataset) -> str | tuple[str, ...]:
    """Read a dataset of one text, or of several as a tuple.

    Raises
    ------
    ValueError
        If the texts have more characters than the file has bytes: many entries could refer to one
        stored text.
    """
    if not item.shape:
        return str(item.asstr()[()])
    if len(item.shape) != 1:
        raise ValueError(f"{item.name} has shape {item.shape}, but texts must have one axis")
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
    """Whether a data type is that of texts, of fixed or variable length."""
    return kind.kind in "SU" or h5py.check_string_dtype(kind) is not None


def require_numbers(item: Any, kinds: str = "fiu", *, text: bool = False) -> None:
    """Check the header of a dataset, before memory is allocated for it.

    Raises
    ------
    ValueError
        If the item is not a dataset, if its data type is not one of the `kinds` (NumPy's f, i, u,
        b), or if it is larger than its file can hold. Texts are accepted if `text` is true.
    """
    if not isinstance(item, h5py.Dataset) or item.shape is None:
        raise ValueError(f"{item.name} is no array")
    if item.dtype.kind not in kinds and not (text and h5py.check_string_dtype(item.dtype)):
        raise ValueError(f"{item.name} holds {item.dtype}, not numbers of NumPy's kinds {kinds}")
    require_stored(item)


#: Numbers of the HDF5 filters that compress: deflate, szip, nbit, scale-offset, LZF.
_PACKING = (1, 4, 5, 6, 32000)


def require_stored(item: h5py.Dataset) -> None:
    """Refuse a dataset with more bytes than its stored data can contain, even if compressed.

    Data that were never written occupy no space in a file, so that any shape can be declared.

    Raises
    ------
    ValueError
        If the dataset is too large; the message has its bytes and the limit.
    """
    filters = item.id.get_create_plist()
    numbers = [filters.get_filter(i)[0] for i in range(filters.get_nfilters())]
    packings = sum(number in _PACKING for number in numbers)
    if packings > 1:
        raise ValueError(f"{item.name} is compressed {packings} times, but once is the limit")
    most = item.id.get_storage_size() * (_DEFLATE if packings else 1)
    if item.nbytes > most:
        raise ValueError(
            f"{item.name} declares {item.nbytes} bytes, but its file can hold at most {most}"
        )
