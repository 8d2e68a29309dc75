"""Matrices in files of Abaqus and CalculiX: the recipe of docs/reduction.md, what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from calculix_ring import DENSITY, POISSON, YOUNG, ring_solid, write_deck, write_model
from foreign_parts import ring_arguments, ring_matrices, ring_mesh, to_scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from scipy import io, sparse
from scipy.spatial import cKDTree

import fenics_ehd as ehd
from fenics_ehd.reduction.foreign_matrices import tetrahedron_mass

PAGE = (Path(__file__).parents[1] / "docs" / "reduction.md").read_text()


def triangle(matrix, *, lower):
    """Rows, columns and values of one triangle, from 0."""
    half = (sparse.tril(matrix) if lower else sparse.triu(matrix)).tocoo()
    return half.row, half.col, half.data


def write_coordinate(path, rows, columns, values):
    text = (f"{i + 1} {j + 1}  {v:.17e}\n" for i, j, v in zip(rows, columns, values, strict=True))
    path.write_text("".join(text))


def write_labels(path, numbers, rows, columns, values):
    """Abaqus' ``FORMAT=MATRIX INPUT``."""
    text = (
        f"{numbers[i // 3]},{i % 3 + 1}, {numbers[j // 3]},{j % 3 + 1}, {v:.17e}\n"
        for i, j, v in zip(rows, columns, values, strict=True)
    )
    path.write_text("".join(text))


def write_calculix(job, matrices, numbers, kept):
    """Upper triangles of the kept dofs, which are written in the order of `kept`."""
    for ending, matrix in zip((".sti", ".mas"), matrices, strict=True):
        part = matrix[kept][:, kept]
        write_coordinate(Path(f"{job}{ending}"), *triangle(part, lower=False))
    Path(f"{job}.dof").write_text("".join(f"{numbers[i // 3]}.{i % 3 + 1}\n" for i in kept))


def write_abaqus(folder, kind, matrices, numbers):
    """Matrices as Abaqus writes them; the files."""
    files = [folder / f"ring_{name}1.mtx" for name in ("STIF", "MASS")]
    for file, matrix in zip(files, matrices, strict=True):
        if kind == "coordinate":
            whole = matrix.tocoo()
            write_coordinate(file, whole.row, whole.col, whole.data)
        else:
            write_labels(file, numbers, *triangle(matrix, lower=True))
    return files


@pytest.fixture(scope="module")
def small():
    """K and M of the ring of 8-node hexahedra."""
    arguments = ring_arguments()
    return [0.5 * (arguments[name] + arguments[name].T) for name in ("stiffness", "mass")]


@pytest.fixture(scope="module")
def quadratic(tmp_path_factory):
    """The documentation's ring, and K and M by dolfinx in the order of its nodes."""
    folder, solid = tmp_path_factory.mktemp("ring"), ring_solid("hex")
    write_model(folder / "ring.msh", solid)
    mesh = ehd.build_mesh(folder / "ring.msh", comm=MPI.COMM_SELF, serendipity_geometry=True)
    made = ehd.assemble_structure(mesh, ehd.Material(YOUNG, POISSON, DENSITY), attachments=())
    _, places = cKDTree(made.coordinates).query(solid.points)
    order = (3 * places[:, None] + np.arange(3)).ravel()
    return solid, [to_scipy(m)[order][:, order] for m in (made.stiffness, made.mass)]


def recipe(kind):
    """Lines of the page for one of the formats."""
    blocks = re.findall(r"(?:^    .*\n|^\n(?=    ))+", PAGE, re.MULTILINE)
    (lines,) = [block for block in blocks if "read_mesh(" in block]
    if kind != "calculix":
        (other,) = [line for line in PAGE.splitlines() if line.startswith("    read = read_abaqus")]
        lines = re.sub(r"    read = read_calculix.*", other, lines)
        assert "read_calculix(" not in lines
    return re.sub(r"^    ", "", lines, flags=re.MULTILINE)


