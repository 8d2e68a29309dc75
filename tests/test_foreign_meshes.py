"""Files of meshes as other programs write them, and those that no part can be made of."""

import json
import os
import subprocess
import sys
from pathlib import Path

import gmsh
import h5py
import meshio
import numpy as np
import pytest
from calculix_ring import ring_solid, write_deck, write_model
from command_line import call, exit_of, program

import fenics_ehd as ehd
from fenics_ehd.base.processes import printing_kept
from fenics_ehd.fem.gmsh_session import session
from fenics_ehd.fem.solid import Solid
from fenics_ehd.fem.solid_file import read_deck, read_mesh

KINDS = ("tet", "hex")

#: Deck as Abaqus/CAE writes it: parts, an assembly with a node of its own, elements of any kind.
CAE = """*Heading
** a comment
*Part, name=Ring
*Node
{nodes}
*Element, type=c3d{count}
{elements}
*Element, type=SPRINGA, elset=springs
900001, 1, 2
*Nset, nset=all, generate
 1, 10, 1
*End Part
*Part, name=Plate
*Node
1, 0., 0.
*Element, type=S3
1, 1, 1, 1
*End Part
*Assembly, name=Assembly
*Instance, name=Ring-1, part=Ring
 1., 0., 0.
*End Instance
*Node
1, 9., 9., 9.
*Nset, nset=reference,
 internal
 1,
*End Assembly
*Step
*Node Output
*End Step
"""


@pytest.fixture(scope="module", params=KINDS)
def ring(request):
    return ring_solid(request.param)


def nodes_and_cells(solid):
    """Rows of a deck, numbers from 1."""
    nodes = [f"{n}, {x[0]!r}, {x[1]!r}, {x[2]!r}" for n, x in enumerate(solid.points.tolist(), 1)]
    rows = [[n, *cell] for n, cell in enumerate((solid.cells + 1).tolist(), 1)]
    cells = [
        ",\n".join(", ".join(map(str, r[i : i + 8])) for i in range(0, len(r), 8)) for r in rows
    ]
    return nodes, cells


def assert_same(found, solid):
    """The same cells, of nodes in any order."""
    assert found.kind == solid.kind
    ours, expected = (s.points[s.cells] for s in (found, solid))
    np.testing.assert_allclose(ours, expected, atol=1e-9)


def test_deck_of_parts_and_an_assembly(ring, tmp_path):
    nodes, cells = nodes_and_cells(ring)
    text = CAE.format(nodes="\n".join(nodes), elements="\n".join(cells), count=len(ring.cells[0]))
    (tmp_path / "cae.inp").write_text(text)
    assert_same(read_mesh(tmp_path / "cae.inp", "m"), ring)


def test_deck_of_files_that_it_includes(ring, tmp_path):
    nodes, cells = nodes_and_cells(ring)
    # In two lists, the numbers of the second before those of the first.
    half = len(nodes) // 2
    (tmp_path / "nodes.inc").write_text("*NODE\n" + "\n".join(nodes[half:]) + "\n")
    kind = f"C3D{len(ring.cells[0])}" + ("R" if ring.kind == "hex" else "M")
    deck = ["*include, input=nodes.inc", "*NODE, NSET=FIRST", *nodes[:half]]
    deck += ["*ELEMENT,", f"TYPE = {kind}", *cells]
    (tmp_path / "deck.inp").write_text("\r\n".join(deck))
    assert_same(read_mesh(tmp_path / "deck.inp", "m"), ring)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("*INCLUDE, INPUT=deck.inp\n", "more than 100 files, .*deck.inp: does one include itself"),
        ("*INCLUDE, INPUT=none.inp\n", "none.inp: no such file"),
        ("*NODE\n1,0,0,0\n", "no C3D4, C3D8.*it needs one kind"),
        ("*NODE\n1,0,x,0\n*ELEMENT,TYPE=C3D4\n1,1,1,1,1\n", "line of .NODE must have the coord"),
        ("*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D4\n1,1,1,1\n", "the numbers of all nodes of an"),
        ("*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D4\n1,1,1,1,2\n", "the numbers of all nodes of an"),
        ("*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D5\n1,1,1,1,1,2\n", "every line of C3D5 the numbers"),
        ("*NODE\n1,0,0,0\n*ngen\n1,2,1\n", r"has \*NGEN: write a deck that lists all"),
        (
            "*PART\n*ELEMENT,TYPE=C3D4\n*END PART\n*PART\n*ELEMENT,TYPE=C3D4\n",
            "2 parts with solid cells",
        ),
    ],
)
def test_deck_that_cannot_be_read(text, message, tmp_path):
    (tmp_path / "deck.inp").write_text(text)
    with pytest.raises(ehd.errors.MeshError, match=message):
        read_deck(tmp_path / "deck.inp")


