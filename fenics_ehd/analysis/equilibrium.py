"""Mechanisms at rest: equilibrium under constant loads, and small motions about it.

A mechanism is in equilibrium if its equations hold with constant velocities and constant
coordinates. These are the equations of an implicit step of infinite length, in which the shift
``s = dx' / dx`` of the formula for the rates is zero. Shafts rotate, the centres of journals are at
rest or move with their initial velocities, and the pressure of every film balances its load. If a
bore rotates, the eccentricity rotates backwards in the frame of the bore.

A mechanism that varies with time has no equilibrium. Rotating forces are not included, and a notice
reports them, because they excite motions about the equilibrium. A mechanism is refused if it has
tables over time, parts whose centre of mass moves on a circle, shapes or supplies that rotate, or
shafts without a drive.

The same equations with a shift s, linearised at the equilibrium, give the response to a generalised
force f. On the motions that the joints allow, spanned by the columns of Z, it is
``Z^T dz = C(s) f`` with

    C(s)^-1 = s^2 M + s D + K.

Mass M, damping D and stiffness K contain all films. They are exact derivatives of the discrete
equations with fixed active sets. If an elastic bore has residual patterns, the dynamic stiffness
``H(s) = C(s)^-1`` has poles. D and K are then its expansion for slow motions, and modes and
vibrations are those of H itself (`fenics_ehd.analysis.film_memory`).

The force of a film on the journal changes by ``-(k_f q + d_f q')``. Its coefficients k_f and d_f
follow from the same response: the film force is the multiplier of the constraint between the
eccentricity and the bodies.

If a joint has a heat balance, its film has the effective temperature at which the leaving oil
carries away the dissipated power (`fenics_ehd.film.heat`). In small motions, temperatures are
constant.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import linalg

from fenics_ehd.analysis.film_memory import SampledStiffness, sampled_shifts
from fenics_ehd.base.arguments import require_class, require_number
from fenics_ehd.base.described import Described, unknown_name
from fenics_ehd.base.errors import GapClosedError, HeatError, SettingsError, SolverError
from fenics_ehd.base.renamed import renamed_arguments
from fenics_ehd.film.heat import TemperatureSearch
from fenics_ehd.film.supply import CircumferentialGrooveSupply, Supply
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.body import POSITION, PlanarBody
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.mechanism import (
    Instant,
    Mechanism,
    Motion,
    System,
    assemble,
    unresisted,
)
from fenics_ehd.multibody.newton import CoupledState, CoupledSteps, SolverState
from fenics_ehd.multibody.quantities import JointStep, joint_row
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.surface import BORE

#: Tolerance of Newton's last update: relative to the gaps, and for coordinates in the norm of the
#: step control.
TOLERANCE = 1e-10

#: Weight of coordinates with given velocities; eccentricities, which follow the velocities, have
#: weight 1.
GIVEN = 1e-12

#: Shift over the largest rate of a film with mass-conserving cavitation, which keeps the oil
#: content of its start without a shift.
STEADY = 1e-10

#: Shift over the largest rate of a film, with which damping is computed.
SLOW = 1e-2


@dataclass(frozen=True, eq=False)
class SearchStart(Described):
    """Start of a search for an equilibrium: the solution at another speed or load.

    Attributes
    ----------
    x
        State x of the time integration, whose first n entries are the coordinates z.
    values
        Unknowns of the step equations, shape (u,).
    patterns
        Number of residual patterns of the elastic bodies that the derivatives of the equations
        contain.
    temperatures
        Temperatures of films with a heat balance, by name of the joint [C].
    """

    x: np.ndarray
    values: np.ndarray
    patterns: int = 0
    temperatures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Equilibrium(Described):
    """A mechanism in equilibrium.

    Attributes
    ----------
    system
        Equations of the mechanism, with the indices of its coordinates.
    x, rate
        State x of the time integration, whose first n entries are the coordinates z, and its rate.
    state
        Solution of films and forces in equilibrium.
    iterations
        Number of iterations of Newton's method.
    solver
        Newton solver of the step equations.
    notices
        Notices of the rotating forces that are not included.
    unknowns
        Unknowns of the step equations in equilibrium, from which a later search can start.
    """

    system: System
    x: np.ndarray
    rate: np.ndarray
    state: CoupledState
    iterations: int
    solver: CoupledSteps
    notices: tuple[str, ...] = ()
    unknowns: SolverState | None = None

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield size and iterations, and load, film and pressure of every lubricated joint."""
        yield "Equilibrium", f"{self.system.n} coordinates, {self.iterations} Newton iterations"
        for name, joint in self.joints().items():
            row = joint_row(joint)
            yield (
                name,
                f"force {row['force_N']:.4g} N, "
                f"eccentricity ratio {row['eccentricity_ratio']:.4g}, "
                f"min_film_thickness {1e6 * row['min_film_thickness_m']:.4g} um, "
                f"max_pressure {1e-6 * row['max_pressure_Pa']:.4g} MPa",
            )
        for name, temperature in self.temperatures.items():
            yield f"temperature {name}", f"{temperature:.4g} C"
        for line in self.notices:
            yield "notice", line

    @property
    def z(self) -> np.ndarray:
        """Coordinates of the mechanism, shape (n,)."""
        return self.x[: self.system.n]

    def joints(self) -> dict[str, JointStep]:
        """Lubricated joints in equilibrium, by name."""
        return {joint.binding.name: joint for joint in self.state.joints}

    @property
    def temperatures(self) -> dict[str, float]:
        """Effective temperatures of the films with a heat balance, by name of the joint [C]."""
        temperatures = {}
        for film in self.system.films:
            temperature = film.film.film.equation.lubricant.temperature
            if film.joint.heat is not None and temperature is not None:
                temperatures[film.name] = temperature
        return temperatures

    @property
    def search_start(self) -> SearchStart:
        """Start of a search at another speed or load."""
        assert self.unknowns is not None
        newest = self.unknowns
        return SearchStart(self.x, newest.values[0], newest.patterns, self.temperatures)


