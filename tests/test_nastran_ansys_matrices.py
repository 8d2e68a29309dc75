"""Matrices that Nastran and Ansys write: foreign files, the ring in every form, refusals."""

import gzip
import shutil
from pathlib import Path

import numpy as np
import pytest
from foreign_parts import DENSITY, OUTER, RADIUS, WIDTH, ring_arguments, ring_matrices, ring_mesh
from mpi4py import MPI
from scipy import io, sparse
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import fenics_ehd as ehd
from fenics_ehd.reduction.foreign_matrices import ForeignMatrices, in_order
from fenics_ehd.reduction.matrix_check import RIGID_LIMIT, check_matrices
from fenics_ehd.reduction.nastran_matrices import read_op4_matrices
from fenics_ehd.reduction.structure import check_structure

FILES = Path(__file__).parent / "matrices"

#: First elastic frequency of the rotor by EXUDYN with its own reader [Hz] (TestModels,
#: compareAbaqusAnsysRotorEigenfrequencies.py).
ROTOR_FREQUENCY = 104.63701055079783


@pytest.fixture(scope="module")
def ring():
    """K and M of the ring of 8-node hexahedra, and positions of its nodes."""
    nodes, cells, _ = ring_mesh()
    stiffness, mass = (0.5 * (m + m.T) for m in ring_matrices(nodes, cells))
    return stiffness.tocsr(), mass.tocsr(), nodes


# OUTPUT4


@pytest.mark.parametrize("form", ["t_dn", "t_s1", "t_s2", "b_dn", "b_s1", "b_s2"])
def test_matrices_of_another_program_are_equal_in_every_form(form):
    """Text and binary; full columns, strings and strings of BIGMAT; real and complex."""
    found = read_op4_matrices(FILES / "nastran" / f"mat_{form}.op4")
    full = read_op4_matrices(FILES / "nastran" / "mat_t_dn.op4")
    assert set(found) == set(full)
    for name, matrix in full.items():
        assert abs(found[name] - matrix).max() == 0.0
    np.testing.assert_array_equal(found["EYE10"].toarray(), np.eye(10))
    assert found["STRINGS"].shape == (30, 20)
    assert np.iscomplexobj(found["EYE5CD"].data)
    assert found["NULL"].nnz == 0


def op4_text(name, matrix, *, bigmat=False):
    """Text file with strings, one for each value, as a sparse matrix of Nastran."""
    matrix = matrix.tocsc()
    rows, columns = matrix.shape
    lines = [f"{columns:8d}{-rows if bigmat else rows:8d}{6:8d}{2:8d}{name:<8s}1P,3E23.16"]
    for column in range(columns):
        part = slice(matrix.indptr[column], matrix.indptr[column + 1])
        lines.append(f"{column + 1:8d}{0:8d}{3 * (part.stop - part.start):8d}")
        for row, value in zip(matrix.indices[part], matrix.data[part], strict=True):
            head = f"{3:8d}{row + 1:8d}" if bigmat else f"{65536 * 3 + row + 1:12d}"
            lines += [head, f"{value:23.16E}"]
    lines += [f"{columns + 1:8d}{1:8d}{2:8d}", f"{1.0:23.16E}"]
    return "\n".join(lines) + "\n"


def op4_binary(name, matrix, integer, order):
    """Binary file with full columns, integers of 4 or 8 bytes in either byte order."""
    dense = matrix.toarray()
    whole, real = f"{order}i{integer}", f"{order}f8"

    def record(*parts):
        content = b"".join(parts)
        mark = np.array(len(content), f"{order}i4").tobytes()
        return mark + content + mark

    columns = dense.shape[1]
    head = np.array([columns, len(dense), 6, 2], whole).tobytes()
    records = [record(head, name.encode().ljust(2 * integer))]
    words = 8 // integer
    for column in range(columns):
        numbers = np.array([column + 1, 1, words * len(dense)], whole).tobytes()
        records.append(record(numbers, dense[:, column].astype(real).tobytes()))
    numbers = np.array([columns + 1, 1, words], whole).tobytes()
    return b"".join([*records, record(numbers, np.ones(1, real).tobytes())])


