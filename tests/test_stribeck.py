"""A rigid bearing between rough surfaces: the Stribeck curve."""

import attrs
import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.analysis.bearing_mechanism import Bearing
from fenics_ehd.cli.bearing import report, summary
from fenics_ehd.scenes.bearing import build_bearing

LOAD, ROUGHNESS = 8000.0, 0.5e-6
ROUGH = ehd.BearingSettings(
    cells_around=32, cells_along=4, journal_roughness=0.3e-6, bore_roughness=0.4e-6
)
SMOOTH = attrs.evolve(ROUGH, journal_roughness=0.0, bore_roughness=0.0)
PLAIN = attrs.evolve(ROUGH, flow_factors=False)


def at(settings, speed):
    return ehd.solve_bearing(attrs.evolve(settings, speed=speed), load=LOAD)


def test_stribeck_curve_has_its_minimum_between_contact_and_full_film(figure):
    speeds = np.array([300.0, 100.0, 50.0, 30.0, 12.0, 2.0, 0.1])
    results = [at(PLAIN, speed) for speed in speeds]
    friction = np.array([r.friction_coefficient for r in results])
    share = np.array([r.contact.share for r in results])
    least = int(np.argmin(friction))
    assert 0 < least < len(speeds) - 1
    assert np.all(np.diff(friction[: least + 1]) < 0)
    assert np.all(np.diff(friction[least:]) > 0)
    assert np.all(np.diff(share) > 0)
    # Full film: contact carries nothing. Boundary: nearly all, and rubs with its coefficient.
    assert share[0] < 1e-9
    assert 0.9 < share[-1] < 1
    assert 0.8 < friction[-1] / PLAIN.boundary_friction < 1
    figure(
        "contact", "Stribeck curve, contact's share of the load at its foot", share[-1], least=0.9
    )
    for result in results:
        np.testing.assert_allclose(result.load, LOAD, rtol=1e-8)
        # Power put in is lost.
        assert result.power_loss == pytest.approx(result.dissipation, rel=1e-8)


def test_full_film_branch_is_that_of_smooth_surfaces_without_flow_factors(figure):
    speeds = [1000.0, 300.0, 200.0]
    worst = 0.0
    for speed in speeds:
        rough, smooth = at(PLAIN, speed), at(SMOOTH, speed)
        assert rough.min_film_thickness > 5 * ROUGHNESS
        for name in ("friction_torque", "min_film_thickness", "max_pressure"):
            worst = max(worst, abs(getattr(rough, name) / getattr(smooth, name) - 1))
    figure("contact", "full film of rough against smooth surfaces, h > 5 sigma", worst, most=1e-6)


def test_tips_that_stand_out_rub_earlier():
    # Of eta beta sigma = 0.04, 1.15 is what counting them on the surfaces gives.
    low, high = (at(attrs.evolve(PLAIN, summit_offset=d), 12.0) for d in (0.0, 1.15))
    assert 4 < high.friction_coefficient / low.friction_coefficient < 5
    assert high.power_loss == pytest.approx(high.dissipation, rel=1e-8)


def test_figures_of_contact_are_there_for_rough_surfaces_alone():
    rough, smooth = at(ROUGH, 30.0), at(SMOOTH, 300.0)
    more = set(summary(rough)) - set(summary(smooth))
    assert more == {
        "contact_load_N",
        "contact_share",
        "max_contact_pressure_Pa",
        "contact_power_W",
        "friction_coefficient",
    }
    assert "load carried by contact" in report(rough)
    assert "contact" not in report(smooth)


def test_surfaces_that_overlap_too_far_are_refused():
    with pytest.raises(ehd.errors.GapClosedError, match="must be above -1 um"):
        Bearing(ROUGH, build_bearing).open_gaps(np.array([1.07 * ROUGH.clearance, 0.0]))
