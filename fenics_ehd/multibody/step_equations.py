"""All equations of one implicit step of a mechanism and its films.

Unknowns are the dimensionless pressures at the free nodes of every film, then ``(z, l, m)``:
coordinates and multipliers on position and velocity level (`system`). Equations are the films',
over their sources, then motion, constraints, and constraints on velocities.

The derivative of the oil's shear, where it acts, is left out: it is c / R of the pressure's, so
that every iteration still shrinks the error by about 1e-3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import sparse

from fenics_ehd.film import FilmState
from fenics_ehd.film.cavitation import CavitationResult, Complementarity
from fenics_ehd.film.film import check_gap
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.border import FilmBorder, FilmMatrix
from fenics_ehd.multibody.flexibility import Answer, BodyFlexibility
from fenics_ehd.multibody.friction import film_friction
from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.multibody.newton import ImplicitStep
from fenics_ehd.multibody.planar_body import FlexibleBody
from fenics_ehd.multibody.system import FilmPlace, Motion, System

#: Rows over columns below which a product with all columns is cheaper than to pick them first.
FEW = 0.25


@dataclass(frozen=True, eq=False)
class FilmPoint:
    """One film at one evaluation.

    Attributes
    ----------
    nodal
        Dimensionless pressure at all nodes.
    gap, problem
        See `Film`.
    defect
        Scaled equations, shape (m,).
    """

    nodal: np.ndarray
    gap: Gap
    problem: Complementarity
    defect: np.ndarray


@dataclass(frozen=True, eq=False)
class Point:
    """One evaluation of all equations.

    Attributes
    ----------
    z, rates, accelerations
        Coordinates, v and v', shape (n,).
    multipliers, drift
        l and m, shape (m,) each.
    films
        Every film.
    motion
        See `Motion`.
    rest
        Residual of all equations but the films', shape (n + 2 m,).
    """

    z: np.ndarray
    rates: np.ndarray
    accelerations: np.ndarray
    multipliers: np.ndarray
    drift: np.ndarray
    films: list[FilmPoint]
    motion: Motion
    rest: np.ndarray


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivatives at a point: matrix and border of every film, and the core."""

    matrices: list[FilmMatrix]
    borders: list[FilmBorder]
    core: np.ndarray


@dataclass(frozen=True, eq=False)
class _Columns:
    """What does not change in the border of one film.

    Attributes
    ----------
    gap
        Gap change at the Gauss points for unit xi, shaft's angle and leading patterns, shape
        (g, n + 1 + k).
    velocity
        Mean velocity for unit rates of xi and of the shaft's angle, shape (g, n + 1).
    forces
        Minus the force of unit pressures at free nodes on xi, shape (n, m).
    shares
        Minus the leading patterns' share of such pressures, shape (k, m); None: no patterns.
    """

    gap: np.ndarray
    velocity: np.ndarray
    forces: np.ndarray
    shares: np.ndarray | None

    @classmethod
    def of(cls, joint: JointFilm, flexibility: BodyFlexibility | None, count: int) -> _Columns:
        """With so many leading patterns."""
        free, scale = joint.film.free, joint.film.parameters.pressure_scale
        turning = np.full((len(joint.thickness), 1), 0.5 * joint.shaft_radius)
        velocity = np.hstack([joint.mean_velocity, turning])
        gap = np.hstack([joint.thickness, np.zeros_like(turning)])
        forces = -scale * joint.load[:, free]
        if flexibility is None:
            return cls(gap, velocity, forces, None)
        shapes, shares = flexibility.leading(min(count, flexibility.size))
        return cls(np.hstack([gap, shapes]), velocity, forces, -scale * shares[:, free])

    @property
    def leading(self) -> int:
        """Number k of leading patterns."""
        return 0 if self.shares is None else len(self.shares)