def in_g_set(matrix):
    """Rows of six degrees of freedom for a node: those of rotations are empty."""
    size = 2 * matrix.shape[0]
    rows = np.flatnonzero(np.arange(size) % 6 < 3)
    wide = sparse.csr_matrix((np.ones(len(rows)), (rows, range(len(rows)))), (size, len(rows)))
    return (wide @ matrix @ wide.T).tocsr()


def test_strings_that_state_the_words_of_their_column_are_read(ring, tmp_path):
    """Form of pyNastran 1.4.1."""
    text = op4_text("KGG", ring[0][:6, :6].tocsr())
    lines = []
    for line in text.splitlines():
        numbers = line.split()
        if len(numbers) == 3 and numbers[1] == "0":
            stated = 2 * int(numbers[2]) // 3 + 1
            line = f"{numbers[0]:>8s}{0:8d}{stated:8d}"
        if len(line) == 12:
            line = f"{65536 * stated + int(line) % 65536:12d}"
        lines.append(line)
    (tmp_path / "k.op4").write_text("\n".join(lines) + "\n")
    found = read_op4_matrices(tmp_path / "k.op4")["KGG"]
    np.testing.assert_array_equal(found.toarray(), ring[0][:6, :6].toarray())
    del lines[3]
    (tmp_path / "k.op4").write_text("\n".join(lines) + "\n")
    with pytest.raises(
        ehd.errors.StructureError, match=r"column 1 of KGG has . values, but .* wor"
    ):
        read_op4_matrices(tmp_path / "k.op4")


@pytest.mark.parametrize("form", ["strings", "bigmat", "<4", ">4", "<8", ">8"])
@pytest.mark.parametrize("rotations", [False, True])
def test_the_ring_from_output4(ring, form, rotations, tmp_path):
    file = tmp_path / "ring.op4"
    matrices = [in_g_set(m) if rotations else m for m in ring[:2]]
    named = zip(("KGG", "MGG"), matrices, strict=True)
    if form in ("strings", "bigmat"):
        file.write_text("".join(op4_text(n, m, bigmat=form == "bigmat") for n, m in named))
    else:
        parts = [op4_binary(n, m, int(form[1]), form[0]) for n, m in named]
        file.write_bytes(b"".join(parts))
    numbers = 10 * np.arange(1, 1 + len(ring[2]))
    found = ehd.read_op4(file, numbers=numbers)
    assert abs(found.stiffness - ring[0]).max() < 1e-15 * abs(ring[0]).max()
    assert abs(found.mass - ring[1]).max() < 1e-15 * abs(ring[1]).max()
    np.testing.assert_array_equal(found.numbers, numbers)
    part = ehd.Structure(found.stiffness, found.mass, ring[2], ring_arguments()["bores"])
    assert part.size == 3 * len(ring[2])


def test_nodes_of_output4_are_in_ascending_order_whatever_order_is_wanted(ring, tmp_path):
    """Nastran sorts by number; the caller's nodes may have any order."""
    numbers = np.random.default_rng(3).permutation(len(ring[2])) + 7
    order = np.argsort(numbers)
    rows = (3 * order[:, None] + [0, 1, 2]).ravel()
    for name, matrix in zip(("K", "M"), ring[:2], strict=True):
        (tmp_path / f"{name}.op4").write_text(op4_text(name, matrix[rows][:, rows]))
    found = ehd.read_op4(tmp_path / "K.op4", tmp_path / "M.op4", numbers)
    assert abs(found.stiffness - ring[0]).max() < 1e-15 * abs(ring[0]).max()
    assert found.check(ring[2]).rotation_defect < RIGID_LIMIT


