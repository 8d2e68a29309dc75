"""A shaft in the lubricated bore of a reduced body: gap from coordinates, forces from pressure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.errors import InterfaceMismatchError
from fenics_ehd.film import Film, FilmState
from fenics_ehd.reduction.body import ReducedBody

#: Largest difference of the film's load from the body's, relative to the largest nodal load.
CONJUGACY_TOLERANCE = 1e-6


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
    elastic displacement, both linear in xi: the gap is ``c + n . Psi xi``, and
    the force on xi is ``Psi^T J P`` with the same ``J`` (15), so gap and force
    are conjugate.

    Parameters
    ----------
    body
        Reduced body of the rod.
    film
        Film on the nodes of that body.
    """

    def __init__(self, body: ReducedBody, film: Film):
        self.film = film
        nodes = len(body.bore_nodes)
        translations = np.zeros((nodes, 3, 2))
        translations[:, 0, 0] = translations[:, 1, 1] = 1.0
        self._directions = np.concatenate([translations, body.bore_basis], axis=2)
        self._flat = self._directions.reshape(3 * nodes, -1)
        self._gap = film.gap_map(self._directions)
        self._load = body.load_projection
        self._spin_load = body.spin_load_projection
        self._check_conjugacy()

    def _check_conjugacy(self) -> None:
        """The film's pressure must do the same work on the bore by its own integrals and by J."""
        for field, direction in ((1, 0), (2, 1)):
            expected = self._load[field]
            own = self.film.load(self._directions[:, :, direction])
            defect = np.abs(own - expected).max() / np.abs(expected).max()
            if not defect <= CONJUGACY_TOLERANCE:
                raise InterfaceMismatchError(
                    f"film and body disagree on the work of a pressure by {defect:.1e} (relative), "
                    f"above {CONJUGACY_TOLERANCE:.0e}: the bore's cells must start at angle zero "
                    "and the body's load matrix must belong to this film element"
                )

    def gap(self, xi: np.ndarray) -> np.ndarray:
        """Gap at every watched point [m]."""
        return self.film.parameters.clearance + self._gap @ xi

    def gap_change(self, change: np.ndarray) -> np.ndarray:
        """Gap change for a change of the coordinates [m]."""
        return self._gap @ change

    def displacement(self, xi: np.ndarray) -> np.ndarray:
        """Bore displacement relative to the shaft, shape (m, 3) [m]."""
        return (self._flat @ xi).reshape(-1, 3)

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
        state = self.film.solve(
            self.displacement(xi), self.displacement(xi_rate), shaft_rate, guess
        )
        slope = self.film.sensitivity(state, self._directions, rate_shift, shaft_rate_slope)
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
