"""Contents of mesh files of other programs: nodes, cells, materials, and counts of other entities.

Files have no units; the user gives the unit of length. Moduli and densities of a deck are assumed
to be in the consistent system of this unit, newton (for inches: pound-force) and second: in MPa and
t/mm3 for mm, in Pa and kg/m3 for m. A value outside the range of real materials is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import attrs
import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.sealed_file import named, require_file
from fenics_ehd.base.shared_settings import Material
from fenics_ehd.base.units import in_unit

#: Solid cells by meshio's names: kind, number of nodes that are kept, number of nodes of a cell.
CELLS = {
    "tetra": ("tet", 4, 4),
    "tetra10": ("tet", 10, 10),
    "hexahedron": ("hex", 8, 8),
    "hexahedron20": ("hex", 20, 20),
    "hexahedron27": ("hex", 20, 27),
}

#: Beginnings of the names of solid cells in meshio and Gmsh, also of kinds that are refused.
_SOLID = (
    *("tetra", "hexahedron", "wedge", "prism", "pyramid", "polyhedron", "trihedron"),
    *(f"VTK_LAGRANGE_{name}" for name in ("TETRAHEDRON", "HEXAHEDRON", "WEDGE", "PYRAMID")),
)

#: Numbers of nodes of other cells by meshio's names.
_OTHERS = {
    **{"vertex": 1, "line": 2, "line3": 3, "triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8},
    **{"quad9": 9, "wedge": 6, "wedge15": 15, "wedge18": 18, "pyramid": 5, "pyramid13": 13},
    **{"pyramid14": 14, "tetra20": 20},
}

#: Consistent unit of force of a unit of length, if it is not 1 N: size [N] and symbol.
_FORCES = {"in": (4.4482216152605, "lbf")}

#: SI unit of each quantity, and the exponent n in its consistent unit, force over length^n (times
#: second^2 for density).
_DIMENSIONS = {"youngs_modulus": ("Pa", 2), "density": ("kg/m3", 4)}


#: Largest number of files that a file may include, directly or indirectly, with repetitions.
MOST_FILES = 100


def included_text(path: Path, opened: list[Path]) -> str:
    """Read the text of a file, or of a file that it includes.

    Parameters
    ----------
    path
        Path of the file to read.
    opened
        Paths of the files that were read before, the main file first; `path` is appended.

    Raises
    ------
    MeshError
        If the file cannot be read or is not a regular file, or if more than `MOST_FILES` files
        are included.
    """
    opened.append(path)
    if len(opened) > MOST_FILES:
        raise MeshError(
            f"{opened[0]} includes more than {MOST_FILES} files, the last is {path}: does one "
            "include itself?"
        )
    with named(MeshError, str(path)):
        require_file(path)
        return path.read_text(encoding="utf-8", errors="replace")


@dataclass(frozen=True)
class FileMaterial:
    """Material of solid cells in a file's own units.

    Attributes
    ----------
    name
        Name of the material in the file.
    values
        Young's modulus, Poisson's ratio and density, if the file has them, in the units of the
        file, by the names of the attributes of `Material`.
    problems
        Reasons why the file's values cannot be used, for instance because the material is not
        isotropic, by the same names.
    """

    name: str
    values: Mapping[str, float] = field(default_factory=dict)
    problems: Mapping[str, str] = field(default_factory=dict)

    def same(self, other: FileMaterial) -> bool:
        """Whether another material has equal values; names may differ."""
        return (self.values, self.problems) == (other.values, other.problems)

    def in_si(self, name: str, unit: str, path: object) -> float:
        """Convert a value to SI units.

        Parameters
        ----------
        name
            Name of the attribute of `Material` that has the value.
        unit
            Unit of length of the file.
        path
            Path of the file, for messages.

        Raises
        ------
        MeshError
            If the value cannot be used, or is outside the range of real materials.
        """
        option = name.replace("_", "-")
        label = f"{path}: material {self.name} has"
        if name in self.problems:
            raise MeshError(f"{label} {self.problems[name]}: give --{option}")
        value = self.values[name]
        if name == "poissons_ratio":
            if not -1 < value < 0.49:
                raise MeshError(
                    f"{label} {name} {value:g}, but it must be above -1 and below 0.49: give "
                    f"--{option}"
                )
            return value
        si_unit, power = _DIMENSIONS[name]
        force, force_name = _FORCES.get(unit, (1.0, "N"))
        converted = value * force / in_unit(f"1 {unit}", "m") ** power
        low, high = attrs.fields_dict(Material)[name].metadata["usual"][0]
        if not low <= converted <= high:
            raise MeshError(
                f"{label} {name} {value:g}, which is {converted:.3g} {si_unit} if the file has the "
                f"units {unit}, {force_name} and s; it must be {low:g} to {high:g} {si_unit}: give "
                f"--unit, or --{option} in {si_unit}"
            )
        return converted


@dataclass(frozen=True, eq=False)
class ForeignMesh:
    """Nodes and all blocks of cells of a file.

    Attributes
    ----------
    points
        Positions of the nodes in the unit of the file, shape (n, 3).
    blocks
        Blocks of cells of the same kind, solid or not: meshio's name of the kind, and node indices
        of the cells, shape (c, k).
    others
        Counts of other entities by name: elements that are not solid, sets.
    materials
        Distinct materials of the solid cells.
    """

    points: np.ndarray
    blocks: Sequence[tuple[str, np.ndarray]]
    others: Mapping[str, int] = field(default_factory=dict)
    materials: Sequence[FileMaterial] = ()

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of cells of each kind, by meshio's name of the kind."""
        numbers: dict[str, int] = {}
        for name, cells in self.blocks:
            numbers[name] = numbers.get(name, 0) + len(cells)
        return numbers

    def left_out(self) -> str:
        """List of entities that are not part of the solid, as text; empty if there are none."""
        parts = {name: n for name, n in self.counts.items() if not name.startswith(_SOLID)}
        for name, number in self.others.items():
            parts[name] = parts.get(name, 0) + number
        return ", ".join(f"{number} {name}" for name, number in parts.items() if number)

    def solid_cells(self, path: object) -> tuple[str, np.ndarray]:
        """Kind of the solid cells, and their node indices, shape (c, 4, 8, 10 or 20).

        Raises
        ------
        MeshError
            If the file has no solid cells, or several kinds.
        """
        name = one_solid_kind(self.counts, self.left_out(), path)
        kind, kept, _ = CELLS[name]
        blocks = [np.asarray(cells)[:, :kept] for block, cells in self.blocks if block == name]
        return kind, np.concatenate([cells for cells in blocks if len(cells)]).astype(np.int64)

    def check(self, path: object) -> ForeignMesh:
        """Check node numbers and the shapes of arrays; return the mesh itself.

        Raises
        ------
        MeshError
            If an array is wrong; the message names the cells.
        """
        nodes = len(self.points)
        for name, cells in self.blocks:
            size = CELLS[name][2] if name in CELLS else _OTHERS.get(name)
            shape = np.shape(cells)
            if size is None or not len(cells):
                continue
            if len(shape) != 2 or shape[1] != size or np.asarray(cells).dtype.kind not in "iu":
                wrong = f"{shape[1]} nodes" if len(shape) == 2 else "different numbers of nodes"
                raise MeshError(f"{path}: {name} cells have {wrong}, but must have {size} nodes")
            if name in CELLS and not 0 <= np.min(cells) <= np.max(cells) < nodes:
                raise MeshError(f"{path}: {name} cells refer to nodes that the file does not have")
            if name in CELLS and np.shape(self.points)[1:] != (3,):
                raise MeshError(f"{path}: nodes of shape {np.shape(self.points)}, not (n, 3)")
        return self

    def require_one_material(self, path: object) -> None:
        """Refuse solid cells of several materials.

        Raises
        ------
        MeshError
            If the cells have several materials; the message names the materials.
        """
        different: list[FileMaterial] = []
        for one in self.materials:
            if not any(one.same(other) for other in different):
                different.append(one)
        if len(different) > 1:
            names = ", ".join(one.name for one in different)
            raise MeshError(
                f"{path} has solid cells of {len(different)} materials, {names}, but a part has "
                "one material: export the cells of one material"
            )