def unlike(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


#: A value of a text file.
ONE = f"{1.0:23.16E}"

HEAD = f"{3:8d}{3:8d}{6:8d}{2:8d}KGG     1P,3E23.16\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "neither a text nor a binary file"),
        (b"%%MatrixMarket matrix", "neither a text nor a binary file"),
        (b"\x18\0\0\0" + bytes(10), "damaged or cut off"),
        (b"       3       3 no head\n", "no head of a matrix"),
        (HEAD.encode(), "the file ends in column 0 of 3 of KGG"),
        ((HEAD + f"{1:8d}{1:8d}{4:8d}\n{ONE}\n").encode(), "the file ends in column 1"),
        ((HEAD + f"{1:8d}{1:8d}{9:8d}\n{ONE}\n{2:8d}{1:8d}{2:8d}\n").encode(), "9 words are"),
        (
            (HEAD + f"{1:8d}{3:8d}{4:8d}\n{ONE}\n{ONE}\n{4:8d}{1:8d}{2:8d}\n{ONE}\n").encode(),
            "row 4",
        ),
        (
            (
                HEAD
                + f"{1:8d}{0:8d}{7:8d}\n{65536 * 7 + 1:12d}\n{ONE}\n{ONE}\n{4:8d}{1:8d}{2:8d}\n"
            ).encode(),
            "column 1 of KGG has 2 values, but 6 words are",
        ),
        (
            (
                HEAD + f"{1:8d}{1:8d}{1:8d}\n{ONE}\n{2:8d}{1:8d}{2:8d}\n{ONE}\n{4:8d}{1:8d}{2:8d}\n"
            ).encode(),
            "column 2 of KGG has 1 values from row 1, but 2 words are",
        ),
        ((HEAD + f"{1:8d}{1:8d}{2:8d}\n{'*.****':>23s}\n").encode(), "is no number"),
        ((HEAD + f"{1:8d}{1:8d}{2:8d}{2:8d}\n").encode(), "is no record of matrix KGG"),
    ],
)
def test_damaged_files_of_output4_are_named(content, message, tmp_path):
    (tmp_path / "bad.op4").write_bytes(content)
    with pytest.raises(ehd.errors.StructureError, match=f"bad.op4: .*{message}"):
        read_op4_matrices(tmp_path / "bad.op4")


def test_a_cut_binary_file_is_refused_at_every_length(ring, tmp_path):
    whole = op4_binary("KGG", ring[0][:6, :6].tocsr(), 4, "<")
    for length in range(4, len(whole) - 8, 11):
        (tmp_path / "cut.op4").write_bytes(whole[:length])
        with pytest.raises(ehd.errors.StructureError, match=r"cut\.op4: "):
            read_op4_matrices(tmp_path / "cut.op4")


