"""The reduced bodies of all methods in the slider-crank."""

from dataclasses import replace

import attrs
import numpy as np
import pytest
from mechanism_cases import REVOLUTION, flexible_slider_crank
from scipy.interpolate import PchipInterpolator
from snapshot_cases import reduce_by

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.elastic_bore import neglected_inertia
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.reduction.bore import rigid_fields
from fenics_ehd.reduction.fixed_interface_modes import centre_constraints, two_step_craig_bampton
from fenics_ehd.reduction.reductor import Basis, bore_rows, gram_matrices, rigid
from fenics_ehd.scenes.part import reduce_structure
from fenics_ehd.scenes.part_settings import ReductionSettings

#: The first film build-up from no pressure at all is compared from here on [s].
START = 2e-4


def run(body, revolutions=0.03, tolerance=1e-5):
    """Curves (time, peak pressure, minimum film) of a run, and the run."""
    end = revolutions * REVOLUTION
    mechanism = flexible_slider_crank(body)
    result = ehd.simulate(mechanism, end, tolerance=tolerance, largest=0.02 / revolutions)
    joint = result.joints["big_end"]
    return np.array([result.time, joint.max_pressure, joint.min_film_thickness]), result


def difference(curves, reference, start=START):
    """Largest differences of peak pressure (over its peak) and minimum film (pointwise)."""
    times = np.linspace(start, reference[0][-1], 500)
    (p, h), (p0, h0) = (
        (PchipInterpolator(c[0], c[1])(times), PchipInterpolator(c[0], c[2])(times))
        for c in (curves, reference)
    )
    return np.abs(p - p0).max() / p0.max(), np.abs(h / h0 - 1).max()


@pytest.fixture(scope="module")
def residual_body(rod_structure):
    return ehd.residual_flexibility(rod_structure, 6, truncation=1e-2)


def moved_to_the_bore(structure, body):
    """The same columns with the mean motion of the bore taken out: another frame."""
    fields = rigid_fields(structure.coordinates)
    centre = centre_constraints(structure)
    columns = body.columns - fields @ (centre.T @ body.columns)
    assert np.abs(centre.T @ columns).max() < 1e-10
    reductor = ehd.Reductor(structure)
    basis = Basis(columns, *gram_matrices(reductor, columns), body.kinds, (), {})
    return reductor.project(basis, "m3", frame="bore-centre", estimate_error=False)


def test_frame_does_not_change_the_physics(rod_structure):
    body = ehd.load_dependent(rod_structure, 6, 12, estimate_error=False, keep_basis=True)
    curves = [run(b, 0.05)[0] for b in (body, moved_to_the_bore(rod_structure, body))]
    # Not round-off: the gap is to leading order in displacements, and the bore's elastic rotation
    # of 1e-4 shifts h along the circumference in one frame, where the other turns with it.
    assert max(difference(curves[1], curves[0])) < 5e-4


@pytest.mark.slow
def test_neglected_inertia_is_that_of_the_patterns(rod_structure, residual_body):
    """``S_res``'s own second-order term ``G_res M G_res J``, for a smooth pressure."""
    from fenics_ehd.reduction.matrices import load_columns
    from fenics_ehd.reduction.static import StaticSolver

    whole = ehd.residual_flexibility(rod_structure, 6, tolerance=0.0, keep_basis=True)
    x, y, _ = whole.pressure_nodes.T
    pressure = 1.0 + np.cos(3 * np.arctan2(y, x))
    static = StaticSolver(rod_structure)
    modes, angular = whole.columns, np.sqrt(np.diag(whole.stiffness))[:, None]

    def rest(loads):
        return static.apply(loads) - modes @ (modes.T @ loads / angular**2)

    first = rest(load_columns(rod_structure.bore.load, pressure[:, None]))
    exact = rest(static.mass.multiply(first))
    rows = bore_rows(rod_structure, exact)[:, :, 0]
    radial = whole.bore_nodes[:, :2] / np.linalg.norm(whole.bore_nodes[:, :2], axis=1)[:, None]
    expected = np.einsum("ic,ic->i", radial, rows[:, :2])
    amplitudes = whole.residual.patterns @ pressure
    estimate = neglected_inertia(whole, whole.residual) @ amplitudes
    # The estimate answers with the patterns alone, the exact term with the static modes too.
    assert np.abs(estimate - expected).max() < 0.05 * np.abs(expected).max()


@pytest.mark.slow
def test_every_method_runs(rod_structure, rod_body, residual_body):
    bodies = {
        "m1": ehd.craig_bampton(rod_structure, 10),
        "m2": two_step_craig_bampton(rod_structure, 10, 5, estimate_error=False),
        "m3": rod_body,
        "m4": residual_body,
        "rigid": rigid(rod_structure, estimate_error=True),
    }
    curves = {}
    for method, body in bodies.items():
        curves[method], result = run(body)
        assert result.summary()["energy_balance_error"] < 1e-3
        estimate = result.columns["basis_error_estimate_m"].max()
        # M4 has the verified error of its displacements in place of a missing flexibility.
        estimated = method == "m4" or bool(body.missing_flexibility.size)
        assert (np.isfinite(estimate) and estimate > 0) == estimated
    # Of M4, which is the full interface, as the test below has it.
    errors = {name: difference(curves[name], curves["m4"], 5e-5)[0] for name in curves}
    assert errors["m3"] < 1e-3
    assert errors["m3"] < errors["m2"] < errors["m1"] < errors["rigid"]


