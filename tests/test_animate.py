"""Animations and ParaView files: what is drawn is what the run recorded."""

import io
import shutil
from dataclasses import replace
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from PIL import Image

from fenics_ehd.cli import main
from fenics_ehd.commands.machine_run import (
    BODY_NAME,
    SCENE_NAME,
    MachineRun,
    leave_scene,
    run_machine,
)
from fenics_ehd.commands.rotor import summarise as summarise_rotor
from fenics_ehd.models import model_path
from fenics_ehd.motion import read_motion
from fenics_ehd.output import read_history
from fenics_ehd.paraview import gather_part
from fenics_ehd.plane import rotation
from fenics_ehd.plotting import animation, animation_film
from fenics_ehd.plotting.animation_crank import chord_frames
from fenics_ehd.plotting.animation_part import front_faces, outline
from fenics_ehd.plotting.animation_shape import shape_of_basis, shape_of_bore
from fenics_ehd.plotting.animation_subjects import (
    automatic_scale,
    crank_frames,
    rotor_subject,
    slider_crank_subject,
)
from fenics_ehd.reduction import BasisFile, save_basis, save_body
from fenics_ehd.reduction.distributed import multiply
from fenics_ehd.results import summarise, write_housing_series, write_run_series
from fenics_ehd.scenes import housing, rod, rotor_run, run
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

SHORT = 0.03
BASIS = "part.h5"


def recorded(settings, part, structure, directory, simulate, describe, scene):
    """A run in a folder, as `fenics-ehd run` leaves it."""
    body = part.reduce(structure, settings)
    columns = body.columns
    body = replace(body, columns=None, provenance=part.origin(settings))
    job = MachineRun(settings, body, 0.0, directory, 1.0, simulate, describe)
    run_machine(replace(job, end=scene.simulated_time(settings)))
    fields = gather_part(structure, body, columns)
    save_basis(directory / BASIS, structure, columns, stress=False)
    with BasisFile(directory / BASIS) as file:
        shape = shape_of_basis(file, body)
    return SimpleNamespace(
        directory=directory, settings=settings, body=body, part=fields, shape=shape,
        motion=read_motion(directory), history=read_history(directory),
    )  # fmt: skip


@pytest.fixture(scope="module")
def crank_run(rod_structure, tmp_path_factory):
    settings = SliderCrankSettings()
    settings = attrs.evolve(
        settings,
        mechanism=attrs.evolve(settings.mechanism, revolutions=SHORT),
        reduction=attrs.evolve(settings.reduction, method="m4", estimate_error=False),
        time=attrs.evolve(settings.time, tolerance=1e-3),
    )
    part = SimpleNamespace(
        reduce=lambda structure, s: rod.reduce_structure(structure, s.reduction), origin=rod.origin
    )
    directory = tmp_path_factory.mktemp("crank")
    return recorded(settings, part, rod_structure, directory, run.simulate, summarise, run)


@pytest.fixture(scope="module")
def rotor_scene(housing_structure, tmp_path_factory):
    settings = RotorSettings()
    settings = attrs.evolve(
        settings,
        shaft=attrs.evolve(settings.shaft, revolutions=SHORT),
        reduction=attrs.evolve(settings.reduction, method="m4", estimate_error=False),
        time=attrs.evolve(settings.time, tolerance=1e-2),
    )
    part = SimpleNamespace(
        reduce=lambda structure, s: housing.reduce_structure(structure, s.reduction),
        origin=housing.origin,
    )
    return recorded(
        settings, part, housing_structure, tmp_path_factory.mktemp("rotor"), rotor_run.simulate,
        summarise_rotor, rotor_run,
    )  # fmt: skip


def crank_subject(given, scale, shape=None):
    shape = shape or given.shape
    motion, history = given.motion, given.history
    return slider_crank_subject(given.settings, given.body, shape, motion, history, scale)


