"""Animations and ParaView files: what is drawn is what the run recorded."""

import io
import shutil
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from command_line import exit_of
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image
from recorded_runs import BASIS, short_run
from scene_cases import write_scene
from scipy.spatial import cKDTree

import fenics_ehd as ehd
from fenics_ehd.base.plane import rotation
from fenics_ehd.plotting.animated_bodies import body_view, front_faces, outline, shape_of_bores
from fenics_ehd.plotting.animation import Bearing, draw, draw_pin, draw_slider, save_animation
from fenics_ehd.plotting.maps import round_scale
from fenics_ehd.plotting.shown import recorded
from fenics_ehd.reduction.part_files import BasisFile
from fenics_ehd.results.motion import RecordedMotion, between_steps, nearest_steps
from fenics_ehd.results.paraview import part_of_basis, write_run

#: Clearance of the paper's machines [m].
CLEARANCE = 17e-6

#: A weld and a free slider on a line that moves, in a mechanism without a film.
IDEAL = """
[bodies]
ground.points = {hook = [0.1, 0.2], far = [0.3, 0.2]}
crank = {kind = "rigid", mass = 1.0, inertia = 1e-3, position = [0.1, 0.2], points.tip = [0.05, 0]}
weight = {kind = "rigid", mass = 0.1, inertia = 1e-5, position = [0.15, 0.2]}
slot = {kind = "rigid", mass = 0.5, inertia = 1e-3, position = [0.3, 0.2], angle = 180.0}
[joints]
main = {kind = "revolute", between = ["ground.hook", "crank"]}
weld = {kind = "fixed", between = ["crank.tip", "weight"]}
pivot = {kind = "revolute", between = ["slot", "ground.far"]}
slot = {kind = "slider", line = "slot", point = "crank.tip", hold_rotation = false}
[drives]
crank = {kind = "speed", speed = 100.0}
[time]
end = 0.02
"""

#: Parts whose shape over the width is not visible.
COARSE_ROD = {
    "bodies.rod.geometry.bore_cells_along": 2,
    "bodies.rod.reduction.method": "m4",
    "bodies.rod.reduction.estimate_error": False,
}
COARSE_HOUSING = {
    "bodies.housing.geometry.bore_cells_along": 3,
    "bodies.housing.reduction.estimate_error": False,
}


@pytest.fixture(scope="module")
def crank(tmp_path_factory):
    folder, time = tmp_path_factory.mktemp("crank"), {"revolutions": 0.03, "tolerance": 1e-3}
    return short_run(folder, "slider-crank-paper", COARSE_ROD, **time)


@pytest.fixture(scope="module")
def rotor(tmp_path_factory):
    folder, time = tmp_path_factory.mktemp("rotor"), {"revolutions": 0.1, "tolerance": 1e-2}
    return short_run(folder, "rotor-paper", COARSE_HOUSING, of="shaft", **time)


@pytest.fixture(scope="module")
def both_ends(tmp_path_factory):
    folder, time = tmp_path_factory.mktemp("both-ends"), {"revolutions": 0.03, "tolerance": 1e-3}
    return short_run(folder, "slider-crank-both-ends", COARSE_ROD, **time)


@pytest.fixture(scope="module")
def four_bar(tmp_path_factory):
    return short_run(tmp_path_factory.mktemp("four-bar"), "four-bar", end=4e-3, tolerance=1e-3)


BOTH_ENDS = pytest.param("both_ends", marks=pytest.mark.slow)
MACHINES = ["crank", BOTH_ENDS, "rotor", "two_bearings", "four_bar"]


@pytest.fixture(params=MACHINES)
def machine(request):
    return request.getfixturevalue(request.param)


def drawn(given, scale, frames=None):
    """Bodies and bearings as drawn at recorded steps, or at instants between them."""
    run = given.run
    if frames is not None:
        times = run.time
        run = RecordedMotion(
            run.system.mechanism,
            between_steps(run.motion, np.linspace(times[0], times[-1], frames)),
        )
    bodies = {name: body_view(run, name, given.shapes.get(name), scale) for name in run.bodies}
    return bodies, {p.name: Bearing(run, p, bodies, scale) for p in run.system.films}


def call(*arguments, capsys):
    status, out, err = exit_of(capsys, *arguments)
    return SimpleNamespace(status=status, out=out, err=err)


