"""Stiff and extreme runs: what was found wrong with them, and mechanics of a textbook."""

from dataclasses import replace

import numpy as np
import pytest
from journal_cases import in_bearing, make_film, steady
from oracle_slider_crank import RigidSliderCrank, balanced
from scene_cases import RIGID_ROD, tables_of

import fenics_ehd as ehd
from fenics_ehd.film import cavitation
from fenics_ehd.multibody.run import Run, touching_film
from fenics_ehd.scenes.scene import scene_of

REDUCTION = "bodies.rod.reduction"


def machine(scene, changes, bodies=None):
    """Its machine, elastic parts of it meshed and reduced unless their bodies are given."""
    return ehd.build(scene_of(tables_of(scene, changes), scene), bodies=bodies)


def with_few_patterns(body, truncation):
    """A body of M4 with the patterns that move its bore most, relative to the first one."""
    residual = body.residual
    sizes = np.abs(body.outward(residual.displacement)).max(axis=0)
    rank = np.flatnonzero(sizes > truncation * sizes.max())[-1] + 1
    few = replace(
        residual,
        displacement=residual.displacement[:, :, :rank],
        patterns=residual.patterns[:rank],
        stiffness=residual.stiffness[:rank],
    )
    return replace(body, residual=few)


def elastic(method, revolutions, changes=None, bodies=None):
    usual = {
        f"{REDUCTION}.method": method,
        f"{REDUCTION}.estimate_error": False,
        "bodies.rod.geometry.bore_cells_along": 2,
        "time.revolutions": revolutions,
        "time.tolerance": 1e-4,
    }
    return machine("slider-crank-paper", usual | (changes or {}), bodies)


def new_run(built):
    return Run(built.mechanism, built.steps, built.end)


def rigid(revolutions, changes=None):
    usual = RIGID_ROD | {"time.revolutions": revolutions, "time.tolerance": 1e-4}
    return machine("slider-crank-paper", usual | (changes or {}))


@pytest.mark.slow
def test_a_rigid_rod_bears_the_load_of_a_textbook():
    built = rigid(1.0)
    history = ehd.simulate(built.mechanism, **built.options)
    joint = history.joints["big_end"]
    times, pressure, film = balanced(built, built.end)
    begin = 0.1 / built.mechanism.drives["crank"](0.0)[1]
    own, other = history.time >= begin, times >= begin
    assert joint.max_pressure[own].max() == pytest.approx(pressure[other].max(), rel=0.01)
    assert joint.min_film_thickness[own].min() == pytest.approx(film[other].min(), rel=0.01)


def test_a_crank_that_a_brake_turns_back_follows_one_equation_of_motion():
    brake, speed, inertia = -60.0, 100.0, 1e-2
    changes = {
        "drives.crank": {"kind": "torque", "torque": brake},
        "bodies.crank.speed": speed,
        "bodies.crank.inertia": inertia,
    }
    built = rigid(0.5, changes)
    history = ehd.simulate(built.mechanism, **built.options)
    expected = RigidSliderCrank(built).driven(speed, inertia, brake, history.time)
    found = history.columns["crank.angle_rad"]
    assert np.abs(found - expected).max() < 2e-3 * np.ptp(expected)
    assert history.columns["crank.speed_rad_per_s"][-1] < -0.1 * speed


def test_a_film_without_thickness_is_an_infinite_error():
    run = new_run(rigid(1.0))
    observed = run.norm.observe(run.state.x[0])
    error = np.zeros_like(observed)
    gaps = run.norm.gaps(observed)
    error[: len(gaps)] = 1e-9
    assert run.norm.error_norm(observed, error) == pytest.approx(1e-9 / gaps.min())
    observed[3] = -1e-7
    assert run.norm.error_norm(observed, error) == np.inf


def test_a_run_does_not_step_through_the_bore():
    """A rod as soft as rubber: the film closes at its nodes before it does at Gauss points."""
    run = new_run(elastic("m3", 0.1, {"bodies.rod.material.youngs_modulus": 1e9}))
    with pytest.raises(ehd.errors.FilmTooThinError):  # noqa: PT012
        for step in run.until(1.0):
            assert run.norm.gaps(step.observed).min() > 0


@pytest.mark.parametrize(
    ("share", "clearance", "limit", "reason"),
    [
        (0.01, 200e-6, 0.2e-6, "the smallest film of surfaces without a roughness"),
        (0.01, 17e-6, 0.17e-6, "joints.pin.smallest_film = 0.01 of the clearance"),
        (1e-4, 200e-6, 0.02e-6, "joints.pin.smallest_film = 0.0001 of the clearance"),
        (0.6, 17e-6, 10.2e-6, "joints.pin.smallest_film = 0.6 of the clearance"),
    ],
)
def test_surfaces_touch_at_the_smaller_of_a_share_and_a_film(share, clearance, limit, reason):
    """A share above the default is meant as it is."""
    found = touching_film("pin", share, clearance)
    assert found == (pytest.approx(limit), reason)


def test_a_thin_film_of_a_large_clearance_is_no_touch():
    """1.9 um of 200 um."""
    film = make_film((64, 4), clearance=200e-6)
    start = {"eccentricity": (198.1e-6, 0.0)}

    def films(**joint):
        load = steady(3e5)
        return ehd.simulate(
            in_bearing(film, {"load": load}, **start, **joint), 1e-5, tolerance=1e-2
        )

    assert films().joints["bearing"].min_film_thickness.min() < 1.95e-6
    with pytest.raises(ehd.errors.FilmTooThinError, match=r"below joints\.bearing\.smallest_film"):
        films(smallest_film=0.011)


@pytest.mark.slow
def test_few_patterns_without_damping_start_a_film(monkeypatch):
    """Full updates lead from one active set to another and back there, from 1e-8 s down."""
    undamped = {"bodies.rod.damping_time": 0.0}
    every = undamped | {f"{REDUCTION}.flexibility_tolerance": 0.0}
    complete = elastic("m4", 0.002, every).bodies["rod"]
    built = elastic("m4", 0.002, undamped, {"rod": with_few_patterns(complete, 0.1)})
    run = new_run(built)
    solve, solves = cavitation.SnesVi.solve, []

    def counted(snes, start):
        solves.append(start)
        return solve(snes, start)

    monkeypatch.setattr(cavitation.SnesVi, "solve", counted)
    peak, steps, attempts = 0.0, 0, 0
    for step in run.until(built.end):
        assert step.rejected.keys() <= {"error above tolerance"}
        peak = max(peak, step.solution.films[0].pressure.max())
        steps, attempts = steps + 1, attempts + 1 + sum(step.rejected.values())
    assert peak > 1e6
    # Only where full updates fail are others tried.
    assert attempts < len(solves) < 1.5 * steps