HIDDEN = "root:x:0:0,hidden,words\n"


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({f"{n}": f"*INCLUDE, INPUT={n + 1}\n" for n in range(1, 1201)}, "more than 100 files"),
        ({f"{n}": f"*INCLUDE, INPUT={n + 1}\n" * 2 for n in range(1, 29)}, "more than 100 files"),
        ({"1": "*INCLUDE, INPUT=/dev/zero\n"}, "/dev/zero: not a regular file"),
        ({"1": "*INCLUDE, INPUT=pipe\n"}, "pipe: not a regular file"),
        ({"1": HIDDEN}, "line of .NODE must have"),
        ({"1": f"*ELEMENT, TYPE=C3D4\n{HIDDEN}"}, "line of .NODE must have"),
        ({"1": "*ELEMENT, TYPE=C3D4\n1, 99999999999999999999,1,1,1\n"}, "line of .NODE must have"),
    ],
)
def test_includes_end_and_show_nothing(files, message, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "29").write_text("")
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    end = "*ELEMENT, TYPE=C3D4\n"
    (tmp_path / "deck.inp").write_text(f"*NODE\n1,0,0,0\n*NODE\n*INCLUDE, INPUT=1\n{end}")
    with pytest.raises(ehd.errors.MeshError, match=message) as found:
        read_deck(tmp_path / "deck.inp")
    assert "\n" not in str(found.value)
    assert "hidden" not in str(found.value)


@pytest.mark.parametrize(("ending", "fields"), [("bdf", 0), ("bdf", 1), ("unv", 0)])
def test_meshes_as_gmsh_writes_them(ending, fields, tmp_path):
    solid, file = ring_solid("tet"), tmp_path / f"ring.{ending}"
    write_model(tmp_path / "ring.msh", solid)
    with session():
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.option.setNumber("Mesh.BdfFieldFormat", fields)
        gmsh.open(str(tmp_path / "ring.msh"))
        gmsh.write(str(file))
    if ending == "bdf":
        assert "BEGIN BULK" not in file.read_text()
    found = read_mesh(file, "m")
    assert len(found.cells) == len(solid.cells)
    np.testing.assert_allclose(
        np.sort(found.points[found.cells].mean(axis=1), axis=0),
        np.sort(solid.points[solid.cells].mean(axis=1), axis=0),
        atol=1e-5,  # numbers of eight characters
    )


@pytest.mark.parametrize("style", ["free", "fixed"])
def test_nastran(ring, style, tmp_path):
    points = [
        f"GRID,{n},,{x[0]!r},{x[1]!r},{x[2]!r}" for n, x in enumerate(ring.points.tolist(), 1)
    ]
    # Nastran lists the middles of upright edges before those on top.
    places = [*range(12), *range(16, 20), *range(12, 16)] if ring.kind == "hex" else [*range(10)]
    card = {"tet": "CTETRA", "hex": "CHEXA"}[ring.kind]
    cells = []
    for number, cell in enumerate((ring.cells[:, places] + 1).tolist(), 1):
        fields = [number, 1, *cell]
        rows = [fields[i : i + 8] for i in range(0, len(fields), 8)]
        if style == "free":
            lines = [",".join(map(str, row)) for row in rows]
            cells.append(f"{card}," + ",+\n+,".join(lines))
        else:
            lines = ["".join(f"{n:8d}" for n in row) for row in rows]
            cells.append(f"{card:8}" + ("+\n" + "+".ljust(8)).join(lines))
    text = "\n".join(["SOL 103", "CEND", "BEGIN BULK", "$ a comment", *points, *cells, "ENDDATA"])
    (tmp_path / "ring.bdf").write_text(text + "\n")
    assert_same(read_mesh(tmp_path / "ring.bdf", "m"), ring)


def changed(solid, how):
    """What is wrong with a mesh, of the first cells."""
    cells, points = solid.cells, solid.points.copy()
    mirror = points * [1, 1, -1]
    if how == "twice":
        return Solid(points, np.vstack([cells, cells[:3]]), solid.kind)
    if how == "mirrored":
        return Solid(mirror, cells, solid.kind)
    corners = 4 if solid.kind == "tet" else 8
    inner = np.setdiff1d(cells[:, corners:], solid.facets())
    points[inner[0]] += 0.02
    return Solid(points, cells, solid.kind)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("twice", r"ring.inp: 3 of \d+ cells are repeated"),
        ("mirrored", r"(\d+) of \1 cells are turned inside out.*the other way round"),
        ("curved", r"\d of \d+ cells are turned inside out.*use smaller cells"),
    ],
)
def test_cells_that_are_no_solid(how, message, tmp_path):
    for kind in KINDS:
        # Of hexahedra in one layer every edge is on the surface.
        solid = changed(ring_solid(kind, 12, 2, 2), how)
        write_deck(tmp_path / "ring.inp", solid, np.arange(1, len(solid.points) + 1))
        with pytest.raises(ehd.errors.MeshError, match=message):
            read_mesh(tmp_path / "ring.inp", "m")


def test_a_model_with_cells_twice_ends_in_one_line(tmp_path):
    solid = changed(ring_solid("tet"), "twice")
    write_model(tmp_path / "ring.msh", solid)
    # dolfinx would free memory twice, and the process be gone.
    with pytest.raises(ehd.errors.MeshError, match=r"ring\.msh: 3 of \d+ cells are repeated"):
        ehd.build_mesh(tmp_path / "ring.msh")


