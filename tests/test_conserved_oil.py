"""Films that keep account of their oil in the coupled steps of mechanisms.

Between smooth and rough surfaces, with oil that pressure makes denser as well.
"""

import re
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from csv_history import only_joint
from differences import slope
from film_cases import oval
from hand_made_rod import CLEARANCE, Joint, flexible, make_mechanism, with_residual
from lone_oil import LoneOil
from mechanism_cases import REVOLUTION, SPEED
from oil_cases import (
    CLOSED,
    ETA,
    RADIUS,
    heights,
    oil_film,
    oscillating,
    rigid_slider_crank,
    whirling,
    with_oil,
)
from oracle_mass_conserving import ClosedJournalFilm, RoughClosedJournalFilm, SqueezedJournal
from oracle_quasi_static import massless_coordinates
from rough_cases import surfaces
from scene_cases import tables_of
from stopped_steps import assert_goes_on
from test_coupled_steps import joined_matrix, mechanism_with, some_step

import fenics_ehd as ehd
from fenics_ehd.multibody import film_models
from fenics_ehd.multibody.bdf import NEWTON_FRACTION, IntegratorOptions
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.scenes.scene import scene_of

HOLE = ehd.HoleSupply(
    name="inlet", on="journal", angle=np.degrees(1.0), height=1e-3, diameter=0.0089, pressure=3e5
)
GROOVE = ehd.AxialGroove(np.radians(90), np.radians(18), 3e5)
DENSE = ehd.Lubricant(ETA, density_law=ehd.DowsonHigginson())

#: Oil so thin that surfaces touch.
THIN = ehd.Lubricant(2e-4)

#: Groups and first words of figures of films, and what those are made of.
SMOOTH = ("film", "conserved oil in the coupled step", {})
ROUGH = ("contact", "conserved oil between rough surfaces", {"oil": THIN, "surfaces": surfaces()})
COMPRESSIBLE = ("oil", "compressible oil", {"oil": DENSE})
BOTH = ("oil", "compressible oil, rough", {"oil": DENSE, "surfaces": surfaces(1e-6, 0.9)})


# --- Against solutions with free boundaries


@pytest.mark.slow
@pytest.mark.parametrize("whirl", [0.0, 125.0, 400.0])
def test_a_closed_journal_settles_to_the_free_boundary_solution(whirl, figure):
    assert_settles(ClosedJournalFilm(0.5, 0.8), whirl, None, figure, *SMOOTH[:2])


@pytest.mark.slow
@pytest.mark.parametrize("whirl", [0.0, 400.0])
def test_between_rough_surfaces_it_settles_to_that_of_these(whirl, figure):
    # Roughness a fifth of the clearance: H from 2.5 at the thinnest place on.
    ratio, rough = 0.2, surfaces(0.2e-6, 0.2)
    velocity = 0.5 - whirl / SPEED
    exact = RoughClosedJournalFilm(0.5, 0.8, ratio, 0.5 * ratio * rough.weight / velocity)
    assert abs(exact.largest_pressure / ClosedJournalFilm(0.5, 0.8).largest_pressure - 1) > 0.05
    assert_settles(exact, whirl, rough, figure, *ROUGH[:2])