def one_solid_kind(counts: Mapping[str, int], others: str, path: object) -> str:
    """Meshio's name of the only kind of solid cells in a file.

    Parameters
    ----------
    counts
        Number of cells of each kind, by meshio's name of the kind.
    others
        Description of other contents, for the message about a file without solid cells.
    path
        Path of the file.

    Raises
    ------
    MeshError
        If the file has no solid cells, several kinds, or a kind that is not in `CELLS`.
    """
    solids = {name: n for name, n in counts.items() if name.startswith(_SOLID) and n}
    if len(solids) != 1 or not set(solids) <= set(CELLS):
        contents = ", ".join(f"{n} {name}" for name, n in solids.items()) or others
        raise MeshError(
            f"{path} has {contents or 'no cells'}: it needs one kind of solid cells, of "
            f"{', '.join(CELLS)}"
        )
    return next(iter(solids))


def part_material(
    found: Sequence[FileMaterial], unit: str, given: Mapping[str, float], path: object
) -> tuple[Material, list[str]]:
    """Material of a part, and a notice about each of its values that is not from the file.

    Parameters
    ----------
    found
        Materials of the file's solid cells, all with equal values. If the list is empty, there are
        no notices.
    unit
        Unit of length of the file.
    given
        Values in SI units that replace those of the file.
    path
        Path of the file.

    Raises
    ------
    MeshError
        If `FileMaterial.in_si` refuses a value.
    """
    lines = []
    values = dict(given)
    for material in found[:1]:
        label = f"{path}: material {material.name} has"
        for name, setting in attrs.fields_dict(Material).items():
            if name in given:
                if name in material.values:
                    lines.append(
                        f"{label} {name} {material.values[name]:g}, {given[name]:g} is given"
                    )
            elif name in material.values or name in material.problems:
                values[name] = material.in_si(name, unit, path)
            else:
                lines.append(f"{label} no {name}: {setting.default:g} is taken")
    return Material(**values), lines
