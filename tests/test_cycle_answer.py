"""What a run tells over the crank angle: places, the journal in its deformed bore, last cycles."""

import numpy as np
import pytest
from journal_cases import ETA, OMEGA, UNIT_LOAD, C, R, ellipse, in_bearing, journal, make_film
from scipy.interpolate import PchipInterpolator

import fenics_ehd as ehd
from fenics_ehd.base.columns import Quantity
from fenics_ehd.base.errors import UnknownNameError
from fenics_ehd.base.extremes import over_time
from fenics_ehd.cli.run import joint_lines
from fenics_ehd.cli.stress import instants_of
from fenics_ehd.film.grid import aligned_grid
from fenics_ehd.multibody.cycle import Cycle, Recurrence
from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.multibody.quantities import upper_most
from fenics_ehd.multibody.summary import EXTREMES, cycle_figures
from fenics_ehd.multibody.tabulated import Curve
from fenics_ehd.plotting.shown import ShownRun, moving_part

TURN = 2 * np.pi / OMEGA


@pytest.mark.parametrize("family", ["lagrange", "serendipity", "bilinear", "uneven"])
def test_journal_is_told_from_the_least_squares_circle_of_its_bore(family):
    """A bore moved, widened, oval, tilted: what is left is the way from its centre."""
    grid = ehd.uniform_grid(R, 2 * R, (20, 4), "lagrange" if family == "uneven" else family)
    if family == "uneven":
        grid = aligned_grid(grid, np.array([0.3, 0.7]))
    film = ehd.Film(ehd.FilmParameters(grid, C, ehd.Lubricant(ETA), OMEGA))
    angle, height = grid.node_positions.T
    journal_at, centre, wider, oval = np.array([7e-6, -3e-6]), np.array([-2e-6, 5e-6]), 1e-6, 2e-6
    normal = np.stack([np.cos(angle), np.sin(angle)])
    bore = wider + centre @ normal + 1e-4 * height * np.cos(angle)
    gap = C + bore - journal_at @ normal
    # A wave that is no first harmonic belongs to no centre, but for what an uneven mesh makes of it
    waves = 0.0 if family == "uneven" else oval * np.cos(2 * angle + 0.4)
    joint = JointFilm(ehd.LubricatedJoint("journal", "bore", film))
    found = joint.circle @ (gap + waves)
    np.testing.assert_allclose(found, journal_at - centre, rtol=0, atol=1e-14)


def test_of_equal_places_the_upper_one_is_told():
    places = np.array([[0.1, -1.0], [0.1, 1.0], [0.2, 0.0]])
    for off in (0.0, 1e-13, -1e-13):
        assert upper_most(places, np.array([1.0 + off, 1.0 - off, 2.0])) == (0.1, 1.0)


def at_rest(load, *, turned=0.0):
    """A journal under a constant load along x in a bore whose frame is turned."""
    film = make_film((64, 8))
    joint = ehd.LubricatedJoint("journal", "block", film, eccentricity=(0.1 * C, 0.0))
    weight = ehd.PointForce("journal", (1.0, 0.0), lambda _: (load, 0.0))
    bodies = {
        "journal": ehd.MasslessBody(),
        "block": ehd.RigidBody(1e9, 1e9, angle=np.degrees(turned)),
    }
    drives = {"journal": ehd.Speed(OMEGA), "block": ehd.Speed(0.0, turned)}
    machine = ehd.Mechanism(bodies, {"film": joint}, drives, {"load": weight})
    return ehd.simulate(machine, 6 * TURN, tolerance=1e-3)


@pytest.mark.parametrize("turned", [pytest.param(0.0, marks=pytest.mark.slow), 0.8])
def test_journal_at_rest_lies_where_its_bearing_says(turned, figure):
    settings = ehd.BearingSettings(
        radius=R, width=2 * R, clearance=C, viscosity=ETA, speed=OMEGA, cells_along=8
    )
    load = 0.2 * UNIT_LOAD
    expected = ehd.solve_bearing(settings, load=load)
    columns = at_rest(load, turned=turned).joints["film"].columns
    end = {name: values[-1] for name, values in columns.items()}
    attitude = abs(end["attitude_angle_deg"] - np.degrees(expected.attitude))
    figure("answers", f"attitude of a journal at rest, bore at {turned:g} rad", attitude, most=0.1)
    assert end["eccentricity_ratio"] == pytest.approx(expected.eccentricity_ratio, rel=2e-3)
    assert end["force_N"] == pytest.approx(load, rel=1e-6)
    # Of the load on the bore, from the bore's x axis.
    assert end["force_angle_deg"] == pytest.approx(-np.degrees(turned), abs=1e-3)
    np.testing.assert_allclose(
        [columns[f"eccentricity_in_bore_{axis}_m"] for axis in "xy"],
        [columns[f"eccentricity_{axis}_m"] for axis in "xy"],
        atol=1e-18,
    )
    # The film is thinnest on the line of centres, within half a cell.
    line = end["attitude_angle_deg"] + end["force_angle_deg"]
    assert abs(end["min_film_angle_deg"] - line) < 4.5 + 1e-6
    assert end["max_pressure_height_m"] == 0.0


