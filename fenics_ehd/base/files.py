"""Files of users and of this program: texts are read, results written, folders locked.

Writes are atomic: a result is complete or absent, even after a crash or with a full disk. One
process at a time writes to a folder, and only the program's own files are replaced or removed.
``manifest.txt`` lists them, one name a line, folders with a slash at the end. A name is appended
before its file is made, so that the manifest is complete even if the process is killed. Symbolic
links are never followed.

Lines ``key: value`` of known keys are no names but properties of the folder. ``command: run`` is
the command that made it: no other command writes there.

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
    """Text of a file in UTF-8, with or without a byte order mark.

    Raises
    ------
    OSError
        The file cannot be read, or is a folder, a pipe or a device: reading these may never end.
    UnicodeDecodeError
        The file is not in UTF-8.
    """
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(0, "a folder, pipe or device, not a file")
    return Path(path).read_text(encoding="utf-8-sig")


def read_json(path: str | Path) -> Any:
    """Content of a JSON file.

    Raises
    ------
    OSError, ValueError
        See `read_text`; or the text is no JSON, or has a number that is not finite.
    """
    try:
        return json.loads(read_text(path), parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None


def _finite(text: str) -> float:
    """Number of a JSON text; the program writes null for numbers that are not finite."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is no finite number")
    return value


def user_cache() -> Path:
    """Folder of the user's caches.

    A relative ``XDG_CACHE_HOME`` is disregarded, as its specification demands: files would be read
    from the current folder.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return cache if cache.is_absolute() else Path.home() / ".cache"


#: Environment variable with the path of the folder of reduced bodies, or with `CACHE_OFF`, and the
#: value with which no bodies are kept; see `fenics_ehd.scenes.kept_bodies`.
CACHE_VARIABLE = "FENICS_EHD_CACHE"
CACHE_OFF = "off"

#: Space for the metadata of HDF5 [bytes].
BOOKKEEPING = 1 << 18

#: Extension of a file that is being written.
PART = ".part"


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turn an `OSError` into an error whose message has the path.

    Raises
    ------
    OutputError
        For every `OSError`.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise OutputError(f"{path}: {reason}") from error


def write_whole(path: Path, content: str | bytes | memoryview) -> None:
    """Write a file under a temporary name, sync it to the disk and rename it; links are replaced.

    Raises
    ------
    OutputError
        The file cannot be written; a former file of that name is unchanged.
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
    """A new empty file in the folder of `path`, to be written and renamed to `path`."""
    partial = path.with_name(path.name + PART)
    while True:
        try:
            partial.open("xb").close()
            return partial
        except FileExistsError:
            partial = path.with_name(f"{path.name}.{token_hex(4)}{PART}")


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Path of the same name in a temporary folder; the file written there is moved to `path`.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with naming(path), TemporaryDirectory(dir=path.absolute().parent) as folder:
        aside = Path(folder, path.name)
        yield aside
        put_in_place(aside, path)


def put_in_place(partial: Path, path: Path) -> None:
    """Sync a written file to the disk, then rename it to `path`, over a former one."""
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
        Bytes by which it will grow.

    Raises
    ------
    OSError
        The disk has too little room.
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


#: List of the program's files in a folder.
MANIFEST = "manifest.txt"

#: First line of that list.
HEADER = "fenics_ehd made these in this folder, and may remove or replace them:"


def lock_taken(descriptor: int) -> bool:
    """Lock an open file or folder; False if another process has locked it.

    The lock ends with the process. On a file system without locks every process gets it.
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
        Another process has locked the folder.
    """
    held = ExitStack()
    file = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    held.callback(os.close, file)
    if not lock_taken(file):
        held.close()
        raise InUseError(f"{directory}: another process is writing to this folder")
    return held


#: Key of the command that made a folder.
COMMAND = "command"

#: All keys of a manifest.
KEYS = (COMMAND,)

#: Status and figures of one run of a sweep or study, in the folder of that run.
OUTCOME = "outcome.json"

#: Commands by the files that they list in manifests of version 0.3, which name no command.
SIGNATURES = {
    "study.json": "study",
    "sweep.json": "sweep",
    "sweep.csv": "sweep",
    "history.h5": "run",
    "history.csv": "run",
    "run.pvd": "paraview",
}

#: Extension of files of ``paraview``, whose manifests of version 0.3 have none of these names.
FIELDS_ENDING = ".vtu"


def made_by(directory: Path) -> str:
    """Command that made a folder, by its entry or by the names it lists; empty if unknown.

    A folder without a manifest belongs to the folder above if the manifest there lists it.

    Raises
    ------
    InputError
        The manifest cannot be used.
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
    """True of a folder that the manifest of the one above lists."""
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
        The message has the folder and both commands.
    """
    maker = made_by(directory)
    if maker not in ("", command):
        raise InputError(
            f"{directory}: made by fenics-ehd {maker}, not a folder for {command}: choose another"
        )