@dataclass(frozen=True, eq=False)
class Linearisation(Described):
    """Small motions ``z = Z q`` about an equilibrium, ``M q'' + D q' + K q = Z^T f``.

    Attributes
    ----------
    basis
        Motions Z that the joints allow, shape (n, k).
    mass, damping, stiffness
        Matrices M, D and K, shape (k, k).
    films
        Coefficients ``(k_f, d_f)`` of every film by the name of its joint, shape (2, 2, k): the
        force on the journal in the frame at rest is ``-(k_f q + d_f q')``.
    sampled
        Dynamic stiffness of a machine with residual patterns of elastic bores, for which M, D, K
        and the coefficients of the films hold for slow motions only; None without patterns.
    """

    basis: np.ndarray
    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    films: Mapping[str, np.ndarray] = field(default_factory=dict)
    sampled: SampledStiffness | None = None

    @staticmethod
    def combined(parts: Sequence[Linearisation], weights: Sequence[float]) -> Linearisation:
        """Weighted sum of small motions in the same coordinates; the weights have the sum 1."""

        def total(name: str) -> np.ndarray:
            arrays = (getattr(part, name) for part in parts)
            return np.asarray(sum(w * array for w, array in zip(weights, arrays, strict=True)))

        films = {
            name: np.asarray(
                sum(w * part.films[name] for w, part in zip(weights, parts, strict=True))
            )
            for name in parts[0].films
        }
        sampled = [part.sampled for part in parts if part.sampled is not None]
        return Linearisation(
            total("basis"),
            total("mass"),
            total("damping"),
            total("stiffness"),
            films,
            SampledStiffness.combined(sampled, weights) if sampled else None,
        )

    def dynamic_stiffness(self, s: complex) -> np.ndarray:
        """Dynamic stiffness H(s) of motions ``q exp(s t)`` with complex s, shape (k, k)."""
        if self.sampled is not None:
            return np.asarray(self.sampled.at(s) + s**2 * self.mass)
        return np.asarray(self.stiffness + s * self.damping + s**2 * self.mass)

    def film_stiffness(self, name: str, s: complex) -> np.ndarray:
        """Negative force of a film on its journal per motion ``q exp(s t)``, shape (2, k)."""
        if name not in self.films:
            raise unknown_name("films", name, self.films)
        if self.sampled is not None:
            return self.sampled.film(name, s)
        stiffness, damping = self.films[name]
        return np.asarray(stiffness + s * damping)

    def along(self, places: np.ndarray) -> Linearisation:
        """The same small motions, with k of the coordinates z in place of q.

        The k coordinates must determine all motions that the joints allow.
        """
        return self.with_coordinates(np.linalg.inv(self.basis[places]))

    def with_coordinates(self, turn: np.ndarray) -> Linearisation:
        """The same small motions with other coordinates p, ``q = turn p``.

        The matrix `turn` has the shape (k, k).
        """
        return Linearisation(
            self.basis @ turn,
            turn.T @ self.mass @ turn,
            turn.T @ self.damping @ turn,
            turn.T @ self.stiffness @ turn,
            {name: film @ turn for name, film in self.films.items()},
            None if self.sampled is None else self.sampled.with_coordinates(turn),
        )

    @property
    def roots(self) -> np.ndarray:
        """Eigenvalues of the motions [1/s]; the equilibrium is stable if no real part is positive.

        The mass matrix M must not be singular, unless the dynamic stiffness is `sampled`.
        """
        if self.sampled is not None:
            return self.sampled.modes(self.mass)[0]
        unit = np.eye(len(self.mass))
        zero = np.zeros_like(self.mass)
        motion = np.block([[zero, unit], [-self.stiffness, -self.damping]])
        roots: np.ndarray = linalg.eigvals(motion, linalg.block_diag(unit, self.mass))
        return roots


