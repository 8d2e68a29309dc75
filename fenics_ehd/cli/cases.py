"""What ``sweep`` and ``study`` have in common: a bar of cases, a table for a reader."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

#: Characters of a status in a printed table.
STATUS_WIDTH = 60

#: Columns of a printed table: column, heading, factor, format.
Shown = Sequence[tuple[str, str, float, str]]


@contextmanager
def case_bar(total: int, done: int = 0) -> Iterator[Callable[[str], None]]:
    """Bar of cases; what it yields is told the status of every one that ends."""
    from tqdm import tqdm

    failures = 0
    with tqdm(
        total=total,
        initial=done,
        unit="case",
        file=sys.stderr,
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
    ) as bar:

        def ended(status: str) -> None:
            nonlocal failures
            failures += status != "complete"
            bar.set_postfix_str(f"{failures} failed", refresh=False)
            bar.update()

        yield ended


def table_lines(names: Sequence[str], rows: Sequence[Mapping[str, Any]], shown: Shown) -> list[str]:
    """Rows for a reader: what names a row, figures in the units of an engineer, its status."""
    heads = [*names, *(heading for _, heading, _, _ in shown)]
    cells = [[*(_value(row[name]) for name in names), *_figures(row, shown)] for row in rows]
    widths = [max(map(len, column)) for column in zip(heads, *cells, strict=True)]
    ends = ["status", *(_shortened(row["status"]) for row in rows)]
    return [
        "  ".join([*(cell.rjust(width) for cell, width in zip(line, widths, strict=True)), end])
        for line, end in zip([heads, *cells], ends, strict=True)
    ]


def _figures(row: Mapping[str, Any], shown: Shown) -> list[str]:
    return [
        "-" if row[name] is None else format(row[name] * factor, form)
        for name, _, factor, form in shown
    ]


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _shortened(status: str) -> str:
    return status if len(status) <= STATUS_WIDTH else f"{status[: STATUS_WIDTH - 3]}..."
