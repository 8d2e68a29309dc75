"""Integrators that the package's own is measured against: orders, stiffness, the same rigid rod."""

from dataclasses import dataclass
from functools import partial

import integrators_alpha
import integrators_dirk
import integrators_petsc
import integrators_scipy
import numpy as np
import pytest
from hand_made_rod import REVOLUTION, Joint, flexible, make_body, make_mechanism
from integrators_case import Case, Reference, Trajectory, Window
from integrators_competitors import coupled, nested, runge_kutta, steps
from integrators_dirk import TABLEAUS
from integrators_scaled import ScaledFilm

from fenics_ehd.errors import StepSizeError
from fenics_ehd.multibody import bdf
from fenics_ehd.multibody.bdf import StepControl

SCHEMES = {name: partial(integrators_dirk.integrate, tableau=t) for name, t in TABLEAUS.items()}
SCHEMES["blend 2+3"] = bdf.integrate
SCHEMES["blend 3+4"] = bdf.integrate
SCHEMES |= {
    f"alpha {radius}": partial(integrators_alpha.integrate, radius=radius) for radius in (0.0, 0.5)
}
ORDERS = {name: t.order for name, t in TABLEAUS.items()}
ORDERS |= {"blend 2+3": 2, "blend 3+4": 3, "alpha 0.0": 2, "alpha 0.5": 2}


@dataclass
class Oscillator:
    """``x'' + c x' + k x = force(t)``."""

    damping: float
    stiffness: float
    force: object = lambda t: 0.0

    def linearise(self, time, x, rate, acceleration, shifts, guess):
        residual = acceleration + self.damping * rate + self.stiffness * x - self.force(time)
        return residual, np.diag([shifts[1] + shifts[0] * self.damping + self.stiffness]), None

    def watch(self, x):
        return x

    def error_norm(self, watched, error):
        return float(np.abs(error).max())

    norm = error_norm

    def admissible_fraction(self, x, change):
        return np.inf


def run(name, problem, end, x, rate, **changes):
    values = {
        "tolerance": 1e-6,
        "first_step": 1e-6,
        "smallest_step": 1e-12,
        "largest_step": 1.0,
        "order": ORDERS[name],
    }
    control = StepControl(**(values | changes))
    found = SCHEMES[name](problem, (0.0, end), np.array([x]), np.array([rate]), control)
    return list(found)


def fixed(name, problem, end, x, rate, step):
    return run(name, problem, end, x, rate, tolerance=1e6, first_step=step, largest_step=step)


def flat_start():
    """Driven along ``t^6 exp(-t)``: the first steps leave no error that hides the order."""
    p = np.poly1d([1, 0, 0, 0, 0, 0, 0])
    first = p.deriv() - p
    second = first.deriv() - first

    def force(t):
        return np.exp(-t) * (second(t) + 0.3 * first(t) + 4.0 * p(t))

    return Oscillator(0.3, 4.0, force), lambda t: np.exp(-t) * p(t)


# --- Formulas


@pytest.mark.parametrize("name", TABLEAUS)
def test_tableaus_fulfil_their_order_conditions(name):
    t = TABLEAUS[name]
    b, c, A = t.matrix[-1], t.nodes, t.matrix
    conditions = {
        1: [(np.ones_like(c), 1)],
        2: [(c, 1 / 2)],
        3: [(c**2, 1 / 3), (A @ c, 1 / 6)],
        4: [(c**3, 1 / 4), (c * (A @ c), 1 / 8), (A @ c**2, 1 / 12), (A @ A @ c, 1 / 24)],
    }
    for order in range(1, t.order + 1):
        for vector, value in conditions[order]:
            assert b @ vector == pytest.approx(value, abs=1e-12)
    # The embedded formula is of the order before the power of the estimate.
    for order in range(1, t.estimated):
        for vector, _ in conditions[order]:
            assert t.error @ vector == pytest.approx(0, abs=1e-12)
    # L-stable: nothing of an infinitely stiff mode is left at the end of a step.
    first = int(t.explicit_first)
    inner = np.linalg.solve(A[first:, first:], np.ones(len(c) - first))
    if first:
        left = np.linalg.solve(A[1:, 1:], A[1:, 0])
        assert left[-1] == pytest.approx(0, abs=1e-12)
    else:
        assert 1 - b @ inner == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", SCHEMES)
def test_error_at_fixed_steps_falls_with_the_order(name):
    problem, exact = flat_start()
    counts = (40, 80) if ORDERS[name] == 4 else (100, 200)
    errors = []
    for count in counts:
        found = fixed(name, problem, 4.0, 0.0, 0.0, 4.0 / count)
        errors.append(max(abs(s.x[0] - exact(s.time)) for s in found))
    # The leading error of esdirk4 is so small that the next one still shows.
    slack = 0.9 if name == "esdirk4" else 0.3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(ORDERS[name], abs=slack)


def test_the_blend_halves_the_error_of_order_two():
    problem, exact = flat_start()
    largest = {}
    for name, blend in (("bdf", 0.0), ("blend", 0.5)):
        control = StepControl(1e6, 0.01, 1e-12, 0.01, 2, blend)
        found = bdf.integrate(problem, (0.0, 4.0), np.zeros(1), np.zeros(1), control)
        largest[name] = max(abs(s.x[0] - exact(s.time)) for s in found)
    assert largest["blend"] == pytest.approx(0.5 * largest["bdf"], rel=0.1)


