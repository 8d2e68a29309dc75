"""Cells, nodes and materials of other programs' meshes: all are counted, one kind is taken."""

import json
from pathlib import Path

import meshio
import numpy as np
import pytest
from calculix_ring import DENSITY, POISSON, YOUNG, ring_solid, surfaces, write_model
from command_line import exit_of
from foreign_parts import OUTER, RADIUS
from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.base.processes import printing_kept
from fenics_ehd.fem.drawn_part import NamedFaces, open_part, place_part, write_part
from fenics_ehd.fem.foreign_mesh import ForeignMesh
from fenics_ehd.fem.gmsh_session import gmsh, session
from fenics_ehd.fem.solid import Solid, inside_out, second_order
from fenics_ehd.fem.solid_file import read_mesh, read_part
from fenics_ehd.fem.structure import part_responses
from fenics_ehd.reduction.mesh_error import compliance_errors
from fenics_ehd.reduction.reductor import rigid

STEEL = ehd.Material(YOUNG, POISSON, DENSITY)

#: Names of cells in decks, in bulk data and in meshio.
TYPES = {"hex": ("C3D8", "CHEXA", "hexahedron"), "tet": ("C3D4", "CTETRA", "tetra")}


def corners_of_ring(kind, around=12, along=2, across=1):
    """Nodes and cells of the ring, corners alone."""
    solid = ring_solid(kind, around, along, across)
    return solid.points[: solid.corners.max() + 1], solid.corners


def with_wedges(cells):
    """Blocks of the ring's hexahedra, of which the first three are cut in two wedges each."""
    halves = np.concatenate([cells[:3, [0, 1, 2, 4, 5, 6]], cells[:3, [0, 2, 3, 4, 6, 7]]])
    return [("hexahedron", cells[3:]), ("wedge", halves)]


def deck_of(points, blocks, more=""):
    """Text of a deck; each type has a set of elements of its own."""
    names = {"hexahedron": "C3D8", "wedge": "C3D6", "tetra": "C3D4"}
    lines = [
        "*NODE",
        *(f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in enumerate(points.tolist(), 1)),
    ]
    number = 0
    for name, cells in blocks:
        lines.append(f"*ELEMENT, TYPE={names[name]}, ELSET=E{names[name]}")
        for cell in (cells + 1).tolist():
            number += 1
            lines.append(", ".join(map(str, [number, *cell])))
    return "\n".join([*lines, more]) + "\n"


def bulk_of(points, blocks, more=""):
    """Text of free-field bulk data."""
    names = {"hexahedron": "CHEXA", "wedge": "CPENTA", "tetra": "CTETRA"}
    lines = ["BEGIN BULK"]
    lines += [f"GRID,{n},,{x!r},{y!r},{z!r}" for n, (x, y, z) in enumerate(points.tolist(), 1)]
    number = 0
    for name, cells in blocks:
        for cell in (cells + 1).tolist():
            number += 1
            fields = [str(n) for n in (number, 1, *cell)]
            lines.append(",".join([names[name], *fields[:8]]))
            lines += [",".join(["", *fields[8:]])] * (len(fields) > 8)
    return "\n".join([*lines, more, "ENDDATA"]) + "\n"


def write_ideas(path, points, blocks):
    """As I-DEAS has it, datasets of nodes and of elements."""
    descriptors = {"hexahedron": 115, "wedge": 112}
    lines = ["    -1", "  2411"]
    for number, x in enumerate(points.tolist(), 1):
        lines += [f"{number:10d}         1         1        11", "".join(f"{v:25.16E}" for v in x)]
    lines += ["    -1", "    -1", "  2412"]
    number = 0
    for name, cells in blocks:
        for cell in (cells + 1).tolist():
            number += 1
            record = (number, descriptors[name], 1, 1, 7, len(cell))
            lines += ["".join(f"{n:10d}" for n in row) for row in (record, cell)]
    path.write_text("\n".join([*lines, "    -1"]) + "\n")


