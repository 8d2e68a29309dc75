"""The table of stiff and extreme runs that ``benchmarks/extremes.py`` writes."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

import fenics_ehd
from fenics_ehd.report.document import Table
from fenics_ehd.report.study_data import Study

NAME = "extremes.md"


@dataclass(frozen=True)
class Extremes:
    """The table, its closing line, and where it was read."""

    table: Table
    summary: str
    source: str


def find_extremes(study: Study) -> Extremes | None:
    """The benchmark's page in the study's folder, else the one that came with the program."""
    shipped = f"docs/{NAME} of fenics_ehd {fenics_ehd.__version__}"
    for path, source in (
        (study.directory / NAME, f"{NAME} in this folder"),
        (Path(fenics_ehd.__file__).parents[1] / "docs" / NAME, shipped),
        (Path(sys.prefix) / "share" / "fenics-ehd" / NAME, shipped),
    ):
        if path.is_file():
            return read_extremes(path.read_text(), source)
    return None


def read_extremes(page: str, source: str) -> Extremes | None:
    """Table and closing line of the page, None where it has no table."""
    lines = page.splitlines()
    rows = [_cells(line) for line in lines if line.startswith("|")]
    if len(rows) < 3:
        return None
    heads, body = rows[0], [row for row in rows[2:] if len(row) == len(rows[0])]
    after = lines[max(i for i, line in enumerate(lines) if line.startswith("|")) + 1 :]
    table = Table(tuple(heads), tuple(map(tuple, body)), words=6, folded=True)
    return Extremes(table, " ".join(line for line in after if line), source)


def _cells(line: str) -> list[str]:
    """Cells of a Markdown row; a bar behind a backslash belongs to the text."""
    cells = re.split(r"(?<!\\)\|", line.strip().strip("|"))
    return [cell.strip().replace("`", "").replace("\\|", "|") for cell in cells]
