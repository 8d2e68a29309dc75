"""Equations of one implicit step of a mechanism and its films.

Unknowns u are those of every film, one film after the other (`film_models`), then ``(z, l, m)``:
coordinates, and multipliers on position and velocity level (`mechanism`). Equations are those of
the films, then motion, constraints, and constraints on velocities.

Shear of the oil in a joint gives generalised forces Q on the joint's coordinates xi and a torque T
on the shaft. The velocities v_2 of the bore and v_1 of the shaft along the circumference are linear
in the rates xi' and in the speed Omega of the shaft relative to the bore (`JointFilm`). Q and T
have the power of the shear stresses tau_2 and tau_1 of `fenics_ehd.film.forces`,

    Q . xi' + T Omega = int tau_2 v_2 + tau_1 v_1 dA.

To round-off, shear and pressure together therefore take from the mechanism the power that the oil
dissipates: with ``U = v_1 - v_2``

    int p dh/dt dA + Q . xi' + T Omega = -int h^3 / (12 eta) |grad p|^2 + theta eta U^2 / h dA.

The power depends on relative motion alone, so that action equals reaction: -T acts on the body with
the bore. T is the shaft's friction torque of `fenics_ehd.film.forces` up to c / R. The resultant on
the body with the bore is ``-int tau_1 t dA``; ``int tau_2 t dA`` would belong to a gap with the
terms of the tangential eccentricity e_t, which are neglected here. The difference is c / R of the
resultant of the pressure, like the forces of these terms. The derivatives of the shear are
neglected, because they are c / R of those of the pressure, too: every iteration still reduces the
error by a factor of about 1e-3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.errors import GapClosedError
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
from fenics_ehd.multibody.static_correction import PatternResponses

#: Changes of the gap at the Gauss points of every film [m], and their rates [m/s].
GapChanges = Sequence[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class FilmFriction:
    """Friction of a film: forces of the oil's shear on the two bodies of a joint.

    Attributes
    ----------
    on_xi
        Generalised forces on the coordinates xi of the joint, shape (n,).
    torque
        Torque on the shaft about its axis [N m], negative if it brakes a shaft that turns in the
        positive sense; the opposite torque acts on the body with the bore.
    sheared
        Power lost to shear, ``int theta eta U^2 / h dA`` [W]; between rough surfaces all losses
        except those of the pressure flow.
    sheared_fraction
        Fraction theta of the width in which oil is sheared, at the Gauss points.
    """

    on_xi: np.ndarray
    torque: float
    sheared: float
    sheared_fraction: np.ndarray


def film_friction(
    journal: JointFilm, state: FilmState, sheared_fraction: np.ndarray | None = None
) -> FilmFriction:
    """Forces and losses of the oil's shear in the film of a joint, in a solved state.

    The sheared fraction is computed from the state unless it is given.
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
        # Power of the shear stress of the pressure in excess of the drag in `Film.powers`. Between
        # smooth surfaces it is zero, because ``h dp/dy`` gives both.
        flow = film.equation.flow(gap)
        carried = p.clearance * p.rate * p.grid.radius * flow.thickness * flow.velocity
        difference = deep * gap.mean_velocity - carried
        sheared += np.sum(area * fields.slope_around * difference)
    # tau_1 + tau_2 acts on the mean velocity, (tau_1 - tau_2) / 2 on the sliding velocity.
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
    """Equations of a step evaluated at one iterate of Newton's method.

    Attributes
    ----------
    drift
        Multipliers of the m constraints on velocity level, shape (m,).
    films
        Equations of every film evaluated at the iterate.
    motion
        Equations of motion evaluated at the iterate.
    rest
        Residual of the n equations of motion and of the m constraints on position and on velocity
        level, shape (n + 2 m,).
    """

    drift: np.ndarray
    films: list[FilmPoint]
    motion: Motion
    rest: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Residual of all equations of the step, the equations of the films first."""
        return np.concatenate([*(film.defect for film in self.films), self.rest])


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivatives of the equations of a step at one iterate of Newton's method.

    Attributes
    ----------
    films
        Derivatives of every film's equations, and its coupling with motion and bores.
    core
        Matrix S of motion, constraints, patterns and contact, see `fenics_ehd.multibody.border`.
    """

    films: list[FilmBlock]
    core: np.ndarray


