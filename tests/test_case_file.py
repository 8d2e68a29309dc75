"""Files of cases as editors, spreadsheets, pandas, NumPy and MATLAB write them, and bad files."""

import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.scenes.scene import as_stored
from fenics_ehd.study.case_file import read_case_file

KEYS = "joints.big_end.clearance", "lubricants.oil.viscosity"
ROWS = [(1.4e-5, 0.01), (1.5e-5, 0.011)]


@pytest.fixture(scope="module")
def scene():
    return as_stored("slider-crank-paper")


def read(scene, directory, content):
    path = directory / "cases.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_case_file(scene, str(path), "--cases cases.csv")


@pytest.mark.parametrize(
    "content",
    [
        "clearance,oil.viscosity\n1.4e-5,0.01\n1.5e-5,0.011\n",
        # Excel: American with a byte order mark; German; Unicode text; Macintosh
        "\ufeffclearance,oil.viscosity\r\n1.40E-05,0.01\r\n1.50E-05,0.011\r\n",
        "clearance;oil.viscosity\r\n1,40E-05;0,01\r\n1,50E-05;0,011\r\n",
        "sep=;\r\nclearance;oil.viscosity\r\n1,40E-05;0,01\r\n1,50E-05;0,011\r\n",
        "clearance\toil.viscosity\r\n1,40E-05\t0,01\r\n1,50E-05\t0,011\r\n".encode("utf-16"),
        "clearance,oil.viscosity\r1.40E-05,0.01\r1.50E-05,0.011\r",
        # Empty lines and columns, at the end and between
        "clearance;;oil.viscosity;;\r\n1,4E-05;;0,01;;\r\n;;;;\r\n1,5E-05;;0,011\r\n;;;;\r\n",
        "clearance,oil.viscosity\n1.4e-5,0.01,\n1.5e-5,0.011,,\n\n\n",
        # LibreOffice: all texts quoted; decimal commas quoted between commas
        '"clearance","oil.viscosity"\n"1.4e-5","0.01"\n"1.5e-5","0.011"\n',
        '"clearance","oil.viscosity"\n"0,000014","0,01"\n"0,000015","0,011"\n',
        # pandas and R with an index, a sweep's own table with its number of the case
        ",clearance,oil.viscosity\n0,1.4e-05,0.01\n1,1.5e-05,0.011\n",
        '"","clearance","oil.viscosity"\n"1",1.4e-05,0.01\n"2",1.5e-05,0.011\n',
        "case,clearance,oil.viscosity\n1,1.4e-05,0.01\n2,1.5e-05,0.011\n",
        # MATLAB: a table; aligned by spaces
        "clearance,oil.viscosity\n1.4e-05,0.01\n1.5e-05,0.011",
        "  clearance   oil.viscosity\n   1.4e-05   1.0000000e-02\n   1.5e-05   1.1000000e-02\n",
        # Comments
        "# of Monday\nclearance, oil.viscosity\n# first\n1.4e-5, 0.01\n1.5e-5, 0.011\n",
    ],
)
def test_one_meaning_in_many_forms(content, scene, tmp_path):
    file = read(scene, tmp_path, content)
    assert file.keys == KEYS
    assert list(file.rows) == ROWS


@pytest.mark.parametrize(
    "content",
    [
        "clearance [um],oil.viscosity\n14,0.01\n15,0.011\n",
        "clearance (um),oil.viscosity [Pa s]\n14,10e-3\n15,11e-3\n",
        # The Western code page of Windows, and a line of units
        "clearance [\u00b5m];oil.viscosity\r\n14;0,01\r\n15;0,011\r\n".encode("cp1252"),
        "clearance;oil.viscosity\r\n\u00b5m;Pa s\r\n14;0,01\r\n15;0,011\r\n".encode("cp1252"),
        "clearance,oil.viscosity\n[um],[-]\n14,0.01\n15,0.011\n",
        "clearance\toil.viscosity\num\t\n14\t0.01\n15\t0.011\n",
        "clearance [um] oil.viscosity\n14 0.01\n15 0.011\n",
        # A unit in each cell
        "clearance;oil.viscosity\n14,0 um;0,01\n15 um;0,011\n",
    ],
)
def test_units_of_columns_lines_and_cells(content, scene, tmp_path):
    file = read(scene, tmp_path, content)
    assert file.keys == KEYS
    number = [tuple(str(value).split()[0] for value in row) for row in file.rows]
    np.testing.assert_allclose(np.array(number, float), [(14, 0.01), (15, 0.011)], rtol=1e-15)
    assert {str(row[0]).split()[1] for row in file.rows} <= {"um", "\u00b5m"}


