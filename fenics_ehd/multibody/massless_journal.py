"""A rigid shaft without mass in a rigid bearing: film force and load are in balance.

    F(e, e', t) + W(t) = 0,    F = - int p n dA

is an implicit first-order equation for the eccentricity e, the shaft's centre
in the frame of the load. F depends on e' through the squeeze of the film; its
derivatives come from the film's exact sensitivity. The shear force on the shaft,
smaller than the pressure's by clearance over radius, is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenics_ehd.film import Film, FilmState, ShaftMotion, shaft_gap
from fenics_ehd.film.kinematics import Gap, GapSlopes, shaft_gap_slopes
from fenics_ehd.multibody.bdf import StepControl, relative_error
from fenics_ehd.multibody.cycles import PeriodicSearch
from fenics_ehd.multibody.shooting import Shooting

#: Damping added to the derivative, as a share of that of a centred shaft. An unloaded film has
#: none, as it cavitates everywhere; for any other this changes nothing beyond Newton's tolerance.
DAMPING_FLOOR = 1e-9

#: Balance of the start, relative to the largest load, and the iterations it may take. It serves
#: to predict the first step only.
START_TOLERANCE, START_ITERATIONS = 1e-6, 30


@dataclass(frozen=True, eq=False)
class JournalState:
    """Film and forces at one instant.

    Attributes
    ----------
    film
        Solution of the film.
    load, force
        Load and film force on the shaft, shape (2,) [N].
    stiffness, damping
        ``dF/de`` and ``dF/de'``, shape (2, 2) [N/m], [N s/m].
    """

    film: FilmState
    load: np.ndarray
    force: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray

    @classmethod
    def as_guess(cls, film: FilmState) -> JournalState:
        """A state of which only the film is known."""
        nothing = np.empty(0)
        return cls(film, nothing, nothing, nothing, nothing)


class MasslessJournal:
    """Force balance of the shaft, as a problem of `fenics_ehd.multibody.bdf`.

    Parameters
    ----------
    film
        Film of the bearing.
    load
        Force on the shaft at a time, shape (2,) [N].
    speeds
        Motion whose speeds apply; its eccentricity does not.
    """

    def __init__(self, film: Film, load: Callable[[float], np.ndarray], speeds: ShaftMotion):
        self.film, self._load, self._speeds = film, load, speeds
        cosine, sine = film.points.normal
        self._directions = film.load(np.stack([cosine, sine], axis=-1))
        angles = np.unique(film.parameters.grid.node_positions[:, 0])
        self._normals = np.column_stack([np.cos(angles), np.sin(angles)])
        p = film.parameters
        radius, width = p.grid.radius, p.grid.width
        # Full film around a centred shaft: that of a short bearing, or of a long one where less.
        self.centred_damping = (
            np.pi
            * p.lubricant.viscosity
            * width
            * (radius / p.clearance) ** 3
            * min(12.0, (width / radius) ** 2)
        )

    @property
    def film_solves(self) -> int:
        """Solves by SNES-VI so far."""
        return self.film.solves

    def search(self, control: StepControl) -> PeriodicSearch:
        """Search for the periodic orbit, integrated in this way."""
        return Shooting(self, control)

    def memory(self) -> dict[str, Any]:
        """What it remembers of former steps: nothing."""
        return {}

    def restore(self, memory: Mapping[str, Any], film: FilmState) -> None:
        """Go on with `memory` and the film of the last accepted step."""

    def motion(self, eccentricity: np.ndarray, rate: np.ndarray) -> ShaftMotion:
        """The shaft's motion."""
        return replace(self._speeds, eccentricity=eccentricity, eccentricity_rate=rate)

    def gap(self, motion: ShaftMotion) -> Gap:
        """The film's."""
        p = self.film.parameters
        return shaft_gap(self.film.points, p.grid.radius, p.clearance, motion)

    def state(
        self, time: float, x: np.ndarray, rate: np.ndarray, guess: FilmState | None
    ) -> JournalState:
        """Film at a given position and velocity, with the derivatives of its force."""
        grid, clearance = self.film.parameters.grid, self.film.parameters.clearance
        motion = self.motion(x, rate)
        film = self._solve(time, self.gap(motion), guess)
        slopes = shaft_gap_slopes(self.film.points, grid.radius, clearance, motion)
        # Columns: e_x, e_y and their rates; the shaft does not tilt.
        pair = (
            np.concatenate([getattr(part, name)[..., :2] for part in slopes], axis=-1)
            for name in ("thickness", "thickness_rate", "mean_velocity")
        )
        slope = -self._directions @ self._sensitivity(film, GapSlopes(*pair))
        floor = DAMPING_FLOOR * self.centred_damping * np.eye(2)
        return JournalState(
            film,
            load=self._load(time),
            force=-self._directions @ film.pressure,
            stiffness=slope[:, :2],
            damping=slope[:, 2:] - floor,
        )

    def _solve(self, time: float, gap: Gap, guess: FilmState | None) -> FilmState:
        return self.film.solve(gap, guess)

    def _sensitivity(self, state: FilmState, slopes: GapSlopes) -> np.ndarray:
        """Derivative of the pressure, shape (nodes, n)."""
        return self.film.sensitivity(state, slopes)

    def linearise(
        self,
        time: float,
        x: np.ndarray,
        rate: np.ndarray,
        acceleration: np.ndarray,
        shifts: tuple[float, float],
        guess: JournalState | None,
    ) -> tuple[np.ndarray, np.ndarray, JournalState]:
        """See `fenics_ehd.multibody.newton.SecondOrderProblem`; the acceleration plays no part."""
        state = self.state(time, x, rate, guess.film if guess else None)
        derivative = state.stiffness + shifts[0] * state.damping
        return state.force + state.load, derivative, state

    def watch(self, x: np.ndarray) -> np.ndarray:
        """Gap around the bore [m], see `fenics_ehd.multibody.bdf.Watched`."""
        return self.film.parameters.clearance - self._normals @ x

    def error_norm(self, watched: np.ndarray, error: np.ndarray) -> float:
        """See `relative_error`."""
        return relative_error(watched, error)

    def norm(self, x: np.ndarray, change: np.ndarray) -> float:
        """Largest change of the gap relative to the gap there."""
        return self.error_norm(self.watch(x), self._normals @ change)

    def admissible_fraction(self, x: np.ndarray, change: np.ndarray) -> float:
        """Fraction of a change at which the shaft touches the bore."""
        square, product = change @ change, x @ change
        if not square > 0.0:
            return np.inf
        room = self.film.parameters.clearance**2 - x @ x
        return float((np.sqrt(product**2 + square * room) - product) / square)

    def starting_rate(self, time: float, x: np.ndarray, largest: float) -> np.ndarray:
        """Velocity at which the film bears the load at a given position, shape (2,) [m/s].

        Newton's iteration, shortened until the imbalance falls.

        Parameters
        ----------
        time
            [s].
        x
            Eccentricity, shape (2,) [m].
        largest
            Force to which the tolerance refers [N].
        """
        rate = self._load(time) / self.centred_damping
        state = self.state(time, x, rate, None)
        imbalance = np.hypot(*(state.force + state.load))
        for _ in range(START_ITERATIONS):
            if imbalance <= START_TOLERANCE * largest:
                break
            update = -np.linalg.solve(state.damping, state.force + state.load)
            for fraction in 0.5 ** np.arange(START_ITERATIONS):
                trial = self.state(time, x, rate + fraction * update, state.film)
                remaining = np.hypot(*(trial.force + trial.load))
                if remaining < imbalance:
                    break
            rate, state, imbalance = rate + fraction * update, trial, remaining
        return rate
