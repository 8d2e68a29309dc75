"""Libraries that print what nobody asked for, on the stream that holds this program's answer."""

from __future__ import annotations

import ctypes
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress


@contextmanager
def printing_kept() -> Iterator[io.StringIO]:
    """Keep what Python code prints, and drop what compiled code writes to file descriptor 1.

    Yields
    ------
    io.StringIO
        What Python code has printed, to its standard or its error output.
    """
    said = io.StringIO()
    _flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        with redirect_stdout(said), redirect_stderr(said):
            yield said
    finally:
        _flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _flush() -> None:
    """Have out what Python and the C library hold back: it goes where it was meant to."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)