def test_matrices_that_are_not_those_of_a_solid_part_are_named(ring, tmp_path):
    error = ehd.errors.StructureError
    with pytest.raises(error, match="no such file"):
        ehd.read_op4(tmp_path / "none.op4")
    file = FILES / "nastran" / "mat_t_dn.op4"
    with pytest.raises(error, match=r"has no matrix KGG, but .*EYE10.*: give names"):
        ehd.read_op4(file)
    with pytest.raises(error, match="EYE5CD: its numbers are complex"):
        ehd.read_op4(file, names=("EYE5CD", "EYE10"))
    with pytest.raises(error, match="K and M have one name, in one file"):
        ehd.read_op4(file, names=("EYE10", "EYE10"))
    with pytest.raises(error, match="must be the names of K and of M"):
        ehd.read_op4(file, names=("EYE10",))
    with pytest.raises(error, match=r"shape \(10, 10\), not six rows .*: give the numbers of all"):
        ehd.read_op4(file, names=("EYE10", "RND1RD"))
    with pytest.raises(error, match=r"shape \(10, 10\), but 3 nodes have 3 or 6 rows"):
        ehd.read_op4(file, numbers=[1, 2, 3], names=("EYE10", "RND1RD"))
    with pytest.raises(error, match="numbers must be distinct whole numbers"):
        ehd.read_op4(file, numbers=5, names=("EYE10", "RND1RD"))
    beam = in_g_set(ring[0]).tolil()
    beam[4, 0] = beam[0, 4] = 5.0
    (tmp_path / "beam.op4").write_text(op4_text("KGG", beam.tocsr()))
    with pytest.raises(error, match="the rotation 5 of node 1 has stiffness or mass"):
        ehd.read_op4(tmp_path / "beam.op4", tmp_path / "beam.op4", range(1, 1 + len(ring[2])))
    twice = op4_text("KGG", ring[0][:6, :6].tocsr())
    (tmp_path / "twice.op4").write_text(twice + twice)
    with pytest.raises(error, match="there are two matrices KGG"):
        read_op4_matrices(tmp_path / "twice.op4")
    (tmp_path / "huge.op4").write_text(twice.replace(f"{6:8d}{6:8d}", f"{6:8d}{99999999:8d}", 1))
    with pytest.raises(
        error, match=r"99999999 rows and 6 columns, but only .* its head is damaged"
    ):
        read_op4_matrices(tmp_path / "huge.op4")


# DMIG


def dmig_text(name, matrix, numbers, *, form=6):
    """Cards of a matrix in wide fields, one triangle if symmetric."""
    half = (sparse.triu(matrix) if form == 6 else matrix).tocsc()
    lines = [f"{'DMIG':8s}{name:8s}{0:8d}{form:8d}{2:8d}{0:8d}{'':16s}{matrix.shape[0]:8d}"]
    for column in range(half.shape[1]):
        lines.append(f"{'DMIG*':8s}{name:<16s}{numbers[column // 3]:16d}{column % 3 + 1:16d}")
        part = slice(half.indptr[column], half.indptr[column + 1])
        for row, value in zip(half.indices[part], half.data[part], strict=True):
            lines.append(f"{'*':8s}{numbers[row // 3]:16d}{row % 3 + 1:16d}{value:16.9E}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("form", [6, 1])
def test_the_ring_from_dmig_cards(ring, form, tmp_path):
    numbers = np.random.default_rng(4).permutation(len(ring[2])) + 7
    text = "".join(
        dmig_text(name, matrix, numbers, form=form)
        for name, matrix in zip(("KAAX", "MAAX"), ring[:2], strict=True)
    )
    lines = text.splitlines()
    lines.insert(4, "   $ an indented comment")
    (tmp_path / "ring.pch").write_text("\n".join(["$ a comment", *lines, "ENDDATA"]))
    found = ehd.read_dmig(tmp_path / "ring.pch", numbers=numbers)
    # A field of 16 characters has 10 digits.
    assert abs(found.stiffness - ring[0]).max() < 1e-9 * abs(ring[0]).max()
    assert abs(found.mass - ring[1]).max() < 1e-9 * abs(ring[1]).max()
    assert found.check(ring[2]).rotation_defect < RIGID_LIMIT


def test_dmig_cards_of_another_program():
    """Diagonal of K and total of M, read by eye from the file."""
    found = ehd.read_dmig(FILES / "nastran" / "dmig.pch")
    assert found.numbers[:3].tolist() == [101, 102, 105]
    # The file has component 1 of every grid point; the others have no row and count as held.
    np.testing.assert_allclose(found.stiffness.diagonal()[:4:3], [155.6, 381.5])
    np.testing.assert_allclose(found.stiffness[0, 3], -155.6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("KAAX", "KBBX", "no DMIG matrix KAAX; there are: KBBX, MAAX; give names"),
        ("       6       2       0", "       9       2       0", "has form 9, but must have 1"),
        ("       6       2       0", "       6       3       0", "its numbers are complex"),
        (
            "               7               1",
            "               7               4",
            "direction|freedom 4",
        ),
        (
            "               7               1",
            "               7               x",
            "is no whole number",
        ),
        ("E+0", "E+x", "is no number"),
        (f"{1:16d}\n*{7:23d}", f"{1:16d}\n*{'':23s}", "all are needed"),
    ],
)
def test_dmig_cards_that_cannot_be_used_are_named(ring, old, new, message, tmp_path):
    numbers = np.arange(7, 7 + len(ring[2]))
    stiffness = dmig_text("KAAX", ring[0], numbers)
    stiffness = stiffness.replace(old, new) if "KAAX" in old else unlike(stiffness, old, new)
    (tmp_path / "ring.pch").write_text(stiffness + dmig_text("MAAX", ring[1], numbers))
    with pytest.raises(ehd.errors.StructureError, match=rf"ring\.pch: .*({message})"):
        ehd.read_dmig(tmp_path / "ring.pch")


