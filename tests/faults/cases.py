"""A malformed input: what is written, what is called, which answer is right."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Case:
    """One malformed input.

    Attributes
    ----------
    group, name
        Class of input, and what is wrong with it.
    prepare
        Writes the inputs into a folder that does not exist yet.
    call
        The program, with that folder as working directory.
    intact
        Name of the intact answer, to which no other is right; None: any of finite numbers.
    slow
        Whether it may just take long.
    """

    group: str
    name: str
    prepare: Callable[[Path], None]
    call: Callable[[], None]
    intact: str | None = None
    slow: bool = False