def equilibrium(
    mechanism: Mechanism,
    *,
    start: Equilibrium | SearchStart | None = None,
    tolerance: float = TOLERANCE,
) -> Equilibrium:
    """Equilibrium of a mechanism under its constant loads.

    Parameters
    ----------
    mechanism
        Mechanism with approximate pose and rates, which is assembled for the start of the search.
        The rates are not changed. Rotating forces are left out, with a warning that is also in
        `Equilibrium.notices`.
    start
        Start of the search (continuation): equilibrium of the same mechanism at another speed or
        load, or the `search_start` of this equilibrium. By default, the search starts from the
        approximate pose.
    tolerance
        Tolerance of the last update of Newton's method, relative to the gaps.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled or varies with time, or `start` belongs to another
        mechanism.
    SolverError
        The search found no equilibrium.
    """
    require_class("mechanism", mechanism, Mechanism)
    if start is not None:
        require_class("start", start, Equilibrium, SearchStart)
    require_number("tolerance", tolerance, above=0)
    mechanism, notices = _without_rotating_forces(mechanism)
    for line in notices:
        warnings.warn(line, stacklevel=2)
    system = System(mechanism)
    if isinstance(start, Equilibrium):
        _require_same(system, start)
        start = start.search_start
    z, rates = assemble(system)
    variation = next(_variations(system, z, rates), "")
    if variation:
        raise SettingsError(f"no equilibrium: {variation}")
    try:
        return replace(_with_balanced_heat(system, tolerance, start), notices=notices)
    except HeatError:
        raise
    except SolverError as error:
        hint = _advice(system, error)
        error.args = (f"no equilibrium found from the pose at the start: {error}{hint}",)
        raise


def _advice(system: System, error: SolverError) -> str:
    """Advice for the message about a search that failed; it may be empty."""
    if any(binding.joint.cavitation != "reynolds" for binding in system.films):
        return "; use cavitation = 'reynolds', or simulate"
    if isinstance(error, GapClosedError):
        return ", or raise speed or viscosity: at this speed the film may not carry its load"
    names = ", ".join(f"joints.{binding.name}.eccentricity" for binding in system.films)
    return f"; the search starts from {names}: change the start, or load the films" if names else ""


