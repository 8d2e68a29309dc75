"""``fenics-ehd paper``: figures, estimates, and the documented parameters of the paper."""

import csv
import json
import re
import tomllib
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import exit_of
from report_cases import m1, m2, m3, write_history, write_study
from study_cases import COARSE
from sweep_cases import Inline

import fenics_ehd as ehd
from fenics_ehd.scenes.scene import as_stored
from fenics_ehd.study import paper, pool
from fenics_ehd.study.plan import REFERENCE, full, steps
from fenics_ehd.study.report.page import percent
from fenics_ehd.study.report.paper_figures import draw_figure
from fenics_ehd.study.worker import CaseResult, failed

#: A revolution's beginning, coarse.
TINY = {"time.revolutions": 0.02, "time.largest_step": 0.0055, **COARSE, **steps(1e-4)}


@pytest.mark.parametrize(
    ("text", "numbers"),
    [("5", (5,)), ("7 5", (5, 7)), ("5,7", (5, 7)), ("5-8,10", (5, 6, 7, 8, 10)),
     ("8-11", (8, 10, 11)), (" 11 , 11 ", (11,))],
)  # fmt: skip
def test_figures_are_numbers_and_ranges(text, numbers):
    assert paper.parse_figures(text) == numbers


@pytest.mark.parametrize("text", ["9", "four", "5;7", "8-5", "5-", "-5", "", "1-99", "5-8-10"])
def test_other_figures_are_refused_in_one_line(text, capfd, tmp_path):
    status, out, err = exit_of(capfd, "paper", f"--figures={text or ' '}", "-o", tmp_path / "out")
    assert status == 2
    assert not out
    (line,) = err.splitlines()
    assert "--figures" in line
    assert "5, 6, 7, 8, 10, 11" in line
    assert not (tmp_path / "out").exists()


def test_a_folder_of_another_command_is_refused(capfd, tmp_path):
    (tmp_path / "manifest.txt").write_text(
        "fenics_ehd made these in this folder, and may remove or replace them:\ncommand: sweep\n"
    )
    status, _, err = exit_of(capfd, "paper", "-o", tmp_path)
    assert status == 2
    assert "was made by fenics-ehd sweep, not by paper" in err


@pytest.mark.parametrize("scene", [paper.SLIDER_CRANK, paper.ROTOR])
def test_every_run_of_a_figure_is_planned_and_has_an_estimate(scene):
    study = paper.paper_study(scene)
    runs = {run for figure in paper.figures_of(scene) for run in figure.runs}
    assert runs <= study.cases.keys()
    assert study.cases.keys() - runs <= {paper.OWN_ERROR, f"{REFERENCE}-basis"}
    assert paper.SECONDS[scene].keys() == paper.paper_study(scene, statements=True).cases.keys()


def test_the_runs_have_the_paper_s_numbers_of_modes():
    study = paper.paper_study(paper.ROTOR)
    for number, modes in ((10, 30), (11, 50)):
        for run in paper.FIGURES[number].runs[2:5]:
            reduction = study.cases[run].scene.bodies["housing"].reduction
            counted = reduction.modes
            if reduction.method == "m3":
                counted = reduction.vibration_modes + reduction.residual_modes
                assert reduction.pressure_set == "pc1"
            assert counted == modes
    rod = paper.paper_study(paper.SLIDER_CRANK).cases
    reference = rod["m3-pc1-lowest-frequency-60"].scene.bodies["rod"].reduction
    assert (reference.vibration_modes, reference.residual_modes) == (6, 60)
    assert rod[REFERENCE].scene.time.tolerance == 1e-7


@pytest.fixture
def tiny_figures(monkeypatch):
    """Figure 5 of values and figure 6 of errors, with coarse runs; the pool that runs them."""
    inline = Inline()
    scene = paper.SLIDER_CRANK
    variants = (paper.m1(10),), (paper.m1(10), paper.m1(14))
    figures = {
        5: paper.PaperFigure(5, scene, variants[0], paper.VALUES, "values"),
        6: paper.PaperFigure(6, scene, variants[1], paper.ERRORS, "errors"),
    }
    reference = paper.Reference(full(8), steps(1e-6), steps(1e-5), (full(6), steps(1e-5)), 1e-4)
    study_of = paper.paper_study
    monkeypatch.setattr(paper, "FIGURES", figures)
    monkeypatch.setattr(paper, "REFERENCES", {scene: reference})
    seconds = {REFERENCE: 90.0, paper.OWN_ERROR: 20.0, "m1-10": 5.0, "m1-14": 5.0}
    seconds |= {f"{REFERENCE}-basis": 20.0, "m2-10": 5.0}
    monkeypatch.setattr(paper, "SECONDS", {scene: seconds})
    more = {scene: (paper.m1(10), paper.m2(10))}
    monkeypatch.setattr(paper, "STATEMENT_VARIANTS", more)
    monkeypatch.setattr(paper, "paper_study", partial(study_of, settings=TINY))
    monkeypatch.setattr(pool, "open_pool", lambda workers: nullcontext(inline))
    return inline


