"""Pictures of runs: which there are, and that they show what the history holds."""

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import copytree
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import call
from csv_history import edited
from recorded_runs import stored_run

import fenics_ehd as ehd
from fenics_ehd.base.columns import Quantity
from fenics_ehd.multibody.cycle import angle_name
from fenics_ehd.plotting import maps as bores
from fenics_ehd.plotting import shown
from fenics_ehd.plotting.curves import emptiest_direction
from fenics_ehd.plotting.picture import ENDINGS, kind_of, plt, save
from fenics_ehd.plotting.pictures import OF_EVERY_RUN, QUANTITIES, Pictures, plot_run
from fenics_ehd.plotting.shown import TIME, ShownJoint, ShownRun
from fenics_ehd.results.recorded_run import MADE

#: Steps of a cycle, short and long ones.
TURN = 360.0 * np.linspace(0.0, 1.0, 40) ** 1.5

CLEARANCE = 20e-6


def joint(name="big_end", run="one", figures=None, turned=None, **columns):
    """A joint of a run in memory, its journal at angles `turned` of a shaft."""
    angle = np.radians(TURN)
    own = {
        "time_s": 1e-4 * TURN,
        "crank_angle_deg": TURN,
        "max_pressure_Pa": 1e6 * (30 + 10 * np.sin(angle)),
        "min_film_thickness_m": 1e-6 * (3 + np.cos(angle)),
        "force_N": 1e3 * (3 + np.cos(angle)),
        "force_angle_deg": 30.0 + 90.0 * np.sin(angle),
        "eccentricity_in_bore_x_m": 0.5 * CLEARANCE * np.cos(angle),
        "eccentricity_in_bore_y_m": 0.4 * CLEARANCE * np.sin(angle),
        "eccentricity_ratio": np.hypot(0.5 * np.cos(angle), 0.4 * np.sin(angle)),
    }
    return ShownJoint(
        SimpleNamespace(
            name=run,
            figures=figures or {},
            label="",
            angle_name="crank angle",
            time_name="time in the cycle",
            current=False,
            starts=False,
            journal_angle=lambda _: turned,
        ),
        name,
        own | columns,
    )


@pytest.mark.parametrize("ending", [*ENDINGS, ".PNG", ".SVG"])
def test_a_picture_is_written_in_every_format_and_is_the_same_again(ending, tmp_path):
    contents = []
    for name in ("one", "two"):
        figure, axes = plt.subplots(layout="constrained")
        axes.plot([0.0, 1.0], [1.0, 2.0])
        (path,) = save(figure, [tmp_path / f"{name}{ending}"])
        assert kind_of(path).holds(path)
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]


def drawn(quantity, *runs, difference=False):
    """Axes of a picture of joints of one or more runs, one row for each name."""
    rows = {}
    for one in runs:
        rows.setdefault(one.name, []).append(one)
    found = QUANTITIES[quantity]
    figure = found.difference(rows) if difference else found.draw(rows)
    axes = figure.axes
    plt.close(figure)
    return axes


def curves(axes):
    """Lines that are curves over a cycle, not marks, means or circles."""
    return [
        line for line in axes.lines if len(line.get_xdata()) > 2 and line.get_marker() == "None"
    ]


@pytest.mark.parametrize(
    ("quantity", "column", "factor"),
    [
        ("max_pressure", "max_pressure_Pa", 1e-6),
        ("min_film_thickness", "min_film_thickness_m", 1e6),
    ],
)
def test_a_curve_is_its_column_over_the_crank_angle(quantity, column, factor):
    one = joint()
    (axes,) = drawn(quantity, one)
    (line,) = curves(axes)
    np.testing.assert_array_equal(line.get_xdata(), TURN)
    np.testing.assert_allclose(line.get_ydata(), factor * one.columns[column])
    values = factor * one.columns[column]
    worst = values.argmax() if quantity == "max_pressure" else values.argmin()
    (mark,) = (line for line in axes.lines if line.get_marker() == "o")
    assert mark.get_xydata().tolist() == [[TURN[worst], values[worst]]]
    message = axes.get_legend().get_texts()[0].get_text()
    assert f"{values[worst]:.4g}" in message
    assert f"at {TURN[worst]:.0f}°" in message
    assert axes.get_ylim()[0] == 0.0