def write_mesh(path, points, blocks):
    """The ring as another program would write it, by the ending of the name."""
    if path.suffix == ".inp":
        path.write_text(deck_of(points, blocks))
    elif path.suffix == ".bdf":
        path.write_text(bulk_of(points, blocks))
    elif path.suffix == ".unv":
        write_ideas(path, points, blocks)
    else:
        form = {"file_format": "gmsh22"} if path.suffix == ".msh" else {}
        blocks = [(name, np.asarray(cells, dtype=np.int32)) for name, cells in blocks]
        data = {}
        if path.suffix == ".msh":
            ones = [np.ones(len(cells), dtype=np.int32) for _, cells in blocks]
            data = {"cell_data": {"gmsh:physical": ones, "gmsh:geometrical": ones}}
            data["field_data"] = {"part": np.array([1, 3])}
        with printing_kept():
            meshio.Mesh(points, blocks, **data).write(path, **form)


@pytest.mark.parametrize("ending", ["inp", "bdf", "unv", "msh", "vtu"])
def test_cells_of_two_kinds_refuse_the_file_with_their_numbers(ending, tmp_path):
    points, cells = corners_of_ring("hex", 12, 2, 2)
    file = tmp_path / f"ring.{ending}"
    write_mesh(file, points, [("hexahedron", cells)])
    assert len(read_mesh(file, "m").cells) == len(cells)
    write_mesh(file, points, with_wedges(cells))
    with pytest.raises(ehd.errors.MeshError, match=f"has {len(cells) - 3} hexahedron, 6 wedge: it"):
        read_mesh(file, "m")


def test_cells_of_two_kinds_refuse_a_model_with_their_numbers(tmp_path):
    points, cells = corners_of_ring("hex", 12, 2, 2)
    write_mesh(tmp_path / "ring.msh", points, with_wedges(cells))
    message = rf"has {len(cells) - 3} hexahedron27, 6 wedge18: .* only 27-node.* 'fenics-ehd part'"
    with pytest.raises(ehd.errors.MeshError, match=message):
        ehd.build_mesh(tmp_path / "ring.msh", comm=MPI.COMM_SELF)


LEFT_OUT = """*ELEMENT, TYPE=S3
9001, 1, 2, 3
9002, 1, 2, 4
*ELEMENT, TYPE=MASS, ELSET=HEAVY
9003, 1
*MASS, ELSET=HEAVY
0.5
*NSET, NSET=A
1, 2
*TIE, NAME=T
a, b
"""


def test_what_is_left_out_is_listed_in_one_line(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    points, cells = corners_of_ring("hex")
    Path("ring.inp").write_text(deck_of(points, [("hexahedron", cells)], LEFT_OUT))
    listed = "2 S3, 1 MASS, 1 sets, 1 *TIE"
    with pytest.warns(UserWarning, match="left out are 2 S3, 1 MASS, 1 sets, 1 .TIE"):
        read_mesh(Path("ring.inp"), "m")
    _, out, _ = exit_of(capfd, "part", "ring.inp")
    assert out.splitlines()[-1] == f"left out of the file: {listed}"
    asked = ["part", "ring.inp", "--bore", "20mm", "--no-check", "-o", "ring.msh", "--json"]
    _, out, _ = exit_of(capfd, *asked)
    assert json.loads(out)["left_out"] == listed


def test_a_part_that_is_placed_twice(tmp_path):
    points, cells = corners_of_ring("hex")
    instance = "*Instance, name=I{0}, part=RING\n*End Instance\n"
    deck = deck_of(points, [("hexahedron", cells)])
    text = f"*Part, name=Ring\n{deck}*End Part\n*Assembly, name=A\n"
    (tmp_path / "one.inp").write_text(f"{text}{instance.format(1)}*End Assembly\n")
    read_mesh(tmp_path / "one.inp", "m")
    (tmp_path / "two.inp").write_text(f"{text}{instance.format(1)}{instance.format(2)}")
    with pytest.raises(ehd.errors.MeshError, match="has 2 parts with solid cells"):
        read_mesh(tmp_path / "two.inp", "m")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "*NODE, SYSTEM=C\n1,1,0,0\n*ELEMENT,TYPE=C3D4\n1,1,1,1,1\n",
            r"has \*NODE, SYSTEM=C: write",
        ),
        ("*NODE\n1,0,0,1_0\n*ELEMENT,TYPE=C3D4\n1,1,1,1,1\n", "line of .NODE must have"),
        ("*NODE\n1,0,0,0\n*ELEMENT,TYPE=SC8R\n1,1,1,1,1,1,1,1,1\n", "has 1 hexahedron SC8R: it"),
    ],
)
def test_deck_that_would_be_misread(text, message, tmp_path):
    (tmp_path / "deck.inp").write_text(text)
    with pytest.raises(ehd.errors.MeshError, match=message):
        read_mesh(tmp_path / "deck.inp", "m")