# --- Where things are


def at(bodies, marker):
    name, _, point = marker.partition(".")
    return bodies[name].points[point]


@pytest.mark.parametrize("frames", [None, 37])
def test_at_scale_one_joints_are_closed_as_drawn(machine, frames):
    bodies, bearings = drawn(machine, 1.0, frames)
    for name, joint in machine.run.system.mechanism.joints.items():
        if isinstance(joint, ehd.LubricatedJoint):
            found = bearings[name]
            turns = np.array([rotation(angle) for angle in found.body.pose[:, 2]])
            there = found.centre + np.einsum("tij,tj->ti", turns, found.offset)
            np.testing.assert_allclose(there, at(bodies, joint.journal), atol=1e-8)
        else:
            first, second = (at(bodies, marker) for marker in joint.markers)
            apart = second - first
            if hasattr(joint, "direction"):
                along = np.array(joint.direction) / np.hypot(*joint.direction)
                apart = apart - np.outer(apart @ along, along)
            # Between two steps, motion is interpolated.
            np.testing.assert_allclose(apart, 0.0, atol=1e-9 if frames is None else 1e-7)


def test_a_rod_enlarged_stays_on_its_pins(crank):
    true, _ = drawn(crank, 1.0)
    large, _ = drawn(crank, 300.0)
    chord = true["rod"].points["pin"] - true["rod"].points[""]
    across = np.column_stack([-chord[:, 1], chord[:, 0]]) / np.linalg.norm(chord[0])
    moved = large["rod"].points["pin"] - true["rod"].points["pin"]
    # It stretches along its chord, and does not leave it.
    assert np.abs(np.sum(moved * across, axis=1)).max() < 1e-5 * np.abs(moved).max()
    assert np.abs(moved).max() > 1e-5


@pytest.mark.parametrize("scale", [1.0, 50.0])
@pytest.mark.parametrize("name", ["crank", BOTH_ENDS, "rotor"])
def test_the_drawn_gap_is_the_enlarged_film(name, scale, request):
    given = request.getfixturevalue(name)
    bodies, bearings = drawn(given, scale)
    for place in given.run.system.films:
        bearing, nodes = bearings[place.name], given.shapes[place.surfaces[0].body].nodes
        bore = given.run.part(place.surfaces[0].body).bores[place.surfaces[0].point]
        from_centre = nodes - bore.centre
        edge = np.flatnonzero(np.isclose(np.hypot(*from_centre[:, :2].T), bore.radius))
        x, y, z = from_centre[edge].T
        angle = np.arctan2(y, x)
        reading = place.film.film.parameters.grid.interpolation(angle, z)
        expected = scale * (reading @ given.run.gaps[place.name].T).T
        if place.film.journal_coordinates > 2:
            # The journal is drawn where it is at half the bore's width.
            tilt = given.run.motion.coordinates[:, place.xi[2:4]]
            expected = expected + scale * tilt @ (np.stack([-np.sin(angle), np.cos(angle)]) * z)
        body = bodies[place.surfaces[0].body]
        local = (body.nodes - body.pose[:, None, :2]) @ body.turns
        part = local[:, edge] - bore.centre[:2]
        between = part - bearing.offset[:, None]
        radius = bearing.radius - scale * bearing.film.clearance
        # Radial to second order in what is drawn.
        steps = np.abs(between - from_centre[edge, :2]).max()
        found = np.linalg.norm(between, axis=2) - radius
        np.testing.assert_allclose(found, expected, atol=2 * steps**2 / radius)
        assert steps < 0.3 * radius


def test_the_drawn_film_is_the_recorded_one(machine):
    _, bearings = drawn(machine, 100.0)
    for name, bearing in bearings.items():
        history = machine.result.joints[name].columns
        # The run also watches Gauss points, and the raster has no node of its own.
        thinnest = bearing.gap.min(axis=(1, 2))
        np.testing.assert_allclose(thinnest, history["min_film_thickness_m"], rtol=1e-2)
        highest, expected = bearing.pressure.max(axis=(1, 2)), history["max_pressure_Pa"]
        np.testing.assert_allclose(highest, expected, rtol=0.03, atol=1e-3 * expected.max())


