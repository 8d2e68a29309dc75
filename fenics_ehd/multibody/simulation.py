"""A mechanism from its start to an end time, and what the run answers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.errors import FilmTooThinError, SettingsError
from fenics_ehd.multibody.assembly import assemble
from fenics_ehd.multibody.bdf import Step, StepControl, integrate
from fenics_ehd.multibody.energy import EnergyBalance, Powers
from fenics_ehd.multibody.friction import film_friction
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.step_solver import CoupledState, CoupledSteps
from fenics_ehd.multibody.system import FilmPlace, System

#: Damping ratio above which the formula of order 3 damps a mode at every step: it is A(82)-stable.
DAMPED = float(np.cos(np.radians(82.0)))


@dataclass(frozen=True, eq=False)
class JointResult:
    """A lubricated joint over the steps of a run.

    Attributes
    ----------
    max_pressure, min_film_thickness
        shape (steps,) [Pa], [m].
    eccentricity
        Of the journal in the undeformed bore's frame, shape (steps, 2) [m].
    force
        Of the film on the journal in the frame at rest, shape (steps, 2) [N].
    """

    max_pressure: np.ndarray
    min_film_thickness: np.ndarray
    eccentricity: np.ndarray
    force: np.ndarray


@dataclass(frozen=True, eq=False)
class Result:
    """A run.

    Attributes
    ----------
    time
        Of the accepted steps, shape (steps,) [s].
    joints
        Lubricated joints by name.
    bodies, body_rates
        Coordinates of every body by name and their rates, shape (steps, n).
    newton_iterations, rejected_steps
        In all.
    energy_balance_error
        See `EnergyBalance.error`.
    """

    time: np.ndarray
    joints: Mapping[str, JointResult]
    bodies: Mapping[str, np.ndarray]
    body_rates: Mapping[str, np.ndarray]
    newton_iterations: int
    rejected_steps: int
    energy_balance_error: float


def simulate(
    mechanism: Mechanism,
    end: float,
    tolerance: float = 1e-5,
    *,
    order: int = 3,
    first_step: float = 1e-8,
    smallest_step: float = 1e-13,
    largest_step: float | None = None,
) -> Result:
    """Solve the initial value problem.

    Parameters
    ----------
    mechanism
        What moves; it is assembled from its rough pose.
    end
        End time [s].
    tolerance
        Local error of a step: relative change of every gap, and of coordinates as
        `Body.error_measure` has them.
    order
        Of the backward differentiation formula, 1 to 3; 2 for 3 where modes lack damping.
    first_step, smallest_step, largest_step
        [s]; no largest: a fiftieth of the time.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, or the end is not after the start.
    StepSizeError
        No step is short enough.
    FilmTooThinError
        A film became thinner than its joint's `smallest_film`.
    """
    if not end > 0.0:
        raise SettingsError(f"end = {end:g} s must be above 0")
    system = System(mechanism)
    solve = CoupledSteps(system)
    norm = StepNorm(solve.equations)
    control = stable_control(
        system,
        StepControl(tolerance, first_step, smallest_step, largest_step or 0.02 * end, order),
    )
    balance: EnergyBalance | None = None
    time, z, rates, iterations, rejected = [], [], [], 0, 0
    joints: list[list[tuple]] = [[] for _ in system.films]
    for step in run(system, solve, norm, end, control):
        powers = step_powers(solve.equations, step)
        if balance is None:
            balance = EnergyBalance(step.time, powers)
        else:
            balance.add(step.time, powers)
        time.append(step.time)
        z.append(step.x[: system.n])
        rates.append(step.rate[: system.n])
        iterations += step.newton_iterations
        rejected += sum(step.rejected.values())
        for found, joint in zip(joints, joint_figures(system, norm, step), strict=True):
            found.append(joint)
    coordinates, speeds = np.array(z), np.array(rates)
    return Result(
        np.array(time),
        {
            place.name: JointResult(*map(np.array, zip(*found, strict=True)))
            for place, found in zip(system.films, joints, strict=True)
        },
        {name: coordinates[:, places] for name, places in system.bodies.items()},
        {name: speeds[:, places] for name, places in system.bodies.items()},
        iterations,
        rejected,
        balance.error if balance is not None else 0.0,
    )


def run(
    system: System, solve: CoupledSteps, norm: StepNorm, end: float, control: StepControl
) -> Iterator[Step]:
    """Assemble and integrate, yield every accepted step.

    Raises
    ------
    FilmTooThinError
        After the step whose film is too thin.
    """
    z, rates = assemble(system)
    resting = np.zeros(solve.equations.patterns)
    start = np.concatenate([z, resting]), np.concatenate([rates, resting])
    for step in integrate(norm, (0.0, end), *start, control, solve):
        yield step
        for place, gap in zip(system.films, norm.film_gaps(step.watched), strict=True):
            _check_film(place, float(gap.min()), step.time)


def _check_film(place: FilmPlace, thickness: float, time: float) -> None:
    smallest = place.joint.smallest_film * place.film.clearance
    if thickness < smallest:
        raise FilmTooThinError(
            f"the film of {place.name} is {thickness * 1e6:.3g} um thin at t = {time:.6g} s, below "
            f"smallest_film of the clearance, {smallest * 1e6:.3g} um: surfaces would touch"
        )


def stable_control(system: System, control: StepControl) -> StepControl:
    """Step control whose formula feeds no mode of a body.

    Order 3 feeds modes of little damping, by 5 to 10 % a step where a step is a radian of theirs:
    a full interface without damping was 71 % off (`docs/extremes.md`).
    """
    if control.order < 3 or system.least_damping >= DAMPED:
        return control
    return replace(control, order=2)


def joint_figures(system: System, norm: StepNorm, step: Step) -> Iterator[tuple]:
    """Fields of `JointResult` at one step, joint by joint."""
    state: CoupledState = step.auxiliary
    gaps = norm.film_gaps(step.watched)
    for place, film, gap in zip(system.films, state.films, gaps, strict=True):
        yield (
            film.pressure.max(),
            gap.min(),
            step.x[place.xi[:2]],
            -state.motion.multipliers[place.rows][:2],
        )


def step_powers(equations: StepEquations, step: Step) -> Powers:
    """Energy and the powers that change it, at an accepted step.

    Without friction the oil's drag is what the surfaces' turning feeds into the film from
    outside: no torque of it acts on the bodies. With friction all of the shear does, and the
    film's loss is all that the oil dissipates.
    """
    system, state = equations.system, step.auxiliary
    motion = state.motion
    z, y = np.split(step.x, [system.n])
    rates, y_rates = np.split(step.rate, [system.n])
    kinetic = strain = damping = film = drag = 0.0
    for _, body, (own, own_rates) in system.each_body(z, rates):
        energies = body.energies(own, own_rates)
        kinetic, strain = kinetic + energies.kinetic, strain + energies.strain
        damping += energies.dissipated
    first = 0
    for flexibility, joint, found in zip(
        equations.flexibilities, system.films, state.films, strict=True
    ):
        lost, fed = joint.film.film.powers(found)
        if joint.film.friction:
            lost, fed = lost + film_friction(joint.film, found).sheared, 0.0
        film, drag = film + lost, drag + fed
        if flexibility is not None:
            patterns = slice(first, first + flexibility.size)
            strain += flexibility.energy(y[patterns])
            damping += flexibility.dissipation(y_rates[patterns])
            first += flexibility.size
    return Powers(
        kinetic=kinetic,
        strain=strain,
        drive=motion.drive_power,
        drag=drag,
        film=film,
        damping=damping,
        gas=motion.applied_power,
    )
