"""Reduced bodies kept in the user's cache, so that a part is not reduced twice.

An entry is addressed by a checksum of everything that made its body: contents and settings of the
part, settings of the reduction, and the `environment`. A body from the cache is therefore bit for
bit the body that a new reduction would give. An entry has two files:

    NAME.h5         the body, see `fenics_ehd.reduction.body`; its date is that of the last use
    NAME.basis.h5   the basis of its displacement fields, see `fenics_ehd.reduction.part_files`

The body is written last, so that every entry with a body is complete. Both files are sealed. An
entry that cannot be read is made again. A file ``NAME.lock`` exists while the body is reduced, so
that other processes wait for it instead of reducing the same part.

The folder is ``fenics_ehd`` in the user's cache, or the folder that `CACHE_VARIABLE` names. A
folder that another user owns or can write to is not used, because that user could have replaced the
bodies. If the folder cannot be used, the run continues, and the part is reduced again. On several
ranks, the first rank reads the folder, and the others follow its decision.

Imports inside functions: the folder can be listed without PETSc.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import re
import stat
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import BodyFileError, EhdError
from fenics_ehd.base.files import CACHE_OFF, CACHE_VARIABLE, PART, lock_taken, user_cache
from fenics_ehd.base.libraries import origin, version_of
from fenics_ehd.base.processes import blas_kernels
from fenics_ehd.base.progress import say
from fenics_ehd.multibody.history import FIELDS_NAME
from fenics_ehd.reduction.body import ReducedBody, load_body, save_body, unknown

if TYPE_CHECKING:
    from fenics_ehd.reduction.structure import Structure

T = TypeVar("T")

#: Largest size of all entries [bytes]; beyond it, entries are removed, the least recently used
#: first. Entries of shipped scenes have 1 to 40 MB.
LARGEST_SIZE = 2 << 30

#: Suffixes of the files of an entry.
BODY = ".h5"
BASIS = ".basis.h5"
LOCK = ".lock"

#: Pattern of the name of an entry.
NAME = re.compile(r"[0-9a-f]{32}")

#: Waiting time after which a line reports that another process reduces the body [s].
NOTICE = 2.0

#: Time between two attempts to lock an entry [s].
POLL = 0.1

#: Longest wait for another process [s]; then the part is reduced here as well.
LONGEST_WAIT = 1800.0

#: Age of a temporary file above which the process that wrote it has ended [s].
ABANDONED = 86400.0

#: Sources of the package on which bodies depend, in addition to settings: folders and modules.
SOURCES = (
    "base",
    "fem",
    "meshes",
    "reduction",
    "film/grid.py",
    "film/transfer.py",
    "multibody/elastic_bore.py",
    "scenes/part.py",
)

#: Prefix of entries of a body's provenance: counts of the work for the error of its mesh.
MESH_ERROR = "mesh_error_"

#: Suffixes of files that are sources.
SOURCE_SUFFIXES = (".py", ".npy", ".geo")

#: Environment variables that keep NumPy and the C library from using some instruction sets.
INSTRUCTION_SETS = ("NPY_DISABLE_CPU_FEATURES", "GLIBC_TUNABLES")

#: Libraries whose versions are part of an address. Gmsh is imported only to mesh a part.
LIBRARIES = ("numpy", "scipy", "petsc4py", "slepc4py", "dolfinx")


# Addresses


def checksum(values: Mapping[str, str], digits: int = 16) -> str:
    """First hexadecimal digits of the SHA-256 checksum of texts by name."""
    return hashlib.sha256(json.dumps(dict(values), sort_keys=True).encode()).hexdigest()[:digits]


def content_of(name: str) -> str | None:
    """Text with the name of a file and a checksum of its content.

    For the folder of a run, the checksum is that of the history in it. The result is None if there
    is no such file.
    """
    path = Path(name, FIELDS_NAME) if Path(name).is_dir() else Path(name)
    if not path.is_file():
        return None
    state = path.stat()
    return f"{Path(name).name} {_file_checksum(path, state.st_mtime_ns, state.st_size)}"


@functools.cache
def _file_checksum(path: Path, _changed: int, _size: int) -> str:
    """First 12 digits of a file's checksum; cached, because many cases refer to the same file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:12]


