"""Mechanisms with lubricated joints against independent answers."""

from dataclasses import replace

import attrs
import numpy as np
import pytest
from mechanism_cases import REVOLUTION, film, rigid_rod, short_films, slider_crank

import fenics_ehd as ehd


def floating(friction):
    """Two rigid bodies that float in the plane, tied by one film alone."""
    oil = film(22.5e-3, 22e-3, 50e-6, 0.01, (20, 4))
    return ehd.Mechanism(
        {
            "disk": ehd.RigidBody(0.5, 1e-3, speed=400.0, velocity=(0.3, 0.0)),
            "ring": ehd.RigidBody(
                0.7, 2e-3, {"bore": (0.05, 0.0)}, centre=(0.03, 0.01), position=(-0.05, 0.0),
                velocity=(0.3, 0.0),
            ),
        },
        {
            "film": ehd.LubricatedJoint(
                "disk", "ring.bore", oil, friction=friction, eccentricity=(1e-5, 2e-5)
            )
        },
    )  # fmt: skip


@pytest.mark.parametrize("friction", [False, True])
def test_what_floats_free_keeps_its_momentum(friction):
    mechanism = floating(friction)
    result = ehd.simulate(mechanism, 4e-3, tolerance=1e-6, order=2)
    momenta = np.zeros((len(result.time), 3))
    for name, body in mechanism.bodies.items():
        x, y, angle = result.bodies[name].coordinates.T
        vx, vy, omega = result.bodies[name].rates.T
        cosine, sine = np.cos(angle), np.sin(angle)
        cx, cy = (
            cosine * body.centre[0] - sine * body.centre[1],
            (sine * body.centre[0] + cosine * body.centre[1]),
        )
        px, py = body.mass * (vx - omega * cy), body.mass * (vy + omega * cx)
        spin = body.inertia * omega + (x + cx) * py - (y + cy) * px
        momenta += np.stack([px, py, spin], axis=-1)
    scale = np.array([1.0, 1.0, 0.05]) * np.abs(momenta[0]).max()
    late = momenta[10:]
    assert np.abs((late - late[0]) / scale).max() < 1e-6
    if friction:
        # Without it the film exchanges next to nothing.
        assert result.summary()["energy_balance_error"] < 1e-3
    turning = result.bodies["disk"].rates[:, 2]
    assert (abs(turning[-1] - turning[0]) > 1e-3) == friction


def renamed(mechanism, name):
    """The same mechanism, its bodies and joints under other names and listed the other way."""

    def marker(text):
        body, dot, point = text.partition(".")
        return (body if body == "ground" else name(body)) + dot + point

    def with_markers(joint):
        if isinstance(joint, ehd.Revolute):
            return attrs.evolve(joint, between=[marker(end) for end in joint.between])
        if isinstance(joint, ehd.Slider):
            return attrs.evolve(joint, line=marker(joint.line), point=marker(joint.point))
        return replace(joint, journal=marker(joint.journal), bore=marker(joint.bore))

    return replace(
        mechanism,
        bodies={name(n): body for n, body in reversed(mechanism.bodies.items())},
        joints={name(n): with_markers(j) for n, j in reversed(mechanism.joints.items())},
        drives={name(n): drive for n, drive in mechanism.drives.items()},
    )


@pytest.mark.parametrize("name", [str, lambda text: text[::-1]], ids=["listed", "named"])
def test_order_and_names_of_what_is_listed_do_not_matter(name):
    mechanism = slider_crank(rigid_rod(), *short_films())
    other = renamed(mechanism, name)
    # Equations stand in the order of the names: another order is another round-off, by which
    # Newton's method may stop an update of a hundredth of the tolerance earlier.
    assert (sorted(map(name, mechanism.bodies)) == list(map(name, sorted(mechanism.bodies)))) == (
        name is str
    )
    a, b = (ehd.simulate(m, 0.1 * REVOLUTION, tolerance=1e-4) for m in (mechanism, other))
    close = 1e-10 if name is str else 1e-6
    assert a.time == pytest.approx(b.time, rel=close)
    for joint, result in a.joints.items():
        found = b.joints[name(joint)].min_film_thickness
        assert result.min_film_thickness == pytest.approx(found, rel=close)