def call(*arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    said = capsys.readouterr()
    return SimpleNamespace(status=end.value.code, out=said.out, err=said.err)


def test_residual_patterns_complete_the_static_response_of_the_whole_part(crank_run, rod_structure):
    body, part = crank_run.body, crank_run.part
    pressure = np.random.default_rng(0).random(len(body.pressure_nodes))
    q = np.linalg.solve(body.stiffness, body.load_projection[3:] @ pressure)
    u = part.displacement(q, body.residual.patterns @ pressure).reshape(-1, 1)
    load = multiply(rod_structure.bore.load, pressure[:, None])
    # In balance with the inertia of the rigid acceleration, all of the load is answered.
    rigid = np.hstack([np.tile(np.eye(3), (len(part.nodes), 1)), spins(part.nodes)])
    inertia = multiply(rod_structure.mass, rigid)
    load -= inertia @ np.linalg.solve(rigid.T @ inertia, rigid.T @ load)
    answered = multiply(rod_structure.stiffness, u)
    # Patterns that move the bore by less than 1e-4 of the first one are dropped.
    assert np.linalg.norm(u.T @ (answered - load)) < 1e-3 * np.linalg.norm(u.T @ load)
    without = part.displacement(q, 0 * (body.residual.patterns @ pressure)).reshape(-1, 1)
    assert np.linalg.norm(without - u) > 1e-2 * np.linalg.norm(u)


def spins(nodes):
    x, y, z = nodes.T
    zero = np.zeros_like(x)
    about = ([zero, -z, y], [z, zero, -x], [-y, x, zero])
    return np.column_stack([np.column_stack(axis).ravel() for axis in about])


def test_front_faces_have_the_area_of_an_extruded_part(crank_run):
    part, body = crank_run.part, crank_run.body
    faces = front_faces(part.nodes, part.cells)
    x, y, _ = np.moveaxis(part.nodes[faces], -1, 0)
    area = 0.5 * np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1))
    mass = area * body.bore_width * SliderCrankSettings().rod.density
    # Polygons in place of arcs.
    assert mass == pytest.approx(body.inertia.total_mass, rel=5e-3)
    edges = outline(faces)
    starts, counts = np.unique(edges[:, ::2], return_counts=True)
    assert set(counts) == {2}, "the outline does not close"
    assert len(starts) < len(np.unique(faces[:, ::2]))


@pytest.mark.parametrize("machine", ["crank_run", "rotor_scene"])
def test_the_drawn_film_is_as_thin_as_the_recorded_one(machine, request):
    given = request.getfixturevalue(machine)
    make = slider_crank_subject if machine == "crank_run" else rotor_subject
    subject = make(given.settings, given.body, given.shape, given.motion, given.history, None)
    found, recorded = subject.film.gap.min(axis=(1, 2)), given.history["min_film_thickness_m"]
    # The run also watches Gauss points, and the raster has no node of its own.
    np.testing.assert_allclose(found, recorded, rtol=1e-2)
    highest = subject.film.pressure.max(axis=(1, 2))
    np.testing.assert_allclose(highest, given.history["max_pressure_Pa"], rtol=0.03)


def test_at_scale_one_the_rod_is_where_it_is(crank_run):
    body, motion, shape = crank_run.body, crank_run.motion, crank_run.shape
    frames, _ = crank_frames(crank_run.settings, body, shape, motion, 1.0)
    # The chord's direction and the turn of the nodes about it make up the rod's angle.
    last = -1
    c1, turn = frames.place(last)
    drawn = c1 + frames.rod.local[last] @ turn.T
    q = motion.coordinates[last, 2 : 2 + body.modes]
    moved = motion.coordinates[last, :2] + shape.displacement(q, motion.quasi_static[last])
    true = c1 + (shape.nodes[:, :2] + moved) @ rotation(motion.columns["rod_angle_rad"][last]).T
    np.testing.assert_allclose(drawn, true, atol=1e-10)


def test_the_piston_stays_on_its_line_at_any_scale():
    rng = np.random.default_rng(1)
    angle = np.linspace(0, 6, 9)
    pins = 0.05 * np.column_stack([np.cos(angle), np.sin(angle)])
    pin, motion = np.array([0.15, 0.02]), 1e-5 * rng.standard_normal((9, 2))
    nodes = rng.standard_normal((4, 2))
    local, drawn, turned = chord_frames(
        pins, angle, pin, motion, nodes, lambda i: motion[i] + 0 * nodes, 300.0
    )
    for i in range(9):
        assert (pins[i] + rotation(turned[i]) @ drawn[i])[1] == pytest.approx(0.0, abs=1e-12)
    # Turning about the shaft changes no gap: nodes come as near to it as they are moved.
    radial = nodes / np.linalg.norm(nodes, axis=1)[:, None]
    nearer = np.einsum("tpc,pc->tp", local - nodes, radial)
    moved = np.einsum("tc,pc->tp", motion, radial)
    np.testing.assert_allclose(nearer, 300.0 * moved, atol=300.0 * 1e-3 * 3e-5)


