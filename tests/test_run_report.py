"""The report of a run: self-contained, every figure once with its error, two sheets of pictures."""

import hashlib
import html.parser
import json
import re
from base64 import b64decode
from functools import partial
from pathlib import Path
from shutil import copytree
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from command_line import OF_THE_MACHINE, call, exit_of
from hypothesis import given
from hypothesis import strategies as st
from scene_cases import LOADED_JOURNAL, write_scene

import fenics_ehd as ehd
from fenics_ehd.multibody.figures import Figure, figures_of
from fenics_ehd.multibody.joints import Speed
from fenics_ehd.reduction.body import InertiaIntegrals
from fenics_ehd.scenes.scene import as_stored
from fenics_ehd.study.report.run_figures import UNITS, figure_blocks, is_zero, number_text
from fenics_ehd.study.report.run_inputs import LARGEST
from fenics_ehd.study.report.scene_words import scene_entries, setting_text

FORMER = Path(__file__).parent / "stored" / "run-0.3"

VOID = {"br", "col", "hr", "img", "link", "meta"}

report = partial(call, "report")


class Page(html.parser.HTMLParser):
    """Tags, links, figures by name and text of a page; every tag must be closed in its order."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.links, self.names, self.open = [], [], [], []
        self.values, self.files, self.text = {}, {}, ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.names += dict(attributes).get("data-figure", "").split()
        self.links += [value for name, value in attributes if name in ("href", "src")]
        if "download" in dict(attributes):
            content = dict(attributes)["href"].partition(";base64,")[2]
            self.files[dict(attributes)["download"]] = b64decode(content)
        if tag not in VOID:
            self.open.append((tag, dict(attributes).get("data-figure", "").split()))

    def handle_endtag(self, tag):
        assert self.open.pop()[0] == tag

    def handle_data(self, data):
        self.text += data
        for name in self.open[-1][1] if self.open else ():
            self.values[name] = data


def page_of(directory):
    return Page((directory / "report.html").read_text())


def full_names(summary):
    return [f"{figure.joint}.{figure.name}".lstrip(".") for figure in figures_of(summary)]


@pytest.fixture(scope="module")
def reported(two_bearings, tmp_path_factory):
    """A copy of the folder of a run, with its report."""
    folder = copytree(two_bearings.directory, tmp_path_factory.mktemp("bearings") / "run")
    assert report(folder) == 0
    return folder


def test_the_page_needs_no_other_file(reported):
    page = page_of(reported)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert "url(" not in (reported / "report.html").read_text()


def hidden(history):
    """Names of figures that are zero, and of their positions, which the page does not print."""
    blocks = figure_blocks(
        figures_of(history.summary()), "crank", searched="cycles" in history.summary(),
        columns={name: joint.columns for name, joint in history.joints.items()},
    )  # fmt: skip
    names = []
    for block in blocks:
        for cell in (cell for row in block.zero for cell in row.cells if cell):
            names += cell.names + [name for part in cell.positions for name in part.names]
        for cell in (cell for row in block.rows for cell in row.cells if cell and cell.zero):
            names += [name for part in cell.positions for name in part.names]
    return names


def test_every_figure_of_the_summary_is_on_the_page_once(reported):
    history = ehd.load_history(reported)
    summary = history.summary()
    page = page_of(reported)
    assert sorted(page.names + hidden(history)) == sorted(full_names(summary))
    for joint, figures in summary["joints"].items():
        value = float(page.values[f"{joint}.max_pressure_Pa"].removesuffix(" MPa"))
        assert value == pytest.approx(1e-6 * figures["max_pressure_Pa"], rel=1e-3)
        film = float(page.values[f"{joint}.min_film_thickness_m"].removesuffix(" µm"))
        assert film == pytest.approx(1e6 * figures["min_film_thickness_m"], rel=1e-3)


def test_the_page_has_five_pictures_with_captions(reported):
    page = page_of(reported)
    assert page.tags.count("img") == page.tags.count("figcaption") == 5
    text = (reported / "report.html").read_text()
    assert len(set(re.findall('alt="([^"]*)"', text))) == 5


def test_the_page_names_every_entry_of_its_scene_and_repeats_the_run(reported):
    page = page_of(reported)
    scene = as_stored(reported / "scene.toml")
    for table in ("joints", "drives", "forces", "lubricants"):
        for name in getattr(scene, table):
            assert name in page.text
    assert "fenics-ehd run source.toml" in page.text
    assert (reported / "scene.toml").read_text() in page.text
    assert page.files == {"source.toml": (reported / "scene.toml").read_bytes()}
    for file in ("scene.toml", "history.csv"):
        assert hashlib.sha256((reported / file).read_bytes()).hexdigest() in page.text
    for version in ehd.load_history(reported).summary()["versions"].values():
        assert version in page.text


@pytest.fixture(scope="module")
def under_loads(tmp_path_factory):
    """Folder of a short run of a journal under two loads, whose tables have the same name."""
    folder = tmp_path_factory.mktemp("loads")
    for name, factor in (("first", 1.0), ("second", 0.5)):
        (folder / name).mkdir()
        loads = ((0.0, 500.0), (1e-2, -500.0), (2e-2, 500.0))
        rows = (f"{time},{factor * load},900" for time, load in loads)
        (folder / name / "load.csv").write_text("\n".join(["time_s,Fx_N,Fy_N", *rows]))
    changes = {
        "forces.load.file": "first/load.csv",
        "forces.more": {"kind": "time-table", "point": "journal", "file": "second/load.csv"},
        "time": {"end": 2e-3, "tolerance": 1e-3, "largest_step": 0.1},
    }
    scene = write_scene(folder / "journal.toml", "loaded-journal", LOADED_JOURNAL, changes)
    assert call("run", scene, "--no-plots", "--no-error-budget", "-o", folder / "run") == 0
    return folder / "run"


def test_the_page_alone_repeats_the_run(under_loads, no_pictures, tmp_path, monkeypatch):
    """Scene and tables of the page, in an empty folder, give the same history and figures."""
    assert report(under_loads) == 0
    page = page_of(under_loads)
    assert set(page.files) == {"journal.toml", "load.csv", "load-2.csv"}
    for name, content in page.files.items():
        assert hashlib.sha256(content).hexdigest() in page.text
        assert content.decode() in page.text
        (tmp_path / name).write_bytes(content)
    assert str(under_loads.parent) not in page.text
    monkeypatch.chdir(tmp_path)
    (command,) = re.findall("fenics-ehd run (.*)", page.text)
    assert call("run", *command.split(), "--no-plots") == 0
    again = tmp_path / "again"
    assert (again / "history.csv").read_bytes() == (under_loads / "history.csv").read_bytes()
    first, second = (json.loads((f / "summary.json").read_text()) for f in (under_loads, again))
    assert {k: v for k, v in first.items() if k not in OF_THE_MACHINE} == {
        k: v for k, v in second.items() if k not in OF_THE_MACHINE
    }


@pytest.mark.parametrize(
    ("change", "warning"),
    [
        (lambda table: table.write_text(f"{table.read_text()}\n"), "changed after the run"),
        (lambda table: table.unlink(), "not in this page: "),
        (lambda table: table.write_bytes(b"#" * LARGEST + table.read_bytes()), "it has 2.0 MB"),
    ],
)
def test_a_table_that_cannot_repeat_the_run_is_a_warning(
    under_loads, no_pictures, tmp_path, change, warning
):
    folder = copytree(under_loads, tmp_path / "run")
    table = tmp_path / "gas.csv"
    table.write_text("angle_deg,force_N")
    digest = hashlib.sha256(table.read_bytes()).hexdigest()
    stored = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(
        stored.replace(str(under_loads.parent / "second" / "load.csv"), str(table))
    )
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps(summary | {"inputs": {"gas.csv": digest}}))
    change(table)
    assert report(folder) == 0
    page = page_of(folder)
    assert f"gas.csv: {warning}" in page.text or warning in page.text
    assert ("gas.csv" in page.files) == (warning == "changed after the run")


def test_the_page_is_the_same_every_time_and_its_run_replaces_it(reported):
    before = (reported / "report.html").read_bytes()
    assert report(reported) == 0
    assert (reported / "report.html").read_bytes() == before
    assert "report.html" in (reported / "manifest.txt").read_text().split()


@pytest.fixture
def no_pictures(monkeypatch):
    """Reports without pictures, which take most of the time."""
    monkeypatch.setattr("fenics_ehd.study.report.run_page.deciding_pictures", lambda run: ())


def test_warnings_and_a_rejected_run_are_on_the_page(reported, no_pictures, tmp_path):
    folder = copytree(reported, tmp_path / "run")
    summary = json.loads((folder / "summary.json").read_text())
    summary |= {"status": "untrustworthy: <film> too thin", "notices": ["big_end: a & b < c"]}
    (folder / "summary.json").write_text(json.dumps(summary))
    assert report(folder) == 0
    page = page_of(folder)
    assert "not to be relied on. Status of the run: untrustworthy: <film> too thin." in page.text
    assert "big_end: a & b < c" in page.text


def test_a_run_in_progress_has_a_page(reported, tmp_path):
    folder = copytree(reported, tmp_path / "run")
    (folder / "summary.json").unlink()
    assert report(folder) == 0
    page = page_of(folder)
    assert "the run is in progress or was interrupted" in page.text
    assert page.tags.count("img") == 5


def test_a_run_of_0_3_and_a_run_of_python_have_a_page(no_pictures, tmp_path):
    former = copytree(FORMER, tmp_path / "former")
    assert report(former) == 0
    history = ehd.load_history(former)
    assert sorted(page_of(former).names + hidden(history)) == sorted(full_names(history.summary()))
    assert "9.746 MPa ± 0.68 % in" in page_of(former).text  # the budget, without other errors
    own = tmp_path / "own"
    ehd.load_history(former).save(own)
    (own / "scene.toml").unlink(missing_ok=True)
    assert report(own) == 0
    assert "made in Python and has no scene file" in page_of(own).text


def test_a_folder_without_a_run_is_refused_in_one_line(tmp_path, capfd):
    status, _, complaint = exit_of(capfd, "report", tmp_path)
    assert status == 2
    assert "neither a run nor a study" in complaint
    assert complaint.count("\n") == 1


NAMES = st.sampled_from(
    ["max_pressure_Pa", "max_pressure_time_s", "min_film_thickness_m", "cycle_max_pressure_Pa",
     "cycle_max_pressure_angle_deg", "cycle_max_pressure_crank_angle_deg", "contact_share",
     "mean_side_flow_m3_per_s", "cycle_mean_side_flow_m3_per_s", "inlet.flow_m3_per_s",
     "outlet_temperature_C", "cycle_max_force_N", "cycle_max_force_angle_deg",
     "orbit_1x_phase_deg", "anything_new"]
)  # fmt: skip
VALUES = st.floats(-1e9, 1e9, allow_nan=False)


@given(
    joints=st.dictionaries(st.sampled_from(["a", "b.c", "d"]), st.dictionaries(NAMES, VALUES)),
    errors=st.dictionaries(NAMES, VALUES.map(abs)),
    searched=st.booleans(),
)
def test_tables_have_every_figure_once(joints, errors, searched):
    entries = {
        name: {**figures, "errors": {key: errors[key] for key in figures if key in errors}}
        for name, figures in joints.items()
    }
    summary = {"joints": entries, "steps": 5}
    found = []
    for block in figure_blocks(figures_of(summary), "crank", searched=searched):
        for row in (*block.rows, *block.zero):
            assert len(row.cells) == (len(block.heads) or 1)
            assert row.label
            for cell in filter(None, row.cells):
                found += cell.names
                found += [name for position in cell.positions for name in position.names]
    assert sorted(found) == sorted(full_names(summary))


@pytest.mark.parametrize(
    ("name", "value", "error", "zero"),
    [
        ("mean_friction_torque_Nm", 0.31, 5e-4, False),
        ("mean_friction_torque_Nm", 4e-4, 5e-4, False),  # unknown, not zero
        ("cycle_mean_friction_torque_Nm", -4e-4, 5e-4, False),
        ("cycle_mean_friction_torque_Nm", -1e-10, 5e-4, True),
        ("mean_friction_torque_Nm", 1e-10, None, True),  # round-off of 0.5 N m
        ("mean_friction_torque_Nm", 1e-8, None, False),
        ("mean_contact_force_N", 1e-8, None, True),  # round-off of the load, not of the contact
        ("mean_contact_share", 1e-12, None, True),
        ("mean_contact_share", 1e-6, None, False),
        ("max_contact_share", 1e-12, None, False),  # extremes are compared with nothing
        ("max_contact_share", 0.0, None, True),
        ("min_film_thickness_m", 1e-6, 2e-6, False),
        ("orbit_1x_phase_deg", 0.0, 1.0, False),
    ],
)
def test_a_mean_is_zero_within_round_off_alone(name, value, error, zero):
    columns = {
        "friction_torque_Nm": np.array([-0.5, 0.1]),
        "contact_force_N": np.array([2e-8, 0.0]),
        "force_N": np.array([100.0, 50.0]),
    }
    assert is_zero(Figure("pin", name, value, error, ""), columns) == zero


@given(st.floats(1e-12, 1e12), st.sampled_from([1.0, -1.0]))
def test_numbers_have_four_digits(value, sign):
    text = number_text(sign * value).replace("−", "-")
    assert float(text) == pytest.approx(sign * value, rel=6e-4)


def test_printed_units_have_the_factor_of_their_unit():
    for end, (factor, unit) in UNITS.items():
        if unit in ("MPa", "µm", "mm", "ms", "N/mm"):
            assert factor == {"MPa": 1e-6, "µm": 1e6, "mm": 1e3, "ms": 1e3, "N/mm": 1e-3}[unit], end


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (17e-6, "m", "17 µm"),
        (0.022, "m", "22 mm"),
        (0.6, "m", "0.6 m"),
        (210e9, "Pa", "210 GPa"),
        (True, "", "yes"),
        ((0.0, -9.81), "m/s2", "(0, -9.81) m/s²"),
        ((0.025, 0.0), "m", "(25, 0) mm"),
        (((90.0, 12.0, 2e5),), "degrees, degrees, Pa", "(90, 12, 200000) [degrees, degrees, Pa]"),
        (45.0, "degrees", "45°"),
        (90.0, "C", "90 °C"),
    ],
)
def test_settings_have_the_unit_that_fits(value, unit, text):
    assert setting_text(value, unit) == text


@pytest.mark.parametrize("name", ["engine", "rotor", "four-bar", "slider-crank-both-ends"])
def test_every_entry_of_a_scene_is_in_words(name):
    scene = as_stored(name)
    history = ehd.load_history(FORMER)
    entries = [(entry.kind, entry.name) for entry in scene_entries(scene, history)]
    assert len(entries) == len(set(entries))
    tables = ("joints", "drives", "forces", "lubricants")
    expected = sum(len(getattr(scene, table)) for table in tables)
    assert len(entries) == expected + len(set(scene.bodies) - {"ground"}) + 1


def test_bodies_have_their_sizes_and_mass_in_words():
    history = ehd.load_history(FORMER)
    entries = scene_entries(as_stored("rotor"), history)
    words = {entry.name: entry.words for entry in entries if entry.kind == "body"}
    shaft = "elastic shaft, length 1 m, diameter 45 mm, Young's modulus 210 GPa, density 7446 kg/m³"
    assert words["shaft"].startswith(
        f"{shaft}, mass 11.84 kg without disks, spring of 1.58e+08 N/m"
    )
    assert "point force at 0.75 of the length" in words["shaft"]
    assert "bore radius 22.5 mm, bore width 22 mm, wall 10 mm" in words["housing"]
    assert "held at foot, mesh of 20-node hexahedra: bore cells around 20" in words["housing"]
    scene = as_stored("slider-crank")
    inertia = InertiaIntegrals(np.eye(3), np.zeros((3, 3)), np.diag([4e-3, 0.0, 0.0]))
    part = SimpleNamespace(
        inertia=inertia, method="m4", modes=9, provenance={"degrees_of_freedom": "10491"}
    )
    entries = scene_entries(scene, history, {"rod": part})
    words = {entry.name: entry.words for entry in entries if entry.kind == "body"}
    assert (
        words["crank"] == "rigid, mass 1 kg, moment of inertia 0.001 kg m², point pin at (48, 0) mm"
    )
    assert "rod length 0.16 m" in words["rod"]
    assert (
        "mass 1 kg, moment of inertia 0.004 kg m² about the centre of mass at (0, 0) mm"
        in words["rod"]
    )
    assert words["rod"].endswith("10491 unknowns, reduced by M4 to 9 modes")
    held = attrs.evolve(scene, drives={"crank": Speed(0.0)})
    entries = scene_entries(held, history)
    drive = next(entry for entry in entries if entry.kind == "drive")
    assert drive.words == "speed 0 rad/s (0 1/min)"