# Ansys


@pytest.fixture(scope="module")
def rotor_files(tmp_path_factory):
    """Files of Ansys: stiffness, mass, mapping; and its nodes, in the order of their numbers."""
    folder = tmp_path_factory.mktemp("ansys")
    names = ("StiffnessMatrixSparse", "MassMatrixSparse", "MatrixDofMappingVector")
    targets = [folder / f"{name}.txt" for name in names]
    for name, target in zip(names[:2], targets[:2], strict=True):
        with gzip.open(FILES / "ansys" / f"rotorAnsys{name}.txt.gz") as packed:
            target.write_bytes(packed.read())
    shutil.copy(FILES / "ansys" / f"rotorAnsys{names[2]}.txt", targets[2])
    text = (FILES / "ansys" / "rotorAnsysNodalCoordinates.txt").read_text().replace(",", ".")
    nodes = np.array([line.split() for line in text.splitlines()[1:]], dtype=float)
    return targets, nodes[np.argsort(nodes[:, 0]), 1:]


def test_a_rotor_of_ansys_has_its_frequency_its_mass_and_no_force_in_rigid_motions(
    rotor_files, figure
):
    files, nodes = rotor_files
    found = ehd.read_ansys(*files)
    np.testing.assert_array_equal(found.numbers, np.arange(1, 1 + len(nodes)))
    check = found.check(nodes)
    assert not check.held
    assert not check.notices
    assert check.rotation_defect < 1e-12
    np.testing.assert_allclose(check.centre[:2], 0.0, atol=1e-12)
    # The mass of a lumped matrix is its diagonal.
    np.testing.assert_allclose(check.mass, found.mass.diagonal()[::3].sum())
    squares = eigh(found.stiffness.toarray(), found.mass.toarray(), eigvals_only=True)
    error = abs(np.sqrt(squares[6]) / (2 * np.pi) / ROTOR_FREQUENCY - 1.0)
    figure("part and reduction", "rotor of Ansys, frequency against Exudyn", error, most=1e-9)


def test_a_mapping_of_equations_gives_the_same_part(rotor_files, tmp_path):
    """``HBMAT`` names node and direction of every equation."""
    files, _ = rotor_files
    order = np.asarray(io.mmread(files[2])).ravel()
    lines = [
        f"{3 * i + j + 1:12d}{node:12d}  U{'XYZ'[j]}"
        for i, node in enumerate(order)
        for j in range(3)
    ]
    mapping = tmp_path / "file.mapping"
    mapping.write_text("\n".join(["   Matrix Eqn    Node    DOF", *reversed(lines)]) + "\n")
    found = ehd.read_ansys(*files[:2], mapping)
    expected = ehd.read_ansys(*files)
    assert abs(found.stiffness - expected.stiffness).max() == 0.0
    for old, new, message in (
        ("UX", "ROTX", "direction ROTX: only displacements"),
        (f"{1:12d}{order[0]:12d}  UX\n", "", "must have each equation from 1 to 344 once"),
    ):
        bad = tmp_path / "bad.mapping"
        bad.write_text(unlike(mapping.read_text() + "", old, new))
        with pytest.raises(ehd.errors.StructureError, match=message):
            ehd.read_ansys(*files[:2], bad)


