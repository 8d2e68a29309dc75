"""The report of a study: self-contained, reproducible, nothing below the reference's own error."""

import csv
import html.parser
import itertools
import json
import re
import tomllib
from dataclasses import replace
from importlib import resources
from pathlib import Path, PurePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_cases import (
    m1,
    m2,
    m3,
    m4,
    run,
    without_end,
    write_bodies,
    write_history,
    write_study,
)

from fenics_ehd.cli import main
from fenics_ehd.errors import InputError
from fenics_ehd.report import accuracy, cost, style, tables, write_report
from fenics_ehd.report.extremes import find_extremes, read_extremes
from fenics_ehd.report.hull import lower_left
from fenics_ehd.report.paper_machine import machine_remark, other_settings
from fenics_ehd.report.pictures import Pictures
from fenics_ehd.report.reading import read_study
from fenics_ehd.report.statement import percent
from fenics_ehd.report.study_data import QUANTITIES

UNIT = {"pressure_set": "pc1", "selection": "largest-eigenvalue"}
STEPS = [(1e-3, 0.04), (1e-4, 0.04 / 10 ** (2 / 3)), (1e-5, 0.04 / 100 ** (2 / 3))]

RUNS = [
    m1(37, online_s=6.0),
    m1(67, online_s=7.0),
    m2(37, online_s=6.5),
    m3(16, 0.1, 0.15, online_s=5.0),
    m3(31, online_s=8.0),
    m3(31, 0.5, 0.3, selection="smallest-eigenvalue", online_s=9.0),
    m3(61, **UNIT, online_s=9.0),
    # Below what the reference itself may be wrong by.
    m4(1e-5, 1e-5, online_s=4.0),
    run("m3-failed", status="failed: StepSizeError: a step below 1e-13 s | given up",
        pressure_set="pc2", selection="largest-eigenvalue"),
    replace(without_end(m4()), run="m4-20"),
    *[m4(error, error, group="tolerance", tolerance=tolerance, own_pressure_error_max=error,
         own_film_error_max=error) for tolerance, error in STEPS],
    *[m3(31, error, error, group="film", film_cells=cells)
      for cells, error in (("10x3", 0.1), ("20x5", 0.02), ("30x7", 0.005))],
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A whole study with its report."""
    directory = tmp_path_factory.mktemp("study")
    planned = len({row.run for row in RUNS})
    study = write_study(directory, RUNS, runs=planned, machine={"cpu": "some <processor>"},
                        settings={"film": {"cells": [20, 5]}}, quick=True)  # fmt: skip
    for name, above in (("reference", 0.0), ("m1-37", 0.2), ("m2-37", 0.1), ("m4", 0.001),
                        ("m3-pc2-lowest-frequency-31", 0.01)):  # fmt: skip
        write_history(study, name, above=above, thicker=above / 2)
    write_bodies(directory)
    write_report(directory)
    return directory


class Page(html.parser.HTMLParser):
    """Ids, links and tags of a page."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.tags = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name in ("href", "src", "xlink:href"):
                self.links.append(value)


def test_the_page_needs_no_other_file(folder):
    page = Page((folder / "report.html").read_text())
    assert not {"script", "link", "img", "iframe"} & set(page.tags)
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert len(page.ids) == len(set(page.ids))
    # Whatever a link within the page points at is there, in figures as well.
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)
    used = re.findall(r"url\(#([^)]*)\)", (folder / "report.html").read_text())
    assert set(used) <= set(page.ids)


def test_every_figure_is_there_in_both_formats_and_on_both_pages(folder):
    names = {path.stem for path in (folder / "figures").glob("*.svg")}
    assert names == {path.stem for path in (folder / "figures").glob("*.png")}
    assert names == {
        "error_against_time", "mean_error_against_time", "error_against_reduction_time",
        "error_against_modes", "figure_5",
        "figure_6", "figure_7", "figure_8", "selections", "errors_over_time",
        "error_against_tolerance", "error_against_film_mesh", "estimate_against_truth",
        "mode_shapes", "pressure",
    }  # fmt: skip
    markdown = (folder / "report.md").read_text()
    assert {f"figures/{name}.png" for name in names} == set(re.findall(r"\]\((.*?)\)", markdown))
    assert Page((folder / "report.html").read_text()).tags.count("figure") == len(names)