def test_in_a_rigid_bore_the_orbit_is_the_journals_eccentricity(two_bearings, four_bar, crank):
    for given in (two_bearings, four_bar):
        for name, orbit in given.run.orbits.items():
            exact = given.result.joints[name].eccentricity
            np.testing.assert_allclose(orbit, exact, atol=1e-12)
    # A bore that moves as a whole takes the orbit with it, one that stretches does not.
    place, run = crank.run.system.films[0], crank.run
    own = run.motion.coordinates[:, place.xi[:2]]
    assert np.abs(own - run.orbits[place.name]).max() > 0.01 * CLEARANCE


def test_motion_between_steps(crank):
    steps, time = crank.run.motion, crank.run.time
    middle = 0.5 * (time[:-1] + time[1:])
    halfway = between_steps(steps, middle)
    (pressure,), (between,) = steps.pressures.values(), halfway.pressures.values()
    # Cubics do not overshoot.
    assert np.all(between >= np.minimum(pressure[:-1], pressure[1:]) - 1e-6)
    assert np.all(between <= np.maximum(pressure[:-1], pressure[1:]) + 1e-6)
    again = between_steps(steps, time)
    np.testing.assert_allclose(again.coordinates, steps.coordinates, atol=1e-18)
    # Coordinates and their rates agree: a crank of constant speed turns evenly.
    turned = RecordedMotion(crank.run.system.mechanism, halfway).coordinates("crank")[:, 2]
    np.testing.assert_allclose(turned, 500.0 * middle, atol=1e-9)
    assert len(nearest_steps(time, 5)) <= 5


@pytest.mark.parametrize(
    ("largest", "scale"), [(238.0, 200.0), (127.9, 100.0), (0.1, 1.0), (49.0, 40.0), (7.0, 7.0)]
)
def test_automatic_scale_is_round_and_not_above_its_limit(largest, scale):
    assert round_scale(largest) == pytest.approx(scale)


# --- What shows of a part


def test_front_faces_have_the_area_of_an_extruded_part(crank):
    part, body = crank.parts["rod"], crank.run.part("rod")
    faces = front_faces(part.nodes, part.cells)
    x, y, _ = np.moveaxis(part.nodes[faces], -1, 0)
    area = 0.5 * np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1))
    # Polygons in place of arcs; steel of 7850 kg/m3.
    assert area * body.bore.width * 7850.0 == pytest.approx(body.inertia.total_mass, rel=5e-3)
    edges = outline(faces)
    starts, counts = np.unique(edges[:, ::2], return_counts=True)
    assert set(counts) == {2}, "the outline does not close"
    assert len(starts) < len(np.unique(faces[:, ::2]))


def test_basis_on_disk_is_that_of_the_body_alone(crank):
    part, shape, body = crank.parts["rod"], crank.shapes["rod"], crank.run.part("rod")
    shown = np.unique(front_faces(part.nodes, part.cells))
    np.testing.assert_allclose(shape.nodes, part.nodes[shown], atol=1e-15)
    basis = shape.fields[..., : body.modes]
    np.testing.assert_allclose(basis, part.basis[shown, :2], atol=1e-12)
    other = replace(body, bore_basis=1.01 * body.bore_basis)
    # Another reduction of the same part may have turned a mode round.
    signs = np.where(np.arange(body.modes) % 2, -1.0, 1.0)
    turned = replace(body, bore_basis=signs * body.bore_basis)
    with BasisFile(crank.directory / BASIS) as file:
        assert part_of_basis(file, other) is None
        found = part_of_basis(file, turned)
    np.testing.assert_allclose(found.basis, signs * part.basis, atol=1e-12)


def test_a_body_alone_gives_its_bore(crank):
    body, whole = crank.run.part("rod"), crank.shapes["rod"]
    shape = shape_of_bores(body)
    assert not shape.mesh
    radius = np.hypot(*shape.nodes[:, :2].T)
    assert radius.min() == pytest.approx(body.bore.radius)
    values = np.hstack(crank.run.elastic("rod"))[-1]
    inner = np.flatnonzero(np.isclose(radius, radius.min()))
    nearest = [np.linalg.norm(whole.nodes - node, axis=1).argmin() for node in shape.nodes[inner]]
    np.testing.assert_allclose(
        (shape.fields @ values)[inner], (whole.fields @ values)[nearest], rtol=1e-6, atol=1e-12
    )


# --- Pictures


