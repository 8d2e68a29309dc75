"""Pictures of a run: which there are, and that they show what the history holds."""

import numpy as np
import pytest
from recorded_runs import short_run
from report_cases import write_history, write_study

from fenics_ehd import load_results
from fenics_ehd.cli.main import main
from fenics_ehd.plotting import history, orbit, picture
from fenics_ehd.scenes.scene_file import shipped

PANELS = {
    "max_pressure": ("max_pressure_Pa", 1e-6),
    "min_film_thickness": ("min_film_thickness_m", 1e6),
}


@pytest.fixture(scope="module")
def bearings(tmp_path_factory):
    """Two bearings of one shaft, which are equal."""
    folder, time = tmp_path_factory.mktemp("bearings"), "end = 2e-3\ntolerance = 1e-3"
    return short_run(folder, "rotor-two-bearings", time)


@pytest.fixture
def columns():
    time = np.linspace(0.0, 1e-2, 50)
    return {
        "time_s": time,
        "kinetic_energy_J": 100 + np.sin(300 * time),
        "strain_energy_J": 0.1 * time,
        "drive_work_J": np.sin(300 * time),
        "applied_work_J": 0 * time,
        "film_work_J": 2 * time,
        "damping_work_J": time,
        "energy_defect_J": 1e-4 * time,
        "basis_error_estimate_m": 1e-8 * (1 + time),
        "min_film_thickness_m": 3e-6 + 0 * time,
    }


@pytest.fixture
def drawn(monkeypatch):
    """Lines of every picture by its name, without writing one."""
    found = {}

    def look(figure, paths):
        found[paths[0].stem] = [line for axes in figure.axes for line in axes.lines]
        picture.plt.close(figure)
        return list(paths)

    for module in (history, orbit):
        monkeypatch.setattr(module, "save", look)
    return found


def test_the_energy_picture_shows_what_is_exchanged_and_what_is_lost(columns, tmp_path, drawn):
    paths = history.plot_energy(columns, tmp_path)
    assert [path.name for path in paths] == ["energy.png", "energy.svg"]
    lines = {line.get_label(): line.get_ydata() for line in drawn["energy"]}
    assert set(lines) >= {"kinetic and strain energy", "drive", "film", "structural damping"}
    # What nothing was exchanged by is not in the legend.
    assert not any("forces" in name for name in lines)
    stored = columns["kinetic_energy_J"] + columns["strain_energy_J"]
    np.testing.assert_allclose(lines["kinetic and strain energy"], stored - stored[0])


def test_the_basis_error_is_drawn_where_it_is_known(columns, tmp_path):
    unknown = columns | {"basis_error_estimate_m": np.full(50, np.nan)}
    joints = {"main": unknown, "big end": columns}
    assert {p.suffix for p in history.plot_basis_error(joints, tmp_path)} == {".png", ".svg"}
    assert history.plot_basis_error({"main": unknown}, tmp_path) == []


def test_equal_curves_are_both_seen(bearings, tmp_path, drawn):
    history.plot_runs({"one": bearings.directory}, tmp_path)
    for name, (column, factor) in PANELS.items():
        lines = {line.get_label(): line for line in drawn[name]}
        curves = [lines["left"], lines["right"]]
        for joint, line in zip(("left", "right"), curves, strict=True):
            expected = factor * bearings.history[f"{joint}.{column}"]
            np.testing.assert_allclose(line.get_ydata(), expected)
        # The later one, on top, has gaps through which the other shows.
        assert [line.get_linestyle() for line in curves] == ["-", "--"]
        assert curves[0].get_color() != curves[1].get_color()


def test_orbits_are_those_of_the_clearance_circle(bearings, tmp_path, drawn):
    history.plot_runs({"one": bearings.directory, "two": bearings.directory}, tmp_path)
    lines = {line.get_label(): line for line in reversed(drawn["orbit"])}
    found = lines["two, right"].get_xydata()
    expected = [bearings.history[f"right.eccentricity_{axis}_m"] / 40e-6 for axis in "xy"]
    np.testing.assert_allclose(found, np.transpose(expected), atol=1e-9)
    force = [line for line in drawn["orbit"] if line.get_label() == "one, left"][1].get_xydata()
    expected = [-1e-3 * bearings.history[f"left.force_{axis}_N"] for axis in "xy"]
    np.testing.assert_allclose(force, np.transpose(expected))


def test_a_periodic_run_is_drawn_over_its_cycle(tmp_path):
    study = write_study(tmp_path, [])
    write_history(study, "reference", steps=5, periodic=True)
    result = load_results(study.folder("reference"))
    (found,) = history.joint_columns({"one": result}).values()
    np.testing.assert_allclose(found["time_s"], np.linspace(2.5e-3, 12.5e-3, 5))
    assert found["max_pressure_Pa"].max() > 40e6


def test_commands_draw_pictures(bearings, tmp_path, capsys):
    folders = (bearings.directory, bearings.directory.parent / bearings.directory.name)
    with pytest.raises(SystemExit) as end:
        main(["plot", *map(str, folders), "-o", str(tmp_path / "pictures")])
    assert end.value.code == 0
    written = capsys.readouterr().out.split()
    names = ("max_pressure", "min_film_thickness", "orbit")
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {
        f"{name}.{suffix}" for name in names for suffix in ("png", "svg")
    }
    assert written == [
        str(tmp_path / "pictures" / f"{n}.{s}") for n in names for s in ("png", "svg")
    ]


def test_a_folder_is_drawn_without_the_tables_of_its_loads(tmp_path):
    """And a scene that asks for no pictures has none."""
    (tmp_path / "push.csv").write_text("angle_deg,force_N\n0,0\n90,40\n180,0\n270,-40\n360,0\n")
    text = shipped("four-bar")
    scene = tmp_path / "scene.toml"
    scene.write_text(
        text[: text.index("[time]")]
        + '[forces.push]\nkind = "angle-table"\npoint = "rocker.tip"\nfile = "push.csv"\n'
        + 'angle_of = "crank"\n[time]\nend = 1e-4\n[output]\nplots = false\n'
    )
    out = tmp_path / "out"
    for command in (["run", scene, "-o", out], ["animate", out, "--frames", 2]):
        with pytest.raises(SystemExit) as end:
            main([str(part) for part in command])
        assert end.value.code == 0
        (tmp_path / "push.csv").unlink(missing_ok=True)
    assert [path.name for path in out.iterdir() if path.suffix in (".png", ".gif")] == [
        "animation.gif"
    ]