def test_figures_are_made_and_complete_runs_are_not_repeated(tiny_figures, capfd, tmp_path):
    folder = tmp_path / "out"
    status, out, err = exit_of(capfd, "paper", "--figures", "5", "-o", folder, "--json")
    assert status == 0, err
    lines = [line.split() for line in err.splitlines()]
    # Two of the four runs, 90 s and 5 s, before anything is run.
    assert ["5", "2", "0", "95", "s"] in lines
    assert lines.index(["5", "2", "0", "95", "s"]) < 3
    assert tiny_figures.cases == [REFERENCE, "m1-10"]
    result = json.loads(out)
    (entry,) = result["figures"]
    assert entry["files"] == ["figure_5.png", "figure_5.svg"]
    assert [row["run"] for row in entry["runs"]] == [REFERENCE, "m1-10"]
    assert result.pop("directory") == str(folder)
    assert json.loads((folder / "paper.json").read_text()) == result
    first = (folder / "figure_5.svg").read_bytes()

    page = (folder / "report.html").read_bytes()
    assert f"paper -o {folder} --figures 6 computes them".encode() in page
    (folder / "report.html").unlink()
    status, out, _ = exit_of(capfd, "report", folder)
    assert (status, out.strip()) == (0, str(folder / "report.html"))
    assert (folder / "report.html").read_bytes() == page

    tiny_figures.tasks.clear()
    status, out, err = exit_of(capfd, "paper", "-o", folder)
    assert status == 0, err
    assert set(tiny_figures.cases) == {paper.OWN_ERROR, "m1-14"}
    lines = [line.split() for line in err.splitlines()]
    assert ["5", "2", "2", "0", "s"] in lines
    assert (folder / "figure_5.svg").read_bytes() == first
    assert (folder / "figure_6.png").is_file()
    assert "figure_6.png" in out
    rows = list(csv.DictReader((folder / "paper.csv").open()))
    assert [(row["figure"], row["run"]) for row in rows[-2:]] == [("6", "m1-10"), ("6", "m1-14")]
    # Printed errors are those of the study, of which the table has a copy.
    printed = next(line for line in out.splitlines() if line.startswith("  M1"))
    assert percent(float(rows[1]["pressure_error_max"])) in printed
    # Estimates are in proportion to the times of the complete runs.
    (row,) = [line for line in lines if line[:3] == ["6", "4", "2"]]
    assert row[-1] == "s"
    assert float(row[-2]) < 25


def test_runs_of_statements_are_planned_once_they_exist(tiny_figures, tmp_path):
    scene = paper.SLIDER_CRANK
    assert "m2-10" in paper.paper_study(scene, statements=True).cases
    assert "m2-10" not in paper.paper_study(scene).cases
    # M1 with 10 modes is a run of a figure.
    for name, expected in (("m1-10", False), ("m2-10", True)):
        (tmp_path / "runs" / name).mkdir(parents=True)
        assert paper.has_statement_runs(tmp_path, scene) is expected


def test_report_of_a_folder_without_runs_is_refused(capfd, tmp_path):
    (tmp_path / "manifest.txt").write_text(
        "fenics_ehd made these in this folder, and may remove or replace them:\ncommand: paper\n"
    )
    status, _, err = exit_of(capfd, "report", tmp_path)
    assert status == 2
    assert "slider-crank-paper/study.json" in err


def without_steps(task):
    """Result of a case whose steps become too small."""
    return CaseResult(failed(ehd.errors.StepSizeError("1e-13 s")))


def without_disk(task):
    """Result of a case that could not be stored."""
    return CaseResult(failed(OSError("disk")))


@pytest.mark.parametrize(
    ("options", "run_case", "message"),
    [
        ([], without_steps, "2 runs failed, the first is slider-crank-paper/reference: failed"),
        # A statement is judged by a run that breaks down, but not by one without disk.
        (["--statements"], without_steps, "2 runs failed"),
        (["--statements"], without_disk, "6 runs failed"),
    ],
)
def test_a_run_that_fails_is_named(
    options, run_case, message, tiny_figures, capfd, tmp_path, monkeypatch
):
    monkeypatch.setattr(pool, "run_case", run_case)
    out = tmp_path / "out"
    status, _, err = exit_of(capfd, "paper", "--figures", "5", *options, "-o", out)
    assert status == 1
    assert message in err
    assert not list((tmp_path / "out").glob("figure*"))