def test_the_drawn_clearance_is_the_enlarged_gap(crank_run, monkeypatch):
    subject = crank_subject(crank_run, 100.0)
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    ring = animation_film.FilmRing(axes, subject.film, 100.0)
    shaft = np.array([0.01, -0.02])
    ring.show(3, shaft, shaft, np.eye(2))
    (oil,) = (c for c in axes.collections if isinstance(c, PolyCollection))
    quads = np.array([path.vertices[:4] for path in oil.get_paths()])
    inner, outer = (np.linalg.norm(quads[:, i] - shaft, axis=1) for i in (0, 3))
    gap = subject.film.gap[3].max(axis=0)[:-1]
    np.testing.assert_allclose(outer - inner, 100.0 * gap, rtol=1e-9)
    assert ring.shaft_radius == pytest.approx(crank_run.body.bore_radius - 100.0 * 17e-6)


@pytest.mark.parametrize(
    ("displacement", "scale"), [(0.0, 200.0), (1e-4, 100.0), (1.0, 1.0), (3e-4, 30.0)]
)
def test_automatic_scale_is_round_and_within_both_limits(displacement, scale):
    assert automatic_scale(17e-6, 0.0225, displacement, 0.16) == pytest.approx(scale)


def test_motion_between_steps_is_on_straight_lines(crank_run):
    steps = crank_run.motion
    middle = 0.5 * (steps.time[:-1] + steps.time[1:])
    between = steps.at(middle)
    np.testing.assert_allclose(
        between.pressure, 0.5 * (steps.pressure[:-1] + steps.pressure[1:]), atol=1e-6
    )
    again = steps.at(steps.time)
    np.testing.assert_allclose(again.coordinates, steps.coordinates, atol=1e-18)
    assert len(steps.nearest(5).time) <= 5


def test_basis_on_disk_is_that_of_the_body_alone(crank_run):
    part, shape = crank_run.part, crank_run.shape
    shown = np.unique(front_faces(part.nodes, part.cells))
    np.testing.assert_allclose(shape.nodes, part.nodes[shown], atol=1e-15)
    np.testing.assert_allclose(shape.basis, part.basis[shown], atol=1e-12)
    other = replace(crank_run.body, bore_basis=1.01 * crank_run.body.bore_basis)
    with BasisFile(crank_run.directory / BASIS) as file:
        assert shape_of_basis(file, other) is None


def test_a_body_alone_gives_its_bore(crank_run):
    shape = shape_of_bore(crank_run.body)
    assert not shape.mesh
    radius = np.hypot(*shape.nodes[:, :2].T)
    assert radius.min() == pytest.approx(crank_run.body.bore_radius)
    q, y = crank_run.motion.coordinates[-1, 2:], crank_run.motion.quasi_static[-1]
    whole = crank_run.shape
    inner = np.flatnonzero(np.isclose(radius, radius.min()))
    at = [np.linalg.norm(whole.nodes - node, axis=1).argmin() for node in shape.nodes[inner]]
    np.testing.assert_allclose(
        shape.displacement(q, y)[inner], whole.displacement(q, y)[at], rtol=1e-6, atol=1e-12
    )


def gif(path):
    with Image.open(path) as picture:
        return picture.n_frames, picture.size, picture.info["duration"]


def test_command_draws_the_part_of_a_basis_and_writes_a_gif(crank_run, capsys):
    directory = crank_run.directory
    target, basis = directory / "animation.gif", ["--basis", directory / BASIS]
    done = call("animate", directory, *basis, "--frames", 2, "--fps", 10, capsys=capsys)
    assert done.status == 0, done.err
    assert done.out.strip() == str(target)
    assert "only the bore" not in done.err
    assert gif(target) == (2, (960, 540), 100)
    assert not list(crank_run.directory.glob("*.part*"))


