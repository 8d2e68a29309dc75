"""Heat in scene files and on the command line: settings, refusals, figures, a resumed run."""

import json
from collections import deque

import pytest
from command_line import call
from csv_history import only_joint, read_history
from scene_cases import tables_of, toml

import fenics_ehd as ehd
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.scenes.scene import changed, scene_of, stored

HEAT = {"supply_temperature": 70.0}
OIL = {"grade": "ISO VG 46"}


def tables(heat=None, oil=None, **time):
    """A journal under a load that turns once in a period."""
    joint = {
        "kind": "lubricated", "journal": "journal", "bore": "ground", "radius": 0.0225,
        "width": 0.022, "clearance": 17e-6, "cells": [16, 3], "lubricant": "oil",
    }  # fmt: skip
    return {
        "bodies": {"journal": {"kind": "massless"}},
        "joints": {"bearing": joint | ({} if heat is None else {"heat": heat})},
        "drives": {"journal": {"kind": "speed", "speed": 500.0}},
        "forces": {
            "load": {"kind": "constant", "point": "journal", "force": [2000.0, 0.0]},
            "unbalance": {"kind": "rotating", "point": "journal", "amplitude": 1000.0,
                          "speed": 500.0},
        },
        "lubricants": {"oil": oil or OIL},
        "time": {"periodic": True, "revolutions": 1.0, "of": "journal", "tolerance": 1e-3,
                 "periodicity": 1e-2, **time},
            }  # fmt: skip