def test_pages_tell_the_same(folder):
    page = (folder / "report.html").read_text()
    markdown = (folder / "report.md").read_text()
    for words in ("What accuracy costs", "given up", "does not hold", "full-6: not run",
                  "Stiff and extreme runs", "some"):  # fmt: skip
        assert words in page
        assert words in markdown
    assert "some &lt;processor&gt;" in page
    rows = [line for line in markdown.splitlines() if line.startswith("|")]
    # As many cells as the table has columns, whatever a status says.
    failed = next(line for line in rows if "given up" in line)
    heads = next(line for line in rows if line.startswith("| run |"))
    assert len(re.findall(r"(?<!\\)\|", failed)) == heads.count("|")


def test_statements_are_a_table_of_their_own(folder):
    with open(folder / "statements.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    verdicts = {row["what it says"]: row["verdict"] for row in rows}
    assert verdicts["M2 needs fewer modes than M1"] == "holds"
    literal = "the residual modes to keep are those of the smallest eigenvalues"
    assert verdicts[literal] == "does not hold"
    assert set(verdicts.values()) >= {"holds", "does not hold", "not run"}


def test_nothing_is_drawn_below_the_reference_s_own_error(folder, tmp_path, monkeypatch):
    lowest, signs = {}, {}

    def look(figure, _folder, name):
        signs[name] = [{line.get_marker() for line in axes.lines} for axes in figure.axes]
        for axes in figure.axes:
            if axes.get_yscale() == "log":
                drawn = [line.get_ydata() for line in axes.lines if line.get_label() != "slope 2/3"]
                values = np.concatenate([np.asarray(y, dtype=float) for y in drawn if len(y)])
                lowest.setdefault(name, []).append(values.min())
        style.plt.close(figure)

    study = read_study(folder)
    for module in (cost, accuracy):
        monkeypatch.setattr(module, "save", look)
    cost.draw_cost(study, cost.ONLINE, tmp_path, "time")
    accuracy.draw_tolerances(study, tmp_path, "tolerance")
    accuracy.draw_film_meshes(study, tmp_path, "mesh")
    floors = [min(r.floor(quantity) for r in study.group("methods")) for quantity in QUANTITIES]
    # M4 lies below and is drawn at the floor itself, by a sign that says so.
    np.testing.assert_allclose(lowest["time"], floors)
    assert [style.BOUND in drawn for drawn in signs["time"]] == [True, True]
    assert not any(style.BOUND in drawn for drawn in signs["mesh"])
    assert np.all(np.array(lowest["tolerance"]) >= floors)
    assert np.all(np.array(lowest["mesh"]) >= floors)


def test_slope_of_the_error_over_the_tolerance_is_found(folder):
    study = read_study(folder)
    (series,) = accuracy.tolerance_series(study, QUANTITIES[0]).values()
    assert accuracy.slope(series[1], 1e-3) == pytest.approx(2 / 3, abs=0.01)
    assert np.isnan(accuracy.slope(series[1][:1], 1e-3))


def test_the_rotor_has_the_paper_s_figures_10_and_11(tmp_path):
    runs = [m1(28), m2(28), m1(48), m2(48), m3(20, coordinates=30, **UNIT),
            m3(40, coordinates=50, **UNIT)]  # fmt: skip
    study = write_study(tmp_path, runs, scene="rotor")
    for row in runs:
        write_history(study, row.run, above=row.pressure_error_max)
    pictures = Pictures(study, tmp_path / "figures")
    assert pictures.curves() == []
    write_history(study, "reference")
    found = {picture.name: picture.caption for picture in pictures.curves()}
    assert set(found) == {"curves", "figure_10", "figure_11"}
    assert "50 coordinates" in found["figure_11"]
    assert all((tmp_path / "figures" / f"{name}.svg").is_file() for name in found)


def test_the_same_study_gives_the_same_files(tmp_path):
    meshes = [m3(31, group="film", film_cells=cells) for cells in ("10x3", "20x5")]
    write_study(tmp_path, meshes)
    texts = []
    for _ in range(2):
        write_report(tmp_path)
        texts.append({path.name: path.read_bytes() for path in sorted(tmp_path.rglob("*.*"))
                      if path.is_file()})  # fmt: skip
    assert texts[0] == texts[1]
    assert "error_against_film_mesh.svg" in texts[0]


def test_a_study_that_has_hardly_begun_is_reported(tmp_path, capfd):
    (tmp_path / "study.json").write_text(json.dumps({"scene": "rotor", "runs": 12}))
    with pytest.raises(SystemExit) as end:
        main(["report", str(tmp_path)])
    assert not end.value.code
    assert capfd.readouterr().out.strip() == str(tmp_path / "report.html")
    assert "12 of 12 are still to come" in (tmp_path / "report.md").read_text()


def test_the_last_row_of_a_killed_writer_does_no_harm(tmp_path):
    write_study(tmp_path, [m1(37), m3(31)])
    table = tmp_path / "table.csv"
    table.write_text(table.read_text()[:-40])
    assert [row.run for row in read_study(tmp_path).runs] == ["m1-37"]


@pytest.mark.parametrize(
    ("content", "words"), [({}, "study.json is missing"), ({"study.json": "{"}, "cannot be read"),
                           ({"study.json": "{}", "table.csv": "a,b\n1,2\n"}, "no column"),
                           ({"study.json": '{"scene": "swing"}'}, "scene = swing"),
                           ({"study.json": '{"scene": ["rotor"]}'}, "scene = ['rotor']"),
                           ({"study.json": '{"runs": null}'}, "runs = None is no whole number"),
                           ({"study.json": '{"errors_count_from_s": "x"}'}, "'x' is no number"),
                           ({"study.json": '{"settings": 3}'}, "settings = 3"),
                           ({"study.json": "{}", "reference.json": '{"step": {"film_max": "x"}}'},
                            "step.film_max = 'x' is no number"),
                           ({"study.json": "{}", "table.csv": b"run,\xff\n"}, "cannot be read")]
)  # fmt: skip
def test_what_is_no_study_is_refused_in_one_line(content, words, tmp_path, capfd):
    for name, text in content.items():
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SystemExit) as end:
        main(["report", str(tmp_path)])
    complaint = capfd.readouterr().err.strip()
    assert end.value.code == 2
    assert words in complaint
    assert "\n" not in complaint