@pytest.mark.parametrize("quantity", ["max_pressure", "min_film_thickness"])
def test_the_band_is_the_error_that_the_run_states(quantity):
    budget = {quantity: {"total": 0.02}, "largest_over_cycle": {quantity: {"total": 0.05}}}
    one = joint(figures={"big_end": {"error_budget": budget}})
    (axes,) = drawn(quantity, one)
    (line,) = curves(axes)
    y = line.get_ydata()
    half = 0.05 * (y.max() if quantity == "max_pressure" else y)
    (band,) = axes.collections
    lower, upper = (band.get_paths()[0].vertices[:, 1][s] for s in (slice(1, 41), slice(42, 82)))
    np.testing.assert_allclose(lower, y - half)
    np.testing.assert_allclose(upper, (y + half)[::-1])
    assert "(± 2 %) at " in axes.get_legend().get_texts()[0].get_text()
    budget[quantity]["total"] = "not estimated"
    (axes,) = drawn(quantity, one)
    assert not axes.collections


def test_equal_curves_of_two_runs_are_both_seen():
    (axes,) = drawn("max_pressure", joint(run="one"), joint(run="two"))
    one, two = curves(axes)
    assert one.get_label().startswith("one: ")
    assert two.get_label().startswith("two: ")
    # The later one, on top, has gaps through which the other shows.
    assert [one.get_linestyle(), two.get_linestyle()] == ["-", "--"]


def test_averages_are_those_over_time_and_flows_all_those_that_end_as_one():
    torque = TURN / 360.0
    (axes,) = drawn("friction", joint(friction_torque_Nm=torque))
    assert "mean 0.5 N m" in axes.get_legend().get_texts()[0].get_text()
    level = [line for line in axes.lines if len(line.get_xdata()) == 2]
    np.testing.assert_allclose(level[0].get_ydata(), 0.5)
    one = joint(side_flow_m3_per_s=1e-6 + 0 * TURN, **{"inlet.flow_m3_per_s": 2e-6 + 0 * TURN})
    (axes,) = drawn("flow", one)
    assert [line.get_label().partition(":")[0] for line in curves(axes)] == ["side", "inlet"]


def test_an_angle_goes_once_around_without_a_line_across():
    place = (TURN + 200.0) % 360.0 - 180.0
    (axes,) = drawn("places", joint(max_pressure_angle_deg=place))
    (line,) = curves(axes)
    y = line.get_ydata()
    assert np.nanmax(np.abs(np.diff(y))) < 180.0
    assert np.isnan(y).sum() == 1


def test_the_orbit_is_that_in_the_clearance_circle():
    one = joint()
    (axes,) = drawn("orbit", one)
    path, circle = curves(axes)
    angle, size = path.get_data()
    found = size * np.exp(1j * angle)
    x, y = (one.columns[f"eccentricity_in_bore_{axis}_m"] / CLEARANCE for axis in "xy")
    np.testing.assert_allclose(found, x + 1j * y, atol=1e-12)
    np.testing.assert_array_equal(circle.get_ydata(), 1.0)
    assert axes.get_ylim() == (0.0, 1.0)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_orbit_of_a_shaft_has_its_sense_of_rotation_and_a_mark_in_each_turn(sense):
    # Two turns of the shaft, which passes its angle 0 at the start, half way and at the end.
    one = joint(turned=sense * 2 * np.radians(TURN - TURN[0]))
    (axes,) = drawn("orbit", one)
    (marks,) = (line for line in axes.lines if str(line.get_label()).startswith("1x mark"))
    angle, size = marks.get_data()
    x, y = (one.columns[f"eccentricity_in_bore_{axis}_m"] / CLEARANCE for axis in "xy")
    orbit = x + 1j * y
    turns = np.abs(one.journal_angle) / (2 * np.pi)
    expected = [np.interp(n, turns, orbit) for n in range(int(turns[-1] + 1e-9) + 1)]
    np.testing.assert_allclose(size * np.exp(1j * angle), expected, atol=1e-12)
    (arrow,) = (text for text in axes.texts if getattr(text, "arrow_patch", None))
    assert np.sign(arrow.xy[0] - arrow.xyann[0]) == sense
    assert "rotation" in [text.get_text() for text in axes.texts]