def test_keys_of_version_0_2_are_read_and_one_line_gives_the_name_of_today():
    given = tables(HEAT | {"conducted": 0.2, "mixing": 0.4})
    given["bodies"]["part"] = {"kind": "flexible", "model": "housing", "held_by": "foot"}
    scene = scene_of(given, "former")
    assert scene.joints["bearing"].heat.conducted_share == 0.2
    assert scene.joints["bearing"].heat.outlet_weight == 0.4
    assert scene.bodies["part"].clamped == "foot"
    assert list(scene.warnings) == [
        "bodies.part.held_by is now named clamped",
        "joints.bearing.heat.conducted is now named conducted_share",
        "joints.bearing.heat.mixing is now named outlet_weight",
    ]
    # A run has the scene as stored, or with other values, and reports it in both cases.
    assert stored(scene).warnings == changed(scene, {"time.cycles": 3}).warnings == scene.warnings
    given_anew = changed(scene, {"bodies.part.held_by": "none"})
    assert given_anew.bodies["part"].clamped == "none"
    assert "bodies.part.held_by is now named clamped" in given_anew.warnings
    assert "held_by" in given["bodies"]["part"]
    with pytest.raises(ehd.errors.SettingsError, match=r"unknown key .*bearing\.heat\.mixing"):
        scene_of(tables(HEAT | {"mixing": 0.4, "outlet_weight": 0.5}), "both")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"heat": {}}, r"joints\.bearing\.heat\.supply_temperature is missing"),
        ({"heat": HEAT, "oil": {"viscosity": 0.01}}, r"joints\.bearing\.heat: the viscosity of "
         r"lubricants\.oil does not depend"),
        ({"heat": HEAT, "periodic": False}, r"joints\.bearing\.heat: .* time\.periodic = false"),
        ({"heat": {"supply_temperature": 500.0}}, r"temperature = 500 C of the oil must lie"),
        ({"heat": HEAT | {"conducted": 1.0}}, r"joints\.bearing\.heat\.conducted_share = 1.0"),
        ({"heat": HEAT | {"mixing": 2.0}}, r"joints\.bearing\.heat\.outlet_weight = 2"),
        ({"heat": HEAT | {"suply": 1.0}}, r"unknown key joints\.bearing\.heat\.suply"),
        ({}, r"lubricants\.oil: temperature is missing"),
    ],
)  # fmt: skip
def test_heat_that_cannot_be_balanced_names_its_key(given, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        scene_of(tables(**given), "scene")


def test_a_run_tells_temperatures_power_and_flow(tmp_path, capsys):
    source = tmp_path / "warm.toml"
    source.write_text(toml(tables(HEAT | {"tolerance": 0.2})))
    assert call("run", source, "-o", tmp_path / "out", "--no-plots", "--no-error-budget") == 0
    assert "effective temperature" in capsys.readouterr().out
    assert call("plot", tmp_path / "out", "--quantity", "bearing.flow") == 0
    assert (tmp_path / "out" / "flow-bearing.png").is_file()
    found = only_joint(json.loads((tmp_path / "out" / "summary.json").read_text()))
    supply, effective, outlet = (
        found[f"{name}_temperature_C"] for name in ("supply", "effective", "outlet")
    )
    assert supply == 70.0 < effective < outlet
    assert effective == pytest.approx(0.5 * (supply + outlet), abs=0.2)
    density = 870.0 * (1 - 6.5e-4 * (effective - 15.0))
    carried = density * 2000.0 * found["mean_leaving_flow_m3_per_s"] * (outlet - supply)
    assert carried == pytest.approx(found["mean_dissipated_power_W"], rel=1e-9)
    history = read_history(tmp_path / "out", "bearing")
    assert history["dissipated_power_W"].min() > 0
    assert history["leaving_flow_m3_per_s"].min() > 0


def test_a_bearing_tells_its_temperatures(capsys):
    line = ["bearing", "--load", 3000, "--grade", "ISO VG 46", "--supply-temperature", 60,
            "--conducted", 0.2, "--cells", "24x6"]  # fmt: skip
    assert call(*line, "--json") == 0
    values = json.loads(capsys.readouterr().out)
    rise = values["outlet_temperature_C"] - values["supply_temperature_C"]
    assert values["effective_temperature_C"] == pytest.approx(60 + 0.5 * rise, abs=1e-5)
    assert values["temperature_C"] == values["effective_temperature_C"]
    carried = values["density_kg_per_m3"] * 2000 * values["leaving_flow_m3_per_s"] * rise
    assert carried == pytest.approx(0.8 * values["dissipated_power_W"], rel=1e-6)
    assert call(*line) == 0
    assert "outlet temperature" in capsys.readouterr().out
    assert call(*line, "--temperature", 70) == 2
    assert "exclude each other" in capsys.readouterr().err


@pytest.mark.slow
def test_conserved_oil_is_warmed_too():
    # What bodies and supplies put in leaves as heat, and the same oil given at that temperature
    # makes the same film.
    found = []
    for heat in (True, False):
        at = {} if heat else {"temperature": found[0]["effective_temperature_C"]}
        scene = scene_of(
            tables_of(
                "loaded-journal-starved",
                {
                    "joints.bearing.cells": [48, 4],
                    "joints.bearing.friction": True,
                    "joints.bearing.initial_filling": 1.0,
                    "lubricants.oil": OIL | at,
                    "time.tolerance": 1e-3,
                    "time.periodicity": 2e-3,
                }
                | ({"joints.bearing.heat": {"supply_temperature": 60.0}} if heat else {}),
            ),
            "starved",
        )
        built = ehd.build(scene)
        run = Run(built.mechanism, built.steps, scene.span)
        recorder = Recorder(run, scene.span, PeriodicSolver(run, scene.span, 2e-3, 20))
        deque(recorder.steps(), maxlen=0)
        found.append(only_joint(RunSummary(recorder).entries()))
    heated, given = found
    assert heated["effective_temperature_C"] > 75.0
    dissipated = heated["mean_dissipated_power_W"]
    power = heated["mean_film_power_W"] + heated["mean_supply_power_W"]
    assert power == pytest.approx(dissipated, rel=5e-3)
    assert given["mean_dissipated_power_W"] == pytest.approx(dissipated, rel=5e-3)
