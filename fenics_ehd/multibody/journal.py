"""A shaft in the lubricated bore of a reduced body: gap from coordinates, forces from pressure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.film import Film, FilmState
from fenics_ehd.film.kinematics import Gap, GapSlopes
from fenics_ehd.multibody.bore_film import BoreFilm
from fenics_ehd.reduction.body import ReducedBody


@dataclass(frozen=True, eq=False)
class FilmForces:
    """Generalised film forces on ``xi`` and ``theta`` and their total derivatives along xi."""

    state: FilmState
    on_xi: np.ndarray
    on_theta: float
    on_xi_slope: np.ndarray
    on_theta_slope: np.ndarray


class Journal:
    """Couples the coordinates ``xi`` of a rod with the film in its bore.

    The bore moves relative to the shaft by its translation ``-e`` and its
    elastic displacement, both linear in xi: the gap is ``c + n . Psi xi``, (4)
    and (5) to leading order in c / R, and the force on xi is the integral of
    ``n . Psi`` times the pressure over the same Gauss points, so gap and force
    are conjugate. No tilt, no ``e_t^2`` terms (`fenics_ehd.film.kinematics` has
    them): in these machines they are below 0.1 %.

    Parameters
    ----------
    body
        Reduced body of the rod.
    film
        Film in its bore.
    transfer
        See `BoreFilm`.
    """

    def __init__(self, body: ReducedBody, film: Film, transfer: str = "conservative"):
        self.film = film
        self.bore = BoreFilm(body, film, transfer)
        p = film.parameters
        self._clearance, self._shaft_radius = p.clearance, p.grid.radius - p.clearance
        # Velocities as seen from C2, the bore's mean position: with it the shaft moves back.
        carried = self._mean_translation()
        self._entrainment = 0.5 * self.bore.tangential - carried
        self._sliding = -self.bore.tangential
        self._load = self.bore.load
        self._spin_load = self.bore.spin_load

    def _mean_translation(self) -> np.ndarray:
        """Tangential component of every field's mean over the bore, at the Gauss points."""
        outward, tangential = self.bore.outward, self.bore.tangential
        cosine, sine = (x[:, :, None] for x in self.film.points.normal)
        area = self.film.assembly.area / self.film.assembly.area.sum()
        x = np.einsum("cq,cqn->n", area, cosine * outward - sine * tangential)
        y = np.einsum("cq,cqn->n", area, sine * outward + cosine * tangential)
        return cosine * y - sine * x

    def gap(self, xi: np.ndarray) -> np.ndarray:
        """Gap at every watched point [m]."""
        return self._clearance + self.bore.watched @ xi

    def gap_change(self, change: np.ndarray) -> np.ndarray:
        """Gap change for a change of the coordinates [m]."""
        return self.bore.watched @ change

    def film_gap(self, xi: np.ndarray, xi_rate: np.ndarray, shaft_rate: float) -> Gap:
        """Gap and surface velocities at the film's Gauss points."""
        speed = self._shaft_radius * shaft_rate
        return Gap(
            self._clearance + self.bore.outward @ xi,
            self.bore.outward @ xi_rate,
            0.5 * speed + self._entrainment @ xi_rate,
            speed + self._sliding @ xi_rate,
        )

    def forces(
        self,
        xi: np.ndarray,
        xi_rate: np.ndarray,
        shaft_rate: float,
        shaft_rate_slope: np.ndarray,
        rate_shift: float,
        guess: FilmState | None,
    ) -> FilmForces:
        """Film forces with exact derivatives.

        Parameters
        ----------
        xi, xi_rate
            Coordinates and rates, shape (n,).
        shaft_rate, shaft_rate_slope
            Speed of the shaft relative to the rod [rad/s] and its derivative along xi.
        rate_shift
            ``d xi' / d xi`` of the time integration formula [1/s].
        guess
            Film state to start from.
        """
        state = self.film.solve(self.film_gap(xi, xi_rate, shaft_rate), guess)
        slopes = GapSlopes(
            self.bore.outward,
            rate_shift * self.bore.outward,
            rate_shift * self._entrainment + 0.5 * self._shaft_radius * shaft_rate_slope,
        )
        slope = self.film.sensitivity(state, slopes)
        s = np.concatenate([[1.0], xi])
        moment = self._spin_load @ state.pressure
        return FilmForces(
            state,
            on_xi=self._load[1:] @ state.pressure,
            on_theta=float(s @ moment),
            on_xi_slope=self._load[1:] @ slope,
            on_theta_slope=moment[1:] + (s @ self._spin_load) @ slope,
        )

    def resultant(self, pressure: np.ndarray) -> np.ndarray:
        """Force of the film on the rod in the rod's frame, x and y [N]."""
        return self._load[1:3] @ pressure

    def moment(self, xi: np.ndarray, pressure: np.ndarray) -> float:
        """Moment of the film on the rod about the shaft's centre [N m]."""
        return float(np.concatenate([[1.0], xi]) @ self._spin_load @ pressure)