def assert_settles(exact, whirl, surfaces, figure, group, words):
    """A closed journal on two meshes, its fluid fraction and largest pressure."""
    clearance = 1e-6
    reformation, rupture = exact.boundaries
    velocity = 0.5 - whirl / SPEED
    errors, turns = [], 3
    for cells in (16, 64):
        film = oil_film((cells, 1), clearance=clearance, sides=CLOSED, surfaces=surfaces)
        mechanism = whirling(film, 0.5, whirl, initial_filling=0.8)
        end = turns * REVOLUTION
        run = Run(mechanism, IntegratorOptions(tolerance=1e-3, order=2, largest=0.5 / cells), end)
        first, *_, last = run.until(end)
        (state,) = last.solution.films
        phi, every = heights(film)
        x = (phi - whirl * end - np.pi) * np.sign(velocity)
        x = np.mod(x - rupture, 2 * np.pi) + rupture - 2 * np.pi
        full = x >= reformation
        expected = np.where(full, 1.0, exact.carried(rupture) / exact.carried(x))
        pressure = abs(velocity) * exact.largest_pressure * film.parameters.pressure_scale
        errors.append(
            [
                np.mean(np.abs(state.fluid_fraction[::every] - expected)),
                abs(state.pressure.max() / pressure - 1),
            ]
        )
        assert 0.2 < full.mean() < 0.8
        (start,) = first.solution.films
        held, full = start.content.sum(), LoneOil(film).filled(start.gap).sum()
        assert held == pytest.approx(exact.filling * full, rel=1e-4 if surfaces else 1e-12)
        assert state.content.sum() == pytest.approx(held, rel=1e-12)
    rates = np.log2(np.divide(errors[0], errors[-1])) / 2
    assert rates.min() > 0.7
    name = f"{words}, closed journal whirling at {whirl:g} rad/s"
    figure(group, f"{name}, fluid fraction", errors[-1][0], most=0.01, unit="%")
    figure(group, f"{name}, observed order of it", rates[0], least=0.9)
    figure(group, f"{name}, largest pressure", errors[-1][1], most=0.02, unit="%")


def squeezed(cells, steps, order=2):
    """Largest error of the empty area over a squeeze and a half, relative, and at the last edge."""
    speed, amplitude, supply, clearance = 100.0, 0.4, 2e5, 1e-5
    lines = tuple(ehd.AxialGroove(angle, 0.0, supply) for angle in (np.pi / 2, -np.pi / 2))
    film = oil_film((cells, 1), clearance=clearance, sides=CLOSED, regions=lines)
    exact = SqueezedJournal(
        lambda t: amplitude * np.cos(speed * t),
        lambda t: -amplitude * speed * np.sin(speed * t),
        supply * (clearance / RADIUS) ** 2 / (12 * ETA),
    )
    end = 0.9 * 2 * np.pi / speed
    control = IntegratorOptions(tolerance=1e-3, order=order, largest=1 / steps, first=1e-6)
    phi, every = heights(film)
    half = np.abs(np.mod(phi + np.pi, 2 * np.pi) - np.pi) < np.pi / 2 - 1e-9
    times, voids, edges = [], [], []
    for step in Run(oscillating(film, amplitude, speed), control, end).until(end):
        share = 1 - step.solution.films[0].fluid_fraction[::every]
        gap = 1 - amplitude * np.cos(speed * step.time) * np.cos(phi)
        times.append(step.time)
        voids.append((share * gap)[half].sum() * 2 * np.pi / cells)
        edges.append((share[half] > 1e-3).sum() * np.pi / cells)
    chosen = np.linspace(0, len(times) - 1, 40).astype(int)
    edge, void = exact.edges(1e-5, np.array(times)[chosen])
    assert edge.max() > 1.2
    assert edge[-1] < 0.8
    late = np.array(times)[chosen] * speed > 0.5
    off = np.abs(np.array(edges)[chosen] - edge)[late].max()
    return np.abs(np.array(voids)[chosen] - void).max() / void.max(), off * cells / (2 * np.pi)


