"""Bores and journals that are not round: shapes, gaps, derivatives of a step, turned frames."""

from dataclasses import replace

import numpy as np
import pytest
from attrs import evolve
from film_cases import oval
from hand_made_rod import Joint, flexible, make_mechanism, run, with_residual
from journal_cases import ETA, OMEGA, UNIT_LOAD, C, R, in_bearing, make_film
from moving_point import assert_derivatives
from scipy.interpolate import CubicSpline

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.notices import stepped_shapes
from fenics_ehd.multibody.run import Run

pytestmark = pytest.mark.kernels

# --- Shapes alone


def table(angles=24, heights=5, function=None):
    """Of a smooth function of angle and height."""
    phi = np.linspace(0.3, 0.3 + 2 * np.pi, angles, endpoint=False)
    z = np.linspace(-R, R, heights)
    function = function or (lambda a, b: 2e-6 * np.cos(3 * a) * (1 + b / R) + 1e-6 * np.sin(a))
    return ehd.ShapeTable(phi, z, function(phi[:, None], z[None, :]))


SHAPES = {
    "oval": oval(3e-6, 0.4),
    "profile": ehd.Shape(half_width=R, barrel=2e-6, taper=-1e-6),
    "misaligned": ehd.Shape(misalignment=(1e-4, -2e-4)),
    "table": ehd.Shape(measured=table()),
    "sum": evolve(oval(1e-6, 1.0, 3), half_width=R, barrel=1e-6, measured=table()),
}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_derivatives_along_the_angle_are_exact(shape):
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(-7, 7, 50), rng.uniform(-R, R, 50)
    step = 1e-5
    for order in (1, 2):
        before, after = (shape.radial(angle + s * step, height, order - 1) for s in (-1, 1))
        np.testing.assert_allclose(
            shape.radial(angle, height, order), (after - before) / (2 * step), atol=1e-5 * 1e-5
        )
    np.testing.assert_allclose(
        shape.radial(angle + 2 * np.pi, height), shape.radial(angle, height), atol=1e-18
    )
    round_one = not np.ptp(shape.radial(angle, np.zeros(50)))
    assert shape.round == (round_one and not any(shape.misalignment))


def test_a_table_meets_its_function_to_fourth_order_around():
    def bumpy(angle, height):
        return np.exp(np.sin(2 * angle)) * (1.0 + height / R)

    angle = np.random.default_rng(1).uniform(0, 7, 200)
    height = np.linspace(-R, R, 200)
    errors = [
        np.abs(table(n, 3, bumpy).radial(angle, height) - bumpy(angle, height)).max()
        for n in (20, 40, 80)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.5)


def spline_of(measured):
    """Periodic cubic spline through the rows of a table, every height for itself."""
    closed = np.append(measured.angles, measured.angles[0] + 2 * np.pi)
    rows = np.vstack([measured.deviations, measured.deviations[:1]])
    return CubicSpline(closed, rows, bc_type="periodic")


@pytest.mark.parametrize("lobes", [2, 3, 4])
def test_a_smooth_table_is_the_spline_to_the_last_bit(lobes):
    # Five rows a wave and more, also where two rows are as far from an extreme as they can be.
    for phase in np.linspace(0.0, 0.4, 5):
        smooth = table(5 * lobes, 2, lambda a, b, p=phase: 1e-6 * np.cos(lobes * a + p) * (2 + b))
        angle = np.linspace(-7.0, 7.0, 501)
        for order in (0, 1, 2):
            expected = spline_of(smooth)(angle, order)[:, 0]
            found = smooth.radial(angle, np.full(501, -R), order)
            np.testing.assert_array_equal(found, expected)
        assert not smooth.stepped.any()


#: A surface with a step, in degrees and um, as coordinate measuring machines write it.
STEP = ([0, 99.9, 100, 235, 235.1, 260, 300], [0, 0, 60, 60, 0, 0, 0])


def stepped(smooth=0.0):
    """A table with a step at its lower height alone."""
    angles, rows = np.radians(STEP[0]), 1e-6 * np.array(STEP[1], dtype=float)
    return ehd.ShapeTable(angles, np.array([-R, R]), np.column_stack([rows, smooth * rows]))


def test_a_step_is_not_overshot_and_its_slope_is_continuous():
    measured = stepped()
    angle = np.linspace(0.0, 2 * np.pi, 100_001)
    assert np.ptp(spline_of(measured)(angle)[:, 0]) > 100 * 60e-6
    found = measured.radial(angle, np.full(angle.size, -R))
    assert found.min() == 0.0
    assert found.max() == pytest.approx(60e-6, rel=1e-12)
    assert list(measured.stepped) == [True, False]
    rows = measured.radial(measured.angles, np.full(len(measured.angles), -R))
    np.testing.assert_allclose(rows, measured.deviations[:, 0], atol=1e-20)
    near, steepest = 1e-9, 60e-6 / np.radians(0.1)
    for place in (*measured.angles, 2 * np.pi):
        before, after = measured.radial(np.array([place - near, place + near]), -R, 1)
        assert before == pytest.approx(after, abs=1e-4 * steepest)
    there = measured.radial(angle + 2 * np.pi, np.full(angle.size, -R))
    np.testing.assert_allclose(there, found, atol=1e-12)


