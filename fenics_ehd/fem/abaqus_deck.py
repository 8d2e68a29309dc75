"""Solid cells of an input file of Abaqus or CalculiX.

meshio 5.3 forgets all nodes at a second ``*NODE`` (reference points of an assembly, say), knows
type names in capitals alone and refuses a deck for any type of element that it does not know.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.sealed_file import named, require_file

#: Cells by their number of nodes, named as meshio does; their nodes are in its order.
SOLIDS = {4: "tetra", 8: "hexahedron", 10: "tetra10", 20: "hexahedron20"}

#: Behind these, node numbers mean other nodes: they are those of one part or instance.
_SCOPES = {
    *("PART", "ENDPART", "INSTANCE", "ENDINSTANCE", "ASSEMBLY", "ENDASSEMBLY"),
}

#: What makes or moves nodes and elements without listing them.
_GENERATORS = {"NCOPY", "NFILL", "NGEN", "NMAP", "SYSTEM", "ELCOPY", "ELGEN"}

#: Most files that a deck includes, each as often as it is included.
MOST_FILES = 100


@dataclass
class _Scope:
    """Lines of nodes, and of solid elements by their type."""

    nodes: list[str] = field(default_factory=list)
    elements: dict[str, list[str]] = field(default_factory=dict)


def read_deck(path: Path) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """Nodes and solid cells; other elements, sets and steps are passed over.

    Parameters
    ----------
    path
        Flat, or of parts and instances, of which one has solid cells: instances are not moved to
        where the assembly has them. ``*INCLUDE`` is followed.

    Returns
    -------
    tuple
        Points (n, 3), and of each type of cell its name, of `SOLIDS`, and the nodes (c, k).

    Raises
    ------
    MeshError
        It has no solid cells, those of several parts, or what cannot be read.
    """
    scopes, lines = [_Scope()], []
    for line in _lines(path, []):
        if not line.startswith("*"):
            lines.append(line)
            continue
        keyword, type_name = _keyword(line)
        lines = []
        if keyword in _SCOPES:
            scopes.append(_Scope())
        elif keyword in _GENERATORS:
            raise MeshError(f"{path} has *{keyword}: write a deck that lists nodes and elements")
        elif keyword == "NODE":
            lines = scopes[-1].nodes
        elif keyword == "ELEMENT" and re.fullmatch(r"C3D\d+[A-Z]*", type_name):
            lines = scopes[-1].elements.setdefault(type_name, [])
    solid = [scope for scope in scopes if scope.elements]
    if not solid:
        raise MeshError(f"{path} has no C3D4, C3D8, C3D10, C3D20: it needs one kind of solid cells")
    if len(solid) > 1:
        raise MeshError(
            f"{path} has {len(solid)} parts of solid cells, it must have one: export the part alone"
        )
    return _arrays(path, solid[0])


def _lines(path: Path, opened: list[Path]) -> Iterator[str]:
    """Lines of a deck and of those that it includes; keywords and their options in one."""
    opened.append(path)
    if len(opened) > MOST_FILES:
        raise MeshError(
            f"{opened[0]} includes more than {MOST_FILES} files, the last is {path}: does one "
            "include itself?"
        )
    with named(MeshError, str(path)):
        require_file(path)
        text = path.read_text(encoding="utf-8", errors="replace")
    text = re.sub(r"^\*\*.*\n?", "", text, flags=re.MULTILINE)
    for line in re.sub(r"^(\*.*,)[ \t]*\n", r"\1", text, flags=re.MULTILINE).splitlines():
        include = re.match(r"\*\s*INCLUDE\s*,.*INPUT\s*=\s*([^,]+)", line, flags=re.IGNORECASE)
        if include:
            other = path.parent / include[1].strip().strip('"')
            yield from _lines(other, opened)
        elif line.strip():
            yield line


def _keyword(line: str) -> tuple[str, str]:
    """Keyword without blanks, and the option TYPE or nothing, in capitals."""
    keyword, *options = re.sub(r"\s", "", line[1:]).upper().split(",")
    pairs = dict(option.partition("=")[::2] for option in options)
    return keyword, pairs.get("TYPE", "")


def _arrays(path: Path, scope: _Scope) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    rows = [line.split(",") for line in scope.nodes]
    numbers, points = np.zeros(len(rows), dtype=np.int64), np.zeros((len(rows), 3))
    for place, row in enumerate(rows):
        try:
            numbers[place], points[place] = int(row[0]), [*map(float, row[1:4]), *[0.0] * 3][:3]
        except (ValueError, OverflowError):
            # What it says is not shown: it may be any file, which a deck from elsewhere includes.
            raise MeshError(
                f"{path}: row {place + 1} below *NODE is no number and coordinates"
            ) from None
    # A node that is listed twice is where it was put last.
    numbers, last = np.unique(numbers[::-1], return_index=True)
    points = points[::-1][last]
    blocks = []
    for type_name, lines in scope.elements.items():
        count = int(re.sub(r"\D", "", type_name[3:]))
        if count not in SOLIDS:
            raise MeshError(f"{path} has {type_name}: it needs C3D4, C3D8, C3D10 or C3D20")
        try:
            entries = np.array([int(n) for n in ",".join(lines).split(",") if n.strip()])
            cells = entries.reshape(-1, count + 1)[:, 1:]
        except ValueError:
            raise MeshError(
                f"{path}: the rows of {type_name} are not a number and {count} nodes each"
            ) from None
        missing = np.setdiff1d(cells, numbers)
        if len(missing):
            raise MeshError(f"{path}: elements have node {missing[0]}, of which no place is given")
        blocks.append((SOLIDS[count], np.searchsorted(numbers, cells)))
    return points, blocks