@pytest.mark.parametrize("rate", [20, 24, 30, 40, 45, 50])
def test_a_gif_lasts_as_long_as_its_frames_a_second_say(rate, tmp_path):
    figure = animation.plt.figure(figsize=(0.4, 0.4))
    count, shades = 12, np.linspace(0, 1, 12)

    def show(frame):
        figure.patch.set_facecolor(str(shades[frame]))

    animation._write_gif(figure, show, count, tmp_path / "a.gif", rate, lambda: None)
    animation.plt.close(figure)
    with Image.open(tmp_path / "a.gif") as picture:
        delays = []
        for frame in range(picture.n_frames):
            picture.seek(frame)
            delays.append(picture.info["duration"])
    # Whole hundredths of a second are all that a GIF knows.
    assert sum(delays) == pytest.approx(1000 * count / rate, abs=5)


@pytest.mark.parametrize("low", [-0.011, 0.0, 0.1, -0.122])
def test_a_bore_is_drawn_wherever_it_lies(low):
    around, along = np.meshgrid(np.linspace(0, 2 * np.pi, 20, endpoint=False), np.linspace(0, 1, 5))
    height = low + 0.022 * along
    nodes = np.stack([0.0225 * np.cos(around), 0.0225 * np.sin(around), height], -1).reshape(-1, 3)
    values = along.reshape(1, -1)
    film = animation_film.film_frames(nodes, values, nodes, values, 17e-6)
    for raster in (film.pressure, film.gap):
        np.testing.assert_allclose(raster[0, :, 0], np.linspace(0, 1, len(film.height)), atol=1e-8)
        assert np.isfinite(raster).all()


@pytest.fixture
def stopped(crank_run, tmp_path):
    """A folder as kill -9 leaves it."""
    for name in ("history.h5", SCENE_NAME, BODY_NAME):
        shutil.copy(crank_run.directory / name, tmp_path / name)
    lines = (crank_run.directory / "history.csv").read_text().splitlines(keepends=True)
    (tmp_path / "history.csv").write_text("".join(lines[:9]) + lines[9][:20])
    return tmp_path


def test_command_takes_a_stopped_run_and_repeats_itself(stopped, capsys):
    files = []
    for name in ("once.gif", "again.gif"):
        target = stopped / name
        done = call("animate", stopped, "-o", target, "--frames", 2, "--scale", 50, capsys=capsys)
        assert done.status == 0, done.err
        assert f"reduce conrod --scene {stopped / SCENE_NAME}" in done.err
        assert gif(target)[0] == 2
        files.append(target.read_bytes())
    assert files[0] == files[1]


def test_model_in_a_folder_that_somebody_sent_is_not_run(stopped, crank_run, capsys):
    """Neither for a picture nor by a command that goes on with a run."""
    model = stopped / "rod.geo"
    model.write_text(f'SystemCall "touch {stopped}/ran";\n{model_path("conrod").read_text()}')
    settings = attrs.evolve(crank_run.settings.rod, model=str(model))
    leave_scene(attrs.evolve(crank_run.settings, rod=settings), stopped)
    made = rod.origin(attrs.evolve(crank_run.settings, rod=settings))
    save_body(replace(crank_run.body, provenance=made), stopped / BODY_NAME)
    for command in (["animate", stopped, "--frames", 2], ["plot", stopped], ["info"]):
        assert call(*command, capsys=capsys).status == 0
    assert not (stopped / "ran").exists()


def test_rotor_is_drawn_with_its_orbit(rotor_scene, tmp_path):
    motion = rotor_scene.motion.nearest(2)
    given = rotor_scene.settings, rotor_scene.body, rotor_scene.shape, motion, rotor_scene.history
    subject = rotor_subject(*given, None)
    figure, show = animation.draw(subject)
    show(1)
    titles = [axes.get_title() for axes in figure.axes]
    assert "shaft in the housing" in titles
    assert "orbit, clearance 17 µm" in titles
    assert "× 200" in subject.note
    orbit = figure.axes[titles.index("orbit, clearance 17 µm")]
    dot = np.ravel([line.get_xydata() for line in orbit.lines if line.get_marker() == "o"])
    last = [rotor_scene.history[f"eccentricity_{c}_m"][-1] * 1e6 for c in "xy"]
    np.testing.assert_allclose(dot, last)