def test_two_rows_that_stand_out_are_not_overshot():
    angles = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    rows = np.where((angles > 1.2) & (angles < 1.7), 5e-6, 0.0)
    measured = ehd.ShapeTable(angles, np.zeros(1), rows[:, None])
    assert rows.sum() == pytest.approx(10e-6)
    assert measured.overshoot == pytest.approx(0.2 * 5e-6, rel=0.02)
    found = measured.radial(np.linspace(0, 7, 999), np.zeros(999))
    assert found.min() >= 0.0
    assert found.max() <= 5e-6


def test_a_table_with_a_step_is_a_notice_of_its_run():
    step = ehd.Shape(measured=stepped(1.0))
    (line,) = stepped_shapes({"a": ehd.LubricatedJoint("a", "b", make_film(), bore_shape=step)})
    assert "joints.a.bore_shape.table: a spline would overshoot its rows by" in line
    plain = ehd.LubricatedJoint("a", "b", make_film(), bore_shape=ehd.Shape(measured=table()))
    assert stepped_shapes({"a": plain}) == []


def test_a_table_of_one_height_stands_for_all_and_ends_stay():
    single = ehd.ShapeTable(
        np.radians([0, 90, 180, 270]), np.zeros(1), np.array([[1.0], [0], [1], [0]])
    )
    assert single.radial(np.pi, 5.0) == pytest.approx(1.0)
    ends = table()
    assert ends.radial(1.0, 9 * R) == ends.radial(1.0, R)


@pytest.mark.parametrize(
    ("angles", "message"),
    [([0.0, 1.0, 2.0], "at least 4"), ([0.0, 2, 1, 3], "ascend"), ([0.0, 1, 2, 7], "one turn")],
)
def test_angles_of_a_table_are_checked(angles, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        ehd.ShapeTable(np.array(angles), np.zeros(1), np.zeros((len(angles), 1)))


def test_nothing_listed_is_round():
    assert JointFilm(ehd.LubricatedJoint("a", "b", make_film())).plain


# --- The gap of a joint


def joint_film(film, *, tilting=False, bore=None, journal=None):
    joint = ehd.LubricatedJoint("shaft", "housing", film, bore_shape=bore, journal_shape=journal)
    return JointFilm(joint, tilting=tilting)


def test_a_misaligned_bore_is_a_journal_tilted_back():
    film, tilt = make_film(), (2e-4, -1e-4)
    xi = np.array([3e-6, -2e-6])
    found = joint_film(film, bore=ehd.Shape(misalignment=tilt)).gap(xi, 0 * xi, OMEGA)
    expected = joint_film(film, tilting=True).gap(
        np.array([*xi, *(-np.array(tilt))]), np.zeros(4), OMEGA
    )
    np.testing.assert_allclose(found.thickness, expected.thickness, rtol=1e-13)
    pressure = film.solve(expected).pressure
    np.testing.assert_allclose(film.solve(found).pressure, pressure, atol=1e-9 * pressure.max())


def test_an_eccentric_journal_that_turns_is_a_centre_that_goes_around():
    # One lobe is an eccentricity: gap and its rate to round-off.
    film, ahead, size = make_film(), 0.7, 4e-6
    found = joint_film(film, journal=oval(size, lobes=1)).gap(
        np.zeros(2), np.zeros(2), OMEGA, ahead
    )
    e = size * np.array([np.cos(ahead), np.sin(ahead)])
    rate = OMEGA * np.array([-e[1], e[0]])
    expected = joint_film(film).gap(e, rate, OMEGA)
    np.testing.assert_allclose(found.thickness, expected.thickness, rtol=1e-13)
    np.testing.assert_allclose(
        found.thickness_rate, expected.thickness_rate, atol=1e-12 * OMEGA * size
    )


def turned_frame_error(clearance):
    """Pressure of a turning oval journal against that in the frame in which it stands."""
    # Nodes of one film lie at nodes of the other: the discrete equations are the same.
    film, turn = make_film((24, 4), clearance=clearance), 2 * np.pi * 5 / 24
    lobes, e = oval(0.3 * clearance, 0.3), clearance * np.array([0.25, 0.1])
    turning = film.solve(joint_film(film, journal=lobes).gap(e, np.zeros(2), OMEGA, turn))
    # There the outer surface turns backwards, and the centre goes backwards around; the gap is that
    # of an oval bore.
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) @ e
    rate = -OMEGA * np.array([-back[1], back[0]])
    bore = evolve(lobes, ovality=-lobes.ovality)
    standing = film.solve(joint_film(film, bore=bore).gap(back, rate, -OMEGA)).pressure
    angle, height = film.parameters.grid.node_positions.T
    there = film.parameters.grid.interpolation(angle + turn, height) @ turning.pressure
    return np.abs(standing - there).max() / standing.max()