@pytest.mark.slow
def test_a_squeezed_journal_ruptures_and_reforms_in_time_as_its_free_boundary(figure):
    errors = np.array([squeezed(16, 32), squeezed(64, 128)])
    # The edge lies within a cell of where it should.
    assert errors[:, 1].max() < 1.0
    name = "conserved oil in the coupled step, squeezed journal, empty area"
    figure("film", name, errors[-1, 0], most=1e-3, unit="%")
    order = np.log2(errors[0, 0] / errors[-1, 0]) / 2
    figure("film", f"{name}, observed order", order, least=1.7)


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("made", "eccentricity", "filling", "end", "peak"),
    [
        ({}, 0.7, 0.6, 0.08, 1e5),
        ({"surfaces": surfaces(2e-6, 0.9)}, 0.7, 0.6, 0.08, 1e5),
        ({"oil": DENSE}, 0.8, 0.9, 0.1, 1e7),
    ],
    ids=["smooth", "rough", "compressible"],
)
def test_one_step_formulas_solve_what_a_film_alone_does(made, eccentricity, filling, end, peak):
    film, end = oil_film((24, 4), regions=(GROOVE,), **made), end * REVOLUTION
    mechanism = whirling(film, eccentricity, 150.0, initial_filling=filling)
    run = Run(mechanism, IntegratorOptions(tolerance=1e-5, order=1, largest=0.05), end)
    alone = LoneOil(film)
    (place,) = run.equations.system.films
    gap = place.film.gap(run.state.x[0, place.xi], run.state.rate[0, place.xi], SPEED)
    content, time, largest = alone.filled(gap, filling), 0.0, []
    # Full where there is a reservoir.
    reservoir = np.isin(np.arange(len(content)), alone.balance.unknown, invert=True)
    content = np.where(reservoir, alone.filled(gap), content)
    for step in run.until(end):
        (state,) = step.solution.films
        found = alone.solve(state.gap, content, step.time - time)
        content, time = found.content, step.time
        largest.append(found.pressure.max())
        np.testing.assert_allclose(state.pressure, found.pressure, atol=1e-5 * (largest[-1] + 1e3))
        np.testing.assert_allclose(state.fluid_fraction, found.fluid_fraction, atol=1e-6)
        np.testing.assert_allclose(state.content, content, atol=1e-6 * content.max())
    assert np.count_nonzero(np.array(largest) > peak) > 10
    assert state.fluid_fraction.min() < filling


# --- Time


def test_nodes_that_fill_are_no_matter_for_a_formula_of_order_3():
    film, orders = oil_film((12, 2)), []
    for oil in ({}, {"initial_filling": 1.0}):
        orders.append(
            Run(rigid_slider_crank(film, **oil), IntegratorOptions(order=3), 1e-3).control.order
        )
    assert orders == [3, 2]


@pytest.mark.slow
def test_order_in_time(figure):
    end = REVOLUTION

    def at_end(steps, order):
        film = oil_film((24, 1), clearance=1e-6, sides=CLOSED)
        control = IntegratorOptions(
            tolerance=1e-3, order=order, largest=1 / steps, first=end / steps
        )
        run = Run(whirling(film, 0.5, 125.0, initial_filling=0.8), control, end)
        *_, last = run.until(end)
        return last.solution.films[0].fluid_fraction

    reference = at_end(400, 2)
    for order, least in ((1, 0.7), (2, 1.6)):
        errors = [np.abs(at_end(n, order) - reference).mean() for n in (40, 160)]
        observed = np.log2(errors[0] / errors[-1]) / 2
        name = f"conserved oil in the coupled step, formula of order {order}, observed order"
        figure("film", name, observed, least=least)


# --- Balance


def flown(run, end, excess):
    """Times, contents, what flows out of the film, and all flows without their signs."""
    rows, system = [], run.equations.system
    for step in run.until(end):
        (state,) = step.solution.films
        rows.append(
            (step.time, state.content.sum(), state.outflow.sum(), np.abs(state.outflow).sum())
        )
        assert state.pressure.min() >= 0.0
        assert state.fluid_fraction.max() <= 1.0 + excess
        assert np.abs(np.minimum(state.pressure, 1 - state.fluid_fraction)).max() < 1e-4
    assert system.films
    return np.array(rows).T


@pytest.mark.kernels
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("kind", "cells", "filling", "end"),
    [
        (SMOOTH, (20, 3), 0.97, 0.5),
        (ROUGH, (20, 4), 0.9, 0.2),
        (COMPRESSIBLE, (20, 3), 0.97, 0.4),
        (BOTH, (20, 3), 0.97, 0.4),
    ],
    ids=["smooth", "rough", "compressible", "both"],
)
def test_a_closed_film_keeps_its_oil_whatever_the_formula(kind, cells, filling, end, order, figure):
    group, words, made = kind
    film = oil_film(cells, sides=CLOSED, **made)
    steps = IntegratorOptions(tolerance=3e-3, order=order)
    run = Run(rigid_slider_crank(film, initial_filling=filling), steps, REVOLUTION)
    excess = NEWTON_FRACTION * 3e-3 if made else 1e-6
    _, content, outflow, _ = flown(run, end * REVOLUTION, excess)
    assert not outflow.any()
    name = f"{words}, order {order}, change of a closed film's content"
    figure(group, name, np.abs(content / content[0] - 1).max(), most=1e-12)


