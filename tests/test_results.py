"""What a run answers in memory and what is read from its folder are one object."""

import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import h5py
import numpy as np
import pytest
from csv_history import edited, read_history
from mechanism_cases import film, rigid_rod, slider_crank
from report_cases import write_history, write_study

import fenics_ehd as ehd
from fenics_ehd.base.columns import Quantity, split_unit, with_unit
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.multibody.quantities import OUTPUTS

END = 2e-5


def one_film():
    return slider_crank(rigid_rod(), film(22.5e-3, 22e-3, 17e-6, 0.01, (12, 2)))


def two_films():
    films = (film(22.5e-3, 22e-3, 17e-6, 0.01, (12, 2)), film(11e-3, 20e-3, 12e-6, 0.01, (8, 2)))
    return slider_crank(rigid_rod(), *films)


@pytest.fixture(scope="module", params=[one_film, two_films])
def both(request, tmp_path_factory):
    """The same short run in memory and on disk, and its folder."""
    folder = tmp_path_factory.mktemp("run")
    found = ehd.simulate(request.param(), END, tolerance=1e-2)
    found.save(folder)
    return found, ehd.load_results(folder), folder


def test_memory_and_disk_are_one_object(both):
    memory, disk, folder = both
    assert type(memory) is type(disk)
    assert list(memory.columns) == list(disk.columns)
    for name, values in memory.columns.items():
        np.testing.assert_array_equal(disk.columns[name], values)
    for name in ("time", "coordinates", "rates", "quasi_static"):
        np.testing.assert_array_equal(getattr(disk, name), getattr(memory, name))
    for name, body in memory.bodies.items():
        np.testing.assert_array_equal(disk.bodies[name].coordinates, body.coordinates)
        np.testing.assert_array_equal(body.angle, body.coordinates[:, 2])
        assert {n: q.units for n, q in disk.bodies[name].items()} == {
            "x": "m", "y": "m", "angle": "rad", "speed": "rad/s",
        }  # fmt: skip
    assert memory.figures.keys() == disk.figures.keys() == memory.joints.keys()
    assert disk.summary()["newton_iterations"] == memory.summary()["newton_iterations"] > len(disk)
    # The CSV has the same with ten digits.
    for name, values in read_history(folder).items():
        np.testing.assert_allclose(disk.columns[name], values, rtol=1e-9, atol=1e-300)


def test_films_have_pressure_and_gap_at_their_nodes(both):
    memory, disk, _ = both
    for name, joint in disk.joints.items():
        found, exact = joint.film, memory.joints[name].film
        for field in ("pressure", "gap", "angle", "height", "cells"):
            ours, reference = getattr(found, field), getattr(exact, field)
            np.testing.assert_allclose(ours, reference, rtol=1e-7)
            assert ours.units == reference.units
        assert (found.pressure.units, found.gap.units) == ("Pa", "m")
        rows = FilmRows.of(found.angle, found.height)
        peaks, films = rows.film_extremes(found.pressure, found.gap)
        np.testing.assert_allclose(peaks, joint.max_pressure, rtol=1e-7)
        np.testing.assert_allclose(films, joint.min_film_thickness, rtol=1e-7)
        assert (found.pressure.max(axis=1) <= joint.max_pressure * (1 + 1e-7)).all()
        assert (found.gap.min(axis=1) >= joint.min_film_thickness * (1 - 1e-7)).all()
        # Cells tile the bore; in a rigid one the gap is c - e . n.
        corners = found.cells[:, [0, 1, 2]]
        around = np.mod(np.diff(found.angle[corners[:, :2]], axis=1), 2 * np.pi).ravel()
        along = found.height[corners[:, 2]] - found.height[corners[:, 0]]
        assert np.sum(around * along) == pytest.approx(2 * np.pi * np.ptp(found.height))
        normal = np.column_stack([np.cos(found.angle), np.sin(found.angle)])
        expected = found.clearance - joint.eccentricity @ normal.T
        np.testing.assert_allclose(found.gap, expected, rtol=1e-6)


