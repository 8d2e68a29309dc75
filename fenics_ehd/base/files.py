"""Reading of text files, atomic writing of results, and folders of results with their manifests.

Writes are atomic: a result is complete or absent, even after a crash or with a full disk. One
process at a time writes to a folder, and only files that this program made are replaced or removed.
``manifest.txt`` lists these files, one name per line; names of folders end with a slash. A name is
appended before its file is made, so that the manifest is complete even if the process is killed.
Symbolic links are never followed.

A line ``key: value`` with a known key is not a name but a property of the folder. ``command: run``
is the command that made the folder; other commands do not write there.

Imports inside functions: h5py is slow to import, and reading texts does not need it.
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
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

from fenics_ehd import __version__
from fenics_ehd.base.errors import (
    CavitationError,
    EhdError,
    InputError,
    InUseError,
    OutputError,
    SettingsError,
)
from fenics_ehd.base.libraries import version_of


def read_text(path: str | Path) -> str:
    """Read a text file in UTF-8, with or without a byte order mark.

    Raises
    ------
    OSError
        If the file cannot be read, or is a folder, a pipe or a device, whose reading may never
        end.
    UnicodeDecodeError
        If the file is not in UTF-8.
    """
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(0, "a folder, pipe or device, not a file")
    return Path(path).read_text(encoding="utf-8-sig")


def read_json(path: str | Path) -> Any:
    """Read a JSON file.

    Raises
    ------
    OSError, ValueError
        If `read_text` cannot read the file, if it is not JSON, or if it has a number that is not
        finite.
    """
    try:
        return json.loads(read_text(path), parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None


def _finite(text: str) -> float:
    """Convert the text of a JSON number to a float, and refuse infinity and NaN.

    This program stores numbers that are not finite as null, see `to_json`.

    Raises
    ------
    ValueError
        If the number is not finite.
    """
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not a finite number")
    return value


def user_cache() -> Path:
    """Folder of the user's caches.

    A relative path in ``XDG_CACHE_HOME`` is ignored, as the specification of this variable demands.
    Files would otherwise be read from the current folder.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return cache if cache.is_absolute() else Path.home() / ".cache"


#: Environment variable with the path of the folder of reduced bodies, or with `CACHE_OFF`, and the
#: value with which no bodies are kept; see `fenics_ehd.scenes.kept_bodies`.
CACHE_VARIABLE = "FENICS_EHD_CACHE"
CACHE_OFF = "off"

#: Space on the disk that is reserved for the metadata of an HDF5 file [bytes].
BOOKKEEPING = 1 << 18

#: Extension of a file that is being written.
PART = ".part"


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Convert an `OSError` in the block to an error whose message has the path.

    Raises
    ------
    OutputError
        If an `OSError` is raised in the block.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise OutputError(f"{path}: {reason}") from error


def write_whole(path: Path, content: str | bytes | memoryview) -> None:
    """Write a file under a temporary name, sync it to the disk, and rename it to its path.

    An existing file or link is replaced.

    Raises
    ------
    OutputError
        If the file cannot be written; an existing file is then unchanged.
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
    """Make an empty file in the folder of `path`, to be written and then renamed to `path`."""
    partial = path.with_name(path.name + PART)
    while True:
        try:
            partial.open("xb").close()
            return partial
        except FileExistsError:
            partial = path.with_name(f"{path.name}.{token_hex(4)}{PART}")


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Yield a path with the same file name in a temporary folder.

    After the block, the file that was written there is moved to `path`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with naming(path), TemporaryDirectory(dir=path.absolute().parent) as folder:
        aside = Path(folder, path.name)
        yield aside
        put_in_place(aside, path)


def put_in_place(partial: Path, path: Path) -> None:
    """Sync a written file to the disk, then rename it to `path`, replacing an existing file."""
    sync_path(partial)
    partial.replace(path)
    sync_path(path.parent)


def require_room(path: Path, size: int) -> None:
    """Check that the disk has room for a file: HDF5 crashes if the disk is full.

    Parameters
    ----------
    path
        Path of the file, which is created if it is missing.
    size
        Number of bytes by which the file will grow.

    Raises
    ------
    OSError
        If the disk has less free space.
    """
    with open(path, "ab") as file:
        end = file.tell()
        try:
            os.posix_fallocate(file.fileno(), end, size)
        finally:
            file.truncate(end)


def sync_path(path: Path) -> None:
    """Sync a file, or the entries of a folder, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


