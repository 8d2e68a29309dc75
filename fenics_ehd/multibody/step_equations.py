"""All equations of one implicit step of a mechanism and its films.

Unknowns u are those of every film, one film after the other (`film_models`), then ``(z, l, m)``:
coordinates and multipliers on position and velocity level (`mechanism`). Equations are the films',
then motion, constraints, and constraints on velocities.

The oil's shear in a journal acts on the coordinates and as a torque on the shaft. The velocities
v_2 of the bore and v_1 of the shaft along the circumference are linear in the rates xi' and in the
speed Omega of the shaft relative to the bore, as the film takes them (`JointFilm`). The tractions
tau_2 and tau_1 of `fenics_ehd.film.forces` do the work on them,

    Q . xi' + T Omega = int tau_2 v_2 + tau_1 v_1 dA,

so that shear and pressure together take from the mechanism what the oil dissipates, to round-off:
with ``U = v_1 - v_2``

    int p dh/dt dA + Q . xi' + T Omega = -int h^3 / (12 eta) |grad p|^2 + theta eta U^2 / h dA.

Being a function of relative motion alone, action is reaction: -T turns the rod. T is the shaft's
friction torque of `fenics_ehd.film.forces` up to c / R. The resultant on the rod is
``-int tau_1 t dA``, where ``int tau_2 t dA`` belongs to a gap that keeps the terms with e_t: the
difference is c / R of the pressure's, as these terms are. The derivative of the shear is left out,
as it is c / R of the pressure's too: every iteration still shrinks the error by about 1e-3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.film.film import FilmState, check_gap
from fenics_ehd.film.forces import film_fields
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.border import FilmBlock
from fenics_ehd.multibody.contact import ContactColumns, Contacts
from fenics_ehd.multibody.film_models import FilmPoint, film_models
from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.multibody.mechanism import FilmBinding, Instant, Motion, System, consecutive
from fenics_ehd.multibody.static_correction import BoreResponses

#: Of every film: change of the gap at the Gauss points and its rate [m], [m/s].
GapChanges = Sequence[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class FilmFriction:
    """Friction of a film: what the oil's shear does to its two bodies.

    Attributes
    ----------
    on_xi
        Generalised forces on the coordinates, shape (n,).
    torque
        On the shaft about its axis [N m], negative when it brakes a shaft that turns in the
        positive sense; its opposite turns the rod.
    sheared
        ``int theta eta U^2 / h dA`` [W]; of rough surfaces all that is lost beside the pressure
        flow.
    sheared_fraction
        Share theta of the width that is sheared, at the Gauss points.
    """

    on_xi: np.ndarray
    torque: float
    sheared: float
    sheared_fraction: np.ndarray


def film_friction(
    journal: JointFilm, state: FilmState, sheared_fraction: np.ndarray | None = None
) -> FilmFriction:
    """Friction of a film whose gap is that of the journal.

    Without a sheared fraction that of the state is computed.
    """
    film = journal.film
    gap = state.gap
    p = film.parameters
    fields = film_fields(film, state, journal.shear_rule)
    area = p.grid.radius**2 * film.assembly.area
    sheared_fraction = fields.sheared_fraction if sheared_fraction is None else sheared_fraction
    thin = deep = gap.thickness
    if p.surfaces is not None:
        thin, deep = p.surfaces.sheared(gap)
    couette = area * sheared_fraction * fields.viscosity * gap.sliding_velocity / thin
    driven = area * deep * fields.slope_around
    sheared = np.sum(couette * gap.sliding_velocity)
    if p.surfaces is not None:
        # What the pressure's stress does beyond the drag of `Film.powers`; between smooth surfaces
        # ``h dp/dy`` does the work of both.
        flow = film.equation.flow(gap)
        carried = p.clearance * p.rate * p.grid.radius * flow.thickness * flow.velocity
        beside = deep * gap.mean_velocity - carried
        sheared += np.sum(area * fields.slope_around * beside)
    # tau_1 + tau_2 acts on the mean velocity, (tau_1 - tau_2) / 2 on the sliding.
    on_xi = -driven.ravel() @ journal.mean_velocity - couette.ravel() @ journal.sliding_velocity
    shaft_radius = p.grid.radius - p.clearance
    return FilmFriction(
        on_xi,
        float(-shaft_radius * (couette.sum() + 0.5 * driven.sum())),
        float(sheared),
        sheared_fraction,
    )


@dataclass(frozen=True, eq=False)
class Point:
    """One evaluation of all equations.

    Attributes
    ----------
    drift
        Multipliers m on velocity level, shape (m,).
    films
        Every film.
    motion
        See `Motion`.
    rest
        Residual of all equations but the films', shape (n + 2 m,).
    """

    drift: np.ndarray
    films: list[FilmPoint]
    motion: Motion
    rest: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Residual of all equations."""
        return np.concatenate([*(film.defect for film in self.films), self.rest])


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivatives at a point: those of every film, and the core."""

    films: list[FilmBlock]
    core: np.ndarray


class StepEquations:
    """Equations of one step after another of one mechanism.

    Parameters
    ----------
    system
        The mechanism.
    weights
        Diagonal of W, shape (n,); None: that of the system.
    gap_changes
        Given changes of all gaps at a time [s], whose consequences are wanted; None in a run.

    Attributes
    ----------
    films
        Models of all films.
    conserves_oil
        Whether one of them conserves its oil.
    places, rest
        Places in u of every film's unknowns, and of ``(z, l, m)``.
    rest_size
        Number of the latter.
    most_patterns
        Residual patterns of the body that has most of them in the derivatives.
    lower
        Lower bounds of u.
    responses
        Residual patterns of the bodies with films that have any.
    contacts
        Of the joints with rough surfaces.
    sheared_fraction
        Sheared share of films with friction that is kept for this step, by the joint's name.
    """

    def __init__(
        self,
        system: System,
        *,
        weights: np.ndarray | None = None,
        gap_changes: Callable[[float], GapChanges] | None = None,
    ):
        self.system = system
        self._weights = system.weights if weights is None else weights
        self._gap_changes = gap_changes
        self.responses = BoreResponses(system)
        self.films = film_models(system.films, system.n + self.responses.size)
        self.conserves_oil = any(film.conserves_oil for film in self.films)
        self.rest_size = system.n + 2 * system.m
        lower = [*(film.lower for film in self.films), np.full(self.rest_size, -np.inf)]
        *self.places, self.rest = consecutive(0, [len(own) for own in lower])
        self.lower = np.concatenate(lower)
        self.contacts = Contacts(system, self.responses)
        self.retain_patterns(0)
        bodies = self.responses.bodies.values()
        self.most_patterns = max((len(body.own) for body in bodies), default=0)

    def retain_patterns(self, count: int) -> None:
        """Take so many residual patterns of every body into the derivatives, where any are."""
        for film, patterns in zip(self.films, self.responses.retained_patterns(count), strict=True):
            film.retain_patterns(*patterns)

    def resting(self, z: np.ndarray) -> np.ndarray:
        """The state behind coordinates z at the start: patterns at rest, initial oil content."""
        volumes = [film.volumes_at(z) for film in self.films]
        return np.concatenate([np.zeros(self.responses.size), *volumes])

    def unknowns_at(self, state: np.ndarray, gaps: list[np.ndarray]) -> np.ndarray:
        """Unknowns u of a state of given gaps, where observed, without pressures and forces."""
        u = np.zeros(len(self.lower))
        for film, own, gap in zip(self.films, self.places, gaps, strict=True):
            void = film.void_fractions(state, gap)
            u[own] = film.values(np.zeros_like(void), void)
        return u

    def begin(self, step: ImplicitStep) -> None:
        """Take the equations of another step."""
        n = self.system.n
        self._step = replace(step, past_x=step.past_x[:n], past_rate=step.past_rate[:n])
        self._holding = False
        self.sheared_fraction: dict[str, np.ndarray] = {}
        self.responses.begin(step)
        self.contacts.begin()
        for i, film in enumerate(self.films):
            film.begin(step, self.responses, i)

    def contents(self, state: np.ndarray, gaps: list[np.ndarray]) -> np.ndarray:
        """Oil of all films in a state of given gaps, see `FilmModel.content`, shape (films,)."""
        each = zip(self.films, gaps, strict=True)
        return np.array([film.content(state, gap) for film, gap in each])

    def keep_within(self, states: np.ndarray, gaps: list[np.ndarray]) -> None:
        """Bring void volumes of the first of some states back into its gaps, the others along."""
        for film, gap in zip(self.films, gaps, strict=True):
            film.keep_within(states, gap)

    def evaluate(self, u: np.ndarray) -> Point:
        """All equations at unknowns u.

        Raises
        ------
        GapClosedError
            A gap is not positive at a Gauss point.
        """
        system = self.system
        step = self._step
        n = system.n
        m = system.m
        rest = u[self.rest]
        z = rest[:n]
        multipliers = rest[n : n + m]
        drift = rest[n + m :]
        instant = Instant(system, step.time, z)
        rates = step.shift * z + step.past_x - self._weights * (drift @ instant.jacobian)
        accelerations = step.shift * rates + step.past_rate
        motion = Motion(instant, rates, accelerations, multipliers)
        residual = motion.residual.copy()
        gaps = [binding.gap(z, rates, step.time) for binding in system.films]
        values = [u[own] for own in self.places]
        self.responses.add(
            [film.pressure(own) for film, own in zip(self.films, values, strict=True)], gaps
        )
        if self._gap_changes is not None:
            changes = self._gap_changes(step.time)
            gaps = [gap.changed(*change) for gap, change in zip(gaps, changes, strict=True)]
        contacts = self.contacts.touch(gaps)
        films = []
        for i, binding in enumerate(system.films):
            check_gap(gaps[i], binding.film.film.parameters.surfaces)
            alone = self.films[i].evaluate(gaps[i], values[i])
            point = replace(alone, contact=contacts[i], rotated=binding.rotated_shape(z, rates))
            self.contacts.subtract_from_residual(i, point, residual)
            films.append(point)
            self._load(i, point, residual)
        parts = [residual, instant.defect, instant.rate_defect(rates)]
        return Point(drift, films, motion, np.concatenate(parts))

    def freeze_sheared_fraction(self) -> None:
        """Keep the sheared share of every film as the next evaluation has it, for this step.

        It jumps where a point cavitates: active set and share may chase each other for ever.
        """
        self._holding = True

    def _load(self, i: int, point: FilmPoint, residual: np.ndarray) -> None:
        """Take a film's forces from the residual of motion."""
        binding = self.system.films[i]
        film = binding.film
        pressure = film.film.parameters.pressure_scale * point.nodal
        residual[binding.xi] -= film.load @ pressure
        if point.rotated is not None:
            _twist(binding, float(point.rotated.torque @ pressure), residual)
        if not film.friction:
            return
        friction = film_friction(
            film, self.films[i].state(point), self.sheared_fraction.get(binding.name)
        )
        if self._holding:
            self.sheared_fraction[binding.name] = friction.sheared_fraction
        residual[binding.xi] -= friction.on_xi
        _twist(binding, friction.torque, residual)

    def linearise(self, point: Point, former: Derivative | None = None) -> Derivative:
        """Derivatives at a point; but for the films' own matrices those of a `former` one."""
        if former is not None:
            each = zip(self.films, former.films, point.films, strict=True)
            films = [film.with_matrix(block, own) for film, block, own in each]
            return Derivative(films, former.core)
        system = self.system
        shift = self._step.shift
        n = system.n
        m = system.m
        weights = self._weights[:, None]
        jacobian = point.motion.instant.jacobian
        parts = point.motion.derivatives()
        size = last = self.rest_size
        patterns = [slice(size, size)] * len(self.films)
        for body in self.responses.bodies.values():
            own = self.films[body.films[0]].retained
            for i in body.films:
                patterns[i] = slice(last, last + own.stop - own.start)
            last += own.stop - own.start
        contact = ContactColumns(self.contacts, self.responses, point.films, last)
        core = np.zeros((contact.size,) * 2)
        # v = shift z + past - W G^T m.
        speed = np.zeros((n, size))
        speed[:, :n] = shift * np.eye(n) - weights * point.motion.instant.force_derivative(
            point.drift
        )
        speed[:, n + m :] = -weights * jacobian.T
        core[:n, :size] = (parts.rate + shift * parts.acceleration) @ speed
        core[:n, :n] += parts.position
        core[:n, n : n + m] = jacobian.T
        core[n : n + m, :n] = jacobian
        core[n + m : size, :size] = jacobian @ speed
        core[n + m : size, :n] += point.motion.carried[1]
        core[size:, size:] = np.eye(len(core) - size)
        contact.enter(core, speed)
        films = []
        for i, film in enumerate(self.films):
            share = float(self.responses.share[self.responses.points[i].start])
            found = film.linearise(point.films[i], shift, speed, patterns[i], share, len(core))
            film.twist(point.films[i], core)
            films.append(contact.extend(i, found, film))
        return Derivative(films, core)

    def gap_change(
        self, derivatives: Sequence[FilmBlock], pressures: list[np.ndarray], x: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray] | None]:
        """Changes of gaps and film equations by changes of pressures [Pa] and of all unknowns x.

        Returns
        -------
        changes
            Of the gap at every film's Gauss points [m].
        left
            Of every film's equations, by patterns left out of the derivatives; None: there are
            none.
        """
        inputs = [own.spread @ x for own in derivatives]
        changes = [own.gap @ given for own, given in zip(derivatives, inputs, strict=True)]
        responses = self.responses
        left = [np.zeros(len(film.nodes)) for film in self.films]
        if not responses.size:
            return changes, None
        any_left = False
        moved = responses.gap_change_from_pressure(pressures)
        for i, (film, derivative) in enumerate(zip(self.films, derivatives, strict=True)):
            body = responses.body_of(i)
            retained = film.retained
            if body is None:
                continue
            missing = moved[responses.points[i]] - derivative.gap[:, retained] @ inputs[i][retained]
            changes[i] = changes[i] + missing
            if retained.stop - retained.start < len(body.own):
                along = derivative.along_gap @ missing
                left[i] = along[film.nodes] / film.scale
                any_left = True
        return changes, left if any_left else None

    def state(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """``(z, y)``, void volumes, and their rates at a point."""
        pressures = [
            film.film.parameters.pressure_scale * own.nodal
            for film, own in zip(self.films, point.films, strict=True)
        ]
        z = point.motion.instant.z
        parts = [(z, point.motion.rates)]
        if self.responses.size:
            forces = self.contacts.forces([own.gap.thickness.ravel() for own in point.films])
            parts.append(self.responses.state(self.responses.static(pressures, forces)))
        for film, own in zip(self.films, point.films, strict=True):
            parts.append(film.volume_rates(own, z))
        x, rates = (np.concatenate(values) for values in zip(*parts, strict=True))
        return x, rates


def _twist(binding: FilmBinding, torque: float, residual: np.ndarray) -> None:
    """Take a torque on the journal, whose opposite is on the bore, from the residual of motion."""
    residual[binding.turning] -= binding.signs * torque
