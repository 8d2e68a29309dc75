"""Lock of the folder of compiled forms: one process compiles at a time.

FFCx writes a C file when it begins to compile a form, and a second file when the form is compiled.
If a process is killed between the two, only the first file exists. Without this lock, every later
process would wait for the killed one.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from fenics_ehd.base.errors import CompilationError
from fenics_ehd.base.files import lock_taken, user_cache
from fenics_ehd.base.printed import escaped

#: Waiting time after which a notice names the process that compiles [s].
NOTICE = 10.0

#: Longest wait for one compilation [s]; a compilation takes half a minute at most.
LIMIT = 300

#: Time between two attempts to lock [s].
POLL = 0.1

#: Longest description of a process in a notice [characters].
LONGEST = 300


def forms_folder() -> Path:
    """Folder of the package's compiled forms, in the user's cache; nothing else compiles there."""
    return user_cache() / "fenics" / "fenics_ehd"


def is_compiled(source: Path) -> bool:
    """True if the form of a C file is compiled."""
    return source.exists() and source.with_suffix(".c.cached").exists()


def orphans(folder: Path) -> list[Path]:
    """C files of forms and elements whose compilation was begun and not completed."""
    return [source for source in folder.glob("libffcx_*.c") if not is_compiled(source)]


@contextmanager
def compiling(folder: Path, notice: float = NOTICE, limit: float = LIMIT) -> Iterator[None]:
    """Lock a folder for compiling and remove orphans; the lock ends with the process.

    Parameters
    ----------
    folder
        Folder, which is created if it is missing.
    notice
        Seconds of waiting after which a line on standard error names the process that compiles.
    limit
        Seconds of waiting for one compilation.

    Raises
    ------
    CompilationError
        Another process holds the lock for longer than `limit`: it is suspended, or its disk hangs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "a+", encoding="utf-8", errors="replace") as lock:
        _take(lock, folder, notice, limit)
        _sign(lock)
        for source in orphans(folder):
            source.unlink(missing_ok=True)
        yield


def _take(lock: IO[str], folder: Path, notice: float, limit: float) -> None:
    began = since = time.monotonic()
    holder = ""
    silent = True
    while not lock_taken(lock.fileno()):
        now = time.monotonic()
        if (current := _signature(lock)) != holder:
            holder = current
            since = now
        if now > since + limit:
            raise CompilationError(
                f"{folder}: forms have been compiled for {limit:g} s by {holder}: continue or end "
                "that process, or set XDG_CACHE_HOME to another folder"
            )
        if silent and now > began + notice:
            silent = False
            with suppress(OSError):  # the standard error output is closed
                print(
                    f"fenics-ehd: waiting for compiled forms, {folder} is in use by {holder}",
                    file=sys.stderr,
                )
        time.sleep(POLL)


def _sign(lock: IO[str]) -> None:
    """Write the process that has locked the file, and the time, into the file."""
    holder = f"process {os.getpid()} on {platform.node()} since {time.strftime('%X')}"
    words = f"{holder}: {' '.join(sys.argv)}".split()
    with suppress(OSError):  # the disk is full: the process stays unnamed
        lock.truncate(0)
        lock.write(escaped(" ".join(words))[:LONGEST])
        lock.flush()


def _signature(lock: IO[str]) -> str:
    lock.seek(0)
    return lock.read(LONGEST) or "an unnamed process"
