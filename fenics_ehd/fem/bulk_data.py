"""Reader of Nastran bulk data: nodes, solid cells and their materials.

`fenics_ehd.base.nastran_cards` reads the fields of a card.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.nastran_cards import cards_of, real_number, whole_number
from fenics_ehd.fem.foreign_mesh import FileMaterial, ForeignMesh, included_text

#: Names in meshio of solid cells, by card name and number of nodes.
_SOLID = {
    "CTETRA": {4: "tetra", 10: "tetra10"},
    "CHEXA": {8: "hexahedron", 20: "hexahedron20"},
    "CPENTA": {6: "wedge", 15: "wedge15"},
    "CPYRAM": {5: "pyramid", 13: "pyramid13"},
    "CPYRA": {5: "pyramid", 13: "pyramid13"},
}

#: Order in VTK of a cell's nodes in Nastran, which lists midpoints of upright edges before those of
#: the top edges.
_ORDERS = {"hexahedron20": [*range(12), *range(16, 20), *range(12, 16)]}

#: Beginnings of card names with a C that do not define an element.
_NO_ELEMENT = ("CORD", "CAERO", "CSET", "CLOAD", "CYAX", "CYJOIN", "CSUPER", "CREEP", "CFLUID")

#: Beginnings of the names of other cards that constrain or connect nodes.
_JOINING = ("RBE", "RBAR", "RROD", "RJOINT", "MPC", "SPC", "PLOTEL", "SUPORT")

#: Cards of solid properties whose material is layered or not linear.
_LAYERED = ("PCOMPS", "PCOMPLS", "PLSOLID")


def read_bulk_data(path: Path) -> ForeignMesh:
    """Read nodes, solid cells and materials from a file of bulk data; count other elements.

    Nodes are in ascending order of their numbers.

    Raises
    ------
    MeshError
        If the file cannot be read, or if a node is not in the basic coordinate system.
    """
    cards: dict[str, list[list[str]]] = {}
    for name, fields in cards_of(_bulk(_text(path, []), path)):
        cards.setdefault(name, []).append(fields)
    numbers, points = _nodes(cards, path)
    blocks, properties = _cells(cards, numbers, path)
    materials = _materials(cards, properties, _mass_factor(cards, path))
    return ForeignMesh(points, blocks, _others(cards), materials)


def _text(path: Path, opened: list[Path]) -> str:
    """Read a file and the files that it includes, without comments."""
    text = re.sub(r"\$.*", "", included_text(path, opened))
    pattern = re.compile(r"^\s*INCLUDE\s+(?:'([^']+)'|\"([^\"]+)\"|(\S+))", re.I | re.M)

    def included(line: re.Match[str]) -> str:
        # A long file name may continue in the next line.
        name = re.sub(r"\s*\n\s*", "", line[1] or line[2] or line[3])
        return _text(path.parent / name.strip(), opened)

    return pattern.sub(included, text)


def _bulk(text: str, path: Path) -> list[str]:
    """Lines of the bulk data section of a deck; all lines of a file without section marks.

    Raises
    ------
    MeshError
        If the deck has several bulk data sections.
    """
    parts = re.split(r"^\s*BEGIN\b.*$", text, flags=re.I | re.M)
    if len(parts) > 2:
        raise MeshError(
            f"{path} has {len(parts) - 1} sections of bulk data (superelements), but must have one"
        )
    bulk = re.split(r"^\s*ENDDATA\b", parts[-1], flags=re.I | re.M)[0]
    return [line.rstrip() for line in bulk.splitlines() if line.strip()]


def _nodes(cards: Mapping[str, list[list[str]]], path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of nodes, ascending, shape (n,), and their positions, shape (n, 3).

    Raises
    ------
    MeshError
        If a GRID is not in the basic coordinate system, or has a field that is not a number.
    """
    standard = [fields[1] for fields in cards.get("GRDSET", [])]
    listed = {}
    for fields in cards.get("GRID", []):
        number, system, *coordinates = [*fields, *[""] * 5][:5]
        if (system or "".join(standard) or "0").strip("0"):
            raise MeshError(
                f"{path}: GRID {number} is not in the basic coordinate system: write nodes with x, "
                "y, z in the basic system"
            )
        try:
            listed[whole_number(number)] = [real_number(text) for text in coordinates]
        except ValueError as error:
            raise MeshError(f"{path}: GRID {number}: {error}") from None
    numbers = np.array(sorted(listed), dtype=np.int64)
    points = np.array([listed[number] for number in numbers.tolist()], dtype=float)
    return numbers, points.reshape(-1, 3)