def loaded(turns):
    mechanism, period = journal(make_film((16, 3)), ellipse(0.2, 0.5, 1), 2 * TURN)
    return ehd.simulate(mechanism, turns * TURN, tolerance=1e-3), mechanism, period


def test_last_cycle_of_a_run_is_that_of_its_loads():
    """Of 5 turns under a load over two: turns 3 to 5, and the start is left out."""
    result, _, period = loaded(5.0)
    assert result.summary()["cycle_used"] == "last of 2"
    found, columns = result.figures["bearing"], result.columns
    angle = columns["crank_angle_deg"]
    assert np.all(np.diff(angle) > 0.0)
    assert angle[-1] == pytest.approx(1800.0)
    late = columns["time_s"] > 5 * TURN - period
    times = columns["time_s"]
    for key, column, sign in (
        ("max_pressure_Pa", "max_pressure_Pa", 1),
        ("min_film_thickness_m", "min_film_thickness_m", -1),
        ("max_force_N", "force_N", 1),
        ("max_eccentricity_ratio", "eccentricity_ratio", 1),
    ):
        value, at = over_time(times[late], columns[column][late], None, sign)
        assert found[f"cycle_{key}"] == pytest.approx(value, rel=1e-12)
        # It lies beyond the largest step, and not far beyond.
        sampled = sign * (sign * columns[column][late]).max()
        assert 0.0 <= sign * (value / sampled - 1.0) < 0.02
        if column == "min_film_thickness_m":
            # Without the whole cycle before, as in pictures.
            expected = np.interp(at, times[late], angle[late]) - 720.0
            assert found["cycle_min_film_crank_angle_deg"] == pytest.approx(expected)
    row = np.flatnonzero(late)[np.argmin(columns["min_film_thickness_m"][late])]
    assert found["cycle_min_film_angle_deg"] == columns["min_film_angle_deg"][row]
    assert found["cycle_min_film_height_m"] == columns["min_film_height_m"][row]
    time = np.linspace(5 * TURN - period, 5 * TURN, 4001)
    mean = np.mean(np.interp(time, columns["time_s"], columns["force_N"]))
    assert found["cycle_mean_force_N"] == pytest.approx(mean, rel=2e-3)
    # Those of version 0.1 are of all of it.
    for column, sign in (("max_pressure_Pa", 1), ("min_film_thickness_m", -1)):
        value = over_time(times, columns[column], None, sign)[0]
        assert found[column] == pytest.approx(value, rel=1e-12)


def test_run_without_a_full_cycle_is_told_whole():
    result, *_ = loaded(1.5)
    assert result.summary()["cycle_used"] == "whole run: no full cycle"
    found = result.figures["bearing"]
    assert found["cycle_max_pressure_Pa"] == found["max_pressure_Pa"]


@pytest.mark.slow
def test_search_tells_its_last_cycle_from_its_own_zero():
    mechanism, period = journal(make_film((16, 3)), ellipse(0.2, 0.5, 2), 2 * TURN)
    result = ehd.simulate(mechanism, period=period, tolerance=1e-2, periodicity=1e-2)
    assert result.summary()["cycle_used"] == f"last of {result.cycles}"
    angle = result.columns["crank_angle_deg"]
    assert angle[0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff(angle) > 0.0)
    assert angle[-1] == pytest.approx(720.0)
    found = result.figures["bearing"]
    for key in ("max_pressure_Pa", "min_film_thickness_m"):
        assert found[f"cycle_{key}"] == found[key]


def test_a_cycle_of_two_turns_keeps_its_stroke():
    """Begun in the second turn of its loads: 400 degrees are no 40 in a later cycle either."""
    angles = np.radians([0.0, 180.0, 370.0, 540.0, 720.0])
    sizes = 0.1 * UNIT_LOAD * np.array([1.0, 1.5, 4.0, 1.5, 1.0])
    load = Curve(PchipInterpolator(angles, sizes), periodic=True)
    mechanism = in_bearing(
        make_film((16, 3)), {"gas": ehd.PointForce("journal", (0.0, -1.0), load, "journal")}
    )
    mechanism.bodies["journal"] = ehd.RigidBody(0.0, 0.0, angle=400.0)
    mechanism.drives["journal"] = ehd.Speed(OMEGA, np.radians(400.0))
    result = ehd.simulate(mechanism, period=2 * TURN, tolerance=1e-2, periodicity=1e-2)
    angle = result.columns["crank_angle_deg"]
    assert result.cycles > 1
    assert angle[[0, -1]] == pytest.approx([400.0, 1120.0])
    # The largest force is that of the table, a turn and ten degrees after its start.
    strongest = angle[np.argmax(result.columns["force_N"])]
    assert strongest == pytest.approx(1090.0, abs=5.0)
    np.testing.assert_array_equal(result.angle_of("journal"), angle)