def test_the_load_diagram_is_that_of_the_load_in_the_bore():
    one = joint()
    (axes,) = drawn("force", one)
    (path,) = curves(axes)
    angle, size = path.get_data()
    np.testing.assert_allclose(size, 1e-3 * one.columns["force_N"])
    np.testing.assert_allclose(np.degrees(angle), one.columns["force_angle_deg"], atol=1e-9)


def test_a_difference_is_that_at_equal_crank_angles():
    first = joint(max_pressure_Pa=1e6 * TURN)
    later = np.linspace(0.0, 360.0, 90)
    columns = {name: np.interp(later, TURN, values) for name, values in joint().columns.items()}
    second = joint(**columns | {"max_pressure_Pa": 1e6 * (1.5 * later + 10.0)})
    (axes,) = drawn("max_pressure", first, second, difference=True)
    (line,) = curves(axes)
    x, y = line.get_data()
    assert set(x) == set(TURN) | set(later)
    np.testing.assert_allclose(y, 0.5 * x + 10.0)
    assert "190 MPa at 360°" in axes.get_legend().get_texts()[0].get_text()


def test_a_difference_keeps_the_order_of_columns_and_tells_what_is_known():
    unknown = np.where(TURN < 90.0, np.nan, 0.0)
    errors = {
        f"{component}.film_error": size * TURN / 360.0 + unknown
        for component, size in (("step_size", 1e-3), ("film_mesh", 3e-3), ("start", 1e-4))
    }
    twice = {name: 2.0 * values for name, values in errors.items()}
    axes = drawn("error_budget", joint(**errors), joint(**twice), difference=True)
    message = [line.get_label() for line in curves(axes[-1])]
    assert message == [
        "step size: 0.1 % at 360°",
        "film mesh: 0.3 % at 360°",
        "start: 0.01 % at 360°",
    ]


def test_a_difference_of_vectors_is_that_of_components():
    first, second = joint(), joint(force_N=2 * joint().columns["force_N"])
    (axes,) = drawn("force", first, second, difference=True)
    along_x, along_y = curves(axes)
    columns = first.columns
    load = 1e-3 * columns["force_N"] * np.exp(1j * np.radians(columns["force_angle_deg"]))
    np.testing.assert_allclose(along_x.get_ydata(), load.real, atol=1e-12)
    np.testing.assert_allclose(along_y.get_ydata(), load.imag, atol=1e-12)


def filmed(width=0.02, cells=(8, 2), peak=0.0, run="one", **columns):
    """A joint with the fields of its film: pressure and gap waves that go around the bore."""
    grid = ehd.uniform_grid(0.025, width, cells)
    angle, height = grid.node_positions.T
    time = np.radians(TURN)[:, None]
    along = 1.0 - (2 * height / width) ** 2
    gap = CLEARANCE * (1 - 0.6 * np.cos(angle - time) + 0.1 * np.cos(2 * angle))
    pressure = 1e6 * (20 + peak) * np.maximum(np.cos(angle - time), 0.0) * along
    peak, thin = (x.argmax(axis=1) for x in (pressure, -gap))
    rows = np.arange(len(TURN))
    places = {
        "max_pressure_Pa": pressure[rows, peak],
        "max_pressure_angle_deg": np.degrees(angle[peak]),
        "max_pressure_height_m": height[peak],
        "min_film_thickness_m": gap[rows, thin],
        "min_film_angle_deg": np.degrees(angle[thin]),
        "min_film_height_m": height[thin],
    }
    one = joint(run=run, **places | columns)
    film = SimpleNamespace(radius=0.025, clearance=CLEARANCE, pressure=pressure, gap=gap)
    one.__dict__.update(film=film, grid=grid)
    return one


