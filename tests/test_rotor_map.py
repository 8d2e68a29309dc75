"""Rotor maps against closed forms: rigid rotor, Jeffcott rotor, reversal, sum of the roots."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.analysis.dynamic_coefficients import stability
from fenics_ehd.analysis.film_meshes import in_basis, mean_linearisation
from fenics_ehd.analysis.modes import (
    damping_ratio,
    damping_ratio_scatter,
    log_decrement,
    log_decrement_scatter,
    matched,
    modes_of,
    root_scatter,
    whirl_direction,
)
from fenics_ehd.analysis.rotor_map import CLOSE, rotor_map_of
from fenics_ehd.analysis.unbalance import PROMINENCE, _resonances, larger_axes, phases

R, C, WIDTH = 0.02, 40e-6, 0.02
GRAVITY = (0.0, -9.81)


@cache
def film():
    return ehd.Film(
        ehd.FilmParameters(ehd.uniform_grid(R, WIDTH, (24, 6)), C, ehd.Lubricant(0.008), 500.0)
    )


def bearing(journal, bore="ground"):
    return ehd.LubricatedJoint(journal, bore, film(), eccentricity=(0.1 * C, -0.4 * C))


def rigid_rotor(mass, gravity=GRAVITY):
    """Function that makes a rigid journal of a mass [kg] in one bearing at a speed."""

    def make(speed):
        body = ehd.RigidBody(mass, 1e-3, position=(0.1 * C, -0.4 * C))
        joints = {"bearing": bearing("rotor")}
        drives = {"rotor": ehd.Speed(speed)}
        return ehd.Mechanism({"rotor": body}, joints, drives, gravity=gravity)

    return make


def jeffcott(mass, stiffness):
    """Function that makes a disk on two springs, whose other ends are massless journals."""

    def make(speed):
        bodies = {name: ehd.MasslessBody() for name in ("left", "right")}
        bodies["disk"] = ehd.RigidBody(mass, 1e-3)
        joints = {name: bearing(name, f"ground.{name}") for name in ("left", "right")}
        bodies["ground"] = ehd.ground({"left": (0.0, 0.0), "right": (0.0, 0.0)})
        springs = {
            name: ehd.SpringDamper(("disk", name), stiffness=stiffness)
            for name in ("left", "right")
        }
        drives = {name: ehd.Speed(speed) for name in ("left", "right", "disk")}
        return ehd.Mechanism(bodies, joints, drives, springs, GRAVITY)

    return make


def film_coefficients(rest, name="rotor"):
    """Stiffness and damping of the film of a rigid rotor, (2, 2) each."""
    linear = ehd.linearise(rest).along(rest.system.bodies[name].start + np.arange(2))
    return linear.stiffness, linear.damping


def test_a_rigid_rotor_becomes_unstable_at_the_speed_and_frequency_of_the_closed_form(figure):
    make = rigid_rotor(6.0)
    chart = rotor_map_of([make], np.linspace(400.0, 1400.0, 5))
    (limit,) = chart.limits
    mass, frequency = stability(*film_coefficients(ehd.equilibrium(make(limit.speed))))
    assert limit.lost
    assert limit.speed == chart.stable_below
    figure("rotor maps", "mass of a rigid rotor at its stability limit, closed form",
           abs(mass / 6.0 - 1.0), most=1e-3, unit="%")  # fmt: skip
    figure("rotor maps", "its whirl ratio, closed form",
           abs(limit.whirl_ratio * limit.speed / frequency - 1.0), most=1e-3, unit="%")  # fmt: skip
    assert 0.4 < limit.whirl_ratio < 0.52
    assert limit.direction > 0.5
    assert limit.scatter == 0.0


def determinant(matrix):
    """Determinant of a matrix of polynomials, coefficients from the highest power down."""
    if len(matrix) == 1:
        return matrix[0][0]
    total = np.zeros(1)
    for j, factor in enumerate(matrix[0]):
        minor = [row[:j] + row[j + 1 :] for row in matrix[1:]]
        total = np.polyadd(total, (-1) ** j * np.polymul(factor, determinant(minor)))
    return total


def test_a_jeffcott_rotor_on_two_equal_bearings_has_the_roots_of_its_polynomial(figure):
    mass, stiffness, speed = 12.0, 8e6, 700.0
    rest = ehd.equilibrium(rigid_rotor(0.5 * mass)(speed))
    k, b = film_coefficients(rest)
    zero, spring = np.zeros(1), np.array([stiffness])
    inertia = np.array([0.5 * mass, 0.0, stiffness])
    blocks = [
        [inertia, zero, -spring, zero],
        [zero, inertia, zero, -spring],
        *(
            [
                *(-spring if i == j else zero for j in range(2)),
                *(np.array([b[i, j], k[i, j] + (stiffness if i == j else 0.0)]) for j in range(2)),
            ]
            for i in range(2)
        ),
    ]
    expected = np.roots(determinant(blocks))
    chart = rotor_map_of([jeffcott(mass, stiffness)], [speed])
    roots = chart.points[0].modes.roots
    assert len(roots) == 8  # infinite roots of the massless journals are left out
    off = max(np.abs(roots - root).min() / abs(root) for root in expected)
    figure("rotor maps", "roots of a Jeffcott rotor on two equal bearings, polynomial",
           off, most=1e-6)  # fmt: skip


def two_bearings(speed=500.0, **changes):
    scene = ehd.read_scene("rotor-two-bearings", **changes)
    mechanism = ehd.build(scene).mechanism
    return lambda value=speed: replace(mechanism, drives={"shaft": ehd.Speed(value)}, forces={})


@cache
def whole_map():
    """Map of the shipped rotor, with the response to an unbalance of 4e-4 kg m."""
    unbalance = ehd.Unbalance("shaft.disk", 4e-4, 30.0)
    return rotor_map_of([two_bearings()], np.linspace(200.0, 1100.0, 10), unbalances=[unbalance])


def test_the_sum_of_the_roots_is_the_trace_of_the_damping_over_the_mass(figure):
    for point in whole_map().points[::4]:
        total = np.trace(np.linalg.solve(point.linear.mass, point.linear.damping))
        figure("rotor maps", "sum of the roots, trace of D over M",
               abs(point.modes.roots.sum() / total + 1.0), most=1e-8)  # fmt: skip


def test_eigenvectors_satisfy_their_equations_and_are_biorthonormal():
    point = whole_map().points[3]
    linear, modes = point.linear, point.modes
    for root, shape in zip(modes.roots, modes.shapes.T, strict=True):
        terms = [root**2 * linear.mass @ shape, root * linear.damping @ shape]
        terms.append(linear.stiffness @ shape)
        largest = max(np.abs(term).max() for term in terms)
        assert np.abs(sum(terms)).max() < 1e-8 * largest
    own = modes.overlaps(modes)
    np.testing.assert_allclose(own, np.eye(len(own)), atol=1e-5)


def test_a_rotor_that_turns_back_is_the_mirror_image(figure):
    make = two_bearings()
    chart = whole_map()
    back = rotor_map_of(
        [make], -chart.speeds[:3], unbalances=[ehd.Unbalance("shaft.disk", 4e-4, -30.0)]
    )
    off = [0.0]
    for track in np.flatnonzero(chart.tracks[:, 0] >= 0):
        difference = np.abs(back.roots[:, 0] - chart.roots[track, 0])
        mirror = int(np.nanargmin(difference))
        off.append(difference[mirror] / abs(chart.roots[track, 0]))
        assert abs(back.direction(0, mirror) - chart.direction(0, track)) < 1e-6
    figure("rotor maps", "roots with the other sense of rotation", max(off), most=1e-6)
    for name in ("shaft.disk", "shaft.left"):
        mirrored = back.response.amplitude(name)[:3]
        np.testing.assert_allclose(mirrored, chart.response.amplitude(name)[:3], rtol=1e-6)
        both = back.response.phase(name)[:3] + chart.response.phase(name)[:3]
        np.testing.assert_allclose(np.exp(1j * both), 1.0, atol=1e-6)


def test_figures_of_a_root():
    root = -30.0 + 40.0j
    assert damping_ratio(root) == 0.6
    np.testing.assert_allclose(log_decrement(root), 2 * np.pi * 30.0 / 40.0)
    assert damping_ratio(-5.0 + 0j) == 1.0
    assert log_decrement(-5.0 + 0j) is None


@pytest.mark.parametrize(
    ("deflection", "sense", "expected"),
    [
        ((1.0, -1j), 1.0, 1.0),
        ((1.0, -1j), -1.0, -1.0),
        ((1.0, 1j), 1.0, -1.0),
        ((1.0, 1.0), 1.0, 0.0),
        ((0.0, 0.0), 1.0, 0.0),
    ],
)
def test_circles_whirl_forward_or_backward_and_lines_do_neither(deflection, sense, expected):
    assert whirl_direction(np.array([deflection], dtype=complex), sense) == expected


def test_half_axes_and_phases_are_those_of_the_ellipse_in_time():
    amplitude = np.array([1.0 + 0.3j, 0.4 - 0.9j])
    turned = np.exp(1j * np.linspace(0.0, 2 * np.pi, 100001))
    distance = np.hypot(*(np.outer(amplitude, turned).real))
    np.testing.assert_allclose(larger_axes(amplitude), distance.max(), rtol=1e-8)
    circle = np.exp(0.7j) * np.array([1.0, -1j])
    np.testing.assert_allclose(phases(circle, 1.0), 0.7)
    back = np.exp(-0.7j) * np.array([1.0, 1j])  # from x to y by 0.7 at time zero
    np.testing.assert_allclose(phases(back, -1.0), 0.7)


def test_modes_are_followed_by_their_overlaps_and_more_speeds_are_added_for_it():
    chart = whole_map()
    asked = np.linspace(200.0, 1100.0, 10)
    assert np.isin(asked, chart.speeds).all()
    present = chart.tracks[:, 1:] >= 0
    little = np.abs(chart.roots[:, 1:].imag) > np.abs(chart.roots[:, 1:].real)
    assert chart.overlaps[:, 1:][present & little].min() > CLOSE
    coarse = rotor_map_of([two_bearings()], [150.0, 1100.0])
    assert len(coarse.speeds) > 4


def test_critical_speeds_are_those_of_the_modes_and_near_to_resonances():
    chart = whole_map()
    assert chart.critical_speeds
    for critical in chart.critical_speeds:
        n = int(np.flatnonzero(chart.speeds == critical.speed)[0])
        frequency = chart.roots[critical.mode, n].imag
        np.testing.assert_allclose(frequency, critical.speed, rtol=1e-3)
    resonances = [each for each in chart.response.resonances if each.point == "shaft.disk"]
    backward = next(each for each in chart.critical_speeds if 500.0 < each.speed < 700.0)
    nearest = min(resonances, key=lambda each: abs(each.speed - backward.speed))
    assert abs(nearest.speed - backward.speed) < 0.02 * backward.speed
    # Of little damping, the amplification factor is 1 / (2 zeta).
    assert abs(nearest.amplification * 2 * backward.damping_ratio - 1.0) < 0.35


def test_forces_of_films_and_unbalance_move_the_rotor():
    """Newton's second law of the shaft's modes of rigid translation: forces on its axis."""
    chart = whole_map()
    n = 4
    speed = chart.speeds[n]
    response = chart.response
    linear = chart.points[n].linear
    system = ehd.equilibrium(two_bearings()(float(speed))).system
    shaft = next(body for _, body, _ in system.each_body(np.zeros(system.n)) if body.size > 1)
    motion = motion_of(chart, n)
    inertia = -(speed**2) * shaft._carried.T @ (linear.basis @ motion)[1 : shaft.size]
    unbalance = 4e-4 * speed**2 * np.exp(1j * np.radians(30.0)) * np.array([1.0, -1j])
    total = unbalance + response.forces["left"][n] + response.forces["right"][n]
    np.testing.assert_allclose(total, inertia, rtol=1e-6, atol=1e-6 * abs(unbalance[0]))


def motion_of(chart, n):
    """Motion q under the unbalance at speed n of a map."""
    from fenics_ehd.analysis.unbalance import response, unbalance_force

    rows = chart.stations.rows[chart.stations.names.index("shaft.disk")]
    speed = float(chart.speeds[n])
    force = unbalance_force(chart.response.unbalances[0], rows, speed)
    return response(chart.points[n].linear, force, speed)


def test_an_unbalance_of_zero_moves_nothing():
    chart = rotor_map_of(
        [rigid_rotor(6.0)], [500.0, 600.0], unbalances=[ehd.Unbalance("rotor", 0.0)]
    )
    assert not chart.response.amplitude("rotor").any()
    with pytest.raises(ehd.errors.SettingsError, match=r"the rotor has no point 'rotor\.nope'"):
        chart.response.phase("rotor.nope")
    with pytest.raises(ehd.errors.SettingsError, match="there is no film 'nope'"):
        chart.response.bearing_force("nope")
    assert chart.response.resonances == ()


def test_films_without_load_and_journals_with_large_orbits_give_notices():
    small, large = (
        rotor_map_of([rigid_rotor(6.0)], [400.0, 500.0], unbalances=[ehd.Unbalance("rotor", me)])
        for me in (1e-6, 1e-3)
    )
    assert not small.notices
    (notice,) = large.notices
    size = larger_axes(large.response.interpolated.journals["bearing"]).max()
    assert "joints.bearing: at " in notice
    assert f"moves the journal by {1e6 * size:.4g} um" in notice
    assert f"{size / C:.3g} of the clearance of 40 um" in notice
    np.testing.assert_allclose(size, small.response.amplitude("rotor").max() * 1e3, rtol=0.01)
    (notice,) = rotor_map_of([rigid_rotor(6.0, (0.0, -1e-6))], [400.0, 500.0]).notices
    assert notice.startswith("joints.bearing: at 400 rad/s its film carries 6e-06 N at ")


def test_speeds_are_stable_or_unstable_by_the_limits_below_them():
    chart = rotor_map_of([rigid_rotor(6.0)], [400.0, 1400.0])
    assert chart.stable_at_first_speed
    assert chart.stable_at(0.99 * chart.stable_below)
    assert not chart.stable_at(1.01 * chart.stable_below)
    unstable = rotor_map_of([rigid_rotor(6.0)], [1400.0, 1450.0])
    assert unstable.stable_below is None
    assert not unstable.stable_at_first_speed
    assert not unstable.stable_at(1425.0)


def test_small_maxima_are_no_resonances():
    speeds = np.linspace(1.0, 2.0, 101)
    hill = np.exp(-(((speeds - 1.5) / 0.1) ** 2))
    noise = 1 + 0.004 * np.cos(200 * speeds)
    peaks = _resonances("disk", speeds, (0.2 + hill) * noise, PROMINENCE)
    assert [round(peak.speed, 1) for peak in peaks] == [1.5]
    assert len(_resonances("disk", speeds, (0.2 + hill) * noise, 0.0)) > 5
    small = 0.2 + 0.01 * hill + np.maximum(speeds - 1.8, 0.0)  # 5 % above its surroundings
    assert len(_resonances("disk", speeds, small, PROMINENCE)) == 1


def test_the_scatter_of_roots_is_that_of_the_meshes():
    parts = [ehd.linearise(ehd.equilibrium(two_bearings(**cells(n))(600.0))) for n in (24, 26, 30)]
    mean = mean_linearisation(parts)
    modes = modes_of(mean)
    parts = [in_basis(part, mean.basis) for part in parts]
    scatter = root_scatter(modes, mean, parts)
    each = np.array([other.roots[matched(modes, other)[0]] for other in map(modes_of, parts)])
    exact = 0.5 * (np.ptp(each.real, axis=0) + 1j * np.ptp(each.imag, axis=0))
    slow = (np.abs(modes.roots) < 1000.0) & (np.abs(modes.roots.imag) > 100.0)
    assert slow.sum() >= 4
    np.testing.assert_allclose(scatter[slow], exact[slow], atol=0.05 * np.abs(exact[slow]).max())
    assert not root_scatter(modes, mean, parts[:1]).any()
    for of_root, scatter_of in (
        (damping_ratio, damping_ratio_scatter),
        (log_decrement, log_decrement_scatter),
    ):
        for i in np.flatnonzero(slow):
            half_range = 0.5 * np.ptp([of_root(root) for root in each[:, i]])
            largest = scatter_of(modes.roots[i], scatter[i])  # the two parts share a cause
            # Errors of the two parts have any signs: the sum of sizes is at most twice their range.
            print(half_range, largest)
            assert 0.9 * half_range <= largest <= 2.0 * half_range
    assert damping_ratio_scatter(-5.0 + 0j, 1.0 + 1.0j) == 0.0
    assert log_decrement_scatter(-5.0 + 0j, 1.0 + 1.0j) is None


def cells(around):
    return {f"joints.{name}.cells": [around, 6] for name in ("left", "right")}


def test_means_over_meshes_are_those_of_the_matrices():
    make = rigid_rotor(6.0)
    single = rotor_map_of([make], [500.0, 600.0]).points[1]
    double = rotor_map_of([make, rigid_rotor(6.0)], [500.0, 600.0]).points[1]
    np.testing.assert_allclose(double.linear.damping, single.linear.damping, rtol=1e-9)
    assert len(double.growth) == 2


def test_a_speed_without_an_equilibrium_is_named_and_the_others_stay():
    heavy = 1e6
    make = rigid_rotor(heavy)
    with pytest.raises(ehd.errors.SolverError, match=r"^no equilibrium at any speed; at 500 rad/s"):
        rotor_map_of([make], [500.0, 600.0])

    def partly(speed):
        return rigid_rotor(6.0 if speed < 550.0 else heavy)(speed)

    chart = rotor_map_of([partly], [500.0, 600.0, 520.0])
    assert list(chart.speeds) == [500.0, 520.0]
    assert list(chart.failures) == [600.0]
    assert modes_of(chart.points[0].linear).roots.size == 4