def _entries(directory: Path) -> dict[str, str]:
    """Entries of a folder's manifest by key; of repeated keys the first is valid."""
    pairs = (line.partition(": ") for line in _lines(directory) if _is_entry(line))
    entries: dict[str, str] = {}
    for key, _, value in pairs:
        entries.setdefault(key, value)
    return entries


def _is_entry(line: str) -> bool:
    key, colon, _ = line.partition(": ")
    return bool(colon) and key in KEYS


def listed(directory: Path) -> tuple[str, ...]:
    """Names in the manifest of a folder; none without a manifest.

    Raises
    ------
    InputError
        The manifest cannot be read, or has names of other folders.
    """
    path = directory / MANIFEST
    names = tuple(line for line in _lines(directory) if not _is_entry(line))
    for name in names:
        if name.startswith(".") or "/" in name[:-1] or "\0" in name or name == "/":
            raise InputError(
                f"{path}: {name!r} is not in this folder: not a list that this program made"
            )
    return names


def _lines(directory: Path) -> tuple[str, ...]:
    """Lines of the manifest of a folder, each once, without its header.

    Raises
    ------
    InputError
        The manifest cannot be read, or the file is no manifest.
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
    return tuple(dict.fromkeys(line for line in lines if line not in ("", HEADER)))


def claim(directory: Path, names: Iterable[str], command: str = "") -> None:
    """Enter names into the manifest of a folder, before their files are made.

    Parameters
    ----------
    directory
        Path of the folder, which is created if it is missing.
    names
        Names of files and folders in the folder.
    command
        Command that makes the folder; empty: the manifest keeps its entry.

    Raises
    ------
    InputError
        A file of such a name was not made by this program or is a link; or another command made the
        folder.
    OutputError
        The manifest cannot be written.
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
        for name in listed_before.intersection(wanted):  # files of a process that was killed
            _part(directory / name).unlink(missing_ok=True)
        if lines:
            _append(directory / MANIFEST, lines)


def _require_claimable(directory: Path, name: str, in_manifest: bool) -> None:
    """Refuse the name of a file or folder that the program did not make.

    Raises
    ------
    InputError
        A file of that name is not in the manifest, or is a link or a device.
    """
    folder = name[-1] == "/"
    path = directory / name
    for existing in filter(os.path.lexists, (path,) if folder else (path, _part(path))):
        if not (in_manifest or _empty(existing)):
            raise InputError(
                f"{existing}: not of a former run ({MANIFEST} does not list it): move it away, or "
                "choose another folder"
            )
        if not (stat.S_ISDIR if folder else stat.S_ISREG)(existing.lstat().st_mode):
            raise InputError(
                f"{existing}: a link or a device, where a {'folder' if folder else 'file'} is to "
                "be written: move it away, or choose another folder"
            )


def _append(manifest: Path, lines: Iterable[str]) -> None:
    """Append lines to a manifest and sync it to the disk."""
    with open(manifest, "a", opener=_no_link, encoding="utf-8") as file:
        # The last line of the manifest may lack its end.
        file.write("\n".join(["" if file.tell() else HEADER, *lines, ""]))
    sync_path(manifest)
    sync_path(manifest.parent)


def clear(directory: Path, names: Collection[str] | None = None) -> None:
    """Remove files and folders that a manifest lists; in folders, only files of their manifests.

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
    """Remove a manifest if none of its files exists, and the folder if it is then empty."""
    if not any((directory / name).exists() for name in listed(directory)):
        (directory / MANIFEST).unlink(missing_ok=True)
        if folder:
            with suppress(OSError):  # the folder has other files
                directory.rmdir()


def _part(path: Path) -> Path:
    return path.with_name(path.name + PART)


def _empty(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink() and not any(path.iterdir())


def _no_link(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW, 0o666)


#: File with the film of a failed solve.
FAILED_FILM = "failed_film.h5"

#: File with the errors of a run over time, by component.
ERROR_BUDGET = "error_budget.json"

#: File with the search for settings that meet an accuracy.
ACCURACY = "accuracy.json"

#: Summary of a run: its figures and status, written last.
SUMMARY = "summary.json"

#: File with the scene of a run, in the folder of its history.
SCENE_NAME = "scene.toml"

#: Names of pictures of runs, in the order of drawing. In names of files, names of joints may
#: follow; names of runs as well if a picture compares several runs.
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

#: File formats of every picture.
PICTURE_FORMATS = ("png", "svg")


def require_writable(path: str | Path) -> None:
    """Refuse an unusable output path before the computation begins.

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
            # Permissions are not sufficient: a file system may be read-only or full.
            with TemporaryFile(dir=existing):
                pass
        except OSError as error:
            raise InputError(f"output {path}: {existing}: {error.strerror}") from None


