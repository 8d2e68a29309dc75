"""Basics of all pictures: colours and styles, the backend, and files in the folder of a run.

The colours are those of Paul Tol's high-contrast scheme, black, and three of his muted scheme
(personal.sron.nl/~pault). Colour-blind readers can distinguish them, and the first four also
differ in grey print. Curves differ in their dashes as well.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Collection, Iterable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import matplotlib

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import (
    PICTURE_FORMATS,
    Kind,
    beginning_with,
    claim,
    require_output,
    write_whole,
)
from fenics_ehd.base.units import unit, unit_of

# Pictures need no window. A notebook, or a program that uses pyplot already, keeps its backend.
if "MPLBACKEND" not in os.environ and "matplotlib.pyplot" not in sys.modules:
    matplotlib.use("Agg")
import matplotlib.pyplot as plt  # the backend must be chosen first
from matplotlib.axes import Axes
from matplotlib.figure import Figure

BLUE = "#004488"
RED = "#BB5566"
YELLOW = "#DDAA33"
BLACK = "#000000"

#: Colours of successive curves.
COLOURS = (BLUE, RED, YELLOW, BLACK, "#44AA99", "#882255", "#999933")

#: Dashes of successive curves: an equal curve below remains visible through the gaps.
DASHES = ("-", (0, (6, 3)), (0, (2, 2)), (0, (6, 2, 1, 2)))

#: Colour maps of pressures and of films, which are monotonic in grey print.
PRESSURES = "YlOrRd"
FILMS = "cividis"

#: Width of a picture, and of one of several panels in a row [inches].
WIDTH = 7.2
PANEL = 4.4

#: Endings of picture files. Every installation can write them; other formats of matplotlib need
#: further programs, or do not accept the same settings.
ENDINGS = (".pdf", ".png", ".svg")

#: Settings of matplotlib: fonts, lines and grids.
SETTINGS: dict[str, Any] = {
    "font.size": 10,
    "axes.labelsize": 10,
    "axes.titlesize": 10,
    "legend.fontsize": 8.5,
    "legend.handlelength": 2.8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.5,
    "lines.markersize": 6,
    "svg.hashsalt": "fenics_ehd",  # for the same identifiers every time
}


def style(number: int) -> dict[str, Any]:
    """Colour and dashes of curve `number` of a figure, as arguments of `Axes.plot`."""
    dashes = DASHES[number % len(DASHES)]
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": dashes}


def factor_of(label: str) -> float:
    """Factor from SI units to the unit in a label's brackets; 1 for an angle or an unknown unit."""
    known = unit(unit_of(label).partition(" of ")[0])
    return 1.0 if known is None or known.turns else float(1 / known.factor)


def with_unit(value: float, label: str) -> str:
    """Text of a value, followed by the unit in a label's brackets if the label has a unit."""
    symbol = unit_of(label)
    return f"{value:.4g}" + (symbol if symbol == "°" else f" {symbol}".rstrip())


def legend(axes: Axes, **options: Any) -> None:
    """Add a legend to axes that have labelled curves."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**{"framealpha": 0.85} | options)


#: First bytes of a file by its ending: of pictures, and of an animation as GIF.
SIGNATURES = {
    ".gif": (b"GIF87a", b"GIF89a"),
    ".pdf": (b"%PDF",),
    ".png": (b"\x89PNG",),
    ".svg": (b"<?xml", b"<svg"),
}


#: Name of the date in the metadata of a format, by the ending of the file.
DATES = {".pdf": "CreationDate", ".svg": "Date"}


def kind_of(path: str | Path) -> Kind:
    """Kind of the output file of a picture or animation, from the ending of its path."""
    ending = Path(path).suffix.lower()
    words = f"a {ending[1:].upper()} picture"
    if ending == ".mp4":
        return beginning_with("an MP4 film", b"ftyp", at=4)
    return beginning_with(words, *SIGNATURES[ending])


def require_format(
    option: str, path: str | Path, known: Collection[str], inputs: Iterable[str | Path] = ()
) -> None:
    """Refuse the path of a picture that cannot be written, before the picture is drawn.

    Raises
    ------
    SettingsError
        The ending is not one of `known`.
    InputError
        The folder is not writable, or the path is that of an input or of a foreign file.
    """
    if Path(path).suffix.lower() not in known:
        raise SettingsError(f"{option} {path}: the file must end with one of {', '.join(known)}")
    require_output(path, kind_of(path), inputs, option)


def save_in_formats(figure: Figure, directory: str | Path, name: str) -> list[Path]:
    """Write a figure in each of `PICTURE_FORMATS` into a folder of this program; return the paths.

    Raises
    ------
    InputError
        The folder has a file with the name of the picture that this program did not write.
    """
    names = [f"{name}.{suffix}" for suffix in PICTURE_FORMATS]
    claim(Path(directory), names)
    return save(figure, [Path(directory) / name for name in names])


def save(figure: Figure, paths: Sequence[str | Path]) -> list[Path]:
    """Write a figure to files in the formats of their endings, close it, and return the paths."""
    written = [Path(path) for path in paths]
    _fix_layout(figure)
    for path in written:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, _content(figure, path.suffix.lower()))
    plt.close(figure)
    return written


def svg_of(figure: Figure) -> bytes:
    """Content of the SVG file of a figure, which is closed."""
    _fix_layout(figure)
    content = _content(figure, ".svg")
    plt.close(figure)
    return content


def _fix_layout(figure: Figure) -> None:
    """Lay out a figure once, so that all its files share the layout."""
    for _ in range(2):  # titles move as soon as the ticks have their positions
        figure.draw_without_rendering()
    figure.set_layout_engine("none")


def _content(figure: Figure, ending: str) -> bytes:
    """Content of the file of a figure, in the format of an ending."""
    picture = BytesIO()
    # Without the date, equal figures give equal files.
    metadata = {DATES[ending]: None} if ending in DATES else {}
    with plt.rc_context({"svg.hashsalt": SETTINGS["svg.hashsalt"]}):
        figure.savefig(picture, format=ending[1:], dpi=150, metadata=metadata)
    content = picture.getvalue()
    return _numbered_clips(content) if ending == ".svg" else content


def _numbered_clips(svg: bytes) -> bytes:
    """Name the clip paths of an SVG file by numbers instead of memory addresses."""
    for number, name in enumerate(re.findall(rb'<clipPath id="(\w+)"', svg)):
        svg = svg.replace(name, b"clip%d" % number)
    return svg