def test_rows_of_nodes_in_a_file_of_their_own(tmp_path):
    points, cells = corners_of_ring("hex")
    nodes, elements = deck_of(points, [("hexahedron", cells)]).split("*ELEMENT")
    (tmp_path / "nodes.txt").write_text(nodes.removeprefix("*NODE\n"))
    (tmp_path / "ring.inp").write_text(f"*NODE, INPUT=nodes.txt, NSET=ALL\n*ELEMENT{elements}")
    np.testing.assert_array_equal(read_mesh(tmp_path / "ring.inp", "m").points, points)


# Materials

ALUMINIUM = "*MATERIAL, NAME=Alu\n*ELASTIC\n70000., 0.33\n*DENSITY\n2.7e-9,\n"
BRONZE = "*MATERIAL, NAME=Bronze\n*DENSITY\n8.8e-9\n*ELASTIC, TYPE=ISOTROPIC\n110000., 0.34\n"
TWIN = ALUMINIUM.replace("Alu", "Twin")
HALVES = "*ELSET, ELSET=LOW, GENERATE\n1, 12, 1\n*ELSET, ELSET=HIGH\n13, 14\n15\n"


def solid_sections(**materials):
    return "".join(
        f"*SOLID SECTION, ELSET={name}, MATERIAL={material}\n1.,\n"
        for name, material in materials.items()
    )


def part_of_deck(capfd, more, *options, unit="mm"):
    """Status, the answer and the error output of `part` for the ring in millimetres."""
    points, cells = corners_of_ring("hex")
    Path("ring.inp").write_text(deck_of(1e3 * points, [("hexahedron", cells)], more))
    asked = ["part", "ring.inp", "--unit", unit, "--bore", "1", "--no-check", "-o", "ring.msh"]
    status, out, err = exit_of(capfd, *asked, *options, "--json")
    return status, json.loads(out) if not status else {}, err


