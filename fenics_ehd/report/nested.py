"""Nested settings and properties as names with dots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Names and values; objects of a list are numbered from 1, tuples become lists."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{before}{name}.")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            yield from flat({f"{name} {i}": each for i, each in enumerate(value, start=1)}, before)
        else:
            yield f"{before}{name}", list(value) if isinstance(value, tuple) else value
