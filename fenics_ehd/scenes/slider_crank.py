"""Slider-crank with a flexible connecting rod and a lubricated big end (section 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.film import Film, FilmState
from fenics_ehd.multibody.crank import ConstantSpeedCrank, CrankMotion
from fenics_ehd.multibody.energy import Powers
from fenics_ehd.multibody.floating_frame import (
    inertia_forces,
    kinetic_energy,
    with_point_mass,
)
from fenics_ehd.multibody.guide import RodAngle, rod_angle
from fenics_ehd.multibody.journal import Journal
from fenics_ehd.plane import rotation
from fenics_ehd.reduction.body import ReducedBody


@dataclass(frozen=True, eq=False)
class MechanismState:
    """What the last evaluation of the mechanism knows, for output."""

    crank: CrankMotion
    angle: RodAngle
    film: FilmState


class SliderCrank:
    """The equations of motion in minimal coordinates, for `bdf.integrate`.

    Coordinates ``xi = (-e_x, -e_y, q)``: the translation of the bore relative to
    the shaft in the rod's frame, and the elastic coordinates.

    Parameters
    ----------
    crank
        Motion of the shaft.
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
    """

    def __init__(
        self,
        crank: ConstantSpeedCrank,
        body: ReducedBody,
        film: Film,
        piston_mass: float,
        damping_time: float,
        transfer: str = "conservative",
    ):
        self.crank = crank
        self.journal = Journal(body, film, transfer)
        self.size = 2 + body.modes
        point = body.points["pin"][:2]
        self._pin = point
        self._inertia = with_point_mass(body.inertia, point, piston_mass)
        self._stiffness = np.zeros((self.size, self.size))
        self._stiffness[2:, 2:] = body.stiffness
        self._damping = damping_time * self._stiffness

    def linearise(
        self,
        time: float,
        x: np.ndarray,
        rate: np.ndarray,
        acceleration: np.ndarray,
        shifts: tuple[float, float],
        guess: MechanismState | None,
    ) -> tuple[np.ndarray, np.ndarray, MechanismState]:
        """Residual of the projected equations of motion and its total derivative."""
        crank = self.crank.at(time)
        angle = rod_angle(crank, self._pin, x, rate, acceleration, shifts)
        film = self.journal.forces(
            x,
            rate,
            crank.speed - angle.rate,
            -angle.rate_slope,
            shifts[0],
            guess.film if guess is not None else None,
        )
        inertia = inertia_forces(self._inertia, crank, angle, (x, rate, acceleration), shifts)
        on_xi = inertia.on_xi - film.on_xi + self._stiffness @ x + self._damping @ rate
        on_theta = inertia.on_theta - film.on_theta
        on_xi_slope = (
            inertia.on_xi_slope - film.on_xi_slope + self._stiffness + shifts[0] * self._damping
        )
        on_theta_slope = inertia.on_theta_slope - film.on_theta_slope
        residual = on_xi + angle.angle_slope * on_theta
        jacobian = (
            on_xi_slope
            + np.outer(angle.angle_slope, on_theta_slope)
            + on_theta * angle.angle_curvature
        )
        return residual, jacobian, MechanismState(crank, angle, film.state)

    def norm(self, x: np.ndarray, change: np.ndarray) -> float:
        """Largest change of the gap relative to the gap there."""
        return float(np.max(np.abs(self.journal.gap_change(change)) / self.journal.gap(x)))

    def admissible_fraction(self, x: np.ndarray, change: np.ndarray) -> float:
        """Fraction of a change at which the gap closes somewhere."""
        closing = -self.journal.gap_change(change) / self.journal.gap(x)
        largest = closing.max()
        return 1.0 / largest if largest > 0.0 else np.inf

    def initial_powers(self) -> Powers:
        """Energy at the start: a centred shaft at rest in the bore, no pressure yet."""
        crank, rest = self.crank.at(0.0), np.zeros(self.size)
        angle = rod_angle(crank, self._pin, rest, rest, rest, (0.0, 0.0))
        kinetic = kinetic_energy(self._inertia, crank, angle, rest, rest)
        return Powers(kinetic, strain=0.0, drive=0.0, drag=0.0, film=0.0, damping=0.0)

    def powers(self, x: np.ndarray, rate: np.ndarray, state: MechanismState) -> Powers:
        """Energy and powers at an accepted step."""
        crank, angle = state.crank, state.angle
        loss, drag = self.journal.film.powers(state.film)
        force = rotation(angle.angle) @ self.journal.resultant(state.film.pressure)
        moment = self.journal.moment(x, state.film.pressure)
        return Powers(
            kinetic=kinetic_energy(self._inertia, crank, angle, x, rate),
            strain=float(0.5 * x @ self._stiffness @ x),
            drive=float(force @ crank.velocity + moment * angle.rate),
            drag=drag,
            film=loss,
            damping=float(rate @ self._damping @ rate),
        )
