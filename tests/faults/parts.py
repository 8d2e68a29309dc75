"""Drawings, meshes and models from elsewhere, and what they include or refer to."""

import os
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from random import Random

from cases import Case
from mpi4py import MPI
from world import World, command

import fenics_ehd as ehd
from fenics_ehd.base.processes import printing_kept
from fenics_ehd.fem.gmsh_session import gmsh, session

DECK = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n"
POINTS = '<Geometry GeometryType="XYZ"><DataItem Dimensions="4 3" Format="{}">{}</DataItem>'
XDMF = f'<Xdmf Version="3.0"><Domain><Grid>{POINTS}</Geometry></Grid></Domain></Xdmf>'
SCRIPT = 'SystemCall "touch ran";\n'


BULK = (
    "BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\n"
    "CTETRA,1,1,1,2,3,4\nPSOLID,1,1\nMAT1,1,2.1+11,,.3,7850.\nENDDATA\n"
)
MATERIAL = (
    "*MATERIAL,NAME=A\n*ELASTIC\n210e9,0.3\n*DENSITY\n7850\n*SOLID SECTION,ELSET=E,MATERIAL=A\n"
)


def _including(*names: str) -> str:
    return "".join(f"*INCLUDE, INPUT={name}\n" for name in names)


#: Text of every file, the part first, by what is wrong with it; ``pipe`` is one.
FILES: Mapping[str, Mapping[str, str]] = {
    "nested includes": {
        f"{n or 'part.inp'}": _including(f"{n + 1}") for n in range(1500)
    },
    "doubling includes": {
        f"{n or 'part.inp'}": _including(*[f"{n + 1}"] * 2 * (n < 27)) for n in range(28)
    },
    **{
        f"include of {name}": {"part.inp": DECK + _including(name)}
        for name in ("pipe", "/dev/zero", "/dev/stdin", ".", "part.inp", "/etc/hostname", "none")
    },
    **{
        f"{form} in {name}": {"part.xdmf": XDMF.format(form, name)}
        for form in ("HDF", "Binary", "XML")
        for name in ("pipe", "pipe:/x", "/dev/zero", "/dev/zero:/x", ".:/x", "none:/x", "")
    },
    **{
        f"second block of {kind}": {"part.inp": DECK + f"*ELEMENT,TYPE={kind}\n2,{nodes}\n"}
        for kind, nodes in (
            *(("C3D6", "1,2,3,4,1,2"), ("C3D10", "1,2,3,4"), ("S3", "1,2,3"), ("C3D8", "1,2,3,4")),
            *(("C3D4", "1,2,3,9"), ("C3D4", "1,2,3,x"), ("SC8R", "1,2,3,4,1,2,3,4"), ("", "1")),
        )
    },
    **{
        f"material {number}": {"part.inp": DECK + text}
        for number, text in enumerate(
            (
                *(MATERIAL, MATERIAL.replace("E,", "NONE,"), "*ELASTIC\n*DENSITY\n"),
                *("*MATERIAL\n*ELASTIC,TYPE=ORTHO\n1,2\n", "*ELSET,ELSET=E\nE\n" + MATERIAL),
                "*ELSET,ELSET=E,GENERATE\n1,999999999999,1\n" + MATERIAL,
            )
        )
    },
    **{
        f"bulk data with {new!r} for {old!r}": {"part.bdf": BULK.replace(old, new)}
        for old, new in (
            *(("1,2,3,4\n", "1,2,3\n"), ("1,2,3,4\n", "1,2,3,4,,\n,9\n"), ("1.,0.,0.", "1.,x,0.")),
            *(("GRID,2,,", "GRID,2,7,"), ("ENDDATA", "INCLUDE 'part.bdf'"), ("2.1+11", "2.1+1+1")),
            *(("ENDDATA", "INCLUDE 'pipe'"), ("BEGIN", "BEGIN SUPER=1\nBEGIN")),
            ("CTETRA", "CHEXA"),
            *(("GRID,3", "GRID,2"), ("MAT1,1", "MAT9,1"), ("CTETRA", ",,,,\nCTETRA")),
        )
    },
    "elements of I-DEAS cut short": {"part.unv": "    -1\n  2412\n 1 111 1 1 7 4\n    -1\n"},
    "elements of I-DEAS with words": {"part.unv": "    -1\n  2412\n 1 a 1 1 7 4\n    -1\n"},
    "a matrix of Abaqus": {"part.mtx": "1,1, 1,1, 2.0\n"},
    "elements in a pipe": {"part.node": "1 3 0 0\n1 0 0 0\n"},
    "entities": {
        "part.xdmf": '<!DOCTYPE Xdmf [<!ENTITY a "aaaaaaaaaa">'
        + "".join(f'<!ENTITY {x} "{f"&{y};" * 10}">' for y, x in pairwise("abcdefghij"))
        + "]><Xdmf Version='3.0'>&j;</Xdmf>"
    },
    **{
        f"script as .{ending}": {f"part.{ending}": SCRIPT}
        for ending in ("Unv", "UNV", "unv", "Step", "STP", "Iges", "Msh", "Geo", "inp", "brep", "")
    },
}  # fmt: skip