@pytest.mark.parametrize(("kind", "end"), [(SMOOTH, 0.5), (ROUGH, 0.2)], ids=["smooth", "rough"])
def test_content_changes_by_the_summed_flow_with_a_one_step_formula(kind, end, figure):
    group, words, made = kind
    film = oil_film((20, 4), regions=(GROOVE,), **made)
    run = Run(
        rigid_slider_crank(film, initial_filling=1.0),
        IntegratorOptions(tolerance=1e-2, order=1),
        REVOLUTION,
    )
    excess = NEWTON_FRACTION * 1e-2 if made else 1e-6
    time, content, outflow, size = flown(run, end * REVOLUTION, excess)
    left = np.diff(time) * outflow[1:]
    defect = np.abs(np.diff(content) + left).max() / content[0]
    assert np.sum(np.diff(time) * size[1:]) > 0.1 * content[0]
    figure(group, f"{words}, oil lost in a step", defect, most=1e-13)


@pytest.mark.slow
def test_balance_of_ten_cycles_closes_at_the_order_of_the_formula(figure):
    film = oil_film((24, 4), regions=(GROOVE,))
    defects = []
    for largest in (0.02, 0.01):
        run = Run(
            rigid_slider_crank(film, initial_filling=1.0),
            IntegratorOptions(tolerance=1e-2, order=2, largest=largest / 10),
            10 * REVOLUTION,
        )
        tracker = Recorder(run, 10 * REVOLUTION)
        deque(tracker.steps(), maxlen=0)
        defects.append(only_joint(RunSummary(tracker).entries())["oil_balance_defect"])
    name = "conserved oil in the coupled step, balance over ten cycles"
    figure("film", name, defects[-1], most=1e-3, unit="%")
    assert defects[1] < 0.6 * defects[0]


def test_oil_that_holes_alone_let_in_is_in_the_balance():
    scene = ehd.read_scene(
        Path(__file__).parent / "golden/house/journal-starved.toml", **{"time.revolutions": 0.25}
    )
    machine = ehd.build(scene)
    found = ehd.simulate(machine.mechanism, **machine.options).figures["bearing"]
    assert abs(found["mean_hole.flow_m3_per_s"]) > 1e-7
    assert found["oil_balance_defect"] < 0.01


def test_energy_balances_at_the_order_of_the_formula():
    film = oil_film((24, 4), regions=(GROOVE,))
    errors = [
        ehd.simulate(
            rigid_slider_crank(film, ambient="oil"), 0.1 * REVOLUTION, tolerance=tolerance
        ).summary()["energy_balance_error"]
        for tolerance in (1e-3, 1e-6)
    ]
    assert errors[1] < 0.25 * errors[0]


@pytest.mark.kernels
@pytest.mark.parametrize("order", [1, 2])
def test_a_turning_oval_journal_keeps_account_of_its_oil(order):
    film = oil_film((24, 3), regions=(GROOVE,))
    mechanism = whirling(film, 0.5, 150.0, initial_filling=0.7)
    joint = replace(mechanism.joints["film"], journal_shape=oval(3e-6), bore_shape=oval(2e-6))
    mechanism = replace(mechanism, joints={**mechanism.joints, "film": joint})
    end = 0.3 * REVOLUTION
    run = Run(mechanism, IntegratorOptions(tolerance=1e-4, order=order, largest=0.05), end)
    oil = run.equations.films[0]
    (place,), left, content, time = run.equations.system.films, 0.0, None, 0.0
    for step in run.until(end):
        (state,) = step.solution.films
        # What the integration keeps is what the gap holds.
        filled = oil.balance.volume_scale * place.film.film.assembly.source(
            state.gap.thickness / place.film.clearance
        )
        held = filled * state.fluid_fraction
        np.testing.assert_allclose(state.content, held, atol=1e-6 * filled.max())
        content = state.content.sum() if content is None else content
        left += (step.time - time) * state.outflow.sum() if time else 0.0
        time = step.time
    assert abs(state.content.sum() - content) > 0.01 * content
    if order == 1:
        assert state.content.sum() + left == pytest.approx(content, rel=1e-12)


