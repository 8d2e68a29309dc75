"""A file that one process at a time may write to."""

from __future__ import annotations

import fcntl
from pathlib import Path
from typing import BinaryIO

from fenics_ehd.sweeps.errors import SweepInUseError


def locked(path: Path) -> BinaryIO:
    """A file opened for appending, held by this process as long as it is open.

    Raises
    ------
    SweepInUseError
        Another process has it.
    """
    file = open(path, "a+b")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise SweepInUseError(f"{path}: another process is adding rows") from None
    except OSError:
        pass  # a file system without locks
    return file