@pytest.mark.parametrize(("quantity", "sign"), [("pressure_map", 1), ("film_map", -1)])
def test_a_map_marks_the_extreme_of_all_nodes_and_steps(quantity, sign):
    one = filmed()
    axes, _ = drawn(quantity, one)
    values = {"pressure_map": 1e-6 * one.film.pressure, "film_map": 1e6 * one.film.gap}[quantity]
    worst = values.max() if sign > 0 else values.min()
    assert axes.get_title(loc="right").startswith(f"{worst:.4g} ")
    angle, height = one.grid.node_positions.T
    node = np.unravel_index((sign * values).argmax(), values.shape)[1]
    ((x, y),) = next(line for line in axes.lines if line.get_marker() == "o").get_xydata()
    found = (sign * values).max(axis=0)
    apart = (np.degrees(angle) - x + 180) % 360 - 180
    marked = np.isclose(apart, 0, atol=1e-6) & np.isclose(1e3 * height, y)
    assert marked.sum() == 1
    assert found[marked] == pytest.approx(found[node], rel=1e-12)


@pytest.mark.parametrize("quantity", ["pressure_map", "film_map"])
@pytest.mark.parametrize("cells", [(8, 2), (40, 8)])
def test_a_map_is_smooth_and_within_the_nodal_values(quantity, cells):
    one = filmed(cells=cells)
    factor, nodal = {
        "pressure_map": (1e-6, one.film.pressure.max(axis=0)),
        "film_map": (1e6, one.film.gap.min(axis=0)),
    }[quantity]
    values, angle, height, *_ = QUANTITIES[quantity].raster(one, "")
    assert len(angle) > 240
    assert len(height) > 48
    assert values.max() == pytest.approx(factor * nodal.max(), rel=1e-12)
    assert values.min() == pytest.approx(factor * nodal.min(), rel=1e-6)
    for (where, z), value in zip(one.grid.node_positions, factor * nodal, strict=True):
        turn = (np.degrees(where) + 180.0) % 360.0 - 180.0
        row, column = np.abs(height - 1e3 * z).argmin(), np.abs(angle - turn).argmin()
        assert abs(angle[column] - turn) < 1e-6
        assert values[row, column] == pytest.approx(value, rel=1e-6, abs=1e-6)


def test_a_marked_extreme_is_that_of_the_summary():
    found = {
        "cycle_max_pressure_Pa": 40.1e6, "cycle_max_pressure_crank_angle_deg": 91.5,
        "cycle_min_film_thickness_m": 1.9e-6, "cycle_min_film_crank_angle_deg": 180.5,
    }  # fmt: skip
    one = joint(figures={"big_end": found})
    for quantity, point in (("max_pressure", (91.5, 40.1)), ("min_film_thickness", (180.5, 1.9))):
        (axes,) = drawn(quantity, one)
        (mark,) = (line for line in axes.lines if line.get_marker() == "o")
        np.testing.assert_allclose(mark.get_xydata(), [point])
    # A difference has its own extreme.
    (axes,) = drawn("max_pressure", one, joint(figures={"big_end": found}), difference=True)
    (mark,) = (line for line in axes.lines if line.get_marker() == "o")
    assert mark.get_ydata() == [0.0]


@pytest.mark.parametrize(
    ("height", "text"), [(4e-16, "z = 0 mm"), (-1.2345, "z = -1.23 mm"), (-1e-9, "z = 0 mm")]
)
def test_a_height_is_rounded_to_the_width_of_the_bore(height, text):
    heights = np.linspace(-10.0, 10.0, 5)
    raster = bores.Raster(np.eye(5), 45.0 * np.arange(5), heights, "", (1.0, 90.0, height))
    figure = bores.draw_rasters([[raster]], "pressure [MPa]", "YlOrRd")
    assert figure.axes[0].get_title(loc="right").endswith(f"at 90°, {text}")
    plt.close(figure)


def test_circles_are_labelled_away_from_the_curves():
    arc = 0.7 * np.exp(1j * np.radians(np.linspace(-130.0, 170.0, 60)))
    assert emptiest_direction([arc], 1.0) == 202.5


def test_angles_of_diagrams_are_from_minus_180_to_180_degrees():
    (axes,) = drawn("orbit", joint())
    labels = [label.get_text().removesuffix("°") for label in axes.get_xticklabels()]
    assert sorted(map(int, labels)) == list(range(-135, 181, 45))


def test_the_axis_names_the_body_that_turns():
    (axes,) = drawn("max_pressure", joint())
    assert axes.get_xlabel() == "crank angle [°]"
    one = joint()
    one.run.angle_name = angle_name("shaft")
    (axes,) = drawn("max_pressure", one)
    assert axes.get_xlabel() == "angle of the shaft [°]"


