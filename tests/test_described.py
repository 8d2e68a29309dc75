"""What Python and notebooks show of every object that ``import fenics_ehd as ehd`` can return."""

import inspect
import re
import typing
from dataclasses import is_dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import attrs
import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.analysis.dynamic_coefficients import DynamicCoefficients
from fenics_ehd.analysis.rotor_map import CriticalSpeed
from fenics_ehd.base.columns import Quantity
from fenics_ehd.base.described import LONGEST_TEXT, MOST_LINES, Described, Named, units_of
from fenics_ehd.film.forces import FlowBalance
from fenics_ehd.plotting.rotor import nearest_speed
from fenics_ehd.reduction.body import InertiaIntegrals
from fenics_ehd.scenes.bearing_map import FailedPoint

STORED = Path(__file__).parent / "stored" / "run-0.3"
BODIES = Path(__file__).parent / "golden" / "stored"

#: Longest name of a line: that of a column of a result.
LONGEST_NAME = 40

PUBLIC = {name: getattr(ehd, name) for name in ehd.__all__ if name not in ("__version__", "errors")}


def returned_classes(function):
    """Classes of this package in the annotation of what a function returns."""
    plain = inspect.unwrap(function)
    hint = eval(plain.__annotations__["return"], plain.__globals__)
    every = [hint, *typing.get_args(hint)]
    return [each for each in every if getattr(each, "__module__", "").startswith("fenics_ehd")]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_class_and_every_returned_one_is_described(name):
    public = PUBLIC[name]
    if name == "quantity":  # a decorator, which returns the function
        return
    classes = [public] if inspect.isclass(public) else returned_classes(public)
    for cls in classes:
        assert issubclass(cls, Described), f"{name}: {cls.__name__} has no description"


def objects(root, seen):
    """Yield an object and all objects of this package that its public attributes lead to."""
    if id(root) in seen or isinstance(root, type):
        return
    seen[id(root)] = root  # the object stays alive, so that its identity stays its own
    if isinstance(root, dict):
        yield from (each for value in root.values() for each in objects(value, seen))
    if isinstance(root, tuple | list):
        yield from (each for value in root[:3] for each in objects(value, seen))
    if not type(root).__module__.startswith("fenics_ehd") or isinstance(root, Quantity):
        return
    if isinstance(root, Described):
        yield root
    if isinstance(root, Described) and (is_dataclass(root) or attrs.has(type(root))):
        for attribute in vars(type(root)).keys() | getattr(root, "__dict__", {}).keys():
            kind = inspect.getattr_static(type(root), attribute, None)
            if attribute.startswith("_") or inspect.isfunction(kind) or "Former" in str(kind):
                continue
            try:
                value = getattr(root, attribute)
            except ehd.errors.EhdError:  # the object has no such part
                continue
            yield from objects(value, seen)


@cache
def bearing():
    return ehd.bearing(load=5e3, with_coefficients=True, cells_around=16, cells_along=3)


@cache
def bearing_map():
    points = ehd.bearing_map(speeds=[300.0], loads=[1e3], cells_around=16, cells_along=3, meshes=1)
    return replace(points, failed=(FailedPoint(300.0, 1e9, "the film is too thin"),))


@cache
def rotor_map():
    unbalance = {"shaft.disk": 1e-4}
    return ehd.rotor_map("rotor-two-bearings", ["4000 rpm"], meshes=1, unbalance=unbalance)


#: Objects from which all others are reached.
ROOTS = {
    "history": lambda: ehd.load_history(STORED),
    "scene": lambda: ehd.read_scene("slider-crank"),
    "machine": lambda: ehd.build(ehd.read_scene("four-bar")),
    "body": lambda: ehd.load_body(BODIES / "body-m4.h5"),
    "bearing": bearing,
    "bearing map": bearing_map,
    "rotor map": rotor_map,
}


@pytest.mark.parametrize("root", ROOTS)
def test_every_reachable_object_has_at_most_ten_short_lines_and_a_table(root):
    reached = list(objects(ROOTS[root](), {}))
    assert reached
    for each in reached:
        text = repr(each)
        lines = text.splitlines()
        assert len(lines) <= MOST_LINES, text
        assert all(len(line) <= LONGEST_NAME + LONGEST_TEXT for line in lines), text
        assert "array(" not in text
        assert " at 0x" not in text, text
        assert each._repr_html_().count("<tr>") == len(lines)


def test_key_figures_have_units_and_bounds():
    text = repr(bearing())
    for words in (r"load +5000 N", r"min_film_thickness +[\d.]+ um", r"stiffness .* ± [\d.]+ MN/m"):
        assert re.search(words, text), text
    assert re.search(r"critical mass [\d.e+]+ ± [\d.e+]+ kg", text)
    assert "1 of 2 points have a result" in repr(bearing_map())
    assert re.search(r"RotorMap +1 speeds, .* rad/s \(\d+ to \d+ 1/min\)", repr(rotor_map()))
    assert "9.746 MPa ± 0.68 %" in repr(ehd.load_history(STORED))
    critical = CriticalSpeed(400.0, 1, 0.123, 1.0, 2.0, 0.004)
    chart = replace(rotor_map(), critical_speeds=(critical,))
    assert "400 ± 2 rad/s (3820 1/min), mode 2, damping ratio 0.123 ± 0.004" in repr(chart)
    matrix = np.eye(2)
    unstable = repr(DynamicCoefficients(matrix, matrix, 0.0, 0.5, 0.0))
    assert unstable.startswith("DynamicCoefficients ")
    assert unstable.endswith("unstable for every mass")
    massless = InertiaIntegrals(np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)))
    assert not massless.centre_of_mass.any()
    assert massless.polar_inertia == 0.0