# --- Compared with Reynolds' condition


@pytest.mark.parametrize("residual", [False, True])
def test_a_film_that_is_full_is_that_of_reynolds(residual, figure):
    film = oil_film((12, 3), sides=ehd.Sides(3e8, 3e8))
    mechanism, runs = mechanism_with("bilinear", residual), []
    for case in (with_oil(mechanism, film), with_oil(mechanism, film)):
        if runs:
            joints = {
                n: replace(j, cavitation="reynolds") if isinstance(j, ehd.LubricatedJoint) else j
                for n, j in case.joints.items()
            }
            case = replace(case, joints=joints)
        runs.append(ehd.simulate(case, 0.02 * REVOLUTION, tolerance=1e-5, order=2))
    oil, reynolds = (run.columns for run in runs)
    assert len(oil["time_s"]) == len(reynolds["time_s"])
    difference = max(
        np.abs(oil[name] / reynolds[name] - 1).max()
        for name in ("time_s", "max_pressure_Pa", "min_film_thickness_m")
    )
    method = "residual patterns" if residual else "modes"
    name = f"conserved oil where the film is full against Reynolds' condition, {method}"
    # Newton's updates end at 1e-7 of the gap, and the next step's length follows from them.
    figure("film", name, difference, most=1e-5)


@pytest.mark.parametrize(
    ("made", "pressure"),
    [
        ({}, "max_pressure_Pa"),
        pytest.param(
            {"surfaces": surfaces(2e-6), "oil": ehd.Lubricant(0.1 * ETA)},
            "max_contact_pressure_Pa",
            marks=pytest.mark.slow,
        ),
    ],
    ids=["smooth", "rough"],
)
def test_residual_patterns_are_coordinates_without_mass(made, pressure):
    joint = Joint()
    joint.film = oil_film((12, 3), **made)
    body = with_residual(joint, flexible(joint)[0])
    found = [
        ehd.simulate(
            with_oil(make_mechanism(b, joint, 1e-3), initial_filling=0.95),
            0.04 * REVOLUTION,
            tolerance=1e-4,
        ).columns
        for b in (body, massless_coordinates(body))
    ]
    for name in (pressure, "min_film_thickness_m", "oil_content_m3"):
        last = [columns[name][-1] for columns in found]
        assert last[0] == pytest.approx(last[1], rel=2e-3)
    assert found[0][pressure][-1] > 1e5


# --- Compared with smooth surfaces


def test_without_roughness_the_film_is_that_of_smooth_surfaces(figure):
    def ends(rough):
        film = oil_film((20, 4), regions=(GROOVE,), surfaces=rough)
        steps = IntegratorOptions(tolerance=0.9, order=2, first=2e-5, largest=1 / 30)
        *_, last = Run(rigid_slider_crank(film, initial_filling=0.9), steps, 6e-4).until(6e-4)
        (state,) = last.solution.films
        return state.pressure / 1e6, state.fluid_fraction

    smooth = ends(None)
    errors = []
    for roughness in (0.8e-6, 0.4e-6, 0.2e-6):
        rough = ends(surfaces(roughness, 0.9))
        errors.append(max(np.abs(r - s).max() for r, s in zip(rough, smooth, strict=True)))
    group, words, _ = ROUGH
    figure(group, f"{words}, 0.2 um against smooth ones", errors[-1], most=1e-3)
    assert errors[0] > 4 * errors[1] > 16 * errors[2]