@pytest.mark.parametrize("quantity", ["max_pressure", "orbit", "force", "eccentricity"])
def test_differences_are_labelled_as_such(quantity):
    (axes,) = drawn(quantity, joint(), joint(), difference=True)
    assert axes.get_ylabel().startswith("difference of")
    assert axes.get_ylim()[0] <= 0.0 <= axes.get_ylim()[1]


def test_joints_of_one_run_share_a_diagram_under_their_names():
    one = joint("front")
    two = replace(joint("back"), run=one.run)
    for quantity in ("max_pressure", "orbit"):
        figure = QUANTITIES[quantity].draw({"": [one, two]})
        texts = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
        plt.close(figure)
        assert [text.partition(":")[0] for text in texts][:2] == ["front", "back"]


def test_between_drawn_bore_and_journal_lies_the_film():
    one = filmed()
    film = one.film
    for step in (0, 17):
        gap, _, place = bores.profile(one, step)
        angle = np.linspace(-np.pi, np.pi, len(gap))
        bore = bores.outward(gap, place, film.clearance)
        e = place[0] * np.cos(angle) + place[1] * np.sin(angle)
        np.testing.assert_allclose(film.clearance + bore - e, gap, atol=1e-18)
        # The bore's own centre: no first harmonic is left in its shape.
        assert abs(np.mean(bore[:-1] * np.exp(1j * angle[:-1]))) < 1e-12 * film.clearance * 1e3
        assert np.hypot(*place) == pytest.approx(0.6 * CLEARANCE, rel=1e-3)  # of the mesh


def test_energies_are_those_exchanged_and_lost():
    angle = np.radians(TURN)
    stored = 100 + np.sin(angle)
    whole = joint(
        "", stored_energy_J=stored - stored[0], drive_work_J=np.sin(angle),
        applied_work_J=0 * angle, film_work_J=2 * angle, damping_work_J=angle,
        energy_defect_J=1e-4 * angle,
    )  # fmt: skip
    panels = drawn("energy", whole)
    names = [[line.get_label() for line in curves(axes)] for axes in panels]
    # What nothing was exchanged by is not in the legend.
    assert names == [
        ["kinetic and strain energy", "drive"],
        ["film", "structural damping"],
        ["defect of the balance"],
    ]


def test_the_basis_error_is_drawn_where_it_is_known():
    known = joint(basis_error_estimate_m=1e-8 * (2 + np.sin(np.radians(TURN))))
    assert QUANTITIES["basis_error"].has(known)
    assert not QUANTITIES["basis_error"].has(joint(basis_error_estimate_m=np.nan * TURN))
    (axes,) = drawn("basis_error", known)
    assert axes.get_yscale() == "log"
    assert len(curves(axes)) == 2
    axes.figure.canvas.draw()
    assert {"0.01", "0.1", "1"} <= {label.get_text() for label in axes.get_yticklabels()}
    # Round-off before the first estimate does not stretch the axis.
    errors = np.where(TURN < 1.0, 1e-20, 1e-8)
    (axes,) = drawn("basis_error", joint(basis_error_estimate_m=errors))
    low, high = axes.get_ylim()
    assert high / low < 2e5


def test_the_command_and_its_page_name_every_quantity(capsys):
    assert plot("--help") == 0
    message = capsys.readouterr().out
    page = (Path(__file__).parents[1] / "docs" / "pictures.md").read_text()
    for name in QUANTITIES:
        assert name in message
        assert f"`{name}`" in page