def test_fields_have_the_units_of_their_documentation():
    assert units_of(ehd.FilmGrid)["radius"] == "m"
    assert units_of(ehd.LubricatedJoint)["eccentricity_rate"] == "m/s"
    assert units_of(ehd.Unbalance)["phase"] == "degrees"
    assert "magnitude  0.0001 kg m" in repr(ehd.Unbalance("shaft.disk", 1e-4))
    assert "between   a, b" in repr(ehd.Revolute(("a", "b")))
    assert "1e-06 m3/s" in repr(FlowBalance(1e-6, 1e-6, 0.0, 0.0, 0.0))
    scene = ehd.read_scene("loaded-journal", **{"joints.bearing.cells": [12, 3]})
    joint = scene.joints["bearing"]
    assert re.search(r"^cells +12, 3$", repr(joint), re.MULTILINE)
    with pytest.raises(ehd.errors.SettingsError) as refused:
        ehd.read_scene("loaded-journal", **{"joints.bearing.clearance": joint})
    assert "\n" not in str(refused.value)
    assert "must be a finite number" in str(refused.value)
    starved = ehd.build(ehd.read_scene("loaded-journal-starved")).mechanism.joints["bearing"]
    assert re.search(r"supplies +axial groove", repr(starved.film))


def test_unknown_names_are_refused_with_similar_ones():
    history = ehd.load_history(STORED)
    machine = ehd.build(ehd.read_scene("four-bar"))
    points = bearing_map()
    cases = {
        lambda: history["rocker_end.max_presure"]: "result['rocker_end.max_presure']: there is no "
        "such name: did you mean rocker_end.max_pressure or ",
        lambda: history["max_pressure"]: "did you mean rocker_end.max_pressure",
        lambda: history[0]: "result[0]: there is no such name: result.names lists",
        lambda: history.units("time_s"): "did you mean time",
        lambda: history.joints["rocker"]: "result.joints['rocker']: there is no such name: did you "
        "mean rocker_end? its names: rocker_end",
        lambda: history.joints["rocker_end"]["max_presure"]: "did you mean max_pressure",
        lambda: history.bodies["Crank"]: "did you mean crank",
        lambda: history.angle_of("Crank"): "did you mean crank",
        lambda: history.figures["x"]: "its names: rocker_end",
        lambda: history.summary()["stat"]: "did you mean status",
        lambda: history.columns["time"]: "did you mean",
        lambda: machine.mechanism.joints["rocker"]: "mechanism.joints['rocker']: ",
        lambda: points["kx"]: "map['kx']: there is no such name: did you mean kxx",
        lambda: replace(points, results=())["kxx"]: "map['kxx']: there is no such name: its names",
        lambda: ehd.read_scene("four-bar").joints["x"]: "scene.joints['x']: there is no such name",
    }
    for look_up, message in cases.items():
        with pytest.raises(ehd.errors.SettingsError) as refused:
            look_up()
        assert isinstance(refused.value, KeyError)
        assert message in str(refused.value)
        assert "\n" not in str(refused.value)
    scene = ehd.read_scene("four-bar")
    body = ehd.load_body(BODIES / "body-m4.h5")
    chart = rotor_map()
    for look_up in (
        lambda: scene.joints["x"],
        lambda: scene.films["x"],
        lambda: body.bores["x"],
        lambda: body.points["x"],
        lambda: chart.points[0].figures["x"],
        lambda: chart.points[0].linear.film_stiffness("x", 1j),
        lambda: ehd.build(scene, bodies={"x": body}),
    ):
        with pytest.raises(ehd.errors.UnknownNameError, match=r"no such name: .*its names"):
            look_up()
    with pytest.raises(ehd.errors.SettingsError, match="track = 99 must be a whole number"):
        chart.shape(0, 99)
    with pytest.raises(ehd.errors.SettingsError, match=r"did you mean .*pressure_map.* choose"):
        history.plot("rocker_end.pressure")
    assert history.joints.get("x") is None
    with pytest.raises(AttributeError, match="did you mean max_pressure"):
        _ = history.joints["rocker_end"].max_presure


def test_dictionaries_by_name_stay_dictionaries():
    named = Named({"a": np.zeros(3)}, "result.films")
    assert dict(named).keys() == {"a"}
    assert repr(named).splitlines()[0].split() == ["result.films", "1", "by", "name"]
    assert isinstance(named, dict)


def test_results_are_drawn():
    titles = [
        figure.axes[0].get_xlabel() or figure.axes[0].get_ylabel()
        for figure in (bearing().plot(), bearing_map().plot(), rotor_map().plot())
    ]
    assert titles == ["z [mm]", "stiffness [MN/m]", "speed [1/min]"]
    assert nearest_speed(rotor_map(), 1.0) == nearest_speed(rotor_map(), None) == 0
    backward = SimpleNamespace(speeds=np.array([-100.0, -300.0]))
    assert [nearest_speed(backward, speed) for speed in (300.0, "2865 rpm")] == [1, 1]
    with pytest.raises(ehd.errors.SettingsError, match="speed = '3000 rpm' has an effect on mode_"):
        rotor_map().plot("campbell", speed="3000 rpm")
    with pytest.raises(ehd.errors.SettingsError, match="quantity = 'cambell' must be one of camp"):
        rotor_map().plot("cambell")
    with pytest.raises(ehd.errors.SettingsError, match="a bearing has one picture"):
        ehd.plot(bearing(), "orbit")
    both = replace(bearing_map(), failed=(FailedPoint(300.0, 2e3, ""), FailedPoint(400.0, 1e3, "")))
    with pytest.raises(ehd.errors.SettingsError, match="several speeds and several loads"):
        both.plot()
