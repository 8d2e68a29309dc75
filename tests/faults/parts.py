"""Drawings, meshes and models from elsewhere, and what they include or refer to."""

import os
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from random import Random

from bench_parts import gmsh, session
from bench_scenes import printing_kept
from cases import Case
from mpi4py import MPI
from world import World, command

import fenics_ehd as ehd

DECK = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n"
POINTS = '<Geometry GeometryType="XYZ"><DataItem Dimensions="4 3" Format="{}">{}</DataItem>'
XDMF = f'<Xdmf Version="3.0"><Domain><Grid>{POINTS}</Geometry></Grid></Domain></Xdmf>'
SCRIPT = 'SystemCall "touch ran";\n'


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