def _written(files: Mapping[str, str]) -> Callable[[Path], None]:
    def prepare(folder: Path) -> None:
        folder.mkdir(parents=True)
        os.mkfifo(folder / "pipe")
        if "part.node" in files:
            os.mkfifo(folder / "part.ele")
        for name, text in files.items():
            (folder / name).write_text(text)

    return prepare


def _listing(file: str) -> Callable[[], None]:
    """A call that lists the faces of a part; it must not run it as a script."""

    def call() -> None:
        try:
            command("part", file, "--json")()
        finally:
            assert not Path("ran").exists()

    return call


def _meshing() -> None:
    """Mesh a model, then one without a fault."""
    try:
        ehd.build_mesh("rod.geo", comm=MPI.COMM_SELF)
    finally:
        assert ehd.build_mesh(
            ehd.model_path("conrod"), {"shank_cells": 6}, comm=MPI.COMM_SELF
        ).groups


def _without(text: str, random: Random) -> str:
    """Text with some of its lines missing, or a number changed."""
    lines = text.splitlines(keepends=True)
    for _ in range(random.choice([1, 3, 10])):
        del lines[random.randrange(len(lines))]
    if random.random() < 0.3:
        return "".join(lines).replace(str(random.randrange(10)), str(random.randrange(10)), 1)
    return "".join(lines)


def _drawing(path: Path) -> str:
    """Text of a drawing of a plate with a hole."""
    with session():
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(-2, -2, 0, 4, 4, 1))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 1, 1))])
        occ.synchronize()
        with printing_kept():
            gmsh.write(str(path))
    return path.read_text()


def part_files(world: World, random: Random) -> Iterator[Case]:
    """Files that ``fenics-ehd part`` is given, and models of scenes."""
    for name, files in random.sample(list(FILES.items()), len(FILES)):
        part = next(iter(files))
        yield Case("part files", name, _written(files), _listing(part))
    step, model = _drawing(world.folder / "plate.step"), ehd.model_path("conrod").read_text()
    iges = (Path(__file__).parents[1] / "parts" / "ring.igs").read_text()
    while True:
        seed = random.randrange(2**32)
        cut = _written({"part.step": _without(step, Random(seed))})
        yield Case("part files", f"drawing ({seed})", cut, _listing("part.step"), slow=True)
        cut = _written({"part.igs": _without(iges, Random(seed))})
        yield Case("part files", f"IGES ({seed})", cut, _listing("part.igs"), slow=True)
        cut = _written({"rod.geo": _without(model, Random(seed))})
        yield Case("part files", f"model ({seed})", cut, _meshing, slow=True)
