"""What every picture needs: a backend without a screen, and files in the folder of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # the backend must be chosen first
from matplotlib.figure import Figure

#: Formats of the pictures of a run.
FORMATS = ("png", "svg")


def save(figure: Figure, paths: Sequence[str | Path]) -> list[Path]:
    """Write a figure to files, whose endings tell the formats, and close it."""
    written = [Path(path) for path in paths]
    for path in written:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150)
    plt.close(figure)
    return written
