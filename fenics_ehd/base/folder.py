"""Folders that the program writes to: by one process at a time, and over nothing but its own files.

``manifest.txt`` lists what the program made in a folder or is about to make, a name a line, that of
a folder with a slash behind. Nothing else is ever removed or replaced, and nothing is done through
a symbolic link. Lines are only ever appended, so that whoever is killed has listed what is there.
"""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Collection, Iterable
from contextlib import ExitStack, suppress
from pathlib import Path

from fenics_ehd.base.errors import InputError, InUseError
from fenics_ehd.base.text_file import read_text
from fenics_ehd.base.whole_file import PART, naming, sync_path

#: Names of what the program made in a folder, and how the list begins.
MANIFEST = "manifest.txt"
HEADER = "fenics_ehd made these in this folder, and may remove or replace them:"


def locked(directory: Path) -> ExitStack:
    """Hold a folder until it is closed; a process that ends holds none.

    Raises
    ------
    InUseError
        Another process has it.
    """
    held, file = ExitStack(), os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    held.callback(os.close, file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        held.close()
        raise InUseError(f"{directory}: another process is writing to this folder") from None
    except OSError:  # a file system without locks
        pass
    return held


def listed(directory: Path) -> tuple[str, ...]:
    """Names in a folder's manifest, none where there is none.

    Raises
    ------
    InputError
        It cannot be read, or names what is not in the folder.
    """
    path = directory / MANIFEST
    if not os.path.lexists(path):
        return ()
    try:
        if path.is_symlink():
            raise OSError("a link")
        lines = read_text(path).split("\n")
        if lines[0] not in ("", HEADER):
            raise OSError(
                "not a list that this program made: move it away, or choose another folder"
            )
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}") from None
    names = tuple(dict.fromkeys(line for line in lines if line not in ("", HEADER)))
    for name in names:
        if name.startswith(".") or "/" in name[:-1] or "\0" in name or name == "/":
            raise InputError(f"{path}: {name!r} is not in this folder: it is no list of a run")
    return names


def claim(directory: Path, names: Iterable[str]) -> None:
    """Take names in a folder, made when missing, for files and folders that are about to be made.

    Raises
    ------
    InputError
        Something there has such a name that is not the program's, or is a link.
    OutputError
        The manifest cannot be written.
    """
    mine, wanted = set(listed(directory)), tuple(names)
    for name in wanted:
        for path in (directory / name, *([] if name[-1] == "/" else [_part(directory / name)])):
            if os.path.lexists(path) and not (name in mine or _empty(path)):
                raise InputError(
                    f"{path}: not of a former run ({MANIFEST} does not list it): move it away, or "
                    "choose another folder"
                )
            mode = path.lstat().st_mode if os.path.lexists(path) else 0
            if mode and not (stat.S_ISDIR if name[-1] == "/" else stat.S_ISREG)(mode):
                raise InputError(f"{path}: a link or device in place of what a run made there")
    manifest, new = directory / MANIFEST, [name for name in wanted if name not in mine]
    with naming(manifest):
        directory.mkdir(parents=True, exist_ok=True)
        for name in mine.intersection(wanted):  # left by a process that was killed
            _part(directory / name).unlink(missing_ok=True)
        if new:
            with open(manifest, "a", opener=_no_link, encoding="utf-8") as file:
                # The last line there may not have been ended.
                file.write("\n".join(["" if file.tell() else HEADER, *new, ""]))
            sync_path(manifest)
            sync_path(directory)


def clear(directory: Path, names: Collection[str] | None = None) -> None:
    """Remove some, or all, of what a folder's manifest lists; folders as far as they are ours.

    Raises
    ------
    InputError
        From `listed`.
    """
    for name in listed(directory):
        path = directory / name
        folder = path.is_dir() and not path.is_symlink()
        if folder != (name[-1] == "/") or (names is not None and name not in names):
            continue
        if folder:
            clear(path)
            let_go(path)
        else:
            for file in filter(os.path.lexists, (path, _part(path))):
                file.unlink()


def let_go(directory: Path, *, folder: bool = True) -> None:
    """Remove the manifest of a folder in which nothing of it is, and the folder if it is empty."""
    if not any((directory / name).exists() for name in listed(directory)):
        (directory / MANIFEST).unlink(missing_ok=True)
        if folder:
            with suppress(OSError):  # something else is in it
                directory.rmdir()


def _part(path: Path) -> Path:
    return path.with_name(path.name + PART)


def _empty(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink() and not any(path.iterdir())


def _no_link(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW, 0o666)