@pytest.mark.parametrize("kind", ["calculix", "labels", "coordinate"])
def test_recipe_of_the_documentation(quadratic, kind, tmp_path, monkeypatch):
    solid, matrices = quadratic
    first = 1 if kind == "coordinate" else 101
    numbers = first + np.arange(len(solid.points))
    write_deck(tmp_path / "ring.inp", solid, numbers)
    if kind == "calculix":
        write_calculix(tmp_path / "ring", matrices, numbers, np.arange(3 * len(numbers)))
    else:
        write_abaqus(tmp_path, kind, matrices, numbers)
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(recipe(kind), names)
    body = ehd.load_body(tmp_path / "ring.h5")
    part = names["part"]
    direct = ehd.load_dependent(
        ehd.Structure(*matrices, solid.points, names["bore"], {"pin": names["pin"]}), 6, 31
    )
    assert part.size == 3 * len(numbers)
    np.testing.assert_allclose(body.frequencies[:6], direct.frequencies[:6], rtol=1e-9)


def test_recipe_of_the_documentation_for_8_nodes(tmp_path, monkeypatch):
    """A first-order deck keeps its nodes, which are those of its matrices."""
    nodes, cells, faces = ring_mesh(20, 2, 1)
    matrices = [0.5 * (m + m.T) for m in ring_matrices(nodes, cells)]
    around = cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    lines = [
        "*NODE",
        *(f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in enumerate(nodes.tolist(), 5)),
    ]
    lines += ["*ELEMENT, TYPE=C3D8"]
    lines += [", ".join(map(str, [n, *cell])) for n, cell in enumerate((around + 5).tolist(), 1)]
    (tmp_path / "ring.inp").write_text("\n".join(lines) + "\n")
    numbers = 5 + np.arange(len(nodes))
    write_calculix(tmp_path / "ring", matrices, numbers, np.arange(3 * len(numbers)))
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(recipe("calculix"), names)
    assert names["part"].size == 3 * len(nodes)
    np.testing.assert_array_equal(names["solid"].points, nodes)
    bore = ehd.bore_from_faces(nodes, faces, "bilinear")
    direct = ehd.load_dependent(ehd.Structure(*matrices, nodes, bore, {"pin": names["pin"]}), 6, 31)
    body = ehd.load_body(tmp_path / "ring.h5")
    np.testing.assert_allclose(body.frequencies[:6], direct.frequencies[:6], rtol=1e-9)


def test_matrix_market_and_npz_of_the_page(small, tmp_path, monkeypatch):
    line = re.search(r'`Structure\("(K\.mtx)", "(M\.npz)", \.\.\.\)`', PAGE)
    monkeypatch.chdir(tmp_path)
    io.mmwrite(line[1], small[0], precision=17, symmetry="symmetric")
    sparse.save_npz(line[2], small[1])
    part = ehd.Structure(line[1], line[2], ring_arguments()["coordinates"])
    for found, given_one in zip((part.stiffness, part.mass), small, strict=True):
        assert abs(to_scipy(found) - given_one).max() < 1e-15 * abs(given_one).max()


@settings(max_examples=15)
@given(st.sampled_from(["calculix", "labels"]), st.integers(0, 2**32 - 1))
def test_any_numbers_rows_and_triangle_give_the_same_matrices(tmp_path_factory, kind, seed):
    folder, random = tmp_path_factory.mktemp("m"), np.random.default_rng(seed)
    count = int(random.integers(2, 6))
    size = 3 * count
    half = random.standard_normal((2, size, size)) * (random.random((2, size, size)) < 0.5)
    matrices = [sparse.csr_matrix(h + h.T + 9 * np.eye(size)) for h in half]
    numbers = random.permutation(50)[:count] + 1
    if kind == "calculix":
        write_calculix(folder / "m", matrices, numbers, random.permutation(size))
        found = ehd.read_calculix(folder / "m", numbers)
    else:
        files = write_abaqus(folder, kind, matrices, numbers)
        # Of every pair either entry, and rows in any order: one triangle all the same.
        for file in files:
            lines = [line.split(",") for line in file.read_text().splitlines()]
            lines = [
                x if random.random() < 0.5 else [*x[2:4], *x[:2], x[4]]
                for x in random.permutation(lines).tolist()
            ]
            file.write_text("".join(",".join(x) + "\n" for x in lines))
        found = ehd.read_abaqus(*files, numbers)
    for ours, expected in zip((found.stiffness, found.mass), matrices, strict=True):
        np.testing.assert_array_equal(ours.toarray(), expected.toarray())
    np.testing.assert_array_equal(found.numbers, numbers)
    wanted = random.integers(0, count, (2, 3))
    np.testing.assert_array_equal(found.indices(numbers[wanted]), wanted)