def environment() -> dict[str, str]:
    """Conditions of a reduction that change bits of its body, in addition to files and settings.

    The texts, by name, describe the sources of the package, versions of libraries, kernels and
    threads of the BLAS, instruction sets of the processor, and options of PETSc that the user has
    set.
    """
    from fenics_ehd.base.petsc_options import options_of_user

    return {
        **_versions(),
        "sources": _sources(),
        "petsc_options": repr(sorted(options_of_user().items())),
        "blas": " ".join(blas_kernels()),
        "processor": _instruction_sets(),
    }


@functools.cache
def _instruction_sets() -> str:
    """Text with the instruction sets of the processor, and the variables that limit their use.

    NumPy and the C library select functions by instruction set, and the results of these functions
    may differ in the last bit.
    """
    lines: list[str] = []
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return " ".join([flags, *(os.environ.get(name, "") for name in INSTRUCTION_SETS)])


@functools.cache
def _versions() -> dict[str, str]:
    """Versions of the package and of libraries, by name."""
    from fenics_ehd import __version__

    # Gmsh has no metadata in Debian. Its module has the numbers of its interface and library.
    gmsh = Path(origin("gmsh"))
    module = gmsh.read_bytes() if gmsh.is_file() else b""
    return {
        "fenics_ehd": __version__,
        "python": sys.version,
        "gmsh": hashlib.sha256(module).hexdigest(),
        **{name: version_of(name) for name in LIBRARIES},
    }