def test_a_cell_that_is_no_number_is_named(tmp_path):
    write_study(tmp_path, [m1(37)])
    table = tmp_path / "table.csv"
    table.write_text(table.read_text().replace(",500", ",many"))
    with pytest.raises(InputError, match="steps = 'many' of run m1-37"):
        read_study(tmp_path)


def test_runs_to_come_are_counted_and_told(folder):
    text = (folder / "report.md").read_text()
    assert "1 of 10 are still to come" in " ".join(text.split())
    assert re.search(r"\| m4-20 \|.*\| not run \|", text)


def test_a_machine_that_is_not_the_paper_s_is_told(tmp_path):
    settings = {"mechanism": {"crank_speed": 100.0, "crank_length": 0.048},
                "rod": {"geometry": {"big_end_wall": 0.013}}, "film": {"cells": [9, 3]},
                "time": {"tolerance": 1e-3}, "reduction": {"method": "m1"}}  # fmt: skip
    study = write_study(tmp_path, [], settings=settings)
    assert other_settings(study) == {
        "mechanism.crank_speed": 100.0,
        "rod.geometry.big_end_wall": 0.013,
    }
    write_report(tmp_path)
    remark = "Not the paper's machine, which the statements are about: mechanism.crank_speed = 100,"
    assert remark in " ".join((tmp_path / "report.md").read_text().split())
    assert machine_remark(write_study(tmp_path, [])) == ""


