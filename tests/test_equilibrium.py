"""Mechanisms at rest and their small motions: exact derivatives, in any mechanism."""

import numpy as np
import pytest

import fenics_ehd as ehd

R, C, WIDTH, SPEED, LOAD = 0.0225, 17e-6, 0.022, 500.0, 4000.0

ROUGH = ehd.RoughSurfaces(journal_roughness=0.3e-6, bore_roughness=0.4e-6, modulus=115e9)


def film(family="lagrange", cells=(24, 6), oil=None, **more):
    grid = ehd.FilmGrid(
        R, np.linspace(0.0, 2 * np.pi, cells[0] + 1),
        WIDTH * np.linspace(-0.5, 0.5, cells[1] + 1), family,
    )  # fmt: skip
    return ehd.Film(ehd.FilmParameters(grid, C, oil or ehd.Lubricant(0.01), SPEED, **more))


def journal(on, force=(LOAD, 0.0), rate=(0.0, 0.0), **joint):
    """A journal of 2 kg under a force [N], that moves at a rate [m/s]."""
    start = {"eccentricity": (0.3 * C, 0.4 * C), "eccentricity_rate": rate}
    shaft = ehd.RigidBody(2.0, 1e-3, position=start["eccentricity"], velocity=rate)
    size = float(np.hypot(*force))
    return ehd.Mechanism(
        {"shaft": shaft},
        {"bearing": ehd.LubricatedJoint("shaft", "ground", on, **start, **joint)},
        {"shaft": ehd.Speed(SPEED)},
        {"load": ehd.PointForce("shaft", force, lambda _: (size, 0.0))},
    )


def place(mechanism):
    found = ehd.equilibrium(mechanism, tolerance=1e-13)
    return found.z[found.system.bodies["shaft"]][:2], found


@pytest.mark.parametrize(
    ("on", "joint"),
    [
        (film(), {}),
        (film("bilinear", oil=ehd.Lubricant(0.01, ehd.Barus(2e-8))), {}),
        (film("serendipity", (20, 5)), {}),
        (film(regions=(ehd.AxialGroove(-1.4, 0.4, 2e5),)), {}),
        (film(), {"bore_shape": ehd.Shape(misalignment=(-2e-4, 3e-4))}),
        (film(surfaces=ROUGH), {}),
    ],
    ids=["plain", "barus", "8-node", "groove", "tilted", "rough"],
)
def test_stiffness_and_damping_are_differences_of_equilibria(on, joint):
    middle = place(journal(on, **joint))[1]
    small = ehd.linearise(middle).along(middle.system.bodies["shaft"].start + np.arange(2))
    np.testing.assert_allclose(small.mass, 2.0 * np.eye(2), atol=1e-12)
    change, velocity = 1e-4 * LOAD, 1e-5 * C * SPEED
    for direction in np.eye(2):
        loads = [np.array((LOAD, 0.0)) + sign * change * direction for sign in (1, -1)]
        ends = [place(journal(on, load, **joint))[0] for load in loads]
        moved = small.stiffness @ (ends[0] - ends[1]) / (2 * change)
        np.testing.assert_allclose(moved, direction, atol=2e-4)
        # Under the same load, moving: the film's stiffness gives what its damping takes.
        ends = [
            place(journal(on, rate=tuple(sign * velocity * direction), **joint))[0]
            for sign in (1, -1)
        ]
        given = -small.stiffness @ (ends[0] - ends[1]) / (2 * velocity)
        taken = small.damping @ direction
        np.testing.assert_allclose(given, taken, atol=2e-4 * np.abs(small.damping).max())


def test_films_that_keep_account_of_their_oil_answer_by_frequency():
    on = film("bilinear", sides=ehd.Sides(1e5, 1e5))
    with pytest.raises(ehd.errors.SettingsError, match="depend on the frequency"):
        ehd.linearise(journal(on, cavitation="mass-conserving"))
