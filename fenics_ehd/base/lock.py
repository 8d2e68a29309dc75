"""A file that one process at a time may write to."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import BinaryIO

from fenics_ehd.base.errors import InUseError


def locked(path: Path) -> BinaryIO:
    """A file opened for appending, held by this process as long as it is open.

    Whoever holds it may remove it. A symbolic link is not followed.

    Raises
    ------
    InUseError
        Another process has it.
    """
    while True:
        file = open(path, "a+b", opener=_no_link)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise InUseError(f"{path.parent}: another process is writing to this folder") from None
        except OSError:
            return file  # a file system without locks
        # Its former holder may have removed it just before it could be had.
        if os.fstat(file.fileno()).st_nlink:
            return file
        file.close()


def _no_link(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW, 0o666)
