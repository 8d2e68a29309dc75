"""One rigid bearing against tables and analytic solutions, and at its extremes.

The tables are for ``h = c (1 + eps cos(theta))``: a clearance of 1e-5 radius makes the
curvature of the gap, of order c / R, invisible.
"""

from functools import cache

import attrs
import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.analysis.dynamic_coefficients import stability
from fenics_ehd.base.plane import rotation
from fenics_ehd.scenes.bearing import bearing_scene
from fenics_ehd.scenes.schema import ConstantForceSettings

R, C, ETA, OMEGA = 0.0225, 0.0225e-5, 0.01, 500.0
PLAIN = ehd.BearingSettings(radius=R, clearance=C, width=2 * R, viscosity=ETA, speed=OMEGA)
SCALE = 6 * ETA * OMEGA * (R / C) ** 2

# Plain 360 degree bearing, L/D = 1, own finite volumes on 960 x 96 cells, Richardson: mode (A
# periodic complementarity, B p = 0 at the maximum film), eccentricity ratio, W / (SCALE R L),
# attitude [degrees], maximum pressure / SCALE and its angle [degrees], Sommerfeld number,
# side flow / (R c omega L).
TABLE = [
    ("A", 0.2, 0.0849692, 77.66, 0.0802672, 114.915, 0.624363, 0.172399),
    ("B", 0.2, 0.0839722, 73.8566, 0.079498, 115.582, 0.631776, 0.160034),
    ("A", 0.6, 0.436957, 51.9785, 0.530659, 148.27, 0.121411, 0.521411),
    ("B", 0.6, 0.43866, 50.5295, 0.529156, 148.327, 0.12094, 0.469234),
    ("A", 0.9, 2.81281, 26.7017, 5.68401, 167.091, 0.0188608, 0.79198),
    ("B", 0.9, 2.81888, 26.4727, 5.68167, 167.093, 0.0188201, 0.695466),
    ("A", 0.95, 6.27285, 19.5371, 16.369, 171.129, 0.00845734, 0.838368),
    ("B", 0.95, 6.28016, 19.44, 16.3664, 171.13, 0.0084475, 0.73318),
]

LOADED = {ratio for _, ratio, *_ in TABLE}

# Its linear coefficients: eccentricity ratio, Sommerfeld number, attitude [degrees],
# k c / W and b c omega / W row by row, M c omega^2 / W at the stability threshold.
COEFFICIENTS = [
    (0.1, 1.3032, 83.8394, [1.1032, 10.222, -9.8278, 2.1433],
     [20.348, 2.1474, 2.1474, 19.895], 6.4234),
    (0.2, 0.62436, 77.6601, [1.1916, 5.4478, -4.6541, 2.1251],
     [10.705, 2.141, 2.141, 9.7869], 6.3614),
    (0.3, 0.38672, 71.4370, [1.3484, 4.0146, -2.8118, 2.0962],
     [7.7479, 2.1302, 2.1302, 6.3433], 6.3013),
    (0.4, 0.26021, 65.1319, [1.5892, 3.4305, -1.8027, 2.0596],
     [6.4939, 2.1206, 2.1206, 4.5751], 6.3143),
    (0.5, 0.17903, 58.6818, [1.951, 3.2086, -1.1158, 2.0173],
     [5.9656, 2.1093, 2.1093, 3.4666], 6.5311),
    (0.6, 0.12141, 51.9786, [2.5071, 3.2079, -0.57391, 1.9736],
     [5.8738, 2.1007, 2.1007, 2.6867], 7.3055),
    (0.7, 0.078137, 44.8220, [3.4354, 3.4116, -0.077778, 1.9343],
     [6.1633, 2.097, 2.097, 2.084], 10.425),
    (0.75, 0.060377, 40.9583, [4.1689, 3.6179, 0.17996, 1.9211],
     [6.4942, 2.1059, 2.1059, 1.828], 17.501),
    (0.8, 0.04472, 36.7894, [5.2595, 3.9354, 0.47088, 1.9147],
     [7.0149, 2.1241, 2.1241, 1.5884], None),
    (0.9, 0.018861, 26.7017, [10.645, 5.3571, 1.3884, 1.9435],
     [9.3156, 2.1981, 2.1981, 1.1056], None),
    (0.95, 0.0084574, 19.5372, [21.245, 7.5514, 2.5294, 2.0189],
     [12.787, 2.3037, 2.3037, 0.81746], None),
]  # fmt: skip