def test_files_of_ansys_that_do_not_fit_are_named(rotor_files, tmp_path):
    files, _ = rotor_files
    error = ehd.errors.StructureError
    with pytest.raises(error, match="does not begin with %%MatrixMarket"):
        ehd.read_ansys(FILES / "README.md", *files[1:])
    with pytest.raises(error, match="neither an array in Matrix Market form nor lines"):
        ehd.read_ansys(*files[:2], FILES / "README.md")
    short = tmp_path / "short.txt"
    short.write_text("%%MatrixMarket matrix array integer general\n2 1\n1\n2\n")
    with pytest.raises(error, match=r"short\.txt names the nodes of 6 eq.*\(345, 345\): write"):
        ehd.read_ansys(*files[:2], short)
    small = tmp_path / "small.txt"
    io.mmwrite(small.with_suffix(".mtx"), sparse.eye(6).tocoo())
    small.with_suffix(".mtx").rename(small)
    with pytest.raises(error, match=r"345 equations, but .*small\.txt has the shape \(6, 6\)"):
        ehd.read_ansys(small, *files[1:])


# Check


def test_a_part_in_order_states_mass_centre_and_density(ring):
    check = check_matrices(*ring)
    volume = 12 * np.sin(2 * np.pi / 12) / 2 * (OUTER**2 - RADIUS**2) * WIDTH
    np.testing.assert_allclose(check.mass, DENSITY * volume, rtol=1e-12)
    np.testing.assert_allclose(check.centre, 0.0, atol=1e-15)
    assert max(check.translation_defect, check.rotation_defect) < 1e-12
    assert 0.1 < check.density / DENSITY < 1.0
    assert not check.notices
    assert f"mass {check.mass:.6g} kg" in str(check)


@pytest.mark.parametrize("change", ["two nodes", "two axes", "all nodes"])
def test_a_wrong_order_is_refused(ring, change):
    nodes = ring[2].copy()
    if change == "two nodes":
        nodes[[3, 4]] = nodes[[4, 3]]
    elif change == "two axes":
        nodes = nodes[:, [1, 0, 2]]
    else:
        nodes = nodes[::-1]
    with pytest.raises(ehd.errors.StructureError, match="not in the same order of nodes, or of x"):
        check_matrices(*ring[:2], nodes)


@pytest.mark.parametrize(
    ("length", "force", "notice"),
    [
        (1e3, 1e-3, "multiply coordinates by 0.001, K and M by 1000"),
        (1.0, 1e-3, "multiply K and M by 1000 (N, mm and t)"),
    ],
)
def test_units_that_do_not_belong_together_are_noticed(ring, length, force, notice):
    check = check_matrices(force * ring[0], force * ring[1], length * ring[2])
    (line,) = check.notices
    assert notice in line
    assert f"notice: {line}" in str(check)


@pytest.mark.parametrize(
    ("force", "mass", "notice"),
    [
        (1.0, 1e-3, "multiply M by 1000 (t)"),
        (1e-3, 1.0, "multiply K by 1000 (N/mm)"),
        (1.0, 1e3, "multiply M by 0.001 (g)"),
        (1e9, 1.0, "give coordinates in m, K in N/m, M in kg"),
    ],
)
def test_the_conversion_of_one_wrong_unit_is_named(ring, force, mass, notice):
    (line,) = check_matrices(force * ring[0], mass * ring[1], ring[2]).notices
    assert line.endswith(notice)


def test_dense_arrays_are_matrices(ring):
    check = check_matrices(ring[0].toarray(), ring[1].toarray(), ring[2])
    assert str(check) == str(check_matrices(*ring))


