"""All equations of one implicit step of a mechanism and its films.

Unknowns are the dimensionless pressures at the free nodes of every film, where oil is conserved
(`conserved_oil`) void fractions too, then ``(z, l, m)``: coordinates and multipliers on position
and velocity level (`system`). Equations are the films', over their sources, then motion,
constraints, and constraints on velocities.

The derivative of the oil's shear, where it acts, is left out: it is c / R of the pressure's, so
that every iteration still shrinks the error by about 1e-3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy import sparse

from fenics_ehd.film import Film, FilmState
from fenics_ehd.film.cavitation import CavitationResult
from fenics_ehd.film.film import check_gap
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.border import FilmBorder
from fenics_ehd.multibody.bore_responses import BoreResponses
from fenics_ehd.multibody.conserved_oil import ConservedOil, conserved_oils
from fenics_ehd.multibody.contact_columns import ContactColumns
from fenics_ehd.multibody.contacts import Contacts
from fenics_ehd.multibody.disturbance import GapChanges, disturb
from fenics_ehd.multibody.film_block import FilmMatrix
from fenics_ehd.multibody.film_columns import FilmColumns, FilmPoint
from fenics_ehd.multibody.film_integrals import FilmIntegrals
from fenics_ehd.multibody.friction import film_friction
from fenics_ehd.multibody.implicit_step import ImplicitStep
from fenics_ehd.multibody.motion import Instant, Motion
from fenics_ehd.multibody.system import FilmPlace, System, consecutive
from fenics_ehd.multibody.turning import turned_border, twist

#: Rows over columns below which a product with all columns is cheaper than to pick them first.
FEW = 0.25


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


class StepEquations:
    """Equations of one step after another of one mechanism.

    Parameters
    ----------
    system
        The mechanism.
    dense_limit
        Free nodes of a film up to which its matrix is dense, its bore's answer in it where no
        other film is on the same body; else the derivatives have the leading residual patterns.

    Attributes
    ----------
    oils, voids
        Of every film, None where Reynolds' condition holds; numbers of the others.
    sizes
        Nodes of every film with an unknown.
    dense
        Whether its matrix is.
    responses
        Residual patterns of the bodies with films that have any.
    contacts
        Of joints with rough surfaces, None where all are smooth.
    filled
        Sheared share of films with friction that is kept for this step, by the joint's name.
    disturbance
        Given changes of the gaps, None in a run.
    """

    def __init__(self, system: System, *, dense_limit: int):
        self.system = system
        free = [len(place.film.film.free) for place in system.films]
        self.dense = [
            n <= dense_limit and place.joint.oil is None
            for n, place in zip(free, system.films, strict=True)
        ]
        self.responses = BoreResponses(system, self.dense)
        self.oils = conserved_oils(system.films, system.n + self.responses.size)
        self.sizes = [
            n if oil is None else len(oil.nodes) for n, oil in zip(free, self.oils, strict=True)
        ]
        self.voids = [i for i, oil in enumerate(self.oils) if oil is not None]
        self.contacts = Contacts.of(system, self.responses)
        self.disturbance: GapChanges | None = None
        self.lead(0)

    def lead(self, count: int) -> None:
        """Take so many residual patterns of every body into the derivatives, where any are."""
        films, responses = self.system.films, self.responses
        self._columns = [
            FilmColumns.of(place, None, oil) for place, oil in zip(films, self.oils, strict=True)
        ]
        for flexibility, matrix in zip(responses.flexibilities, responses.matrices, strict=True):
            if matrix is None:
                leading = flexibility.leading(min(count, flexibility.size))
                for i, patterns in zip(flexibility.films, leading, strict=True):
                    self._columns[i] = FilmColumns.of(films[i], patterns, self.oils[i])

    @property
    def most_patterns(self) -> int:
        """Residual patterns of the body that has most of them in the derivatives."""
        pairs = zip(self.responses.flexibilities, self.responses.matrices, strict=True)
        return max((f.size for f, matrix in pairs if matrix is None), default=0)

    @property
    def rest_size(self) -> int:
        """Unknowns beside those of the films."""
        return self.system.n + 2 * self.system.m

    def resting(self, z: np.ndarray) -> np.ndarray:
        """The state behind coordinates z at the start: patterns at rest, gaps as filled."""
        volumes = [self.oil(i).volumes_at(z) for i in self.voids]
        return np.concatenate([np.zeros(self.responses.size), *volumes])

    def begin(self, step: ImplicitStep) -> None:
        """Take the equations of another step."""
        n = self.system.n
        self._step = replace(step, past_x=step.past_x[:n], past_rate=step.past_rate[:n])
        self.scales: list[float] = []
        self._holding = False
        self.filled: dict[str, np.ndarray] = {}
        self.responses.begin(step)
        if self.contacts is not None:
            self.contacts.begin()
        for i in self.voids:
            oil, xi = self.oil(i), self.system.films[i].xi
            # What is constant in the gap is part of its past, too.
            constant = (1.0 + step.shift) * oil.affine_gap(np.zeros(len(xi)))
            past = oil.affine_gap(step.past_x[xi], self.responses.past_gap(i)) - constant
            oil.begin(step, past)

    def contents(self, state: np.ndarray, gaps: list[np.ndarray]) -> list[float]:
        """Oil of the films of `voids` in a state of given gaps, where observed [m^3]."""
        return [self.oil(i).content(state, gaps[i]) for i in self.voids]

    def keep_within(self, states: np.ndarray, gaps: list[np.ndarray]) -> None:
        """Bring void volumes of the first of some states back into its gaps, the others along."""
        for i in self.voids:
            change = self.oil(i).within_gap(states[0], gaps[i])
            states[:, self.oil(i).volumes] += change

    def oil(self, i: int) -> ConservedOil:
        """Of one of `voids`."""
        oil = self.oils[i]
        assert oil is not None
        return oil

    def pressures(self, values: list[np.ndarray]) -> list[np.ndarray]:
        """Pressures at the free nodes of every film from those at all nodes with an unknown."""
        if not self.voids:
            return values
        pairs = zip(values, self.oils, strict=True)
        return [own if oil is None else own[oil.inside] for own, oil in pairs]

    def evaluate(
        self,
        pressures: list[np.ndarray],
        rest: np.ndarray,
        voids: Mapping[int, np.ndarray] = MappingProxyType({}),
    ) -> Point:
        """All equations at one point: dimensionless pressures, ``(z, l, m)``, and void fractions.

        Raises
        ------
        GapClosedError
            A gap is not positive at a Gauss point.
        """
        system, step = self.system, self._step
        n, m = system.n, system.m
        z, multipliers, drift = rest[:n], rest[n : n + m], rest[n + m :]
        instant = Instant(system, step.time, z)
        rates = step.shift * z + step.past_x - system.weights * (drift @ instant.jacobian)
        accelerations = step.shift * rates + step.past_rate
        motion = Motion(instant, rates, accelerations, multipliers)
        residual = motion.residual.copy()
        gaps = [
            place.film.gap(z[place.xi], rates[place.xi], place.ahead(rates), place.ahead(z))
            for place in system.films
        ]
        self.responses.add(self.pressures(pressures), gaps)
        if self.disturbance is not None:
            disturb(gaps, self.disturbance)
        for i, place in enumerate(system.films):
            if place.film.film.parameters.feeds:
                gaps[i] = replace(gaps[i], turn=place.ahead(z), time=step.time)
        touches = None if self.contacts is None else self.contacts.touch(gaps)
        films = []
        for i, place in enumerate(system.films):
            point = self._film(i, place, pressures[i], gaps[i], voids.get(i))
            if place.film.shape is not None:
                turned = place.film.shape.turned(place.ahead(z), place.ahead(rates))
                point = replace(point, turned=turned)
            if touches is not None and self.contacts is not None:
                point = replace(point, touch=touches[i])
                self.contacts.take(i, point, residual)
            films.append(point)
            self._load(place, point, residual)
        parts = [residual, instant.defect, instant.rate_defect(rates)]
        return Point(
            z, rates, accelerations, multipliers, drift, films, motion, np.concatenate(parts)
        )

    def _film(
        self, i: int, place: FilmPlace, pressure: np.ndarray, gap: Gap, void: np.ndarray | None
    ) -> FilmPoint:
        film = place.film.film
        check_gap(gap, film.parameters.surfaces)
        if void is not None:
            oil = self.oil(i)
            balanced, defect, oil_point = oil.evaluate(gap, pressure, void)
            if len(self.scales) <= i:
                self.scales.append(1.0)
            return FilmPoint(oil.balance.nodal(pressure), gap, balanced, defect, oil=oil_point)
        problem = film.equation.problem(gap)
        if len(self.scales) <= i:
            self.scales.append(problem.scale)
        nodal = film.equation.nodal(pressure)
        return FilmPoint(
            nodal, gap, problem, film.cavitation.defect(problem, pressure) / self.scales[i]
        )

    def hold_filled(self, filled: Mapping[str, np.ndarray] = MappingProxyType({})) -> None:
        """Keep the sheared share of every film as the next evaluation has it, for this step.

        It jumps where a point cavitates: active set and share may chase each other for ever. Some
        may be given, by the joint's name.
        """
        self._holding = True
        self.filled |= filled

    def _load(self, place: FilmPlace, point: FilmPoint, residual: np.ndarray) -> None:
        """Take the film's forces from the residual of motion."""
        film = place.film
        pressure = film.film.parameters.pressure_scale * point.nodal
        residual[place.xi] -= film.load @ pressure
        if point.turned is not None:
            _twist(place, float(point.turned.torque @ pressure), residual)
        if not film.friction:
            return
        friction = film_friction(film, self.film_state(place, point), self.filled.get(place.name))
        if self._holding:
            self.filled[place.name] = friction.filled
        residual[place.xi] -= friction.on_xi
        _twist(place, friction.torque, residual)

    @staticmethod
    def film_state(place: FilmPlace, point: FilmPoint) -> FilmState:
        """The film's state as it is known at a point."""
        film = place.film.film
        free = point.nodal[film.free]
        result = CavitationResult(free, point.defect, np.flatnonzero(free > 0.0), 0)
        pressure = film.parameters.pressure_scale * point.nodal
        fraction = None if point.oil is None else 1.0 - point.oil.nodal_void
        return FilmState(pressure, point.gap, result, point.problem, fraction)

    def integrals(self, states: Sequence[FilmState]) -> list[FilmIntegrals]:
        """Of every film in a state."""
        places = self.system.films
        contacts = [None] * len(places) if self.contacts is None else self.contacts.joints
        each = zip(places, states, contacts, strict=True)
        return [FilmIntegrals(place.film, state, contact) for place, state, contact in each]

    def linearise(self, point: Point) -> Derivative:
        """Derivatives at a point."""
        system, shift = self.system, self._step.shift
        n, m, weights = system.n, system.m, system.weights[:, None]
        jacobian, parts = point.motion.instant.jacobian, point.motion.derivatives()
        size = self.rest_size
        responses = self.responses
        patterns = consecutive(
            size, [self._columns[f.films[0]].leading for f in responses.flexibilities]
        )
        last, contact = patterns[-1].stop if patterns else size, None
        if self.contacts is not None:
            contact = ContactColumns(self.contacts, responses, system.films, point.films, last)
            last = contact.size
        core = np.zeros((last,) * 2)
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
        if contact is not None:
            contact.enter(core, speed)
        matrices, borders = [], []
        for i, place in enumerate(system.films):
            film, own, scale = place.film.film, point.films[i], self.scales[i]
            body = responses.of_film(i)
            share = 0.0 if body is None else responses.share(body)
            places = slice(size, size) if body is None else patterns[body]
            border = self._columns[i].border(own, scale, shift, speed, places, share, len(core))
            if contact is not None:
                border = contact.extend(i, border, scale, self._columns[i])
            answer = None
            if body is not None and (matrix := responses.matrices[body]) is not None:
                along_gap = (share * film.parameters.pressure_scale / scale) * border.along_gap
                answer = partial(_answer_block, film, matrix, along_gap)
            if own.turned is not None:
                border = turned_border(self._columns[i], own, own.turned, border, scale, speed)
                twist(place, own, own.turned, core)
            if own.oil is None:
                entries = own.problem.entries(own.nodal[film.free]) / scale
                pattern, weights_of_film = film.assembly.pattern, own.problem.weights
            else:
                entries = own.problem.entries(own.oil.values)
                pattern, weights_of_film = self.oil(i).balance.pattern, own.oil.transport
            matrices.append(FilmMatrix(pattern, entries, weights_of_film, answer))
            borders.append(border)
        return Derivative(matrices, borders, core)

    def gap_change(
        self, borders: Sequence[FilmBorder], pressures: list[np.ndarray], x: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray] | None]:
        """What changes of pressures at free nodes and of all other unknowns x do to the films.

        Returns
        -------
        changes
            Of the gap at every film's Gauss points [m].
        left
            Of every film's equations, by patterns left out of the derivatives; None: there are
            none.
        """
        places = self.system.films
        changes = [place.film.thickness @ x[place.xi] for place in places]
        for i, border in enumerate(borders):
            if border.slope is not None:
                changes[i] = changes[i] + border.slope * places[i].ahead(x)
        left, any_left = [np.zeros(size) for size in self.sizes], False
        for body, flexibility in enumerate(self.responses.flexibilities):
            moved = flexibility.each(self.responses.moved(body, pressures))
            for i, own in zip(flexibility.films, moved, strict=True):
                columns, border, film = self._columns[i], borders[i], places[i].film
                changes[i] = changes[i] + own
                if columns.shares is not None and columns.leading < flexibility.size:
                    leading = columns.gap[:, film.size + 1 :] @ x[border.patterns]
                    along = border.along_gap @ (own - leading)
                    left[i], any_left = along[columns.nodes] / self.scales[i], True
        for i, border in enumerate(borders):
            if border.contact is not None:
                pressing, moved_by = border.contact
                changes[i] = changes[i] + moved_by @ x[pressing]
        return changes, left if any_left else None

    def state(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """``(z, y)``, void volumes, and their rates at a point."""
        pressures = [
            place.film.film.parameters.pressure_scale * film.nodal
            for place, film in zip(self.system.films, point.films, strict=True)
        ]
        values, rates = self.responses.state(pressures)
        if self.contacts is not None:
            self.contacts.add_amplitudes(point.films, values, rates)
        for i in self.voids:
            oil_point = point.films[i].oil
            assert oil_point is not None
            volumes, change = self.oil(i).volume_rates(oil_point, point.z)
            values, rates = [*values, volumes], [*rates, change]
        return np.concatenate([point.z, *values]), np.concatenate([point.rates, *rates])


def _twist(place: FilmPlace, torque: float, residual: np.ndarray) -> None:
    """Take a torque on the journal, whose opposite is on the bore, from the residual of motion."""
    for angle, sign in place.turning:
        residual[angle] -= sign * torque


def _answer_block(
    film: Film,
    matrix: np.ndarray,
    along_gap: sparse.csc_matrix,
    rows: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    """What pressures at some free nodes do to the equations at others by the bore's answer."""
    reached = film.assembly.restrict(along_gap, film.free[rows])
    if len(rows) < FEW * len(columns):
        return (reached @ matrix)[:, columns]
    return reached @ np.take(matrix, columns, axis=1)
