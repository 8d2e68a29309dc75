"""A shaft in the lubricated bore of a reduced body: gap from coordinates, forces from pressure."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from fenics_ehd.film import Film
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.bore_film import BoreFilm
from fenics_ehd.multibody.compliance import BoreCompliance
from fenics_ehd.reduction.body import ReducedBody


class Journal:
    """Couples the coordinates ``xi`` of a rod with the film in its bore.

    The bore moves relative to the shaft by its translation ``-e`` and its
    elastic displacement, both linear in xi: the gap is ``c + n . Psi xi``, (4)
    and (5) to leading order in c / R, and the force on xi is the integral of
    ``n . Psi`` times the pressure over the same Gauss points, so gap and force
    are conjugate. No tilt, no ``e_t^2`` terms (`fenics_ehd.film.kinematics` has
    them): in these machines they are below 0.1 %. Nor do the residual patterns of
    M4 move the oil along the circumference.

    Parameters
    ----------
    body
        Reduced body of the rod.
    film
        Film in its bore.
    transfer
        See `BoreFilm`.
    damping_time
        zeta of the residual patterns [s].

    Attributes
    ----------
    thickness, mean_velocity, sliding_velocity
        Change of the gap and, per rate, of the two velocities of `Gap` for unit coordinates, at
        the g Gauss points, shape (g, n).
    load, spin_load
        Generalised forces of nodal pressures on the position field and the coordinates, and their
        moment about z, shape (1 + n, nodes).
    compliance
        Residual patterns of M4, None for other bodies.
    """

    def __init__(
        self,
        body: ReducedBody,
        film: Film,
        transfer: str = "conservative",
        damping_time: float = 0.0,
    ):
        self.film = film
        self.bore = BoreFilm(body, film, transfer)
        p = film.parameters
        self._clearance, self._shaft_radius = p.clearance, p.grid.radius - p.clearance
        n = 2 + body.modes
        outward, tangential = (x[..., :n] for x in (self.bore.outward, self.bore.tangential))
        # Velocities as seen from C2, the bore's mean position: with it the shaft moves back.
        carried = self._mean_translation(outward, tangential)
        self.thickness = _flat(outward)
        self.mean_velocity = _flat(0.5 * tangential - carried)
        self.sliding_velocity = _flat(-tangential)
        self.load = self.bore.load[: 1 + n]
        self.spin_load = self.bore.spin_load[: 1 + n]
        self._watched = np.ascontiguousarray(self.bore.watched[:, :n])
        self.compliance = None
        if body.residual is not None and body.residual.rank:
            self.compliance = BoreCompliance.of(self.bore, body.residual.stiffness, damping_time)

    def _mean_translation(self, outward: np.ndarray, tangential: np.ndarray) -> np.ndarray:
        """Tangential component of every field's mean over the bore, at the Gauss points."""
        cosine, sine = (x[:, :, None] for x in self.film.points.normal)
        area = self.film.assembly.area / self.film.assembly.area.sum()
        x = np.einsum("cq,cqn->n", area, cosine * outward - sine * tangential)
        y = np.einsum("cq,cqn->n", area, sine * outward + cosine * tangential)
        return cosine * y - sine * x

    @property
    def coordinates(self) -> int:
        """Number n of coordinates."""
        return self.thickness.shape[1]

    @property
    def size(self) -> int:
        """Length of the state ``x = (xi, y)``."""
        return self.coordinates + (self.compliance.size if self.compliance else 0)

    @cached_property
    def _watching(self) -> np.ndarray:
        if self.compliance is None:
            return self._watched
        return np.hstack([self._watched, self.compliance.watched])

    def gap(self, x: np.ndarray) -> np.ndarray:
        """Gap at every watched point [m] for a state."""
        return self._clearance + self._watching @ x

    def film_gap(self, xi: np.ndarray, xi_rate: np.ndarray, shaft_rate: float) -> Gap:
        """Gap and surface velocities at the film's Gauss points, residual patterns left out."""
        speed = self._shaft_radius * shaft_rate
        shape = self.film.points.angle.shape
        return Gap(
            (self._clearance + self.thickness @ xi).reshape(shape),
            (self.thickness @ xi_rate).reshape(shape),
            (0.5 * speed + self.mean_velocity @ xi_rate).reshape(shape),
            (speed + self.sliding_velocity @ xi_rate).reshape(shape),
        )

    def mean_velocity_slope(self, rate_shift: float, shaft_rate_slope: np.ndarray) -> np.ndarray:
        """Derivative of the mean velocity along xi at the Gauss points, shape (g, n).

        Parameters
        ----------
        rate_shift
            ``d xi' / d xi`` of the time integration formula [1/s].
        shaft_rate_slope
            Derivative of the shaft's speed along xi, shape (n,).
        """
        return rate_shift * self.mean_velocity + 0.5 * self._shaft_radius * shaft_rate_slope

    def resultant(self, pressure: np.ndarray) -> np.ndarray:
        """Force of the film on the rod in the rod's frame, x and y [N]."""
        return self.load[1:3] @ pressure

    def moment(self, xi: np.ndarray, pressure: np.ndarray) -> float:
        """Moment of the film on the rod about the shaft's centre [N m]."""
        return float(np.concatenate([[1.0], xi]) @ self.spin_load @ pressure)


def _flat(values: np.ndarray) -> np.ndarray:
    """Values at cells and Gauss points in one row a point."""
    return np.ascontiguousarray(values.reshape(-1, values.shape[-1]))
