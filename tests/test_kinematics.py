"""The gap between shaft and bore against plain geometry."""

import numpy as np
import pytest
from differences import numbers, slope
from film_cases import ETA, OMEGA, C, R, make_film
from hypothesis import given
from hypothesis import strategies as st

import fenics_ehd as ehd
from fenics_ehd.film.kinematics import SurfacePoints

WIDTH = 0.022
SHAFT = R - C
POINTS = SurfacePoints(
    *(x.ravel() for x in np.meshgrid(np.linspace(0, 6, 19), np.linspace(-0.5, 0.5, 5) * WIDTH))
)
# Eccentricity in clearances and tilt in clearances per width, each at x and y.
positions = numbers(4, largest=0.7)
rates = numbers(4, largest=300.0)
speeds = st.floats(-1000, 1000)


def motion(position, rate=(0.0,) * 4, speed=OMEGA, **more):
    scale = C * np.array([1, 1, 1 / WIDTH, 1 / WIDTH])
    e, e_rate = scale * position, scale * np.array(rate)
    return ehd.ShaftMotion(e[:2], speed, e_rate[:2], e[2:], e_rate[2:], **more)


def distance(position, *, perpendicular=False):
    """From the bore inwards along e_r to a cylinder, by the quadratic equation of a line.

    Its sections are circles in planes of constant height, or, as of a true
    tilted cylinder, across its own axis.
    """
    x, y, about_x, about_y = C * position * np.array([1, 1, 1 / WIDTH, 1 / WIDTH])
    axis = np.array([about_y, -about_x, 1.0])
    phi = POINTS.angle[:, None]
    ray = np.hstack([np.cos(phi), np.sin(phi), 0 * phi])
    offset = np.column_stack([np.zeros((len(phi), 2)), POINTS.height]) - [x, y, 0.0]
    if perpendicular:
        axis /= np.linalg.norm(axis)
        ray = ray - (ray @ axis)[:, None] * axis
        offset = offset - (offset @ axis)[:, None] * axis
    else:
        offset = offset - offset[:, 2:] * axis
    # |offset + t ray| = SHAFT
    a, b, c = (np.sum(u * v, axis=1) for u, v in ((ray, ray), (ray, offset), (offset, offset)))
    return R - (-b + np.sqrt(b**2 - a * (c - SHAFT**2))) / a


@given(position=positions)
def test_thickness_is_the_distance_to_the_shaft(position):
    found = ehd.shaft_gap(POINTS, R, C, motion(position)).thickness
    assert np.abs(found - distance(position)).max() < 1e-10 * C
    # A true cylinder's section is an ellipse, longer by the square of the tilt.
    tilt = np.linalg.norm(position[2:]) * C / WIDTH
    true = distance(position, perpendicular=True)
    assert np.abs(found - true).max() <= 0.51 * R * tilt**2 + 1e-10 * C


@given(position=positions, rate=rates, speed=speeds)
def test_thickness_rate_is_the_rate_of_that_distance_whatever_the_spin(position, rate, speed):
    found = ehd.shaft_gap(POINTS, R, C, motion(position, rate, speed)).thickness_rate
    size = C * (1.0 + np.abs(rate).max())
    expected = slope(lambda t: distance(position + t * rate), step=1e-5)
    assert np.abs(found - expected).max() < 1e-7 * size
    # (2) on the shaft's own surface: it carries its points along, for any motion on it.
    x, y, about_x, about_y = C * position / np.array([1, 1, WIDTH, WIDTH])
    vx, vy, wx, wy = C * rate / np.array([1, 1, WIDTH, WIDTH])
    phi, z = POINTS.angle, POINTS.height

    def surface(a):
        """Angle to the shaft's surface: h_1 and its velocity there, radial and tangential."""
        centre = np.stack([x + z * about_y, y - z * about_x])
        e_r, e_t = (
            centre[0] * np.cos(a) + centre[1] * np.sin(a),
            (centre[1] * np.cos(a) - centre[0] * np.sin(a)),
        )
        h = e_r + np.sqrt(SHAFT**2 - e_t**2)
        arm = h * np.stack([np.cos(a), np.sin(a)]) - centre
        velocity = np.stack([vx + z * wy, vy - z * wx]) + speed * np.stack([-arm[1], arm[0]])
        radial = velocity[0] * np.cos(a) + velocity[1] * np.sin(a)
        return h, radial, velocity[1] * np.cos(a) - velocity[0] * np.sin(a)

    h, radial, tangential = surface(phi)
    inclination = slope(lambda a: surface(phi + a)[0]) / h
    assert np.abs(found + radial - tangential * inclination).max() < 1e-9 * (size + abs(speed) * C)
    velocity = ehd.shaft_gap(POINTS, R, C, motion(position, rate, speed)).sliding_velocity
    assert np.abs(velocity - tangential).max() < 1e-13 * R * (1 + abs(speed))


def turned_pressure(clearance, frame_speed):
    """Pressure of one motion, seen from a frame that turns about the bore's centre."""
    film = make_film(
        (96, 4), width=R, clearance=clearance, oil=ehd.Lubricant(ETA * (clearance / C) ** 2)
    )
    e, e_rate = clearance * np.array([0.5, 0.2]), clearance * np.array([60.0, -90.0])
    seen = ehd.ShaftMotion(
        e,
        OMEGA - frame_speed,
        e_rate - frame_speed * np.array([-e[1], e[0]]),
        bore_speed=40.0 - frame_speed,
    )
    return film.solve(ehd.shaft_gap(film.points, R, clearance, seen)).pressure


def test_turning_both_bodies_and_the_frame_leaves_the_pressure():
    # Exactly so on a thin film: velocities are taken per radius of the bore on both surfaces.
    differences = []
    for clearance in (4e-4 * R, 1e-4 * R, 1e-8 * R):
        rest, turning = (turned_pressure(clearance, speed) for speed in (0.0, 700.0))
        differences.append(np.abs(rest - turning).max() / rest.max())
    assert differences[0] < 4e-4
    assert differences[2] < 1e-5
    excess = np.array(differences[:2]) - differences[2]
    assert excess[0] / excess[1] == pytest.approx(4, rel=0.3)


def test_shaft_far_off_is_refused():
    with pytest.raises(ehd.errors.SettingsError, match="less than the shaft's radius"):
        ehd.shaft_gap(POINTS, R, C, motion(np.array([2 * R / C, 0, 0, 0])))
