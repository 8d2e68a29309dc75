"""Signals that end a run: between two steps, never in the middle of writing one."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

#: They all end a run as Ctrl-C does.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE)

#: Exit status of a command that they ended.
INTERRUPTED = 130


@contextmanager
def ending_signals_raise() -> Iterator[None]:
    """Have SIGTERM and SIGHUP raise `KeyboardInterrupt` as SIGINT does.

    In the middle of an import, which would make another error of it, they end the process.
    What is ignored, SIGINT in a shell's background jobs say, stays ignored. So does SIGPIPE,
    except between the steps of a run: whoever writes to a closed pipe is told by an error.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = {number: signal.getsignal(number) for number in ENDING}
    for number, handler in former.items():
        if handler in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _raise)
    if former[signal.SIGPIPE] is signal.SIG_IGN:  # by Python
        signal.signal(signal.SIGPIPE, _pass_over)
    try:
        yield
    finally:
        _restore(former)


def _raise(_number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            with suppress(OSError):
                os.write(2, b"fenics-ehd: interrupted\n")
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt


def _pass_over(_number: int, _frame: FrameType | None) -> None:
    pass


def _restore(handlers: dict[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        if handler is not None:  # else not one of Python's
            signal.signal(number, handler)


@contextmanager
def interrupt_between_steps() -> Iterator[Callable[[], None]]:
    """Hold back the first signal until the function yielded here is called.

    It then raises `KeyboardInterrupt`. A second signal acts at once. Only signals that would
    raise something are held back, see `ending_signals_raise`.
    """
    former = {n: handler for n in ENDING if callable(handler := signal.getsignal(n))}
    asked = False

    def remember(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        _restore(former)

    def check() -> None:
        if asked:
            raise KeyboardInterrupt

    for number in former:
        signal.signal(number, remember)
    try:
        yield check
    finally:
        _restore(former)


@contextmanager
def interrupt_kept() -> Iterator[None]:
    """Leave signals as they are: Gmsh takes SIGINT away from import to end."""

    def keep(number: int, _handler: Any) -> Any:
        return signal.getsignal(number)

    original = signal.signal
    signal.signal = keep  # type: ignore[assignment]
    try:
        yield
    finally:
        signal.signal = original