def test_held_nodes_are_held(small, tmp_path):
    numbers = 5 + np.arange(small[0].shape[0] // 3)
    held = np.r_[0:6, 10]
    kept = np.setdiff1d(np.arange(small[0].shape[0]), held)
    write_calculix(tmp_path / "m", small, numbers, kept)
    found = ehd.read_calculix(tmp_path / "m", numbers)
    k = found.stiffness.toarray()
    np.testing.assert_array_equal(k[np.ix_(kept, kept)], small[0].toarray()[np.ix_(kept, kept)])
    assert not k[np.ix_(held, kept)].any()
    assert (k[held, held] > 0).all()
    without = ehd.read_calculix(tmp_path / "m")
    np.testing.assert_array_equal(without.numbers, numbers[2:])
    with pytest.raises(ehd.errors.StructureError, match="node 5 has no row in the matrices"):
        without.indices([[7, 5]])
    # A penalty has the same effect.
    penalty = small[0].copy()
    penalty.setdiag(np.where(np.isin(np.arange(len(k)), held), 1e36, penalty.diagonal()))
    files = write_abaqus(tmp_path, "labels", (penalty, small[1]), numbers)
    again = ehd.read_abaqus(*files)
    np.testing.assert_array_equal(again.stiffness.toarray(), k)


GOOD = {
    "m.sti": "1 1 2.0\n1 2 0.5\n2 2 2.0\n3 3 2.0\n",
    "m.mas": "1 1 1.0\n2 2 1.0\n3 3 1.0\n",
    "m.dof": "7.1\n7.2\n7.3\n",
}


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("m.sti", None, r"m\.sti: no such file"),
        ("m.dof", None, r"m\.dof: no such file"),
        ("m.sti", "", "m.sti is empty"),
        ("m.sti", "1 1 2.0\n1 2\n", r"m\.sti: "),
        ("m.sti", "1 1 x\n", r"m\.sti: .*could not convert"),
        ("m.sti", "1 1 2.0\n1 2 nan\n", "m.sti, entry 2: a number is not finite"),
        ("m.sti", "1 1.5 2.0\n", "m.sti, entry 1: .* must be whole numbers of"),
        ("m.sti", "1 4 2.0\n", "m.sti has row 4, but there are 3 rows"),
        ("m.sti", "0 1 2.0\n", "m.sti has the node or row 0, but numbers begin at 1"),
        ("m.sti", "1 1\n", "lines of 2 numbers, not 3"),
        ("m.mas", "1 1 1.0\n1 1 1.0\n", "m.mas has the entry of row 1, column 1 more than once"),
        ("m.mas", "1 1 1.0\n1 2 .5\n2 1 .5\n2 3 .5\n", "row 2, column 3 without its mirror"),
        ("m.dof", "7.1\n7\n7.3\n", r"m\.dof: .*columns changed"),
        ("m.dof", "", "m.dof is empty"),
        ("m.dof", "7.1\n7.2\n7.4\n", "node 7 has degree of freedom 4: only displacements"),
        ("m.dof", "7.1\n7.2\n7.2\n", "a degree of freedom of a node has two rows"),
    ],
)
def test_files_of_calculix_that_do_not_fit_are_named(tmp_path, file, text, message):
    for name, good in GOOD.items():
        if name != file or text is not None:
            (tmp_path / name).write_text(text if name == file else good)
    with pytest.raises(ehd.errors.StructureError, match=message):
        ehd.read_calculix(tmp_path / "m")


@pytest.mark.parametrize(
    ("stiffness", "numbers", "message"),
    [
        ("1,1, 1,1, 2.0\n", [2], "node 1 is not in .numbers."),
        ("1,1, 1,1, 2.0\n", [1, 1], "distinct whole numbers, one for every node"),
        ("1,1, 1,1, 2.0\n", [1.0], "numbers must be distinct whole numbers"),
        (
            "-1,1, -1,1, 2.0\n",
            None,
            "has the node or row -1, but numbers begin at 1: internal",
        ),
        ("1,6, 1,6, 2.0\n", None, "node 1 has degree of freedom 6"),
        ("1 1 2.0\n", None, "lines of 3 and 5 numbers: write both"),
        ("*MATRIX, TYPE=STIFFNESS\n1,1\n", None, "STIF"),
    ],
)
def test_files_of_abaqus_that_do_not_fit_are_named(tmp_path, stiffness, numbers, message):
    files = tmp_path / "STIF.mtx", tmp_path / "MASS.mtx"
    files[0].write_text(stiffness)
    files[1].write_text("1,1, 1,1, 1.0\n")
    with pytest.raises(ehd.errors.StructureError, match=message):
        ehd.read_abaqus(*files, None if numbers is None else np.array(numbers))


