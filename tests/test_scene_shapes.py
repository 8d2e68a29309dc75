"""Shapes in scene files and on the command line: tables, refusals, runs that go on."""

import json

import numpy as np
import pytest
from command_line import exit_of
from scene_cases import RIGID_ROD, tables_of, write_scene
from stopped_steps import assert_goes_on

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.run import Run
from fenics_ehd.scenes.scene import scene_of, scene_text
from fenics_ehd.scenes.shape_tables import read_shape_table, require_covering

WIDTH, CLEARANCE = 0.022, 17e-6


def mechanism_of(**changes):
    keys = {f"joints.big_end.{key}": value for key, value in changes.items()}
    scene = scene_of(tables_of("slider-crank-paper", RIGID_ROD | keys), "scene")
    return ehd.build(scene).mechanism


def rows(angles, heights, function):
    lines = [f"{a},{z},{function(a, z):.9g}" for a in angles for z in heights]
    return "\n".join(["angle_deg,height_mm,deviation_um", *lines])


def oval(angle, _height):
    return 3 * np.cos(2 * np.radians(angle))


# --- Tables

QUARTERS, METRES = (0, 90, 180, 270), "angle_deg,height_m,deviation_m\n"


def test_a_table_is_the_shape_that_it_was_made_of(tmp_path):
    path, angles = tmp_path / "oval.csv", range(0, 360, 5)
    for last in (angles, [*angles, 360]):
        path.write_text(rows(last, (-11, 11), oval))
        shape = read_shape_table(path, "table")
        phi = np.linspace(-4, 9, 300)
        np.testing.assert_allclose(
            shape.radial(phi, 0.003), ehd.Shape(ovality=3e-6).radial(phi, 0.003), atol=2e-11
        )


def test_rows_of_a_table_may_come_in_any_order(tmp_path):
    path = tmp_path / "shape.csv"
    text = rows(range(0, 360, 30), (-11, 0, 11), lambda a, z: oval(a, z) + 0.1 * z)
    path.write_text(text)
    first = read_shape_table(path, "table")
    header, *lines = text.splitlines()
    path.write_text("\n".join([header, *reversed(lines)]))
    again = read_shape_table(path, "table")
    assert np.array_equal(first.deviations, again.deviations)
    assert first.radial(0.5, 0.011) - first.radial(0.5, -0.011) == pytest.approx(2.2e-6)


def covering_table(path):
    """Read a table, and check that it covers the bearing."""
    table = read_shape_table(path, "a.table")
    require_covering(table, f"a.table {path}", WIDTH, CLEARANCE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (rows((0, 90, 180), (-11, 11), oval), "3 angles: give at least 4"),
        (rows((0, 90, 180, 270), (-11, 11), oval) + "\n90,-11,1", "one row for every angle"),
        (rows((0, 90, 180, 270), (-11, 5), oval), "must cover the bearing's width"),
        (rows((0, 90, 180, 270, 380), (0,), oval), "span 380 deg"),
        (rows((0, 90, 180, 270, 360), (0,), lambda a, _: a), "differ"),
        # Millimetres or micrometres that are called metres.
        (METRES + rows(QUARTERS, (-11, 11), oval).partition("\n")[2], "heights of 22 m.*height_mm"),
        (METRES + rows(QUARTERS, (0,), oval).partition("\n")[2], "deviations of 3 m.*deviation_um"),
        ("angle_deg,height_mm\n1,2", "no column deviation"),
        (rows((0, 90, 180, 270), (0,), lambda *_: np.nan), "finite number"),
    ],
)
def test_tables_that_are_none_are_refused(tmp_path, text, message):
    path = tmp_path / "shape.csv"
    path.write_text(text)
    with pytest.raises(ehd.errors.SettingsError, match=f"a.table .*shape.csv.*{message}"):
        covering_table(path)


# --- Scenes


