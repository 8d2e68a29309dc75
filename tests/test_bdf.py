"""Time integration: orders, tolerances, stiffness, admissible steps, and what it reports."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from newton_steps import integrate

import fenics_ehd as ehd
from fenics_ehd.multibody.bdf import IntegratorOptions, IntegratorState
from fenics_ehd.multibody.tabulated import blended, derivative_weights, extrapolation_weights

pytestmark = pytest.mark.kernels

profile = settings(max_examples=60)


@dataclass
class Linear:
    """``x'' + c x' + k x = force(t)``, one oscillator in each coordinate."""

    damping: np.ndarray
    stiffness: np.ndarray
    force: object = lambda t: 0.0
    calls: list = field(default_factory=list)

    def linearise(self, time, x, rate, acceleration, shifts, guess):
        self.calls.append(time)
        residual = acceleration + self.damping * rate + self.stiffness * x - self.force(time)
        jacobian = np.diag(shifts[1] + shifts[0] * self.damping + self.stiffness)
        return residual, jacobian, (guess or 0) + 1

    def observe(self, x):
        return x

    def error_norm(self, observed, error):
        return float(np.abs(error).max())

    norm = error_norm

    def admissible_fraction(self, x, change):
        return np.inf


def oscillator(damping, stiffness, force=lambda t: 0.0):
    return Linear(np.atleast_1d(float(damping)), np.atleast_1d(float(stiffness)), force)


def control(**changes):
    values = {"tolerance": 1e-6, "first": 1e-6, "smallest": 1e-12, "largest": 1.0, "order": 2}
    return IntegratorOptions(**(values | changes))


def run(problem, end, x, rate, **changes):
    return list(
        integrate(problem, (0.0, end), np.atleast_1d(float(x)), np.atleast_1d(float(rate)),
                  control(**changes))
    )  # fmt: skip


# --- Formulas


@st.composite
def grids(draw):
    """Points in time, newest first, their distances within a factor of 100."""
    distances = draw(st.lists(st.floats(0.02, 2.0), min_size=1, max_size=5))
    return draw(st.floats(-3.0, 3.0)) - np.concatenate([[0.0], np.cumsum(distances)])


@profile
@given(grids(), st.data())
def test_derivative_weights_are_exact_for_polynomials(times, data):
    coefficients = data.draw(
        st.lists(st.floats(-1, 1), min_size=len(times), max_size=len(times)).map(np.poly1d)
    )
    weights = derivative_weights(times)
    found = weights @ coefficients(times)
    rounding = np.abs(weights) @ np.abs(coefficients(times)) + 1.0
    assert found == pytest.approx(coefficients.deriv()(times[0]), abs=1e-11 * rounding)


@profile
@given(grids(), st.floats(0.0, 2.0), st.data())
def test_extrapolation_is_exact_for_polynomials(times, ahead, data):
    rows = [
        data.draw(st.lists(st.floats(-1, 1), min_size=len(times), max_size=len(times)))
        for _ in range(2)
    ]
    polynomials = [np.poly1d(row) for row in rows]
    values = np.column_stack([p(times) for p in polynomials])
    target = times[0] + ahead
    found = extrapolation_weights(times, target) @ values
    # Lagrange's polynomials magnify the rounding of the values.
    magnified = [
        np.prod((target - np.delete(times, j)) / (t - np.delete(times, j)))
        for j, t in enumerate(times)
    ]
    rounding = np.abs(magnified) @ np.abs(values) + 1.0
    expected = np.array([p(target) for p in polynomials])
    assert np.all(np.abs(found - expected) <= 1e-11 * rounding)


# --- Order and tolerance


@profile
@given(st.lists(st.floats(0.2, 1.0), min_size=5, max_size=5), st.sampled_from([1, 2, 3]),
       st.sampled_from([0.0, 0.5]))  # fmt: skip