@pytest.mark.parametrize(
    "more",
    [
        ALUMINIUM + solid_sections(EC3D8="Alu"),
        ALUMINIUM,
        ALUMINIUM + BRONZE + "*ELEMENT,TYPE=S3,ELSET=SKIN\n9001,1,2,3\n"
        "*SHELL SECTION, ELSET=SKIN, MATERIAL=Bronze\n1.\n" + solid_sections(EC3D8="Alu"),
        ALUMINIUM + TWIN + HALVES + solid_sections(LOW="Alu", HIGH="Twin"),
    ],
)
def test_one_material_of_a_deck_is_taken(more, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    status, answer, err = part_of_deck(capfd, more)
    assert (status, err) == (0, "")
    expected = {"youngs_modulus": 70e9, "poissons_ratio": 0.33, "density": 2700.0}
    assert answer["material"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("more", "options", "message"),
    [
        (
            ALUMINIUM + BRONZE + HALVES + solid_sections(LOW="Alu", HIGH="Bronze"),
            [],
            "has solid cells of 2 materials, ALU, BRONZE",
        ),
        (ALUMINIUM + BRONZE, [], "no *SOLID SECTION that names one of 2 materials: give --young"),
        (ALUMINIUM.replace("2.7e-9", "2700"), [], "density 2700, which is 2.7e+15"),
        (ALUMINIUM.replace("70000.", "70e9"), [], "youngs_modulus 7e+10, which is"),
        (ALUMINIUM.replace("0.33", "0.5"), [], "poissons_ratio 0.5, but it must be above -1"),
        (
            ALUMINIUM.replace("*ELASTIC", "*ELASTIC, TYPE=ORTHO"),
            [],
            "TYPE=ORTHO: give --youngs-mod",
        ),
        (ALUMINIUM.replace("*ELASTIC", "*HYPERELASTIC, NEO HOOKE"), [], "has *HYPERELASTIC: give"),
        (
            ALUMINIUM.replace("*ELASTIC", "*User Material, constants=2"),
            [],
            "has *USERMATERIAL: give",
        ),
        (ALUMINIUM.replace("0.33", "0.33,20.\n69000.,0.33,90."), [], "ELASTIC of 2 rows, not one"),
    ],
)
def test_materials_that_a_part_cannot_have(more, options, message, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    status, _, err = part_of_deck(capfd, more, *options)
    assert status == 2
    assert message in err
    assert len(err.splitlines()) == 1
    assert not Path("ring.msh").exists()


def test_given_values_take_the_place_of_a_deck_s_and_a_line_reports_it(
    tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    given = ["--density", "2800", "--youngs-modulus", "71e9", "--poissons-ratio", "0.3"]
    text = ALUMINIUM.replace("*ELASTIC", "*ELASTIC, TYPE=ORTHO")
    status, answer, err = part_of_deck(capfd, text, *given)
    assert status == 0
    assert answer["material"]["density"] == 2800.0
    assert answer["material"]["youngs_modulus"] == 71e9
    assert "material ALU has density 2.7e-09, 2800 is given" in err
    status, answer, err = part_of_deck(capfd, ALUMINIUM.partition("*DENSITY")[0])
    assert answer["material"]["density"] == 7850.0
    assert "material ALU has no density: 7850 is taken" in err


@pytest.mark.parametrize(
    ("unit", "young", "density"),
    [("m", 70e9, 2700.0), ("cm", 7e6, 2.7e-5), ("in", 10152641.6, 2.526459e-4)],
)
def test_units_of_a_material_follow_that_of_length(unit, young, density, tmp_path):
    points, cells = corners_of_ring("hex")
    material = f"*MATERIAL, NAME=A\n*ELASTIC\n{young}, 0.33\n*DENSITY\n{density}\n"
    (tmp_path / "ring.inp").write_text(deck_of(50 * points, [("hexahedron", cells)], material))
    (own,) = read_part(tmp_path / "ring.inp", unit).materials
    assert own.in_si("youngs_modulus", unit, "ring") == pytest.approx(70e9, rel=1e-6)
    assert own.in_si("density", unit, "ring") == pytest.approx(2700.0, rel=1e-5)


@pytest.mark.parametrize(
    ("more", "density"),
    [
        ("PSOLID,1,7\nMAT1,7,70000.,,.33,2.7-9", 2.7e-9),
        ("PSOLID,1,7\nMAT1,7,70000.,,.33,2.7e-5\nPARAM,WTMASS,1.D-4", 2.7e-9),
        ("PSOLID         1       7\nMAT1           7  70000.26315.79           2.7-9", 2.7e-9),
    ],
)
def test_material_of_bulk_data(more, density, tmp_path):
    points, cells = corners_of_ring("hex")
    (tmp_path / "ring.bdf").write_text(bulk_of(1e3 * points, [("hexahedron", cells)], more))
    (own,) = read_part(tmp_path / "ring.bdf", "mm").materials
    expected = {"youngs_modulus": 70000.0, "poissons_ratio": 0.33, "density": density}
    assert own.values == pytest.approx(expected, rel=1e-6)


def test_mass_factor_that_is_no_number(tmp_path):
    points, cells = corners_of_ring("hex")
    text = bulk_of(1e3 * points, [("hexahedron", cells)], "PARAM,WTMASS,abc")
    (tmp_path / "ring.bdf").write_text(text)
    with pytest.raises(ehd.errors.MeshError, match=r"ring.bdf: PARAM WTMASS: 'abc' is no number"):
        read_part(tmp_path / "ring.bdf", "mm")


def test_several_materials_of_bulk_data(tmp_path):
    points, cells = corners_of_ring("hex")
    text = bulk_of(
        1e3 * points,
        [("hexahedron", cells)],
        "PSOLID,1,7\nPSOLID,2,8\nMAT1,7,7.+4,,.33\nMAT1,8,2.+5,,.3",
    )
    (tmp_path / "ring.bdf").write_text(text.replace("CHEXA,1,1,", "CHEXA,1,2,"))
    with pytest.raises(ehd.errors.MeshError, match="of 2 materials, MAT1 7, MAT1 8"):
        read_mesh(tmp_path / "ring.bdf", "mm")
    assert len(read_mesh(tmp_path / "ring.bdf", "mm", several_materials=True).cells) == len(cells)


def test_scene_has_the_material_of_its_model(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert part_of_deck(capfd, ALUMINIUM)[0] == 0
    changes = {"bodies.rod.model": "ring.msh", "bodies.rod.geometry": {}}
    tables = ehd.read_scene("slider-crank-paper").tables
    tables["bodies"]["rod"] = {k: v for k, v in tables["bodies"]["rod"].items() if k != "material"}
    scene = ehd.read_scene(tables, **changes)
    assert scene.bodies["rod"].material.density == pytest.approx(2700.0)
    assert not [line for line in scene.warnings if "material" in line]
    scene = ehd.read_scene(tables, **changes, **{"bodies.rod.material.density": 2800.0})
    assert scene.bodies["rod"].material.density == 2800.0
    assert scene.bodies["rod"].material.youngs_modulus == pytest.approx(70e9)
    (line,) = [line for line in scene.warnings if "material" in line]
    assert line == "bodies.rod.material.density = 2800 is used, but model ring.msh has 2700"


# Bulk data of Nastran

BLANK = """$ second line blank in field 1
BEGIN BULK
GRID           1              0.      0.      0.
GRID           2              1.      0.      0.
GRID           3              0.      1.      0.
GRID*                  4                              0.              0.
*                     1.
GRID           5              .5      0.      0.
GRID           6              .5      .5      0.
GRID           7              0.      .5      0.
GRID           8              0.      0.    5.-1
GRID           9              .5      0.      .5
GRID          10              0.      .5      .5
CTETRA         1       2       1       2       3       4       5       6
               7       8       9      10
ENDDATA
"""


def test_blank_continuation_of_nastran(tmp_path):
    (tmp_path / "one.bdf").write_text(BLANK)
    solid = read_mesh(tmp_path / "one.bdf", "m")
    np.testing.assert_array_equal(solid.cells, [range(10)])
    np.testing.assert_array_equal(solid.points[[3, 7]], [[0, 0, 1], [0, 0, 0.5]])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("      9      10", "      9", "CTETRA 1 has 9 nodes, but must have 4 or 10"),
        ("      9      10", "      9      11", "CTETRA 1: node 11 is not among the GRIDs"),
        ("GRID           2        ", "GRID           2       3", "GRID 2 is not in the basic coor"),
        (
            "GRID           2              1.",
            "GRID           2              x.",
            "GRID 2: 'x.' is no",
        ),
        ("BEGIN BULK\n", "BEGIN BULK\nINCLUDE 'one.bdf'\n", "includes more than 100 files"),
        ("BEGIN BULK\n", "BEGIN BULK\nINCLUDE 'no\nne.bdf'\n", "none.bdf: no such file"),
        ("ENDDATA", "BEGIN SUPER=1", "has 2 sections of bulk data"),
    ],
)
def test_bulk_data_that_cannot_be_read(old, new, message, tmp_path):
    assert old in BLANK
    (tmp_path / "one.bdf").write_text(BLANK.replace(old, new))
    with pytest.raises(ehd.errors.MeshError, match=message) as found:
        read_mesh(tmp_path / "one.bdf", "m")
    assert "\n" not in str(found.value)


# Words of libraries


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([[0, 1, 2]], "tetra cells have 3 nodes, but must have 4"),
        ([[0, 1, 2, 3], [0, 1, 2]], "have different numbers of nodes"),
        ([[0, 1, 2, 7]], "tetra cells refer to nodes that the file does not have"),
    ],
)
def test_blocks_have_the_nodes_of_their_kind(cells, message):
    block = np.array(cells, dtype=object) if len({len(c) for c in cells}) > 1 else np.array(cells)
    with pytest.raises(ehd.errors.MeshError, match=message):
        ForeignMesh(np.zeros((4, 3)), [("tetra", block)]).check("part.vtk")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("part.mtx", "1,1, 1,1, 2.0\n"),
        ("part.vtk", "1,1, 1,1, 2.0\n"),
        ("part.mesh", "MeshVersionFormatted 2\nDimension 3\nVertices\n2\n1 2\n"),
        ("part.vtu", "<VTKFile type='UnstructuredGrid'><UnstructuredGrid/></VTKFile>"),
    ],
)
def test_a_reader_s_inner_words_are_not_shown(name, text, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    status, out, err = exit_of(capfd, "part", name)
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert "meshio cannot read it" in err
    for words in ("unpack", "index", "object", "NoneType", "Illegal cell", "inhomogeneous"):
        assert words not in err
    assert ("read_abaqus" in err) == text.startswith("1,1")


def test_a_matrix_of_abaqus_in_place_of_matrix_market(tmp_path):
    (tmp_path / "STIF1.mtx").write_text("1,1, 1,1, 2.0\n")
    with pytest.raises(ehd.errors.StructureError, match=r"%%MatrixMarket.* by read_abaqus"):
        ehd.Structure(str(tmp_path / "STIF1.mtx"), str(tmp_path / "STIF1.mtx"), np.zeros((1, 3)))


def test_hexahedra_of_20_nodes_in_a_model_are_sent_to_part(tmp_path):
    solid = ring_solid("hex")
    order = [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14]
    with session():
        gmsh.model.add("ring")
        entity = gmsh.model.addDiscreteEntity(3)
        gmsh.model.mesh.addNodes(
            3, entity, np.arange(1, len(solid.points) + 1), solid.points.ravel()
        )
        gmsh.model.mesh.addElementsByType(entity, 17, [], (solid.cells[:, order] + 1).ravel())
        gmsh.model.addPhysicalGroup(3, [entity])
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
        gmsh.write(str(tmp_path / "ring.msh"))
    assert len(read_mesh(tmp_path / "ring.msh", "m").cells) == len(solid.cells)
    with pytest.raises(
        ehd.errors.MeshError, match=r"24 hexahedron20: .*27-node.*'fenics-ehd part'"
    ):
        ehd.build_mesh(tmp_path / "ring.msh", comm=MPI.COMM_SELF)


def test_mesh_of_gmsh_with_a_group_for_some_cells(tmp_path):
    """As Gmsh writes all cells and a physical group of the volume: meshio fails on it."""
    write_model(tmp_path / "ring.msh", ring_solid("tet"))
    with session():
        gmsh.open(str(tmp_path / "ring.msh"))
        volumes = [number for _, number in gmsh.model.getEntities(3)]
        gmsh.model.removePhysicalGroups()
        gmsh.model.addPhysicalGroup(3, volumes)
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.write(str(tmp_path / "other.msh"))
    ours, reference = (read_mesh(tmp_path / f"{name}.msh", "m") for name in ("other", "ring"))
    for solid in (ours, reference):
        assert solid.cells.shape == (144, 10)
    middles = [np.sort(s.points[s.cells].mean(axis=1), axis=0) for s in (ours, reference)]
    np.testing.assert_allclose(*middles, atol=1e-12)


#: A tetrahedron and three cells that have none of the common numbers of nodes.
CUT_CELLS = """$MeshFormat
3 0 8
$EndMeshFormat
$Entities
0 0 0 2
0 0 1 0
1 0 1 1
$EndEntities
$Nodes
7
1 0 0 0 0
2 1 0 0 0
3 0 1 0 0
4 0 0 1 0
5 0 0 0.5 0
6 0.5 0 0.5 0
7 0 0.5 0.5 0
$EndNodes
$Elements
4
1 4 0 4 1 2 3 4
2 136 1 5 1 2 3 5 1
3 136 1 5 2 3 5 6 1
4 136 1 5 3 5 6 7 1
$EndElements
"""


def test_cells_of_gmsh_alone_are_counted(tmp_path):
    (tmp_path / "cut.msh").write_text(CUT_CELLS)
    with pytest.raises(ehd.errors.MeshError, match="has 1 tetra, 3 tetrahedron xfem: it needs one"):
        read_mesh(tmp_path / "cut.msh", "m")


def test_prisms_that_gmsh_alone_knows_are_solid_cells(tmp_path):
    points = np.random.default_rng(1).random((40, 3))
    blocks = [("tetra", np.array([[0, 1, 2, 3]])), ("prism 40", np.arange(40)[None])]
    with pytest.raises(ehd.errors.MeshError, match="has 1 tetra, 1 prism 40"):
        ForeignMesh(points, blocks).solid_cells("part")


# First order


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", ["hex", "tet"])
@pytest.mark.parametrize("around", [12, 16, 40])
def test_bore_of_straight_edges_is_found_and_round(kind, around, order, tmp_path):
    points, cells = corners_of_ring(kind, around, 2, 1)
    name = TYPES[kind][2]
    if order == 2:
        raised = second_order(Solid(points, cells, kind))
        points, cells, name = raised.points, raised.cells, f"{name}{raised.cells.shape[1]}"
    write_mesh(tmp_path / "ring.vtu", points, [(name, cells)])
    opened = open_part(tmp_path / "ring.vtu")
    np.testing.assert_array_equal(opened.solid.points, points)
    kinds = [face.kind for face in opened.faces]
    assert kinds == ["bore", "shaft", "plane", "plane"]
    assert opened.radius(1) == pytest.approx(RADIUS, rel=1e-12)
    part = place_part(opened, NamedFaces({"bore": 1}, {})).quadratic()
    assert not inside_out(part.solid).any()
    x = part.solid.points[np.unique(part.surfaces()["bore"])]
    np.testing.assert_allclose(np.linalg.norm(x[:, :2], axis=1), RADIUS, rtol=1e-12)
    outside = part.facets[part.numbers == 2]
    np.testing.assert_allclose(
        np.linalg.norm(part.solid.points[outside, :2], axis=2), OUTER, rtol=1e-12
    )


@pytest.mark.parametrize(("kind", "around", "most"), [("hex", 16, 1e-9), ("tet", 24, 5e-3)])
def test_first_order_ring_yields_as_the_second_order_one(kind, around, most, tmp_path):
    exact = ring_solid(kind, around, 2, 1 if kind == "hex" else 2)
    points, cells = exact.points[: exact.corners.max() + 1], exact.corners
    write_mesh(tmp_path / "ring.vtu", points, [(TYPES[kind][2], cells)])
    part = place_part(open_part(tmp_path / "ring.vtu"), NamedFaces({"bore": 1}, {})).quadratic()
    write_part(tmp_path / "first.msh", part.solid, part.surfaces())
    write_part(tmp_path / "second.msh", exact, {"bore": surfaces(exact)["bore"]})
    parts = [
        part_responses(tmp_path / f"{n}.msh", STEEL, ["bore"], None) for n in ("first", "second")
    ]
    masses = [rigid(structure).inertia.total_mass for structure, _ in parts]
    assert masses[0] == pytest.approx(masses[1], rel=1e-12)
    ours, reference = (answers.compliance for _, answers in parts)
    assert max(compliance_errors(ours - reference, reference).values()) < most


def test_curvature_that_turns_cells_inside_out_is_named(tmp_path):
    points, cells = corners_of_ring("hex", 16, 2, 2)
    radii = np.linalg.norm(points[:, :2], axis=1)
    middle = np.abs(radii - 0.5 * (RADIUS + OUTER)) < 1e-6
    points[middle, :2] *= (1.005 * RADIUS / radii[middle])[:, None]  # thinner than the arc is high
    write_mesh(tmp_path / "ring.vtu", points, [("hexahedron", cells)])
    part = place_part(open_part(tmp_path / "ring.vtu"), NamedFaces({"bore": 1}, {}))
    with pytest.raises(ehd.errors.MeshError, match=r"bore: 32 of 64 cells .* more cells around it"):
        part.quadratic()


@pytest.mark.parametrize("kind", ["hex", "tet"])
def test_model_of_first_order_cells_has_a_round_bore(kind, tmp_path):
    solid = ring_solid(kind)
    points, cells = corners_of_ring(kind)
    corners = {"hex": 4, "tet": 3}[kind]
    facets = surfaces(solid)["bore"][:, :corners]
    names = {"hex": ("hexahedron", "quad"), "tet": ("tetra", "triangle")}[kind]
    blocks = [
        (name, np.asarray(c, np.int32)) for name, c in zip(names, (cells, facets), strict=True)
    ]
    groups = [np.full(len(c), i, dtype=np.int32) for i, (_, c) in enumerate(blocks, 1)]
    data = {"gmsh:physical": groups, "gmsh:geometrical": groups}
    mesh = meshio.Mesh(points, blocks, cell_data=data)
    mesh.field_data = {"part": np.array([1, 3]), "bore": np.array([2, 2])}
    mesh.write(tmp_path / "ring.msh", file_format="gmsh22")
    made = ehd.build_mesh(tmp_path / "ring.msh", comm=MPI.COMM_SELF)
    structure = ehd.assemble_structure(made, STEEL, attachments=())
    radii = np.linalg.norm(structure.bore.coordinates[:, :2], axis=1)
    np.testing.assert_allclose(radii, RADIUS, rtol=1e-12)


def test_second_order_cells_stay_as_they_are():
    solid = ring_solid("tet")
    assert second_order(solid) is solid
    assert (solid.facet_element, solid.quadratic) == ("triangle", True)


def test_a_second_order_model_is_not_moved(tmp_path):
    write_model(tmp_path / "ring.msh", ring_solid("hex"))
    made = ehd.build_mesh(tmp_path / "ring.msh", comm=MPI.COMM_SELF, serendipity_geometry=False)
    radii = np.linalg.norm(made.mesh.geometry.x[:, :2], axis=1)
    assert radii.min() > 0.99 * RADIUS