def balanced(
    system: System, tolerance: float = TOLERANCE, former: SearchStart | None = None
) -> Equilibrium:
    """Equilibrium of a mechanism under its loads at time zero, even if the loads vary later.

    Parameters
    ----------
    system
        Equations of the mechanism, whose approximate pose and rates are assembled.
    tolerance
        Tolerance of the last update of Newton's method, relative to the gaps.
    former
        Start of the search; None for the approximate pose.

    Raises
    ------
    SettingsError, SolverError
        As for `equilibrium`.
    """
    z, rates = assemble(system, rough=None if former is None else former.x[: system.n])
    # Rates are given, except those of eccentricities, which follow in the frame of a rotating bore.
    weights = np.full(system.n, GIVEN)
    for binding in system.films:
        weights[binding.xi[: binding.film.journal_coordinates]] = 1.0
    solver = CoupledSteps(system, weights=weights)
    norm = StepNorm(solver.equations)
    if former is not None and len(former.values) != len(solver.equations.lower):
        raise SettingsError(OTHER_MECHANISM)
    rest = solver.equations.resting(z) if former is None else former.x[len(z) :]
    x = np.concatenate([z, rest])
    observed = norm.observe(x)
    shift = STEADY * _rate(system) if solver.equations.conserves_oil else 0.0
    moving = np.concatenate([rates, np.zeros(len(x) - len(z))])
    past = moving - shift * x, -shift * moving
    step = ImplicitStep(0.0, shift, *past, x, x, (observed, observed), tolerance)
    start: SolverState | None
    if former is not None:
        start = SolverState(np.zeros(1), former.values[None], former.patterns)
    else:
        start = None if solver.equations.conserves_oil else _start(solver.equations, z, rates)
    attempt = solver(norm, step, start)
    if attempt.solved is None:
        assert attempt.cause is not None
        raise attempt.cause
    solved = attempt.solved
    return Equilibrium(
        system,
        solved.x,
        solved.rate,
        solved.solution,
        attempt.iterations,
        solver,
        unknowns=solved.solver,
    )


#: Largest number of temperatures in the search for a heat balance.
MOST_TEMPERATURES = 50

#: Least change of ln(viscosity) between two equilibria from which the exponent of power over flow
#: is computed; it is small because the equilibria differ in temperature only.
LEAST_CHANGE = 1e-6


def _with_balanced_heat(system: System, tolerance: float, start: SearchStart | None) -> Equilibrium:
    """Equilibrium in which the heat of every film with a heat balance is balanced.

    Raises
    ------
    SolverError, HeatError
        No equilibrium was found at a temperature, or no temperature balances the heat of a film.
    """
    searches = _temperature_searches(system, {} if start is None else start.temperatures)
    for _ in range(MOST_TEMPERATURES):
        for binding in system.films:
            if binding.name in searches:
                binding.film.film.set_temperature(searches[binding.name].temperature)
        try:
            rest = balanced(system, tolerance, start)
        except SolverError as error:
            causes = (search.cause_of(error) for search in searches.values())
            raise next(filter(None, causes), error) from error
        unsettled = ""
        for name, search in searches.items():
            joint = rest.joints()[name]
            power = joint.dissipated
            flow = joint.flows.leaving
            if not search.settled(power, flow):
                unsettled = name
                search.move(power, flow)
        if not unsettled:
            return rest
        start = rest.search_start
    raise HeatError(
        f"joints.{unsettled}.heat: the effective temperature, "
        f"{searches[unsettled].temperature:.6g} C, is not balanced after {MOST_TEMPERATURES} "
        f"equilibria: raise joints.{unsettled}.heat.tolerance"
    )