@cache
def plain(ratio):
    """The plain bearing with its coefficients."""
    return ehd.solve_bearing(PLAIN, eccentricity=ratio, with_coefficients=True)


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("mode", "ratio", "load", "attitude", "pressure", "place", "sommerfeld", "flow"), TABLE
)
def test_table_of_rigid_bearings(
    mode, ratio, load, attitude, pressure, place, sommerfeld, flow, figure
):
    at_max_film = attrs.evolve(PLAIN, line_at_max_film=True)
    result = plain(ratio) if mode == "A" else ehd.solve_bearing(at_max_film, eccentricity=ratio)
    error = abs(result.load / (SCALE * R * 2 * R) / load - 1)
    figure("rigid bearing", "load, table for L/D = 1", error, most=3e-4, unit="%")
    error = abs(np.degrees(result.attitude) - attitude)
    figure("rigid bearing", "attitude angle, the same", error, most=0.02, unit="degrees")
    error = abs(result.max_pressure / SCALE / pressure - 1)
    figure("rigid bearing", "peak pressure, the same", error, most=3e-4, unit="%")
    assert np.degrees(result.max_pressure_angle) == pytest.approx(place, abs=0.05)
    assert result.sommerfeld_number == pytest.approx(sommerfeld, rel=3e-4)
    error = abs(result.flow.side / (R * C * OMEGA * 2 * R) / flow - 1)
    figure("rigid bearing", "side flow, the same", error, most=1e-3, unit="%")
    assert result.min_film_thickness == pytest.approx((1 - ratio) * C)


@pytest.mark.parametrize(
    ("ratio", "sommerfeld", "attitude", "stiffness", "damping", "mass"),
    [
        # On every kernel those of which the table has the load: they are computed together.
        pytest.param(*row, marks=pytest.mark.kernels if row[0] in LOADED else pytest.mark.slow)
        for row in COEFFICIENTS
    ],
)
def test_table_of_coefficients(ratio, sommerfeld, attitude, stiffness, damping, mass, figure):
    result = plain(ratio)
    linear = result.coefficients
    assert result.sommerfeld_number == pytest.approx(sommerfeld, rel=1e-3)
    assert np.degrees(result.attitude) == pytest.approx(attitude, abs=0.02)
    unit = result.load / C
    # k_yx passes through zero near 0.72: there 1 % of the largest entry is meant.
    floor = 0.01 * 0.1 * np.abs(stiffness).max()
    k, b = linear.stiffness.ravel() / unit, linear.damping.ravel() / unit * OMEGA
    np.testing.assert_allclose(k, stiffness, rtol=0.01, atol=floor)
    error = np.abs(k - stiffness).max() / np.abs(stiffness).max()
    figure("rigid bearing", "stiffness, over its largest entry, table", error, most=0.01, unit="%")
    error = np.abs(b / damping - 1).max()
    figure("rigid bearing", "damping, every entry, table", error, most=0.005, unit="%")
    if mass is None:
        assert linear.critical_mass is linear.threshold is linear.whirl_ratio is None
    else:
        assert linear.critical_mass * C * OMEGA**2 / result.load == pytest.approx(mass, rel=0.01)
        assert linear.threshold == pytest.approx(np.sqrt(mass), rel=0.005)