@functools.cache
def _sources() -> str:
    """Checksum of the package's sources on which reduced bodies depend, see `SOURCES`."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for name in SOURCES:
        root = (
            Path(str(resources.files("fenics_ehd.meshes"))) if name == "meshes" else package / name
        )
        files = [root] if root.is_file() else sorted(root.rglob("*"))
        for file in files:
            if file.suffix in SOURCE_SUFFIXES:
                digest.update(f"{name} {file.relative_to(root.parent)} ".encode())
                digest.update(hashlib.file_digest(open(file, "rb"), "sha256").digest())
    return digest.hexdigest()


# The folder


def is_on() -> bool:
    """True unless the environment variable `CACHE_VARIABLE` switches the cache off."""
    return os.environ.get(CACHE_VARIABLE) != CACHE_OFF


def folder() -> Path | None:
    """Folder of the cache, created if it does not exist; None if no cache is used.

    If a folder cannot be used, a line on standard error reports it, once in a process.
    """
    if not is_on():
        return None
    named = Path(os.environ.get(CACHE_VARIABLE, ""))
    try:
        path = named if named.is_absolute() else user_cache() / "fenics_ehd"
    except RuntimeError:  # of the standard library
        report(f"reduced bodies are not kept: user {os.geteuid()} has no home folder: set HOME")
        return None
    if named.parts and path != named:
        report(f"{CACHE_VARIABLE} = {named} is not an absolute path: {path} is used")
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = path.stat()
        fault = _fault(state)
        if not fault and state.st_mode & 0o077:
            path.chmod(state.st_mode & 0o700)
    except OSError as error:
        fault = error.strerror or str(error)
    if fault:
        report(f"reduced bodies are not kept: {path}: {fault}")
        return None
    return path


def _fault(state: os.stat_result, *, directory: bool = True) -> str:
    """Reason why a folder or file of the cache must not be used, from its `stat`; else empty.

    Files and folders of other users, and those to which others can write, are not used.
    """
    if not (stat.S_ISDIR if directory else stat.S_ISREG)(state.st_mode):
        return "not a folder" if directory else "not a file"
    if state.st_uid != os.geteuid():
        return f"it belongs to user {state.st_uid}, not to {os.geteuid()}"
    if state.st_mode & 0o022:
        return f"others can write to it: use chmod 700, or another folder in {CACHE_VARIABLE}"
    return ""


@functools.cache
def report(line: str) -> None:
    """Print a line on standard error; equal lines are printed once in a process."""
    say(f"fenics-ehd: {line}")


@dataclass(frozen=True)
class Stored:
    """Files of one entry in the folder of the cache.

    Attributes
    ----------
    name
        Name of the entry: checksum of everything on which the body depends.
    files
        Paths of its files.
    size
        Sum of the sizes of its files [bytes].
    used
        Time of its last use [s since 1970].
    """

    name: str
    files: tuple[Path, ...]
    size: int
    used: float

    def remove(self) -> None:
        """Remove the files of the entry, the body first."""
        for file in sorted(self.files, key=lambda file: file.name.endswith(BASIS)):
            file.unlink(missing_ok=True)


def stored(path: Path) -> list[Stored]:
    """Entries in the folder of a cache, the least recently used first; other files are ignored."""
    files: dict[str, list[tuple[Path, os.stat_result]]] = {}
    for file in sorted(path.iterdir()):
        name, _, suffix = file.name.partition(".")
        if not NAME.fullmatch(name) or f".{suffix}" == LOCK:
            continue
        with suppress(OSError):  # another process has removed it
            state = file.lstat()
            if suffix.endswith(PART) and state.st_mtime > time.time() - ABANDONED:
                continue  # it is being written
            files.setdefault(name, []).append((file, state))
    entries = [
        Stored(
            name,
            tuple(file for file, _ in some),
            sum(state.st_size for _, state in some),
            max(state.st_mtime for _, state in some),
        )
        for name, some in files.items()
    ]
    return sorted(entries, key=lambda entry: entry.used)


def described(entry: Stored) -> dict[str, Any]:
    """Description of an entry for a list: last use, size, and reduction of its body."""
    body = next(filter(None, (_read(file, load_body, use=False) for file in entry.files)), None)
    provenance = {} if body is None else body.provenance
    return {
        "name": entry.name,
        "used": time.strftime("%Y-%m-%d %H:%M", time.localtime(entry.used)),
        "size_bytes": entry.size,
        "method": "damaged" if body is None else body.method,
        "modes": 0 if body is None else body.modes,
        "model": provenance.get("model", "").partition(" ")[0],
        "reduction_time_s": float(provenance.get("reduction_time_s", "0")),
    }


def trim(path: Path, most: int) -> None:
    """Remove the least recently used entries of a folder until all have at most `most` bytes."""
    entries = stored(path)
    size = sum(entry.size for entry in entries)
    for entry in entries:
        if size <= most:
            return
        entry.remove()
        size -= entry.size


# Entries


@dataclass(frozen=True)
class Entry:
    """Address of a body in the cache; all methods are collective over the ranks that reduce it.

    Attributes
    ----------
    name
        Name of the entry: checksum of everything on which the body depends; empty if the body is
        not kept.
    made
        Entries that the provenance of the body must have, by name.
    comm
        Ranks that share the part.
    with_mesh_error
        Name of the entry that has the same body with an estimated mesh error. It is read, too, if
        this entry is for a body without a mesh error; else empty.
    """

    name: str = ""
    made: Mapping[str, str] = field(default_factory=dict)
    comm: MPI.Comm = field(default_factory=lambda: MPI.COMM_SELF)
    with_mesh_error: str = ""

    def body(self) -> ReducedBody | None:
        """Read the body of the entry; None if the cache has no valid body."""
        return self.comm.bcast(self._on_first(self._read_body))

    def fields(self, structure: Structure) -> tuple[ReducedBody, np.ndarray] | None:
        """Read the body of the entry, and the rows of its basis for the nodes of this rank.

        The result is None if the cache has no valid body or basis.

        Parameters
        ----------
        structure
            Structure of the part, meshed with the settings of the body.
        """
        body = self.body()
        if body is None:
            return None
        counts = self.comm.gather(len(structure.coordinates)) or []
        shares = self._on_first(lambda path: _read_basis(path, self._names, body, counts))
        share = self.comm.scatter([None] * self.comm.size if shares is None else shares)
        usable = share is not None and np.array_equal(share[0], structure.coordinates)
        if not self.comm.allreduce(usable, op=MPI.LAND):
            basis = f"{self.name}{BASIS}"
            self._on_first(lambda path: report(f"{path / basis} cannot be used: reduced anew"))
            return None
        return body, share[1].reshape(-1, body.modes)

    def keep(self, body: ReducedBody, structure: Structure, columns: np.ndarray) -> None:
        """Store a body in the cache, with the rows `columns` of its basis on each rank.

        Old entries are removed if the cache becomes too large. If the body cannot be stored, the
        first rank reports the reason.
        """
        from fenics_ehd.reduction.part_files import save_basis

        if not self.made.items() <= body.provenance.items():
            return  # the model was changed while the part was meshed
        path = self.comm.bcast(self._on_first(lambda folder: folder))
        if path is None:
            return
        try:
            save_basis(path / f"{self.name}{BASIS}", structure, columns, stress=False)
            if self.comm.rank:
                return
            save_body(body, path / f"{self.name}{BODY}")
            for suffix in (BASIS, BODY):
                (path / f"{self.name}{suffix}").chmod(0o600)
            trim(path, LARGEST_SIZE)
        except (EhdError, OSError) as error:
            if self.comm.rank == 0:
                report(f"a reduced body is not kept: {error}")
                with suppress(OSError):  # a basis is read only with its body
                    (path / f"{self.name}{BASIS}").unlink(missing_ok=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the lock of the entry, so that one process at a time reduces the body.

        If another process holds the lock, wait for it.
        """
        path = self._on_first(lambda folder: folder)
        descriptor = None if path is None else _lock(path / f"{self.name}{LOCK}")
        self.comm.barrier()
        try:
            yield
        finally:
            if path is not None and descriptor is not None:
                with suppress(OSError):
                    (path / f"{self.name}{LOCK}").unlink()
                os.close(descriptor)

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(filter(None, (self.name, self.with_mesh_error)))

    def _on_first(self, act: Callable[[Path], T | None]) -> T | None:
        """Call a function with the folder of the cache, on the first rank.

        The result is that of the function; None on other ranks, and if no cache is used.
        """
        if self.comm.rank or not self.name:
            return None
        path = folder()
        return None if path is None else act(path)

    def _read_body(self, path: Path) -> ReducedBody | None:
        """Read the body of this entry, or else that of the entry `with_mesh_error`.

        The mesh error is then removed from the body.

        The result is None if neither can be used.
        """
        for name in self._names:
            body = _read(path / f"{name}{BODY}", load_body)
            if body is not None and self.made.items() <= body.provenance.items():
                return body if name == self.name else without_mesh_error(body)
        return None


