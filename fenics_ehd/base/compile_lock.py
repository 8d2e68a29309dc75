"""Folder of compiled forms: one process compiles at a time, and others do not wait for ever.

FFCx marks a form that it compiles by its C file, and one that is compiled by a second file. A
process that is killed leaves the first without the second, and any later one believes that somebody
is at work.
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
from fenics_ehd.base.files import lock_taken
from fenics_ehd.base.printed import escaped

#: Seconds of waiting after which a line names the process that compiles.
NOTICE = 10.0

#: Seconds of waiting for one and the same compilation, which takes half a minute at most.
LIMIT = 300

#: Seconds between two attempts to take the lock.
POLL = 0.1

#: Longest name of a process [characters].
LONGEST = 300


def forms_folder() -> Path:
    """Folder of the package's compiled forms, in the user's cache; nothing else compiles there.

    A relative ``XDG_CACHE_HOME`` is passed over, as its specification has it: libraries would be
    loaded from the current folder.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (cache if cache.is_absolute() else Path.home() / ".cache") / "fenics" / "fenics_ehd"


def is_compiled(source: Path) -> bool:
    """True if the form of a C file is compiled."""
    return source.exists() and source.with_suffix(".c.cached").exists()


def orphans(folder: Path) -> list[Path]:
    """C files of forms and elements that some process began to compile and did not complete."""
    return [source for source in folder.glob("libffcx_*.c") if not is_compiled(source)]


@contextmanager
def compiling(folder: Path, notice: float = NOTICE, limit: float = LIMIT) -> Iterator[None]:
    """Compile into a folder as its only process, orphans removed; a killed process lets go.

    Parameters
    ----------
    folder
        Created when missing.
    notice
        Seconds of waiting after which a line on standard error names the process that compiles.
    limit
        Seconds of waiting for one compilation.

    Raises
    ------
    CompilationError
        Another process holds the lock for longer than `limit`: it is stopped, or its disk hangs.
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
            with suppress(OSError):  # nobody is listening
                print(
                    f"fenics-ehd: waiting for compiled forms, {folder} is in use by {holder}",
                    file=sys.stderr,
                )
        time.sleep(POLL)


def _sign(lock: IO[str]) -> None:
    """Write down which process has locked the file, and since when: no two compilations alike."""
    holder = f"process {os.getpid()} on {platform.node()} since {time.strftime('%X')}"
    words = f"{holder}: {' '.join(sys.argv)}".split()
    with suppress(OSError):  # a full disk: nameless
        lock.truncate(0)
        lock.write(escaped(" ".join(words))[:LONGEST])
        lock.flush()


def _signature(lock: IO[str]) -> str:
    lock.seek(0)
    return lock.read(LONGEST) or "an unnamed process"