@pytest.mark.kernels
def test_threshold_is_where_a_root_becomes_imaginary():
    linear = plain(0.6).coefficients
    for factor, stable in ((0.999, True), (1.001, False)):
        inertia = factor * linear.critical_mass * np.eye(2)
        matrix = np.block(
            [
                [np.zeros((2, 2)), np.eye(2)],
                [
                    -np.linalg.solve(inertia, linear.stiffness),
                    -np.linalg.solve(inertia, linear.damping),
                ],
            ]
        )
        assert (np.linalg.eigvals(matrix).real.max() < 0) == stable
    whirl = linear.whirl_ratio * OMEGA
    roots = np.linalg.eigvals(matrix)
    assert np.abs(roots - 1j * whirl).min() < 1e-2 * whirl


def test_pure_cross_coupling_is_unstable_at_every_mass_without_damping_to_hold_it():
    assert stability(np.array([[-1.0, 0.5], [-0.5, -1.0]]), np.eye(2)) == (0.0, None)
    assert stability(2.0 * np.eye(2), np.eye(2)) == (None, None)


@pytest.mark.kernels
@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_stability_of_a_tiny_or_huge_bearing_is_that_of_a_scaled_one(size):
    k, b = np.array([[2.5, 3.2], [-0.57, 2.0]]), np.array([[5.9, 2.1], [2.1, 2.7]])
    mass, frequency = stability(k, b)
    assert stability(size * k, size * b) == pytest.approx((size * mass, frequency))


@pytest.mark.kernels
@pytest.mark.parametrize("ratio", [1e-4, 0.3, 0.9, 0.998])
def test_load_finds_the_eccentricity_that_gave_it(ratio):
    settings = attrs.evolve(PLAIN, cells_around=40, cells_along=6)
    given = ehd.solve_bearing(settings, eccentricity=ratio)
    found = ehd.solve_bearing(settings, load=given.load)
    # The meshes need not be the same: they are graded for slightly different gaps.
    assert 1 - found.eccentricity_ratio == pytest.approx(1 - ratio, rel=1e-3)
    assert found.load == pytest.approx(given.load, rel=1e-8)
    assert found.attitude == pytest.approx(given.attitude, abs=5e-4)


@pytest.mark.kernels
@pytest.mark.parametrize(
    "settings",
    [
        ehd.BearingSettings(grooves=(ehd.AxialGroove(np.radians(-90), np.radians(20), 2e5),)),
        ehd.BearingSettings(tilt=(3e-4, 2e-4)),
        ehd.BearingSettings(speed=0.0, squeeze=(0.01, 0.002)),
        ehd.BearingSettings(speed=400.0, squeeze=(-0.0002, 0.0001), ambient=1e5),
    ],
    ids=["groove", "tilt", "squeeze", "all"],
)
def test_force_lies_on_the_load_line(settings):
    settings = attrs.evolve(settings, cells_around=40, cells_along=8)
    for given in ({"eccentricity": 0.5}, {"load": 1.5e4}):
        result = ehd.solve_bearing(settings, **given)
        directions = np.stack(result.film.points.normal, axis=-1)
        force = rotation(result.angle) @ result.film.load(directions) @ result.state.pressure
        np.testing.assert_allclose(force, [result.load, 0.0], atol=1e-8 * result.load)


def test_reversed_rotation_is_the_mirror_image():
    settings = ehd.BearingSettings(
        tilt=(2e-4, 1e-4), grooves=(ehd.AxialGroove(np.radians(-70), np.radians(20), 1e5),)
    )
    forward = ehd.solve_bearing(settings, load=3000.0)
    backward = ehd.solve_bearing(attrs.evolve(settings, speed=-settings.speed), load=3000.0)
    assert backward.attitude == forward.attitude > 0
    assert backward.friction_torque == forward.friction_torque > 0
    assert backward.power_loss == pytest.approx(500.0 * backward.friction_torque)


