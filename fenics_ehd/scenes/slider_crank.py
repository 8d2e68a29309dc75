"""Slider-crank with a flexible connecting rod and a lubricated big end (section 4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from fenics_ehd.film import Film, FilmState
from fenics_ehd.multibody.bdf import relative_error
from fenics_ehd.multibody.coupled import CoupledState
from fenics_ehd.multibody.crank import (
    AngleFunction,
    ConstantSpeedCrank,
    CrankMotion,
    DrivenCrank,
)
from fenics_ehd.multibody.energy import Powers
from fenics_ehd.multibody.equations import Equations
from fenics_ehd.multibody.floating_frame import (
    inertia_forces,
    kinetic_energy,
    with_point_mass,
)
from fenics_ehd.multibody.free_angle import (
    FreeAngleJournal,
    with_empty_column,
    with_empty_field,
)
from fenics_ehd.multibody.friction import FilmFriction, film_friction
from fenics_ehd.multibody.guide import RodAngle, rod_angle
from fenics_ehd.multibody.journal import Journal
from fenics_ehd.multibody.piston import gas_forces, piston_velocity
from fenics_ehd.multibody.tabulated import TabulatedLoad
from fenics_ehd.plane import rotation
from fenics_ehd.reduction.body import ReducedBody

#: Lead of the crank that is watched as zero [rad]. What is watched must not come near zero, and the
#: thinnest of it is the film.
WATCHED_LEAD = 1e3

#: Coordinates with their rates and accelerations, shape (n,) each.
State = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class MechanismState:
    """What the last evaluation of the mechanism knows, for output."""

    crank: CrankMotion
    angle: RodAngle


class SliderCrank:
    """The equations of motion in minimal coordinates, a `Mechanism`.

    Coordinates ``xi = (-e_x, -e_y, q)``: the translation of the bore relative to
    the shaft in the rod's frame, and the elastic coordinates; behind them the lead
    of a `DrivenCrank`. A body with residual flexibility adds the amplitudes of its
    patterns to the state.

    Without friction the film's pressure does no work on the crank's angle: it pushes shaft
    and rod oppositely, which move together while xi rests.

    Parameters
    ----------
    crank
        Motion of the shaft, given or driven.
    body
        Reduced rod with a boundary point ``pin``.
    film
        Film on the rod's bore.
    piston_mass
        [kg].
    damping_time
        zeta of ``D_e = zeta T^T K T`` [s].
    transfer
        How pressures reach a bore with another mesh than the film's.
    gas_force
        Force on the piston over the crank's angle, positive towards the crank's axis [N]; or None.
    friction
        Whether the oil's shear acts on rod and shaft.
    """

    def __init__(
        self,
        crank: ConstantSpeedCrank | DrivenCrank,
        body: ReducedBody,
        film: Film,
        piston_mass: float,
        damping_time: float,
        transfer: str = "conservative",
        *,
        gas_force: AngleFunction | None = None,
        friction: bool = False,
    ):
        self.crank, self._gas_force, self._shears = crank, gas_force, friction
        self._driven = crank if isinstance(crank, DrivenCrank) else None
        pin, inertia = body.points["pin"][:2], body.inertia
        self.journal: Journal
        if self._driven is not None:
            self.journal = FreeAngleJournal(body, film, transfer, damping_time)
            pin, inertia = with_empty_column(pin), with_empty_field(inertia)
        else:
            self.journal = Journal(body, film, transfer, damping_time)
        self.size, n = self.journal.size, self.journal.coordinates
        self._pin = pin
        self._inertia = with_point_mass(inertia, pin, piston_mass)
        self._stiffness = np.zeros((n, n))
        elastic = slice(2, 2 + body.modes)
        self._stiffness[elastic, elastic] = body.stiffness
        self._damping = damping_time * self._stiffness
        functions: list[Any] = (
            [gas_force] if self._driven is None else [gas_force, self._driven.torque]
        )
        self.tables: Sequence[TabulatedLoad] = [
            function.tabulated(self.crank_angle)
            for function in functions
            if hasattr(function, "tabulated")
        ]

    def crank_angle(self, time: float, x: np.ndarray) -> float:
        """At a time [s], in a state [rad]."""
        lead = 0.0 if self._driven is None else float(x[self.journal.coordinates - 1])
        return self.crank.speed * time + lead

    def _motion(self, time: float, state: State, shifts: tuple[float, float]) -> CrankMotion:
        if isinstance(self.crank, ConstantSpeedCrank):
            return self.crank.at(time)
        lead, rate, acceleration = (float(values[-1]) for values in state)
        return self.crank.at(time, (lead, rate, acceleration), shifts)

    def equations(
        self,
        time: float,
        xi: np.ndarray,
        rate: np.ndarray,
        acceleration: np.ndarray,
        shifts: tuple[float, float],
        pressure: np.ndarray,
    ) -> Equations:
        """Projected equations of motion, see `Mechanism`."""
        state = xi, rate, acceleration
        crank = self._motion(time, state, shifts)
        angle = rod_angle(crank, self._pin, *state, shifts)
        inertia = inertia_forces(self._inertia, crank, angle, state, shifts)
        journal, shear = self.journal, None
        on_theta, s = inertia.on_theta, np.concatenate([[1.0], xi])
        shaft_rate_slope = -angle.rate_slope
        if crank.along is not None:
            shaft_rate_slope[-1] += crank.along.speed
        # With shear, its moment and that of the pressure are together minus the shaft's torque.
        moment = np.zeros(len(s))
        if self._shears:
            shear = partial(self._shear, crank, angle)
        else:
            moment = journal.spin_load @ pressure
            on_theta -= s @ moment
        elastic = self._stiffness @ xi + self._damping @ rate
        residual = inertia.on_xi - journal.load[1:] @ pressure + elastic
        residual += angle.angle_slope * on_theta
        applied = list(self._applied(crank, angle, xi))
        for forces, _ in applied:
            residual -= forces

        def linearise() -> tuple[np.ndarray, np.ndarray]:
            slope = inertia.on_xi_slope + self._stiffness + shifts[0] * self._damping
            slope += np.outer(angle.angle_slope, inertia.on_theta_slope - moment[1:])
            slope += on_theta * angle.angle_curvature
            for _, derivatives in applied:
                slope -= derivatives
            if self._shears:
                return slope, journal.load[1:]
            spun = np.outer(angle.angle_slope, s @ journal.spin_load)
            return slope, journal.load[1:] + spun

        shaft_rate, known = crank.speed - angle.rate, MechanismState(crank, angle)
        return Equations(residual, shaft_rate, shaft_rate_slope, linearise, known, shear)

    def _shear(self, crank: CrankMotion, angle: RodAngle, state: FilmState) -> np.ndarray:
        """See `Equations.shear`; the shaft turns by ``phi - theta`` in the bore."""
        turning = -angle.angle_slope
        if crank.along is not None:
            turning[-1] += 1.0
        return film_friction(self.journal, state).forces(turning)

    def _applied(
        self, crank: CrankMotion, angle: RodAngle, xi: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Generalised forces, and their derivatives, of the gas and on the crank itself."""
        if self._gas_force is not None:
            yield gas_forces(self._gas_force, crank, angle, self._pin, xi)
        if self._driven is not None and crank.along is not None:
            forces, derivatives = np.zeros(len(xi)), np.zeros((len(xi), len(xi)))
            moment, slope = self._driven.moment(crank)
            inertia = self._driven.inertia
            forces[-1] = moment - inertia * crank.angular_acceleration
            derivatives[-1, -1] = slope - inertia * crank.along.angular_acceleration
            yield forces, derivatives

    def watch(self, x: np.ndarray) -> np.ndarray:
        """Gap at the watched points [m], see `fenics_ehd.multibody.bdf.Watched`.

        Behind it the lead of a driven crank [rad], raised by `WATCHED_LEAD`.
        """
        gap = self.journal.gap(x)
        if self._driven is not None:
            return np.append(gap, WATCHED_LEAD + x[self.journal.coordinates - 1])
        return gap

    def error_norm(self, watched: np.ndarray, error: np.ndarray) -> float:
        """See `relative_error`; of a driven crank the error in rad, if that is larger."""
        if self._driven is None:
            return relative_error(watched, error)
        return max(relative_error(watched[:-1], error[:-1]), float(abs(error[-1])))

    def friction(self, state: CoupledState) -> FilmFriction | None:
        """Friction of the film at an accepted step, None for a mechanism without it."""
        return film_friction(self.journal, state.film) if self._shears else None

    def initial_powers(self, x: np.ndarray | None = None, rate: np.ndarray | None = None) -> Powers:
        """Energy at the start, no pressure yet, the rod undeformed; None: the shaft centred."""
        n = self.journal.coordinates
        rest = np.zeros(n)
        state = (rest if x is None else x[:n], rest if rate is None else rate[:n], rest)
        crank = self._motion(0.0, state, (0.0, 0.0))
        angle = rod_angle(crank, self._pin, *state, (0.0, 0.0))
        drive = 0.0 if self._driven is None else self._driven.moment(crank)[0] * crank.speed
        return Powers(
            self._kinetic(crank, angle, *state[:2]),
            strain=0.0,
            drive=drive,
            drag=0.0,
            film=0.0,
            damping=0.0,
            gas=self._gas_power(crank, angle, state[1]),
        )

    def _kinetic(
        self, crank: CrankMotion, angle: RodAngle, xi: np.ndarray, xi_rate: np.ndarray
    ) -> float:
        """Kinetic energy of rod and piston, and of a driven crank [J]."""
        energy = kinetic_energy(self._inertia, crank, angle, xi, xi_rate)
        if self._driven is not None:
            energy += self._driven.kinetic_energy(crank)
        return energy

    def _gas_power(self, crank: CrankMotion, angle: RodAngle, xi_rate: np.ndarray) -> float:
        if self._gas_force is None:
            return 0.0
        velocity = piston_velocity(crank, angle, self._pin, xi_rate)
        return -self._gas_force(crank.angle)[0] * velocity

    def powers(self, x: np.ndarray, rate: np.ndarray, state: CoupledState) -> Powers:
        """Energy and powers at an accepted step, see `Powers`."""
        crank, angle = state.mechanism.crank, state.mechanism.angle
        journal = self.journal
        xi, y = np.split(x, [journal.coordinates])
        xi_rate, y_rate = np.split(rate, [journal.coordinates])
        strain, damping = 0.5 * xi @ self._stiffness @ xi, xi_rate @ self._damping @ xi_rate
        if journal.compliance is not None:
            strain += journal.compliance.energy(y)
            damping += journal.compliance.dissipation(y_rate)
        drive, drag, film = self._joint_powers(xi, state)
        return Powers(
            kinetic=self._kinetic(crank, angle, xi, xi_rate),
            strain=float(strain),
            drive=drive,
            drag=drag,
            film=film,
            damping=float(damping),
            gas=self._gas_power(crank, angle, xi_rate),
        )

    def _joint_powers(self, xi: np.ndarray, state: CoupledState) -> tuple[float, float, float]:
        """Powers of the drive, of the shaft's drag on the oil, and lost in the film [W]."""
        crank, angle = state.mechanism.crank, state.mechanism.angle
        journal, pressure = self.journal, state.film.pressure
        lost, drag = journal.film.powers(state.film)
        resultant, moment = journal.resultant(pressure), journal.moment(xi, pressure)
        friction = self.friction(state)
        if friction is not None:
            resultant = resultant + friction.on_xi[:2]
            moment = -friction.torque
            drag = -friction.torque * (crank.speed - angle.rate)
            lost += friction.sheared
        if self._driven is not None:
            drive = self._driven.moment(crank)[0] * crank.speed
            if friction is not None:
                # The joint's forces are internal: only the oil's dissipation is left of them.
                return drive, 0.0, lost
            return drive + moment * angle.rate, drag, lost
        force = rotation(angle.angle) @ resultant
        return float(force @ crank.velocity + moment * angle.rate), drag, lost