def _temperature_searches(
    system: System, temperatures: Mapping[str, float]
) -> dict[str, TemperatureSearch]:
    """Searches for the temperatures of films with a heat balance, by name of the joint.

    A search starts from the temperature in another equilibrium [C]; without one, from the
    temperature of the supply.
    """
    searches = {}
    for binding in system.films:
        heat = binding.joint.heat
        oil = binding.film.film.parameters.lubricant.oil
        if heat is None or oil is None:
            continue
        key = f"joints.{binding.name}.heat"
        search = TemperatureSearch(heat, oil, key, least_change=LEAST_CHANGE)
        search.shift(temperatures.get(binding.name, search.temperature) - search.temperature)
        searches[binding.name] = search
    return searches


#: Message about the start of a search that has other unknowns than the mechanism.
OTHER_MECHANISM = (
    "start: this is an equilibrium of another mechanism: give one with the same bodies, joints and "
    "film meshes, or leave start out"
)


def _require_same(system: System, former: Equilibrium) -> None:
    """Refuse to start a search from the equilibrium of another mechanism.

    Raises
    ------
    SettingsError
        The mechanisms differ in coordinates of bodies and joints, or in film nodes.
    """
    nodes, former_nodes = (
        {film.name: film.film.film.assembly.size for film in each.films}
        for each in (system, former.system)
    )
    if (system.bodies, system.m, nodes) != (former.system.bodies, former.system.m, former_nodes):
        raise SettingsError(OTHER_MECHANISM)


# Mechanisms without an equilibrium


def _without_rotating_forces(mechanism: Mechanism) -> tuple[Mechanism, tuple[str, ...]]:
    """Copy of a mechanism without its rotating forces, and a notice for each of these forces."""
    rotating = {
        name: force.left_out_of_equilibrium
        for name, force in mechanism.forces.items()
        if force.left_out_of_equilibrium
    }
    if not rotating:
        return mechanism, ()
    constant = {name: f for name, f in mechanism.forces.items() if name not in rotating}
    notices = (
        f"the equilibrium is without the rotating force {name} {description}"
        for name, description in rotating.items()
    )
    return replace(mechanism, forces=constant), tuple(notices)


def _variations(system: System, z: np.ndarray, rates: np.ndarray) -> Iterator[str]:
    """Reasons why a mechanism has no equilibrium, one text each."""
    yield from _varying_loads(system, z, rates)
    instant = Instant(system, 0.0, z)
    yield from _moving_parts(system, instant, rates)
    for binding in system.films:
        yield from _turning_surfaces(binding, rates)
    resting = np.zeros(system.n)
    stiffness = Motion(instant, resting, resting, np.zeros(system.m)).derivatives().position
    films = [binding.xi[: binding.film.journal_coordinates] for binding in system.films]
    resisted = np.eye(system.n)[np.concatenate([*films, np.zeros(0, dtype=int)])]
    name = unresisted(system, np.arange(system.n), [instant.jacobian, stiffness, resisted])
    if name:
        yield (
            f"nothing holds body {name} at an angle or a speed: add drives.{name} with "
            "kind = 'speed', also for speed = 0"
        )


#: Times at which a function of time without a table is compared with its value at time zero [s].
SAMPLES = (1e-4, 0.0137, 0.711, 29.3)

#: Largest number of rows of a table that are compared.
MOST_ROWS = 200

#: Relative change of a load that counts as round-off.
UNCHANGED = 1e-9

#: Rate of a point over the fastest rotation that is round-off of the assembly [m].
ROUNDING = 1e-13