#: Until surfaces touch.
END = 1.7e-3


def touched(tolerance):
    film = oil_film((16, 3), oil=THIN, sides=ehd.Sides(1e5, 1e5), surfaces=surfaces())
    return ehd.simulate(rigid_slider_crank(film, initial_filling=1.0), END, tolerance=tolerance)


@pytest.mark.kernels
def test_a_run_goes_on_where_surfaces_touch():
    # Where smooth ones end it: `test_contact.py`.
    result = touched(1e-3)
    assert result.time[-1] == pytest.approx(END)
    assert result.columns["contact_share"].max() > 0.3
    assert result.summary()["newton_iterations"] < 3.0 * len(result.time)


@pytest.mark.slow
def test_energy_is_balanced_in_contact(figure):
    defects = []
    for tolerance in (1e-4, 3e-7):
        columns = touched(tolerance).columns
        defects.append(np.abs(columns["energy_defect_J"]).max() / columns["film_work_J"][-1])
    group, words, _ = ROUGH
    figure(group, f"{words}, energy balance over what is dissipated, 3e-7", defects[1], most=1e-3)
    assert defects[1] < 0.3 * defects[0]


# --- Derivatives


#: Films by what they are made of, on how many cells, and whether there is oil outside. So rough and
#: stiff that contact is everywhere, and as strong as the film.
STIFF = {"surfaces": surfaces(CLEARANCE / 2, modulus=1e13), "regions": (GROOVE,)}
STIFF_JOURNAL = STIFF | {"surfaces": surfaces(CLEARANCE / 2, 0.9, modulus=1e13)}
THICK = {"oil": ehd.Lubricant(ETA, ehd.Barus(1e-8), ehd.DowsonHigginson()), "regions": (GROOVE,)}
DERIVATIVES = {
    "groove": ({"regions": (GROOVE,)}, (16, 4), True),
    "hole": ({"feeds": (HOLE,)}, (16, 4), True),
    "rough": (STIFF, (12, 3), False),
    "rough journal": (STIFF_JOURNAL, (12, 3), False),
    "rough, lobed journal": (STIFF_JOURNAL, (12, 3), True),
    "compressible": (THICK, (12, 3), False),
    "compressible, rough": (THICK | {"surfaces": surfaces(CLEARANCE / 2, 0.9)}, (12, 3), False),
}


@pytest.mark.kernels
@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("kind", DERIVATIVES)
def test_derivatives_equal_central_differences(kind, residual, monkeypatch):
    """Along all unknowns, at a point in the middle of motion."""
    made, cells, outside = DERIVATIVES[kind]
    mechanism = mechanism_with("bilinear", residual)
    mechanism = with_oil(mechanism, oil_film(cells, **made), ambient="oil" if outside else "air")
    if "lobed" in kind:
        ((name, joint),) = ((n, j) for n, j in mechanism.joints.items() if hasattr(j, "film"))
        joint = replace(joint, journal_shape=oval(3e-6, 0.3))
        mechanism = replace(mechanism, joints={**mechanism.joints, name: joint})
    point = assert_oil_derivatives(mechanism, monkeypatch)
    if kind.startswith("rough"):
        assert point.films[0].contact.pressure.max() > 1e6