def shown_run(monkeypatch, time, angle, cycle=None, **summary):
    """A run in memory whose peak pressure is its step's number [MPa]."""
    steps = np.arange(len(time))
    units = {
        "time": "s", "run/time": "s", "run/crank_angle": "deg", "joints/a/max_pressure": "Pa",
        "run/cycle": "1", "run/cycle_time": "s", "state/coordinates": "m", "state/rates": "m/s",
    }  # fmt: skip
    values = {"time": time, "run/time": time, "run/crank_angle": angle}
    values |= {"joints/a/max_pressure": 1e6 * steps}
    values |= {f"state/{name}": np.zeros((len(time), 1)) for name in ("coordinates", "rates")}
    if cycle is not None:
        start = [time[cycle < n].max(initial=time[0] if n > 1 else 0.0) for n in cycle]
        values |= {"run/cycle": cycle, "run/cycle_time": time - start}
    found = {path: Quantity(np.asarray(v, float), units[path]) for path, v in values.items()}
    message = {"joint": "a", **summary} if summary else {}
    result = ehd.History(found, ("joints/a/eccentricity_x",), ("m",), message)
    monkeypatch.setattr(shown, "load_history", lambda _: result)
    run = ShownRun("", "folder")
    return run, run.joints["a"].columns


WHOLE, FIRST = "whole run: no full cycle", "first cycle: films build up"


@pytest.mark.parametrize(
    ("time", "angle", "cycle", "summary", "shown", "message"),
    [
        # Periodic: as it is recorded.
        ([2.0, 2.5, 4.0], [40.0, 200.0, 760.0], [2, 2, 2],
         {"cycle_used": "last of 2", "cycle_start_s": 2.0, "cycle_end_s": 4.0},
         [(0.0, 0.0, 40.0), (0.5, 1.0, 200.0), (2.0, 2.0, 760.0)], ""),
        # A search that was stopped: from the end of the cycle before its last whole one on. No
        # chord closes what does not repeat itself.
        ([0.5, 1.0, 1.5, 2.0, 2.5], [180.0, 360.0, 540.0, 720.0, 900.0], [1, 1, 2, 2, 3],
         {"cycle_used": "last of 2", "cycle_start_s": 1.0, "cycle_end_s": 2.0},
         [(0.0, 1.0, 0.0), (0.5, 2.0, 180.0), (1.0, 3.0, 360.0)], ""),
        # One that was killed has no summary.
        ([0.5, 1.0, 1.5, 2.0, 2.5], [180.0, 360.0, 540.0, 720.0, 900.0], [1, 1, 2, 2, 3], {},
         [(0.0, 1.0, 0.0), (0.5, 2.0, 180.0), (1.0, 3.0, 360.0)], ""),
        ([0.5, 1.0, 1.5], [180.0, 360.0, 540.0], [1, 1, 1],
         {"cycle_used": FIRST, "cycle_start_s": 0.0, "cycle_end_s": 1.5},
         [(0.5, 0.0, 180.0), (1.0, 1.0, 360.0), (1.5, 2.0, 540.0)], FIRST),
        # Another run: its last full cycle from its start, between two steps.
        ([1.0, 2.0, 3.0, 4.0], [540.0, 720.0, 900.0, 1080.0], None,
         {"cycle_used": "last of 2", "cycle_start_s": 2.5, "cycle_end_s": 4.0},
         [(0.0, 1.5, 90.0), (0.5, 2.0, 180.0), (1.5, 3.0, 360.0)], ""),
        # A cycle of two turns, from its second one on: no other stroke. Backwards, too.
        ([2.0, 2.2, 3.0, 4.0], [1080.0, 1090.0, 1450.0, 1800.0], None,
         {"cycle_used": "last of 1", "cycle_start_s": 2.0, "cycle_end_s": 4.0},
         [(0.0, 0.0, 360.0), (0.2, 1.0, 370.0), (1.0, 2.0, 730.0), (2.0, 3.0, 1080.0)], ""),
        ([2.0, 2.2, 3.0, 4.0], [0.0, -10.0, -350.0, -720.0], [2, 2, 2, 2],
         {"cycle_used": "last of 2", "cycle_start_s": 2.0, "cycle_end_s": 4.0},
         [(0.0, 0.0, 0.0), (0.2, 1.0, -10.0), (1.0, 2.0, -350.0), (2.0, 3.0, -720.0)], ""),
        ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0], None,
         {"cycle_used": WHOLE, "cycle_start_s": 0.0, "cycle_end_s": 3.0},
         [(1.0, 0.0, None), (2.0, 1.0, None), (3.0, 2.0, None)], WHOLE),
    ],
    ids=["periodic", "search", "killed", "first cycle", "full cycle", "two turns",
         "backwards", "no full cycle"],
)  # fmt: skip
def test_the_cycle_that_is_shown(time, angle, cycle, summary, shown, message, monkeypatch):
    cycle = None if cycle is None else np.array(cycle)
    run, columns = shown_run(monkeypatch, np.array(time), np.array(angle), cycle, **summary)
    clock, pressure, turned = (list(values) for values in zip(*shown, strict=True))
    assert columns["time_s"].tolist() == pytest.approx(clock)
    assert (1e-6 * columns["max_pressure_Pa"]).tolist() == pytest.approx(pressure)
    if turned[0] is None:
        assert "crank_angle_deg" not in columns
    else:
        assert columns["crank_angle_deg"].tolist() == turned
    assert run.label == message
    # Films build up over a first cycle: the axis names it.
    assert run.starts == bool(message)
    (axes,) = drawn("max_pressure", run.joints["a"])
    assert axes.get_xlabel().endswith(f", {message}" if message else "]")


