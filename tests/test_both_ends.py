"""A flexible rod lubricated at both of its ends: what one film presses moves the other's bore."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from mechanism_cases import CRANK, REVOLUTION, SPEED, recorded, slider_crank
from mpi4py import MPI
from oil_cases import conserved
from test_several_bores import COARSE

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.static_correction import PatternResponses
from fenics_ehd.multibody.trust import surface_loads
from fenics_ehd.plotting.animated_bodies import shape_of_bores
from fenics_ehd.reduction.fixed_interface_modes import two_step_craig_bampton
from fenics_ehd.results.motion import RecordedMotion

END = 0.1 * REVOLUTION
JOINTS = ("big_end", "gudgeon")


def part(bores):
    geometry = COARSE | {"bore_cells_along": 2}
    mesh = ehd.build_mesh(ehd.model_path("conrod"), geometry, comm=MPI.COMM_SELF, bores=bores)
    return ehd.Reductor(ehd.assemble_structure(mesh, ehd.Material(210e9, 0.3, 7850.0), bores=bores))


@cache
def rod():
    return part(("bore", "pin"))


METHODS = {
    "full": lambda rod: ehd.full_interface(rod, 10),
    "m4": lambda rod: ehd.residual_flexibility(rod, 6),
    "m3": lambda rod: ehd.load_dependent(rod, 6, 60),
    "m2": lambda rod: two_step_craig_bampton(rod, 120),
}


@cache
def body_of(method):
    """Of the rod with both bores."""
    return METHODS[method](rod())


def film(grid, clearance):
    return ehd.Film(ehd.FilmParameters(grid, clearance, ehd.Lubricant(0.01), rate=SPEED))


def machine(body, gudgeon=True, pin_cells=None):
    bores = body.bores
    own = [ehd.film_grid(bore.pressure_coordinates) for bore in bores.values()]
    if pin_cells:
        own[1] = ehd.uniform_grid(bores["pin"].radius, bores["pin"].width, pin_cells, "lagrange")
    flexible = ehd.FlexibleBody(body, 1e-3, position=(CRANK, 0.0))
    return slider_crank(flexible, film(own[0], 17e-6), film(own[1], 12e-6) if gudgeon else None)


@cache
def result_of(method):
    return ehd.simulate(machine(body_of(method)), END, tolerance=1e-5)


def apart(one, other, start=2e-4):
    """Largest differences of two runs, of pressures over the peak, and of films."""
    late = one.time > start
    found = {}
    for joint in one.joints:
        a, b = one.joints[joint], other.joints[joint]
        pressure, thickness = (
            np.interp(one.time[late], other.time, getattr(b, name))
            for name in ("max_pressure", "min_film_thickness")
        )
        peak = b.max_pressure.max()
        found[f"{joint} pressure"] = np.abs(a.max_pressure[late] - pressure).max() / peak
        found[f"{joint} film"] = np.abs(a.min_film_thickness[late] / thickness - 1).max()
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("method", "limit"), [("m4", 5e-4), ("m3", 5e-3), ("m2", 0.05)])
def test_methods_agree_on_both_films(method, limit):
    found = apart(result_of("full"), result_of(method))
    assert len(found) == 4
    assert max(found.values()) < limit, found


@pytest.mark.parametrize(
    "method", ["m4", "m3", *(pytest.param(m, marks=pytest.mark.slow) for m in ("m2", "full"))]
)
def test_energy_is_balanced_and_newtons_method_converges_fast(method):
    result = result_of(method)
    assert result.summary()["energy_balance_error"] < 1e-3
    # Half an iteration more a step than with the coupling in the films' own matrices.
    assert result.summary()["newton_iterations"] / len(result.time) < 3.5


@pytest.mark.slow
def test_films_of_both_ends_keep_account_of_their_oil():
    """M4's patterns couple the bores; also if one film has Reynolds' condition."""
    found = {}
    for name in ("full", "m4"):
        mechanism = machine(body_of(name))
        for joint in JOINTS:
            coarse = mechanism.joints[joint].film.parameters
            film = ehd.Film(replace(coarse, grid=replace(coarse.grid, family="bilinear")))
            changed = replace(mechanism.joints[joint], film=film, **conserved(initial_filling=0.95))
            mechanism = replace(mechanism, joints={**mechanism.joints, joint: changed})
        found[name] = ehd.simulate(mechanism, END, tolerance=1e-4)
        joints = {
            **mechanism.joints,
            "gudgeon": replace(mechanism.joints["gudgeon"], cavitation="reynolds"),
        }
        found[f"{name}, one"] = ehd.simulate(replace(mechanism, joints=joints), END, tolerance=1e-4)
    for kind in ("", ", one"):
        other = apart(found[f"full{kind}"], found[f"m4{kind}"])
        assert max(other.values()) < 5e-3, other
    both, one = (found[name].columns for name in ("m4", "m4, one"))
    assert {"big_end.oil_content_m3", "gudgeon.oil_content_m3"} <= both.keys()
    assert "gudgeon.oil_content_m3" not in one


def test_two_rods_answer_their_films_as_each_alone():
    """The film of one stands between those of the other, whose structure damps otherwise."""
    body = body_of("m4")
    films = {
        n: film(ehd.film_grid(bore.pressure_coordinates), 17e-6) for n, bore in body.bores.items()
    }
    rods = {"one": ehd.FlexibleBody(body, 1e-3), "other": ehd.FlexibleBody(body, 4e-3)}
    bores = {"a": "one.bore", "b": "other.bore", "c": "one.pin"}
    joints = {
        name: ehd.LubricatedJoint("journal", bore, films[bore.partition(".")[2]])
        for name, bore in bores.items()
    }

    def answers(names, *moving):
        machine = {"journal": ehd.RigidBody(1.0), **{name: rods[name] for name in moving}}
        system = System(ehd.Mechanism(machine, {name: joints[name] for name in names}))
        responses, past, pressures, forces = PatternResponses(system), np.zeros(2000), [], []
        for name in moving:
            past[responses.of_body(name)] = 1e9 * np.cos(np.arange(body.residual.rank) + len(name))
        for place in system.films:
            nodes = place.film.film.parameters.grid.node_positions[:, 0]
            pressures.append(1e7 * (1 + np.cos(nodes + ord(place.name))))
            forces.append(ord(place.name) * np.sin(place.film.film.points.angle.ravel()) ** 2)
        responses.begin(SimpleNamespace(shift=2e3, past_x=past))
        gaps = (
            responses.gap_change_from_pressure(pressures),
            responses.gap_change_from_forces(np.concatenate(forces)),
        )
        y, rate = responses.state(responses.static(pressures, np.concatenate(forces)))
        found = {
            name: [part[responses.bodies[name].patterns] for part in (y, rate)] for name in moving
        }
        for i, (place, own) in enumerate(zip(system.films, responses.points, strict=True)):
            some = np.arange(own.start, own.stop, 7)
            found[place.name] = [gap[own] for gap in (*gaps, responses.past_gap, responses.share)]
            found[place.name] += [
                responses.unit_pressure_response(i, some),
                *responses.retained_patterns(9)[i],
            ]
            found[place.name].append(responses.unit_force_response(some)[own])
        return found

    together = answers("abc", "one", "other")
    for name, alone in (answers("ac", "one") | answers("b", "other")).items():
        for found, expected in zip(together[name], alone, strict=True):
            assert np.abs(expected).max() > 0.0
            np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_one_film_of_two_bores_is_that_of_a_rod_with_one():
    """The same modes, and patterns that together are the same flexibility."""
    found = [
        ehd.simulate(
            machine(ehd.residual_flexibility(part(bores), 6, tolerance=0.0), gudgeon=False),
            0.5 * END,
            tolerance=1e-5,
        )
        for bores in (("bore",), ("bore", "pin"))
    ]
    assert max(apart(*found).values()) < 1e-4


def test_a_film_of_other_cells_than_its_bore_is_coupled_too():
    fine = ehd.simulate(machine(body_of("m4"), pin_cells=(16, 4)), END, tolerance=1e-5)
    found = apart(result_of("m4"), fine)
    assert max(v for k, v in found.items() if k.startswith("big_end")) < 0.02
    assert max(found.values()) < 0.2


@pytest.mark.parametrize(
    ("pin_cells", "transfer", "limit"),
    [(None, "conservative", 5e-3), ((16, 4), "mortar", 5e-3), ((16, 4), "conservative", 2e-2)],
)
def test_what_presses_in_one_bore_moves_the_other(pin_cells, transfer, limit):
    """The gap of every film by the pressure in the other, as the reduced part has it."""
    body, mechanism = body_of("m4"), machine(body_of("m4"), pin_cells=pin_cells)
    gudgeon = replace(mechanism.joints["gudgeon"], transfer=transfer)
    joints = {**mechanism.joints, "gudgeon": gudgeon}
    run = Run(replace(mechanism, joints=joints), IntegratorOptions(), END)
    responses = run.equations.responses
    responses.begin(SimpleNamespace(shift=0.0, past_x=run.state.x[0]))
    places = run.equations.system.films
    assert [place.surfaces[0].point for place in places] == ["bore", "pin"]
    for i, j in ((0, 1), (1, 0)):
        pressures = [np.zeros(p.film.film.assembly.size) for p in places]
        angle = places[j].film.film.parameters.grid.node_positions[:, 0]
        pressures[j] = 1e7 * (1.0 + np.cos(angle))
        load = np.zeros(body.load_projection.shape[1])
        own = body.rows_of(places[j].surfaces[0].point).pressures
        load[own] = places[j].film.surfaces[0].maps.structure_pressure(pressures[j])
        moved = responses.gap_change_from_pressure(pressures)[responses.points[i]]
        residual = body.residual
        nodes = body.rows_of(places[i].surfaces[0].point).nodes
        expected = residual.displacement[nodes] @ (residual.patterns @ load)
        reading = places[i].film.surfaces[0].maps.normal
        assert np.abs(moved).max() > 1e-10
        difference = np.abs(moved - reading @ expected.ravel()).max()
        assert difference < limit * np.abs(moved).max()


def test_the_error_estimate_of_each_bore_knows_the_pressures_in_both():
    run = Run(machine(body_of("m3")), IntegratorOptions(tolerance=1e-4), END)
    tracker = Recorder(run, END)
    for step in run.until(0.1 * END):
        row = tracker.add(step)
    estimates = [row[f"{joint}.basis_error_estimate_m"] for joint in JOINTS]
    missing = body_of("m3").missing_flexibility
    largest = max(float(np.abs(f.pressure).max()) for f in step.solution.films)
    for estimate in estimates:
        assert 0.0 < estimate < np.abs(missing).sum(axis=1).max() * largest
    pressures = [film.pressure for film in step.solution.films]
    loads = surface_loads(run.equations.system, pressures, step.x)["rod"]
    assert len(loads) == missing.shape[1]
    for place, film in zip(run.equations.system.films, step.solution.films, strict=True):
        bore = place.surfaces[0]
        own = loads[body_of("m3").rows_of(bore.point).pressures]
        expected = bore.surface.maps.structure_pressure(film.pressure)
        np.testing.assert_array_equal(own, expected)


def test_a_recorded_run_has_gaps_and_pressures_of_both_bores():
    body, mechanism = body_of("m4"), machine(body_of("m4"))
    run = Run(mechanism, IntegratorOptions(tolerance=1e-3), END)
    tracker = Recorder(run, END)
    rows, films = [], []
    for step in run.until(0.05 * END):
        rows.append(tracker.add(step))
        films.append(step.solution.films)
    fields = tracker.rows
    coordinates, rates, quasi_static = (
        np.array([f[f"state/{name}"] for f in fields])
        for name in ("coordinates", "rates", "quasi_static")
    )
    pressures = {j: np.array([f[f"joints/{j}/film/pressure"] for f in fields]) for j in JOINTS}
    time = np.array([row["time_s"] for row in rows])
    replay = RecordedMotion(mechanism, recorded(time, coordinates, rates, quasi_static, pressures))
    assert replay.elastic("rod")[1].shape == (len(time), body.residual.rank)
    for joint, film in zip(JOINTS, films[-1], strict=True):
        least = replay.gaps[joint][-1].min()
        # At the nodes alone, and at the Gauss points too.
        assert least == pytest.approx(rows[-1][f"{joint}.min_film_thickness_m"], rel=2e-2)
        own = body.rows_of({"big_end": "bore", "gudgeon": "pin"}[joint]).pressures
        loads = replay.bore_pressure("rod")[-1, own]
        np.testing.assert_allclose(np.sort(loads), np.sort(film.pressure), rtol=1e-12)


def test_a_body_alone_shows_a_ring_for_every_bore():
    body = body_of("m4")
    shape = shape_of_bores(body)
    assert shape.fields.shape[2] == body.modes + body.residual.rank
    halves = np.split(np.arange(len(shape.nodes)), [len(shape.nodes[shape.nodes[:, 0] < 0.1])])
    for nodes, bore in zip(halves, body.bores.values(), strict=True):
        radii = np.hypot(*(shape.nodes[nodes] - bore.centre)[:, :2].T)
        assert radii.min() == pytest.approx(bore.radius)
    assert {len(np.unique(f < halves[1][0])) for f in shape.faces} == {1}