def test_impossible_units_are_refused(ring):
    with pytest.raises(ehd.errors.StructureError, match=r"kg/m3, which is impossible: give coord"):
        check_matrices(*ring[:2], 1e3 * ring[2])


def test_a_held_part_is_reported_as_held(ring):
    held = ring[0].tolil()
    held[:9, :9] += 1e9 * np.eye(9)
    assert "held" in str(check_matrices(held.tocsr(), *ring[1:]))


def test_a_diagonal_that_counts_twice_is_noticed(ring):
    """``U + U.T`` of an upper triangle has elastic forces in translations at every node."""
    upper = sparse.triu(ring[0])
    doubled = (upper + upper.T).tocsr()
    check = check_matrices(doubled, *ring[1:])
    assert "elastic forces at every node" in check.notices[0]
    assert "notice: translations have elastic forces at every node" in repr(check)
    assert "every node" in check._repr_html_()
    part = ehd.Structure(doubled, *ring[1:])
    with pytest.warns(UserWarning, match="is the diagonal of K counted twice"):
        check_structure(part)


def test_shapes_that_do_not_fit_are_named(ring):
    with pytest.raises(ehd.errors.StructureError, match=r"stiffness matrix has shape .* 3 rows"):
        check_matrices(*ring[:2], ring[2][:-1])
    flat = ring[2] * [1.0, 1.0, 0.0]
    with pytest.raises(ehd.errors.StructureError, match=r"in one plane|same order"):
        check_matrices(*ring[:2], flat)


