"""Oils whose viscosity changes in the coupled step: against films at rest, order, limits."""

from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from journal_cases import ETA, OMEGA, UNIT_LOAD, C, constant, equilibrium, journal, make_film

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.newton import classify_failure
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.verdict import verdict

GROUP = "oil"

OILS = {
    "Barus": ehd.Lubricant(ETA, ehd.Barus(4e-8)),
    "Roelands": ehd.Lubricant(ETA, ehd.Roelands(ETA, 0.8)),
    "Cross": ehd.Lubricant(ETA, shear_law=ehd.Cross(2e5, 0.8, 0.3)),
    "Barus and Cross": ehd.Lubricant(ETA, ehd.Barus(4e-8), shear_law=ehd.Cross(2e5, 0.8, 0.3)),
}

#: Down, on a plain bearing of eccentricity 0.6.
LOAD = 0.436957 * UNIT_LOAD * np.array([0.0, -1.0])


@pytest.mark.parametrize("name", OILS)
def test_constant_load_ends_at_the_equilibrium_of_the_film_alone(name, figure):
    load = 2 * LOAD
    film = make_film((24, 4), oil=OILS[name])
    mechanism, _ = journal(film, constant(load), 0.02, rows=3)
    going = Run(
        mechanism, IntegratorOptions(tolerance=1e-4, order=2, first=1e-6, largest=0.2), 0.06
    )
    *_, last = going.until(0.06)
    place = going.equations.system.films[0]
    found = last.x[place.xi][:2]
    expected = equilibrium(film, load, OMEGA, found)
    plain = equilibrium(make_film((24, 4)), load, OMEGA, found)
    defect = np.abs(found - expected).max() / C
    figure(
        GROUP,
        f"{name}, journal comes to rest, eccentricity over clearance",
        defect,
        most=1e-3,
        unit="%",
    )
    assert np.abs(expected - plain).max() / C > 0.02, "the law must matter"
    # The pressure is that of the film alone in this gap, to Newton's tolerance.
    (state,) = last.solution.films
    alone = film.solve(state.gap).pressure
    np.testing.assert_allclose(state.pressure, alone, atol=1e-6 * alone.max())


def ends(oil, steps, order=2):
    """Eccentricity after a stretch of a swelling load, in so many equal steps."""
    film = make_film((16, 3), oil=oil)
    start = equilibrium(film, 0.3 * LOAD, OMEGA)
    end = 0.004

    def swelling(share):
        return 0.3 * LOAD[:, None] * (1 + 2 * np.sin(np.pi * np.asarray(share)) ** 2)

    mechanism, _ = journal(film, swelling, end, eccentricity=tuple(start))
    length = end / steps
    result = ehd.simulate(
        mechanism, end, tolerance=0.9, order=order, first=length, largest=1.0001 / steps
    )
    assert len(result.time) == pytest.approx(steps, abs=1)
    return result.joints["bearing"].eccentricity[-1] / C


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Barus", "Cross"])
def test_steps_converge_at_the_order_of_the_formula(name, figure):
    oil = OILS[name]
    finest = ends(oil, 320)
    errors = [np.abs(ends(oil, steps) - finest).max() for steps in (20, 40, 80)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    figure(GROUP, f"{name}, order in time of the two-step formula", orders[-1], least=1.8)


def test_a_load_that_no_viscosity_bears_is_a_named_error(figure):
    # Rigid surfaces: what the law can bear at a place is the load of q = 1 / alpha at its peak.
    film = make_film((24, 4), oil=ehd.Lubricant(ETA, ehd.Barus(4e-8)))
    squeeze = ehd.ShaftMotion(np.zeros(2), OMEGA, eccentricity_rate=np.array([0.0, -1e-3]))
    plain = make_film((24, 4))
    q = plain.solve(ehd.shaft_gap(plain.points, 0.02, C, squeeze)).pressure
    pressure = -np.log1p(-(1 - 1e-9) * q / q.max()) / 4e-8
    bearable = (film.load(np.stack(film.points.normal, axis=-1)) @ pressure)[1] / LOAD[1]
    assert 6 < bearable < 9
    for share, borne in ((0.9, True), (1.5, False)):
        mechanism, _ = journal(film, constant(share * bearable * LOAD), 0.02, rows=3)
        going = Run(mechanism, IntegratorOptions(tolerance=1e-3, order=2, first=1e-6), 0.02)
        if borne:
            step = next(going.until(0.02))
            (state,) = step.solution.films
            highest = 4e-8 * state.pressure.max()
            figure(GROUP, "Barus near what it can bear, alpha p", highest, least=4.0)
            continue
        with pytest.raises(ehd.errors.StepSizeError, match="viscosity runs away with the pressure"):
            next(going.until(0.02))


def stages(oil, share, cells=(16, 3)):
    """A journal's run, and what is recorded of it."""
    mechanism, _ = journal(make_film(cells, oil=oil), constant(share * LOAD), 0.02, rows=3)
    going = Run(mechanism, IntegratorOptions(tolerance=1e-3, order=2, first=1e-6), 0.01)
    tracker = Recorder(going, 0.01)
    deque(tracker.steps(), maxlen=0)
    return going, tracker


def test_a_step_that_fails_with_thick_oil_says_so():
    failure = ehd.errors.SolverError("no convergence")
    for oil, message in ((OILS["Barus"], True), (OILS["Cross"], False)):
        going, _ = stages(oil, 1.0)
        equations, former = going.equations, going.state.solver
        assert classify_failure(failure, equations, None) is failure
        assert classify_failure(failure, equations, former) is failure
        # At the last accepted step five hundred times as thick.
        highest = equations.films[0].pressure(former.values[0][equations.film_indices[0]]).max()
        thick = replace(former, values=former.values * 155e6 / highest)
        named = classify_failure(failure, equations, thick)
        assert isinstance(named, ehd.errors.ViscosityError) == message
        if message:
            assert "the viscosity of the oil in bearing runs away" in str(named)
            assert "at 155 MPa it is 4.9e+02 times" in str(named)
        beyond = replace(former, values=former.values * 1e12 / highest)
        assert (
            isinstance(classify_failure(failure, equations, beyond), ehd.errors.ViscosityError)
            == message
        )


@pytest.mark.slow
def test_pressures_that_are_the_mesh_s_own_are_not_trusted():
    # 6 times the load of eccentricity 0.6 is beyond what the oil can bear; so coarse a mesh does.
    _, tracker = stages(OILS["Barus"], 6.0)
    assert RunSummary(tracker).steepest_thickening(*tracker.system.films) > 1e3
    assert verdict(RunSummary(tracker)).startswith("untrustworthy: the viscosity in bearing varies")
    _, tracker = stages(OILS["Barus"], 3.0)
    assert 1.0 < RunSummary(tracker).steepest_thickening(*tracker.system.films) < 10.0
    assert verdict(RunSummary(tracker)) == "complete"
    _, tracker = stages(ehd.Lubricant(ETA), 3.0)
    assert RunSummary(tracker).steepest_thickening(*tracker.system.films) == 1.0


def test_no_number_overflows_on_the_way_to_the_error():
    film = make_film((12, 2), oil=ehd.Lubricant(ETA, ehd.Barus(4e-8)))
    mechanism, _ = journal(film, constant(1e4 * LOAD), 0.02, rows=3)
    with (
        np.errstate(all="raise", under="ignore"),
        pytest.raises(ehd.errors.StepSizeError, match="runs away"),
    ):
        ehd.simulate(mechanism, 0.02, order=2, first=1e-6)
