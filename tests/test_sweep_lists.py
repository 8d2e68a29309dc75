"""Sweeps along lists together, from tables, in parts, and from Python."""

import json

import numpy as np
import pytest
from command_line import exit_of
from sweep_cases import Inline, results, rows_of, sweep_inline, write_scene

import fenics_ehd as ehd
from fenics_ehd.base.progress import Progress
from fenics_ehd.study.cases import changed_text
from fenics_ehd.study.merged_sweep import merge_sweeps
from fenics_ehd.study.sweep import Part, SweepFolder, make_sweep

CLEARANCE = "joints.big_end.clearance"
VISCOSITY = "lubricants.oil.viscosity"
TABLE = "clearance [um],oil.viscosity\n14,0.01\n\n15,0.011\n16,0.012\n"
#: The cases of this table as lists.
LISTS = ["clearance=14um,15um,16um", "oil.viscosity=0.01,0.011,0.012"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "cases.csv"
    path.write_text(TABLE)
    return str(path)


@pytest.fixture(scope="module")
def complete(scene, table, tmp_path_factory):
    """Folder of the sweep without parts."""
    directory = tmp_path_factory.mktemp("complete")
    sweep_inline(make_sweep(scene, table=table), directory, keep=True)
    return directory


def values_of(sweep):
    return [case.values for case in sweep.cases]


def test_lists_together_are_the_lines_of_a_table(scene, table):
    values = [(14e-6, 0.01), (15e-6, 0.011), (16e-6, 0.012)]
    listed = make_sweep(scene, LISTS, zipped=True)
    tabled = make_sweep(scene, table=table)
    assert values_of(listed) == values_of(tabled) == values
    assert listed.keys == tabled.keys == (CLEARANCE, VISCOSITY)
    assert [case.identity for case in listed.cases] == [case.identity for case in tabled.cases]


def test_repeated_values_in_lists_together_are_different_cases(scene):
    sweep = make_sweep(scene, ["clearance=14e-6,14e-6", "oil.viscosity=0.01,0.02"], zipped=True)
    assert values_of(sweep) == [(14e-6, 0.01), (14e-6, 0.02)]


def test_lines_of_a_table_are_combined_with_lists(scene, table):
    sweep = make_sweep(scene, ["time.tolerance=1e-3,1e-4"], table=table)
    assert len(sweep.cases) == 6
    assert values_of(sweep)[:3] == [(14e-6, 0.01, 1e-3), (14e-6, 0.01, 1e-4), (15e-6, 0.011, 1e-3)]


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--set", "clearance=1e-5,2e-5", "--zip"], "--zip has no effect without a second list"),
        (
            ["--set", "clearance=1e-5,2e-5", "--set", "oil.viscosity=0.01", "--zip"],
            "lubricants.oil.viscosity has 1 values, but joints.big_end.clearance has 2",
        ),
        (["--set", "clearance=1e-5", "--part", "3"], "--part 3 must be K/N"),
        (
            ["--set", "clearance=1e-5", "--part", "0/3"],
            "--part 0/3: the number of the part, 0, must be from 1 to 3",
        ),
        (["--set", "clearance=1e-5", "--part", "4/3"], "the number of the part, 4, must be"),
        (["--set", "clearance=1e-5", "--part", "1/0"], "the number of parts, 0, must be from 1 to"),
        (["--set", "clearance=1e-5", "--part", "2/2"], "the sweep has 1 cases"),
        (["--cases", "no.csv"], "--cases no.csv: No such file"),
        (["--cases", "."], "--cases .: this is a folder: give a CSV file"),
        ([], "give --set KEY=VALUES"),
        (["--set", "clearance=1e-5", "--merge"], "--set has no effect with --merge"),
        (["--merge"], "--merge needs -o"),
        (["--set", "clearance=1e-5", "--scheduler", "node01"], "give the address of a scheduler"),
        (["--set", "clearance=1e-5", "--scheduler", "local:0"], "from 1 to 1024"),
        (
            ["--set", "clearance=1e-5", "--scheduler", "local:2", "--workers", "2"],
            "--scheduler and --workers exclude each other",
        ),
    ],
)
def test_bad_options_are_refused_in_one_line(options, named, scene, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, output, errors = exit_of(capfd, "sweep", scene, *options)
    assert status == 2
    assert not output
    assert named in errors
    assert len(errors.strip().splitlines()) == 1


def test_missing_and_surplus_words_are_named(capfd):
    for arguments, named in (
        (("sweep", "--merge"), "--merge needs the folders of the parts"),
        (("sweep",), "sweep runs one SCENE, but there are 0"),
        (("sweep", "a", "b"), "sweep runs one SCENE, but there are 2 (a, b)"),
    ):
        status, _, errors = exit_of(capfd, *arguments)
        assert status == 2
        assert named in errors
        assert len(errors.strip().splitlines()) == 1


def test_values_that_cannot_run_have_the_line_of_the_file(scene, tmp_path):
    path = tmp_path / "cases.csv"
    path.write_text("clearance [um];oil.viscosity\n14;0,01\n\n-15;0,011\n16;-1\n16;-1\n")
    with pytest.raises(ehd.errors.SettingsError) as error:
        make_sweep(scene, table=str(path))
    message = str(error.value)
    assert message.startswith(
        f"3 of 4 cases cannot run: --cases {path}: line 4: {CLEARANCE} = -1.5e-05"
    )
    assert f"; --cases {path}: line 5: {VISCOSITY} = -1.0 must be" in message
    assert message.count(VISCOSITY) == 1


def test_only_the_difference_of_another_sweep_is_named(scene, tmp_path):
    lists = [f"clearance={start}e-6:30e-6:{count}" for start, count in ((10, 9), (11, 9), (10, 8))]
    with SweepFolder(tmp_path, make_sweep(scene, lists[:1])) as folder:
        folder.write("sweep.json", folder.sweep.about)
    for values, named in (
        (lists[1], f"(value 1 of {CLEARANCE} is 1e-05 in the folder, but 1.1e-05 here)"),
        (lists[2], f"({CLEARANCE} has 9 values in the folder, but 8 here)"),
    ):
        with pytest.raises(ehd.errors.InputError) as error:
            SweepFolder(tmp_path, make_sweep(scene, [values]))
        assert named in str(error.value)


def test_values_with_one_text_have_a_message_about_their_difference():
    values = ["a" * 70]
    text = changed_text("key", values, str(values), "there", "here")
    assert text.startswith("key is ['aaa")


def test_a_key_without_effect_is_named_once(scene):
    with pytest.raises(ehd.errors.SettingsError) as error:
        make_sweep(scene, ["residual_modes=5:24:20", "clearance=14e-6,15e-6"])
    message = str(error.value)
    assert message.startswith("40 of 40 cases cannot run: ")
    assert message.count("residual_modes = ") == 1
    values = {"residual_modes": range(5, 9), "clearance": np.linspace(14e-6, 15e-6, 4)}
    with pytest.raises(ehd.errors.SettingsError) as error:
        ehd.sweep(scene, values, zipped=True)
    assert str(error.value).startswith("4 of 4 cases cannot run: ")
    assert str(error.value).count("residual_modes = ") == 1


def test_many_bad_values_are_one_line(scene):
    with pytest.raises(ehd.errors.SettingsError, match=r"; and 15 more$"):
        make_sweep(scene, ["clearance=-20:-1:20"])


def test_parts_and_the_complete_sweep_agree_row_by_row(scene, table, complete, tmp_path, capfd):
    for number in (1, 2):
        part = make_sweep(scene, table=table, part=Part(number, 2))
        sweep_inline(part, tmp_path / str(number), keep=True)
    with pytest.raises(ehd.errors.InputError, match="part is 1/2 in the folder, but 2/2 here"):
        SweepFolder(tmp_path / "1", part)
    one, two = tmp_path / "1", tmp_path / "2"
    # A complete part tells how the parts become one sweep.
    command = ("sweep", scene, "--cases", table, "--part", "2/2", "-o", two)
    status, printed, _ = exit_of(capfd, *command)
    assert status == 0
    assert f"fenics-ehd sweep --merge {two} ... -o DIR" in printed.splitlines()[-1]
    first = merge_sweeps([one], tmp_path / "merged")
    assert first.missing == [2]
    merged = merge_sweeps([two, one], tmp_path / "merged")
    assert not merged.missing
    rows = rows_of(tmp_path / "merged")
    assert [row["case"] for row in rows] == ["1", "2", "3"]
    assert results(rows) == results(rows_of(complete))
    assert merged.rows[2][CLEARANCE] == 16e-6
    for name in ("0001", "0002", "0003"):
        history = (complete / "runs" / name / "history.csv").read_bytes()
        assert (tmp_path / "merged" / "runs" / name / "history.csv").read_bytes() == history
    # A later merge of some parts keeps the rows of the others.
    assert not merge_sweeps([two], tmp_path / "merged").missing
    assert rows_of(tmp_path / "merged") == rows
    merged_table = tmp_path / "merged" / "sweep.csv"
    written = merged_table.read_text()
    merged_table.write_text(written.replace("wall_time_s", "seconds", 1))
    with pytest.raises(ehd.errors.InputError, match="merged has other columns than that of"):
        merge_sweeps([two], tmp_path / "merged")
    merged_table.write_text(written)
    # The merged folder is that of the sweep without parts, with nothing to run.
    pool, _ = sweep_inline(make_sweep(scene, table=table), tmp_path / "merged")
    assert pool.cases == []


def test_folders_that_cannot_be_merged_are_named(scene, complete, tmp_path, capfd):
    other = tmp_path / "other"
    sweep_inline(make_sweep(scene, ["clearance=14e-6"]), other)
    capfd.readouterr()
    arguments = (
        ([complete, tmp_path], f"{tmp_path} is not the folder of a sweep"),
        ([complete, other], "has another sweep than"),
        ([other, other], f"{other} is given twice: name each part once"),
        ([tmp_path / "none"], "is not the folder of a sweep"),
    )
    for folders, named in arguments:
        status, _, errors = exit_of(capfd, "sweep", "--merge", *folders, "-o", tmp_path / "out")
        assert status == 2
        assert named in errors
        assert len(errors.strip().splitlines()) == 1
    status, _, errors = exit_of(capfd, "sweep", "--merge", complete, "-o", complete)
    assert status == 2
    assert "is one of the parts" in errors


def test_a_sweep_in_python_is_a_table(scene, complete, tmp_path):
    values = {"clearance": np.array([14e-6, 15e-6, 16e-6]), "oil.viscosity": "0.01:0.012:3"}
    texts: list[str] = []
    progress = Progress(texts.append, interval=0.0)
    table = ehd.sweep(
        scene, values, zipped=True, executor=Inline(), folder=tmp_path / "out", progress=progress
    )
    assert texts[0] == "sweep: 0 %, 0 of 3 cases"
    assert texts[-1].startswith("sweep: 100 %, ")
    expected = rows_of(complete)
    assert len(table) == 3
    assert table.complete.all()
    np.testing.assert_array_equal(table["clearance"], values["clearance"])
    for name in ("big_end.max_pressure_Pa", "min_film_thickness_m", "steps"):
        column = next(key for key in expected[0] if key == name or key.endswith(f".{name}"))
        texts = [json.dumps(number) for number in table[name].tolist()]
        assert texts == [row[column] for row in expected]
    table.write(tmp_path / "table.csv")
    written = (tmp_path / "table.csv").read_bytes()
    assert written == (tmp_path / "out" / "sweep.csv").read_bytes()
    with pytest.raises(KeyError, match=r"clearence.*did you mean joints\.big_end\.clearance"):
        _ = table["clearence"]
    assert "3 cases, 3 complete" in repr(table)


def test_bad_arguments_in_python(scene):
    with pytest.raises(ehd.errors.SettingsError, match="workers = 2 has no effect"):
        ehd.sweep(scene, {"clearance": [1e-5]}, executor=Inline(), workers=2)
    with pytest.raises(ehd.errors.SettingsError, match="needs a folder"):
        ehd.sweep(scene, {"clearance": [1e-5]}, keep=True)
    with pytest.raises(ehd.errors.SettingsError, match="must be a list of values"):
        ehd.sweep(scene, {"clearance": 1e-5})
    joint = ehd.read_scene(scene).joints["big_end"]
    with pytest.raises(ehd.errors.SettingsError, match="must be a value of a scene file"):
        ehd.sweep(scene, {"clearance": [joint]})
    with pytest.raises(ehd.errors.SettingsError, match="at least one key"):
        ehd.sweep(scene, {})
    with pytest.raises(
        ehd.errors.SettingsError, match="zipped = true has no effect without a second"
    ):
        ehd.sweep(scene, {"clearance": [1e-5]}, zipped=True)
    with pytest.raises(
        ehd.errors.SettingsError, match="zipped = true has no effect with a file of cases"
    ):
        ehd.sweep(scene, "cases.csv", zipped=True)
    with pytest.raises(ehd.errors.SettingsError, match=r"values = 'no\.csv': No such file"):
        ehd.sweep(scene, "no.csv")
