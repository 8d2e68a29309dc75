"""Lock of the folder of compiled forms: one process compiles at a time.

FFCx writes a C file when it begins to compile a form, and a second file when it has compiled the
form. If a process is killed in between, only the C file exists, and every later process would wait
for the second file in vain. With a lock, a process can remove such a C file and compile the form.
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
from fenics_ehd.base.progress import say

#: Waiting time after which a notice names the process that compiles [s].
NOTICE = 10.0

#: Longest waiting time for one process that compiles [s]; a compilation takes at most half a
#: minute.
LIMIT = 300

#: Time between two attempts to lock [s].
POLL = 0.1

#: Largest number of characters that describe a process in a notice.
LONGEST = 300


def forms_folder() -> Path:
    """Folder in the user's cache for compiled forms of this package only."""
    return user_cache() / "fenics" / "fenics_ehd"


def is_compiled(source: Path) -> bool:
    """Whether the form in a C file has been compiled."""
    return source.exists() and source.with_suffix(".c.cached").exists()


def orphans(folder: Path) -> list[Path]:
    """C files of forms and elements in a folder: those whose compilation was not completed."""
    return [source for source in folder.glob("libffcx_*.c") if not is_compiled(source)]


@contextmanager
def compiling(folder: Path, notice: float = NOTICE, limit: float = LIMIT) -> Iterator[None]:
    """Lock a folder for compiling, and remove the files of compilations that were not completed.

    The lock is released at the end of the ``with`` block, or of the process.

    Parameters
    ----------
    folder
        Path of the folder, which is created if it is missing.
    notice
        Waiting time [s] after which a line on standard error names the process that compiles.
    limit
        Longest waiting time [s] for one process that compiles.

    Raises
    ------
    CompilationError
        If another process holds the lock for longer than `limit`, for instance because it is
        suspended.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "a+", encoding="utf-8", errors="replace") as lock:
        _take(lock, folder, notice, limit)
        _sign(lock)
        for source in orphans(folder):
            source.unlink(missing_ok=True)
        yield


def _take(lock: IO[str], folder: Path, notice: float, limit: float) -> None:
    """Wait until the lock file is locked, see `compiling`."""
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
                f"{folder}: {holder} has been compiling forms for {limit:g} s: resume that "
                "process if it is suspended, end it, or set XDG_CACHE_HOME to another folder"
            )
        if silent and now > began + notice:
            silent = False
            say(f"fenics-ehd: waiting for compiled forms: {folder} is in use by {holder}")
        time.sleep(POLL)


def _sign(lock: IO[str]) -> None:
    """Write a description of this process and the time into the file that it has locked."""
    holder = f"process {os.getpid()} on {platform.node()} since {time.strftime('%X')}"
    words = f"{holder}: {' '.join(sys.argv)}".split()
    with suppress(OSError):  # the disk may be full: then there is no description
        lock.truncate(0)
        lock.write(escaped(" ".join(words))[:LONGEST])
        lock.flush()


def _signature(lock: IO[str]) -> str:
    """Description of the process that has locked the file."""
    lock.seek(0)
    return lock.read(LONGEST) or "an unnamed process"