def assert_oil_derivatives(mechanism, monkeypatch):
    """Balance and motion along all unknowns at some point, which is returned."""
    equations = StepEquations(System(mechanism))
    equations.retain_patterns(100)
    m, n = len(equations.films[0].nodes), equations.system.n
    size = equations.films[0].balance.assembly.size
    begin, former = equations.begin, 1e-9 * np.random.default_rng(1).uniform(-1, 1, size)
    monkeypatch.setattr(
        equations, "begin", lambda s: begin(replace(s, past_x=np.append(s.past_x, former)))
    )
    start, sizes, rng = some_step(equations)
    void, sizes_of_void = rng.uniform(0, 0.5, m), np.full(m, 0.1)
    point = equations.evaluate(unknowns(start, void))
    derivative = equations.linearise(point)
    joined, (matrix,) = joined_matrix(equations, derivative), derivative.films

    def defect(h):
        found = equations.evaluate(unknowns(start + h * direction, void + h * of_void))
        return np.concatenate([found.films[0].balance, found.rest])

    rest = len(start) - m
    for part in (slice(0, m), slice(m, m + n), slice(m + n, None), None):
        direction, of_void = sizes * rng.uniform(-1, 1, len(start)), np.zeros(m)
        if part is None:
            direction, of_void = 0 * direction, sizes_of_void * rng.uniform(-1, 1, m)
        else:
            direction[np.setdiff1d(np.arange(len(start)), np.arange(len(start))[part])] = 0.0
        found, expected = joined @ direction, slope(defect, step=1e-3)
        found[:m] -= matrix.pattern.multiply(matrix.weights, of_void)
        size = np.abs(expected)
        size[m:] += np.abs(derivative.core[:rest, :rest]) @ sizes[m:]
        size[:m] = np.abs(point.films[0].balance).max()
        assert np.all(np.abs(found - expected) <= 1e-6 * size)
    return point


def unknowns(values, void):
    """All unknowns from those of pressures and motion, and void fractions."""
    return np.insert(values, len(void), void)


# --- Runs


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("oil", "filling"), [(None, 0.9), (DENSE, 1.0)], ids=["constant", "compressible"]
)
def test_a_run_goes_on_to_the_last_bit(oil, filling):
    mechanism = rigid_slider_crank(
        oil_film((16, 3), regions=(GROOVE,), oil=oil), initial_filling=filling
    )
    assert_goes_on(mechanism, IntegratorOptions(tolerance=1e-3), 0.05 * REVOLUTION)


@pytest.mark.slow
def test_a_periodic_film_repeats_its_oil(figure):
    film = oil_film((16, 3), regions=(GROOVE,))
    result = ehd.simulate(
        rigid_slider_crank(film, initial_filling=1.0),
        period=REVOLUTION,
        periodicity=2e-3,
        tolerance=1e-2,
    )
    assert result.cycles > 2
    supplied, lost = mean_flows(result)
    name = "conserved oil, side flow of a periodic film against its supply"
    figure("film", name, abs(lost / supplied - 1), most=0.02, unit="%")


def mean_flows(result):
    """Supply and side flow over a cycle, by the trapezoidal rule [m3]."""
    widths = np.diff(result.time, prepend=0.0)
    widths = 0.5 * (widths + np.roll(widths, -1))
    columns = "supply_flow_m3_per_s", "side_flow_m3_per_s"
    return [widths @ result.columns[name] for name in columns]


@pytest.mark.kernels
def test_fluid_fractions_far_below_zero_are_no_step(monkeypatch):
    monkeypatch.setattr(film_models, "UNDERSHOOT", -0.5)
    film = oil_film((12, 2))
    with pytest.raises(
        ehd.errors.StepSizeError, match=r"the fluid fraction of a node is .*, below the limit"
    ):
        ehd.simulate(rigid_slider_crank(film, initial_filling=0.3), REVOLUTION, tolerance=1e-2)


def test_nothing_of_it_is_computed_without_it(monkeypatch):
    monkeypatch.setattr(film_models.MassConservingFilm, "__init__", None)
    film = oil_film((12, 2))
    run = Run(rigid_slider_crank(film), IntegratorOptions(tolerance=1e-2), 0.01 * REVOLUTION)
    *_, last = run.until(0.01 * REVOLUTION)
    assert len(last.x) == run.equations.system.n
    tracker = Recorder(run, 0.01 * REVOLUTION)
    assert not any("oil" in name or "flow" in name for name in tracker.add(last))
    assert not any("fluid_fraction" in path for path in tracker.rows[-1])