@dataclass(frozen=True)
class Kind:
    """Kind of an output file.

    Attributes
    ----------
    words
        Name of the kind with its article, for messages.
    holds
        Function that is true of a file of this kind; the file exists and is not empty.
    """

    words: str
    holds: Callable[[Path], bool]


def beginning_with(words: str, *signatures: bytes, at: int = 0) -> Kind:
    """Kind of files that have one of some signatures `at` a number of bytes from the start."""

    def holds(path: Path) -> bool:
        with open(path, "rb") as file:
            file.seek(at)
            return file.read(max(map(len, signatures))).startswith(signatures)

    return Kind(words, holds)


def require_output(
    path: str | Path, kind: Kind, inputs: Iterable[str | Path] = (), option: str = "-o"
) -> None:
    """Refuse an output file that would replace an input, or a file of another kind.

    An empty file may be replaced: `mktemp` makes one.

    Parameters
    ----------
    path, kind
        Path and kind of the file to be written.
    inputs
        Files that the command reads.
    option
        Option of the command line with the path.

    Raises
    ------
    InputError
        The file cannot be written (`require_writable`), is a folder, or exists and has another
        kind.
    SettingsError
        The path is that of an input file.
    """
    require_writable(path)
    file = Path(path)
    label = f"{option} {path}"
    if file.is_dir():
        raise InputError(f"{option} would write a file {path}: it is a folder")
    for source in inputs:
        with suppress(OSError):  # the output or an input does not exist
            if os.path.samefile(file, source):
                raise SettingsError(f"{label}: {source} is an input file, give another name")
    try:
        other = file.is_file() and file.stat().st_size > 0 and not kind.holds(file)
    except (OSError, ValueError) as error:
        raise InputError(f"{label}: {error}") from None
    if other:
        raise InputError(
            f"{label}: the file there is not {kind.words}: move it away, or give another name"
        )


def require_kept(directory: Path, inputs: Iterable[str | Path], names: Iterable[str] = ()) -> None:
    """Refuse a folder for results if an input in it would be replaced or removed.

    Parameters
    ----------
    directory
        Folder for the results.
    inputs
        Files that the command reads.
    names
        Names that the command will write, besides those in the manifest of the folder.

    Raises
    ------
    InputError
        The message has the input.
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
    """Status of the run in a folder, empty without a summary."""
    return str(_summary(directory).get("status", ""))


def complete_result(directory: Path) -> dict[str, Any] | None:
    """Summary of the complete result in a folder; None if the folder has none."""
    summary = _summary(directory)
    return summary if summary.get("status") == "complete" else None


def require_complete(directory: Path) -> dict[str, Any]:
    """Summary of the complete result in a folder.

    Raises
    ------
    InputError
        The folder does not exist, or has no complete result.
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
    """Summary in a folder; empty if there is none."""
    with suppress(OSError, ValueError):
        summary = read_json(directory / SUMMARY)
        if isinstance(summary, dict):
            return summary
    return {}


def write_summary(directory: str | Path, summary: Mapping[str, object]) -> None:
    """Write ``summary.json``."""
    write_whole(Path(directory) / SUMMARY, to_json(summary) + "\n")


@contextmanager
def keeping_failed_film(directory: str | Path) -> Iterator[None]:
    """Save the film of a `CavitationError` that ends a command, directly or as its cause.

    Raises
    ------
    EhdError
        The error itself; its message has the path of the saved film.
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
                f"{error}; its film is not saved: {path} exists and is not of this program"
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
    """True of a file that `keeping_failed_film` wrote."""
    import h5py

    with suppress(OSError, RuntimeError), h5py.File(path, "r") as file:
        return {"gap", "pressure"} <= set(file)
    return False


def to_json(values: Mapping[str, object]) -> str:
    """JSON text; a number that is not finite becomes null."""
    return json.dumps(_plain(values), indent=2, allow_nan=False)


def _plain(value: object) -> object:
    """A value in which numbers that are not finite are replaced by null, at any depth."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def versions(*, installed: bool = False) -> dict[str, str]:
    """Versions of imported libraries; with `installed`, of all libraries that are installed."""
    names = ("numpy", "scipy", "h5py", "petsc4py", "slepc4py", "dolfinx", "gmsh", "matplotlib")
    return {
        "fenics_ehd": __version__,
        "python": platform.python_version(),
        **{name: version_of(name) for name in names if installed or name in sys.modules},
    }