def test_some_steps_and_no_films(both):
    _, disk, folder = both
    half = disk.each(lambda values: values[::2])
    assert len(half) == -(-len(disk) // 2)
    name = next(iter(disk.joints))
    np.testing.assert_array_equal(half.joints[name].film.gap, disk.joints[name].film.gap[::2])
    small = ehd.load_results(folder, films=False)
    np.testing.assert_array_equal(small.joints[name].force, disk.joints[name].force)
    with pytest.raises(ehd.errors.InputError, match="films were not read"):
        _ = small.joints[name].film
    with pytest.raises(AttributeError, match=r"no quantity is named 'temperature': .*max_pressure"):
        _ = disk.joints[name].temperature


def test_every_dataset_has_its_unit(both):
    *_, folder = both
    found = {}

    def note(path, item):
        if isinstance(item, h5py.Dataset):
            found[path] = item.attrs["units"].astype(str)

    with h5py.File(folder / "history.h5") as file:
        assert (file.attrs["format"], file.attrs["format_version"]) == ("fenics_ehd history", 4)
        file.visititems(note)
        state = file["state/coordinates"]
        names, units = (list(state.attrs[name].astype(str)) for name in ("names", "units"))
        assert len(names) == len(units) == state.shape[1]
    assert dict(zip(names, units, strict=True))["joints/big_end/eccentricity_x"] == "m"
    assert found["time"] == found["run/step"] == "s"
    assert found["joints/big_end/film/gap"] == "m"
    assert found["run/newton_iterations"] == "1"


@pytest.mark.parametrize(
    ("column", "name", "unit"),
    [
        ("side_flow_m3_per_s", "side_flow", "m3/s"),
        ("groove.flow_m3_per_s", "groove.flow", "m3/s"),
        ("friction_torque_Nm", "friction_torque", "N m"),
        ("contact_sliding_Pa_m", "contact_sliding", "Pa m"),
        ("speed_rad_per_s", "speed", "rad/s"),
        ("force_x_N", "force_x", "N"),
        ("newton_iterations", "newton_iterations", "1"),
        ("contact_share", "contact_share", "1"),
    ],
)
def test_columns_end_with_their_unit(column, name, unit):
    assert split_unit(column) == (name, unit)
    assert with_unit(name, unit) == column


def test_parts_keep_their_unit_and_products_have_none():
    force = Quantity([1.0, 2.0, 4.0], "N")
    assert force[1:].units == force.reshape(3, 1).units == "N"
    assert type(force * 2.0) is type(np.sqrt(force)) is np.ndarray
    assert isinstance(force.max(), float)
    assert pickle.loads(pickle.dumps(force)).units == "N"


def test_of_a_periodic_run_that_was_stopped_the_last_whole_cycle_is_found(tmp_path):
    study = write_study(tmp_path, [])
    write_history(study, "one", steps=30, periodic=True)
    with edited(study.folder("one")) as file:
        file["run/cycle"][:] = np.repeat([1, 2, 3], 10)
        file["run/cycle_time"][:] = 1e-3 * np.concatenate([np.arange(1, 11)] * 3)
        file["run/cycle_time"][20:] *= 0.9
        file["time"][:] = 1e-2 * (file["run/cycle"][:] - 1) + file["run/cycle_time"][:]
        del file["cycle"]  # as before version 0.4: decided from the columns
    found = ehd.load_results(study.folder("one"))
    assert np.all(np.diff(found.time) > 0)
    assert len(found) == 30
    last = found.last_cycle()
    np.testing.assert_array_equal(last.time, found.run.cycle_time[10:20])
    film = found.joints["big_end"].film
    np.testing.assert_array_equal(last.joints["big_end"].film.pressure, film.pressure[10:20])
    assert len(last.last_cycle()) == 10
    # One that was stopped while its last cycle, which is whole, was judged.
    with edited(study.folder("one")) as file:
        file["run/cycle_time"][20:] /= 0.9
        file["time"][:] = 1e-2 * (file["run/cycle"][:] - 1) + file["run/cycle_time"][:]
    last = ehd.load_results(study.folder("one")).last_cycle()
    assert set(last.run.cycle) == {3.0}


def test_what_cannot_be_read_is_one_line(tmp_path):
    with pytest.raises(ehd.errors.InputError, match=r"no: no such folder"):
        ehd.load_results(tmp_path / "no")
    with pytest.raises(ehd.errors.InputError, match=r"not a results folder, it has no history\.h5"):
        ehd.load_results(tmp_path)
    with h5py.File(tmp_path / "history.h5", "w") as file:
        file["coordinates"] = np.zeros((3, 2))  # as 0.1 wrote it
    with pytest.raises(ehd.errors.InputError, match="not a fenics_ehd history"):
        ehd.load_results(tmp_path)
    with h5py.File(tmp_path / "history.h5", "a") as file:
        file.attrs.update(format=np.bytes_("fenics_ehd history"), format_version=2)  # 0.2
    with pytest.raises(ehd.errors.InputError, match=r"version 2, .* reads 4: .*history\.csv"):
        ehd.load_results(tmp_path)
    study = write_study(tmp_path, [])
    write_history(study, "one", steps=8)
    folder = study.folder("one")
    (folder / "summary.json").write_text('{"status": "complete", "basis_error_estimate_m": null}')
    assert np.isnan(ehd.load_results(folder).summary()["basis_error_estimate_m"])
    (folder / "summary.json").write_text("[")
    with pytest.raises(ehd.errors.InputError, match=r"summary\.json: not a summary of a run"):
        ehd.load_results(folder)


def test_tables_of_pandas_and_xarray_where_they_are(both, monkeypatch):
    memory, *_ = both
    for name, convert in (("pandas", memory.to_dataframe), ("xarray", memory.to_xarray)):
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(ehd.errors.InputError, match=f"needs {name}, which is not installed"):
            convert()
    pandas, xarray = ModuleType("pandas"), ModuleType("xarray")
    pandas.Index = lambda values, name: (name, values)
    pandas.DataFrame = lambda columns, index: (columns, index)
    xarray.Dataset = dict
    monkeypatch.setitem(sys.modules, "pandas", pandas)
    monkeypatch.setitem(sys.modules, "xarray", xarray)
    columns, (name, time) = memory.to_dataframe()
    assert name == "time_s" not in columns
    np.testing.assert_array_equal(time, memory.time)
    assert "kinetic_energy_J" in columns
    found = memory.to_xarray()
    assert set(found) == set(memory.names)
    over, values, message = found["step"]
    assert (over, message) == ("time", {"units": "s"})
    np.testing.assert_array_equal(values, memory["step"])
    np.testing.assert_array_equal(found["time"][1], memory.time)


def test_reading_needs_neither_dolfinx_nor_mpi(both):
    *_, folder = both
    code = (
        "import sys, fenics_ehd; fenics_ehd.load_results(sys.argv[1]);"
        "print([n for n in ('dolfinx', 'petsc4py', 'mpi4py', 'scipy', 'matplotlib') "
        "if n in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, folder], capture_output=True, text=True, env=os.environ
    )
    assert done.stdout.strip() == "[]", done.stderr


def test_the_page_on_results_has_every_quantity_as_it_is_registered():
    page = (Path(__file__).parents[1] / "docs" / "results.md").read_text()
    for output in OUTPUTS:
        mean = " (mean in the summary)" if output.mean else ""
        assert f"| `{output.column}` | {output.meaning}{mean} |" in page
