"""The reduced bodies of all methods in the slider-crank."""

from dataclasses import replace
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from fenics_ehd.errors import InputError, SettingsError, StepSizeError
from fenics_ehd.multibody.neglected_inertia import neglected_inertia
from fenics_ehd.reduction import (
    craig_bampton,
    full_interface,
    load_dependent,
    residual_flexibility,
    rigid,
    two_step_craig_bampton,
)
from fenics_ehd.reduction.craig_bampton import centre_constraints
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.projection import Basis, gram_matrices, project
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.scenes import transient
from fenics_ehd.scenes.rod import reduce_rod, reduce_structure
from fenics_ehd.scenes.run import Totals, simulate, step_control
from fenics_ehd.scenes.slider_crank_settings import Reduction, SliderCrankSettings
from fenics_ehd.settings import build

#: The first film build-up from no pressure at all is compared from here on [s].
START = 2e-4


def run(body, revolutions=0.03, tolerance=1e-5):
    """Curves (time, peak pressure, minimum film, ...) of a run, and its totals."""
    settings = SliderCrankSettings()
    settings = attrs.evolve(
        settings,
        time=attrs.evolve(settings.time, tolerance=tolerance),
        mechanism=attrs.evolve(settings.mechanism, revolutions=revolutions),
    )
    rows = []
    totals = simulate(settings, body, Totals(), lambda row, _: rows.append(list(row.values())))
    return np.array(rows).T, totals


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
    return residual_flexibility(rod_structure, 6, truncation=1e-2)


def moved_to_the_bore(structure, body):
    """The same columns with the mean motion of the bore taken out: another frame."""
    fields = rigid_fields(structure.coordinates)
    centre = centre_constraints(structure)
    columns = body.columns - fields @ (centre.T @ body.columns)
    assert np.abs(centre.T @ columns).max() < 1e-10
    mass = MassOperator(structure.mass)
    basis = Basis(columns, *gram_matrices(structure, mass, columns), body.kinds, (), {})
    return project(structure, mass, basis, method="m3", frame="bore-centre")


def test_frame_does_not_change_the_physics(rod_structure):
    body = load_dependent(rod_structure, 6, 12, estimate_error=False, keep_basis=True)
    curves = [run(b, 0.05)[0] for b in (body, moved_to_the_bore(rod_structure, body))]
    # Not round-off: the gap is to leading order in displacements, and the bore's elastic rotation
    # of 1e-4 shifts h along the circumference in one frame, where the other turns with it.
    assert max(difference(curves[1], curves[0])) < 5e-4


def test_bodies_without_residual_flexibility_neglect_no_inertia(rod_body):
    assert neglected_inertia(rod_body).shape == (0, 0)


def test_neglected_inertia_is_that_of_the_patterns(rod_structure, residual_body):
    """``S_res``'s own second-order term ``G_res M G_res J``, for a smooth pressure."""
    from fenics_ehd.reduction.distributed import load_columns, node_rows
    from fenics_ehd.reduction.static import StaticSolver

    whole = residual_flexibility(rod_structure, 6, truncation=0.0, keep_basis=True)
    x, y, _ = whole.pressure_nodes.T
    pressure = 1.0 + np.cos(3 * np.arctan2(y, x))
    static = StaticSolver(rod_structure)
    modes, angular = whole.columns, np.sqrt(np.diag(whole.stiffness))[:, None]

    def rest(loads):
        return static.apply(loads) - modes @ (modes.T @ loads / angular**2)

    first = rest(load_columns(rod_structure.bore.load, pressure[:, None]))
    exact = rest(static.mass.multiply(first))
    rows = node_rows(exact, 0, rod_structure.bore.nodes, rod_structure.comm)[:, :, 0]
    radial = whole.bore_nodes[:, :2] / np.linalg.norm(whole.bore_nodes[:, :2], axis=1)[:, None]
    expected = np.einsum("ic,ic->i", radial, rows[:, :2])
    amplitudes = whole.residual.patterns @ pressure
    estimate = neglected_inertia(whole) @ amplitudes
    # The estimate answers with the patterns alone, the exact term with the static modes too.
    assert np.abs(estimate - expected).max() < 0.05 * np.abs(expected).max()


@pytest.mark.slow
def test_every_method_runs(rod_structure, residual_body):
    bodies = [
        craig_bampton(rod_structure, 10),
        two_step_craig_bampton(rod_structure, 10, 5, estimate_error=False),
        residual_body,
    ]
    for body in bodies:
        _, totals = run(body)
        assert totals.energy_error < 1e-3
        estimated = np.isfinite(totals.basis_error) and totals.basis_error > 0
        assert estimated == bool(body.missing_flexibility.size)


