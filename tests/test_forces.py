"""Forces, powers and flows of the film against independent integrals and balances."""

import numpy as np
import pytest
from film_cases import FAMILIES
from oracle_walls import walls

import fenics_ehd as ehd
from fenics_ehd.base.fields import SHEAR_RULES
from fenics_ehd.film.forces import FilmFlows, film_fields
from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.multibody.step_equations import film_friction

pytestmark = pytest.mark.kernels

R, C, B, ETA, OMEGA = 0.0225, 17e-6, 0.022, 0.01, 500.0
GROOVES = (ehd.AxialGroove(np.pi / 2, np.pi / 8, 3e5), ehd.AxialGroove(-np.pi / 2, np.pi / 8, 1e5))


def solved(
    motion, *, cells=(64, 8), family="lagrange", sides=None, regions=(), clearance=C, oil=None
):
    parameters = ehd.FilmParameters(
        ehd.uniform_grid(R, B, cells, family),
        clearance,
        oil or ehd.Lubricant(ETA),
        OMEGA,
        sides or ehd.Sides(),
        regions,
    )
    film = ehd.Film(parameters)
    return film, film.solve(ehd.shaft_gap(film.points, R, clearance, motion))


def everything_moves(clearance=C):
    return ehd.ShaftMotion(
        clearance * np.array([0.3, -0.4]),
        OMEGA,
        clearance * np.array([100.0, 50.0]),
        clearance / B * np.array([0.4, -0.3]),
        clearance / B * np.array([20.0, 30.0]),
        bore_speed=-100.0,
    )


def eccentric(ratio=0.6, clearance=C):
    return ehd.ShaftMotion(np.array([ratio * clearance, 0.0]), OMEGA)


def friction_of(film, state, rule="streamers"):
    """Friction of the film as a joint has it, and the joint's film."""
    joint = JointFilm(ehd.LubricatedJoint("a", "b", film, shear_rule=rule), tilting=True)
    return joint, film_friction(joint, state)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("clearance", [C, C / 100])
def test_friction_is_that_of_the_two_walls_as_they_are(family, clearance):
    motion = ehd.ShaftMotion(
        clearance * np.array([0.3, -0.4]), OMEGA, clearance * np.array([100.0, 50.0])
    )
    film, state = solved(
        motion, family=family, sides=ehd.Sides(1e5, None), regions=GROOVES, clearance=clearance
    )
    for rule in SHEAR_RULES:
        _, friction = friction_of(film, state, rule)
        found = walls(film, state, motion.eccentricity, friction.sheared_fraction)
        # The film's push on an eccentric shaft has no arm about its axis; c / R is left out.
        assert friction.torque == pytest.approx(found.shaft_torque, rel=3 * clearance / R)
        size = np.abs(found.on_bore).max()
        assert found.on_shaft == pytest.approx(-found.on_bore, abs=1e-4 * size)
        assert friction.on_xi[:2] == pytest.approx(found.shear_on_shaft, abs=2e-6 * size)
        assert np.abs(found.shear_on_bore + found.shear_on_shaft).max() < 3e-3 * size
        lost = film.powers(state)[0] + friction.sheared
        assert lost == pytest.approx(found.dissipation, rel=1e-10)


@pytest.mark.parametrize("oil", [ehd.Lubricant(ETA), ehd.Lubricant(ETA, ehd.Barus(1e-9))])
def test_power_put_in_is_dissipated(oil):
    """Full film, cavitated film and supplied film; pumping enters where the sides have pressure."""
    small = C / 100
    cases = (
        (eccentric(0.3, small), ehd.Sides(), ()),
        (eccentric(0.3, small), ehd.Sides(1e9, 1e9), ()),
        (everything_moves(small), ehd.Sides(2e8, 1e8), ()),
    )
    for motion, sides, regions in cases:
        # A softer oil, so that pressures suit the pressure law.
        thin = ehd.Lubricant(1e-4 * ETA, oil.viscosity_law)
        film, state = solved(motion, sides=sides, regions=regions, clearance=small, oil=thin)
        (joint, friction), flow = friction_of(film, state), FilmFlows(film, state).balance
        # As seen from the bore.
        place = np.stack([motion.eccentricity, motion.tilt])
        rates = np.stack([motion.eccentricity_rate, motion.tilt_rate])
        rates = rates - motion.bore_speed * place @ [[0.0, 1.0], [-1.0, 0.0]]
        put_in = -(joint.load @ state.pressure + friction.on_xi) @ rates.ravel()
        put_in -= friction.torque * (motion.shaft_speed - motion.bore_speed)
        pumped = -sides.lower * flow.lower - sides.upper * flow.upper
        lost = film.powers(state)[0] + friction.sheared
        assert put_in + pumped == pytest.approx(lost, rel=1e-5)