def test_a_turning_oval_journal_is_an_oval_bore_turning_back(figure):
    # Up to c / R, by which the two surfaces differ in length: lubrication theory leaves that out.
    coarse, fine = (turned_frame_error(clearance) for clearance in (C, 1e-3 * C))
    figure("shapes", "turning oval journal in the turned frame, pressure", coarse, most=3 * C / R)
    assert fine < 2e-3 * coarse


# --- Equations of a step


def swinging(bore=None, journal=None, film=None, **joint):
    """A heavy journal in a bore that turns too, both with a shape."""
    film = film or make_film((12, 3))
    return ehd.Mechanism(
        {
            "shaft": ehd.RigidBody(2.0, 1e-3, speed=OMEGA, angle=np.degrees(0.3)),
            "ring": ehd.RigidBody(1.0, 2e-3, speed=-40.0, angle=np.degrees(-0.2)),
        },
        {
            "pivot": ehd.Revolute(("ground", "ring")),
            "bearing": ehd.LubricatedJoint(
                "shaft", "ring", film, bore_shape=bore, journal_shape=journal, **joint
            ),
        },
        forces={"load": ehd.PointForce("shaft", (0.3, -1.0), lambda _: (0.1 * UNIT_LOAD, 0.0))},
    )


@pytest.mark.parametrize("shift", [1e3, 1e5])
def test_derivatives_of_a_step_are_exact(shift):
    system = System(swinging(oval(3e-6, 0.5), evolve(oval(4e-6, 0.2), half_width=R, barrel=-2e-6)))
    assert_derivatives(system, shift, 1e-2, 1e-7)


def test_the_norm_knows_the_gap_of_the_equations():
    going = Run(swinging(oval(3e-6), oval(4e-6, 0.2)), IntegratorOptions(tolerance=1e-3), 1e-3)
    *_, last = going.until(1e-4)
    (film,) = last.solution.films
    (gap,) = going.norm.film_gaps(last.observed)
    inside = film.gap.thickness.size
    np.testing.assert_allclose(gap[:inside], film.gap.thickness.ravel(), rtol=1e-4)


def test_a_wrong_angle_is_an_error_of_the_gap():
    # Waves so steep that it is one more than of the angle.
    going = Run(swinging(journal=oval(8e-6, 0.2, 9)), IntegratorOptions(tolerance=1e-3), 1e-3)
    (place,), x = going.equations.system.films, going.state.x[0]
    wrong = x.copy()
    wrong[place.surfaces[1].angle] += 1e-4
    observed = going.norm.observe(x)
    error = going.norm.error_norm(observed, observed - going.norm.observe(wrong))
    nodes = place.film.film.parameters.grid.node_positions[:, 0]
    angle = 9 * (np.concatenate([place.film.film.points.angle.ravel(), nodes]) - 0.5 - 0.2)
    relative = 72e-6 * np.sin(angle) / (C - 8e-6 * np.cos(angle))
    assert error == pytest.approx(1e-4 * np.abs(relative).max(), rel=1e-2)


# --- In motion


# Streamers begin and end with the film's points, where `full` is smooth.
@pytest.mark.parametrize(
    ("friction", "fine"),
    [({}, 1e-5), ({"shear_rule": "full"}, 1e-5), ({"shear_rule": "streamers"}, 1e-6)],
)
def test_energy_balance_closes_with_the_tolerance(friction, fine):
    shapes = {"bore": oval(3e-6, 0.5), "journal": oval(4e-6, 0.2), "friction": bool(friction)}
    shapes |= friction
    steps = {"largest": 1.0, "order": 2}
    loose, tight = (
        ehd.simulate(swinging(**shapes), 1e-2, tolerance=t, **steps).summary()[
            "energy_balance_error"
        ]
        for t in (1e-3, fine)
    )
    assert loose < 2e-2
    assert tight < loose / 5


#: So that c / R, by which the frames differ, is below what is compared.
NARROW = 0.05 * C


def under_load(turning, film, speed, load, **shapes):
    """A massless journal under a load that turns at a speed, from a given eccentricity."""
    load = {"load": ehd.RotatingForce("journal", load, turning)}
    return in_bearing(film, load, speed=speed, eccentricity=(0.3 * NARROW, 0.0), **shapes)