@pytest.mark.parametrize(("first", "shown"), [(1440.0, 0.0), (1800.0, 0.0), (400.0, 40.0)])
def test_angle_of_a_body_is_that_of_the_run(first, shown):
    """Where the body turns with the run's angle; another one begins within a turn."""
    turned = np.linspace(0.0, 720.0, 9)
    values = {
        "time": Quantity(turned, "s"),
        "run/crank_angle": Quantity(turned, "deg"),
        "bodies/crank/angle": Quantity(np.radians(1440.0 + turned), "rad"),
        "bodies/cam/angle": Quantity(np.radians(first + 0.5 * turned), "rad"),
        "bodies/piston/x": Quantity(turned, "m"),
    }
    found = ehd.History(values)
    np.testing.assert_array_equal(found.angle_of("crank"), turned)
    np.testing.assert_allclose(found.angle_of("cam"), shown + 0.5 * turned)
    assert found.angle_of("piston") is None
    with pytest.raises(UnknownNameError, match=r"result.bodies\['none'\].*crank, cam, piston"):
        found.angle_of("none")


def test_search_that_was_stopped_tells_its_last_whole_cycle():
    """Steps of three cycles, the third cut off: extremes, means and times are of the second."""
    numbers = np.repeat([1, 2, 3], [4, 5, 2])
    clock = np.concatenate([np.linspace(0.5, 2.0, 4), np.linspace(0.4, 2.0, 5), [0.4, 0.8]])
    peak = 10.0 * numbers + np.arange(len(clock)) % 3
    own = {name: peak for _, column, *_, places in EXTREMES for name in (column, *places)}
    columns = {f"joints/pin/{name}": v for name, v in (own | {"flow_m3_per_s": clock}).items()}
    columns |= {"time_s": 2.0 * (numbers - 1) + clock, "run/crank_angle_deg": 180.0 * clock}
    columns |= {"run/cycle": numbers, "run/cycle_time_s": clock}

    def answer(steps):
        part = {name: values[:steps] for name, values in columns.items()}
        cycle = Cycle.of_columns(part, Recurrence())
        return cycle, cycle_figures(cycle, part, "pin", ["flow_m3_per_s"])

    (stopped, found), (whole, others), (first, _) = (answer(steps) for steps in (11, 9, 3))
    assert stopped == whole
    assert stopped.complete
    assert stopped.label == "last of 2"
    assert stopped.start == pytest.approx(2.0)
    assert stopped.end == pytest.approx(4.0)
    for name, sign in (("max_pressure_Pa", 1), ("min_film_thickness_m", -1)):
        value = over_time(clock[4:9], peak[4:9].astype(float), 2.0, sign)[0]
        assert found[f"cycle_{name}"] == pytest.approx(value)
        assert value == pytest.approx(sign * (sign * peak[4:9]).max(), rel=0.02)
    # Means of models are those of the cycle under way, unless that is not the one.
    assert found["cycle_mean_flow_m3_per_s"] == pytest.approx(1.2, abs=0.1)
    assert "cycle_mean_flow_m3_per_s" not in others
    assert first.label == "first cycle: films build up"
    assert not first.complete


def stored_run(folder, times, cycle, numbers=None):
    """The history of a run of a journal in a folder, its steps at the given times [s]."""
    units = {
        "time": "s", "run/crank_angle": "deg", "run/kinetic_energy": "J", "run/strain_energy": "J",
        "joints/pin/max_pressure": "Pa", "state/coordinates": "mixed", "state/rates": "mixed",
    }  # fmt: skip
    values = dict.fromkeys(units, np.zeros(len(times)))
    values |= {"time": times, "run/crank_angle": 360.0 * times, "joints/pin/max_pressure": times}
    values |= {f"state/{name}": np.zeros((len(times), 1)) for name in ("coordinates", "rates")}
    if numbers is not None:
        units |= {"run/cycle": "1", "run/cycle_time": "s"}
        values |= {"run/cycle": numbers, "run/cycle_time": times - (numbers - 1)}
    quantities = {path: Quantity(np.asarray(v, float), units[path]) for path, v in values.items()}
    ehd.History(quantities, ("joints/pin/eccentricity_x",), ("m",), stored_cycle=cycle).save(folder)
    return folder


