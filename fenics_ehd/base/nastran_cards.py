"""Cards of Nastran's bulk data: their fields, and the numbers in these.

The fields of a card have 8 or 16 columns, or are separated by commas (MSC Nastran, Quick Reference
Guide, "Format of Bulk Data entries"). A continuation line follows its card; its first field is
empty or begins with ``+`` or ``*``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

#: Name and fields of a card.
Card = tuple[str, list[str]]


def cards_of(lines: Iterable[str]) -> Iterator[Card]:
    """Join lines to cards: the fields of continuation lines are appended.

    Comments, which begin with ``$`` anywhere in a line, and empty lines are left out.
    """
    card: Card | None = None
    for text in lines:
        line = text.partition("$")[0].rstrip()
        if not line:
            continue
        first, fields = fields_of(line)
        if card is not None and (not first or first[0] in "+*"):
            card[1].extend(fields)
            continue
        if card is not None:
            yield card
        card = first.rstrip("*").strip().upper(), fields
    if card is not None:
        yield card


def fields_of(line: str) -> tuple[str, list[str]]:
    """First field of a line, and its data fields: eight, or four of double width."""
    if "," in line:
        first, *fields = (field.strip() for field in line.split(","))
        count = 4 if "*" in first else 8
        return first, [*fields, *[""] * count][:count]
    line = line.expandtabs(8)
    first = line[:8].strip()
    width = 16 if "*" in first else 8
    return first, [line[i : i + width].strip() for i in range(8, 72, width)]


def real_number(text: str) -> float:
    """Convert a field to a real number: ``1.5-3`` is 1.5e-3, and an empty field is 0.

    Raises
    ------
    ValueError
        If the field is not a number.
    """
    if not re.fullmatch(r"[0-9.eEdD+\-]*", text):
        raise ValueError(f"{text!r} is no number")
    text = re.sub("[dD]", "e", text).lower()
    if "e" not in text:
        text = re.sub(r"(?<=[0-9.])([+-])", r"e\1", text)
    return float(text or 0)


def whole_number(text: str) -> int:
    """Convert a field to a whole number.

    Raises
    ------
    ValueError
        If the field is not a whole number.
    """
    if not re.fullmatch(r"[0-9]{1,18}", text):
        raise ValueError(f"{text!r} is no whole number")
    return int(text)