#: Name of the manifest, the list of the program's files in a folder.
MANIFEST = "manifest.txt"

#: First line of a manifest.
HEADER = "fenics_ehd made these in this folder, and may remove or replace them:"


def lock_taken(descriptor: int) -> bool:
    """Lock an open file or folder; return False if another process has locked it.

    The lock ends with the process. On a file system without locks, the result is always True.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def locked(directory: Path) -> ExitStack:
    """Lock a folder until the returned stack is closed, or the process ends.

    Raises
    ------
    InUseError
        If another process has locked the folder.
    """
    held = ExitStack()
    file = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    held.callback(os.close, file)
    if not lock_taken(file):
        held.close()
        raise InUseError(f"{directory}: another process is writing to this folder")
    return held


#: Key in a manifest of the command that made the folder.
COMMAND = "command"

#: All keys of a manifest.
KEYS = (COMMAND,)

#: Name of the file with status and figures of a run in a sweep or study of versions before 0.4.
OUTCOME = "outcome.json"

#: Commands by file names in manifests of version 0.3, which do not have the key of the command.
SIGNATURES = {
    "study.json": "study",
    "sweep.json": "sweep",
    "sweep.csv": "sweep",
    "history.h5": "run",
    "history.csv": "run",
    "run.pvd": "paraview",
}

#: Extension of the files that ``paraview`` writes, which may be all that a manifest of 0.3 has.
FIELDS_ENDING = ".vtu"


def made_by(directory: Path) -> str:
    """Command that made a folder, from the key or the file names in its manifest.

    The text is empty if the command is unknown. If a folder has no manifest, but is listed in the
    manifest of its parent folder, the result is the command that made the parent folder.

    Raises
    ------
    InputError
        If the manifest cannot be used.
    """
    entries = _entries(directory)
    if COMMAND in entries:
        return entries[COMMAND]
    names = listed(directory)
    if OUTCOME in names:
        return made_by(directory.absolute().parent.parent) or "sweep"
    for name, command in SIGNATURES.items():
        if name in names:
            return command
    for name in ("study.json", "sweep.json"):  # a study or sweep whose manifest was removed
        if (directory / name).is_file():
            return SIGNATURES[name]
    if any(name.endswith(FIELDS_ENDING) for name in names):
        return "paraview"
    if is_part(directory):
        return made_by(directory.absolute().parent)
    return "plot" if names else ""


def is_part(directory: Path) -> bool:
    """Whether a folder is listed in the manifest of its parent folder."""
    absolute = Path(os.path.abspath(directory))
    if absolute == absolute.parent:
        return False
    with suppress(InputError):
        return f"{absolute.name}/" in listed(absolute.parent)
    return False


def require_made_by(directory: Path, command: str) -> None:
    """Refuse a folder that another command made.

    Raises
    ------
    InputError
        If another command made the folder; the message has both commands.
    """
    maker = made_by(directory)
    if maker not in ("", command):
        raise InputError(
            f"{directory} was made by fenics-ehd {maker}, not by {command}: choose another folder"
        )


def _entries(directory: Path) -> dict[str, str]:
    """Values of the keys in a folder's manifest; the first line of a repeated key counts."""
    pairs = (line.partition(": ") for line in _lines(directory) if _is_entry(line))
    entries: dict[str, str] = {}
    for key, _, value in pairs:
        entries.setdefault(key, value)
    return entries


def _is_entry(line: str) -> bool:
    """Whether a line of a manifest is a known key with its value, not a name."""
    key, colon, _ = line.partition(": ")
    return bool(colon) and key in KEYS


