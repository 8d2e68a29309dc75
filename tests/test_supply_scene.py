"""Supplies of a scene's films: read, refused, run."""

import json
import re
from copy import deepcopy

import numpy as np
import pytest
from command_line import call
from scene_cases import LOAD, LOADED_JOURNAL, tables_of, write_scene
from scipy.interpolate import CubicSpline

import fenics_ehd as ehd
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.scenes.films import build_film
from fenics_ehd.scenes.inputs import supplies_of
from fenics_ehd.scenes.scene import scene_of

AT = "joints.bearing.supply"

#: A hole in the journal behind a passage, and a groove around the bore.
FED = {
    "joints.bearing.cells": [32, 8],
    f"{AT}.inlet": {
        "kind": "hole", "on": "journal", "angle": 90, "diameter": 6e-3, "pressure": 3e5,
        "resistance": 1e11,
    },
    f"{AT}.groove": {"kind": "circumferential-groove", "width": 5e-3, "table": "supply.csv"},
}  # fmt: skip

PRESSURES = "time_s,pressure_bar\n0,1\n5e-3,3\n20e-3,1\n"


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Mechanism of the shipped loaded journal with changes."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "supply.csv").write_text(PRESSURES)
    (tmp_path / "load.csv").write_text(LOAD)

    def make(changes):
        scene = scene_of(
            tables_of("loaded-journal", LOADED_JOURNAL | deepcopy(FED) | changes), "case"
        )
        return ehd.build(scene).mechanism

    return make


def test_supplies_are_those_of_the_scene(made):
    mechanism = made({})
    inlet, groove = mechanism.joints["bearing"].film.parameters.feeds
    assert inlet == ehd.HoleSupply(
        name="inlet", on="journal", angle=90, diameter=6e-3, pressure=3e5, resistance=1e11
    )
    assert inlet.pressure_at(1.0) == 3e5
    assert isinstance(groove, ehd.CircumferentialGrooveSupply)
    assert groove.closed
    assert not groove.on_journal
    # Over and over, as all in a periodic scene; no step jumps over its rows.
    assert [groove.pressure_at(t) for t in (0.0, 5e-3, 25e-3)] == pytest.approx([1e5, 3e5, 3e5])
    assert any(load.curve is groove.curve for load in System(mechanism).tables)


WRONG = [
    ({f"{AT}.inlet.kind": "whole"}, r"inlet.kind = 'whole': did you mean hole"),
    ({f"{AT}.inlet.kind": None}, r"bearing.supply.inlet.kind is missing: one of hole"),
    ({f"{AT}.inlet.diamter": 1e-3}, r"unknown key .*supply.inlet.diamter of kind .*NAME.diameter"),
    ({f"{AT}.inlet.pressure": -1e5}, r"supply.inlet.pressure = -100000.0 must be at least 0"),
    ({f"{AT}.inlet.on": "shaft"}, r"inlet.on = 'shaft' must be one of bore, journal"),
    ({f"{AT}.groove.pressure": 1e5}, r"supply.groove: give either a pressure or a table"),
    ({f"{AT}.groove.width": None}, r"joints.bearing.supply.groove.width is missing"),
    ({AT: 3}, r"joints.bearing.supply = 3 must be tables: \[joints.bearing.supply.NAME\]"),
    ({AT: {"inlet": 3}}, r"joints.bearing.supply.inlet = 3 must be a table"),
    ({AT: {"in let": {"kind": "hole"}}}, r"a name must consist of letters, digits, _ and -"),
    # what bearing and mesh cannot hold
    ({f"{AT}.inlet.diameter": 0.02}, r"supply.inlet reaches from z = -10 to 10 mm, the bearing"),
    ({f"{AT}.inlet.height": 9e-3}, r"so that land remains at both sides"),
    ({f"{AT}.inlet.diameter": 1e-3}, r"size of 1 mm, below the cell size .* = \[158, 20\]"),
    ({f"{AT}.groove.width": 19e-3}, r"supply.groove has a land of 0.5 mm, below"),
]  # fmt: skip


