"""What every picture needs: a backend without a screen, and files in the folder of a run."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import matplotlib

from fenics_ehd.whole_file import write_whole

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
        picture = BytesIO()
        figure.savefig(picture, format=path.suffix[1:], dpi=150)
        write_whole(path, picture.getbuffer())
    plt.close(figure)
    return written
