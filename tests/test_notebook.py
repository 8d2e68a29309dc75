"""Figures and short texts of results, as Python and notebooks show them."""

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.base.described import LONGEST_TEXT, MOST_LINES, Described
from fenics_ehd.plotting.picture import plt

STORED = Path(__file__).parent / "stored" / "run-0.3"
BODIES = Path(__file__).parent / "golden" / "stored"


@pytest.fixture(scope="module")
def history():
    return ehd.load_history(STORED)


def shown_curve(figure):
    """Abscissas and ordinates of the longest curve of a figure."""
    line = max(figure.axes[0].lines, key=lambda line: len(line.get_xdata()))
    return line.get_xdata(), line.get_ydata()


def test_a_history_draws_its_own_columns(history):
    before = plt.get_fignums()
    figure = history.plot("rocker_end.min_film_thickness")
    _, film = shown_curve(figure)
    assert film.min() == pytest.approx(1e6 * history["rocker_end.min_film_thickness"].min())
    assert plt.get_fignums() == before  # a notebook would show an open figure twice


def test_folders_and_histories_give_the_same_figure(history):
    by_folder, by_history = (
        shown_curve(ehd.plot(run, "max_pressure")) for run in (STORED, history)
    )
    np.testing.assert_array_equal(by_folder, by_history)
    assert history.folder == STORED


def test_runs_have_the_names_of_their_folders_or_the_given_ones(history, tmp_path):
    other = copytree(STORED, tmp_path / "other")
    figure = ehd.plot([STORED, other], "max_pressure")
    names = [text.get_text().partition(":")[0] for text in figure.axes[0].get_legend().get_texts()]
    assert names == ["run-0.3", "other"]
    figure = ehd.plot({"first": STORED, "second": history}, "max_pressure")
    names = [text.get_text().partition(":")[0] for text in figure.axes[0].get_legend().get_texts()]
    assert names == ["first", "second"]
    figure = ehd.plot([history, history], "max_pressure")
    names = [text.get_text().partition(":")[0] for text in figure.axes[0].get_legend().get_texts()]
    assert names == ["run-0.3 (1)", "run-0.3 (2)"]


def test_orbits_and_maps(history):
    assert history.plot_orbit("rocker_end").axes[0].name == "polar"
    title = history.plot_map("rocker_end", "film").axes[0].get_title(loc="right")
    assert "µm" in title


def test_any_column_of_a_joint_is_drawn(history):
    name = "rocker_end.force_x"
    figure = history.plot(name)
    (axes,) = figure.axes
    assert axes.get_ylabel() == "force x [N]"
    _, values = shown_curve(figure)
    np.testing.assert_allclose(values, history.last_cycle()[name])


def test_a_difference_of_a_run_and_itself_is_zero(history):
    figure = ehd.plot([history, STORED], "max_pressure", difference=True)
    _, difference = shown_curve(figure)
    np.testing.assert_allclose(difference, 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((STORED, "no_such"), r"quantity no_such: no such quantity .*choose from max_pressure"),
        ((STORED, "big.orbit"), r"no lubricated joint big: choose from rocker_end"),
        (([], "orbit"), "runs is empty"),
        (({}, "orbit"), "runs is empty"),
        ((3, "orbit"), "runs = 3 is of class int"),
        (([3], "orbit"), "runs = 3 is of class int"),
        ((STORED, 3), "quantity = 3 is of class int"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        ehd.plot(*arguments)


def test_an_unknown_field_is_refused(history):
    with pytest.raises(ehd.errors.SettingsError, match=r"field = 'gap' must be one of pressure"):
        history.plot_map("rocker_end", "gap")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ehd.load_history(STORED), ("four-bar", "complete", "9.746 MPa ± 0.68 %")),
        (lambda: ehd.read_scene("slider-crank"), ("rod (flexible)", "big_end (lubricated)")),
        (lambda: ehd.load_body(BODIES / "body-m4.h5"), ("method m4", "Hz", "kg")),
        (
            lambda: ehd.build(ehd.read_scene("four-bar")).mechanism,
            ("crank (RigidBody)", "rocker_end (LubricatedJoint)"),
        ),
    ],
)
def test_large_objects_are_described_in_ten_lines(make, words):
    described = make()
    text = repr(described)
    assert len(text.splitlines()) <= 10
    assert all(word in text for word in words)
    table = described._repr_html_()
    assert table.count("<tr>") == len(text.splitlines())


def test_long_descriptions_are_shortened_and_tables_escaped():
    class Long(Described):
        def described(self):
            for number in range(30):
                yield f"line {number}", "<b>" + "x" * 500

    text = repr(Long())
    lines = text.splitlines()
    assert len(lines) == MOST_LINES
    assert lines[-1].split() == ["and", "21", "more"]
    assert max(len(line) for line in lines) <= LONGEST_TEXT + len("line 0  ")
    assert "<b>" not in Long()._repr_html_()
