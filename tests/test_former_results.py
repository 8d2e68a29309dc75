"""Results of version 0.3 are read: a shortened real run, whose one joint is not in its names."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import call
from csv_history import edited

import fenics_ehd as ehd
from fenics_ehd.results.recorded_run import load_run_state
from fenics_ehd.study.pool import OtherFolderError
from fenics_ehd.study.sweep import SweepFolder, make_sweep

STORED = Path(__file__).parent / "stored" / "run-0.3"


@pytest.fixture
def folder(tmp_path):
    return Path(shutil.copytree(STORED, tmp_path / "run"))


def test_columns_and_figures_of_a_former_run_have_the_name_of_the_joint():
    history = ehd.load_history(STORED)
    former = json.loads((STORED / "summary.json").read_text())
    (joint,) = history.joints
    assert joint == former["joint"] == "rocker_end"
    assert history.status == "complete"
    assert history.figures[joint]["max_pressure_Pa"] == former["max_pressure_Pa"]
    assert history.figures[joint]["error_budget"] == former["error_budget"]
    assert "max_pressure_Pa" not in history.summary()
    assert history.summary()["steps"] == former["steps"]
    assert history.cycle.label == former["cycle_used"]
    column = history.columns["rocker_end.max_pressure_Pa"]
    np.testing.assert_array_equal(column, history["rocker_end.max_pressure"])
    assert history.joints[joint].film.pressure.shape[0] == len(history)


def test_bare_names_are_accepted_with_a_warning_if_one_joint_has_them():
    history = ehd.load_history(STORED)
    with pytest.warns(DeprecationWarning, match=r"force_x_N is now rocker_end\.force_x_N"):
        force = history.columns["force_x_N"]
    np.testing.assert_array_equal(force, history.columns["rocker_end.force_x_N"])
    with pytest.warns(DeprecationWarning, match=r"max_pressure_Pa is now joints\.rocker_end\."):
        peak = history.summary()["max_pressure_Pa"]
    assert peak == history.figures["rocker_end"]["max_pressure_Pa"]
    with pytest.warns(DeprecationWarning, match=r"max_pressure_Pa is now joints\.rocker_end\."):
        assert history.summary().get("max_pressure_Pa") == peak
    with pytest.warns(DeprecationWarning, match=r"force_x_N is now rocker_end\.force_x_N"):
        np.testing.assert_array_equal(history.columns.get("force_x_N"), force)
    with pytest.warns(DeprecationWarning, match="joint is now the key under joints"):
        assert history.summary()["joint"] == "rocker_end"
    assert history.summary().get("no_such_figure", 0) == 0
    # Columns of bodies had their names before.
    for unknown in ("angle_rad", "force_z_N"):
        with pytest.raises(KeyError):
            _ = history.columns[unknown]


def test_pictures_of_a_former_run_are_drawn(folder, capsys):
    assert call("plot", folder, "--quantity", "rocker_end.max_pressure") == 0
    assert (folder / "max_pressure-rocker_end.png").is_file()
    assert capsys.readouterr().err == ""
    assert call("plot", folder, "--quantity", "max_pressure") == 0
    assert (folder / "max_pressure.png").is_file()
    notice = "--quantity max_pressure is now --quantity rocker_end.max_pressure"
    assert notice in capsys.readouterr().err
    assert call("plot", folder, "--quantity", "pin.max_pressure") == 2
    assert "has no lubricated joint pin" in capsys.readouterr().err


def test_a_former_run_is_not_continued(folder):
    with edited(folder) as file:
        file.create_group("resume")
    with pytest.raises(ehd.errors.InputError, match=r"version 0\.3\.0\.dev0, and .* cannot cont"):
        load_run_state(folder)


def test_a_former_sweep_is_not_continued(tmp_path):
    sweep = make_sweep("four-bar", ["time.tolerance=1e-3,2e-3"])
    former = {**sweep.identity, "version": "0.3.0.dev0"}
    with SweepFolder(tmp_path, sweep) as folder:
        folder.write("sweep.json", former)
    with pytest.raises(OtherFolderError, match=r"version is 0\.3\.0\.dev0 in the folder"):
        SweepFolder(tmp_path, sweep)


def test_the_cycle_of_a_run_is_stored_with_its_history(tmp_path):
    history = ehd.load_history(STORED)
    history.save(tmp_path)
    with h5py.File(tmp_path / "history.h5") as file:
        assert file.attrs["format_version"] == 4
        assert file["cycle"].attrs["start"] == history.cycle.start
    again = ehd.load_history(tmp_path)
    assert again.stored_cycle == history.cycle
    assert again.summary().keys() == history.summary().keys()