class StepEquations:
    """Equations of a step of one mechanism and its films.

    Parameters
    ----------
    system
        The mechanism.
    weights
        Weights W in the rates ``z' = shift z + past - W G^T m`` of the coordinates, shape (n,); m
        are multipliers. None for the weights of the system.

    Attributes
    ----------
    films
        Models of all films.
    couplings
        Couplings of all films with motion and bores.
    conserves_oil
        Whether at least one film has mass-conserving cavitation.
    film_indices, rest
        Indices, among the unknowns u, of every film's unknowns, and of the coordinates and
        multipliers ``(z, l, m)``.
    rest_size
        Number of coordinates and multipliers ``(z, l, m)``.
    most_patterns
        Largest number of residual patterns of a body.
    lower
        Lower bounds of the unknowns u, shape (count,).
    responses
        Responses of bores with films through their residual patterns.
    contacts
        Asperity contact in the joints with rough surfaces.
    sheared_fraction
        Sheared fractions that are frozen for this step, by name of the joint.
    """

    def __init__(self, system: System, *, weights: np.ndarray | None = None):
        self.system = system
        self._weights = system.weights if weights is None else weights
        self.responses = PatternResponses(system)
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
        """Set the largest number of residual patterns of a body that the derivatives retain."""
        self._retained = count
        patterns = self.responses.retained_patterns(count)
        for coupling, (gap, amplitudes) in zip(self.couplings, patterns, strict=True):
            coupling.retain_patterns(gap, amplitudes)

    def resting(self, z: np.ndarray) -> np.ndarray:
        """Entries of the initial state after those of the coordinates z.

        They are zeros for the amplitudes of the residual patterns, and the initial oil contents.
        """
        contents = [film.content.initial(z) for film in self.films]
        return np.concatenate([np.zeros(self.responses.size), *contents])

    def unknowns_at(self, state: np.ndarray, gaps: list[np.ndarray]) -> np.ndarray:
        """Unknowns u with the void fractions of a state, and zero in all other entries.

        `gaps` are the observed gaps of every film in this state [m].
        """
        u = np.zeros(len(self.lower))
        for film, indices, gap in zip(self.films, self.film_indices, gaps, strict=True):
            void = film.content.void_fractions(state, gap)
            u[indices] = film.unknowns(np.zeros(film.film.assembly.size), void)
        return u

    def begin(self, step: ImplicitStep, gap_changes: GapChanges = ()) -> None:
        """Set the time step whose equations are evaluated.

        Parameters
        ----------
        step
            Time integration formula of the step.
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
        """Volume of oil in every film for a state and its observed gaps, shape (films,) [m^3]."""
        each = zip(self.films, gaps, strict=True)
        return np.array([film.content.oil(state, gap) for film, gap in each])

    def keep_within(self, states: np.ndarray, gaps: list[np.ndarray]) -> None:
        """Correct oil contents in extrapolated states, see `FilmContent.keep_within`."""
        for film, gap in zip(self.films, gaps, strict=True):
            film.content.keep_within(states, gap)

    def evaluate(self, u: np.ndarray) -> Point:
        """Evaluate all equations at unknowns u.

        Raises
        ------
        GapClosedError
            If a gap is not positive at a Gauss point.
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
            try:
                check_gap(gaps[i], binding.film.film.parameters.surfaces)
            except GapClosedError as error:
                raise GapClosedError(f"joints.{binding.name}: {error}") from None
            film = self.films[i].evaluate(gaps[i], unknowns[i])
            point = replace(film, contact=contacts[i], turning=binding.turning_rows(z, rates))
            self.contacts.subtract_from_residual(i, point, residual)
            films.append(point)
            self._subtract_from_residual(i, point, residual)
        parts = [residual, instant.defect, instant.rate_defect(rates)]
        return Point(drift, films, motion, np.concatenate(parts))

    def freeze_sheared_fraction(self) -> None:
        """Freeze the sheared fraction of every film at its next evaluation, for this step.

        The sheared fraction jumps when a node cavitates, so that active set and sheared fraction
        may cycle.
        """
        self._freezing = True

    def _subtract_from_residual(self, i: int, point: FilmPoint, residual: np.ndarray) -> None:
        """Subtract the forces of film i, pressure and friction, from the residual of motion."""
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
        """Derivatives of the equations of the step at one iterate of Newton's method.

        If `former` derivatives are given, only the films' matrices A and W are computed again.
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
        """Derivative of the rates with respect to coordinates and multipliers (z, l, m).

        The rates of the coordinates are ``shift z + past - W G^T m``. The shape is (n, n + 2 m).
        """
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
        """Core matrix S with the blocks of motion and constraints, shape (size, size).

        Unknowns of residual patterns and contact have ones on the diagonal.
        """
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
        """Changes of gaps and film equations due to changes of nodal pressures [Pa] and unknowns x.

        Returns
        -------
        changes
            Changes of the gap at the Gauss points of every film [m].
        residuals
            Changes of every film's equations due to residual patterns that the derivatives do not
            retain; None if all are retained.
        """
        inputs = [block.spread @ x for block in blocks]
        changes = [block.gap @ values for block, values in zip(blocks, inputs, strict=True)]
        responses = self.responses
        if self._retained >= self.most_patterns:
            return changes, None
        # The retained patterns are unknowns in x.
        missing = responses.gap_change_from_pressure(pressures, self._retained)
        residuals = [np.zeros(film.pattern.size) for film in self.films]
        for i, (coupling, block) in enumerate(zip(self.couplings, blocks, strict=True)):
            if responses.bodies_of(i):
                change = missing[responses.points[i]]
                changes[i] = changes[i] + change
                residuals[i] = coupling.model.rows(block.along_gap @ change)
        return changes, residuals

    def state(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """State x of the time integration at an iterate, and its rate.

        The state has the coordinates z, the amplitudes y of the residual patterns, and the oil
        contents of all films.
        """
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
    """Subtract a torque on the journal [N m] and its opposite on the bore from the residual."""
    residual[binding.turning] -= binding.signs * torque
