"""The report of a study: self-contained, reproducible, nothing below the reference's own error."""

import html.parser
import itertools
import json
import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest
from command_line import exit_of
from foreign_parts import ring
from hypothesis import given
from hypothesis import strategies as st
from report_cases import (
    changed,
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

import fenics_ehd as ehd
from fenics_ehd.study.compare import COLUMNS
from fenics_ehd.study.report import figures
from fenics_ehd.study.report.figures import best_bodies, first_shapes
from fenics_ehd.study.report.page import render
from fenics_ehd.study.report.study_data import CURVES, FILM, PRESSURE, read_study
from fenics_ehd.study.report.write import TABLES, unknown_floors, write_report

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
    changed(without_end(m4()), run="m4-20"),
    *[m4(error, error, group="tolerance", tolerance=tolerance, own_pressure_error_max=error,
         own_film_error_max=error) for tolerance, error in STEPS],
    *[m3(31, error, error, group="film", film_cells=cells)
      for cells, error in (("10x3", 0.1), ("20x5", 0.02), ("30x7", 0.005))],
]  # fmt: skip


#: Runs with a history.
ABOVE = {"reference": 0.0, "m1-37": 0.2, "m2-37": 0.1, "m4": 0.001,
         "m3-pc2-lowest-frequency-31": 0.01}  # fmt: skip