def test_two_turning_surfaces():
    settings = ehd.BearingSettings(cells_around=32, cells_along=6)
    one, both, counter, bore = (
        ehd.solve_bearing(attrs.evolve(settings, speed=shaft, bore_speed=bore), eccentricity=0.6)
        for shaft, bore in ((500.0, 0.0), (500.0, 500.0), (500.0, -498.0), (0.0, 500.0))
    )
    ratio = settings.clearance / settings.radius
    assert both.load == pytest.approx(2 * one.load, rel=2 * ratio)
    assert bore.load == pytest.approx(one.load, rel=3 * ratio)
    # Little is dragged in: that of the sum of the speeds, and of the difference of the two radii.
    assert counter.load < (2.0 / 500.0 + 3 * ratio) * one.load
    assert counter.power_loss > 3 * one.power_loss


def test_short_bearing_has_ocvirks_load(figure):
    """Half Sommerfeld solution of the short bearing; L/D = 0.05."""
    ratio, width = 0.6, 0.05 * 2 * R
    result = ehd.solve_bearing(attrs.evolve(PLAIN, width=width), eccentricity=ratio)
    square = 16 * ratio**2 + np.pi**2 * (1 - ratio**2)
    ocvirk = ETA * OMEGA * R * width**3 / (4 * C**2) * ratio / (1 - ratio**2) ** 2 * np.sqrt(square)
    attitude = np.arctan(np.pi * np.sqrt(1 - ratio**2) / (4 * ratio))
    error = abs(result.load / ocvirk - 1)
    figure(
        "rigid bearing",
        "load of a short bearing after Ocvirk, L/D = 0.05",
        error,
        most=0.01,
        unit="%",
    )
    assert result.attitude == pytest.approx(attitude, abs=np.radians(0.5))


@pytest.mark.parametrize("ratio", [0.0, 0.5, 0.9])
def test_short_bearing_squeezed_without_rotation(ratio):
    """p = 6 eta V cos(phi) (B^2 / 4 - z^2) / h^3 on the approached half."""
    width, velocity = 0.02 * 2 * R, 0.01
    settings = attrs.evolve(PLAIN, width=width, speed=0.0, squeeze=(velocity, 0.0))
    result = ehd.solve_bearing(settings, eccentricity=ratio)
    phi, weight = np.polynomial.legendre.leggauss(200)
    phi, weight = np.pi / 2 * phi, np.pi / 2 * weight
    integral = np.sum(weight * np.cos(phi) ** 2 / (1 - ratio * np.cos(phi)) ** 3)
    expected = ETA * velocity * R * width**3 / C**3 * integral
    assert result.load == pytest.approx(expected, rel=0.01)
    assert result.attitude == (pytest.approx(0.0, abs=1e-9) if ratio else None)
    assert result.power_loss == pytest.approx(result.load * velocity, rel=1e-4)
    assert result.sommerfeld_number == 0.0


@pytest.mark.kernels
def test_tilted_shaft_is_turned_back():
    result = ehd.solve_bearing(ehd.BearingSettings(tilt=(1e-4, 2e-4)), eccentricity=0.4)
    work = result.tilting_moment @ result.settings.tilt
    assert work < 0
    shift = 0.011 * np.array([2e-4, -1e-4])
    ends = [np.linalg.norm(result.position + s * shift) for s in (1, -1)]
    assert result.min_film_thickness == pytest.approx(17e-6 - max(ends))