def test_a_floor_that_is_known_in_part_is_used_and_told(tmp_path):
    nan = float("nan")
    study = write_study(tmp_path, [m4(1e-5, 1e-5, pressure_floor=nan, film_floor=nan)])
    assert [study.runs[0].visible_error(q) for q in QUANTITIES] == [1e-3, 2e-3]
    assert "by its basis is not known" in tables.floor_remark(study)


def test_the_true_gap_of_the_reference_bounds_what_a_run_can_be_seen_to_have(tmp_path):
    errors = {"": float("nan"), "-step": 1e-9, "-basis": 3e-9, "-film": 5e-8}
    rows = [m3(31), run("other", group="reference", film_cells="30x7", true_gap_error_m=6e-8)]
    rows += [
        run(f"reference{kind}", group="reference", true_gap_error_m=error)
        for kind, error in errors.items()
    ]
    study = write_study(tmp_path, rows)
    study = replace(study, reference={**study.reference, "film": {"run": "reference-film"}})
    assert accuracy.gap_floor(study) == 3e-9
    assert accuracy.gap_floor(replace(study, runs=(m3(31),))) == pytest.approx(2e-3 * 2.5e-6)


POINT = st.tuples(st.integers(0, 20), st.integers(0, 20), st.integers())


@given(st.lists(POINT, min_size=1))
def test_hull_is_what_no_point_beats(points):
    hull = lower_left(points)
    assert set(hull) <= set(points)
    assert all(a[0] < b[0] and a[1] > b[1] for a, b in itertools.pairwise(hull))
    for x, y, _ in points:
        assert any(a <= x and b <= y for a, b, _ in hull)


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.4567, "46 %"), (0.0123, "1.2 %"), (3.4e-4, "0.034 %"), (0.0996, "10 %"), (2.0, "200 %")],
)
def test_percent_has_two_digits_that_mean_something(value, words):
    assert percent(value) == words


def test_every_method_has_one_colour_that_stays_apart_in_grey():
    colours = [style.matplotlib.colors.to_rgb(colour) for colour in style.COLOURS.values()]
    luminances = sorted(np.array(colours) @ [0.2126, 0.7152, 0.0722])
    assert np.diff(luminances).min() > 0.1
    assert style.line_style(m3(31))["color"] == style.line_style(m3(61, **UNIT))["color"]


def test_a_table_of_extremes_in_the_folder_goes_first(tmp_path):
    study = write_study(tmp_path, [])
    shipped = find_extremes(study)
    assert shipped.source.startswith("docs/extremes.md")
    assert len(shipped.table.rows) > 50
    (tmp_path / "extremes.md").write_text("| a | b |\n| --- | --- |\n| 1 | 2 |\n")
    assert find_extremes(study).table.rows == (("1", "2"),)


def test_what_the_pages_need_is_packaged():
    root = Path(__file__).parents[1]
    setuptools = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert "fenics_ehd.report" in setuptools["packages"]
    templates = resources.files("fenics_ehd.report") / "templates"
    for name in ("report.html", "report.md"):
        assert (templates / name).is_file()
        patterns = setuptools["package-data"]["fenics_ehd.report"]
        assert any(PurePath("templates", name).match(pattern) for pattern in patterns)
    (page,) = setuptools["data-files"]["share/fenics-ehd"]
    assert (root / page).is_file()


def test_the_table_of_extremes_is_read_from_its_page():
    page = "# Runs\n\n| case | verdict |\n| --- | --- |\n| `a` \\| b | PASS |\n\n1 row.\n"
    found = read_extremes(page, "here")
    assert found.table.rows == (("a | b", "PASS"),)
    assert found.summary == "1 row."


def test_properties_of_each_call_have_a_row_of_their_own():
    calls = [{"workers": 2, "runs": 14}, {"workers": 1, "runs": 3}]
    found = tables.properties_table("machine", {"cpu": "fast", "calls": calls})
    assert found.rows == (
        ("cpu", "fast"),
        ("calls 1.workers", "2"),
        ("calls 1.runs", "14"),
        ("calls 2.workers", "1"),
        ("calls 2.runs", "3"),
    )