def test_a_scene_lists_what_is_not_round(tmp_path):
    (tmp_path / "oval.csv").write_text(rows(range(0, 360, 5), (0,), oval))
    path = write_scene(
        tmp_path / "scene.toml", "slider-crank-paper", RIGID_ROD,
        {
            "joints.big_end.bore_shape.table": "oval.csv",
            "joints.big_end.journal_shape.ovality": 2e-6,
            "joints.big_end.journal_shape.ovality_angle": 30.0,
            "joints.big_end.journal_shape.barrel": -1e-6,
        },
    )  # fmt: skip
    scene = ehd.read_scene(path)
    joint = ehd.build(scene).mechanism.joints["big_end"]
    assert joint.bore_shape.radial(0.0, 0.0) == pytest.approx(3e-6)
    assert joint.journal_shape.radial(np.radians(30), WIDTH / 2) == pytest.approx(1e-6)
    # Stored and read again.
    (tmp_path / "again.toml").write_text(scene_text(scene))
    again = ehd.read_scene(tmp_path / "again.toml").joints["big_end"]
    assert again == scene.joints["big_end"]
    plain = mechanism_of().joints["big_end"]
    assert (plain.bore_shape, plain.journal_shape) == (None, None)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bore_shape.ovality": 18e-6}, r"bore_shape.ovality = 1.8e-05 m closes.*1.7e-05"),
        ({"journal_shape.ovality": -17e-6}, "journal_shape.ovality = -1.7e-05 m closes"),
        ({"bore_shape.ovality": 3.0}, "bore_shape.ovality = 3.0 must be below.*in m"),
        ({"bore_shape.lobes": 0}, "lobes = 0 must be a whole number"),
        ({"bore_shape.oval": 1e-6}, "unknown key joints.big_end.bore_shape.oval"),
        ({"journal_shape.table": "none.csv"}, "journal_shape.table .*none.csv: No such file"),
    ],
)
def test_shapes_that_cannot_be_are_refused(changes, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        mechanism_of(**changes)


def test_shapes_that_close_the_gap_together_are_refused_at_the_start():
    # Both are below the clearance; the journal is narrow where the bore is wide.
    apart = mechanism_of(**{"bore_shape.ovality": 10e-6, "journal_shape.ovality": -10e-6})
    with pytest.raises(ehd.errors.SettingsError, match=r"joints\.big_end\.bore_shape.*-3 um"):
        Run(apart, IntegratorOptions(), 1e-3)


def test_a_run_with_shapes_and_friction_goes_on_bitwise():
    changes = {
        "bore_shape.ovality": 3e-6, "journal_shape.ovality": 4e-6, "friction": True,
        "shear_rule": "full",
    }  # fmt: skip
    assert_goes_on(mechanism_of(**changes), IntegratorOptions(tolerance=1e-3), 2e-4)


# --- The command


def test_the_command_takes_shapes(tmp_path, capfd):
    table = tmp_path / "oval.csv"
    table.write_text(rows(range(0, 360, 5), (0,), oval))
    found = {}
    for name, options in {
        "round": [], "oval": ["--ovality", "3e-6"], "table": ["--shape-table", str(table)],
        "turned": ["--ovality", "-3e-6", "--ovality-angle", "90"],
        "crowned": ["--barrel", "4e-6", "--taper", "1e-6"],
    }.items():  # fmt: skip
        arguments = ("bearing", "--load", 800, "--cells", "32x4", "--json", *options)
        status, output, _ = exit_of(capfd, *arguments)
        assert not status
        found[name] = json.loads(output)["min_film_thickness_m"]
    assert found["oval"] == pytest.approx(found["turned"], rel=1e-9)
    assert found["oval"] == pytest.approx(found["table"], rel=1e-4)
    assert len({round(value, 9) for value in found.values()}) == 3
    for option in ("--ovality", "--taper"):
        status, _, reported = exit_of(capfd, "bearing", "--load", 8, option, 2e-5)
        assert status == 2
        assert "the gap" in reported
