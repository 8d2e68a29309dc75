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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.film.film import FilmState, check_gap
from fenics_ehd.film.forces import film_fields
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.border import FilmBlock
from fenics_ehd.multibody.contact import ContactColumns, Contacts
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.film_coupling import FilmCoupling
from fenics_ehd.multibody.film_models import film_models
from fenics_ehd.multibody.film_point import FilmPoint
from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.multibody.mechanism import Instant, Motion, System, consecutive
from fenics_ehd.multibody.static_correction import BoreResponses

#: Change of the gap at the Gauss points of every film [m], and its rate [m/s].
GapChanges = Sequence[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class FilmFriction:
    """Friction of a film: forces of the oil's shear on its two bodies.

    Attributes
    ----------
    on_xi
        Generalised forces on the coordinates, shape (n,).
    torque
        On the shaft about its axis [N m], negative when it brakes a shaft that turns in the
        positive sense; its opposite turns the rod.
    sheared
        ``int theta eta U^2 / h dA`` [W]; of rough surfaces all losses but those of the pressure
        flow.
    sheared_fraction
        Fraction theta of the width that is sheared, at the Gauss points.
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
        # Work of the pressure's stress beyond the drag of `Film.powers`, which is zero between
        # smooth surfaces: there ``h dp/dy`` does the work of both.
        flow = film.equation.flow(gap)
        carried = p.clearance * p.rate * p.grid.radius * flow.thickness * flow.velocity
        difference = deep * gap.mean_velocity - carried
        sheared += np.sum(area * fields.slope_around * difference)
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
        Points of all films.
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
    """Equations of the steps of one mechanism.

    Parameters
    ----------
    system
        The mechanism.
    weights
        Weights W of the coordinates in the rates ``z' = shift z + past - W G^T m``, shape (n,);
        None: those of the system.

    Attributes
    ----------
    films
        Models of all films.
    couplings
        Couplings of all films with motion and bores.
    conserves_oil
        Whether the cavitation of a film is mass-conserving.
    film_indices, rest
        Indices in u of every film's unknowns, and of ``(z, l, m)``.
    rest_size
        Number of unknowns ``(z, l, m)``.
    most_patterns
        Largest number of residual patterns of a body.
    lower
        Lower bounds of u.
    responses
        Residual patterns of the bodies with films that have any.
    contacts
        Contact in the joints with rough surfaces.
    sheared_fraction
        Sheared fractions that are frozen for this step, by the name of a joint with friction.
    """

    def __init__(self, system: System, *, weights: np.ndarray | None = None):
        self.system = system
        self._weights = system.weights if weights is None else weights
        self.responses = BoreResponses(system)
        self.films = film_models(system.films, system.n + self.responses.size)
        self.couplings = [FilmCoupling(film) for film in self.films]
        self.conserves_oil = any(film.conserves_oil for film in self.films)
        self.rest_size = system.n + 2 * system.m
        lower = [*(film.lower for film in self.films), np.full(self.rest_size, -np.inf)]
        *self.film_indices, self.rest = consecutive(0, [len(bounds) for bounds in lower])
        self.lower = np.concatenate(lower)
        self.contacts = Contacts(system, self.responses)
        self.retain_patterns(0)
        bodies = self.responses.bodies.values()
        self.most_patterns = max((len(body.amplitudes) for body in bodies), default=0)

    def retain_patterns(self, count: int) -> None:
        """Retain at most `count` residual patterns of every body in the derivatives."""
        self._retained = count
        patterns = self.responses.retained_patterns(count)
        for coupling, (gap, amplitudes) in zip(self.couplings, patterns, strict=True):
            coupling.retain_patterns(gap, amplitudes)

    def resting(self, z: np.ndarray) -> np.ndarray:
        """The state behind coordinates z at the start: patterns at rest, initial oil content."""
        contents = [film.content.initial(z) for film in self.films]
        return np.concatenate([np.zeros(self.responses.size), *contents])

    def unknowns_at(self, state: np.ndarray, gaps: list[np.ndarray]) -> np.ndarray:
        """Unknowns u in a state with observed gaps, without pressures and forces."""
        u = np.zeros(len(self.lower))
        for film, indices, gap in zip(self.films, self.film_indices, gaps, strict=True):
            void = film.content.void_fractions(state, gap)
            u[indices] = film.unknowns(np.zeros(film.film.assembly.size), void)
        return u

    def begin(self, step: ImplicitStep, gap_changes: GapChanges = ()) -> None:
        """Start a step.

        Parameters
        ----------
        step
            Formula of the step.
        gap_changes
            Changes imposed on the gaps of all films, for sensitivities and error budgets.
        """
        n = self.system.n
        self._step = replace(step, past_x=step.past_x[:n], past_rate=step.past_rate[:n])
        self._gap_changes = gap_changes
        self._freezing = False
        self.sheared_fraction: dict[str, np.ndarray] = {}
        self.responses.begin(step)
        self.contacts.start_step()
        for film, points in zip(self.films, self.responses.points, strict=True):
            film.begin(step, self.responses.past_gap[points])

    def contents(self, state: np.ndarray, gaps: list[np.ndarray]) -> np.ndarray:
        """Oil of all films in a state with observed gaps, shape (films,) [m^3]."""
        each = zip(self.films, gaps, strict=True)
        return np.array([film.content.oil(state, gap) for film, gap in each])

    def keep_within(self, states: np.ndarray, gaps: list[np.ndarray]) -> None:
        """Correct the contents of extrapolated states, see `FilmContent.keep_within`."""
        for film, gap in zip(self.films, gaps, strict=True):
            film.content.keep_within(states, gap)

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
        unknowns = [u[indices] for indices in self.film_indices]
        each = zip(self.films, unknowns, strict=True)
        self.responses.add([film.pressure(values) for film, values in each], gaps)
        for i, change in enumerate(self._gap_changes):
            gaps[i] = gaps[i].changed(*change)
        contacts = self.contacts.at_gaps(gaps)
        films = []
        for i, binding in enumerate(system.films):
            check_gap(gaps[i], binding.film.film.parameters.surfaces)
            film = self.films[i].evaluate(gaps[i], unknowns[i])
            point = replace(film, contact=contacts[i], turning=binding.turning_rows(z, rates))
            self.contacts.subtract_from_residual(i, point, residual)
            films.append(point)
            self._subtract_from_residual(i, point, residual)
        parts = [residual, instant.defect, instant.rate_defect(rates)]
        return Point(drift, films, motion, np.concatenate(parts))

    def freeze_sheared_fraction(self) -> None:
        """Freeze the sheared fraction of every film at its next evaluation, for this step.

        It jumps where a node cavitates: active set and sheared fraction may cycle.
        """
        self._freezing = True

    def _subtract_from_residual(self, i: int, point: FilmPoint, residual: np.ndarray) -> None:
        """Subtract a film's forces from the residual of motion."""
        binding = self.system.films[i]
        film = binding.film
        pressure = film.film.parameters.pressure_scale * point.nodal
        residual[binding.xi] -= film.load @ pressure
        if point.turning is not None:
            forces = point.turning.load @ pressure
            residual[binding.turning_dofs] -= forces @ binding.turning_map
        if not film.friction:
            return
        frozen = self.sheared_fraction.get(binding.name)
        friction = film_friction(film, self.films[i].state(point), frozen)
        if self._freezing:
            self.sheared_fraction[binding.name] = friction.sheared_fraction
        residual[binding.xi] -= friction.on_xi
        _subtract_torque(binding, friction.torque, residual)

    def linearise(self, point: Point, former: Derivative | None = None) -> Derivative:
        """Derivatives at a point.

        With `former` derivatives only the films' own matrices are computed anew.
        """
        if former is not None:
            each = zip(self.couplings, former.films, point.films, strict=True)
            films = [coupling.with_matrix(block, film) for coupling, block, film in each]
            return Derivative(films, former.core)
        patterns, count = self.responses.pattern_indices(self._retained, self.rest_size)
        contact = ContactColumns(self.contacts, self.responses, point.films, count)
        speed = self._speed_derivative(point)
        core = self._core(point, speed, contact.size)
        contact.add_to_core(core, speed)
        films = []
        for i, coupling in enumerate(self.couplings):
            share = float(self.responses.share[self.responses.points[i].start])
            film = point.films[i]
            shift = self._step.shift
            block = coupling.linearise(film, shift, speed, patterns[i], share, len(core))
            coupling.add_turning_stiffness(film, core)
            films.append(contact.extend(i, block, coupling.model))
        return Derivative(films, core)

    def _speed_derivative(self, point: Point) -> np.ndarray:
        """Derivative of the rates ``shift z + past - W G^T m`` along (z, l, m), shape (n, .)."""
        n = self.system.n
        m = self.system.m
        weights = self._weights[:, None]
        instant = point.motion.instant
        speed = np.zeros((n, self.rest_size))
        along_z = self._step.shift * np.eye(n) - weights * instant.force_derivative(point.drift)
        speed[:, :n] = along_z
        speed[:, n + m :] = -weights * instant.jacobian.T
        return speed

    def _core(self, point: Point, speed: np.ndarray, size: int) -> np.ndarray:
        """Derivative S of motion and constraints; ones on the diagonal of the other unknowns."""
        n = self.system.n
        m = self.system.m
        last = self.rest_size
        jacobian = point.motion.instant.jacobian
        parts = point.motion.derivatives()
        core = np.zeros((size, size))
        core[:n, :last] = (parts.rate + self._step.shift * parts.acceleration) @ speed
        core[:n, :n] += parts.position
        core[:n, n : n + m] = jacobian.T
        core[n : n + m, :n] = jacobian
        core[n + m : last, :last] = jacobian @ speed
        core[n + m : last, :n] += point.motion.carried[1]
        core[last:, last:] = np.eye(size - last)
        return core

    def gap_change(
        self, blocks: Sequence[FilmBlock], pressures: list[np.ndarray], x: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray] | None]:
        """Changes of gaps and film equations by changes of pressures [Pa] and of all unknowns x.

        Returns
        -------
        changes
            Changes of the gap at the Gauss points of every film [m].
        residuals
            Changes of every film's equations by the patterns that the derivatives do not retain;
            None: all are retained.
        """
        inputs = [block.spread @ x for block in blocks]
        changes = [block.gap @ values for block, values in zip(blocks, inputs, strict=True)]
        responses = self.responses
        if not responses.size:
            return changes, None
        residuals = [np.zeros(film.pattern.size) for film in self.films]
        complete = True
        by_pressure = responses.gap_change_from_pressure(pressures)
        for i, (coupling, block) in enumerate(zip(self.couplings, blocks, strict=True)):
            bodies = responses.bodies_of(i)
            if not bodies:
                continue
            retained = coupling.retained_patterns
            by_retained = block.gap[:, retained] @ inputs[i][retained]
            missing = by_pressure[responses.points[i]] - by_retained
            changes[i] = changes[i] + missing
            if retained.stop - retained.start < sum(len(body.amplitudes) for body in bodies):
                residuals[i] = coupling.model.rows(block.along_gap @ missing)
                complete = False
        return changes, None if complete else residuals

    def state(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """``(z, y)``, the contents of all films, and the rates of these values at a point."""
        pressures = [
            film.film.parameters.pressure_scale * film_point.nodal
            for film, film_point in zip(self.films, point.films, strict=True)
        ]
        z = point.motion.instant.z
        parts = [(z, point.motion.rates)]
        if self.responses.size:
            forces = self.contacts.forces([film.gap.thickness.ravel() for film in point.films])
            parts.append(self.responses.state(self.responses.static(pressures, forces)))
        for film, film_point in zip(self.films, point.films, strict=True):
            parts.append(film.content.at_end(film_point, z))
        x, rates = (np.concatenate(values) for values in zip(*parts, strict=True))
        return x, rates


def _subtract_torque(binding: FilmBinding, torque: float, residual: np.ndarray) -> None:
    """Subtract a torque on the journal, its opposite on the bore, from the residual of motion."""
    residual[binding.turning] -= binding.signs * torque