def test_faces_of_three_cells(tmp_path):
    points = np.vstack([np.zeros(3), np.eye(3), [1, 1, 1], [2, 2, 2.5]])
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [1, 2, 3, 5]])
    meshio.write(tmp_path / "three.vtu", meshio.Mesh(points, [("tetra", cells)]))
    with pytest.raises(ehd.errors.MeshError, match="1 faces are shared by more than two cells"):
        read_mesh(tmp_path / "three.vtu", "m")


def test_a_check_that_fails_leaves_no_model(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    solid = ring_solid("tet")
    write_deck(Path("ring.inp"), solid, np.arange(1, len(solid.points) + 1))
    asked = ["part", "ring.inp", "--bore", "20mm", "-o", "ring.msh"]

    def fails(_opened, _placed, path, *_):
        assert path.is_file()
        raise ehd.errors.MeshError(f"{path}: no part")

    monkeypatch.setattr("fenics_ehd.cli.part._checked", fails)
    status, out, err = exit_of(capfd, *asked, "--json")
    assert (status, out) == (2, "")
    assert err == "fenics-ehd: MeshError: ring.msh: no part\n"
    assert [path.name for path in tmp_path.iterdir()] == ["ring.inp"]
    assert call(*asked, "--no-check") == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ring.inp", "ring.msh"]


@pytest.mark.parametrize("check", ["--check", "--no-check"])
def test_a_full_disk_leaves_no_model(check, tmp_path):
    """Gmsh writes what there is room for, without an error."""
    solid = ring_solid("tet")
    write_deck(tmp_path / "ring.inp", solid, np.arange(1, len(solid.points) + 1))
    # After MPI has begun, which has files of its own.
    code = """if True:
        import resource, sys
        from mpi4py import MPI
        from fenics_ehd.cli.main import main
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
        main(sys.argv[1:])"""
    asked = ["part", "ring.inp", "--bore", "20mm", check, "-o", "ring.msh"]
    command = [sys.executable, "-c", code, *asked]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert found.returncode == 1
    assert found.stderr == "fenics-ehd: OutputError: ring.msh: File too large\n"
    assert [path.name for path in tmp_path.iterdir()] == ["ring.inp"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("broken.step", "ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1=FOO(;\nENDSEC;\n"),
        ("broken.msh", "$MeshFormat\n4.1 0 8\n"),
        ("broken.bdf", "nothing\n"),
        ("broken.unv", "nothing\n"),
    ],
)
def test_a_broken_file_is_one_line(name, text, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    status, out, err = exit_of(capfd, "part", name, "--json")
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == 1, err


#: Sources of the numbers of an XDMF file, and the message about each.
ELSEWHERE = {
    "pipe": "is not a regular file",
    "device": "is not a regular file",
    "folder above": "is not a regular file",
    "pipe next to the file that a link leads to": "is not a regular file",
    "HDF5 of another file": "are in another file",
    "HDF5 of a pipe": "are in another file",
    "HDF5 without data": "declares",
}


@pytest.mark.parametrize("where", ELSEWHERE)
def test_xdmf_that_leads_elsewhere_is_refused_at_once(where, tmp_path, capfd):
    solid = ring_solid("tet")
    (tmp_path / "below").mkdir()
    path = tmp_path / "below" / "m.xdmf"
    meshio.write(path, meshio.Mesh(solid.points, [("tetra10", solid.cells)]))
    data = tmp_path / "below" / "m.h5"
    target = {"device": "/dev/zero", "folder above": ".."}.get(where, "m.h5")
    path.write_text(path.read_text().replace("m.h5:", f"{target}:"))
    if where.startswith("HDF5"):
        with h5py.File(data, "r+") as file:
            shape, kind = file["data0"].shape, file["data0"].dtype
            del file["data0"]
            os.mkfifo(tmp_path / "below" / "pipe")
            if where.endswith("another file"):
                file["data0"] = h5py.ExternalLink("other.h5", "x")
            elif where.endswith("pipe"):
                file.create_dataset("data0", shape, kind, external=[("pipe", 0, 10**6)])
            else:
                file.create_dataset("data0", (10**10, 3), kind, chunks=(10**4, 3))
    else:
        data.unlink()
        os.mkfifo(data)
    if where.endswith("link leads to"):
        path = tmp_path / "m.xdmf"
        path.symlink_to(tmp_path / "below" / "m.xdmf")
    status, out, err = exit_of(capfd, "part", path)
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == 1, err
    assert ELSEWHERE[where] in err


def test_nothing_but_the_answer_is_printed(tmp_path):
    # meshio takes a .msh for one of Ansys first, and prints an empty line then.
    write_model(tmp_path / "ring.msh", ring_solid("tet"))
    done = program("part", "ring.msh", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["file"] == "ring.msh"
    assert done.stdout.startswith("{")


def test_what_compiled_code_prints_goes_nowhere(capfd):
    with printing_kept() as reported:
        os.write(1, b"loud\n")
        print("heard")
    print("after")
    assert capfd.readouterr().out == "after\n"
    assert reported.getvalue() == "heard\n"