def listed(directory: Path) -> tuple[str, ...]:
    """File and folder names in the manifest of a folder; empty if there is no manifest.

    Raises
    ------
    InputError
        If the manifest cannot be read, or has names that are not in the folder itself.
    """
    path = directory / MANIFEST
    names = tuple(line for line in _lines(directory) if not _is_entry(line))
    for name in names:
        if name.startswith(".") or "/" in name[:-1] or "\0" in name or name == "/":
            raise InputError(
                f"{path}: {name!r} is not the name of a file in this folder: fenics-ehd did not "
                "write this list"
            )
    return names


def _lines(directory: Path) -> tuple[str, ...]:
    """Distinct lines of the manifest of a folder, without its first line.

    Raises
    ------
    InputError
        If the manifest cannot be read, or if the file is not a manifest.
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
                "fenics-ehd did not write this list: move it away, or choose another folder"
            )
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}") from None
    return tuple(dict.fromkeys(line for line in lines if line not in ("", HEADER)))


def claim(directory: Path, names: Iterable[str], command: str = "") -> None:
    """Append names to the manifest of a folder, before their files are made.

    Parameters
    ----------
    directory
        Path of the folder, which is created if it is missing.
    names
        Names of files and folders that will be made in the folder.
    command
        Command that makes the folder; if empty, the command in the manifest is not changed.

    Raises
    ------
    InputError
        If a file with such a name was not made by this program or is a link, or if another
        command made the folder.
    OutputError
        If the manifest cannot be written.
    """
    if command:
        require_made_by(directory, command)
    listed_before = set(listed(directory))
    wanted = tuple(names)
    for name in wanted:
        _require_claimable(directory, name, name in listed_before)
    lines = [name for name in wanted if name not in listed_before]
    if command and COMMAND not in _entries(directory):
        lines.insert(0, f"{COMMAND}: {command}")
    with naming(directory / MANIFEST):
        directory.mkdir(parents=True, exist_ok=True)
        for name in listed_before.intersection(wanted):  # a killed process may have left a part
            _part(directory / name).unlink(missing_ok=True)
        if lines:
            _append(directory / MANIFEST, lines)


def _require_claimable(directory: Path, name: str, in_manifest: bool) -> None:
    """Refuse the name of a file or folder that the program did not make.

    Raises
    ------
    InputError
        If a file with this name is not in the manifest, or is a link or a device.
    """
    folder = name[-1] == "/"
    path = directory / name
    for existing in filter(os.path.lexists, (path,) if folder else (path, _part(path))):
        if not (in_manifest or _empty(existing)):
            raise InputError(
                f"{existing} exists and is not from a former run ({MANIFEST} does not list it): "
                "move it away, or choose another folder"
            )
        if not (stat.S_ISDIR if folder else stat.S_ISREG)(existing.lstat().st_mode):
            raise InputError(
                f"{existing} is a link or a device, but a {'folder' if folder else 'file'} must "
                "be written there: move it away, or choose another folder"
            )


def _append(manifest: Path, lines: Iterable[str]) -> None:
    """Append lines to a manifest and sync it to the disk."""
    with open(manifest, "a", opener=_no_link, encoding="utf-8") as file:
        # The last line of the manifest may lack its line break.
        file.write("\n".join(["" if file.tell() else HEADER, *lines, ""]))
    sync_path(manifest)
    sync_path(manifest.parent)


def clear(directory: Path, names: Collection[str] | None = None) -> None:
    """Remove the files and folders that the manifest of a folder lists.

    In subfolders, too, only files that are listed in the manifest of their folder are removed. If
    `names` is not None, files and folders with other names are kept.

    Raises
    ------
    InputError
        If a manifest cannot be used, see `listed`.
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
    """Remove the manifest of a folder if no listed file exists.

    If `folder` is true and the folder is then empty, the folder is removed, too.
    """
    if not any((directory / name).exists() for name in listed(directory)):
        (directory / MANIFEST).unlink(missing_ok=True)
        if folder:
            with suppress(OSError):  # the folder has other files
                directory.rmdir()