def _varying_loads(system: System, z: np.ndarray, rates: np.ndarray) -> Iterator[str]:
    """Reasons why there is no equilibrium: drives, forces and supplies that vary with time.

    They are evaluated at several times, while the bodies move with constant rates.
    """
    times = np.array([0.0, *SAMPLES])
    for table in system.tables:
        rows = table.curve.curve.x
        rows = rows[:: 1 + len(rows) // MOST_ROWS]
        if table.angle is None:
            times = np.append(times, rows)
        elif rates[table.angle]:
            times = np.append(times, (rows - z[table.angle]) / rates[table.angle])
    mechanism = system.mechanism
    for name, drive in mechanism.drives.items():
        if _differs([drive(time)[1] for time in times]):
            yield (
                f"drives.{name}: its speed varies with time: give it a constant speed, or run the "
                "scene in time"
            )
    instant = Instant(system, 0.0, z)
    u = instant.u
    u_rates = instant.values_along @ rates
    fastest = max((abs(rates[angle]) for angle in system.angles.values()), default=0.0)
    u_rates[np.abs(u_rates) < ROUNDING * fastest] = 0.0
    for name, (force, columns) in zip(sorted(mechanism.forces), system.forces, strict=True):
        loads = [
            force.load(t, u[columns] + t * u_rates[columns], u_rates[columns]).value
            for t in (0.0, *times)
        ]
        if _differs(loads):
            yield (
                f"forces.{name} varies with time or angle: leave it out, give it a constant size, "
                "or run the scene in time"
            )
    for binding in system.films:
        for feed in binding.film.film.parameters.feeds:
            if _differs([feed.pressure_at(time) for time in times]):
                yield (
                    f"joints.{binding.name}: the pressure of a supply varies with time: give it a "
                    "constant one, or run the scene in time"
                )


def _differs(values: list[float] | list[np.ndarray]) -> bool:
    """True if some of the values, at several times, differ from the first value."""
    array = np.stack([np.asarray(value, dtype=float) for value in values])
    return bool(np.abs(array - array[0]).max() > UNCHANGED * np.abs(array).max())


#: Distance of a centre of mass or point from the axis of its body that counts as zero [m].
CENTRED = 1e-9


def _moving_parts(system: System, instant: Instant, rates: np.ndarray) -> Iterator[str]:
    """Reasons why there is no equilibrium: rotating bodies that are elastic or not balanced.

    A body is not balanced if its centre of mass, or one of its points with a joint, is not on its
    axis of rotation.
    """
    carried = instant.rate_derivative(rates)[0] @ rates
    for name, marker in system.markers.items():
        turning = system.angles.get(name.partition(".")[0])
        least = CENTRED * float(rates[turning]) ** 2 if turning is not None else np.inf
        if any(np.abs(carried[columns][POSITION]).max() > least for columns in marker.columns):
            yield f"{name} is carried around as its body turns: run it"
    resting = np.zeros(2)
    for columns, body, (z, own_rates) in system.each_body(instant.z, rates):
        name = next(n for n, other in system.bodies.items() if other == columns)
        turning = system.angles.get(name)
        if turning is None or not rates[turning] or not isinstance(body, PlanarBody):
            continue
        if body.modes:
            yield f"{name} is elastic and turns under loads that stand still: run it"
        moving, still = (
            body.balance(z, speeds, np.zeros_like(z), minus_gravity=resting).forces[POSITION]
            for speeds in (own_rates, np.zeros_like(z))
        )
        least = CENTRED * float(rates[turning]) ** 2 * body.integrals.total_mass
        if np.abs(moving - still).max() > least:
            yield f"the centre of mass of {name} is carried around as the body turns: run it"


def _turning_surfaces(binding: FilmBinding, rates: np.ndarray) -> Iterator[str]:
    """Reasons why there is no equilibrium: shapes and supplies of a film that rotate."""
    parameters = binding.film.film.parameters
    for bound in reversed(binding.surfaces):
        side = bound.surface.side
        feeds = any(feed.on == side.name and not _all_around(feed) for feed in parameters.feeds)
        grooves = side.sign == BORE and bool(parameters.regions)
        uneven = feeds or grooves or not bound.surface.shape.round
        if uneven and bound.angle_of(rates):
            yield f"the shape or a supply of the {side.name} of {binding.name} turns: run it"


def _all_around(feed: Supply) -> bool:
    """True if an oil supply has the same geometry at all angles: a groove around the bearing."""
    return isinstance(feed, CircumferentialGrooveSupply) and feed.extent >= 360.0


def _rate(system: System) -> float:
    """Largest reference angular speed of the films of a mechanism [rad/s]; 1 without films."""
    return max((binding.film.film.parameters.rate for binding in system.films), default=1.0)


def _start(equations: StepEquations, z: np.ndarray, rates: np.ndarray) -> SolverState | None:
    """First guess of the unknowns of the step equations.

    Pressures are those of each film at the given gap, with Reynolds' cavitation condition. The
    result is None if a film cannot be solved.
    """
    values = np.zeros(len(equations.lower))
    for film, dofs in zip(equations.films, equations.film_indices, strict=True):
        gap = film.binding.gap(z, rates, 0.0)
        try:
            values[dofs] = film.unknowns(film.film.solve(gap).pressure)
        except SolverError:
            return None
    return SolverState(np.zeros(1), values[None], 0)


@renamed_arguments(found="rest")
def linearise(rest: Equilibrium | Mechanism) -> Linearisation:
    """Linearise the motions of a mechanism about an equilibrium.

    Parameters
    ----------
    rest
        Equilibrium, or a mechanism whose equilibrium is computed.

    Raises
    ------
    SettingsError
        The cavitation is mass-conserving, so that the response of the film depends on the
        frequency; or a motion has no stiffness, such as a shaft that turns freely.
    SolverError
        The dynamic stiffness of a machine with residual patterns cannot be interpolated.
    """
    if isinstance(rest, Mechanism):
        rest = equilibrium(rest)
    require_class("rest", rest, Equilibrium, Mechanism)
    system = rest.system
    solver = rest.solver
    if solver.equations.conserves_oil:
        raise SettingsError(
            "cavitation = 'mass-conserving': stiffness and damping of the film depend on the "
            "frequency: use 'reynolds'"
        )
    jacobian = Instant(system, 0.0, rest.z).jacobian
    basis = linalg.null_space(jacobian)
    mass = basis.T @ rest.state.motion.derivatives().acceleration @ basis
    if solver.equations.most_patterns:
        return _with_memory(rest, jacobian, basis, mass)
    slow = SLOW * _rate(system)
    still, still_forces = _dynamic_stiffness(rest, jacobian, basis, 0.0)
    moving, moving_forces = _dynamic_stiffness(rest, jacobian, basis, slow)
    damping = (moving - still) / slow - slow * mass
    films = {
        name: np.stack([force, (moving_forces[name] - force) / slow])
        for name, force in still_forces.items()
    }
    return Linearisation(basis, mass, damping, still, films)


def _with_memory(
    rest: Equilibrium, jacobian: np.ndarray, basis: np.ndarray, mass: np.ndarray
) -> Linearisation:
    """Linearise a mechanism with residual patterns, from its dynamic stiffness at real shifts."""
    shifts = sampled_shifts(_rate(rest.system))
    samples = [_dynamic_stiffness(rest, jacobian, basis, shift) for shift in shifts]
    sampled = SampledStiffness(
        shifts,
        np.array([matrix for matrix, _ in samples]) - shifts[:, None, None] ** 2 * mass,
        {name: np.array([films[name] for _, films in samples]) for name in samples[0][1]},
    )
    stiffness = sampled.values[0]
    return Linearisation(
        basis, mass, sampled.damping, stiffness, sampled.film_coefficients, sampled
    )


def _dynamic_stiffness(
    rest: Equilibrium, jacobian: np.ndarray, basis: np.ndarray, shift: float
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Dynamic stiffness ``s^2 M + s D + K`` at the shift s, and the dynamic stiffness of each film.

    Columns of a film's matrix, shape (2, k), are its negative forces on the journal for unit
    amplitudes of the k motions in `basis`. They follow from the multipliers of the joint. These
    balance the sum of the film force and of the generalised force on the joint's own coordinates.
    """
    moved, multipliers = rest.solver.response_to_forces(rest.x, rest.rate, shift, basis)
    stiffness = np.linalg.inv(basis.T @ moved)
    shares = {}
    for binding in rest.system.films:
        dofs = binding.xi[: binding.film.journal_coordinates]
        on_joint = np.linalg.solve(jacobian[binding.rows][:, dofs].T, basis[dofs])
        shares[binding.name] = (on_joint - multipliers[binding.rows])[:2] @ stiffness
    return stiffness, shares
