"""Progress of long computations: one line with the part that is done, and the time left.

A function that may take long has an argument `progress`, and opens a stage of it for every part of
its work:

    with progress.stage("static solves", total=279) as stage:
        for part in parts:
            ...
            stage.to(part.stop)

A library such as tqdm draws one bar for each loop: it neither has nested stages in one line, nor
adds lines to a log at intervals, nor shows what a worker process is doing, and its bars in
notebooks need ipywidgets. This module has one line for all of these.

The caller decides whether and where progress is shown. In a terminal, one line on standard error is
rewritten and is removed at the end. In a notebook, one output is updated. In the log of a command,
a line is added at intervals of `LOG_INTERVAL`. Elsewhere, and on all ranks but the first, progress
is silent. A stage that is shown costs one reading of the clock per call.

Imports inside functions: only notebooks have IPython.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import escaped, shown
from fenics_ehd.base.processes import RANKS, is_rank

#: Least time between two changes of the line in a terminal or notebook [s].
INTERVAL = 0.2

#: Least time between two lines in the log of a command [s]; shorter work has no line.
LOG_INTERVAL = 10.0

#: Least time between two texts of a worker process [s].
REPORT_INTERVAL = 0.5

#: Beginning of a line in the log of a command.
LOG_PREFIX = "progress: "

#: Time [s] and share of the work from which on the time left is estimated: the first steps of a run
#: are much shorter than later ones.
FIRST_ESTIMATE = 0.5
FIRST_SHARE = 0.02


class Stage:
    """A part of a computation.

    Attributes
    ----------
    name
        Name of the stage.
    total, done
        Amount of work in a unit of the stage, and the part of it that is done; a total of 0 is
        unknown.
    """

    def __init__(
        self, changed: Callable[[], None], name: str, total: float, unit: str, done: float
    ):
        self._changed = changed
        self.name = name
        self.total = total
        self.done = done
        self._unit = unit
        self._note: str | Callable[[], str] = ""
        self._begin(done)

    def _begin(self, done: float) -> None:
        self._began = monotonic()
        self._first = done

    def to(self, done: float, note: str | Callable[[], str] = "") -> None:
        """Set the part that is done, and a short text about it, or a function that makes the text.

        The function is called only if the line is shown.

        A smaller part than before is the start of another round, such as the next cycle of a run.
        """
        if done < self.done:
            self._begin(done)
        self.done = done
        self._note = note
        self._changed()

    def add(self, note: str = "") -> None:
        """Add one to the part that is done."""
        self.to(self.done + 1, note)

    @property
    def elapsed(self) -> float:
        """Time since the start of the stage, or of its present round [s]."""
        return monotonic() - self._began

    def text(self) -> str:
        """Text of the line: percentage, time left, amounts and note.

        If the total is unknown, the text has the time since the start.
        """
        elapsed = self.elapsed
        words = []
        if self.total:
            words.append(f"{100 * min(self.done / self.total, 1.0):.0f} %")
            advance = self.done - self._first
            if advance > FIRST_SHARE * self.total and elapsed > FIRST_ESTIMATE:
                remaining = elapsed * max(self.total - self.done, 0.0) / advance
                words.append(f"{duration(remaining)} left")
            amounts = f"{_amount(self.done)} of {_amount(self.total)}"
            words.append(f"{amounts} {self._unit}".rstrip())
        elif elapsed >= 1.0:
            words.append(duration(elapsed))
        note = self._note() if callable(self._note) else self._note
        return ", ".join(filter(None, [*words, note]))


def _amount(value: float) -> str:
    """Text of an amount: all digits of a count, four digits of any other number."""
    return f"{value:.0f}" if value == round(value) else f"{value:.4g}"


def duration(seconds: float) -> str:
    """Text of a duration: ``12 s``, ``3 min 05 s``, ``2 h 07 min``."""
    rounded = round(seconds)
    if rounded < 60:
        return f"{rounded} s"
    if rounded < 3600:
        return f"{rounded // 60} min {rounded % 60:02d} s"
    return f"{rounded // 3600} h {rounded % 3600 // 60:02d} min"


class Progress:
    """Progress of a computation, silent unless `show` is given.

    Parameters
    ----------
    show
        Function that shows the text of the present stages.
    end
        Function that is called when an outermost stage ends, with the names and durations of all
        outermost stages so far.
    interval
        Least time between two calls of `show` within a stage [s].
    at_once
        Whether a stage is shown when it starts; otherwise after the interval.
    say
        Function that prints a line which remains; by default such lines are not shown.
    """

    def __init__(
        self,
        show: Callable[[str], None] | None = None,
        end: Callable[[str], None] = lambda text: None,
        *,
        interval: float = INTERVAL,
        at_once: bool = True,
        say: Callable[[str], None] = lambda text: None,
    ):
        self.say = say
        self._show = show
        self._end = end
        self._interval = interval
        self._at_once = at_once
        self._stages: list[Stage] = []
        self._ended: list[str] = []
        self._due = monotonic() + (0.0 if at_once else interval)

    @contextmanager
    def stage(
        self, name: str, total: float = 0.0, unit: str = "", *, done: float = 0.0
    ) -> Iterator[Stage]:
        """Open a stage, within the stage that is open already; yield it.

        Parameters
        ----------
        name
            Name of the stage, such as ``"vibration modes"``.
        total, unit
            Amount of work and its unit; 0 if the amount is unknown.
        done
            Amount that is done at the start.
        """
        stage = Stage(self._update, name, total, unit, done)
        if self._show is None:
            # One silent progress serves all threads.
            yield stage
            return
        began = monotonic()
        self._stages.append(stage)
        try:
            self._update(now=self._at_once)
            yield stage
        finally:
            self._stages.pop()
            if not self._stages:
                self._ended.append(f"{name}: {duration(monotonic() - began)}")
                self._end(", ".join(self._ended))

    def _update(self, *, now: bool = False) -> None:
        """Show the text of all open stages, if the interval is over or `now` is true."""
        if self._show is None:
            return
        time = monotonic()
        if not now and time < self._due:
            return
        self._due = time + self._interval
        texts = ((stage.name, stage.text()) for stage in self._stages)
        self._show(" - ".join(": ".join(filter(None, pair)) for pair in texts))


#: Progress that is not shown.
SILENT = Progress()


def _write(text: str) -> None:
    """Write a text to standard error, which may be missing, closed or broken."""
    if sys.stderr is None:
        return
    with suppress(OSError, ValueError):
        sys.stderr.write(text)
        sys.stderr.flush()


def _width() -> int:
    """Number of characters that fit on a line of the terminal."""
    columns = 80
    with suppress(OSError, ValueError):
        columns = os.get_terminal_size(sys.stderr.fileno()).columns or columns
    return columns - 1


def say(text: str) -> None:
    """Print a text to standard error; in a terminal, its first line replaces a line of progress.

    All printers of standard error use this function: a line of progress leaves the cursor at its
    start, and would remain behind a shorter text.
    """
    first, *others = escaped(text).split("\n")
    padded = f"{first:{_width() if _in_terminal() else 0}}"
    _write("\n".join([padded, *others, ""]))


class _Line:
    """Line of a terminal that is rewritten; other output starts at its beginning."""

    def __init__(self) -> None:
        self._length = 0

    def show(self, text: str) -> None:
        """Replace the line by a text, which is shortened to the width of the terminal."""
        width = _width()
        text = escaped(text)[:width]
        _write(f"{text:{min(self._length, width)}}\r")
        self._length = len(text)

    def end(self, _text: str) -> None:
        """Remove the line."""
        self.show("")


class _Output:
    """Output of a notebook's cell that is updated."""

    def __init__(self) -> None:
        self._handle: Any = None

    def show(self, text: str) -> None:
        """Replace the output by a text."""
        from IPython.display import display

        bundle = {"text/plain": text}
        if self._handle is None:
            self._handle = display(bundle, raw=True, display_id=True)
        else:
            self._handle.update(bundle, raw=True)