@pytest.mark.parametrize("stored", [True, False], ids=["stored", "without stored cycle"])
@pytest.mark.parametrize(
    ("times", "numbers", "first", "last", "label"),
    [
        # The search was stopped within its third cycle, and within its first.
        (np.arange(0.25, 2.75, 0.25), [1] * 4 + [2] * 4 + [3] * 2, 1.25, 2.0, "last of 2"),
        (np.arange(0.25, 1.00, 0.25), [1] * 3, 0.25, 0.75, "first cycle: films build up"),
        # A run once through, and one that is shorter than a cycle.
        (np.arange(0.25, 3.00, 0.25), None, 2.0, 2.75, "last of 2"),
        (np.arange(0.25, 1.00, 0.25), None, 0.25, 0.75, "whole run: no full cycle"),
    ],
    ids=["stopped in a cycle", "stopped in the first", "once through", "no cycle"],
)
def test_every_reader_has_the_steps_of_the_same_cycle(
    times, numbers, first, last, label, stored, tmp_path
):
    """Of a run that was stored without its cycle and has no numbers, all steps count."""
    columns = {"time_s": times, "run/crank_angle_deg": 360.0 * times}
    if numbers is not None:
        numbers = np.array(numbers, float)
        columns |= {"run/cycle": numbers, "run/cycle_time_s": times - (numbers - 1)}
    cycle = Cycle.of_columns(columns, Recurrence())
    folder = stored_run(tmp_path, times, cycle if stored else None, numbers)
    history = ehd.load_history(folder)
    if not stored and numbers is None:
        first, label = times[0], "whole run"
        cycle = Cycle(0.0, times[-1], label, complete=False, periodic=False)
    assert history.cycle == cycle
    assert cycle.label == label
    assert cycle.period == cycle.end - cycle.start
    assert cycle.complete == label.startswith("last")
    rows = cycle.rows(times)
    shown_run = ShownRun("", folder)
    shown_times = shown_run.time + cycle.start
    instants = instants_of(ehd.read_scene("four-bar"), history.last_cycle())
    # A run once through has a step at the start of its cycle, which belongs to it as well.
    after_start = slice(int(cycle.start > 0.0 and numbers is None), None)
    shown_after_start = slice(int(cycle.start > 0.0), None)
    for reader in (
        times[rows],
        history.last_cycle().run.time[after_start],
        instants["time_s"][after_start] + cycle.start,
        shown_times[shown_after_start],
    ):
        assert reader[0] == pytest.approx(first)
        assert reader[-1] == pytest.approx(last)
        np.testing.assert_allclose(reader, times[rows], atol=1e-12)
    assert len(moving_part(history)) == (rows.stop - rows.start if cycle.periodic else len(times))
    assert shown_run.label == ("" if cycle.complete else label)
    summary = {"cycles": 3} if numbers is not None else {}
    assert Cycle.of_summary(summary | cycle.entries()) == cycle


def test_one_mean_of_a_flow_is_printed():
    """That over the cycle under way, where there is one."""
    flows = {"mean_side_flow_m3_per_s": 1e-6, "mean_inlet.flow_m3_per_s": 2e-6}
    extremes = {"max_pressure_Pa": 1e7, "max_pressure_time_s": 1.0}
    extremes |= {"min_film_thickness_m": 1e-6, "min_film_thickness_time_s": 1.0}
    _, _, *lines = joint_lines(extremes | flows | {"cycle_mean_side_flow_m3_per_s": 3e-6})
    assert [line.split()[-3:-1] for line in lines] == [["inlet", "2.0000"], ["side", "3.0000"]]


def test_crank_angle_is_that_of_what_is_driven():
    """By a speed, else by a torque, else the journal's; the column is there without any film."""

    def angles(drives, forces):
        wheel, other = (
            ehd.RigidBody(1.0, 1e-3, angle=np.degrees(0.5)),
            ehd.RigidBody(1.0, 1e-3, speed=20.0),
        )
        bodies = {"wheel": wheel, "axle": other, "ground": ehd.ground({})}
        joints = {name: ehd.Revolute(("ground", name)) for name in ("wheel", "axle")}
        machine = ehd.Mechanism(bodies, joints, drives, forces)
        return ehd.simulate(machine, 0.1, tolerance=1e-6).columns["crank_angle_deg"]

    assert angles({"wheel": ehd.Speed(10.0, 0.5)}, {})[-1] == pytest.approx(np.degrees(1.5))
    torque = ehd.Torque("wheel", torque=0.2)
    assert angles({}, {"motor": torque})[-1] == pytest.approx(np.degrees(1.5), rel=1e-4)
    assert angles({}, {})[-1] == pytest.approx(np.degrees(2.0), rel=1e-4)
