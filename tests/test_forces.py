"""Forces, powers and flows of the film against independent integrals and balances."""

import numpy as np
import pytest

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film import Film, FilmParameters, Lubricant, ShaftMotion, shaft_gap
from fenics_ehd.film.flow import flow_balance
from fenics_ehd.film.forces import film_forces
from fenics_ehd.film.grid import FAMILIES, uniform_grid
from fenics_ehd.film.lubricant import Barus
from fenics_ehd.film.shear import SHEAR_RULES, film_fields
from fenics_ehd.film.supply import AxialGroove, Sides

pytestmark = pytest.mark.kernels

R, C, B, ETA, OMEGA = 0.0225, 17e-6, 0.022, 0.01, 500.0
GROOVES = (AxialGroove(np.pi / 2, np.pi / 8, 3e5), AxialGroove(-np.pi / 2, np.pi / 8, 1e5))


def solved(
    motion, *, cells=(64, 8), family="lagrange", sides=None, regions=(), clearance=C, oil=None
):
    parameters = FilmParameters(
        uniform_grid(R, B, cells, family),
        clearance,
        oil or Lubricant(ETA),
        OMEGA,
        sides or Sides(),
        regions,
    )
    film = Film(parameters)
    return film, film.solve(shaft_gap(film.points, R, clearance, motion))


def everything_moves(clearance=C):
    return ShaftMotion(
        clearance * np.array([0.3, -0.4]),
        OMEGA,
        clearance * np.array([100.0, 50.0]),
        clearance / B * np.array([0.4, -0.3]),
        clearance / B * np.array([20.0, 30.0]),
        bore_speed=-100.0,
    )


def eccentric(ratio=0.6, clearance=C):
    return ShaftMotion(np.array([ratio * clearance, 0.0]), OMEGA)


def finer_points(film, order=6):
    """Angle, height and weight of a Gauss rule that the film does not use, flat arrays."""
    x, w = np.polynomial.legendre.leggauss(order)
    grid = film.parameters.grid

    def axis(boundaries):
        widths = np.diff(boundaries)[:, None]
        return (boundaries[:-1, None] + widths * (x + 1) / 2).ravel(), (widths * w / 2).ravel()

    (angle, dphi), (height, dz) = axis(grid.angles), axis(grid.heights)
    a, z = np.meshgrid(angle, height, indexing="ij")
    return a.ravel(), z.ravel(), np.outer(dphi, dz).ravel()


def gap_at(angle, height, motion, clearance):
    """Gap and its slope along the angle, written out anew."""
    x = motion.eccentricity[0] + height * motion.tilt[1]
    y = motion.eccentricity[1] - height * motion.tilt[0]
    radial = x * np.cos(angle) + y * np.sin(angle)
    tangential = y * np.cos(angle) - x * np.sin(angle)
    chord = np.sqrt((R - clearance) ** 2 - tangential**2)
    # d(radial) / d(angle) = tangential, d(tangential) / d(angle) = -radial.
    return R - radial - chord, -tangential - tangential * radial / chord


@pytest.mark.parametrize("family", FAMILIES)
def test_action_equals_reaction(family):
    film, state = solved(everything_moves(), family=family, sides=Sides(1e5, None), regions=GROOVES)
    for rule in SHEAR_RULES:
        forces = film_forces(film, state, everything_moves(), rule)
        shaft, bore = forces.on_shaft, forces.on_bore
        scale = np.abs(bore.force).max()
        np.testing.assert_allclose(shaft.force, -bore.force, atol=1e-13 * scale)
        np.testing.assert_allclose(shaft.moment, -bore.moment, atol=1e-13 * R * scale)
        # Neither part alone is opposite: the shaft's surface is inclined and smaller.
        split = forces.pressure_on_shaft.force + forces.pressure_on_bore.force
        assert np.abs(split).max() > 1e-6 * scale