@pytest.mark.parametrize("name", SCHEMES)
def test_error_falls_with_the_tolerance(name):
    problem = Oscillator(0.2, 9.0)
    speed = np.sqrt(9.0 - 0.01)
    errors = []
    # The estimate of sdirk2 is one of order one.
    for tolerance in (1e-3, 1e-5) if name == "sdirk2" else (1e-4, 1e-6):
        found = run(name, problem, 3.0, 1.0, 0.0, tolerance=tolerance)
        waves = [np.cos(speed * s.time) + 0.1 / speed * np.sin(speed * s.time) for s in found]
        exact = [np.exp(-0.1 * s.time) * w for s, w in zip(found, waves, strict=True)]
        errors.append(max(abs(s.x[0] - x) for s, x in zip(found, exact, strict=True)))
    assert errors[0] < 3e-2
    assert errors[1] < errors[0] / 8


# --- Stiffness


@pytest.mark.parametrize("name", SCHEMES)
def test_an_overdamped_stiff_mode_follows_its_load_at_large_steps(name):
    stiffness, relaxation, speed = (2 * np.pi * 1e5) ** 2, 1e-3, 500.0
    load = Oscillator(
        relaxation * stiffness, stiffness, lambda t: stiffness * (1 - np.cos(speed * t))
    )
    lag = speed * relaxation
    errors = []
    for step in (1e-4, 5e-5):
        found = fixed(name, load, 2e-2, 0.0, 0.0, step)
        times = np.array([s.time for s in found])
        wave = np.cos(speed * times) + lag * np.sin(speed * times)
        exact = 1 - (wave + lag**2 * np.exp(-times / relaxation)) / (1 + lag**2)
        errors.append(np.abs([s.x[0] for s in found] - exact).max())
    assert errors[0] < 2e-3
    # Nearly the whole order, although the mode has no motion of its own.
    assert np.log2(errors[0] / errors[1]) > 0.75 * min(ORDERS[name], 3)


@pytest.mark.parametrize("name", SCHEMES)
def test_a_stiff_mode_off_its_equilibrium_dies_at_large_steps(name):
    problem = Oscillator(0.0, (2 * np.pi * 6e5) ** 2)
    found = fixed(name, problem, 1e-2, 1.0, 0.0, 1e-4)
    amplitudes = np.array([abs(s.x[0]) for s in found])
    assert amplitudes.max() < 1.0 + 1e-9
    assert amplitudes[-1] < 1e-6


# --- The slider-crank


def short_run(mechanism, share=0.02):
    rest = np.zeros(mechanism.size)
    case = Case("by hand", mechanism, REVOLUTION / 50)
    return case, Window(0.0, share * REVOLUTION, rest, rest)


@pytest.fixture(scope="module")
def rigid():
    joint = Joint()
    case, window = short_run(make_mechanism(make_body(joint), joint))
    return case, window, Reference(list(steps(case, window, 1e-7, 3)), 5e-5)


NESTED = {name: partial(integrators_petsc.integrate, m) for name, m in
          integrators_petsc.METHODS.items()}  # fmt: skip
OTHERS = {
    "nested bdf 2": partial(nested, 2),
    "coupled bdf 3": partial(coupled, 3, 0.0),
    "blend": partial(coupled, 2, 0.5),
    "esdirk3": partial(runge_kutta, "esdirk3"),
    "SciPy Radau": partial(integrators_scipy.integrate, "Radau", False),
}


@pytest.mark.parametrize("name", NESTED | OTHERS)
def test_a_rigid_rod_moves_the_same(name, rigid):
    case, window, reference = rigid
    integrate = (NESTED | OTHERS)[name]
    found = case.complete(integrate(case, window, 1e-4))
    assert found.times[-1] == pytest.approx(window.end, rel=1e-9)
    assert np.all(np.diff(found.times) > 0)
    assert reference.errors(found).larger < 5e-3


def test_scaled_derivatives_are_those_of_differences():
    joint = Joint()
    mechanism = make_mechanism(flexible(joint)[0], joint)
    case, window = short_run(mechanism, 0.01)
    last = list(steps(case, window, 1e-4, 2))[-1]
    system = ScaledFilm(case)
    state = [last.x, last.rate, last.acceleration]
    found = system.derivatives(last.time, *state)
    for k, (matrix, size) in enumerate(zip(found, (1.0, 1e5, 1e10), strict=True)):
        for column in range(system.size):
            change = 1e-6 * size * system.length[column] * np.eye(system.size)[column]
            ends = [
                system.residual(last.time, *(s + sign * change * (i == k)
                                             for i, s in enumerate(state)))
                for sign in (1, -1)
            ]  # fmt: skip
            slope = (ends[0] - ends[1]) / (2e-6 * size)
            np.testing.assert_allclose(slope, matrix[:, column], rtol=1e-3,
                                       atol=1e-4 * np.abs(matrix).max())  # fmt: skip
    shifts = (1e5, 1e10)
    together = found[0] + shifts[0] * found[1] + shifts[1] * found[2]
    combined = system.combined(last.time, *state, shifts)
    np.testing.assert_allclose(combined, together, atol=1e-6 * np.abs(combined).max())


def test_errors_are_counted_at_the_steps_and_between_them(rigid):
    case, window, reference = rigid
    exact = Trajectory().add_all(steps(case, window, 1e-7, 3))
    assert reference.errors(exact).larger < 1e-10
    some = slice(None, None, 5)
    sparse = Trajectory(exact.times[some], exact.pressure[some], exact.film[some])
    errors = reference.errors(sparse)
    assert errors.larger < 1e-10
    assert errors.larger_curve > 1e-5


@pytest.mark.parametrize("name", ["tr-bdf2", "alpha 0.5"])
def test_a_problem_that_cannot_be_solved_ends_with_a_named_error(name):
    problem = Oscillator(1.0, 1.0, lambda t: np.nan if t > 0.5 else 0.0)
    with pytest.raises(StepSizeError, match="the step fell"):
        run(name, problem, 1.0, 1.0, 0.0, smallest_step=1e-9)