def test_films_that_cannot_conserve_oil_are_refused():
    quadratic = whirling(oil_film((12, 3), family="lagrange"), 0.5, 150.0)
    with pytest.raises(ehd.errors.SettingsError, match="needs element = 'bilinear'"):
        ehd.simulate(quadratic, 1e-3)
    for wrong, message in (
        ({"initial_filling": 1.2}, r"initial_filling = 1\.2"),
        ({"ambient": "water"}, "ambient = 'water' must be one of air, oil"),
        ({"cavitation": "gumbel"}, "cavitation = 'gumbel' must be one of reynolds, mass-con"),
    ):
        with pytest.raises(ehd.errors.SettingsError, match=message):
            ehd.LubricatedJoint("a", "b", oil_film((12, 3)), **wrong)


# --- Scenes


def starved(**changes):
    """The shipped starved scene on a coarse film."""
    coarse = {"joints.bearing.cells": [30, 4], "time.tolerance": 5e-3}
    return scene_of(tables_of("loaded-journal-starved", coarse | changes), "starved")


@pytest.mark.slow
def test_a_starved_bearing_has_less_film_than_one_that_reynolds_fills(figure):
    found = []
    for changes in ({}, {"cavitation": "reynolds", "initial_filling": 1.0}):
        joint = {f"joints.bearing.{key}": value for key, value in changes.items()}
        built = ehd.build(starved(**joint))
        steps = vars(built.steps)
        found.append(ehd.simulate(built.mechanism, period=built.period, periodicity=5e-3, **steps))
    oil, reynolds = found
    content = oil.columns["oil_content_m3"]
    assert content.max() < 0.8 * 25e-6 * 2 * np.pi * 0.025 * 0.02
    assert (
        oil.columns["min_film_thickness_m"].min() < reynolds.columns["min_film_thickness_m"].min()
    )
    assert oil.columns["side_flow_m3_per_s"].min() >= 0.0
    name = "starved loaded journal, balance of a cycle's oil"
    supplied, lost = mean_flows(oil)
    figure("film", name, abs(lost / supplied - 1), most=0.02, unit="%")


@pytest.mark.slow
def test_a_slider_crank_on_40_cells_has_the_film_of_80(figure):
    oil = {"element": "bilinear", "cavitation": "mass-conserving", "ambient_pressure": 1e5}
    changes = {f"joints.big_end.{key}": value for key, value in oil.items()}
    tables = tables_of("slider-crank", changes | {"time.tolerance": 1e-3})
    built = ehd.build(scene_of(tables, "oil"))
    run = Run(built.mechanism, built.steps, built.period)
    for _ in run.until(2 * built.period):
        pass
    steps = list(run.until(3 * built.period))
    pressure = max(step.solution.films[0].pressure.max() for step in steps)
    thickness = min(run.norm.film_gaps(step.observed)[0].min() for step in steps)
    # 80 x 10 cells at a tolerance of 1e-4; with first-order upwinding 81 MPa and 1.79 um on 40.
    name = "conserved oil, slider-crank with M4 on 40 cells against 80, third cycle"
    figure("film", f"{name}, largest pressure", abs(pressure / 55.3e6 - 1), most=0.03, unit="%")
    figure("film", f"{name}, minimum film", abs(thickness / 2.131e-6 - 1), most=0.01, unit="%")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"element": "lagrange"}, "joints.bearing.element = 'lagrange' cannot conserve mass"),
        ({"initial_filling": 1.1}, "joints.bearing.initial_filling = 1.1 must be at most 1"),
        ({"cavitation": "elrod"}, "joints.bearing.cavitation = 'elrod'"),
        (
            {"cavitation": "reynolds"},
            "has no effect without joints.bearing.cavitation = 'mass-conserving'",
        ),
    ],
)
def test_scenes_that_cannot_conserve_oil_are_refused(changes, words):
    joint = {f"joints.bearing.{key}": value for key, value in changes.items()}
    with pytest.raises(ehd.errors.SettingsError, match=re.escape(words)):
        starved(**joint)


def test_a_massless_journal_needs_a_full_film_at_the_start():
    body = {"bodies.journal.kind": "massless", "bodies.journal.mass": None}
    with pytest.raises(ehd.errors.SettingsError, match="no force holds the massless body journal"):
        starved(**body, **{"bodies.journal.inertia": None})