@pytest.mark.parametrize("clearance", [C, 1e-3])
def test_pressure_on_the_shaft_is_that_on_its_own_inclined_surface(clearance):
    motion = everything_moves(clearance)
    film, state = solved(motion, sides=Sides(1e5, 2e5), clearance=clearance)
    angle, height, weight = finer_points(film)
    pressure = film.parameters.grid.interpolation(angle, height) @ state.pressure
    gap, slope = gap_at(angle, height, motion, clearance)
    cosine, sine = np.cos(angle), np.sin(angle)
    x = -pressure * ((R - gap) * cosine - slope * sine) * weight
    y = -pressure * ((R - gap) * sine + slope * cosine) * weight
    pressure_on_shaft = film_forces(film, state, motion).pressure_on_shaft
    scale = np.hypot(x.sum(), y.sum())
    np.testing.assert_allclose(pressure_on_shaft.force, [x.sum(), y.sum()], atol=2e-6 * scale)
    tilting = [-(height * y).sum(), (height * x).sum()]
    np.testing.assert_allclose(pressure_on_shaft.moment[:2], tilting, atol=2e-6 * scale * B)


@pytest.mark.parametrize("clearance", [C, C / 100])
def test_friction_torque_is_the_shear_on_the_shaft(clearance):
    """The film's push on an eccentric shaft has no arm about its axis; c / R is left out."""
    motion = everything_moves(clearance)
    film, state = solved(motion, clearance=clearance)
    fields = film_fields(film, state)
    gap = state.gap
    shear = -fields.filled * fields.viscosity * gap.sliding_velocity / gap.thickness
    shear -= 0.5 * gap.thickness * fields.slope_around
    expected = (R - clearance) * R**2 * np.sum(film.assembly.area * shear)
    torque = film_forces(film, state, motion).friction_torque
    assert torque == pytest.approx(expected, rel=3 * clearance / R)


def test_centred_shaft_has_petroffs_torque():
    motion = eccentric(0.0)
    film, state = solved(motion, cells=(12, 3))
    forces = film_forces(film, state, motion)
    petroff = -2 * np.pi * ETA * OMEGA * R**3 * B / C
    assert forces.friction_torque == pytest.approx(petroff, rel=2 * C / R)
    assert forces.power == pytest.approx(-OMEGA * petroff, rel=2 * C / R)


@pytest.mark.parametrize("oil", [Lubricant(ETA), Lubricant(ETA, Barus(1e-9))])
def test_power_put_in_is_dissipated(oil):
    """Full film, cavitated film and supplied film; pumping enters where the sides have pressure."""
    small = C / 100
    cases = (
        (eccentric(0.3, small), Sides(), ()),
        (eccentric(0.3, small), Sides(1e9, 1e9), ()),
        (everything_moves(small), Sides(2e8, 1e8), ()),
    )
    for motion, sides, regions in cases:
        # A softer oil, so that pressures suit the pressure law.
        thin = Lubricant(1e-4 * ETA, oil.viscosity_law)
        film, state = solved(motion, sides=sides, regions=regions, clearance=small, oil=thin)
        forces, flow = film_forces(film, state, motion), flow_balance(film, state)
        pumped = -sides.lower * flow.lower - sides.upper * flow.upper
        assert forces.power + pumped == pytest.approx(forces.dissipation, rel=1e-5)


def test_supply_pressure_pumps():
    motion = ShaftMotion(np.array([0.4 * C, 0.2 * C]), 0.0)
    film, state = solved(motion, regions=GROOVES)
    forces, flow = film_forces(film, state, motion), flow_balance(film, state)
    assert forces.power == 0.0
    # Two grooves of different pressure: what enters at one and leaves at the other does work too.
    assert 1e5 * flow.supply < forces.dissipation < 3e5 * flow.supply
    one = (AxialGroove(0.0, np.pi / 8, 3e5),)
    film, state = solved(motion, regions=one)
    forces, flow = film_forces(film, state, motion), flow_balance(film, state)
    assert forces.dissipation == pytest.approx(3e5 * flow.supply, rel=1e-9)
    assert flow.side == pytest.approx(flow.supply, rel=1e-9)


