"""Reader of Abaqus and CalculiX decks: nodes, elements of all types, materials of solids.

The module replaces meshio's reader. If a deck has a second ``*NODE``, for instance for reference
points, meshio's reader drops all nodes before it. It knows type names only in capitals, and refuses
unknown element types. Messages do not quote lines of a deck, because a deck may include any file.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.fem.foreign_mesh import FileMaterial, ForeignMesh, included_text

#: Names in meshio of C3D elements by number of nodes; the order of the nodes is that of VTK.
_NAMES = {
    **{4: "tetra", 10: "tetra10", 8: "hexahedron", 20: "hexahedron20", 27: "hexahedron27"},
    **{5: "pyramid", 6: "wedge", 15: "wedge15"},
}
#: Pattern of the types of elements that fill a volume (solids, continuum shells, cohesive elements)
#: with the number of nodes.
_SOLID = re.compile(r"(?:C3D|SC|CSS|COH3D)(\d+)[A-Z]*")

#: Keywords that begin or end a scope, a part or an instance with node numbers of its own.
_SCOPES = {
    *("PART", "ENDPART", "INSTANCE", "ENDINSTANCE", "ASSEMBLY", "ENDASSEMBLY"),
}

#: Keywords that create or move nodes and elements without listing them.
_GENERATORS = {"NCOPY", "NFILL", "NGEN", "NMAP", "SYSTEM", "ELCOPY", "ELGEN"}

#: Keywords that constrain or connect nodes or give them mass; a part ignores them.
_JOINING = {
    *("BOUNDARY", "EQUATION", "MPC", "TIE", "COUPLING", "KINEMATICCOUPLING"),
    *("DISTRIBUTINGCOUPLING", "RIGIDBODY", "EMBEDDEDELEMENT", "NONSTRUCTURALMASS"),
    *("PRE-TENSIONSECTION", "SHELLTOSOLIDCOUPLING"),
}


@dataclass(eq=False)
class _Section:
    """Section of a deck: a keyword and its options, both in capitals, and the data lines."""

    keyword: str
    options: Mapping[str, str]
    rows: list[str]


@dataclass(eq=False)
class _Scope:
    """Sections of a part or an instance, or of a deck without parts.

    Attributes
    ----------
    kind, options
        Keyword that begins the scope, and its options.
    sections
        Sections in the scope.
    """

    kind: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    sections: list[_Section] = field(default_factory=list)

    def of(self, keyword: str) -> list[_Section]:
        """Sections of the scope with a keyword."""
        return [section for section in self.sections if section.keyword == keyword]

    @property
    def solids(self) -> list[_Section]:
        """Sections of the scope that contain solid elements."""
        return [s for s in self.of("ELEMENT") if _SOLID.fullmatch(s.options.get("TYPE", ""))]


def read_deck(path: Path) -> ForeignMesh:
    """Read nodes, solid cells and their materials from a deck; count other entities.

    Nodes are in ascending order of their numbers.

    Parameters
    ----------
    path
        Path of a deck. In a deck with parts and instances, only one of them may have solid cells;
        the position of an instance is ignored. Files of ``*INCLUDE`` and ``INPUT=`` are read.

    Raises
    ------
    MeshError
        If the deck cannot be read, or has no solid cells, or has solid cells in several parts or
        instances.
    """
    scopes = _scopes(path)
    solid = [scope for scope in scopes if scope.solids]
    if not solid:
        raise MeshError(f"{path} has no C3D4, C3D8, C3D10, C3D20: it needs one kind of solid cells")
    count = max(len(solid), _instances(scopes, solid[0]))
    if count > 1:
        raise MeshError(
            f"{path} has {count} parts with solid cells, but must have one: export the part alone"
        )
    scope = solid[0]
    try:
        numbers, points = _nodes(scope)
        elements = [_elements(section) for section in scope.solids]
        nodes = [_looked_up(numbers, table[:, 1:]) for table in elements]
    except (ValueError, OverflowError):
        types = dict.fromkeys(section.options["TYPE"] for section in scope.solids)
        raise MeshError(
            f"{path}: every line of *NODE must have the coordinates of a node, and every line of "
            f"{', '.join(types)} the numbers of all nodes of an element"
        ) from None
    blocks = [(_cell(section), cells) for section, cells in zip(scope.solids, nodes, strict=True)]
    element_numbers = [table[:, 0] for table in elements]
    materials = _materials(scopes, scope, element_numbers)
    return ForeignMesh(points, blocks, _others(scopes), materials)


def _scopes(path: Path) -> list[_Scope]:
    """Divide a deck into scopes with their sections.

    Raises
    ------
    MeshError
        If the deck generates nodes or elements, or has nodes in another coordinate system.
    """
    scopes = [_Scope()]
    # A keyword begins with one star. Comments, with two stars, are already removed.
    for text in re.split(r"^\*", _text(path, []), flags=re.MULTILINE)[1:]:
        header, _, body = text.partition("\n")
        keyword, options = _keyword(header)
        if keyword in _SCOPES:
            scopes.append(_Scope(keyword, options))
        elif keyword in _GENERATORS:
            raise MeshError(
                f"{path} has *{keyword}: write a deck that lists all nodes and elements"
            )
        elif keyword == "NODE" and options.get("SYSTEM", "R") != "R":
            raise MeshError(f"{path} has *NODE, SYSTEM={options['SYSTEM']}: write x, y, z of nodes")
        rows = [row for row in body.splitlines() if row.strip()]
        scopes[-1].sections.append(_Section(keyword, options, rows))
    return scopes


def _instances(scopes: Sequence[_Scope], part: _Scope) -> int:
    """Number of instances of a part in the assembly."""
    if part.kind != "PART":
        return 1
    name = part.options.get("NAME")
    return sum(scope.kind == "INSTANCE" and scope.options.get("PART") == name for scope in scopes)


def _nodes(scope: _Scope) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the nodes of a scope, ascending, shape (n,), and their positions, (n, 3).

    Raises
    ------
    ValueError
        If a line has a field that is not a number.
    """
    rows = [row for section in scope.of("NODE") for row in section.rows]
    _require_numbers(rows, "0-9eEdD+.")
    fields = [row.upper().replace("D", "E").split(",") for row in rows]
    # A line may omit coordinates that are zero. If a number is repeated, the last line is valid.
    listed = {int(row[0]): [*row[1:4], "", ""][:3] for row in fields}
    numbers = np.array(sorted(listed), dtype=np.int64)
    texts = [[text.strip() or "0" for text in listed[number]] for number in numbers.tolist()]
    return numbers, np.array(texts, dtype=float).reshape(-1, 3)