def test_the_estimate_is_the_error_of_the_first_power_that_a_formula_misses(gaps, order, blend):
    # Past values are exact, and so is the rate that the equation gives: what is left is local.
    past, time = -np.concatenate([[0.0], np.cumsum(gaps[1:])]), gaps[0]
    power = np.poly1d([1.0, *np.zeros(order + 1)])
    values = power(past)[:, None]
    state = IntegratorState(past, values, values, values, gaps[0])
    weights, _ = blended(time, past, order, blend)
    used = past[: len(weights) - 1]
    found = (power.deriv()(time) - weights[1:] @ power(used)) / weights[0]
    distance = found - extrapolation_weights(past[: order + 1], time) @ power(past[: order + 1])
    estimate = state.implicit_step(None, time, order, blend, 1.0).error_share * distance
    assert estimate == pytest.approx(found - power(time), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(("order", "stable"), [(1, np.inf), (2, 2.41), (3, 1.61)])
def test_steps_grow_no_faster_than_their_formula_is_stable_for(order, stable):
    # Zero-stability of variable steps: Guglielmi and Zennaro, Numer. Math. 88, 2001.
    steps = run(oscillator(1.0, 4.0), 1.0, 1, 0, tolerance=1e6, first=1e-9, order=order)
    sizes = np.diff([0.0, *(s.time for s in steps)])
    growth = sizes[1:] / sizes[:-1]
    # The first steps, which have no history, are of order 1.
    assert growth[order:].max() <= stable
    assert growth.max() > 1.4


def flat_start():
    """An oscillator driven along ``t^6 exp(-t)``.

    Flat at the start, so that the first steps, which have too little history
    for their order, leave no error that hides the order of the others.
    """
    p = np.poly1d([1, 0, 0, 0, 0, 0, 0])
    first = p.deriv() - p
    second = first.deriv() - first
    damping, stiffness = 0.3, 4.0

    def force(t):
        return np.exp(-t) * (second(t) + damping * first(t) + stiffness * p(t))

    return oscillator(damping, stiffness, force), lambda t: np.exp(-t) * p(t)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_errors_at_fixed_steps_fall_with_the_order(order):
    """Of values and, at the end, of rates."""
    problem, exact = flat_start()
    errors = []
    for count in (400, 800):
        step = 4.0 / count
        steps = run(problem, 4.0, 0, 0, tolerance=1e6, first=step, largest=step,
                    order=order)  # fmt: skip
        assert len(steps) == pytest.approx(count, abs=2)
        last, largest = steps[-1], max(abs(s.x[0] - exact(s.time)) for s in steps)
        rate = 6 * exact(last.time) / last.time - exact(last.time)
        errors.append([largest, abs(last.rate[0] - rate)])
    orders = np.log2(np.divide(*errors))
    np.testing.assert_allclose(orders, order, atol=0.15)


def error_of_a_decay(**changes):
    """Largest error of an oscillation that dies away from 1."""
    decay, speed = 0.1, np.sqrt(9.0 - 0.01)

    def exact(t):
        return np.exp(-decay * t) * (np.cos(speed * t) + decay / speed * np.sin(speed * t))

    steps = run(oscillator(0.2, 9.0), 3.0, 1, 0, **changes)
    return max(abs(s.x[0] - exact(s.time)) for s in steps)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_error_falls_in_proportion_to_the_tolerance(order):
    tolerances = np.array([1e-3, 1e-4, 1e-5, 1e-6]) / (1 if order == 1 else 10)
    errors = []
    for tolerance in tolerances:
        # Long enough for rates free of rounding, short enough for a start at order 1.
        errors.append(error_of_a_decay(tolerance=tolerance, order=order, first=1e-6))
    # Local error of order k + 1 at tolerance, so a global one of tolerance^(k / (k + 1)).
    rates = np.diff(np.log10(errors)) / np.diff(np.log10(tolerances))
    assert np.all(np.abs(rates - order / (order + 1)) < 0.2), errors


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_shorter_first_step_does_no_harm(order):
    # Steps double many times from a start as short as this one: a formula that is not stable
    # at that growth magnifies the rounding of the first rates instead of forgetting it.
    errors = [error_of_a_decay(tolerance=1e-5, order=order, first=first) for first in (1e-6, 1e-9)]
    assert errors[1] < 1.5 * errors[0]


# --- Stiffness


def test_an_overdamped_stiff_mode_follows_its_load_at_large_steps():
    # A bore mode: 100 kHz, relaxing within 1 ms, under a load that begins smoothly.
    stiffness, relaxation, speed = (2 * np.pi * 1e5) ** 2, 1e-3, 500.0
    problem = oscillator(
        relaxation * stiffness, stiffness, lambda t: stiffness * (1 - np.cos(speed * t))
    )
    lag = speed * relaxation
    errors = []
    for step in (1e-4, 5e-5):
        steps = run(problem, 2e-2, 0, 0, tolerance=1e6, first=step, largest=step)
        times = np.array([s.time for s in steps])
        decayed = lag**2 * np.exp(-times / relaxation)
        wave = np.cos(speed * times) + lag * np.sin(speed * times)
        settled = 1 - (wave + decayed) / (1 + lag**2)
        errors.append(np.abs([s.x[0] for s in steps] - settled).max())
    assert errors[0] < 2e-3
    assert errors[1] < errors[0] / 3


@pytest.mark.parametrize("damping", [0.0, 2e-3])
def test_a_stiff_mode_off_its_equilibrium_dies_at_large_steps(damping):
    # Undamped or not: steps of 60 periods must not feed the mode.
    stiffness = (2 * np.pi * 6e5) ** 2
    problem = oscillator(damping * stiffness, stiffness)
    steps = run(problem, 1e-2, 1, 0, tolerance=1e6, first=1e-4, largest=1e-4)
    amplitudes = np.array([abs(s.x[0]) for s in steps])
    assert amplitudes.max() < 1.0 + 1e-12
    assert amplitudes[-1] < 1e-2
    assert np.all(np.diff(np.maximum.accumulate(amplitudes[::-1])) >= 0)


# --- Admissible set


@dataclass
class Squeeze:
    """A mass pressed on a squeeze film of thickness x > 0: ``x'' + x' / x^3 = -load``."""

    load: float
    seen: list = field(default_factory=list)
    shortened: int = 0

    def linearise(self, time, x, rate, acceleration, shifts, guess):
        self.seen.append(float(x[0]))
        assert x[0] > 0, "the film was evaluated with a closed gap"
        residual = acceleration + rate / x**3 + self.load
        slope = shifts[1] + shifts[0] / x**3 - 3 * rate / x**4
        return residual, np.diag(slope), None

    def observe(self, x):
        return x

    def error_norm(self, observed, error):
        return float(np.abs(error / observed).max())

    norm = error_norm

    def admissible_fraction(self, x, change):
        fraction = float(-x[0] / change[0]) if change[0] < 0 else np.inf
        self.shortened += fraction < 1
        return fraction


@pytest.mark.parametrize("first", [1e-6, 3.0])
def test_an_admissible_set_that_the_predictor_would_leave_is_never_left(first):
    problem = Squeeze(load=10.0)
    steps = run(problem, 30.0, 1, -1, tolerance=1e-3, first=first, largest=5.0)
    assert min(problem.seen) > 0
    # Without inertia 1 / (2 x^2) grows at the rate of the load.
    settled = (2 * 10.0 * 30.0) ** -0.5
    if first > 1:
        assert problem.shortened, "this test wants a predictor that leaves the set"
        assert steps[-1].x[0] == pytest.approx(settled, rel=0.05)
    else:
        assert steps[-1].x[0] == pytest.approx(settled, rel=0.01)


def test_the_gap_stays_open_at_every_step_size():
    rng = np.random.default_rng(1)
    for _ in range(20):
        problem = Squeeze(load=10 ** rng.uniform(-1, 4))
        steps = run(problem, 1.0, 1, -(10 ** rng.uniform(-2, 3)), tolerance=1e-2,
                    first=10 ** rng.uniform(-6, 0), smallest=1e-14)  # fmt: skip
        assert min(problem.seen) > 0
        assert steps[-1].time == 1.0


# --- What is rejected, counted and reported


@dataclass
class Closing(Linear):
    """An oscillator whose gap closes in steps longer than a limit."""

    longest: float = 1.0

    def linearise(self, time, x, rate, acceleration, shifts, guess):
        result = super().linearise(time, x, rate, acceleration, shifts, guess)
        # The first weight of the formula of order 1 is 1 / step.
        if shifts[0] < 1.0 / self.longest:
            raise ehd.errors.GapClosedError("closed")
        return result


def test_failed_attempts_are_counted_by_reason():
    problem = Closing(np.ones(1), np.ones(1), longest=0.01)
    first = next(integrate(problem, (0.0, 10.0), np.ones(1), np.zeros(1),
                           control(first=0.8, tolerance=1e-3)))  # fmt: skip
    # 0.8, 0.16, 0.032 are too long; a failure shortens by five.
    assert first.time == pytest.approx(0.0064)
    assert first.rejected == {"GapClosedError": 3}


def test_every_attempt_is_an_accepted_or_a_counted_rejected_step():
    # A kick that no step size anticipates.
    problem = oscillator(1.0, 4.0, lambda t: 1e3 * (t > 0.5))
    steps = run(problem, 1.0, 1, 0)
    rejected = sum(sum(s.rejected.values()) for s in steps)
    assert {reason for s in steps for reason in s.rejected} == {"error above tolerance"}
    # Calls of one attempt share their time, a retry has another.
    assert len(steps) + rejected == 1 + np.count_nonzero(np.diff(problem.calls))
    assert rejected >= 3
    # The counts belong to the step that succeeded, and do not pile up.
    assert sum(bool(s.rejected) for s in steps) < 10


def test_a_step_below_the_smallest_names_the_key_and_the_reason():
    problem = Closing(np.ones(1), np.ones(1), longest=1e-9)
    with pytest.raises(ehd.errors.StepSizeError) as caught:
        run(problem, 1.0, 1, 0, first=1e-3, smallest=1e-6)
    message = str(caught.value)
    assert "time.smallest_step = 1.0e-06 s" in message
    assert "GapClosedError" in message
    assert "time.tolerance" in message
    assert "t = 0 s" in message


class Hopeless(Linear):
    """Every update is of length 1, for every step."""

    def linearise(self, *arguments):
        _, jacobian, state = super().linearise(*arguments)
        return jacobian @ np.ones(1), jacobian, state


class Singular(Linear):
    def linearise(self, *arguments):
        residual, jacobian, state = super().linearise(*arguments)
        return residual, 0 * jacobian, state


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (Hopeless(np.ones(1), np.ones(1)), r"time\.smallest_step"),
        (Singular(np.ones(1), np.ones(1)), "LinAlgError"),
        (oscillator(1.0, 4.0, lambda t: np.nan if t > 0.5 else 0.0), r"time\.smallest_step"),
        (oscillator(1.0, 4.0, lambda t: np.inf if t > 0.5 else 0.0), r"time\.smallest_step"),
    ],
    ids=["never converges", "singular", "nan", "inf"],
)
def test_what_cannot_be_solved_ends_with_a_named_error(problem, words):
    with pytest.raises(ehd.errors.StepSizeError, match=words):
        run(problem, 1.0, 1, 0, first=1e-3, smallest=1e-6)