def test_side_flow_comes_from_the_grooves():
    grooves = tuple(ehd.AxialGroove(np.radians(a), np.radians(15), 3e5) for a in (90, -90))
    result = ehd.solve_bearing(ehd.BearingSettings(grooves=grooves), load=2000.0)
    flow = result.flow
    assert flow.side == pytest.approx(flow.supply + flow.cavities, rel=1e-9)


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("changes", "given"),
    [
        ({}, {"eccentricity": 0.999}),
        ({"tilt": (1.05e-3, 0.0)}, {"eccentricity": 0.3}),
        ({"clearance": 1e-6}, {"eccentricity": 0.6}),
        ({"clearance": 1e-3}, {"load": 1.0}),
        ({"width": 5 * 0.045}, {"eccentricity": 0.6}),
        ({"width": 0.05 * 0.045}, {"load": 5.0}),
        ({"cells_along": 1}, {"eccentricity": 0.6}),
        ({"cells_around": 3, "cells_along": 1}, {"eccentricity": 0.6}),
        ({"roelands": 0.6}, {"eccentricity": 0.8}),
        ({"speed": 0.0}, {"eccentricity": 0.6}),
        ({"tilt": (1.54e-3, 0.0)}, {"eccentricity": 0.0}),
    ],
)
def test_extremes_that_work(changes, given):
    result = ehd.solve_bearing(ehd.BearingSettings(**changes), **given)
    assert result.load >= 0
    assert result.power_loss >= 0
    assert 0 < result.min_film_thickness < result.settings.clearance


@pytest.mark.slow
def test_default_mesh_is_good_enough_at_the_extremes(figure):
    """0.1 % in load against 4 times the cells around and 2 along."""
    for width, ratio in ((0.0225, 0.95), (0.09, 0.99), (0.045, 0.999)):
        settings = ehd.BearingSettings(width=width)
        fine = attrs.evolve(settings, cells_around=256, cells_along=24)
        load = ehd.solve_bearing(settings, eccentricity=ratio).load
        error = abs(load / ehd.solve_bearing(fine, eccentricity=ratio).load - 1)
        name = "load with the default mesh, eccentricity up to 0.999, against a fine one"
        figure("rigid bearing", name, error, most=1e-3, unit="%")


