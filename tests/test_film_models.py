"""The seam of film models: a film with one further nodal unknown needs no change elsewhere."""

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.multibody import film_models
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.film_content import FilmContent
from fenics_ehd.multibody.film_models import ReynoldsFilm
from fenics_ehd.multibody.film_point import FilmPoint
from fenics_ehd.multibody.run import Run

#: Time constant of the scalar [s].
LAG = 3e-4


class ScalarContent(FilmContent):
    """The scalar in the state of the integration."""

    def begin(self, step):
        self.shift, self.past = step.shift, step.past_x[self.indices]

    def at_end(self, point, z):
        return point.scalar, self.shift * point.scalar + self.past


@dataclass(frozen=True, eq=False)
class ScalarPoint(FilmPoint):
    """A point with the scalar; `alone` is that of the film without it."""

    scalar: np.ndarray
    alone: FilmPoint


class LaggedScalar(ReynoldsFilm):
    """A film whose scalar T follows the pressure, ``LAG T' = p - T``, and has no effect on it."""

    def __init__(self, binding, first):
        super().__init__(binding, first)
        self.content = ScalarContent(first, len(self.nodes))
        self.lower = np.concatenate([self.lower, np.full(len(self.nodes), -np.inf)])

    def unknowns(self, pressure, void=None):
        pressures = super().unknowns(pressure, void)
        return np.concatenate([pressures, np.zeros_like(pressures)])

    def evaluate(self, gap, unknowns):
        pressures, scalar = np.split(unknowns, 2)
        alone = super().evaluate(gap, pressures)
        rate = self.content.shift * scalar + self.content.past
        defect = np.concatenate([alone.defect, LAG * rate + scalar - pressures])
        problem = alone.problem
        return ScalarPoint(pressures, alone.nodal, gap, problem, defect, scalar, alone)

    def right_side(self, point, full):
        return super().right_side(point.alone, full)

    def update(self, point, full, solution):
        defect = point.defect[len(self.nodes) :]
        pressures = np.zeros(len(self.nodes))
        pressures[full] = solution[full]
        return np.concatenate([solution, (defect + pressures) / (1 + LAG * self.content.shift)])

    def settled(self, point, tolerance):
        scale = np.abs(point.scalar).max(initial=1e-300)
        small = np.abs(point.defect[len(self.nodes) :]).max() <= tolerance * scale
        return small and super().settled(point.alone, tolerance)

    def state(self, point):
        return super().state(getattr(point, "alone", point))

    def end(self, point, tolerance):
        return super().end(point.alone, tolerance)


#: Steps of the runs.
COUNT = 25


def run_of(name):
    """Run of a shipped scene, what its steps were solved from, and the steps."""
    machine = ehd.build(ehd.read_scene(name, **{"joints.bearing.cells": [16, 4]}))
    run = Run(machine.mechanism, IntegratorOptions(tolerance=1e-3), 1e-3)
    solve, asked = run.solve, []

    def solving(norm, step, former):
        asked.append(step)
        return solve(norm, step, former)

    run.solve = solving
    steps = list(islice(run.until(1e-3), COUNT))
    run.solve = solve
    return run, asked, steps


@pytest.fixture(scope="module")
def runs():
    """The journal bearing's run without and with the scalar."""
    plain = run_of("loaded-journal")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(film_models, "MODELS", {"reynolds": LaggedScalar})
        return plain, run_of("loaded-journal")


def test_a_step_with_a_further_nodal_unknown_has_the_same_pressures_to_the_last_bit(runs):
    (plain, asked, _), (extended, _, _) = runs
    size = extended.equations.films[0].content.size
    rng = np.random.default_rng(1)
    for step in asked:
        alone = plain.solve(plain.norm, step, None)
        arrays = {
            name: np.append(getattr(step, name), rng.uniform(-1, 1, size))
            for name in ("past_x", "past_rate", "start", "predicted")
        }
        other = extended.solve(extended.norm, replace(step, **arrays), None)
        assert alone.iterations == other.iterations
        films = [attempt.solved.solution.films[0] for attempt in (alone, other)]
        assert np.array_equal(films[0].pressure, films[1].pressure)
        assert np.array_equal(alone.solved.x, other.solved.x[: -size or None])
    assert films[0].pressure.max() > 1e5


def test_a_further_nodal_unknown_does_not_change_a_run(runs):
    (_, _, plain), (_, _, extended) = runs
    assert len(plain) == len(extended) == COUNT
    for alone, other in zip(plain, extended, strict=True):
        assert alone.newton_iterations == other.newton_iterations
        assert alone.time == pytest.approx(other.time, rel=1e-10)
        # Sums over former steps are rounded otherwise in longer vectors.
        np.testing.assert_allclose(alone.x, other.x[: len(alone.x)], rtol=1e-9, atol=1e-18)


def test_a_further_nodal_unknown_is_integrated_with_the_motion(runs):
    _, (run, _, steps) = runs
    (film,) = run.equations.films
    scale = film.film.parameters.pressure_scale
    for step in steps:
        scalar, rate = step.x[film.content.indices], step.rate[film.content.indices]
        pressure = step.solution.films[0].pressure[film.nodes] / scale
        size = np.abs(pressure).max()
        np.testing.assert_allclose(LAG * rate, pressure - scalar, atol=1e-9 * size)
    assert 0.1 * size < scalar.max() < size
    # Values of the step before are carried on by the integrator: the rate is that of the scalar.
    span = steps[-1].time - steps[-2].time
    mean = 0.5 * (steps[-1].rate + steps[-2].rate)[film.content.indices]
    change = (steps[-1].x - steps[-2].x)[film.content.indices]
    np.testing.assert_allclose(change, span * mean, atol=0.02 * np.abs(change).max())