# --- Times


@pytest.mark.parametrize("end", [1e-12, 0.1, 1 / 3, 0.7, 1.0])
@pytest.mark.parametrize("first", [1e-6, 0.05, 0.3])
def test_the_last_step_ends_exactly_at_the_end(end, first):
    steps = run(oscillator(1.0, 4.0), end, 1, 0, first=first * end,
                largest=0.31 * end, tolerance=1e-3, smallest=1e-20)  # fmt: skip
    times = np.array([0.0, *(s.time for s in steps)])
    assert times[-1] == end
    assert np.all(np.diff(times) > 0)
    # No sliver at the end: its short step would spoil the formula's weights.
    assert times[-1] - times[-2] > 0.3 * (times[-2] - times[-3])
    assert np.diff(times).max() <= 0.31 * end * (1 + 1e-12)


def test_a_first_step_that_is_too_long_is_found_out():
    # Critical damping, 1 / e within the first step, whose value must not be taken on trust.
    problem = oscillator(2.0, 1.0)
    steps = run(problem, 3.0, 1, 0, tolerance=1e-6, first=1.0, largest=1.0)
    errors = [abs(s.x[0] - (1 + s.time) * np.exp(-s.time)) for s in steps]
    assert max(errors) < 1e-3


def test_history_is_that_of_accepted_steps_only():
    # The same steps, once found by trial and once taken straight away, give the same values.
    kick = oscillator(1.0, 4.0, lambda t: 30.0 * (t > 0.5))
    trial = run(kick, 1.0, 1, 0, tolerance=1e-4, blend=0.0)
    assert any(s.rejected for s in trial)
    for newer, older, oldest in zip(trial[3:], trial[2:], trial[1:], strict=False):
        times = np.array([newer.time, older.time, oldest.time])
        values = np.array([newer.x[0], older.x[0], oldest.x[0]])
        rates = np.array([newer.rate[0], older.rate[0], oldest.rate[0]])
        weights = derivative_weights(times)
        assert newer.rate[0] == pytest.approx(weights @ values, abs=1e-9)
        assert newer.acceleration[0] == pytest.approx(weights @ rates, rel=1e-9, abs=1e-9)
        # Rounding of x enters the acceleration times the squared weight.
        residual = (
            newer.acceleration[0] + newer.rate[0] + 4 * newer.x[0] - 30.0 * (newer.time > 0.5)
        )
        assert residual == pytest.approx(0.0, abs=1e-10 + 1e-14 * weights[0] ** 2)