@pytest.mark.parametrize(
    ("changes", "given", "message"),
    [
        ({"cells_around": 12, "cells_along": 2}, {"load": 1e9}, "load = 1e.09 N is too high"),
        ({"speed": 0.0}, {"load": 10.0}, "load = 10 N: the film has no pressure at speed = 0"),
        ({"speed": 0.0, "squeeze": (-0.01, 0.0)}, {"load": 1.0}, "first component must be above 0"),
        ({"squeeze": (0.0, 0.05)}, {"eccentricity": 0.0}, "degrees off the load line"),
        ({"tilt": (1.5e-3, 0.0)}, {"eccentricity": 0.3}, "close the gap at every attitude"),
        ({"element": "bilinear", "cells_along": 1}, {"eccentricity": 0.3}, "use more cells"),
        ({"cells_around": 3, "grooves": tuple(ehd.AxialGroove(a, 0.1) for a in range(4))},
         {"load": 1.0}, "3 cells around cannot resolve 8 groove edges"),
    ],
)  # fmt: skip
def test_extremes_that_are_refused(changes, given, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        ehd.solve_bearing(ehd.BearingSettings(**changes), **given)


@pytest.mark.kernels
def test_viscosity_that_runs_away_is_a_named_error():
    """1 / p of Barus' film is bounded: at constant viscosity, 54 MPa, it may have 50 at most."""
    with pytest.raises(ehd.errors.ViscosityError, match="viscosity runs away with the pressure"):
        ehd.solve_bearing(ehd.BearingSettings(barus=2e-8), eccentricity=0.8)


def test_barus_film_is_that_of_reduced_pressure_or_refused(figure):
    """p = -ln(1 - a q) / a, q of constant viscosity and proportional to the speed."""
    barus, plain = 40e-9, ehd.BearingSettings()
    highest = ehd.solve_bearing(plain, eccentricity=0.6).max_pressure

    def peaking(pressure):
        reduced = -np.expm1(-barus * pressure) / barus
        speed = plain.speed * reduced / highest
        return ehd.solve_bearing(attrs.evolve(plain, barus=barus, speed=speed), eccentricity=0.6)

    error = abs(peaking(100e6).max_pressure / 100e6 - 1)
    name = "peak of 100 MPa under Barus' law, 4e-8 1/Pa, against the reduced pressure"
    figure("rigid bearing", name, error, most=1e-3, unit="%")
    # 500 MPa would need q to 2e-9: the mesh has 183 MPa.
    with pytest.raises(ehd.errors.ViscosityError, match="within a film cell, above the limit"):
        peaking(500e6)


def test_centred_shaft_has_no_coefficients():
    with pytest.raises(ehd.errors.SettingsError, match="no derivatives at a centred shaft"):
        ehd.solve_bearing(PLAIN, eccentricity=0.0, with_coefficients=True)


def test_a_bore_that_turns_entrains_as_much_oil_as_its_journal():
    """Under a load that stands the film sees the sum of both speeds, up to clearance / radius."""
    cells = {"cells_around": 32, "cells_along": 6}
    for speed, bore_speed in ((500.0, 500.0), (0.0, 1000.0), (1200.0, -200.0)):
        found = ehd.bearing(load=5e3, speed=speed, bore_speed=bore_speed, **cells)
        alone = ehd.bearing(load=5e3, speed=1000.0, **cells)
        apart = np.linalg.norm(found.position - alone.position) / np.linalg.norm(alone.position)
        assert apart < 2 * 17e-6 / 0.0225
        np.testing.assert_allclose(found.sommerfeld_number, alone.sommerfeld_number, rtol=1e-12)


@pytest.mark.kernels
@pytest.mark.parametrize("bore_speed", [-500.0, -500.7, -499.3])
def test_surfaces_that_turn_against_each_other_draw_no_oil_in(bore_speed):
    """Of terms of clearance / radius a film would carry 2 kN at eccentricity 0.9965."""
    speeds = {"speed": 500.0, "bore_speed": bore_speed}
    with pytest.raises(ehd.errors.SettingsError, match=r"draw in no oil: .* 0\.75\d rad/s"):
        ehd.bearing(load=2e3, **speeds)
    squeezed = ehd.bearing(load=2e3, squeeze=(2e-4, 0.0), cells_around=24, **speeds)
    assert squeezed.load == pytest.approx(2e3)


def test_the_small_coefficient_of_a_plain_bearing_does_not_feel_its_mesh():
    found = [
        ehd.bearing(
            eccentricity=0.7, with_coefficients=True, cells_around=around, cells_along=along
        ).coefficients
        for around, along in ((32, 8), (64, 12))
    ]
    small = [linear.stiffness[1, 0] for linear in found]
    assert small[0] == pytest.approx(small[1], rel=0.04)
    assert found[0].whirl_ratio == pytest.approx(found[1].whirl_ratio, rel=2e-3)


def test_a_bearing_is_the_equilibrium_of_its_scene():
    """The same scene as any machine's, with equal cells and the journal at a rough position."""
    settings = ehd.BearingSettings(grooves=(ehd.AxialGroove(np.radians(80.0), 0.2, 1e5),))
    graded = ehd.solve_bearing(settings, load=3e3)
    scene = bearing_scene(settings, angle=0.0)
    film = attrs.evolve(scene.joints["film"], cells=(96, 12))
    shaft = ehd.MasslessBody(position=(5e-6, 5e-6))
    machine = ehd.build(
        attrs.evolve(
            scene,
            bodies={**scene.bodies, "shaft": shaft},
            joints={**scene.joints, "film": film},
            forces={"load": ConstantForceSettings(point="shaft", force=(3e3, 0.0))},
        )
    )
    rest = ehd.equilibrium(machine.mechanism)
    position = rest.z[rest.system.bodies["shaft"]][:2]
    assert position == pytest.approx(graded.position, rel=2e-3)
    assert rest.joints()["film"].pressure.max() == pytest.approx(graded.max_pressure, rel=2e-3)