@pytest.fixture(scope="module")
def bearings(two_bearings, tmp_path_factory):
    """Two bearings of one shaft, which are equal: a copy, to which pictures are added."""
    folder = tmp_path_factory.mktemp("bearings") / "run"
    return stored_run(copytree(two_bearings.directory, folder))


plot = partial(call, "plot")


def test_numbers_in_pictures_are_those_of_the_summary(bearings):
    """Extremes between the steps and means over time, with the same four digits."""
    pictures = Pictures({"": bearings.directory})
    summary = json.loads((bearings.directory / "summary.json").read_text())["joints"]["left"]
    for quantity, entry, factor in (
        ("max_pressure", "cycle_max_pressure_Pa", 1e-6),
        ("min_film_thickness", "cycle_min_film_thickness_m", 1e6),
        ("specific_load", "cycle_max_specific_load_Pa", 1e-6),
        ("eccentricity", "cycle_max_eccentricity_ratio", 1.0),
        ("friction", "mean_friction_power_W", 1.0),
        ("friction", "mean_friction_torque_Nm", 1.0),
        ("flow", "mean_side_flow_m3_per_s", 1e6),
    ):
        figure = pictures.figure(quantity)
        texts = [text.get_text() for axes in figure.axes for text in axes.get_legend().get_texts()]
        assert any(f"{factor * summary[entry]:.4g} " in f"{text} " for text in texts), entry
        plt.close(figure)
    shown = ShownRun("", bearings.directory)
    extreme = shown.joints["left"].extreme("max_pressure_Pa", TIME)
    assert extreme == (1e3 * summary["max_pressure_time_s"], summary["max_pressure_Pa"])
    assert shown.time_name == "time"


def test_the_command_draws_what_is_asked_for(bearings, tmp_path, capsys):
    out = tmp_path / "pictures"
    chosen = ["--joint", "left", "--quantity", "force", "--quantity", "film_map"]
    assert plot(bearings.directory, *chosen, "-o", out) == 0
    files = [out / f"{n}-left.{s}" for n in ("force", "film_map") for s in ("png", "svg")]
    assert capsys.readouterr().out.split() == [str(path) for path in files]
    assert set(out.iterdir()) == {*files, out / "manifest.txt"}
    # The same every time; without a choice, all that there is.
    again = Pictures({"": bearings.directory}, ["left"]).draw("film_map", tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in files[2:]]
    names = set(Pictures({"": bearings.directory}).names)
    assert {"max_pressure", "orbit", "force", "film_map", "bore", "energy"} <= names
    assert {"friction", "flow", "specific_load"} <= names
    assert not {"contact", "oil_content"} & names


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--quantity", "contact"], "--quantity contact: no such quantity in"),
        (["--quantity", "speed"], "choose from max_pressure, min_film_thickness, orbit, force"),
        (["--joint", "middle"], "has no such lubricated joint: choose"),
        (["--joint", "middle"], "choose from left, right"),
        (["--difference"], "--difference needs 2 runs"),
    ],
)
def test_what_is_not_there_is_named_with_what_there_is(
    arguments, message, bearings, tmp_path, capsys
):
    assert plot(bearings.directory, *arguments, "-o", tmp_path / "none") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert not (tmp_path / "none").exists()


