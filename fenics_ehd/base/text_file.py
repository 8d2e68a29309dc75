"""Text that a user or another program wrote: scenes, tables, JSON."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any


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
    """What a JSON file holds.

    Raises
    ------
    OSError, ValueError
        See `read_text`, or it is no JSON.
    """
    try:
        return json.loads(read_text(path))
    except RecursionError:
        raise ValueError("brackets within brackets without end") from None
