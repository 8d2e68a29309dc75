"""What every picture needs: a backend without a screen, and files in the folder of a run."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib

from fenics_ehd.base.whole_file import write_whole

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # the backend must be chosen first
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: Formats of the pictures of a run.
FORMATS = ("png", "svg")

#: Of one curve after another, drawn over each other: equal ones show through the gaps.
DASHES = ("-", (0, (6, 4)), (0, (2, 3)), (0, (6, 2, 1, 2)))


def style(number: int) -> dict[str, Any]:
    """Colour and dashes of a curve of several."""
    return {"color": f"C{number}", "linestyle": DASHES[number % len(DASHES)]}


def over_time(axes: Axes, label: str) -> None:
    """What every panel of curves over time has, once they are drawn."""
    axes.set(xlabel="time [ms]", ylabel=label)
    axes.label_outer()
    axes.margins(x=0)
    axes.grid(alpha=0.3, which="both")
    if axes.get_legend_handles_labels()[0]:
        axes.legend()


def in_formats(directory: str | Path, name: str) -> list[Path]:
    """Files of a picture in each of `FORMATS`."""
    return [Path(directory) / f"{name}.{suffix}" for suffix in FORMATS]


def save(figure: Figure, paths: Sequence[str | Path]) -> list[Path]:
    """Write a figure to files, whose endings tell the formats, and close it."""
    written = [Path(path) for path in paths]
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once for all files
    for path in written:
        path.parent.mkdir(parents=True, exist_ok=True)
        picture = BytesIO()
        # Without the date the same figure is the same file.
        told = {"Date": None} if path.suffix == ".svg" else {}
        figure.savefig(picture, format=path.suffix[1:], dpi=150, metadata=told)
        write_whole(path, picture.getbuffer())
    plt.close(figure)
    return written