def test_supply_pressure_pumps():
    motion = ehd.ShaftMotion(np.array([0.4 * C, 0.2 * C]), 0.0)
    film, state = solved(motion, regions=GROOVES)
    lost, flow = film.powers(state)[0], FilmFlows(film, state).balance
    assert friction_of(film, state)[1].sheared == 0.0
    # Two grooves of different pressure: what enters at one and leaves at the other does work too.
    assert 1e5 * flow.supply < lost < 3e5 * flow.supply
    one = (ehd.AxialGroove(0.0, np.pi / 8, 3e5),)
    film, state = solved(motion, regions=one)
    lost, flow = film.powers(state)[0], FilmFlows(film, state).balance
    assert lost == pytest.approx(3e5 * flow.supply, rel=1e-9)
    assert flow.side == pytest.approx(flow.supply, rel=1e-9)


def test_streamers_carry_the_flow_of_the_rupture():
    motion = eccentric(0.7)
    film, state = solved(motion)
    filled = film_fields(film, state, "streamers").sheared_fraction
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
    going = ehd.ShaftMotion(position, OMEGA, whirl * np.array([0.0, position[0]]))
    standing = ehd.ShaftMotion(position, OMEGA - whirl, bore_speed=-whirl)
    lost = []
    for motion in (going, standing):
        film, state = solved(motion, clearance=C / 100)
        filled = film_fields(film, state).sheared_fraction
        lost.append(film.powers(state)[0] + friction_of(film, state)[1].sheared)
    assert lost[0] == pytest.approx(lost[1], rel=1e-4)
    # At half speed, pure squeeze, cavities are alike on both sides.
    assert filled.min() < 0.6


def test_shear_rules_are_in_order_and_grooves_are_free_of_it():
    motion = eccentric(0.7)
    film, state = solved(motion)
    drag = {rule: -friction_of(film, state, rule)[1].torque for rule in SHEAR_RULES}
    assert drag["none"] < drag["streamers"] < drag["full"]
    film, state = solved(motion, regions=GROOVES)
    filled = film_fields(film, state, "full").sheared_fraction
    inside = np.abs(np.abs(film.points.angle - np.pi) - np.pi / 2) < np.pi / 16
    assert np.all(filled[inside] == 0.0)
    assert np.all(filled[~inside] == 1.0)
    with pytest.raises(ehd.errors.SettingsError, match="'most' is not one of streamers, full"):
        film_fields(film, state, "most")


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("sides", [ehd.Sides(), ehd.Sides(2e5, None), ehd.Sides(1e5, 3e5)])
def test_flows_balance_to_round_off(family, sides):
    film, state = solved(everything_moves(), family=family, sides=sides, regions=GROOVES)
    flow = FilmFlows(film, state).balance
    # Of what goes round: all flows across the film's ends are small differences of it.
    around = B * np.max(np.abs(state.gap.mean_velocity) * state.gap.thickness)
    defect = flow.supply + flow.cavities - flow.side - flow.squeeze
    assert abs(defect) < 1e-13 * around
    assert flow.cavities >= 0.0
    if sides.upper is None:
        assert flow.upper == 0.0


def test_an_unbalance_rotates_with_its_body():
    speed, time = 600.0, 1.3e-3
    unbalance = ehd.Unbalance("shaft.disk", 4e-4, 25.0)
    turning = ehd.RotatingForce("shaft.disk", 4e-4 * speed**2, speed)
    u, rates = np.zeros(5), np.zeros(5)
    u[2], rates[2] = speed * time - np.radians(25.0), speed
    np.testing.assert_allclose(
        unbalance.load(time, u, rates).value, turning.load(time, u, rates).value, rtol=1e-12
    )
    (variation,) = unbalance.variations
    assert variation.angle_of == "shaft"
    np.testing.assert_allclose(variation.period, 2 * np.pi)


def test_a_magnitude_and_an_amplitude_of_zero_are_values():
    rates = np.array([0.0, 0.0, 600.0, 0.0, 0.0])
    for force in (ehd.Unbalance("shaft", 0.0), ehd.RotatingForce("shaft", 0.0, 600.0)):
        assert not force.load(0.1, np.zeros(5), rates).value.any()
    with pytest.raises(ehd.errors.SettingsError, match=r"magnitude = -1.0 .*at least 0"):
        ehd.Unbalance("shaft", -1.0)
