"""A report as plain values, whatever it is rendered to."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    kind: str = "text"


@dataclass(frozen=True)
class Picture:
    """A figure: stem of its files in ``figures/`` and what it shows."""

    name: str
    caption: str
    kind: str = "picture"


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes
    ----------
    heads, rows
        Cells are text.
    caption
        What the rows are.
    words
        Number of leading columns that hold words; the others hold figures and are set right.
    folded
        Whether the page shows it only when asked.
    """

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    words: int = 1
    folded: bool = False
    kind: str = "table"


Block = Text | Picture | Table


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    title: str
    blocks: tuple[Block, ...]

    @property
    def anchor(self) -> str:
        """Name for links to it."""
        return "-".join("".join(c if c.isalnum() else " " for c in self.title.lower()).split())


@dataclass(frozen=True)
class Document:
    """The whole report."""

    title: str
    sections: tuple[Section, ...]