class StepEquations:
    """Equations of one step after another of one mechanism.

    Parameters
    ----------
    system
        The mechanism.
    dense_limit
        Free nodes of a film up to which its matrix is dense, its bore's answer in it; above that
        the derivatives have the leading residual patterns only.

    Attributes
    ----------
    sizes
        Free nodes of every film.
    dense
        Whether its matrix is.
    flexibilities
        Residual patterns of the bore of every film, None where there are none.
    """

    def __init__(self, system: System, *, dense_limit: int):
        self.system = system
        self.sizes = [len(place.film.film.free) for place in system.films]
        self.dense = [size <= dense_limit for size in self.sizes]
        self.flexibilities = [_flexibility(system, place) for place in system.films]
        films = [place.film.film for place in system.films]
        # Of unit pressures at free nodes, and of the pressures that are given.
        self._answer_matrices = [
            np.ascontiguousarray(f.answer_matrix[:, film.free]) if f and dense else None
            for f, film, dense in zip(self.flexibilities, films, self.dense, strict=True)
        ]
        self._given = [
            f.moved(film.parameters.pressure_scale * film.equation.given) if f else np.zeros(0)
            for f, film in zip(self.flexibilities, films, strict=True)
        ]
        self.lead(0)

    def lead(self, count: int) -> None:
        """Take so many residual patterns of every sparse film into the derivatives."""
        self._columns = [
            _Columns.of(place.film, None if dense else flexibility, count)
            for place, flexibility, dense in zip(
                self.system.films, self.flexibilities, self.dense, strict=True
            )
        ]

    @property
    def most_patterns(self) -> int:
        """Residual patterns of the sparse film that has most of them."""
        return max(
            (
                f.size
                for f, dense in zip(self.flexibilities, self.dense, strict=True)
                if f and not dense
            ),
            default=0,
        )

    @property
    def rest_size(self) -> int:
        """Unknowns beside the pressures."""
        return self.system.n + 2 * self.system.m

    @property
    def patterns(self) -> int:
        """All residual patterns: unknowns behind z in the state."""
        return sum(f.size for f in self.flexibilities if f is not None)

    def begin(self, step: ImplicitStep) -> None:
        """Take the equations of another step."""
        n = self.system.n
        self._step = replace(step, past_x=step.past_x[:n], past_rate=step.past_rate[:n])
        self.scales: list[float] = []
        self._holding = False
        self._filled: dict[str, np.ndarray] = {}
        self._answers: list[Answer | None] = []
        place = n
        for flexibility in self.flexibilities:
            if flexibility is None:
                self._answers.append(None)
                continue
            past = step.past_x[place : place + flexibility.size]
            self._answers.append(flexibility.answer(step.shift, past))
            place += flexibility.size
        # What is left without pressure, and its rate: both are multiples of the past.
        self._resting = [
            None if f is None or a is None else f.outward(a.share * a.past)
            for f, a in zip(self.flexibilities, self._answers, strict=True)
        ]

    def evaluate(self, pressures: list[np.ndarray], rest: np.ndarray) -> Point:
        """All equations at one point: dimensionless pressures at free nodes, and ``(z, l, m)``.

        Raises
        ------
        GapClosedError
            A gap is not positive at a Gauss point.
        """
        system, step = self.system, self._step
        n, m = system.n, system.m
        z, multipliers, drift = rest[:n], rest[n : n + m], rest[n + m :]
        instant = system.at(step.time, z)
        rates = step.shift * z + step.past_x - system.weights * (drift @ instant.jacobian)
        accelerations = step.shift * rates + step.past_rate
        motion = instant.motion(rates, accelerations, multipliers)
        residual = motion.residual.copy()
        films = []
        for i, place in enumerate(system.films):
            point = self._film(i, place, pressures[i], z, rates)
            films.append(point)
            self._load(place, point, residual)
        parts = [residual, instant.defect, instant.rate_defect(rates)]
        return Point(
            z, rates, accelerations, multipliers, drift, films, motion, np.concatenate(parts)
        )

    def _film(
        self, i: int, place: FilmPlace, pressure: np.ndarray, z: np.ndarray, rates: np.ndarray
    ) -> FilmPoint:
        film = place.film.film
        nodal = film.equation.nodal(pressure)
        gap = place.film.gap(z[place.xi], rates[place.xi], place.shaft_rate(rates))
        resting, answer, flexibility = self._resting[i], self._answers[i], self.flexibilities[i]
        if flexibility is not None and answer is not None and resting is not None:
            moved = self.moved(i, pressure) + answer.share * self._given[i]
            shape = gap.thickness.shape
            change = moved - flexibility.damping_time * resting
            rate = answer.shift * moved + resting
            gap = replace(
                gap,
                thickness=gap.thickness + change.reshape(shape),
                thickness_rate=gap.thickness_rate + rate.reshape(shape),
            )
        check_gap(gap)
        problem = film.equation.problem(gap)
        if len(self.scales) <= i:
            self.scales.append(problem.scale)
        return FilmPoint(
            nodal, gap, problem, film.cavitation.defect(problem, pressure) / self.scales[i]
        )

    def hold_filled(self) -> None:
        """Keep the sheared share of every film as the next evaluation has it, for this step.

        It jumps where a point cavitates: active set and share may chase each other for ever.
        """
        self._holding = True

    def moved(self, i: int, free: np.ndarray) -> np.ndarray:
        """Gap change that the patterns answer to dimensionless pressures at free nodes [m]."""
        flexibility, answer = self.flexibilities[i], self._answers[i]
        assert flexibility is not None
        assert answer is not None
        pressure = answer.share * self.system.films[i].film.film.parameters.pressure_scale * free
        matrix = self._answer_matrices[i]
        return flexibility.moved(self._nodal(i, pressure)) if matrix is None else matrix @ pressure

    def _nodal(self, i: int, free: np.ndarray) -> np.ndarray:
        """Changes at all nodes of a film from those at the free ones."""
        film = self.system.films[i].film.film
        nodal = np.zeros(film.assembly.size)
        nodal[film.free] = free
        return nodal

    def _load(self, place: FilmPlace, point: FilmPoint, residual: np.ndarray) -> None:
        """Take the film's forces from the residual of motion."""
        film = place.film
        residual[place.xi] -= film.load @ (film.film.parameters.pressure_scale * point.nodal)
        if not film.friction:
            return
        friction = film_friction(film, self.film_state(place, point), self._filled.get(place.name))
        if self._holding:
            self._filled[place.name] = friction.filled
        residual[place.xi] -= friction.on_xi
        if place.journal_angle is not None:
            residual[place.journal_angle] -= friction.torque
        if place.bore_angle is not None:
            residual[place.bore_angle] += friction.torque

    @staticmethod
    def film_state(place: FilmPlace, point: FilmPoint) -> FilmState:
        """The film's state as it is known at a point."""
        film = place.film.film
        free = point.nodal[film.free]
        result = CavitationResult(free, point.defect, np.flatnonzero(free > 0.0), 0)
        pressure = film.parameters.pressure_scale * point.nodal
        return FilmState(pressure, point.gap, result, point.problem)

    def linearise(self, point: Point) -> Derivative:
        """Derivatives at a point."""
        system, shift = self.system, self._step.shift
        n, m, weights = system.n, system.m, system.weights[:, None]
        jacobian, parts = point.motion.instant.jacobian, point.motion.derivatives()
        leading = [columns.leading for columns in self._columns]
        size = self.rest_size
        core = np.zeros((size + sum(leading),) * 2)
        # v = shift z + past - W G^T m.
        speed = np.zeros((n, size))
        speed[:, :n] = shift * np.eye(n) - weights * point.motion.instant.bend(point.drift)
        speed[:, n + m :] = -weights * jacobian.T
        core[:n, :size] = (parts.rate + shift * parts.acceleration) @ speed
        core[:n, :n] += parts.position
        core[:n, n : n + m] = jacobian.T
        core[n : n + m, :n] = jacobian
        core[n + m : size, :size] = jacobian @ speed
        core[n + m : size, :n] += point.motion.carry()
        core[size:, size:] = np.eye(len(core) - size)
        matrices, borders, place = [], [], size
        for i, film in enumerate(system.films):
            own = slice(place, place + leading[i])
            borders.append(self._border(i, film, point.films[i], speed, own, len(core)))
            problem, free = point.films[i].problem, film.film.film.free
            entries = problem.entries(point.films[i].nodal[free]) / self.scales[i]
            answer, own_answer = None, self._answers[i]
            if self.dense[i] and own_answer is not None:
                share = own_answer.share * film.film.film.parameters.pressure_scale
                along_gap = (share / self.scales[i]) * borders[-1].along_gap
                answer = partial(self._answer_block, i, along_gap)
            pattern = film.film.film.assembly.pattern
            matrices.append(FilmMatrix(pattern, entries, problem.weights, answer))
            place += leading[i]
        return Derivative(matrices, borders, core)

    def _answer_block(
        self, i: int, along_gap: sparse.csc_matrix, rows: np.ndarray, columns: np.ndarray
    ) -> np.ndarray:
        """What pressures at some free nodes do to the equations at others by the bore's answer."""
        film, matrix = self.system.films[i].film.film, self._answer_matrices[i]
        assert matrix is not None
        reached = film.assembly.restrict(along_gap, film.free[rows])
        if len(rows) < FEW * len(columns):
            return (reached @ matrix)[:, columns]
        return reached @ np.take(matrix, columns, axis=1)

    def _border(
        self,
        i: int,
        place: FilmPlace,
        point: FilmPoint,
        speed: np.ndarray,
        patterns: slice,
        size: int,
    ) -> FilmBorder:
        """Of one film; the rates of xi follow xi alone: their share of the drift is tiny."""
        film, shift, n = place.film.film, self._step.shift, place.film.size
        along_h, along_v = film.equation.gap_slopes(point.gap, point.nodal, shift)
        columns = self._columns[i]
        inputs, velocity = along_h @ columns.gap, along_v @ columns.velocity
        inputs[:, :n] += shift * velocity[:, :n]
        inputs[:, n] += velocity[:, n]
        spread = np.zeros((inputs.shape[1], size))
        spread[np.arange(n), place.xi] = 1.0
        if place.journal_angle is not None:
            spread[n, : speed.shape[1]] += speed[place.journal_angle]
        if place.bore_angle is not None:
            spread[n, : speed.shape[1]] -= speed[place.bore_angle]
        outputs, rows = columns.forces, place.xi
        answer = self._answers[i]
        if columns.shares is not None and answer is not None:
            outputs = np.vstack([outputs, answer.share * columns.shares])
            rows = np.concatenate([rows, np.arange(patterns.start, patterns.stop)])
            spread[n + 1 :, patterns] = np.eye(patterns.stop - patterns.start)
        inputs = inputs[film.free] / self.scales[i]
        return FilmBorder(inputs, spread, outputs, rows, patterns, along_h)

    def gap_change(
        self, borders: Sequence[FilmBorder], pressures: list[np.ndarray], x: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray] | None]:
        """What changes of pressures and of all other unknowns x do to the films.

        Returns
        -------
        changes
            Of the gap at every film's Gauss points [m].
        left
            Of every film's equations, by patterns left out of the derivatives; None: there are
            none.
        """
        changes, left, any_left = [], [], False
        for i, (place, border) in enumerate(zip(self.system.films, borders, strict=True)):
            change = place.film.thickness @ x[place.xi]
            flexibility, columns = self.flexibilities[i], self._columns[i]
            left.append(np.zeros(self.sizes[i]))
            if flexibility is not None:
                moved = self.moved(i, pressures[i])
                change = change + moved
                if columns.shares is not None and columns.leading < flexibility.size:
                    leading = columns.gap[:, place.film.size + 1 :] @ x[border.patterns]
                    trailing = moved - leading
                    free = place.film.film.free
                    left[-1], any_left = (border.along_gap @ trailing)[free] / self.scales[i], True
            changes.append(change)
        return changes, left if any_left else None

    def state(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """``(z, y)`` and their rates at a point."""
        values, rates = [point.z], [point.rates]
        for flexibility, answer, place, film in zip(
            self.flexibilities, self._answers, self.system.films, point.films, strict=True
        ):
            if flexibility is not None and answer is not None:
                pressure = place.film.film.parameters.pressure_scale * film.nodal
                y = answer.share * flexibility.amplitudes(pressure) + answer.rest
                values.append(y)
                rates.append(answer.shift * y + answer.past)
        return np.concatenate(values), np.concatenate(rates)


def _flexibility(system: System, place: FilmPlace) -> BodyFlexibility | None:
    """Residual patterns of the bore of a film."""
    body = system.mechanism.bodies.get(place.bore_body)
    if not isinstance(body, FlexibleBody) or place.film.bore is None:
        return None
    residual = body.reduced.residual
    if residual is None or not residual.rank:
        return None
    return BodyFlexibility(body.reduced, place.film, body.damping_time)
