"""Drawings of other programs: units, surfaces without a solid, merged faces, exact lists, sizes."""

import json
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage

import meshio
import numpy as np
import pytest
from click.testing import CliRunner
from foreign_parts import RADIUS, ring_mesh

import fenics_ehd as ehd
from fenics_ehd.base.processes import printing_kept
from fenics_ehd.cli.main import cli
from fenics_ehd.fem import drawing as drawing_module
from fenics_ehd.fem.drawing import TRIED_SIZES, CellSizes, read_drawing
from fenics_ehd.fem.drawing_unit import unit_ratio
from fenics_ehd.fem.drawn_part import NamedFaces, open_part, place_part
from fenics_ehd.fem.faces import fit_cylinder
from fenics_ehd.fem.gmsh_session import gmsh, session
from fenics_ehd.fem.solid import inside_out

#: Ring of 45 and 68 mm, 22 mm wide, as a solid and as its four surfaces, by OpenCASCADE's writer.
RING, SURFACES = (Path(__file__).parent / "parts" / f"{name}.igs" for name in ("ring", "surfaces"))


def drawn(path, shape, unify=True):
    """A STEP file in millimetres of what a function makes of OpenCASCADE's kernel."""
    with session():
        gmsh.option.setNumber("Geometry.OCCUnionUnify", unify)
        shape(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        with printing_kept():
            gmsh.write(str(path))
    return path


def rod(scale=1.0):
    """A connecting rod of a millimetre times a factor, in the five pieces it is made of."""

    def made(occ):
        def cylinder(x, radius):
            return [(3, occ.addCylinder(x, 0, 0, 0, 0, 22 * scale, radius * scale))]

        pin = 160 * scale
        solid = occ.fuse(cylinder(0, 33.9), cylinder(pin, 21))[0]
        shank = occ.addBox(0, -12.5 * scale, 0, pin, 25 * scale, 22 * scale)
        solid = occ.fuse(solid, [(3, shank)])[0]
        occ.cut(solid, cylinder(0, 22.5) + cylinder(pin, 12))

    return made


def plate(holes):
    """A plate with a square of round holes and of pockets."""

    def made(occ):
        solid = [(3, occ.addBox(0, 0, 0, 10 * holes, 10 * holes, 5))]
        tools = []
        for i, j in np.ndindex(holes, holes):
            x, y = 10 * i + 5, 10 * j + 5
            if (i + j) % 2:
                tools.append((3, occ.addCylinder(x, y, 0, 0, 0, 5, 2)))
            else:
                tools.append((3, occ.addBox(x - 2, y - 2, 2, 4, 4, 3)))
        occ.cut(solid, tools)

    return made


def cylinders(faces):
    """Kind, radius [mm] and angle [degrees] of every cylinder."""
    return [
        (f.kind, round(1e3 * f.cylinder.radius, 9), round(360 * f.arc, 9))
        for f in faces
        if f.cylinder is not None
    ]


def listed(*arguments):
    done = CliRunner().invoke(cli, ["part", *map(str, arguments)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done


#: Unit's flag and name, and what follows them, in the head of the file of the ring.
MILLIMETRES = ",2,2HMM,1,0.01,"


@pytest.mark.parametrize(
    ("declared", "unit", "millimetres"),
    [
        (MILLIMETRES, None, 1.0),
        (",1,2HIN,1,0.01,", None, 25.4),
        (",10,2HCM,1,.01,", None, 10.0),
        (",6,1HM,01,0.01,", "mm", 1.0),
    ],
)
def test_iges_is_read_in_its_own_unit(declared, unit, millimetres, tmp_path):
    file = tmp_path / "ring.IGS"
    text = RING.read_text()
    assert MILLIMETRES in text
    file.write_text(text.replace(MILLIMETRES, declared))
    drawing = read_drawing(file, unit)
    assert cylinders(drawing.faces) == [
        ("bore", pytest.approx(22.5 * millimetres), 360.0),
        ("shaft", pytest.approx(34 * millimetres), 360.0),
    ]
    np.testing.assert_allclose(drawing.faces[0].centre, [0, 0, 0.011 * millimetres], atol=1e-12)
    assert drawing.faces[0].area == pytest.approx(2e-6 * np.pi * 22.5 * 22 * millimetres**2)
    assert drawing.notices == []


def test_iges_becomes_a_model(tmp_path):
    target = tmp_path / "ring.msh"
    call = [RING, "--bore", "22.5mm", "--cells-around", "24", "--no-check", "--json"]
    figures = json.loads(listed(*call, "-o", target).stdout)
    assert figures["bores"]["bore"]["moved_m"] < 1e-12
    mesh = meshio.read(target)
    radius = np.linalg.norm(mesh.points[:, :2], axis=1)
    assert radius.min() == pytest.approx(0.0225)
    assert np.ptp(mesh.points[:, 2]) == pytest.approx(0.022)


@pytest.mark.slow
def test_closed_surfaces_are_sewn_and_open_ones_refused(tmp_path):
    drawing = read_drawing(SURFACES)
    assert drawing.notices == [f"{SURFACES}: 4 surfaces that enclose a volume are sewn to a solid"]
    assert cylinders(drawing.faces) == cylinders(read_drawing(RING).faces)

    def bored_plate(occ):
        solid = occ.cut([(3, occ.addBox(0, 0, 0, 50, 40, 5))], [(3, occ.addSphere(25, 20, 5, 4))])
        occ.remove(solid[0])
        occ.synchronize()
        occ.remove(occ.getEntities(2)[-1:])

    with pytest.raises(ehd.errors.MeshError, match=r"open\.step has no solid, and its 6 surfaces"):
        read_drawing(drawn(tmp_path / "open.step", bored_plate))


@pytest.mark.slow
def test_faces_of_one_plane_are_merged(tmp_path):
    file = drawn(tmp_path / "rod.step", rod(), unify=False)
    drawing = read_drawing(file)
    assert len(drawing_module._read(file, 1e-3, merge=False).faces) > len(drawing.faces)
    assert [face.kind for face in drawing.faces] == [
        "bore",
        "bore",
        "shaft",
        "shaft",
        *["plane"] * 4,
    ]
    assert cylinders(drawing.faces)[:2] == [("bore", 22.5, 360.0), ("bore", 12.0, 360.0)]
    area = sum(face.area for face in drawing.faces)
    raw = drawing_module._read(file, 1e-3, merge=False)
    assert area == pytest.approx(sum(face.area for face in raw.faces), rel=1e-9)
    part = place_part(open_part(file), NamedFaces({"bore": 1}, {"pin": 2}), 24)
    assert not inside_out(part.solid).any()


def test_faces_are_those_of_the_surfaces_exactly(tmp_path):
    def drilled(occ):
        ring = occ.cut(
            [(3, occ.addCylinder(3, 4, 5, 0, 0, 20, 30))],
            [
                (3, occ.addCylinder(3, 4, 5, 0, 0, 20, 20)),
                (3, occ.addCylinder(0, 4, 15, 50, 0, 0, 2)),
            ],
        )[0]
        occ.rotate(ring, 0, 0, 0, 1, 2, 3, 0.7)

    bore, hole, rim, *_ = read_drawing(drawn(tmp_path / "ring.step", drilled)).faces
    # A hole in a bore takes nothing from its turn, but from its area.
    assert cylinders([bore, hole, rim]) == [
        ("bore", 20.0, 360.0), ("bore", 2.0, 360.0), ("shaft", 30.0, 360.0)
    ]  # fmt: skip
    assert 12e-6 < 2 * np.pi * 0.02**2 - bore.area < 13e-6
    assert bore.cylinder.deviation < 1e-15
    assert abs(bore.axis @ hole.axis) < 1e-12


@pytest.mark.slow
def test_long_lists_are_grouped_and_no_mesh_is_made(tmp_path, monkeypatch):
    file = drawn(tmp_path / "plate.step", plate(8))
    monkeypatch.setattr(drawing_module, "_generate", None)
    done = listed(file)
    rows = [line.split() for line in done.stdout.splitlines()]
    assert rows[2][:5] == ["1-32", "bore", "2.0000", "5.000", "360"]
    assert rows[2][-2:] == ["32", "faces"]
    assert len(rows) < 12
    assert "198 faces, faces of equal size in one row: --json lists every face" in done.stdout
    faces = json.loads(listed(file, "--json").stdout)["faces"]
    assert [face["number"] for face in faces] == list(range(1, 199))
    assert {face["arc_degrees"] for face in faces[:32]} == {360.0}


@pytest.mark.slow
def test_thousand_faces_are_listed_in_twenty_seconds(tmp_path):
    file = drawn(tmp_path / "plate.step", plate(20))
    before = getrusage(RUSAGE_CHILDREN).ru_utime
    assert len(json.loads(listed(file, "--json").stdout)["faces"]) == 1206
    # Of the processor: other programs on the machine do not count.
    assert getrusage(RUSAGE_CHILDREN).ru_utime - before < 20.0


@pytest.mark.slow
def test_drawing_of_another_unit_than_it_declares(tmp_path):
    file = drawn(tmp_path / "rod.step", rod(1e-3))
    with pytest.raises(
        ehd.errors.MeshError, match=r"is 0\.0002149 m long, below 0\.001: give its --u"
    ):
        open_part(file)
    assert cylinders(open_part(file, "m").faces)[0] == ("bore", 22.5, 360.0)
    with pytest.raises(ehd.errors.MeshError, match="is 68 m long, above 5: give its --unit"):
        open_part(RING, "m")
    assert cylinders(open_part(RING, "mm").faces) == cylinders(open_part(RING).faces)


CONTEXT = "#9=(GLOBAL_UNIT_ASSIGNED_CONTEXT((#1,{})));\n"
SI = "#{}=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({},.METRE.));\n"
INCH = (
    "#1=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));\n"
    "#4=LENGTH_MEASURE_WITH_UNIT ( LENGTH_MEASURE( 2.54 ), #5 );\n"
    "#3=(CONVERSION_BASED_UNIT('INCH',#4)LENGTH_UNIT()\nNAMED_UNIT(#2));\n"
)


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        (SI.format(2, ".MILLI.") + CONTEXT.format("#2"), 1e-3),
        (SI.format(2, "$") + CONTEXT.format("#2"), 1.0),
        (INCH + SI.format(5, ".CENTI.") + CONTEXT.format("#3"), 0.0254),
        (SI.format(2, "$") + SI.format(3, ".MILLI.") + CONTEXT.format("#2,#3"), None),
        ("nothing", None),
    ],
)
def test_unit_that_a_step_file_declares(text, metres, tmp_path):
    (tmp_path / "part.stp").write_text(text)
    if metres is None:
        with pytest.raises(
            ehd.errors.MeshError, match="no unit of length, or several, so that --unit"
        ):
            unit_ratio(tmp_path / "part.stp", "mm")
    else:
        assert unit_ratio(tmp_path / "part.stp", "mm") == pytest.approx(1e-3 / metres)


def test_unit_behind_delimiters_of_its_own(tmp_path):
    head = ["1H/", "1H;", "4Ha,/;", *["1"] * 10, "10", "2HCM"]
    (tmp_path / "part.igs").write_text(f"{'/'.join(head)};".ljust(72) + "G0000001\n")
    assert unit_ratio(tmp_path / "part.igs", "m") == pytest.approx(100.0)


SIZES = CellSizes([], 8e-3)


def refusing(monkeypatch, count):
    """Numbers of cells of the meshes judged, of which the first `count` are rejected."""
    cells = []

    def judged(solid):
        cells.append(len(solid.cells))
        return np.array([len(cells) <= count])

    monkeypatch.setattr(drawing_module, "inside_out", judged)
    return cells


@pytest.mark.slow
def test_cells_inside_out_make_them_finer(monkeypatch):
    ring = read_drawing(RING)
    # Each size is judged again after nodes were moved.
    cells = refusing(monkeypatch, 4)
    mesh = drawing_module._mesh(RING, ring.shape, ring.scale, SIZES)
    assert mesh.size == TRIED_SIZES[2]
    assert cells[::2] == [*cells[1::2], len(mesh.solid.cells)]
    assert 1.4 * cells[0] < len(mesh.solid.cells)
    assert cells == sorted(cells)
    cells = refusing(monkeypatch, 10)
    with pytest.raises(
        ehd.errors.MeshError, match=r"1 of \d+ cells are turned inside out, even wi"
    ):
        drawing_module._mesh(RING, ring.shape, ring.scale, SIZES)
    assert len(cells) == 2 * len(TRIED_SIZES)


@pytest.mark.slow
def test_size_that_passed_is_printed(monkeypatch, tmp_path):
    def here(drawing, sizes):
        return drawing_module._mesh(drawing.path, drawing.shape, drawing.scale, sizes)

    monkeypatch.setattr(drawing_module.Drawing, "mesh", here)
    refusing(monkeypatch, 2)
    call = [RING, "--bore", "1", "--cells-around", "16", "--no-check", "-o", tmp_path / "x.msh"]
    done = listed(*call, "--json")
    figures, warning = done.stdout, done.stderr if done.stderr_bytes is not None else done.output
    assert '"cells_around": 20.0' in figures
    assert "has 20 cells around its bores: with 16 cells, some were inside out" in warning


def test_size_of_cells_is_that_of_the_nearest_cylinder():
    axis = np.array([0.0, 0.6, 0.8])
    points = np.array([[1.0, 0, 0], [0, 0.8, -0.6], [-1.0, 0, 0], [0.6, 0.64, -0.48]])
    cylinder = fit_cylinder(np.vstack([points, points + axis]), np.vstack([points, points]))
    sizes = CellSizes([(cylinder, 40.0)], 0.5, coarser=2.0)
    at_wall = 2 * np.pi / 40
    assert sizes(points[0] + 0.5 * axis) == pytest.approx(2 * at_wall)
    assert sizes(1.5 * points[0] + 0.5 * axis) == pytest.approx(2 * (at_wall + 0.5 * 0.35))
    assert sizes(points[0] + 1.4 * axis) == pytest.approx(2 * (at_wall + 0.4 * 0.35))
    assert sizes(9 * points[0]) == 1.0


def ring_file(path, around):
    nodes, cells, _ = ring_mesh(around=around)
    order = [0, 1, 3, 2, 4, 5, 7, 6]
    meshio.write(path, meshio.Mesh(nodes, [("hexahedron", cells[:, order])]))
    return path


def test_hint_of_the_angle_where_a_coarse_cylinder_is_in_pieces(tmp_path):
    part = open_part(ring_file(tmp_path / "ring.vtu", 8))
    assert not cylinders(part.faces)
    assert part.notices == [
        f"{tmp_path}/ring.vtu: cylinders of radius 20, 30 mm are in pieces, whose cells turn by up "
        "to 50 degrees: give --angle 50"
    ]
    wider = open_part(tmp_path / "ring.vtu", sharp=50.0)
    assert wider.faces[0].cylinder.radius == pytest.approx(RADIUS)
    assert wider.notices == []
    assert open_part(ring_file(tmp_path / "fine.vtu", 16)).notices == []


def test_mesh_of_a_tenth_of_a_millimetre(tmp_path):
    file = ring_file(tmp_path / "ring.vtu", 16)
    with pytest.raises(
        ehd.errors.MeshError, match=r"is 6e-05 m long, below 0\.001: give its --unit"
    ):
        open_part(file, "mm")