def test_cells_that_grooves_stretch_must_hold_a_hole_before_anything_is_reduced():
    groove = {"joints.bearing.grooves": [[101.0, 30.0, 1e5]], f"{AT}.inlet.on": "bore"}
    hole = {
        f"{AT}.inlet.diameter": 6.3e-3,
        f"{AT}.inlet.angle": 0.0,
        "joints.bearing.cells": [25, 8],
    }
    scene = scene_of(
        tables_of("loaded-journal", deepcopy(FED) | {f"{AT}.groove": None} | hole | groove), "case"
    )
    with pytest.raises(
        ehd.errors.SettingsError, match=r"^joints.bearing.supply.inlet has a size of 6.3 mm"
    ):
        build_film(scene, "bearing", None, 300.0, supplies_of(scene, "bearing"))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"pressure": 0.0}, r"supply\.inlet\.pressure is 0"),
        ({"resistance": 1e15}, r"supply\.inlet\.resistance = 1e\+15 Pa s/m3 lets at most 0\.0003"),
        ({}, None),
    ],
)
def test_a_supply_that_is_shut_is_named_in_one_line(change, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "load.csv").write_text(LOAD)
    inlet = FED[f"{AT}.inlet"] | change
    changes = {"joints.bearing.cells": [32, 8], f"{AT}.inlet": inlet}
    built = ehd.build(scene_of(tables_of("loaded-journal", LOADED_JOURNAL | changes), "case"))
    lines = [line for line in built.warnings if "no oil enters" in line]
    assert len(lines) == (text is not None)
    if text:
        assert re.search(
            rf"^joints\.bearing: no oil enters through 1 of its openings: {text}", lines[0]
        )


def fed_pin(speed, **changes):
    """Supply of the crank's pin, 3 bar at the begin of its drilling, at a speed of the crank."""
    hole = {"kind": "hole", "on": "journal", "diameter": 6e-3, "angle": 90.0, "pressure": 3e5}
    changes = {
        "joints.big_end.supply.inlet": hole | changes,
        "joints.big_end.cells": [40, 8],
        "lubricants.oil.density": 850.0,
        **speed,
    }
    scene = scene_of(tables_of("slider-crank", changes), "case")
    (supply,) = supplies_of(scene, "big_end")
    return supply


def rotating_column(density, radii, speed):
    """Pressure between the ends of a rotating column of oil: the sum of its slices' weights."""
    edges = np.linspace(*radii, 1001)
    middles = 0.5 * (edges[1:] + edges[:-1])
    return float(np.sum(density * middles * speed**2 * np.diff(edges)))


@pytest.mark.parametrize(
    ("radii", "speed"), [((0.0, 48e-3), 500.0), ((22e-3, 48e-3), -500.0), ((48e-3, 20e-3), 200.0)]
)
def test_oil_in_a_drilling_of_the_crank_has_the_pressure_of_a_rotating_column(radii, speed, figure):
    supply = fed_pin({"drives.crank.speed": speed}, head_radius=list(radii))
    rise = supply.pressure_at(0.0) - 3e5
    expected = rotating_column(850.0, radii, speed)
    name = f"pressure rise in a drilling, {1e3 * radii[0]:g} to {1e3 * radii[1]:g} mm"
    figure("supply", name, abs(rise / expected - 1), most=1e-9)
    if radii[0] == 0.0:
        assert rise == pytest.approx(2.4e5, rel=0.03)


def test_pressure_in_a_drilling_follows_a_speed_over_time(tmp_path):
    table = tmp_path / "speed.csv"
    table.write_text("time_s,speed_rad_per_s\n0,300\n5e-3,500\n1,500\n")
    speed = {"drives.crank.speed": None, "drives.crank.table": str(table)}
    speed |= {"time.periodic": False, "time.revolutions": None, "time.end": 0.01}
    supply = fed_pin(speed, head_radius=[0.0, 48e-3])
    assert supply.pressure_at(0.0) - 3e5 == pytest.approx(
        rotating_column(850.0, (0.0, 48e-3), 300.0)
    )
    assert supply.pressure_at(0.5) - 3e5 == pytest.approx(
        rotating_column(850.0, (0.0, 48e-3), 500.0)
    )


