"""Ctrl-C between two steps, never in the middle of writing one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupt_between_steps() -> Iterator[Callable[[], None]]:
    """Hold back the first SIGINT until the function yielded here is called.

    It then raises `KeyboardInterrupt`. A second SIGINT acts at once. Where SIGINT
    is ignored, as in a shell's background jobs, it stays ignored.
    """
    former = signal.getsignal(signal.SIGINT)
    if former is not signal.default_int_handler:
        yield lambda: None
        return
    asked = False

    def remember(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        signal.signal(signal.SIGINT, former)

    def check() -> None:
        if asked:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, remember)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, former)


@contextmanager
def interrupt_kept() -> Iterator[None]:
    """Leave Ctrl-C with Python: importing Gmsh takes it away until Gmsh ends."""
    former = signal.getsignal(signal.SIGINT)
    try:
        yield
    finally:
        if former is not None and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, former)