def test_settings_name_every_method(rod_structure):
    for method, frame in (("m1", "bore-centre"), ("rigid", "mean-axis")):
        body = reduce_structure(rod_structure, Reduction(method=method, estimate_error=False))
        assert (body.method, body.frame) == (method, frame)
    few = Reduction(
        method="m3", residual_modes=3, pressure_set="pc2-long", selection="largest-eigenvalue"
    )
    assert reduce_structure(rod_structure, few).modes == 6 + 2 + 3


def test_snapshots_of_a_run_are_a_pressure_set(rod_structure, tmp_path):
    from fenics_ehd.history_file import HistoryWriter
    from fenics_ehd.results import bore_constants

    settings = SliderCrankSettings()
    settings = attrs.evolve(settings, mechanism=attrs.evolve(settings.mechanism, revolutions=0.02))
    body = load_dependent(rod_structure, 6, 8, estimate_error=False)
    with HistoryWriter(tmp_path, bore_constants(body)) as history:
        simulate(settings, body, Totals(), history.add)
    reduction = Reduction(snapshots=str(tmp_path), selection="proper-orthogonal", residual_modes=5)
    again = reduce_structure(rod_structure, reduction)
    assert again.modes == 6 + 2 + 5
    with pytest.raises(InputError, match=r"no: no such folder"):
        reduce_structure(rod_structure, attrs.evolve(reduction, snapshots=str(tmp_path / "no")))
    other = attrs.evolve(
        SliderCrankSettings(),
        reduction=reduction,
        film=attrs.evolve(SliderCrankSettings().film, element="serendipity"),
    )
    with pytest.raises(SettingsError, match="440 pressure nodes are not the 340"):
        reduce_rod(other)


@pytest.mark.slow
def test_residual_flexibility_is_the_full_interface(rod_structure):
    """DESIGN: 0.073 % and 0.0014 % with 9 modes, against every residual mode."""
    full = full_interface(rod_structure)
    body = residual_flexibility(rod_structure, 6)
    assert body.modes == 9
    # Steps so short that curves have no kinks to hide between them.
    reference, _ = run(full, 0.3, 1e-6)
    curves, totals = run(body, 0.3, 1e-6)
    pressure, film = difference(curves, reference)
    assert pressure < 1e-3
    assert film < 2e-4
    # The estimate, of neglected inertia, is not far from the truth.
    assert 0.3 < totals.basis_error / (film * reference[2].min()) < 5
    truncated, _ = run(replace(body, residual=None, missing_flexibility=np.zeros((0, 0))), 0.3)
    assert max(difference(truncated, reference)) > 0.1


@pytest.mark.parametrize(("patterns", "advised"), [(6, True), (200, False)])
def test_few_residual_patterns_are_named_where_no_step_is_short_enough(
    patterns, advised, monkeypatch
):
    def give_up(*_):
        raise StepSizeError("the step fell to 1e-13 s")

    monkeypatch.setattr(transient, "advance", give_up)
    journal = SimpleNamespace(compliance=SimpleNamespace(patterns=np.zeros((patterns, 3))))
    machine = SimpleNamespace(journal=journal, tables=())
    with pytest.raises(StepSizeError, match=r"^the step fell to 1e-13 s") as caught:
        transient._advanced(machine, None, 1.0, None, None)
    assert ("lower reduction.residual_truncation" in str(caught.value)) is advised


@pytest.mark.parametrize(
    ("damping_time", "order", "taken"), [(1e-4, 3, 3), (1e-6, 3, 2), (0.0, 3, 2), (0.0, 1, 1)]
)
def test_a_formula_that_feeds_undamped_modes_is_not_taken(
    rod_structure, damping_time, order, taken
):
    body = load_dependent(rod_structure, 6, 4, estimate_error=False)
    settings = build(
        SliderCrankSettings, {"rod": {"damping_time": damping_time}, "time": {"order": order}}
    )
    assert step_control(settings, 1e-3, body).order == taken


def test_a_rigid_rod_has_no_modes_to_feed(rod_structure):
    settings = build(SliderCrankSettings, {"rod": {"damping_time": 0.0}})
    assert step_control(settings, 1e-3, rigid(rod_structure, estimate_error=False)).order == 3