def test_streamers_carry_the_flow_of_the_rupture():
    motion = eccentric(0.7)
    film, state = solved(motion)
    filled = film_fields(film, state, "streamers").filled
    pressure = film.assembly.at_points(state.pressure)[0]
    section = np.isclose(film.points.height, film.points.height[0, 0])
    order = np.argsort(film.points.angle[section])
    gap, full, share = (
        values[section][order]
        for values in (state.gap.thickness, pressure > 1e-9 * pressure.max(), filled)
    )
    assert 0 < full.sum() < len(full)
    carried = None
    for place in np.tile(np.arange(len(full)), 2):
        if full[place]:
            carried = gap[place]
            assert share[place] == 1.0
        elif carried is not None:
            assert share[place] == pytest.approx(min(carried / gap[place], 1.0))


@pytest.mark.parametrize("share", [0.2, 0.48, 0.5, 0.52, 0.8])
def test_streamers_come_from_upstream_as_the_cavity_sees_it(share):
    # A whirling shaft, and the same in the frame that turns with its centre.
    position, whirl = np.array([0.7 * C / 100, 0.0]), share * OMEGA
    going = ShaftMotion(position, OMEGA, whirl * np.array([0.0, position[0]]))
    standing = ShaftMotion(position, OMEGA - whirl, bore_speed=-whirl)
    lost = []
    for motion in (going, standing):
        film, state = solved(motion, clearance=C / 100)
        filled = film_fields(film, state).filled
        lost.append(film_forces(film, state, motion).dissipation)
    assert lost[0] == pytest.approx(lost[1], rel=1e-4)
    # At half speed, pure squeeze, cavities are alike on both sides.
    assert filled.min() < 0.6


def test_shear_rules_are_in_order_and_grooves_are_free_of_it():
    motion = eccentric(0.7)
    film, state = solved(motion)
    drag = {rule: -film_forces(film, state, motion, rule).friction_torque for rule in SHEAR_RULES}
    assert drag["none"] < drag["streamers"] < drag["full"]
    film, state = solved(motion, regions=GROOVES)
    filled = film_fields(film, state, "full").filled
    inside = np.abs(np.abs(film.points.angle - np.pi) - np.pi / 2) < np.pi / 16
    assert np.all(filled[inside] == 0.0)
    assert np.all(filled[~inside] == 1.0)
    with pytest.raises(SettingsError, match="'most' is not one of streamers, full, none"):
        film_forces(film, state, motion, "most")


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("sides", [Sides(), Sides(2e5, None), Sides(1e5, 3e5)])
def test_flows_balance_to_round_off(family, sides):
    film, state = solved(everything_moves(), family=family, sides=sides, regions=GROOVES)
    flow = flow_balance(film, state)
    # Of what goes round: all flows across the film's ends are small differences of it.
    around = B * np.max(np.abs(state.gap.mean_velocity) * state.gap.thickness)
    defect = flow.supply + flow.cavities - flow.side - flow.squeeze
    assert abs(defect) < 1e-13 * around
    assert flow.cavities >= 0.0
    if sides.upper is None:
        assert flow.upper == 0.0


def test_closed_side_mirrors_a_bearing_of_twice_the_width():
    motion = eccentric(0.5)
    film, state = solved(motion, cells=(32, 8))
    grid = uniform_grid(R, B / 2, (32, 4))
    half = Film(FilmParameters(grid, C, Lubricant(ETA), OMEGA, Sides(None, 0.0)))
    other = half.solve(shaft_gap(half.points, R, C, motion))
    whole, part = flow_balance(film, state), flow_balance(half, other)
    assert part.upper == pytest.approx(whole.side / 2, rel=1e-9)
    force = film_forces(half, other, motion).pressure_on_bore.force
    expected = film_forces(film, state, motion).pressure_on_bore.force / 2
    np.testing.assert_allclose(force, expected, rtol=1e-9)
