"""Parts as other programs give them: python demos/parts/example_parts.py FOLDER.

All are connecting rods of the shipped model's default dimensions, turned and shifted, in
millimetres: `rod.step` from OpenCASCADE, `drilled.step` with chamfered big end and an oil hole,
`drilled.msh`, the same meshed by Gmsh with tetrahedra, `rod.inp` of C3D10 tetrahedra,
`turned.msh` of 27-node hexahedra, nodes rounded to 0.1 um, and `calculix.inp`, which has CalculiX
store the matrices of 20-node hexahedra, in N, mm and t.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import gmsh
import meshio
import numpy as np

import fenics_ehd as ehd
from fenics_ehd.base.processes import printing_kept
from fenics_ehd.fem.solid import Solid, used

ELEMENT = {"hex": "C3D20", "tet": "C3D10"}
TURN, SHIFT = (1.0, 2.0, 3.0, 0.7), (120.0, -30.0, 55.0)


def drawing(path: Path, *, drilled: bool) -> None:
    """A rod as a CAD program draws it."""
    occ = gmsh.model.occ
    ring = [occ.addCylinder(0, 0, -11, 0, 0, 22, 33.9), occ.addCylinder(160, 0, -11, 0, 0, 22, 21)]
    solids = [(3, ring[0])], [(3, ring[1]), (3, occ.addBox(0, -12.5, -11, 160, 25, 22))]
    rod = occ.fuse(*solids)[0]
    tools = [occ.addCylinder(0, 0, -11, 0, 0, 22, 22.5), occ.addCylinder(160, 0, -11, 0, 0, 22, 12)]
    if drilled:
        tools.append(occ.addCylinder(-40, 0, 2, 30, 0, 0, 2.5))
        tools += [
            occ.addCone(0, 0, -11, 0, 0, 1, 23.5, 22.5),
            occ.addCone(0, 0, 11, 0, 0, -1, 23.5, 22.5),
        ]
    rod = occ.cut(rod, [(3, tool) for tool in tools])[0]
    axis = np.array(TURN[:3]) / np.linalg.norm(TURN[:3])
    occ.rotate(rod, 0, 0, 0, *axis, TURN[3])
    occ.translate(rod, *SHIFT)
    occ.synchronize()
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    with printing_kept():
        gmsh.write(str(path))
    if drilled:
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 20)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 8)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.model.mesh.optimize("HighOrderFastCurving")
        gmsh.write(str(path.with_suffix(".msh")))
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1e22)
    gmsh.clear()


def mesh(path: Path, cells: str, tetrahedra: float) -> None:
    """A mesh of the shipped model as another program would have it."""
    gmsh.open(str(ehd.model_path("conrod")))
    gmsh.onelab.setNumber("Rod/tetrahedra", [tetrahedra])
    gmsh.open(str(ehd.model_path("conrod")))
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    own = path.with_suffix(".own.msh")
    gmsh.write(str(own))
    gmsh.clear()
    gmsh.onelab.clear()
    with printing_kept():
        found = meshio.read(own)
    own.unlink()
    turned = 1e3 * found.points @ rotation().T + SHIFT
    block = np.vstack([block.data for block in found.cells if block.type == cells])
    if path.stem == "calculix":
        numbers = np.arange(1, len(turned) + 1)
        solid = used(Solid(np.round(turned, 4), block[:, :20], "hex"))
        write_deck(path, solid, numbers[: len(solid.points)], (210e3, 0.3, 7.85e-9))
        return
    options = {"float_fmt": ".4f"} if path.suffix == ".inp" else {"binary": False}
    form = {} if path.suffix == ".inp" else {"file_format": "gmsh"}
    meshio.write(path, meshio.Mesh(np.round(turned, 4), [(cells, block)]), **form, **options)


def write_deck(
    path: Path,
    solid: Solid,
    numbers: np.ndarray,
    material: tuple[float, float, float],
    held: Iterable[int] = (),
) -> None:
    """Input of CalculiX that stores the matrices; nodes have the given numbers."""
    lines = ["*NODE, NSET=ALL"]
    lines += [
        ",".join([str(n), *(f"{v:.13e}" for v in x)])
        for n, x in zip(numbers, solid.points, strict=True)
    ]
    lines.append(f"*ELEMENT, TYPE={ELEMENT[solid.kind]}, ELSET=PART")
    for number, cell in enumerate(numbers[solid.cells], 1):
        rows = [[number, *cell][i : i + 15] for i in range(0, len(cell) + 1, 15)]
        lines += [",\n".join(",".join(map(str, row)) for row in rows)]
    young, poisson, density = material
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{young},{poisson}", "*DENSITY", f"{density}"]
    lines += ["*SOLID SECTION, ELSET=PART, MATERIAL=STEEL"]
    if fixed := [f"{n},1,3" for n in held]:
        lines += ["*BOUNDARY", *fixed]
    lines += ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "1", "*END STEP"]
    path.write_text("\n".join(lines) + "\n")


def rotation() -> np.ndarray:
    """About the axis of `TURN`, shape (3, 3)."""
    x, y, z = np.array(TURN[:3]) / np.linalg.norm(TURN[:3])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(TURN[3]) * cross + (1 - np.cos(TURN[3])) * cross @ cross


def main(folder: Path) -> None:
    """All of them."""
    folder.mkdir(parents=True, exist_ok=True)
    gmsh.initialize([""], readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    drawing(folder / "rod.step", drilled=False)
    drawing(folder / "drilled.step", drilled=True)
    mesh(folder / "rod.inp", "tetra10", 1.0)
    mesh(folder / "turned.msh", "hexahedron27", 0.0)
    mesh(folder / "calculix.inp", "hexahedron27", 0.0)
    gmsh.finalize()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