@pytest.mark.parametrize(
    ("speed", "changes", "message"),
    [
        (500.0, {"head_radius": [-1e-3, 48e-3]}, "must be two distances from the axis"),
        (500.0, {"head_radius": [48e-3]}, "head_radius = .* must be two finite numbers"),
        (
            500.0,
            {"head_radius": [48e-3, 0.0], "pressure": 1e5},
            "gives -.* Pa at the film",
        ),
        (
            500.0,
            {"on": "bore", "head_radius": [0.0, 48e-3]},
            "needs the speed of rod, the body",
        ),
    ],
)
def test_a_drilling_whose_pressure_is_unknown_or_negative_is_refused(speed, changes, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        fed_pin({"drives.crank.speed": speed}, **changes)


@pytest.mark.parametrize(("changes", "message"), WRONG)
def test_what_a_scene_cannot_say_of_a_supply(made, changes, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        made(changes)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (PRESSURES.replace("3\n", "-3\n"), r"groove.table .* has a pressure of -300000 Pa: "),
        (PRESSURES.replace("20e-3,1", "20e-3,2"), r"the last row \(200000\) differs from the"),
        (PRESSURES.replace("bar", "psi"), r"column 'pressure_psi' needs a unit"),
    ],
)
def test_tables_that_are_none(made, tmp_path, table, message):
    (tmp_path / "supply.csv").write_text(table)
    with pytest.raises(ehd.errors.SettingsError, match=message):
        made({})


def test_a_supply_of_another_period_than_the_cycle_is_refused_before_anything_is_meshed(tmp_path):
    table = tmp_path / "supply.csv"
    table.write_text(PRESSURES)
    hole = {"kind": "hole", "diameter": 4e-3, "table": str(table)}
    scene = scene_of(tables_of("slider-crank", {"joints.big_end.supply.inlet": hole}), "case")
    begun = []
    text = (
        r"^joints\.big_end\.supply\.inlet repeats 0\.628318\d* times in the cycle of 0\.0125664 s"
    )
    with pytest.raises(ehd.errors.SettingsError, match=text):
        ehd.build(scene, announce=begun.extend)
    assert not begun


def test_a_run_tells_the_flow_of_every_supply(tmp_path):
    short = {
        "joints.bearing.cells": [24, 5],
        f"{AT}.inlet.diameter": 8e-3,
        "time.periodic": False,
        "time.period": None,
        "time.end": 2e-3,
    }
    path = write_scene(
        tmp_path / "case.toml", "loaded-journal", LOADED_JOURNAL, deepcopy(FED), short
    )
    (tmp_path / "supply.csv").write_text(PRESSURES)
    assert call("run", path, "--no-plots", "--no-error-budget", "-o", tmp_path / "out") == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    figures = summary["joints"]["bearing"]
    names = [f"{name}flow_m3_per_s" for name in ("inlet.", "groove.", "side_")]
    means = [figures[f"mean_{name}"] for name in names]
    header, *rows = (tmp_path / "out" / "history.csv").read_text().splitlines()
    columns = dict(zip(header.split(","), np.loadtxt(rows, delimiter=",").T, strict=True))
    assert means[-1] > 0.0  # holes and grooves take oil as well where the film bears the load
    for name, mean in zip(names, means, strict=True):
        flow = columns[f"bearing.{name}"]
        time = columns["time_s"]
        expected = CubicSpline(time, flow).integrate(*time[[0, -1]]) / np.ptp(time)
        assert mean == pytest.approx(expected, abs=2e-2 * np.abs(flow).max())
