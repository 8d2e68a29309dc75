"""Drawings of the signs, made when the site is built, into docs/drawings/."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .attitude import draw_attitude
from .film import draw_film
from .gap import draw_gap
from .rod import draw_rod
from .rotor import draw_rotor
from .sketch import save

if TYPE_CHECKING:  # drawn without Sphinx too
    from sphinx.application import Sphinx

DRAWINGS = {
    "gap": draw_gap,
    "attitude": draw_attitude,
    "film": draw_film,
    "rod": draw_rod,
    "rotor": draw_rotor,
}


def draw_all(folder: Path) -> None:
    """All drawings as SVG."""
    folder.mkdir(exist_ok=True)
    for name, draw in DRAWINGS.items():
        save(draw(), folder / f"{name}.svg")


def setup(app: Sphinx) -> dict[str, bool]:
    """Draw before Sphinx looks for pictures."""
    app.connect("builder-inited", lambda app: draw_all(Path(app.srcdir) / "drawings"))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