def test_mp4_is_written_or_the_missing_program_is_named(crank_run, tmp_path, capsys, monkeypatch):
    target = tmp_path / "run.mp4"
    if shutil.which("ffmpeg"):
        subject = crank_subject(crank_run, None, shape_of_bore(crank_run.body))
        short = replace(subject, time=subject.time[:2])
        animation.save_animation(short, target, 10, lambda: None)
        assert b"ftyp" in io.BytesIO(target.read_bytes()).read(16)
    monkeypatch.setenv("PATH", str(tmp_path))
    refused = call("animate", crank_run.directory, "-o", target, capsys=capsys)
    assert refused.status == 2
    assert "needs ffmpeg" in refused.err


def test_bad_requests_end_with_one_line(crank_run, stopped, tmp_path, capsys, rod_body):
    save_body(rod_body, tmp_path / "other.h5")
    empty = tmp_path / "empty"
    empty.mkdir()
    one_step = (stopped / "history.csv").read_text().splitlines(keepends=True)[:2]
    cases = [
        ((crank_run.directory, "-o", "run.avi"), ".gif, .mp4"),
        ((empty,), "not a run of slider-crank or rotor"),
        ((crank_run.directory, "--body", tmp_path / "other.h5"), "--body"),
        ((crank_run.directory, "--basis", crank_run.directory / BODY_NAME), "basis"),
    ]
    for arguments, named in cases:
        refused = call("animate", *arguments, capsys=capsys)
        assert (refused.status, len(refused.err.splitlines())) == (2, 1), refused.err
        assert named in refused.err
    (stopped / BODY_NAME).rename(stopped / "moved.h5")
    refused = call("animate", stopped, capsys=capsys)
    assert (refused.status, "by --body" in refused.err) == (2, True), refused.err
    (stopped / "moved.h5").rename(stopped / BODY_NAME)
    (stopped / "history.csv").write_text("".join(one_step))
    refused = call("animate", stopped, capsys=capsys)
    assert (refused.status, "needs 2" in refused.err) == (2, True), refused.err


def test_paraview_series_has_times_and_the_whole_displacement(crank_run, tmp_path):
    import xml.etree.ElementTree as ElementTree

    meshio = pytest.importorskip("meshio")
    for name in ("history.csv", "history.h5"):
        shutil.copy(crank_run.directory / name, tmp_path / name)
    body, motion = crank_run.body, crank_run.motion
    path = write_run_series(crank_run.settings, body, crank_run.part, tmp_path, 3)
    entries = list(ElementTree.parse(path).iter("DataSet"))
    times = [float(entry.get("timestep")) for entry in entries]
    np.testing.assert_allclose(times, motion.nearest(3).time, rtol=1e-8)
    last = path.parent / entries[-1].get("file")
    # What ParaView colours by when it opens the file.
    assert b'<PointData Scalars="pressure_Pa" Vectors="displacement_m">' in last.read_bytes()
    mesh = meshio.read(last)
    angle = motion.columns["rod_angle_rad"][-1]
    turn = np.eye(3)
    turn[:2, :2] = rotation(angle)
    q, y = motion.coordinates[-1, 2:], motion.quasi_static[-1]
    expected = crank_run.part.displacement(q, y) @ turn.T
    np.testing.assert_allclose(mesh.point_data["displacement_m"], expected, atol=1e-18)
    assert np.abs(crank_run.part.patterns @ y).max() > 0.02 * np.abs(expected).max()


def test_paraview_series_of_a_housing_rests_and_deforms(rotor_scene, tmp_path):
    meshio = pytest.importorskip("meshio")
    for name in ("history.csv", "history.h5"):
        shutil.copy(rotor_scene.directory / name, tmp_path / name)
    path = write_housing_series(rotor_scene.body, rotor_scene.part, tmp_path, 2)
    assert path.name == "housing.pvd"
    mesh = meshio.read(path.parent / "housing_0001.vtu")
    np.testing.assert_array_equal(mesh.points, rotor_scene.part.nodes)
    q = rotor_scene.motion.coordinates[-1, rotor_scene.settings.shaft.modes :]
    expected = rotor_scene.part.displacement(q, rotor_scene.motion.quasi_static[-1])
    np.testing.assert_allclose(mesh.point_data["displacement_m"], expected, atol=1e-18)
    held = mesh.points[:, 1] < mesh.points[:, 1].min() + 1e-9
    # Held nodes are equations of their own, solved to round-off.
    moved = np.abs(mesh.point_data["displacement_m"])
    assert moved[held].max() < 1e-9 * moved.max()
    assert mesh.point_data["pressure_Pa"].max() > 1e5
