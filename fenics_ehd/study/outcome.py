"""What came of a task of the pool. Errors come back as text, in one line.

Errors themselves may not survive the way between processes, and a film that failed carries its
arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from fenics_ehd.base.errors import EhdError
from fenics_ehd.study.pool import WorkerDiedError

T = TypeVar("T")

#: Status of a run whose figures can be trusted.
COMPLETE = "complete"

#: How often a form is waited for that another worker is compiling, ten seconds each time.
COMPILATIONS = 6


class FailedCasesError(EhdError):
    """Some cases failed; the rows of all others are complete."""


@dataclass(frozen=True)
class Outcome:
    """``"complete"`` or what went wrong, and the figures of a run that came to its end."""

    status: str
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether its figures can be trusted."""
        return self.status == COMPLETE


def failed(error: BaseException) -> Outcome:
    """Outcome of an error: its name and message."""
    return Outcome("failed: " + " ".join(f"{type(error).__name__}: {error}".rstrip(": ").split()))


def recorded(answer: Outcome | WorkerDiedError) -> Outcome:
    """Outcome of a task whose worker may have died."""
    return failed(answer) if isinstance(answer, WorkerDiedError) else answer


def patiently(function: Callable[[], T]) -> T:
    """Call again while another worker compiles a form: dolfinx waits for it ten seconds only."""
    for _ in range(COMPILATIONS - 1):
        try:
            return function()
        except TimeoutError:
            pass
    return function()