def test_rows_of_a_large_part_have_products_above_32_bits():
    """A diagonal and one coupling of 20 000 nodes, as 32-bit row numbers."""
    size = 60_000
    rows = np.append(np.arange(size), [1, size - 2]).astype(np.int32)
    columns = np.append(np.arange(size), [size - 2, 1]).astype(np.int32)
    values = np.append(np.full(size, 2.0), [0.5, 0.5])
    entries = (np.column_stack([rows, columns]), values)
    labels = np.column_stack([np.repeat(np.arange(1, size // 3 + 1), 3), np.arange(size) % 3])
    found = in_order([Path("K"), Path("M")], [entries, entries], labels, None)
    assert found.stiffness.nnz == size + 2


def test_a_row_without_stiffness_does_not_hold_the_others(ring):
    """Only a penalty against most of the diagonal counts as held."""
    soft = ring[0].tolil()
    soft[3, :] = soft[:, 3] = 0.0
    soft[3, 3] = 1e-8
    both = [m.tocoo() for m in (soft, ring[1])]
    entries = [(np.column_stack([m.row, m.col]), m.data) for m in both]
    nodes = np.arange(1, 1 + len(ring[2]))
    labels = np.column_stack([np.repeat(nodes, 3), np.tile([0, 1, 2], len(nodes))])
    found = in_order([Path("K"), Path("M")], entries, labels, None)
    assert abs(found.stiffness - soft.tocsr()).max() == 0.0


@pytest.mark.parametrize(
    ("which", "value", "message"),
    [
        ("stiffness", np.nan, "stiffness has a value that is not finite"),
        ("mass", 0.0, "mass has the diagonal entry 0 at node 0, component x"),
        ("mass", -1.0, "mass has the diagonal entry -"),
    ],
)
def test_matrices_of_no_part_are_refused_by_the_check(ring, which, value, message):
    changed = {"stiffness": ring[0], "mass": ring[1]}
    changed[which] = changed[which] * value
    with pytest.raises(ehd.errors.StructureError, match=message):
        check_matrices(**changed, coordinates=ring[2])


def rounded(matrix, digits):
    """A matrix whose file has a number of digits."""
    copy = matrix.copy()
    copy.data = np.array([float(f"{value:.{digits - 1}e}") for value in copy.data])
    return copy


def test_damaged_entries_show_in_the_check(ring):
    error = ehd.errors.StructureError
    heavy = ring[1].tolil()
    heavy[4, 4] *= 1.1
    with pytest.raises(error, match=r"masses along x, y and z are .* entries of M are missing"):
        check_matrices(ring[0], heavy.tocsr(), ring[2])
    askew = ring[0].tolil()
    askew[4, 7] *= 1.5
    with pytest.raises(error, match="stiffness is not symmetric: relative defect"):
        check_matrices(askew.tocsr(), *ring[1:])
    with pytest.raises(error, match="are no numbers"):
        check_matrices(*ring[:2], "abc")


@pytest.mark.parametrize("digits", [12, 10, 8, 7])
def test_forces_that_the_digits_of_a_file_explain_are_accepted(ring, digits):
    check = check_matrices(rounded(ring[0], digits), *ring[1:])
    assert not check.held
    assert not check.notices
    assert f"as accurate as the file's {digits} digits" in str(check)
    unit = 0.5 * 10.0 ** (1 - digits)
    assert 0.05 * unit < max(check.translation_defect, check.rotation_defect) < unit


def test_forces_that_the_digits_do_not_explain_are_noticed_or_refused(ring):
    """A value that is wrong in its ninth digit, in a file of ten; a file of five digits."""
    error = ehd.errors.StructureError
    damaged = rounded(ring[0], 10)
    row = 100
    column = damaged.indices[damaged.indptr[row]]
    part = damaged.tolil()
    part[row, column] = part[column, row] = float(f"{(1 + 4e-8) * damaged[row, column]:.9e}")
    (line,) = check_matrices(part.tocsr(), *ring[1:]).notices
    assert "more than the digits of K explain" in line
    with pytest.raises(error, match=r"K has 5 digits, at least 7 are needed"):
        check_matrices(rounded(ring[0], 5), *ring[1:])
    single = ring[0].astype(np.float32).astype(float)
    assert "the file's single precision" in str(check_matrices(single, *ring[1:]))
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    turned = ForeignMatrices(single, ring[1], np.arange(72)).turned(turn)
    assert "as accurate as 7 digits" in str(turned.check(ring[2] @ turn.T))


@pytest.mark.parametrize("digits", [0, 99, "10"])
def test_stated_digits_are_a_count(ring, digits):
    with pytest.raises(ehd.errors.SettingsError, match="digits"):
        check_matrices(*ring, digits=digits)


def bore_flexibility(body):
    """Flexibility of the bore by the body's elastic coordinates."""
    load = body.load_projection[-body.modes :]
    return load.T @ np.linalg.solve(body.stiffness, load)


def test_a_free_part_of_ten_digits_is_reduced_to_within_the_stated_error(ring, figure):
    """Frequencies and flexibility, against those of all digits; also of a rotated part."""
    arguments = ring_arguments(comm=MPI.COMM_SELF)
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    read = ForeignMatrices(rounded(ring[0], 10), rounded(ring[1], 10), np.arange(72))
    back = read.turned(turn).turned(turn.T)
    assert back.digits == 10
    exact = ehd.full_interface(ehd.Structure(**arguments))
    assert "stiffness_rounding" not in exact.accuracy
    flexibility = bore_flexibility(exact)
    for each in (read, back):
        assert not each.check(ring[2]).notices
        matrices = {"stiffness": each.stiffness, "mass": each.mass, "digits": each.digits}
        part = ehd.Structure(**arguments | matrices)
        body = ehd.full_interface(part)
        stated = body.accuracy["stiffness_rounding"]
        assert 5e-10 < stated < 1e-6
        errors = [
            np.abs(body.frequencies[:6] / exact.frequencies[:6] - 1.0).max(),
            np.abs(bore_flexibility(body) - flexibility).max() / np.abs(flexibility).max(),
        ]
        assert max(errors) < stated
    figure("matrices", "10 digits of K, error over stated error", max(errors) / stated, most=1.0)
    (line,) = check_matrices(back.stiffness, back.mass, ring[2]).notices
    assert "state the digits of its file, digits=10" in line
