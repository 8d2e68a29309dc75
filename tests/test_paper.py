"""Verdicts on the paper's statements, for studies whose result is known."""

import dataclasses
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from report_cases import (
    NAN,
    bearing,
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

from fenics_ehd.study.paper import FIGURES
from fenics_ehd.study.report import paper_page
from fenics_ehd.study.report import paper_rotor as rotor
from fenics_ehd.study.report import paper_slider_crank as crank
from fenics_ehd.study.report import paper_statement as comparisons
from fenics_ehd.study.report.paper_statement import (
    FAILS,
    HOLDS,
    NOT_RUN,
    OPEN,
    PARTLY,
    MissingRunsError,
)

UNIT = {"pressure_set": "pc1", "selection": "largest-eigenvalue"}
LITERAL = {"selection": "smallest-eigenvalue"}
LONG, SHORT = ({"pressure_set": f"pc2-{name}"} for name in ("long", "short"))


@pytest.mark.parametrize("scene", paper_page.STATEMENTS)
def test_a_study_without_runs_has_the_verdict_not_run_for_every_statement(scene, tmp_path):
    empty = bearing(scene=scene, directory=tmp_path)
    findings = [statement.judge(empty) for statement in paper_page.STATEMENTS[scene]]
    assert {finding.verdict for finding in findings} == {NOT_RUN}
    assert all(finding.measured for finding in findings)


@pytest.mark.parametrize(
    ("check", "runs", "verdict"),
    [
        (crank.rich_reference, [m3(60, 0.03, 0.04, **UNIT)], HOLDS),
        (crank.rich_reference, [m3(61, 0.03, 0.08, **UNIT)], FAILS),
        (comparisons.m2_ahead_of_m1, [m1(37, 0.2, 0.2), m2(37, 0.1, 0.1)], HOLDS),
        (comparisons.m2_ahead_of_m1, [m1(37, 0.2, 0.1), m2(37, 0.1, 0.2)], PARTLY),
        (comparisons.m2_ahead_of_m1, [m1(37, 0.1, 0.1), m2(37, 0.2, 0.2)], FAILS),
        # Other numbers of coordinates are not compared.
        (comparisons.m2_ahead_of_m1, [m1(37, 0.1, 0.1), m2(67, 0.2, 0.2)], NOT_RUN),
        (crank.literal_selection, [m3(31), m3(31, 0.5, 0.2, **LITERAL)], FAILS),
        (crank.literal_selection, [m3(31), m3(31, 0.01, 0.01, **LITERAL)], HOLDS),
        (crank.literal_selection, [m3(31)], NOT_RUN),
        # M2's need lies between the last run that is not as good and the first that is.
        (crank.quarter_of_m2, [m3(31), m2(67)], OPEN),
        (crank.quarter_of_m2, [m3(31), m2(170)], HOLDS),
        (crank.quarter_of_m2, [m3(31), m2(67, 0.01, 0.01)], FAILS),
        (crank.quarter_of_m2, [m3(31), m2(67), m2(170, 0.01, 0.01)], OPEN),
        (crank.quarter_of_m2, [m3(31), m2(160), m2(170, 0.01, 0.01)], HOLDS),
        (crank.one_shape_is_not_enough, [m3(31), m3(31, 0.1, 0.2, **LONG)], NOT_RUN),
        (crank.one_shape_is_not_enough, [m3(31), m3(31, **SHORT)], NOT_RUN),
        (crank.one_shape_is_not_enough,
         [m3(31), m3(31, 0.1, 0.2, **LONG), m3(31, 0.1, 0.2, **SHORT)], HOLDS),
        (crank.one_shape_is_not_enough, [m3(31), m3(31, 0.1, 0.2, **LONG), m3(31, **SHORT)],
         PARTLY),
        (crank.one_shape_is_not_enough, [m3(31), m3(31, **LONG), m3(31, **SHORT)], FAILS),
        # More modes of both kinds would not be a fair comparison.
        (crank.one_shape_is_not_enough,
         [m3(80), m3(31, 0.1, 0.2, **LONG), m3(31, 0.1, 0.2, **SHORT)], NOT_RUN),
        (crank.m3_fastest, [m1(37, online_s=9.0), m3(31, online_s=5.0)], HOLDS),
        (crank.m3_fastest, [m1(37, online_s=3.0), m3(31, online_s=5.0)], FAILS),
        # One measurement of each time tells no difference of a few per cent.
        (crank.m3_fastest, [m1(37, online_s=5.2), m3(31, online_s=5.0)], OPEN),
        (crank.m3_fastest, [m1(37, online_s=5.2), m1(67, online_s=9.0), m3(31, online_s=5.0)],
         PARTLY),
        (crank.m3_fastest, [m1(37, 0.001, 0.002, online_s=9.0), m3(31, online_s=5.0)], FAILS),
        (crank.best_at_every_size, [m1(37), m2(37), m3(31)], HOLDS),
        (crank.best_at_every_size, [m1(37), m2(37), m3(31, 0.15, 0.02)], PARTLY),
        # Below the reference's own error nothing is smaller than anything.
        (comparisons.m2_ahead_of_m1, [m1(37, 3e-4, 3e-4), m2(37, 1e-4, 1e-4)], OPEN),
        (crank.best_at_every_size, [m1(37, 3e-4, 3e-4), m2(37, 3e-4, 3e-4), m3(31, 1e-4, 1e-4)],
         OPEN),
    ],
)  # fmt: skip
def test_verdict_follows_from_the_table(check, runs, verdict, tmp_path):
    try:
        found = check(bearing(*runs, directory=tmp_path)).verdict
    except MissingRunsError:
        found = NOT_RUN
    assert found == verdict


#: By statement, runs that are enough for a verdict, and those that it must not be given without.
WAITED_FOR = [
    (crank.rich_reference, [m3(60, **UNIT)], [m3(61, pressure_set="pc1")]),
    (crank.enough_with_31, [m3(31)], [m3(31, **LITERAL)]),
    (crank.literal_selection, [m3(31)], [m3(31, **LITERAL)]),
    (crank.literal_selection, [m3(31, **LITERAL), m3(31)], [m3(31, selection="every-column")]),
    (crank.quarter_of_m2, [m3(31), m2(170)], [m2(37)]),
    (crank.quarter_of_m2, [m2(170)], [m3(31)]),
    (crank.one_shape_is_not_enough, [m3(31), m3(31, **LONG)], [m3(31, **SHORT)]),
    (crank.m3_fastest, [m1(37), m3(31, online_s=1.0)], [m2(37)]),
    (crank.best_at_every_size, [m1(37), m2(37), m3(31)], [m3(61)]),
    (comparisons.m2_ahead_of_m1, [m1(37), m2(37)], [m2(67)]),
    (partial(comparisons.many_modes, method="m1"), [m1(127), m3(31)], [m1(37)]),
    (partial(comparisons.many_modes, method="m1"), [m1(127), m3(31)], [m3(16)]),
    (partial(comparisons.m3_best, sizes=(39,)), [m1(37), m2(38), m3(31)], [m2(37)]),
]


@pytest.mark.parametrize("status", ["not run", "failed: OSError: no space left on device"])
@pytest.mark.parametrize(("check", "there", "missing"), WAITED_FOR)
def test_no_verdict_before_the_runs_that_it_needs(check, there, missing, status, tmp_path):
    whole = bearing(*there, *missing, directory=tmp_path)
    assert check(whole).verdict != NOT_RUN
    waiting = bearing(*there, *(without_end(row, status) for row in missing), directory=tmp_path)
    with pytest.raises(MissingRunsError, match=missing[0]["run"]):
        check(waiting)


def test_a_selection_that_could_not_run_is_reported_and_fails(tmp_path):
    failed = without_end(m3(31, **LITERAL), "failed: StepSizeError: 1e-13 s")
    finding = crank.literal_selection(bearing(m3(31), failed, directory=tmp_path))
    assert finding.verdict == FAILS
    assert "StepSizeError" in finding.measured


@pytest.mark.parametrize(
    ("rival", "verdict"), [(m1(127, 0.2, 0.2), HOLDS), (m1(37, 0.04, 0.04), FAILS),
                           (m1(127, 0.04, 0.04), OPEN), (m1(37, 0.2, 0.2), OPEN)]
)  # fmt: skip
def test_many_modes_are_twice_those_of_m3(rival, verdict, tmp_path):
    found = comparisons.many_modes(bearing(rival, m3(31), directory=tmp_path), "m1")
    assert found.verdict == verdict


@pytest.mark.parametrize(("falling", "verdict"), [(True, HOLDS), (False, PARTLY)])
def test_plateau_is_seen_in_the_reference(falling, verdict, tmp_path):
    folder = bearing(directory=tmp_path)
    write_history(folder.study, "reference", falling=falling)
    assert crank.plateau(folder).verdict == verdict
    assert crank.peak_at_the_axis(folder).verdict == HOLDS


@pytest.mark.parametrize(
    "check", [crank.plateau, crank.peak_at_the_axis, crank.smoother_flank, rotor.unsymmetric]
)
def test_a_reference_that_is_not_complete_tells_nothing(check, tmp_path):
    folder = bearing(directory=tmp_path, status="failed: StepSizeError: 1e-13 s")
    write_history(folder.study, "reference")
    with pytest.raises(MissingRunsError, match="complete"):
        check(folder)


def test_flank_behind_the_peak_gets_flatter(tmp_path):
    folder = bearing(directory=tmp_path)
    write_history(folder.study, "reference")
    finding = crank.smoother_flank(folder)
    # exp(-(angle / width)^2) is one half at width sqrt(ln 2); the profile's width is 0.4 rad at
    # 6 ms and 0.6 at 8 ms.
    width = np.degrees(np.sqrt(np.log(2)) * np.array([0.4, 0.6]))
    stated = [float(word) for word in finding.measured.replace(",", "").split() if "." in word]
    np.testing.assert_allclose(stated, width, atol=1.0)
    assert finding.verdict == HOLDS


@pytest.mark.parametrize(("above", "verdict"), [(0.05, HOLDS), (-0.05, FAILS), (5e-4, OPEN)])
def test_too_stiff_is_too_high_a_pressure_at_high_loads(above, verdict, tmp_path):
    folder = bearing(m1(37), directory=tmp_path)
    write_history(folder.study, "reference", steps=400)
    write_history(folder.study, "m1-37", above=above)
    assert crank.m1_stiff(folder).verdict == verdict


def test_vibration_modes_do_not_depend_on_the_residual_ones(tmp_path):
    rows = [m1(8), m3(6), m3(12), m4()]
    write_bodies(bearing(*rows, directory=tmp_path).study, *(row["run"] for row in rows))
    finding = crank.independent_numbers(bearing(*rows, directory=tmp_path))
    assert finding.verdict == HOLDS
    assert "6 vibration modes with 10, 16 static ones" in finding.measured
    # Bodies of an earlier study, which no row names, are left out.
    with pytest.raises(MissingRunsError, match="different numbers"):
        crank.independent_numbers(bearing(m3(6), directory=tmp_path))


@pytest.mark.parametrize(("tilt", "verdict"), [(0.0, FAILS), (0.5, HOLDS)])
def test_a_tilted_shaft_makes_the_pressure_unsymmetric(tilt, verdict, tmp_path):
    folder = bearing(scene="rotor-paper", directory=tmp_path)
    write_history(folder.study, "reference", tilt=tilt)
    assert rotor.unsymmetric(folder).verdict == verdict


def rotor_runs(size, m3_error):
    m1_run, m2_run = m1(size - 2, 0.3, 0.3), m2(size - 2, 0.2, 0.2)
    errors = {"pressure_error_max": m3_error, "film_error_max": m3_error}
    m3_run = run(f"m3-{size}", coordinates=size, residual_modes=size - 10, **UNIT, **errors)
    return [m1_run, m2_run, m3_run]


@pytest.mark.parametrize(
    ("error", "best", "small"), [(0.05, HOLDS, HOLDS), (0.15, HOLDS, FAILS), (0.4, FAILS, FAILS)]
)
def test_methods_of_the_rotor_are_compared_with_as_many_modes(error, best, small, tmp_path):
    runs = [*rotor_runs(30, error), *rotor_runs(50, error)]
    folder = bearing(*runs, scene="rotor-paper", directory=tmp_path)
    assert comparisons.m3_best(folder, (30, 50)).verdict == best
    assert rotor.small_for_m3(folder).verdict == small
    assert comparisons.m1_worst(folder, 30).verdict == (HOLDS if error < 0.3 else PARTLY)


def test_pressure_shapes_are_compared_with_unit_pressures(tmp_path):
    shapes = run("shapes", pressure_set="pc2", residual_modes=20, pressure_error_max=0.5,
                 film_error_max=0.5, coordinates=30)  # fmt: skip
    folder = bearing(shapes, *rotor_runs(30, 0.05), scene="rotor-paper", directory=tmp_path)
    assert rotor.shapes_fail(folder).verdict == HOLDS


@pytest.mark.parametrize(
    ("status", "verdict"),
    [("failed: FilmTooThinError: 0.16 um", HOLDS), ("failed: OSError: disk", NOT_RUN)],
)
def test_pressure_shapes_that_break_the_film_down_are_worse(status, verdict, tmp_path):
    shapes = without_end(run("shapes", pressure_set="pc2", residual_modes=20), status)
    folder = bearing(shapes, *rotor_runs(30, 0.05), scene="rotor-paper", directory=tmp_path)
    (statement,) = [one for one in rotor.STATEMENTS if one.check is rotor.shapes_fail]
    assert statement.judge(folder).verdict == verdict


def test_errors_are_larger_where_the_pressure_is_high(tmp_path):
    folder = write_study(tmp_path, rotor_runs(30, 0.05), ("bearing",), scene="rotor-paper").joints[
        0
    ]
    write_history(folder.study, "reference")
    for name in ("m1-28", "m2-28", "m3-30"):
        write_history(folder.study, name, above=0.1)
    assert rotor.large_where_high(folder).verdict == HOLDS


def test_errors_and_verdicts_of_a_figure_are_written_to_a_page(tmp_path, monkeypatch):
    unit = {"pressure_set": "pc1", "selection": "largest-eigenvalue"}
    rows = [run("reference", group="reference", method="full", pressure_error_max=NAN),
            run("reference-step", group="reference", method="full"), m1(30), m2(30),
            m3(20, coordinates=32, **unit), m4() | {"run": "m4-10-2e-03"}, m1(50)]  # fmt: skip
    rows[-1] = without_end(rows[-1])
    study = write_study(tmp_path / "rotor-paper", rows, ("bearing",), scene="rotor-paper")
    for row in rows[:-1]:
        write_history(study, row["run"], above=0.0 if row["run"] == "reference" else 0.1)
    (machine,) = paper_page.write_paper_page(tmp_path)
    assert machine.missing == (11,)
    (result,) = machine.figures
    assert not result.failed
    verdicts = {each.statement.text: each.finding.verdict for each in result.statements}
    assert verdicts["with 30 modes M1 is farthest off"] == HOLDS
    others = {each.statement.text: each.finding.verdict for each in machine.others}
    assert others["the tilting shaft makes the pressure unsymmetric along the axis"] == FAILS
    page = (tmp_path / "report.html").read_text()
    assert page.count("<svg") + page.count("data:image/svg+xml") == 1
    for row in result.table().rows:
        assert f'<td class="word">{row[0]}</td>' in page
    stored = json.loads((tmp_path / "paper.json").read_text())
    assert stored["missing_figures"] == [5, 6, 7, 8, 11]
    assert f"paper -o {tmp_path} --figures 5,6,7,8,11 computes them" in page
    assert {each["statement"]: each["verdict"] for each in stored["statements"]["rotor-paper"]} == (
        others
    )
    # Figures that have been drawn are not drawn again.
    monkeypatch.setattr(paper_page, "draw_figure", None)
    drawn = {"figure_10": (tmp_path / "figure_10.svg").read_bytes()}
    paper_page.write_paper_page(tmp_path, drawn)
    assert (tmp_path / "report.html").read_text() == page


def test_a_run_that_failed_has_its_status_in_the_table(tmp_path):
    failed = without_end(m1(22), "failed: StepSizeError: 1e-13 s")
    figure = dataclasses.replace(FIGURES[6], variants=FIGURES[6].variants[:1])
    result = paper_page.FigureResult(figure, bearing(directory=tmp_path).study, (failed,), ())
    assert result.failed == {"m1-22": "failed: StepSizeError: 1e-13 s"}
    assert result.table().rows[0][0] == "M1: failed: StepSizeError: 1e-13 s"


@pytest.mark.parametrize("scene", paper_page.STATEMENTS)
def test_the_page_of_the_documentation_has_every_statement(scene):
    page = (Path(__file__).parents[1] / "docs" / "paper.md").read_text()
    for statement in paper_page.STATEMENTS[scene]:
        row = f"| {statement.section} | {statement.text} | {statement.rule} |"
        assert page.count(row) == 1