def without_mesh_error(body: ReducedBody) -> ReducedBody:
    """Copy of a body as if the error of its mesh had not been estimated."""
    accuracy = {k: v for k, v in body.accuracy.items() if k != "flexibility_mesh_error"}
    made = {k: v for k, v in body.provenance.items() if not k.startswith(MESH_ERROR)}
    return replace(body, mesh_flexibility=unknown(), accuracy=accuracy, provenance=made)


def _read(path: Path, load: Callable[[Path], T], *, use: bool = True) -> T | None:
    """Content of a file of the cache, read by the function `load`.

    The result is None if the file is missing, damaged, or of another user. With `use`, the date of
    the file becomes the present time.
    """
    try:
        if _fault(path.lstat(), directory=False):
            return None
        content = load(path)
    except (BodyFileError, OSError):
        return None
    if use:
        with suppress(OSError):  # a folder that can only be read
            os.utime(path)
    return content


def _read_basis(
    path: Path, names: tuple[str, ...], body: ReducedBody, counts: list[int]
) -> list[Any] | None:
    """Read the nodes and the basis of a body, divided into one pair of blocks for each rank.

    `counts` are the numbers of nodes of the ranks. The result is None without a valid file.
    """
    from fenics_ehd.reduction.part_files import BasisFile

    def load(file: Path) -> tuple[np.ndarray, np.ndarray]:
        with BasisFile(file) as basis:
            return basis.nodes, basis.basis

    for name in names:
        content = _read(path / f"{name}{BASIS}", load)
        if content is None:
            continue
        nodes, basis = content
        if len(nodes) == sum(counts) and basis.shape[2] == body.modes:
            ends = np.cumsum(counts)[:-1]
            return list(zip(np.split(nodes, ends), np.split(basis, ends), strict=True))
    return None


def _lock(path: Path) -> int | None:
    """Lock a file, if necessary after waiting for another process; return the file's descriptor.

    The result is None if the file cannot be locked. A process that releases its lock removes the
    file. If that happens before this process has locked the file, it tries again with a new file.
    """
    began = time.monotonic()
    silent = True
    while time.monotonic() < began + LONGEST_WAIT:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        except OSError:  # a folder that can only be read
            return None
        if lock_taken(descriptor):
            with suppress(OSError):
                if os.path.samestat(os.fstat(descriptor), path.lstat()):
                    return descriptor
        os.close(descriptor)
        if silent and time.monotonic() > began + NOTICE:
            silent = False
            report(f"waiting for another process that reduces the same part, {path}")
        time.sleep(POLL)
    return None
