"""Files of a user and of this program: text read, results written whole, folders held.

Results are there whole or not at all, whatever ends the program or fills the disk. A folder is
written to by one process at a time, and over nothing but the program's own files: ``manifest.txt``
lists what the program made in a folder or is about to make, a name a line, that of
a folder with a slash behind. Nothing else is ever removed or replaced, and nothing is done through
a symbolic link. Lines are only ever appended, so that whoever is killed has listed what is there.
"""

from __future__ import annotations

import fcntl
import io
import json
import math
import os
import platform
import stat
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

from fenics_ehd import __version__
from fenics_ehd.base.errors import CavitationError, EhdError, InputError, InUseError, OutputError
from fenics_ehd.base.libraries import version_of


def read_text(path: str | Path) -> str:
    """Text of a file in UTF-8, with or without a byte order mark.

    Raises
    ------
    OSError
        It cannot be read, or is none: a pipe would be waited for, a device has no end.
    UnicodeDecodeError
        It holds something else.
    """
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(0, "a folder, pipe or device, not a file")
    return Path(path).read_text(encoding="utf-8-sig")


def read_json(path: str | Path) -> Any:
    """Content of a JSON file.

    Raises
    ------
    OSError, ValueError
        See `read_text`, or it is no JSON, or holds a number that is not finite.
    """
    try:
        return json.loads(read_text(path), parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise ValueError("brackets within brackets without end") from None


def _finite(text: str) -> float:
    """Number of a JSON text, which the program writes as null if it is not finite."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is no finite number")
    return value


#: Room for what HDF5 notes of its datasets [bytes].
BOOKKEEPING = 1 << 18

#: How the name ends that a file has until it is whole.
PART = ".part"


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Have failures to write name the file.

    Raises
    ------
    OutputError
        In place of an `OSError`.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise OutputError(f"{path}: {reason}") from error


def write_whole(path: Path, content: str | bytes | memoryview) -> None:
    """Write a file aside, put it on the disk and rename it; links are replaced, not followed.

    Raises
    ------
    OutputError
        It cannot be written; a former file of that name is as it was.
    """
    with naming(path):
        partial = new_part(path)
        try:
            with open(partial, "wb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
            put_in_place(partial, path)
        except BaseException:
            with suppress(OSError):
                partial.unlink()
            raise


def new_part(path: Path) -> Path:
    """An empty file beside another one, to become it: nobody else's, and no former one."""
    partial = path.with_name(path.name + PART)
    while True:
        try:
            partial.open("xb").close()
            return partial
        except FileExistsError:
            partial = path.with_name(f"{path.name}.{token_hex(4)}{PART}")


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Path of the same name in a folder of its own, for a program to write; it then becomes `path`.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with naming(path), TemporaryDirectory(dir=path.absolute().parent) as folder:
        aside = Path(folder, path.name)
        yield aside
        put_in_place(aside, path)


def put_in_place(partial: Path, path: Path) -> None:
    """Have a written file on the disk before it gets its name, in place of a former one."""
    sync_path(partial)
    partial.replace(path)
    sync_path(path.parent)


def require_room(path: Path, size: int) -> None:
    """Refuse what the disk has no room for: HDF5 crashes where it cannot write.

    Parameters
    ----------
    path
        File, created when missing.
    size
        By which it is about to grow [bytes].

    Raises
    ------
    OSError
        There is none.
    """
    with open(path, "ab") as file:
        end = file.tell()
        try:
            os.posix_fallocate(file.fileno(), end, size)
        finally:
            file.truncate(end)


def sync_path(path: Path) -> None:
    """Have the system write a file, or a folder's entries, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


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


#: Where the film of a failed solve is kept.
FAILED_FILM = "failed_film.h5"

#: Errors of a run over time, by component.
ERROR_BUDGET = "error_budget.json"

#: How settings were chosen that meet an accuracy.
ACCURACY = "accuracy.json"

#: Figures of a run and how it ended, written last.
SUMMARY = "summary.json"

#: Scene of a run, beside its history.
SCENE_NAME = "scene.toml"

#: What pictures of runs show, in which order: their files have these names; joints, and what
#: several runs make of them, may follow.
PICTURES = (
    "max_pressure",
    "min_film_thickness",
    "orbit",
    "force",
    "eccentricity",
    "places",
    "friction",
    "flow",
    "contact",
    "oil_content",
    "basis_error",
    "error_budget",
    "pressure_map",
    "film_map",
    "contact_map",
    "bore",
    "energy",
)

#: Formats of each of them.
PICTURE_FORMATS = ("png", "svg")


def require_writable(path: str | Path) -> None:
    """Refuse an output path early, before any work is done for it.

    Raises
    ------
    InputError
        Neither the path nor the nearest folder above it can be written to, or the path is a
        device or a pipe.
    """
    existing = Path(path).absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if existing != Path(path).absolute() and not existing.is_dir():
        raise InputError(f"output {path}: {existing} is not a folder")
    if not (existing.is_dir() or existing.is_file()):
        raise InputError(f"output {path}: {existing} is neither a file nor a folder")
    if not os.access(existing, os.W_OK):
        raise InputError(
            f"output {path}: no permission to write to {existing}; with Docker, mkdir -p results "
            'and give docker run --user "$(id -u):$(id -g)"'
        )
    if existing.is_dir():
        try:
            # Permission is not all: a file system may be read-only, full or no real one.
            with TemporaryFile(dir=existing):
                pass
        except OSError as error:
            raise InputError(f"output {path}: {existing}: {error.strerror}") from None


def complete_result(directory: Path) -> dict[str, Any] | None:
    """Summary of the complete result in a folder, None where there is none."""
    summary = _summary(directory)
    return summary if summary.get("status") == "complete" else None


def require_complete(directory: Path) -> dict[str, Any]:
    """Summary of the complete result in a folder.

    Raises
    ------
    InputError
        There is no such folder, no result in it, or one that is not complete.
    """
    path = directory / SUMMARY
    try:
        summary = read_json(path) if path.is_file() else {}
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a summary of a run: {error}") from None
    if not isinstance(summary, dict) or summary.get("status") != "complete":
        summary = summary if isinstance(summary, dict) else {}
        missing = f"it has no {SUMMARY} of one" if directory.is_dir() else "no such folder"
        raise InputError(f"{directory}: no complete run: {summary.get('status', missing)}")
    return summary


def _summary(directory: Path) -> dict[str, Any]:
    """Summary in a folder, empty where there is none."""
    with suppress(OSError, ValueError):
        summary = read_json(directory / SUMMARY)
        if isinstance(summary, dict):
            return summary
    return {}


def write_summary(directory: str | Path, summary: Mapping[str, object]) -> None:
    """Write ``summary.json``, whole or not at all."""
    write_whole(Path(directory) / SUMMARY, to_json(summary) + "\n")


@contextmanager
def keeping_failed_film(directory: str | Path) -> Iterator[None]:
    """Save the film of a `CavitationError` that ends a command, itself or as the cause.

    Raises
    ------
    EhdError
        The error, its message naming the file.
    """
    try:
        yield
    except EhdError as error:
        cause: BaseException | None = error
        while cause is not None and not (isinstance(cause, CavitationError) and cause.state):
            cause = cause.__cause__
        if cause is None:
            raise
        path = Path(directory) / FAILED_FILM
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        import h5py  # slow to import, and texts do without

        # HDF5 crashes where it cannot write.
        content = io.BytesIO()
        with h5py.File(content, "w") as file:
            for name, values in cause.state.items():
                file[name] = values
        write_whole(path, content.getvalue())
        raise type(error)(f"{error}; the film is kept in {path}") from error


def to_json(values: Mapping[str, object]) -> str:
    """JSON text; a number that is not finite becomes null, which JSON has."""
    return json.dumps(_plain(values), indent=2, allow_nan=False)


def _plain(value: object) -> object:
    """A value with null in the place of numbers that are not finite, at any depth."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def versions(*, installed: bool = False) -> dict[str, str]:
    """Versions of everything that takes part in a result, or of everything that could."""
    names = ("numpy", "scipy", "h5py", "petsc4py", "slepc4py", "dolfinx", "gmsh", "matplotlib")
    return {
        "fenics_ehd": __version__,
        "python": platform.python_version(),
        **{name: version_of(name) for name in names if installed or name in sys.modules},
    }
