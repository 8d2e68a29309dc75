"""Text and table that describe an object: what Python and notebooks show of large results.

A class that derives from `Described` defines its lines once, in `described`. Python shows
them as text, at most `MOST_LINES`, and Jupyter as a table.
"""

from __future__ import annotations

import html
from collections.abc import Iterable

#: Largest numbers of lines, and of characters of a line's text.
MOST_LINES = 10
LONGEST_TEXT = 100


class Described:
    """Base class of objects that are shown by a few lines instead of all their arrays."""

    def described(self) -> Iterable[tuple[str, str]]:
        """Names and texts of the lines that describe the object; the first names the object."""
        raise NotImplementedError

    def _lines(self) -> list[tuple[str, str]]:
        """At most `MOST_LINES` lines of `described`, each of them shortened."""
        lines = [(name, _shortened(text)) for name, text in self.described()]
        if len(lines) > MOST_LINES:
            hidden = len(lines) - MOST_LINES + 1
            lines = [*lines[: MOST_LINES - 1], ("", f"and {hidden} more")]
        return lines

    def __repr__(self) -> str:
        lines = self._lines()
        width = max((len(name) for name, _ in lines), default=0)
        return "\n".join(f"{name:{width}}  {text}".rstrip() for name, text in lines)

    def _repr_html_(self) -> str:
        """Table of the lines, which Jupyter shows."""
        rows = (
            f'<tr><th style="text-align:left">{html.escape(name)}</th>'
            f'<td style="text-align:left">{html.escape(text)}</td></tr>'
            for name, text in self._lines()
        )
        return f"<table>{''.join(rows)}</table>"


def _shortened(text: str) -> str:
    """Shorten a text to at most `LONGEST_TEXT` characters."""
    return text if len(text) <= LONGEST_TEXT else f"{text[: LONGEST_TEXT - 4]} ..."


def names_or_none(names: Iterable[str]) -> str:
    """Names separated by commas; "none" if there are none."""
    return ", ".join(names) or "none"
