"""``import fenics_ehd as ehd``: what it offers, and what that costs."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_rod import Joint, make_body
from mechanism_cases import film, rigid_rod, slider_crank

import fenics_ehd as ehd


@pytest.mark.parametrize("name", [name for name in ehd.__all__ if name != "__version__"])
def test_every_public_name_is_there_and_documented(name):
    assert getattr(ehd, name).__doc__


def test_public_names_are_listed():
    assert set(ehd.__all__) <= set(dir(ehd))


def test_a_history_has_what_is_documented():
    names = "time names units figures summary last_cycle save to_dataframe to_xarray"
    assert all(getattr(ehd.History, name).__doc__ for name in names.split())


def test_a_name_that_is_none_is_said_to_be_none():
    with pytest.raises(AttributeError, match="no attribute 'Bearing'"):
        _ = ehd.Bearing


SHORT = {
    "time.periodic": False,
    "time.revolutions": 0.004,
    "time.tolerance": 1e-2,
    "output.error_budget": False,
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("rod") / "rod.h5"
    ehd.save_body(make_body(Joint()), path)
    tables = dict(ehd.read_scene("slider-crank").tables)
    tables["bodies"] = {**tables["bodies"], "rod": {"kind": "flexible", "body": str(path)}}
    return ehd.read_scene(tables, **SHORT)


def test_a_machine_in_memory_is_that_of_its_folder(scene, tmp_path):
    machine = ehd.build(scene)
    found = ehd.simulate(machine.mechanism, **machine.options)
    kept = ehd.run(scene, tmp_path / "out")
    pressures = (one.joints["big_end"].film.pressure for one in (found, kept))
    np.testing.assert_allclose(*pressures, rtol=1e-6, atol=1.0)
    assert kept.summary()["status"] == "complete"
    again = ehd.load_history(tmp_path / "out")
    np.testing.assert_array_equal(again.time, kept.time)
    with pytest.raises(ehd.errors.InputError, match="complete"):
        ehd.run(scene, tmp_path / "out")
    other = ehd.read_scene(scene.tables, **{"joints.big_end.clearance": 21e-6})
    with pytest.raises(ehd.errors.SettingsError, match=r"clearance = 2\.1e-05, but the run"):
        ehd.run(other, tmp_path / "out", resume=True)
    ehd.run(scene, tmp_path / "out", resume=True)


def test_what_would_be_left_out_in_python_is_refused():
    grid = ehd.uniform_grid(0.0225, 0.022, (24, 6))
    mechanism = ehd.build(ehd.read_scene("four-bar")).mechanism

    def film(**more):
        return ehd.Film(ehd.FilmParameters(grid, 17e-6, ehd.Lubricant(0.01), 500.0, **more))

    driven = replace(mechanism, drives={"crank": ehd.Torque("crank", torque=1.0)})
    fed = ehd.HoleSupply(diameter=5e-3, name="oil", table="pressure.csv")
    for make, message in (
        (lambda: ehd.Shape(barrel=3e-6), r"barrel = 3e-06 m, taper = 0 m need half_width"),
        (lambda: ehd.Shape(table="shape.csv"), r"table = 'shape\.csv' is read only for scenes"),
        (lambda: film(feeds=(fed,)), r"oil: table = 'pressure\.csv' is read only for scenes"),
        (
            lambda: ehd.bearing(load="5 kg"),
            "load = '5 kg' must be a number in N, or a number with a unit of",
        ),
        (lambda: ehd.read_scene("four-bar", **{"bodies.crank.mass.x": 1}), "mass is not a table"),
        (lambda: ehd.simulate(driven, 1e-3), r"drives\.crank must be a Speed"),
        (lambda: ehd.simulate(mechanism, 1e-3, order=4), "order = 4 must be a whole number, at le"),
        (lambda: ehd.simulate(mechanism, 1e-3, tolerance=0.0), "tolerance = 0.0 must be above 0"),
    ):
        with pytest.raises(ehd.errors.SettingsError, match=message):
            make()


def test_changes_name_their_keys():
    scene = ehd.read_scene("four-bar", **{"time.tolerance": 1e-3})
    assert scene.time.tolerance == 1e-3
    with pytest.raises(ehd.errors.SettingsError, match="tolerence"):
        ehd.read_scene("four-bar", **{"time.tolerence": 1e-3})


def test_a_run_is_gone_through_again_by_another_mechanism_and_judged(tmp_path):
    mechanism = slider_crank(rigid_rod(), film(22.5e-3, 22e-3, 17e-6, 0.01, (12, 2)))
    history = ehd.simulate(mechanism, 4e-5, tolerance=1e-3)
    again = ehd.replay(history, mechanism)
    np.testing.assert_array_equal(again["time"], history["time"])
    name = "big_end.min_film_thickness"
    np.testing.assert_allclose(again[name], history[name], rtol=1e-4)
    thicker = slider_crank(rigid_rod(), film(22.5e-3, 22e-3, 17e-6, 0.0101, (12, 2)))
    change = ehd.replay(history, thicker, stride=2)[name][-1] / history[name][-1]
    assert 1.0 < change < 1.01
    assert ehd.error_budget(history).joints["big_end"]["min_film_thickness"]["known"] > 0.0
    with pytest.raises(ehd.errors.InputError, match="needs a periodic solution"):
        ehd.multiplier(history)
    history.save(tmp_path)
    with pytest.raises(ehd.errors.InputError, match="was read"):
        ehd.replay(ehd.load_history(tmp_path), mechanism)