def _elements(section: _Section) -> np.ndarray:
    """Number and node numbers of each element in a section, shape (c, 1 + k)."""
    match = _SOLID.fullmatch(section.options["TYPE"])
    assert match is not None
    _require_numbers(section.rows, "0-9")
    texts = [text for text in ",".join(section.rows).split(",") if text.strip()]
    return np.array(texts, dtype=object).astype(np.int64).reshape(-1, 1 + int(match[1]))


def _require_numbers(rows: Sequence[str], characters: str) -> None:
    """Refuse lines with characters that Python accepts in a number but Abaqus does not.

    Raises
    ------
    ValueError
        If a line has a character other than `characters`, commas, blanks and minus signs.
    """
    if re.search(rf"[^{characters},\s-]", "\n".join(rows)):
        raise ValueError("a data line has characters that no number has")


def _looked_up(numbers: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Indices of the node numbers `nodes` in the ascending array `numbers`.

    Raises
    ------
    ValueError
        If a node number is not in the array.
    """
    indices = np.minimum(np.searchsorted(numbers, nodes), len(numbers) - 1)
    if not len(numbers) or (numbers[indices] != nodes).any():
        raise ValueError("an element has a node that the deck does not define")
    return indices


def _cell(section: _Section) -> str:
    """Meshio's name of the cells in a section of solid elements.

    The element type is appended if it does not begin with C3D; such cells cannot make up a part.
    """
    type_name = section.options["TYPE"]
    family = _SOLID.fullmatch(type_name)
    assert family is not None
    name = _NAMES.get(int(family[1]), "polyhedron")
    return name if type_name.startswith("C3D") else f"{name} {type_name}"


def _others(scopes: Sequence[_Scope]) -> dict[str, int]:
    """Count elements that are not solid, and sets, constraints and connections, by name."""
    counts: Counter[str] = Counter()
    for section in (section for scope in scopes for section in scope.sections):
        if section.keyword == "ELEMENT":
            type_name = section.options.get("TYPE", "elements")
            if not _SOLID.fullmatch(type_name):
                ends = [row.rstrip().endswith(",") for row in section.rows]
                counts[type_name] += len(ends) - sum(ends[:-1])
        elif section.keyword in ("NSET", "ELSET"):
            counts["sets"] += 1
        elif section.keyword in _JOINING:
            counts[f"*{section.keyword}"] += 1
    return dict(counts)


def _materials(
    scopes: Sequence[_Scope], solid: _Scope, elements: Sequence[np.ndarray]
) -> list[FileMaterial]:
    """Materials that ``*SOLID SECTION`` assigns to sets with solid elements.

    A deck without such a section must have at most one material, which is then the result.
    """
    known = _all_materials(section for scope in scopes for section in scope.sections)
    names = [
        section.options.get("MATERIAL", "")
        for section in solid.of("SOLIDSECTION")
        if _has_solid(solid, section.options.get("ELSET", ""), elements)
    ]
    if not names and len(known) > 1:
        problem = f"no *SOLID SECTION that names one of {len(known)} materials"
        return [FileMaterial("of the solid cells", {}, dict.fromkeys(_EVERY, problem))]
    if not names:
        return list(known.values())
    return [known.get(name, FileMaterial(name)) for name in dict.fromkeys(names)]


def _has_solid(scope: _Scope, name: str, elements: Sequence[np.ndarray]) -> bool:
    """Whether an element set contains a solid element; true for a set that is not defined."""
    pending = [name]
    seen: set[str] = set()
    while pending:
        seen.add(name := pending.pop())
        for section in scope.of("ELEMENT"):
            if section.options.get("ELSET", "") == name and section in scope.solids:
                return True
        for section in scope.of("ELSET"):
            if section.options.get("ELSET") == name:
                if any(_has_element(section, numbers) for numbers in elements):
                    return True
                pending += _words(section) - seen
    sets = {s.options.get("ELSET", "") for s in scope.sections if s.keyword in ("ELEMENT", "ELSET")}
    return not seen & sets


def _words(section: _Section) -> set[str]:
    """Entries in the data lines of a set: element numbers and set names, in capitals."""
    rows = re.sub(r"[^\S\n]", "", "\n".join(section.rows)).upper()
    return {word for word in re.split(r"[,\n]", rows) if word}


def _has_element(section: _Section, elements: np.ndarray) -> bool:
    """Whether a section of a set contains one of the `elements`, in a list or in a range."""
    if "GENERATE" in section.options:
        for row in section.rows:
            first, last, step = [*map(int, re.findall(r"\d+", row)[:3]), 1, 1, 1][:3]
            inside = (elements >= first) & (elements <= last)
            if (inside & ((elements - first) % max(step, 1) == 0)).any():
                return True
        return False
    return not _words(section).isdisjoint(map(str, elements.tolist()))


def _all_materials(sections: Iterable[_Section]) -> dict[str, FileMaterial]:
    """Isotropic elastic materials by name."""
    sections_of: dict[str, dict[str, _Section]] = {}
    name = None
    for section in sections:
        if section.keyword == "MATERIAL":
            name = section.options.get("NAME", "")
            sections_of[name] = {}
        elif section.keyword in {*_QUANTITIES, *_OTHER_ELASTICITY} and name is not None:
            sections_of[name][section.keyword] = section
    return {name: _material(name, parts) for name, parts in sections_of.items()}


#: Names in `Material` of the first numbers in the data line of a keyword.
_QUANTITIES = {"ELASTIC": ("youngs_modulus", "poissons_ratio"), "DENSITY": ("density",)}
_EVERY = [name for names in _QUANTITIES.values() for name in names]

#: Keywords of materials that are not linear and isotropic.
_OTHER_ELASTICITY = {
    *("HYPERELASTIC", "ANISOTROPICHYPERELASTIC", "HYPERFOAM", "HYPOELASTIC", "LOWDENSITYFOAM"),
    "USERMATERIAL",
}


def _material(name: str, parts: Mapping[str, _Section]) -> FileMaterial:
    """Make a material from the sections of its keywords."""
    values: dict[str, float] = {}
    problems: dict[str, str] = {}
    for keyword, section in parts.items():
        names = _QUANTITIES.get(keyword, _QUANTITIES["ELASTIC"])
        numbers = _numbers(section.rows[0]) if section.rows else []
        kind = section.options.get("TYPE", "ISO")
        if keyword in _OTHER_ELASTICITY:
            problems |= dict.fromkeys(names, f"*{keyword}")
        elif not "ISOTROPIC".startswith(kind):
            problems |= dict.fromkeys(names, f"*{keyword}, TYPE={kind}")
        elif len(section.rows) != 1:
            problems |= dict.fromkeys(names, f"*{keyword} of {len(section.rows)} rows, not one")
        elif len(numbers) < len(names):
            problems |= dict.fromkeys(names, f"*{keyword} without {' and '.join(names)}")
        else:
            values |= dict(zip(names, numbers, strict=False))
    return FileMaterial(name or "without a name", values, problems)


def _numbers(row: str) -> list[float]:
    """Numbers of a data line, up to its first field that is not a number."""
    numbers = []
    for text in row.split(","):
        try:
            numbers.append(float(text))
        except ValueError:
            break
    return numbers


def _text(path: Path, opened: list[Path]) -> str:
    """Read a deck with its included files.

    Comments are removed, and continued lines of a keyword are joined.
    """
    text = included_text(path, opened)

    def included(name: str) -> str:
        return _text(path.parent / name.strip().strip('"'), opened)

    text = re.sub(r"^\*\*.*\n?", "", text, flags=re.MULTILINE)
    text = re.sub(r"^(\*.*,)[ \t]*\n", r"\1", text, flags=re.MULTILINE)
    text = _INCLUDE.sub(lambda line: included(line[1]), text)
    return _ROWS_ELSEWHERE.sub(lambda line: f"{line[1]}{line[3]}\n{included(line[2])}", text)


#: Pattern of a line that includes a file.
_INCLUDE = re.compile(r"^\*\s*INCLUDE\s*,.*INPUT\s*=\s*([^,\n]+).*$", re.IGNORECASE | re.MULTILINE)

#: Pattern of keywords whose data lines are in a separate file.
_ROWS_ELSEWHERE = re.compile(
    r"^(\*[ \t]*(?:NODE|ELEMENT|NSET|ELSET)[ \t]*(?:,.*?)?),[ \t]*INPUT[ \t]*=[ \t]*([^,\n]+)(.*)$",
    re.IGNORECASE | re.MULTILINE,
)


def _keyword(line: str) -> tuple[str, dict[str, str]]:
    """Name of a keyword without blanks, and its options by name, in capitals."""
    keyword, *options = re.sub(r"\s", "", line).upper().split(",")
    pairs = [option.partition("=") for option in options if option]
    return keyword, {name: value.strip('"') for name, _, value in pairs}
