"""A supply that turns with the journal in the coupled step, against one at rest on the bore."""

import attrs
import numpy as np
import pytest
from journal_cases import in_bearing
from scipy.interpolate import CubicSpline

import fenics_ehd as ehd

R, C, ETA, OMEGA, WIDTH = 0.02, 2e-6, 0.01, 100.0, 0.02
LOAD = 0.5 * 6 * ETA * OMEGA * (R / C) ** 2 * R * WIDTH
GROOVE = ehd.AxialGrooveSupply(
    name="inlet", angle=90, extent=50, length=0.6 * WIDTH, pressure=0.05 * LOAD / (R * WIDTH)
)
TURN = 2 * np.pi / OMEGA


def seen_from_the_groove(
    on_journal, cells=(32, 8), tolerance=1e-4, span=0.5, family="lagrange", **more
):
    """Times, eccentricities in the frame of the groove, flows, rejected steps and iterations.

    In the frame of the journal a groove on it is at rest, the bore turns backwards and so does the
    load: that is a groove on the bore, with the journal turning backwards.
    """
    feed = attrs.evolve(GROOVE, on="journal" if on_journal else "bore")
    grid = ehd.uniform_grid(R, WIDTH, cells, family)
    film = ehd.Film(ehd.FilmParameters(grid, C, ehd.Lubricant(ETA), OMEGA, feeds=(feed,)))
    speed, load = (OMEGA, 0.0) if on_journal else (-OMEGA, -OMEGA)
    force = {"load": ehd.RotatingForce("journal", LOAD, load, 0.0)}
    mechanism = in_bearing(film, force, speed=speed, eccentricity=(0.2 * C, -0.1 * C), **more)
    result = ehd.simulate(mechanism, end=span * TURN, tolerance=tolerance, order=2, first=1e-6)
    e = result.joints["bearing"].eccentricity
    if on_journal:
        back = -OMEGA * result.time
        e = np.column_stack(
            [
                np.cos(back) * e[:, 0] - np.sin(back) * e[:, 1],
                np.sin(back) * e[:, 0] + np.cos(back) * e[:, 1],
            ]
        )
    return result, e / C


def difference(cells, tolerance, span=0.25):
    """Largest difference of the orbits, over the clearance, and of the flows, over the largest."""
    (one, e), (other, f) = (
        seen_from_the_groove(on, cells, tolerance, span) for on in (True, False)
    )
    # The films build up first, in steps of their own.
    time = np.linspace(0.1 * one.time[-1], one.time[-1], 400)
    flows = [CubicSpline(r.time, r.columns["inlet.flow_m3_per_s"])(time) for r in (one, other)]
    orbits = np.abs(CubicSpline(one.time, e)(time) - CubicSpline(other.time, f)(time))
    return orbits.max(), np.abs(flows[0] - flows[1]).max() / np.abs(flows[0]).max()


@pytest.mark.slow
def test_turning_and_resting_groove_converge_with_mesh_and_step(figure):
    found = [difference(cells, 1e-6) for cells in ((16, 5), (32, 10))]
    # What is left is c / R, a ten-thousandth: the groove's speed is that of one or other surface.
    figure("supply", "turning against resting groove, orbit over c", found[1][0], most=1.5e-4)
    figure("supply", "turning against resting groove, flow", found[1][1], most=5e-3)
    assert found[0][1] > 3 * found[1][1]
    coarse = [difference((32, 10), tolerance)[0] for tolerance in (1e-3, 1e-5)]
    assert coarse[0] > 1.5 * coarse[1] > 1.5 * 1.5 * found[1][0]


def test_what_is_supplied_is_in_the_energy_balance_and_the_columns():
    result, _ = seen_from_the_groove(True, (16, 5), 1e-3)
    assert result.summary()["energy_balance_error"] < 1e-5
    flow, side = (result.columns[f"{name}flow_m3_per_s"] for name in ("inlet.", "side_"))
    assert flow[-1] > 0.0
    assert side[-1] > 0.0


@pytest.mark.parametrize("family", ["lagrange", "bilinear"])
def test_power_of_bodies_and_supply_is_what_is_lost(family):
    result, _ = seen_from_the_groove(True, (16, 5), 1e-5, 0.1, family, friction=True)
    put_in, supplied, lost = (
        result.columns[f"{name}_power_W"][5:] for name in ("film", "supply", "dissipated")
    )
    assert np.abs(put_in + supplied - lost).max() < 1e-5 * lost.max()
    assert np.abs(supplied).max() > 1e-3 * lost.max()