def test_the_error_budget_is_drawn_by_component(bearings, tmp_path):
    run = copytree(bearings.directory, tmp_path / "run")
    assert "error_budget" in Pictures({"": run}).names
    (run / "error_budget.json").unlink()
    assert "error_budget" not in Pictures({"": run}).names
    time = [0.0, 1e-3, 2e-3]
    over = {
        "time_s": time, "max_pressure_Pa": [1e6, 4e6, 2e6], "min_film_thickness_m": [4e-6] * 3,
        "more_max_pressure_Pa": [0.0, 4e4, 0.0], "more_min_film_thickness_m": [1e-8] * 3,
    }  # fmt: skip
    (run / "error_budget.json").write_text(json.dumps({"left": {"film_mesh": over}}))
    joints = ShownRun("", run).joints
    assert QUANTITIES["error_budget"].has(joints["left"])
    assert not QUANTITIES["error_budget"].has(joints["right"])
    pressure, film = drawn("error_budget", joints["left"])
    (line,) = curves(pressure)
    assert line.get_label() == "film mesh"
    expected = np.interp(joints["left"].columns["time_s"], time, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(line.get_ydata(), expected, atol=1e-12)
    np.testing.assert_allclose(curves(film)[0].get_ydata(), 0.25)
    # Times of the budget count from the run's start, those of the picture from the cycle's.
    summary = json.loads((run / "summary.json").read_text())
    middle = 0.5 * summary["cycle_end_s"]
    with edited(run) as file:
        file["cycle"].attrs["start"] = middle
    late = ShownRun("", run).joints["left"].columns
    assert late["time_s"][0] == 0.0
    expected = 0.01 * np.interp(middle + late["time_s"], time, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(late["film_mesh.pressure_error"], expected, atol=1e-12)
    (run / "error_budget.json").write_text("[]")
    with pytest.raises(ehd.errors.InputError, match="not the error budget"):
        Pictures({"": run}).draw("error_budget", tmp_path)


def test_two_runs_share_their_panels(bearings, tmp_path, capsys):
    same = copytree(bearings.directory, tmp_path / "same")
    chosen = ("--difference", "--quantity", "orbit", "-o", tmp_path)
    assert plot(bearings.directory, same, *chosen) == 0
    assert (tmp_path / "orbit-difference.svg").is_file()
    own = bearings.directory / "max_pressure.png"
    assert plot(bearings.directory, "--quantity", "max_pressure") == 0
    before = own.read_bytes()
    capsys.readouterr()
    assert plot(bearings.directory, same, "--quantity", "max_pressure") == 0
    names = [Path(name).name for name in capsys.readouterr().out.split()]
    assert names == ["max_pressure-comparison.png", "max_pressure-comparison.svg"]
    assert own.read_bytes() == before
    assert plot(bearings.directory, same, "--difference", "--quantity", "bore") == 2
    assert "no difference of this quantity" in capsys.readouterr().err


def test_runs_without_a_joint_in_common_have_no_difference(bearings, tmp_path, capsys):
    other = copytree(bearings.directory, tmp_path / "other")
    history = ehd.load_history(other)
    moved = partial(re.sub, "joints/(left|right)/", r"joints/\1most/")
    values = {moved(path): own for path, own in history.values.items()}
    replace(history, values=values).save(other)
    assert plot(bearings.directory, other, "--difference", "-o", tmp_path / "none") == 2
    message = capsys.readouterr().err
    assert "left, right in the first, leftmost, rightmost in the second" in message


def test_a_run_leaves_what_needs_only_its_history_and_a_later_one_takes_it(bearings, monkeypatch):
    def not_rendered(figure, directory, name):
        plt.close(figure)
        return [directory / f"{name}.{ending}" for ending in ("png", "svg")]

    monkeypatch.setattr("fenics_ehd.plotting.pictures.save_in_formats", not_rendered)
    paths = plot_run(bearings.directory)
    names = {path.stem for path in paths}
    assert names >= {"max_pressure", "min_film_thickness", "orbit", "force", "energy"}
    assert names <= set(OF_EVERY_RUN)
    assert not {"film_map", "bore"} & names
    for ending in ("png", "svg"):
        assert {f"{name}.{ending}" for name in OF_EVERY_RUN} <= set(MADE)