def whole_study(directory, joints, **about):
    study = write_study(directory, RUNS, joints, **about)
    for name, above in ABOVE.items():
        write_history(study, name, above=above, thicker=above / 2, periodic=len(joints) > 1)
    write_bodies(study, "m1-37", "m2-37", "m3-pc2-lowest-frequency-31", "m4")
    return directory


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study with its report, but without histories and bodies."""
    directory = tmp_path_factory.mktemp("study")
    about = {"machine": {"cpu": "some <processor>"}, "settings": {"film": {"cells": [20, 5]}}}
    write_study(directory, RUNS, **about, quick=True)
    write_report(directory)
    return directory


@pytest.fixture(scope="module")
def both_ends(tmp_path_factory):
    """A whole periodic study of a scene with two lubricated joints."""
    joints = ("big_end", "small_end")
    return whole_study(tmp_path_factory.mktemp("both"), joints, start=0.0)


def words(study):
    """A report without its figures."""
    return " ".join(render("report.jinja", "md", {}, study=study, **TABLES).split())


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
    assert not {"script", "link", "iframe"} & set(page.tags)
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert len(page.ids) == len(set(page.ids))
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)
    figures = [link.partition("base64,")[2] for link in page.links if link.startswith("data:")]
    files = {path.read_bytes() for path in (folder / "figures").glob("*.svg")}
    assert {b64decode(figure) for figure in figures} == files


#: Figures that the table alone gives, and those of histories and bodies.
FIGURES = {
    "error_against_time", "error_against_modes", "error_against_tolerance",
    "error_against_film_mesh", "estimate_against_truth",
}  # fmt: skip
MORE_FIGURES = {"curves", "errors_over_time", "mode_shapes_rod", "pressure_big_end"}


def test_every_figure_is_there_in_both_formats_and_on_both_pages(folder):
    assert figures_on_the_pages(folder) == FIGURES


@pytest.mark.slow
@pytest.mark.parametrize("joints", [("big_end",), ("big_end", "small_end")])
def test_histories_and_bodies_have_figures_for_every_joint(joints, tmp_path):
    write_report(whole_study(tmp_path, joints))
    pressures = {f"pressure_{joint}" for joint in joints}
    assert figures_on_the_pages(tmp_path) == FIGURES | MORE_FIGURES | pressures


def figures_on_the_pages(folder):
    names = {path.stem for path in (folder / "figures").glob("*.svg")}
    assert names == {path.stem for path in (folder / "figures").glob("*.png")}
    markdown = (folder / "report.md").read_text()
    assert {f"figures/{name}.png" for name in names} == set(re.findall(r"\]\((.*?)\)", markdown))
    assert Page((folder / "report.html").read_text()).tags.count("figure") == len(names)
    return names


def test_pages_tell_the_same(folder):
    page = (folder / "report.html").read_text()
    markdown = (folder / "report.md").read_text()
    for words in ("Error and computing time", "given up", "full-6: not run", "some", "cells"):
        assert words in page
        assert words in markdown
    assert "some &lt;processor&gt;" in page
    rows = [line for line in markdown.splitlines() if line.startswith("|")]
    # As many cells as the table has columns, for any status.
    failed = next(line for line in rows if "given up" in line)
    heads = next(line for line in rows if line.startswith("| run |"))
    assert len(re.findall(r"(?<!\\)\|", failed)) == heads.count("|")


def test_names_and_messages_are_no_html(tmp_path):
    bad = "<script>alert(1)</script> [here](javascript:x) | ```"
    rows = [run("reference", method="full"), run(f"m3 {bad}", status=f"failed: {bad}")]
    study = write_study(tmp_path, rows, scene=bad, cpu=f"{bad}\n```\n<b>")
    for form in ("md", "html"):
        text = render("report.jinja", form, {}, study=study, **TABLES)
        prose = re.sub(r"(?ms)^```json$.*?^```$", "", text)
        assert "<script" not in prose.replace("<style", "")
        assert "<b>" not in prose
        assert form == "html" or "](javascript" not in prose
    assert prose.count("&lt;script&gt;") >= 4


def test_every_joint_has_its_own_table_panels_and_rows(both_ends):
    study = read_study(both_ends)
    markdown = words(study)
    for joint in ("big_end", "small_end"):
        assert f"{joint}. Fastest run of each method" in markdown
        assert f"| m1-37 | {joint} |" in markdown
    figure = figures.draw_methods(study, figures.alike(study))
    titles = [axes.get_title("left") for axes in figure.axes]
    assert titles == ["big_end", "", "small_end", ""]
    tops = [axes.lines[0].get_ydata().max() for axes in figure.axes]
    figures.plt.close(figure)
    # The second one has twice the pressure and the same film.
    assert tops[2] == pytest.approx(2 * tops[0])
    assert tops[3] == pytest.approx(tops[1])


def test_runs_that_are_drawn_over_time_are_about_as_large(folder):
    chosen = {row["method"]: row for row in figures.alike(read_study(folder))}
    # The middle number of coordinates, and of those with as many the most accurate one.
    assert {name: row["coordinates"] for name, row in chosen.items()} == {
        "m1": 39, "m2": 39, "m3": 39, "m4": 9,
    }  # fmt: skip
    assert chosen["m3"]["selection"] == "lowest-frequency"


def test_the_worst_joint_counts(tmp_path):
    good = [m1(37, 0.1, 0.1, joint=name) for name in "ab"]
    bad = [m1(67, 0.05, 0.05, joint="a"), m1(67, 0.3, 0.1, joint="b")]
    study = write_study(tmp_path, [*good, *bad], ("a", "b"))
    errors = [[row.error(PRESSURE) for row in joint.measured("methods")] for joint in study.joints]
    assert errors == [[0.1, 0.05], [0.1, 0.3]]
    assert study.worst_error("m1-67") == 0.3
    assert [row["run"] for row in figures.best(study, "m1")] == ["m1-37"]


def test_errors_over_time_are_those_of_the_study_outside_the_grey_band(both_ends):
    study = read_study(both_ends)
    # A periodic study is drawn over the time in its cycle.
    time = study.history("reference").time
    assert 0 < time[0] < time[-1] == pytest.approx(0.0125)
    figure = figures.draw_errors(study, study.joints[0].measured("methods", method="m1"))
    drawn = figure.axes[0].lines[0].get_ydata()
    figures.plt.close(figure)
    # Where nothing is off, no curve is drawn.
    assert np.nanmin(drawn) == pytest.approx(20)
    assert np.isnan(drawn).any()


def test_nothing_is_drawn_below_the_reference_s_own_error(folder):
    joints = read_study(folder).joints
    drawn = {
        "time": figures.draw_cost(joints, figures.ONLINE),
        "tolerance": figures.draw_tolerances(joints),
        "mesh": figures.draw_film_meshes(joints),
    }
    lowest, signs = {}, {}
    for name, figure in drawn.items():
        signs[name] = [{line.get_marker() for line in axes.lines} for axes in figure.axes]
        lowest[name] = [
            min(np.min(line.get_ydata()) for line in axes.lines
                if len(line.get_ydata()) and line.get_label() != "slope 2/3")
            for axes in figure.axes
        ]  # fmt: skip
        figures.plt.close(figure)
    floors = [100 * min(r.floor(q) for r in joints[0].measured("methods")) for q in CURVES]
    # M4 lies below and is drawn at the floor itself, by a sign of its own.
    np.testing.assert_allclose(lowest["time"], floors)
    assert [figures.BOUND in seen for seen in signs["time"]] == [True, True]
    assert not any(figures.BOUND in seen for seen in signs["mesh"])
    assert np.all(np.array(lowest["tolerance"]) >= floors)
    assert np.all(np.array(lowest["mesh"]) >= floors)


def test_slope_of_the_error_over_the_tolerance_is_found(folder):
    (joint,) = read_study(folder).joints
    (series,) = figures.tolerance_series(joint, PRESSURE).values()
    assert figures.slope(series[1], 1e-3) == pytest.approx(2 / 3, abs=0.01)
    assert np.isnan(figures.slope(series[1][:1], 1e-3))


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
    (tmp_path / "study.json").write_text(
        json.dumps({"scene": "x", "joints": ["a"], "start": 0, "runs": 12})
    )
    status, output, _ = exit_of(capfd, "report", tmp_path)
    assert not status
    assert output.strip() == str(tmp_path / "report.html")
    assert "12 of 12 have not been run yet" in (tmp_path / "report.md").read_text()


#: What every study tells.
TABLE = {"scene": "x", "joints": ["a"], "runs": 1, "start": 0.0}
STUDY = {"study.json": json.dumps(TABLE)}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({}, "neither history.h5 nor study.json"),
        ({"study.json": "{"}, "cannot be read"),
        ({"study.json": "[1]"}, "cannot be read"),
        ({"study.json": '{"scene": "x"}'}, "cannot be read: 'joints'"),
        (STUDY | {"table.csv": "a,b\n1,2\n"}, "not the table of a study"),
        (STUDY | {"table.csv": b"run,\xff\n"}, "not the table of a study"),
        (STUDY | {"table.csv": f"{','.join(COLUMNS)}\n" + "x," * 50 + "\n"}, "not the table"),
        (STUDY | {"reference.json": "{"}, "reference.json: cannot be read"),
    ],
)  # fmt: skip
def test_what_is_no_study_is_refused_in_one_line(content, words, tmp_path, capfd):
    for name, text in content.items():
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    status, _, complaint = exit_of(capfd, "report", tmp_path)
    assert status == 2
    assert words in complaint
    assert "\n" not in complaint.strip()


def test_what_is_known_of_the_reference_s_own_errors_is_told_for_every_joint(tmp_path):
    study = write_study(tmp_path, [m4(1e-5, 1e-5)])
    assert unknown_floors(study) == ["basis"]
    assert "error of the reference by its basis was not computed" in words(study)
    film = {"joints": {"a": {"pressure_max": 0.02, "film_max": 0.03},
                       "b": {"pressure_max": 0.04, "film_max": 0.05}}}  # fmt: skip
    study = write_study(tmp_path, [m4()], ("a", "b"), reference={"film": film})
    assert [joint.own_error("film", FILM) for joint in study.joints] == [0.03, 0.05]
    shared = (
        "b: all runs share the error of the film mesh, which is 4 % of the peak pressure and 5 %"
    )
    assert shared in words(study)


def test_the_true_gap_of_the_reference_bounds_what_a_run_can_be_seen_to_have(tmp_path):
    errors = {"-step": 1e-9, "-basis": 3e-9, "-film": 5e-8}
    rows = [run(f"reference{kind}", group="reference", true_gap_error_m=error)
            for kind, error in errors.items()]  # fmt: skip
    study = write_study(tmp_path, [m3(31), *rows], reference={"film": {"run": "reference-film"}})
    assert figures.gap_floor(study.joints[0]) == 3e-9
    alone = write_study(tmp_path / "alone", [m3(31)])
    assert figures.gap_floor(alone.joints[0]) == 0


def test_every_bore_of_a_part_has_its_mode_shapes(tmp_path):
    study = write_study(tmp_path, [m1(8)])
    body = ehd.craig_bampton(ring(), 8, estimate_error=False)
    twice = replace(
        body,
        bores={"bore": body.bore, "pin": body.bore},
        bore_basis=np.vstack([body.bore_basis] * 2),
        load_projection=np.hstack([body.load_projection] * 2),
        spin_load_projection=np.hstack([body.spin_load_projection] * 2),
        rigid_load=np.hstack([body.rigid_load] * 2),
    )
    study.folder("m1-8").mkdir(parents=True)
    ehd.save_body(twice, study.folder("m1-8") / "body-rod.h5")
    found = best_bodies(study)
    assert list(found) == ["rod_bore", "rod_pin"]
    shapes, notes = first_shapes(found["rod_pin"]["m1"], "fixed-boundary")
    modes = [i for i in np.argsort(body.frequencies) if body.kinds[i] == "fixed-boundary"][:6]
    np.testing.assert_array_equal(shapes, body.bore_basis[:, :, modes])
    assert len(notes) == 6


POINT = st.tuples(st.integers(0, 20), st.integers(0, 20), st.integers())


@given(st.lists(POINT, min_size=1))
def test_hull_is_what_no_point_beats(points):
    hull = figures.lower_left(points)
    assert set(hull) <= set(points)
    assert all(a[0] < b[0] and a[1] > b[1] for a, b in itertools.pairwise(hull))
    for x, y, _ in points:
        assert any(a <= x and b <= y for a, b, _ in hull)