def test_words_that_are_units_stay_words(scene, tmp_path):
    file = read(scene, tmp_path, 'reduction.method,big_end.cells\nm3,"[20, 5]"\nm4,"[40, 10]"\n')
    assert list(file.rows) == [("m3", [20, 5]), ("m4", [40, 10])]
    assert list(file.lines) == [2, 3]
    spaces = read(scene, tmp_path, "reduction.method big_end.cells\nm3 [20, 5]\nm4 [40, 10]\n")
    assert spaces.rows == file.rows


def test_files_of_libraries(scene, tmp_path):
    values = np.array(ROWS)
    path = tmp_path / "numpy.csv"
    for options in (
        {"header": "clearance oil.viscosity"},
        {"header": "clearance,oil.viscosity", "delimiter": ","},
        {"header": "clearance;oil.viscosity", "delimiter": ";", "comments": ""},
    ):
        np.savetxt(path, values, **options)
        assert list(read(scene, tmp_path, path.read_bytes()).rows) == ROWS
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(values, columns=["clearance", "oil.viscosity"])
    for options in ({}, {"index": False}, {"sep": ";", "decimal": ","}, {"sep": "\t"}):
        frame.to_csv(path, **options)
        assert list(read(scene, tmp_path, path.read_bytes()).rows) == ROWS


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("", "a line of keys, and a line for each case"),
        ("clearance\n", "a line of keys, and a line for each case"),
        ("clearance\n[um]\n", "a line of keys, and a line for each case"),
        ("1e-5,0.01\n", "line 1, '1e-5,0.01', has no keys"),
        (b"\x89PNG\r\n\x1a\n\0\0", "this is not a text"),
        (b"PK\x03\x04...", "a workbook of Excel or LibreOffice: save its sheet as CSV"),
        (
            "clearence\n1e-5\n",
            "line 1: unknown key clearence: did you mean joints.big_end.clearance",
        ),
        ("frobnicate\n1e-5\n", "and 141 more: 'fenics-ehd init' prints"),
        ("clearance,big_end.clearance\n1e-5,1e-5\n", "is given twice: drop one of the columns"),
        ("clearance,oil.viscosity\n1e-5\n", "line 2 has 1 values, but line 1 has 2 keys"),
        (
            "clearance,oil.viscosity\n1,5e-5,0,01\n",
            "line 2 has 4 values, but line 1 has 2 keys: sep",
        ),
        ("clearance,oil.viscosity\n1e-5,\n", "line 2: column oil.viscosity is empty: give a value"),
        ("clearance,\n1e-5,7\n", "line 2 has 2 values, but line 1 has 1 keys"),
        (",clearance\n1000,1e-5\n3000,2e-5\n", "column 1 has no heading, but line 2 has '1000'"),
        ("clearance;tolerance\n1,000;2.5e-5\n", "1,000 may mean 1.000 or 1000: write one of"),
        (",clearance\nx,1e-5\n", "column 1 has no heading, but line 2 has 'x' there"),
        ("case,clearance\n3,1e-5\n", "column case: line 2 has '3', but cases are numbered from 1"),
        ("clearance\n1e-5\n12um\n", "line 2 has 1e-5 without a unit, but line 3 has 12um"),
        ("clearance [um]\n12um\n", "line 2: column clearance [um]: '12um' must be a number in the"),
        ("clearance [s]\n12\n", "line 1: column clearance [s]: joints.big_end.clearance must be"),
        ("clearance [furlong]\n12\n", "'furlong' is not a known unit"),
        ("reduction.method [um]\nm3\n", "values of bodies.rod.reduction.method are not numbers"),
        ("clearance [um\n12\n", "must be a key, or a key with a unit in brackets"),
        ("big_end.cells\n20\n", "line 2: joints.big_end.cells = '20' must be a list"),
        ('clearance,oil.viscosity\n1,1\n"1e-5,3\n', "line 3: a quotation mark is not closed"),
        ("tolerance\tlargest_step\n1,500\t2\n", "1,500 may mean 1.500 or 1500: write one of these"),
        ("tolerance;largest_step\n1.500;0,2\n", "1.500 may mean 1.500 or 1500"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(content, named, scene, tmp_path):
    with pytest.raises(ehd.errors.SettingsError) as error:
        read(scene, tmp_path, content)
    message = str(error.value)
    assert message.startswith("--cases cases.csv: ")
    assert named in message
    assert "\n" not in message


def test_errors_of_a_spreadsheet_are_no_comments(scene, tmp_path):
    file = read(scene, tmp_path, "clearance\n# a comment\n1e-5\n#N/A\n#REF!\n#NV\n#NVH\n")
    assert [row[0] for row in file.rows] == [1e-5, "#N/A", "#REF!", "#NV"]


def test_a_comma_is_decimal_if_another_number_shows_it(scene, tmp_path):
    file = read(scene, tmp_path, "tolerance\tlargest_step\n1,500\t0,25\n")
    assert file.rows == ((1.5, 0.25),)