def test_the_figure_of_several_joints_shows_the_chosen_one(two_bearings):
    run, result = two_bearings.run, two_bearings.result
    columns = result.joints["left"].columns | {"time_s": result.time}
    chosen = nearest_steps(run.time, 3)
    frames = RecordedMotion(run.system.mechanism, run.motion.each(lambda values: values[chosen]))
    figure, show = draw(run, frames, {}, "left", None)
    show(2)
    (dot,) = (
        line for axes in figure.axes for line in axes.lines
        if line.get_marker() == "o" and axes.get_xlabel() == "eccentricity x / c"
    )  # fmt: skip
    last = [columns[f"eccentricity_{axis}_m"][-1] / 40e-6 for axis in "xy"]
    np.testing.assert_allclose(np.ravel(dot.get_xydata()), last, rtol=1e-6)
    written = " ".join(text.get_text() for text in figure.texts)
    assert "× 90" in written
    assert f"left, t = {1e3 * columns['time_s'][-1]:.2f} ms" in written


def test_the_angle_in_the_title_is_that_of_the_run(four_bar):
    """In the second turn of a later cycle of two turns."""
    run = four_bar.run
    turned = np.asarray(run.motion.run.crank_angle)
    motion = run.motion.changed(
        {
            "run/crank_angle": turned + 370.0 - turned[0],
            "bodies/crank/angle": np.radians(turned + 3 * 720.0 + 370.0 - turned[0]),
        }
    )
    frames = RecordedMotion(run.system.mechanism, motion)
    figure, show = draw(frames, frames, {}, "rocker_end", None)
    show(0)
    assert "crank 370°" in " ".join(text.get_text() for text in figure.texts)