def _part(path: Path) -> Path:
    """Temporary name of a file that is being written."""
    return path.with_name(path.name + PART)


def _empty(path: Path) -> bool:
    """Whether a path is an empty folder."""
    return path.is_dir() and not path.is_symlink() and not any(path.iterdir())


def _no_link(path: str, flags: int) -> int:
    """Open a file that is not a symbolic link."""
    return os.open(path, flags | os.O_NOFOLLOW, 0o666)


#: Name of the file with the film of a failed solve.
FAILED_FILM = "failed_film.h5"

#: Name of the file with the error budget of a run over time.
ERROR_BUDGET = "error_budget.json"

#: Name of the file with the search for settings that meet an accuracy.
ACCURACY = "accuracy.json"

#: Name of the file with the summary of a run, its figures and status; it is written last.
SUMMARY = "summary.json"

#: Name of the file with the scene of a run, in the folder of its history.
SCENE_NAME = "scene.toml"

#: Names of pictures of runs, in the order of drawing. A file name may also have the name of a
#: joint, and names of runs if the picture compares several.
PICTURES = (
    "max_pressure",
    "min_film_thickness",
    "orbit",
    "force",
    "specific_load",
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

#: File formats of every picture.
PICTURE_FORMATS = ("png", "svg")


def require_writable(path: str | Path) -> None:
    """Refuse an output path that cannot be written to, before a computation begins.

    Raises
    ------
    InputError
        If the path, or the nearest existing folder above it, cannot be written to, or if the path
        is a device or a pipe.
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
            # Permissions may be right on a file system that is read-only or full.
            with TemporaryFile(dir=existing):
                pass
        except OSError as error:
            raise InputError(f"output {path}: {existing}: {error.strerror}") from None


@dataclass(frozen=True)
class Kind:
    """Kind of an output file, which is recognised before a file is replaced.

    Attributes
    ----------
    words
        Name of the kind with its article, for messages.
    holds
        Function of the path of a file, which exists and is not empty. It returns whether the file
        is of this kind.
    """

    words: str
    holds: Callable[[Path], bool]


def beginning_with(words: str, *signatures: bytes, at: int = 0) -> Kind:
    """Make the kind of files that have one of the `signatures` at byte `at`, counted from 0."""

    def holds(path: Path) -> bool:
        with open(path, "rb") as file:
            file.seek(at)
            return file.read(max(map(len, signatures))).startswith(signatures)

    return Kind(words, holds)


def require_output(
    path: str | Path, kind: Kind, inputs: Iterable[str | Path] = (), option: str = "-o"
) -> None:
    """Refuse an output file that would replace an input file or a file of another kind.

    An empty file may be replaced, as `mktemp` makes one.

    Parameters
    ----------
    path, kind
        Path and kind of the file to be written.
    inputs
        Paths of the files that the command reads.
    option
        Option of the command line that has the path, for messages.

    Raises
    ------
    InputError
        If the file cannot be written (`require_writable`), is a folder, or exists and is of
        another kind.
    SettingsError
        If the path is that of an input file.
    """
    require_writable(path)
    file = Path(path)
    label = f"{option} {path}"
    if file.is_dir():
        raise InputError(f"{label} is a folder, but a file must be written: give another name")
    for source in inputs:
        with suppress(OSError):  # the output or an input does not exist
            if os.path.samefile(file, source):
                raise SettingsError(f"{label}: {source} is an input file: give another name")
    try:
        other = file.is_file() and file.stat().st_size > 0 and not kind.holds(file)
    except (OSError, ValueError) as error:
        raise InputError(f"{label}: {error}") from None
    if other:
        raise InputError(
            f"{label} exists and is not {kind.words}: move it away, or give another name"
        )


def require_kept(directory: Path, inputs: Iterable[str | Path], names: Iterable[str] = ()) -> None:
    """Refuse a folder for results if an input in it would be replaced or removed.

    Parameters
    ----------
    directory
        Path of the folder for results.
    inputs
        Paths of the files that the command reads.
    names
        File names that the command will write, in addition to those in the folder's manifest.

    Raises
    ------
    InputError
        If an input would be replaced or removed; the message has its path.
    """
    outputs = {*listed(directory), *names}
    folder = directory.resolve()
    for source in inputs:
        path = Path(source).resolve()
        if not path.is_relative_to(folder) or path == folder:
            continue
        first, *below = path.relative_to(folder).parts
        if first + "/" * bool(below) in outputs:
            raise InputError(
                f"-o {directory}: the command reads {source}, which it would replace: choose "
                "another folder"
            )


def status_of(directory: Path) -> str:
    """Status of the run in a folder; empty if there is no summary."""
    return str(_summary(directory).get("status", ""))


def complete_result(directory: Path) -> dict[str, Any] | None:
    """Summary of the complete result in a folder; None if the folder has no complete result."""
    summary = _summary(directory)
    return summary if summary.get("status") == "complete" else None


def require_complete(directory: Path) -> dict[str, Any]:
    """Summary of the complete result in a folder.

    Raises
    ------
    InputError
        If the folder does not exist, or has no complete result.
    """
    path = directory / SUMMARY
    try:
        summary = read_json(path) if path.is_file() else {}
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a summary of a run: {error}") from None
    if not isinstance(summary, dict) or summary.get("status") != "complete":
        summary = summary if isinstance(summary, dict) else {}
        missing = f"there is no {SUMMARY}" if directory.is_dir() else "no such folder"
        raise InputError(f"{directory}: no complete run: {summary.get('status', missing)}")
    return summary


def _summary(directory: Path) -> dict[str, Any]:
    """Summary of the run in a folder; empty if the folder has no summary."""
    with suppress(OSError, ValueError):
        summary = read_json(directory / SUMMARY)
        if isinstance(summary, dict):
            return summary
    return {}


def write_summary(directory: str | Path, summary: Mapping[str, object]) -> None:
    """Write the summary of a run, ``summary.json``, to a folder."""
    write_whole(Path(directory) / SUMMARY, to_json(summary) + "\n")


@contextmanager
def keeping_failed_film(directory: str | Path) -> Iterator[None]:
    """Save the film if the block raises a `CavitationError`, or an error caused by such an error.

    Raises
    ------
    EhdError
        The error of the block again, with the path of the saved film at the end of its message.
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
        import h5py

        if path.is_file() and not _is_film(path):
            raise type(error)(
                f"{error}; the film is not saved, as {path} exists and is not from this program"
            ) from error
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        # HDF5 crashes if the disk is full.
        content = io.BytesIO()
        with h5py.File(content, "w") as file:
            for name, values in cause.state.items():
                file[name] = values
        write_whole(path, content.getvalue())
        raise type(error)(f"{error}; the film is saved in {path}") from error


def _is_film(path: Path) -> bool:
    """Whether a file is a film that `keeping_failed_film` saved."""
    import h5py

    with suppress(OSError, RuntimeError), h5py.File(path, "r") as file:
        return {"gap", "pressure"} <= set(file)
    return False


def to_json(values: Mapping[str, object], *, indent: int | None = 2) -> str:
    """Convert values to JSON text; numbers that are not finite become null."""
    return json.dumps(_plain(values), indent=indent, allow_nan=False)


def _plain(value: object) -> object:
    """Replace numbers that are not finite by None in a value, at any depth."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def versions(*, installed: bool = False) -> dict[str, str]:
    """Versions of this package, Python and the imported libraries, by name.

    With `installed`, the result has all known libraries, even if they are not imported.
    """
    names = ("numpy", "scipy", "h5py", "petsc4py", "slepc4py", "dolfinx", "gmsh", "matplotlib")
    return {
        "fenics_ehd": __version__,
        "python": platform.python_version(),
        **{name: version_of(name) for name in names if installed or name in sys.modules},
    }
