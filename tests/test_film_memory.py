"""Small motions in bores with residual patterns: the films have memory."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fenics_ehd as ehd
from fenics_ehd.analysis import film_memory
from fenics_ehd.analysis.film_meshes import mean_linearisation
from fenics_ehd.analysis.modes import modes_of
from fenics_ehd.analysis.rotor_map import MapPoint, rotor_map_of
from fenics_ehd.analysis.unbalance import film_force, response
from fenics_ehd.base.errors import SolverError
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.study.rotor_folder import StoredPoints

SPEED = 600.0
PERIOD = 2 * np.pi / SPEED
LAYERS = "ring_layers", "web_layers", "foot_layers"
COARSE = {"joints.bearing.cells": [20, 5]} | {f"bodies.housing.geometry.{n}": 1 for n in LAYERS}
ZETAS = (0.0, 1e-3)


@cache
def rotor(zeta, load=1000.0):
    """The shipped rotor on coarse meshes, under a constant load [N]."""
    scene = ehd.read_scene("rotor", **COARSE, **{"bodies.housing.damping_time": zeta})
    force = ehd.PointForce("shaft.bearing", (0.3, -1.0), lambda time: (load, 0.0))
    return replace(ehd.build(scene).mechanism, forces={"load": force})


@cache
def linearised(zeta):
    rest = ehd.equilibrium(rotor(zeta))
    return rest, ehd.linearise(rest)


class FullPencil:
    """Pencil ``J_0 + s J_1 + s^2 J_2`` in which pressures and patterns are unknowns as well.

    All derivatives of the equations are polynomials in s, once those of a pattern, which has the
    lag 1 / (1 + zeta s), are multiplied by 1 + zeta s.
    """

    def __init__(self, rest, basis, zeta, step=100.0):
        at_rest, above, below = (self.matrix(rest, s, zeta) for s in (0.0, step, -step))
        linear = (above - below) / (2 * step)
        square = (above + below - 2 * at_rest) / (2 * step**2)
        self.coefficients = at_rest, linear, square
        defect = self(3 * step) - self.matrix(rest, 3 * step, zeta)
        assert np.abs(defect).max() < 1e-12 * np.abs(at_rest).max()
        self.basis = np.zeros((len(at_rest), basis.shape[1]))
        self.basis[self.start : self.start + len(basis)] = basis

    def matrix(self, rest, s, zeta):
        equations = rest.solver.equations
        past = rest.rate - s * rest.x, -s * rest.rate
        step = ImplicitStep(0.0, s, *past, rest.x, rest.x, (rest.x, rest.x), 1e-10)
        equations.begin(step)
        equations.retain_patterns(equations.most_patterns)
        derivative = equations.linearise(equations.evaluate(rest.unknowns.values[0]))
        equations.retain_patterns(rest.unknowns.patterns)
        (film,), (full,) = derivative.films, rest.solver._full
        self.start = len(full)
        matrix = np.zeros((len(full) + len(derivative.core),) * 2)
        matrix[: len(full), : len(full)] = film.block(full, full)
        matrix[: len(full), len(full) :] = (film.inputs @ film.spread)[full]
        matrix[len(full) + film.rows, : len(full)] = film.outputs[:, full]
        matrix[len(full) :, len(full) :] = derivative.core
        matrix[len(full) + equations.rest_size :] *= 1 + zeta * s
        return matrix

    def __call__(self, s):
        return sum(s**i * matrix for i, matrix in enumerate(self.coefficients))

    def stiffness(self, s):
        """Dynamic stiffness of the motions at a complex s."""
        return np.linalg.inv(self.basis.T @ np.linalg.solve(self(s), self.basis + 0j))

    def root(self, start):
        """Root near an approximate one, by inverse iteration in the linear pencil."""
        root = start
        rng = np.random.default_rng(0)
        x, y = rng.normal(size=(2, len(self.basis))) + 0j
        slope = self.coefficients[1] + 2 * root * self.coefficients[2]
        for _ in range(8):
            x = np.linalg.solve(self(root), slope @ x)
            y = np.linalg.solve(self(root).T, slope.T @ y)
            x /= np.linalg.norm(x)
            y /= np.linalg.norm(y)
            slope = self.coefficients[1] + 2 * root * self.coefficients[2]
            change = (y @ self(root) @ x) / (y @ slope @ x)
            root = root - change
            if abs(change) < 1e-9 * abs(root):
                return root
        raise AssertionError(start)


@pytest.mark.parametrize("zeta", ZETAS)
def test_roots_are_those_of_the_pencil_with_all_pressures_and_patterns(zeta, figure):
    rest, linear = linearised(zeta)
    modes = modes_of(linear)
    pencil = FullPencil(rest, linear.basis, zeta)
    lowest = [root for root in modes.roots if 0.0 < root.imag < 10 * SPEED]
    assert len(lowest) >= 5
    errors = [abs(root / pencil.root(root) - 1.0) for root in lowest]
    figure("rotor maps", f"roots in an elastic bore with damping time {zeta:g} s, full pencil",
           max(errors), most=1e-5)  # fmt: skip
    for index in range(len(modes.roots)):
        stiffness = linear.dynamic_stiffness(modes.roots[index])
        size = np.linalg.norm(stiffness, 2) * np.linalg.norm(modes.shapes[:, index])
        assert np.linalg.norm(stiffness @ modes.shapes[:, index]) < 1e-8 * size
    np.testing.assert_allclose(np.diag(modes.overlaps(modes)), 1.0, rtol=1e-6)


@pytest.mark.parametrize("zeta", ZETAS)
def test_vibrations_are_those_of_the_pencil_with_all_pressures_and_patterns(zeta, figure):
    rest, linear = linearised(zeta)
    pencil = FullPencil(rest, linear.basis, zeta)
    force = np.random.default_rng(1).normal(size=len(linear.basis)) + 0j
    motion = response(linear, force, SPEED)
    expected = np.linalg.solve(pencil.stiffness(1j * SPEED), linear.basis.T @ force)
    figure("rotor maps", f"vibration in an elastic bore with damping time {zeta:g} s, full pencil",
           np.linalg.norm(motion - expected) / np.linalg.norm(expected), most=1e-5)  # fmt: skip
    # The film carries the journal, whose load is that of the pressures on it.
    np.testing.assert_allclose(
        linear.film_stiffness("bearing", 1e-4j * SPEED).imag / (1e-4 * SPEED),
        linear.films["bearing"][1], rtol=1e-3, atol=1e-6 * np.abs(linear.films["bearing"][1]).max(),
    )  # fmt: skip
    assert film_force(linear, "bearing", motion, SPEED).shape == (2,)


def test_slow_motions_and_other_coordinates_have_the_same_stiffness():
    linear = linearised(0.0)[1]
    slow = linear.dynamic_stiffness(1e-3j)
    np.testing.assert_allclose(slow.real, linear.stiffness, atol=1e-9 * np.abs(slow).max())
    turn = np.random.default_rng(2).normal(size=linear.mass.shape)
    turned = linear.with_coordinates(turn)
    expected = turn.T @ linear.dynamic_stiffness(1j * SPEED) @ turn
    defect = turned.dynamic_stiffness(1j * SPEED) - expected
    assert np.abs(defect).max() < 1e-6 * np.abs(expected).max()
    mean = mean_linearisation([linear, linear.with_coordinates(-np.eye(len(turn)))])
    defect = mean.dynamic_stiffness(1j * SPEED) - linear.dynamic_stiffness(1j * SPEED)
    assert np.abs(defect).max() < 1e-9 * np.abs(expected).max()


def test_a_stored_point_has_the_same_modes(tmp_path):
    rest, linear = linearised(1e-3)
    roots = modes_of(linear).roots
    growth = np.array([roots[0].real])
    point = MapPoint(SPEED, linear, {}, growth, 0.01 * np.abs(roots), (rest.search_start,))
    StoredPoints(tmp_path, "map")[SPEED] = point
    stored = StoredPoints(tmp_path, "map")[SPEED]
    np.testing.assert_array_equal(stored.modes.roots, point.modes.roots)
    np.testing.assert_array_equal(stored.scatter, point.scatter)
    np.testing.assert_array_equal(
        stored.linear.film_stiffness("bearing", 1j * SPEED),
        linear.film_stiffness("bearing", 1j * SPEED),
    )


def test_an_interpolant_with_a_large_error_is_refused(monkeypatch):
    linear = linearised(0.0)[1]
    monkeypatch.setattr(film_memory, "LARGEST_SUPPORT", 2)
    with pytest.raises(SolverError, match="the dynamic stiffness of the elastic bore is interp"):
        modes_of(linear.with_coordinates(np.eye(len(linear.mass))))


def test_round_off_of_the_samples_makes_no_unstable_roots():
    """Without the limit on poles, round-off of 1e-8 has real roots of some 400 1/s."""
    linear = linearised(1e-3)[1]
    sampled = linear.sampled
    sizes = np.linalg.norm(sampled.values, axis=(1, 2), keepdims=True) / len(linear.mass)
    noise = 1e-8 * sizes * np.random.default_rng(0).normal(size=sampled.values.shape)
    noisy = replace(linear, sampled=replace(sampled, values=sampled.values + noise))
    roots = modes_of(noisy).roots
    assert roots.real.max() < 0.0
    assert len(roots) == len(modes_of(linear).roots)


@pytest.mark.slow
def test_small_vibrations_in_an_elastic_bore_decay_in_time_as_the_least_stable_mode(figure):
    """Under a load at which matrices of slow motions have half the decay, 9 % of the multiplier."""
    machine = rotor(0.0, load=100.0)
    rest = ehd.equilibrium(machine)
    joint = machine.joints["bearing"]
    centred = replace(joint, eccentricity=tuple(rest.z[rest.system.films[0].xi[:2]]))
    machine = replace(machine, joints=machine.joints | {"bearing": centred})
    steps = {"tolerance": 1e-5, "periodicity": 1e-4, "cycles": 60, "order": 2}
    multiplier = ehd.multiplier(ehd.simulate(machine, period=PERIOD, **steps))
    point = rotor_map_of([lambda speed: machine], [SPEED]).points[0]
    expected = np.exp(point.largest_real_part * PERIOD)
    figure("rotor maps", "multiplier of a cycle in time in an elastic bore, least stable mode",
           abs(abs(multiplier.value) / expected - 1.0), most=2e-3, unit="%")  # fmt: skip