def both_frames(cells, tolerance):
    """Minimum film at common times: turning oval journal, and oval bore in its frame."""
    film, lobes = make_film(cells, clearance=NARROW), oval(0.25 * NARROW, 0.0)
    load = 0.2 * UNIT_LOAD * (C / NARROW) ** 2
    end, steps = np.pi / OMEGA, {"tolerance": tolerance, "order": 2, "first": 1e-7}
    at_rest = under_load(0.0, film, OMEGA, load, journal_shape=lobes)
    bore = evolve(lobes, ovality=-lobes.ovality)
    rate = (0.0, -OMEGA * 0.3 * NARROW)
    turned = under_load(-OMEGA, film, -OMEGA, load, bore_shape=bore, eccentricity_rate=rate)
    times = np.linspace(0.1, 1.0, 40) * end
    found = []
    for mechanism in (at_rest, turned):
        result = ehd.simulate(mechanism, end, **steps)
        found.append(np.interp(times, result.time, result.joints["bearing"].min_film_thickness))
    return found


@pytest.mark.slow
def test_a_turning_journal_is_a_turned_frame_on_a_fine_mesh(figure):
    turning, standing = both_frames((48, 4), 1e-6)
    error = np.abs(turning / standing - 1).max()
    figure("shapes", "turning oval journal in the turned frame, film", error, most=1e-3)


def test_a_gap_closed_at_the_start_is_refused():
    with pytest.raises(ehd.errors.SettingsError, match=r"bearing\.bore_shape.*-4 um.*20 um"):
        Run(swinging(oval(1.2 * C)), IntegratorOptions(), 1e-3)


# --- Along the axis


def crowned_film(along):
    """Largest error of the pressure under a crowned journal pressed flat onto its bore."""
    grid = ehd.uniform_grid(R, R, (8, along), "lagrange")
    film = ehd.Film(ehd.FilmParameters(grid, C, ehd.Lubricant(ETA), OMEGA))
    crown, speed, half = 0.4 * C, 1e-3, 0.5 * R
    gap = joint_film(film, journal=ehd.Shape(half_width=half, barrel=-crown)).gap(
        np.zeros(2), np.zeros(2), 0.0
    )
    gap = replace(gap, thickness_rate=np.full_like(gap.thickness, -speed))
    z = grid.node_positions[:, 1]
    h = C + crown * (z / half) ** 2
    # h^3 dp/dz = -12 eta v z, integrated from the end, where h = c + a.
    exact = 3 * ETA * speed * half**2 / crown * (1 / h**2 - 1 / (C + crown) ** 2)
    return np.abs(film.solve(gap).pressure - exact).max() / exact.max()


def test_a_crowned_journal_is_the_exact_solution_along_the_axis(figure):
    errors = np.array([crowned_film(n) for n in (2, 4, 8)])
    figure("shapes", "crowned journal, squeezed, 8 cells along", errors[-1], most=1e-4)
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 2.5)


def end_of(tolerance):
    """Eccentricity after two thirds of a turn of an oval journal."""
    film, shape = make_film((12, 2)), oval(0.25 * C)
    load = {"load": ehd.RotatingForce("journal", 0.15 * UNIT_LOAD, 0.3 * OMEGA)}
    mechanism = in_bearing(film, load, journal_shape=shape)
    steps = {"order": 2, "first": 1e-7, "largest": 0.5}
    result = ehd.simulate(mechanism, 4 / OMEGA, tolerance=tolerance, **steps)
    return result.joints["bearing"].eccentricity[-1]


@pytest.mark.slow
def test_the_motion_converges_with_the_tolerance(figure):
    exact = end_of(5e-8)
    errors = np.array([np.abs(end_of(t) - exact).max() / C for t in (1e-3, 1e-4, 1e-5, 1e-6)])
    figure("shapes", "oval journal, eccentricity at tolerance 1e-6", errors[-1], most=2e-4)
    # Of order 2 with the local error under control: tolerance^(2/3), a factor of 100.
    assert errors[0] / errors[-1] > 50


def test_an_oval_journal_in_an_elastic_bore_costs_no_iterations(figure):
    # The rod's modes, its residual patterns and the journal's angle move the gap together.
    joint = Joint((10, 2))
    rod = with_residual(joint, flexible(joint)[0])
    errors, counts = [], []
    for shape in (None, oval(3e-6, 0.2)):
        found = [
            run(make_mechanism(rod, joint, journal_shape=shape), 0.03, t) for t in (1e-3, 1e-5)
        ]
        errors.append([result.summary()["energy_balance_error"] for result in found])
        counts.append(
            [result.summary()["newton_iterations"] / len(result.time) for result in found]
        )
    (_, plain), (loose, tight) = errors
    figure("shapes", "energy balance, oval journal in an elastic rod", tight, most=2e-4)
    assert tight < max(loose / 3, 2 * plain)
    assert np.all(np.array(counts[1]) < np.array(counts[0]) + 0.5)