def test_coordinates_of_another_number_of_nodes_are_named(tmp_path):
    files = tmp_path / "STIF.mtx", tmp_path / "MASS.mtx"
    for file in files:
        file.write_text("1 1 1.0\n4 4 1.0\n")
    with pytest.raises(ehd.errors.StructureError, match="4 rows, not 3 for each of 2 nodes"):
        ehd.read_abaqus(*files)


def test_mass_of_tetrahedra_is_that_of_rigid_motions_and_refuses_folded_cells():
    solid = ring_solid("tet")
    mass = tetrahedron_mass(solid.points, solid.cells, 2.0)
    turned = tetrahedron_mass(solid.points, solid.cells[:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]], 2.0)
    assert abs(mass - turned).max() < 1e-14 * abs(mass).max()
    volume = tetrahedron_mass(solid.points, solid.cells, 1.0)[::3, ::3].sum()
    assert mass[::3, ::3].sum() == pytest.approx(2 * volume, rel=1e-14)
    x = np.column_stack([solid.points[:, 0], np.zeros((len(solid.points), 2))]).ravel()
    y = np.column_stack([solid.points[:, 1], np.zeros((len(solid.points), 2))]).ravel()
    assert x @ mass @ x == pytest.approx(y @ mass @ y, rel=1e-3)
    with pytest.raises(ehd.errors.StructureError, match=r"cell 0 .* is folded"):
        tetrahedron_mass(solid.points, solid.cells[:, [4, 1, 2, 3, 0, *range(5, 10)]], 1.0)
    with pytest.raises(ehd.errors.StructureError, match=r"cells have shape \(144, 4\)"):
        tetrahedron_mass(solid.points, solid.cells[:, :4], 1.0)
    with pytest.raises(ehd.errors.StructureError, match="cells refer to nodes 0 to"):
        tetrahedron_mass(solid.points[:-1], solid.cells, 1.0)


@pytest.mark.parametrize("made", [sparse.coo_matrix, sparse.coo_array])
def test_matrix_market_is_read_by_any_scipy(small, tmp_path, monkeypatch, made):
    """Newer SciPy returns a sparse array, and warns unless `spmatrix` is given."""
    io.mmwrite(tmp_path / "K.mtx", small[0], precision=17, symmetry="symmetric")
    read = io.mmread
    calls = []

    def newer(source, *, spmatrix=True):
        calls.append(spmatrix)
        return made(read(source))

    monkeypatch.setattr(io, "mmread", newer)
    part = ehd.Structure(tmp_path / "K.mtx", small[1], ring_arguments()["coordinates"])
    assert abs(to_scipy(part.stiffness) - small[0]).max() < 1e-15 * abs(small[0]).max()
    assert calls == [False]


def test_a_matrix_market_file_without_its_size_is_refused(small, tmp_path):
    io.mmwrite(tmp_path / "K.mtx", small[0])
    with (tmp_path / "K.mtx").open() as file:
        head = file.readline()
    (tmp_path / "K.mtx").write_text(f"{head}%\n")
    with pytest.raises(ehd.errors.StructureError, match="ends before the line with its size"):
        ehd.Structure(tmp_path / "K.mtx", small[1], ring_arguments()["coordinates"])


def test_exponents_of_fortran_are_read(small, tmp_path):
    """``1.5D+03`` in files of CalculiX, Abaqus and in Matrix Market form."""
    numbers = np.arange(1, 1 + small[0].shape[0] // 3)
    write_calculix(tmp_path / "m", small, numbers, np.arange(3 * len(numbers)))
    files = write_abaqus(tmp_path, "labels", small, numbers)
    io.mmwrite(tmp_path / "K.mtx", small[0], precision=17, symmetry="symmetric")
    for file in (tmp_path / "m.sti", files[0], tmp_path / "K.mtx"):
        text = file.read_text()
        file.write_text(re.sub(r"(?<=\d)e(?=[+-]\d)", "D", text))
        assert file.read_text() != text
    part = ehd.Structure(tmp_path / "K.mtx", small[1], ring_arguments()["coordinates"])
    for found in (
        ehd.read_calculix(tmp_path / "m").stiffness,
        ehd.read_abaqus(*files).stiffness,
        to_scipy(part.stiffness),
    ):
        assert abs(found - small[0]).max() < 1e-14 * abs(small[0]).max()