def _cells(
    cards: Mapping[str, list[list[str]]], numbers: np.ndarray, path: Path
) -> tuple[list[tuple[str, np.ndarray]], set[str]]:
    """Blocks of solid cells of the same kind, and the property numbers that these cells have.

    Raises
    ------
    MeshError
        If a cell has a wrong number of nodes, or a node that is not in the file.
    """
    rows: dict[str, list[list[int]]] = {}
    properties = set()
    row = {number: index for index, number in enumerate(numbers.tolist())}
    for name, kinds in _SOLID.items():
        for fields in cards.get(name, []):
            label = f"{path}: {name} {fields[0]}"
            properties.add(fields[1] or fields[0])
            nodes = [text for text in fields[2:22] if text not in ("", "0")]
            if len(nodes) not in kinds:
                wanted = " or ".join(map(str, kinds))
                raise MeshError(
                    f"{label} has {len(nodes)} nodes, but must have {wanted}: write all of them"
                )
            try:
                rows.setdefault(kinds[len(nodes)], []).append([row[whole_number(n)] for n in nodes])
            except ValueError as error:
                raise MeshError(f"{label}: {error}") from None
            except KeyError as error:
                raise MeshError(f"{label}: node {error} is not among the GRIDs") from None
    blocks = [(name, np.array(cells, dtype=np.int64)) for name, cells in rows.items()]
    return [(n, cells[:, _ORDERS[n]] if n in _ORDERS else cells) for n, cells in blocks], properties


def _others(cards: Mapping[str, list[list[str]]]) -> dict[str, int]:
    """Count, by card name, elements that are not solid, and cards that connect nodes."""
    counts: Counter[str] = Counter()
    for name, rows in cards.items():
        element = name.startswith("C") and not name.startswith(_NO_ELEMENT)
        if (element and name not in _SOLID) or name.startswith(_JOINING):
            counts[name] += len(rows)
    return dict(counts)


def _materials(
    cards: Mapping[str, list[list[str]]], properties: set[str], factor: float
) -> list[FileMaterial]:
    """Materials to which properties of solid cells refer; `factor` multiplies their densities."""
    layered = {fields[0]: name for name in _LAYERED for fields in cards.get(name, [])}
    materials = {
        number: FileMaterial(f"of {layered[number]} {number}", {}, _problem(layered[number]))
        for number in sorted(properties & set(layered))
    }
    isotropic = {fields[0]: fields for fields in cards.get("MAT1", [])}
    for fields in cards.get("PSOLID", []):
        if fields[0] in properties:
            number = fields[1]
            materials[number] = _material(number, isotropic.get(number), factor)
    return list(materials.values())


def _problem(text: str) -> dict[str, str]:
    """Problems of a material without usable values, see `FileMaterial`: one reason for them all."""
    return dict.fromkeys(("youngs_modulus", "poissons_ratio", "density"), text)


def _mass_factor(cards: Mapping[str, list[list[str]]], path: Path) -> float:
    """Factor by which all densities are multiplied, from ``PARAM,WTMASS``.

    Raises
    ------
    MeshError
        If the parameter is not a number.
    """
    values = [value for name, value, *_ in cards.get("PARAM", []) if name.upper() == "WTMASS"]
    try:
        return real_number(values[0]) if values else 1.0
    except ValueError as error:
        raise MeshError(f"{path}: PARAM WTMASS: {error}") from None


def _material(number: str, fields: Sequence[str] | None, factor: float) -> FileMaterial:
    """Material from the fields of a MAT1 card; a material without values if there is no card."""
    name = f"MAT1 {number}"
    if fields is None:
        return FileMaterial(number, {}, _problem("no MAT1"))
    try:
        numbers = dict(zip("EGNR", [real_number(text) for text in fields[1:5]], strict=True))
    except ValueError as error:
        return FileMaterial(name, {}, _problem(str(error)))
    written = {letter for letter, text in zip("EGNR", fields[1:5], strict=True) if text}
    values = {}
    if "E" in written:
        values["youngs_modulus"] = numbers["E"]
    elif {"G", "N"} <= written:
        values["youngs_modulus"] = 2 * numbers["G"] * (1 + numbers["N"])
    if "N" in written:
        values["poissons_ratio"] = numbers["N"]
    elif {"E", "G"} <= written and numbers["G"]:
        values["poissons_ratio"] = numbers["E"] / (2 * numbers["G"]) - 1
    if "R" in written:
        values["density"] = numbers["R"] * factor
    return FileMaterial(name, values)
