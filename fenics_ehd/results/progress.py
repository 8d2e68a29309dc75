"""The progress bar of a run."""

from __future__ import annotations

import sys
from contextlib import suppress

from tqdm import tqdm


class _Unobserved:
    """The error output; nobody has to be there, and a full disk may be behind it."""

    def write(self, text: str) -> None:
        """Write it, if possible."""
        with suppress(OSError):
            sys.stderr.write(text)

    def flush(self) -> None:
        """Likewise."""
        with suppress(OSError):
            sys.stderr.flush()


def progress_bar(end: float) -> tqdm:
    """Bar of the simulated time up to `end` [s]; seldom redrawn where nobody watches."""
    return tqdm(
        total=1e3 * end,
        unit="ms",
        file=_Unobserved(),
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
        bar_format="{percentage:3.0f}% |{bar:24}| {n:.3f}/{total:.3f} ms {postfix} [{elapsed}, "
        "ends in {remaining}]",
    )