def _log(text: str) -> None:
    _write(f"{LOG_PREFIX}{escaped(text)}\n")


def _in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def _in_terminal() -> bool:
    """Whether standard error is shown in a terminal."""
    return sys.stderr is not None and (sys.stderr.isatty() or _launched_in_terminal())


def _launched_in_terminal() -> bool:
    """Whether this process is a rank whose launcher copies standard error to a terminal."""
    with suppress(OSError):
        copy = os.readlink(f"/proc/{os.getppid()}/fd/2")
        return is_rank() and copy.startswith(("/dev/pts/", "/dev/tty"))
    return False


def shown_progress(*, logs: bool = False) -> Progress:
    """Progress in a terminal or notebook; with `logs` also in a log; silent on later ranks.

    Commands have logs. Functions of the package that Python programs call have none.
    """
    if any(os.environ.get(name, "0") != "0" for name in RANKS):
        return SILENT
    if _in_notebook():
        output = _Output()
        return Progress(output.show, output.show)
    if _in_terminal():
        line = _Line()
        return Progress(line.show, line.end, say=say)
    return Progress(_log, interval=LOG_INTERVAL, at_once=False, say=say) if logs else SILENT


def written_progress(path: Path | None) -> Progress:
    """Progress of a worker process, which is written to a file for its parent; silent for None."""
    if path is None:
        return SILENT

    def write(text: str) -> None:
        with suppress(OSError):  # the parent has ended, or the disk is full
            path.write_text(text)

    return Progress(write, interval=REPORT_INTERVAL)


def read_progress(path: Path) -> str:
    """Text that a worker process has written by `written_progress`; empty if there is none."""
    with suppress(OSError, UnicodeDecodeError):
        return path.read_text()
    return ""


def chosen_progress(progress: Progress | bool) -> Progress:
    """Progress from the argument of a public function: shown if true, silent if false.

    Raises
    ------
    SettingsError
        If the argument is neither a progress nor True or False.
    """
    if isinstance(progress, Progress):
        return progress
    if not isinstance(progress, bool):
        raise SettingsError(f"progress = {shown(progress)} must be True, False or a Progress")
    return shown_progress() if progress else SILENT