def recorded(mechanism, end, folder):
    """Leave the history of a run; its pressures on the nodes of the bore, shape (k, steps)."""
    history = ehd.simulate(mechanism, end)
    history.save(folder)
    bore = System(mechanism).films[0].film.surfaces[0].maps
    pressures = history.pressures["big_end"]
    return np.column_stack([bore.structure_pressure(p) for p in pressures])


@pytest.mark.slow
def test_snapshots_of_a_run_are_a_pressure_set(rod_structure, tmp_path):
    body = ehd.load_dependent(rod_structure, 6, 8, estimate_error=False)
    mechanism = flexible_slider_crank(body)
    pressures = recorded(mechanism, 0.02 * REVOLUTION, tmp_path / "run")
    reduction = ReductionSettings(
        method="m3", snapshots=str(tmp_path / "run"), residual_modes=5, estimate_error=False,
    )  # fmt: skip
    again = reduce_structure(rod_structure, reduction)
    assert again.modes == 6 + 2 + 5
    given = reduce_by(rod_structure, 6, 5, pressures, "proper-orthogonal", estimate_error=False)
    assert again.accuracy["static_added"] == 0
    flexibility = again.basis_flexibility(), given.basis_flexibility()
    np.testing.assert_allclose(*flexibility, atol=1e-9 * np.abs(flexibility[0]).max())
    with pytest.raises(ehd.errors.InputError, match=r"no: no such folder"):
        reduce_structure(rod_structure, attrs.evolve(reduction, snapshots=str(tmp_path / "no")))
    joint = mechanism.joints["big_end"]
    cells = ehd.uniform_grid(body.bore.radius, body.bore.width, (12, 3))
    other = ehd.Film(replace(joint.film.parameters, grid=cells))
    joints = {**mechanism.joints, "big_end": replace(joint, film=other)}
    recorded(replace(mechanism, joints=joints), 1e-7, tmp_path / "other")
    with pytest.raises(ehd.errors.SettingsError, match="168 film nodes of that run are not"):
        reduce_structure(rod_structure, attrs.evolve(reduction, snapshots=str(tmp_path / "other")))


@pytest.mark.slow
def test_residual_flexibility_is_the_full_interface(rod_structure):
    """DESIGN: 0.073 % and 0.0014 % with 9 modes, against every residual mode."""
    full = ehd.full_interface(rod_structure)
    body = ehd.residual_flexibility(rod_structure, 6, tolerance=0.0)
    assert body.modes == 9
    reference, _ = run(full, 0.3, 1e-6)
    times, expected_pressure, expected_film = reference[:, reference[0] > START]
    # At the very steps of the other run: curves have kinks, which may hide between steps.
    going = Run(flexible_slider_crank(body), IntegratorOptions(tolerance=1e-6), 0.3 * REVOLUTION)
    tracker, rows = Recorder(going, 0.3 * REVOLUTION), []
    for time in times:
        for step in going.until(time):
            row = tracker.add(step)
        rows.append(row)
    found, film_thickness, estimates = (
        np.array([row[name] for row in rows])
        for name in (
            "big_end.max_pressure_Pa",
            "big_end.min_film_thickness_m",
            "big_end.basis_error_estimate_m",
        )
    )
    pressure = np.abs(found - expected_pressure).max() / expected_pressure.max()
    film = np.abs(film_thickness / expected_film - 1).max()
    assert pressure < 2e-4
    assert film < 2e-4
    # The estimate, of neglected inertia, is not far from the truth.
    assert 0.3 < estimates.max() / (film * expected_film.min()) < 5
    truncated, _ = run(replace(body, residual=None, missing_flexibility=np.zeros((0, 0))), 0.3)
    assert max(difference(truncated, reference)) > 0.1


def test_a_formula_that_feeds_undamped_modes_is_not_taken(rod_structure):
    body = ehd.load_dependent(rod_structure, 6, 4, estimate_error=False)
    for damping_time, order, taken in ((1e-4, 3, 3), (1e-6, 3, 2), (0.0, 3, 2), (0.0, 1, 1)):
        assert order_taken(body, damping_time, order) == taken, damping_time
    # A rigid rod has no modes to feed.
    assert order_taken(rigid(rod_structure, estimate_error=False), 0.0, 3) == 3


def order_taken(body, damping_time, order):
    mechanism = flexible_slider_crank(body)
    rod = attrs.evolve(mechanism.bodies["rod"], damping_time=damping_time)
    mechanism = replace(mechanism, bodies={**mechanism.bodies, "rod": rod})
    return Run(mechanism, IntegratorOptions(order=order), 1e-3).control.order