def test_ideal_joints_are_drawn_where_they_are(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(IDEAL)
    shown = call("run", scene, "-o", tmp_path / "out", "--no-plots", capsys=capsys)
    assert shown.status == 0
    run = recorded(tmp_path / "out")
    bodies = {name: body_view(run, name, None, 100.0) for name in run.bodies}
    axes = Figure().add_subplot()
    joints = run.system.mechanism.joints
    draw_pin(axes, joints["weld"], bodies, 1e-3, -1)
    draw_slider(axes, joints["slot"], bodies, 1e-3, -1)
    angle = 100.0 * run.time[-1]
    tip = np.array([0.1, 0.2]) + 0.05 * np.array([np.cos(angle), np.sin(angle)])
    (weld,) = (line for line in axes.lines if line.get_marker() == "s")
    np.testing.assert_allclose(weld.get_xydata()[0], tip, atol=1e-8)
    (block,) = (patch for patch in axes.patches if isinstance(patch, Polygon))
    np.testing.assert_allclose(block.get_xy()[:4].mean(axis=0), tip, atol=1e-8)
    # The line goes through its pivot and the block.
    (line,) = (line for line in axes.lines if line.get_linestyle() == "-.")
    (x0, y0), (x1, y1) = line.get_xydata()
    for x, y in (tip, (0.3, 0.2)):
        assert (x - x0) * (y1 - y0) - (y - y0) * (x1 - x0) == pytest.approx(0.0, abs=1e-10)
    # There is no film: the mechanism alone, and its energies.
    done = call("animate", tmp_path / "out", "--frames", 2, capsys=capsys)
    assert done.status == 0, done.err
    assert "put in for good" not in shown.out
    drawn = call("plot", tmp_path / "out", capsys=capsys).out.split()
    assert drawn == [str(tmp_path / "out" / f"energy.{suffix}") for suffix in ("png", "svg")]


def gif(path):
    with Image.open(path) as picture:
        return picture.n_frames, picture.size, picture.info["duration"]


def test_command_draws_the_part_of_a_basis_and_writes_a_gif(crank, capsys):
    directory = crank.directory
    target, basis = directory / "animation.gif", ["--basis", directory / BASIS]
    done = call("animate", directory, *basis, "--frames", 2, "--fps", 10, capsys=capsys)
    assert done.status == 0, done.err
    assert done.out.strip() == str(target)
    assert "bores" not in done.err
    assert gif(target) == (2, (960, 540), 100)
    assert not list(directory.glob("*.part*"))


@pytest.mark.parametrize("rate", [20, 24, 30, 40, 45, 50])
def test_a_gif_lasts_as_long_as_its_frames_a_second_say(rate, tmp_path):
    figure = Figure(figsize=(0.4, 0.4))
    count, shades = 12, np.linspace(0, 1, 12)

    def show(frame):
        figure.patch.set_facecolor(str(shades[frame]))

    save_animation(figure, show, count, tmp_path / "a.gif", rate, lambda: None)
    with Image.open(tmp_path / "a.gif") as picture:
        delays = []
        for frame in range(picture.n_frames):
            picture.seek(frame)
            delays.append(picture.info["duration"])
    # Whole hundredths of a second are all that a GIF knows.
    assert sum(delays) == pytest.approx(1000 * count / rate, abs=5)


@pytest.fixture
def stopped(crank, tmp_path):
    """A folder as kill -9 leaves it."""
    for name in ("scene.toml", "body-rod.h5"):
        shutil.copy(crank.directory / name, tmp_path / name)
    cut(crank.directory, tmp_path, 9)
    return tmp_path


def cut(source, target, steps):
    """The first steps of a run, without a summary."""
    history = ehd.load_results(source).each(lambda values: values[:steps])
    replace(history, entries={}).save(target)


@pytest.mark.slow
def test_command_takes_a_stopped_run_and_repeats_itself(stopped, capsys):
    files = []
    for name in ("once.gif", "again.gif"):
        target = stopped / name
        done = call("animate", stopped, "-o", target, "--frames", 2, "--scale", 50, capsys=capsys)
        assert done.status == 0, done.err
        assert f"reduce rod --scene {stopped / 'scene.toml'} --method m4" in done.err
        assert gif(target)[0] == 2
        files.append(target.read_bytes())
    assert files[0] == files[1]


def test_model_in_a_folder_that_somebody_sent_is_not_run(stopped, capsys):
    model = stopped / "rod.geo"
    model.write_text(f'SystemCall "touch {stopped}/ran";\n{ehd.model_path("conrod").read_text()}')
    scene = stopped / "scene.toml"
    scene.write_text(scene.read_text().replace('model = "conrod"', 'model = "rod.geo"'))
    for command in (["animate", stopped, "--frames", 2], ["plot", stopped, "--quantity", "force"]):
        assert call(*command, capsys=capsys).status == 0
    (stopped / "body-rod.h5").unlink()
    assert call("animate", stopped, capsys=capsys).status == 2
    assert not (stopped / "ran").exists()


def test_mp4_is_written_or_the_missing_program_is_named(four_bar, tmp_path, capsys, monkeypatch):
    target = tmp_path / "run.mp4"
    if shutil.which("ffmpeg"):
        done = call("animate", four_bar.directory, "-o", target, "--frames", 2, capsys=capsys)
        assert done.status == 0, done.err
        assert b"ftyp" in io.BytesIO(target.read_bytes()).read(16)
    monkeypatch.setenv("PATH", str(tmp_path))
    refused = call("animate", four_bar.directory, "-o", target, capsys=capsys)
    assert refused.status == 2
    assert "needs ffmpeg" in refused.err


def test_bad_requests_end_with_one_line(crank, stopped, tmp_path, capsys):
    empty = tmp_path / "empty"
    empty.mkdir()
    cases = [
        ((crank.directory, "-o", "run.avi"), ".gif, .mp4"),
        ((empty,), "not a results folder"),
        ((crank.directory, "--joint", "small_end"), "--joint small_end: the lubricated joints of "
         "the run are big_end"),
        ((crank.directory, "--basis", crank.directory / "body-rod.h5"), "basis"),
    ]  # fmt: skip
    for arguments, named in cases:
        refused = call("animate", *arguments, capsys=capsys)
        assert (refused.status, len(refused.err.splitlines())) == (2, 1), refused.err
        assert named in refused.err
    other = replace(ehd.load_body(stopped / "body-rod.h5"), residual=None)
    ehd.save_body(other, stopped / "body-rod.h5")
    refused = call("animate", stopped, capsys=capsys)
    assert (refused.status, "history.h5" in refused.err) == (2, True), refused.err
    shutil.copy(crank.directory / "body-rod.h5", stopped)
    cut(crank.directory, stopped, 1)
    refused = call("animate", stopped, capsys=capsys)
    assert (refused.status, "needs 2" in refused.err) == (2, True), refused.err


# --- ParaView


def opened(series):
    """Times of a series, and blocks at each by group and name, as a reader finds them."""
    found = []
    for entry in ElementTree.parse(series).iter("DataSet"):
        blocks = {
            (group.get("name"), member.get("name")): meshio.read(series.parent / member.get("file"))
            for group in ElementTree.parse(series.parent / entry.get("file")).iter("Block")
            for member in group
        }
        found.append((float(entry.get("timestep")), blocks))
    return zip(*found, strict=True)


def series_of(given, folder, frames=3):
    return write_run(given.built.mechanism, given.result, given.parts, folder / "vtk", frames)


def test_one_file_opens_all_bodies_and_films_where_the_motion_has_them(machine, tmp_path):
    times, frames = opened(series_of(machine, tmp_path))
    run, result = machine.run, machine.result
    expected = nearest_steps(result.time, 3)
    np.testing.assert_allclose(times, result.time[expected], rtol=1e-8)
    names = {("bodies", name) for name in run.bodies} | {("films", name) for name in result.joints}
    for step, blocks in zip(expected, frames, strict=True):
        assert blocks.keys() == names
        for name in run.bodies:
            body = blocks["bodies", name]
            assert np.isfinite(body.point_data["displacement_m"]).all()
            if name not in machine.parts:
                # As they are: at rest and the elastic motion.
                moved = body.points + body.point_data["displacement_m"]
                for point in run.bodies[name].point_names:
                    place = run.marker(name, point)[step, :2]
                    assert np.abs(moved[:, :2] - place).max(axis=1).min() < 1e-12
        for place in run.system.films:
            block, film = blocks["films", place.name], result.joints[place.name].film
            np.testing.assert_allclose(block.point_data["pressure_Pa"], film.pressure[step])
            np.testing.assert_allclose(block.point_data["gap_m"], film.gap[step])
            # Its circle is that of the bore: the journal's place less the eccentricity.
            turn = rotation(run.marker(place.surfaces[0].body, "")[step, 2])
            centre = 0.5 * (block.points.max(axis=0) + block.points.min(axis=0))[:2]
            journal, _, point = place.joint.journal.partition(".")
            away = turn @ result.joints[place.name].eccentricity[step]
            np.testing.assert_allclose(
                centre + away, run.marker(journal, point)[step, :2], atol=0.02 * film.radius
            )


def test_the_film_bends_as_its_gap_says(crank, tmp_path):
    """c - e . n + u . n is the gap; the crank's pin turns at 500 rad/s."""
    times, frames = opened(series_of(crank, tmp_path))
    result, joint = crank.result, crank.result.joints["big_end"]
    for time, blocks, step in zip(times, frames, nearest_steps(result.time, 3), strict=True):
        block, film = blocks["films", "big_end"], joint.film
        turn = rotation(result.bodies["rod"].angle[step])
        pin = 0.048 * np.array([np.cos(500.0 * time), np.sin(500.0 * time)])
        offset = block.points[:, :2] - (pin - turn @ joint.eccentricity[step])
        np.testing.assert_allclose(np.hypot(*offset.T), film.radius, atol=1e-9)
        normal = offset / film.radius
        bent = np.einsum("pi,pi->p", block.point_data["displacement_m"][:, :2], normal)
        gap = film.clearance - normal @ (turn @ joint.eccentricity[step]) + bent
        np.testing.assert_allclose(gap, film.gap[step], atol=1e-10)
        # Nodes of the cells go around them: their corners turn one way.
        corners = block.points[block.cells[0].data[:, :4]]
        sides = np.diff(corners, axis=1)
        out = np.cross(sides[:, 0], sides[:, 1])
        assert (np.einsum("ci,ci->c", out, np.cross(sides[:, 1], sides[:, 2])) > 0).all()
    assert np.abs(bent).max() > 0.1 * CLEARANCE


def test_a_series_has_the_whole_displacement_of_a_part(crank, tmp_path):
    path = series_of(crank, tmp_path)
    run, part = crank.run, crank.parts["rod"]
    (*_, time), (*_, blocks) = opened(path)
    assert time == pytest.approx(run.time[-1], rel=1e-8)
    # What ParaView colours by when it opens the file.
    last = path.with_name("bodies-rod_0002.vtu").read_bytes()
    assert b'<PointData Scalars="pressure_Pa" Vectors="displacement_m">' in last
    mesh = blocks["bodies", "rod"]
    x, y, angle = (crank.result.columns[f"rod.{name}"][-1] for name in ("x_m", "y_m", "angle_rad"))
    turn = np.eye(3)
    turn[:2, :2] = rotation(angle)
    q, amplitudes = (values[-1] for values in crank.run.elastic("rod"))
    expected = part.displacement(q, amplitudes) @ turn.T
    np.testing.assert_allclose(mesh.point_data["displacement_m"], expected, atol=1e-18)
    np.testing.assert_allclose(mesh.points, [x, y, 0.0] + part.nodes @ turn.T, atol=1e-9)
    assert np.abs(part.patterns @ amplitudes).max() > 0.02 * np.abs(expected).max()
    # Film and bore share their nodes, which are where they are on the part and move with it.
    highest = crank.result.joints["big_end"].film.pressure[-1].max()
    assert mesh.point_data["pressure_Pa"].max() == pytest.approx(highest, rel=1e-7)
    film = blocks["films", "big_end"]
    distance, nearest = cKDTree(mesh.points).query(film.points)
    shared = distance < 1e-6
    assert np.count_nonzero(shared) > 100
    np.testing.assert_allclose(
        film.point_data["displacement_m"][shared],
        mesh.point_data["displacement_m"][nearest[shared]],
        atol=1e-9,
    )


def test_a_housing_rests_and_deforms(rotor, tmp_path):
    *_, (*_, blocks) = opened(series_of(rotor, tmp_path, 2))
    mesh, part = blocks["bodies", "housing"], rotor.parts["housing"]
    np.testing.assert_array_equal(mesh.points, part.nodes)
    expected = part.displacement(*(x[-1] for x in rotor.run.elastic("housing")))
    np.testing.assert_allclose(mesh.point_data["displacement_m"], expected, atol=1e-18)
    held = mesh.points[:, 1] < mesh.points[:, 1].min() + 1e-9
    # Held nodes are equations of their own, solved to round-off.
    moved = np.abs(mesh.point_data["displacement_m"])
    assert moved[held].max() < 1e-9 * moved.max()
    assert mesh.point_data["pressure_Pa"].max() > 1e5


def test_command_makes_the_series_of_a_run_after_it(crank, tmp_path, capsys):
    series, basis = tmp_path / "series", crank.directory / BASIS
    arguments = ("paraview", crank.directory, "--frames", 2, "-o", series)
    done = call(*arguments, "--basis", basis, capsys=capsys)
    assert (done.status, done.out) == (0, f"{series / 'run.pvd'}\n"), done.err
    *_, (*_, found) = opened(series / "run.pvd")
    *_, (*_, expected) = opened(series_of(crank, tmp_path, 2))
    ours, reference = (blocks["bodies", "rod"] for blocks in (found, expected))
    np.testing.assert_allclose(ours.points, reference.points, atol=1e-15)
    # What M4's residual patterns move between the bores is not in a basis.
    moved = [mesh.point_data["displacement_m"] for mesh in (ours, reference)]
    assert 0 < np.abs(moved[0] - moved[1]).max() < 0.2 * np.abs(moved[1]).max()
    on_bore = np.abs(moved[0] - moved[1]).max(axis=1) < 1e-15
    assert np.count_nonzero(on_bore) >= len(crank.run.part("rod").bore_nodes)
    assert call(*arguments, capsys=capsys).status == 0
    *_, (*_, found) = opened(series / "run.pvd")
    assert found["bodies", "rod"].cells[0].type == "line"
    refused = call(*arguments, "--basis", crank.directory / "body-rod.h5", capsys=capsys)
    assert (refused.status, len(refused.err.splitlines())) == (2, 1)


def test_a_series_without_a_mesh_has_lines_and_films(tmp_path, capsys):
    scene = write_scene(tmp_path / "scene.toml", "four-bar", {"time": {"end": 1e-5}})
    out = tmp_path / "out"
    done = call("run", scene, "-o", out, "--no-plots", "--vtk", "--frames", 2, capsys=capsys)
    assert done.status == 0, done.err
    *_, (*_, blocks) = opened(out / "vtk" / "run.pvd")
    assert blocks["bodies", "coupler"].cells[0].type == "line"
    assert [name for group, name in blocks if group == "films"] == ["rocker_end"]