@pytest.mark.parametrize(
    ("number", "rows"),
    [
        (5, [m3(60, pressure_set="pc1")]),
        (6, [m1(22), m1(37), m1(67), m1(127)]),
        (7, [m2(22), m2(37), m2(67), m2(127)]),
        (8, [m3(16), m3(31), m3(61), m3(80)]),
    ],
)
def test_curves_of_the_slider_crank_are_those_of_the_figure_s_runs(number, rows, tmp_path):
    study = write_study(tmp_path, [*rows, m1(99)])
    figure = paper.FIGURES[number]
    assert draw_figure(figure, study) is None
    assert set(figure.runs) == {REFERENCE, *(row["run"] for row in rows)}
    for name in (REFERENCE, "m1-99", *(row["run"] for row in rows)):
        write_history(study, name)
    drawn = draw_figure(figure, study)
    curves = [line for line in drawn.axes[0].lines if len(line.get_xdata()) > 2]
    assert len(curves) == 1 + len(rows)
    safe = [line for line in drawn.axes[1].lines if set(line.get_ydata()) == {2.5}]
    # The paper has the line of h_safe in figure 5 (b) alone.
    assert len(safe) == (number == 5)


def test_curves_of_the_rotor_are_errors(tmp_path):
    unit = {"pressure_set": "pc1", "selection": "largest-eigenvalue"}
    rows = [m1(30), m2(30), m3(20, coordinates=30, **unit)]
    study = write_study(tmp_path, rows, ("bearing",), scene="rotor-paper")
    for name, above in ((REFERENCE, 0.0), *((row["run"], 0.1) for row in rows)):
        write_history(study, name, above=above)
    drawn = draw_figure(paper.FIGURES[10], study)
    curves = [line for line in drawn.axes[0].lines if len(line.get_xdata()) > 2]
    errors = [np.nanmax(line.get_ydata()) for line in curves]
    assert errors == pytest.approx([10.0, 10.0, 10.0])


#: Page with the parameters; rows of Table 2 and section 5 are those of the rotor.
PAGE = Path(__file__).parents[1] / "docs" / "paper.md"


def documented_settings():
    """Settings in the table of parameters: scene, key and value of each."""
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if len(cells) == 4 and re.match(r"Table \d|[\d., ]+$|\(\d", cells[0]):
            rotor = cells[0] == "Table 2" or cells[0][0] == "5"
            scene = paper.ROTOR if rotor else paper.SLIDER_CRANK
            for text in re.findall(r"`([\w.]+ = [^`]+)`", cells[3]):
                ((key, value),) = _flat(tomllib.loads(text))
                yield scene, key, value


def _flat(tables, prefix=""):
    for name, value in tables.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def test_the_documented_parameters_are_those_of_the_scenes():
    settings = {
        scene: dict(_flat(as_stored(scene).tables)) for scene in (paper.SLIDER_CRANK, paper.ROTOR)
    }
    documented = list(documented_settings())
    assert len(documented) > 60
    for scene, key, value in documented:
        assert settings[scene][key] == value, (scene, key)


#: Settings that the paper does not have: structure of the scene file, defaults of features that the
#: paper lacks, output, and limits of steps. The method is that of each run.
NOT_OF_THE_PAPER = re.compile(
    r"output\.|.*\.(angle|between|bores|journal|bore|lubricant|line|point|points|direction|table|"
    r"hold_rotation|grooves|shear_rule|smallest_film|method|snapshots|flexibility_tolerance|solver|"
    r"estimate_error|of|periodic|first_step|smallest_step|largest_step|inertia)$|"
    r".*\.(bore_shape|journal_shape)\.|joints\.\w+\.kind$|drives\.\w+\.kind$|"
    r"bodies\.(crank|rod|shaft|housing)\.position$|bodies\.shaft\.kind$|bodies\.housing\.kind$"
)


@pytest.mark.parametrize("scene", [paper.SLIDER_CRANK, paper.ROTOR])
def test_every_setting_in_the_scene_s_file_is_documented_or_not_of_the_paper(scene):
    documented = {key for name, key, _ in documented_settings() if name == scene}
    text = (Path(ehd.__file__).parent / "scenes" / "shipped" / f"{scene}.toml").read_text()
    written = dict(_flat(tomllib.loads(text)))
    missing = {key for key in written if key not in documented and not NOT_OF_THE_PAPER.match(key)}
    assert not missing
