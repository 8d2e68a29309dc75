"""A shaft that moves and tilts in the bore of a clamped body: linear maps of the film."""

from __future__ import annotations

import numpy as np

from fenics_ehd.film import Film
from fenics_ehd.multibody.journal import Journal
from fenics_ehd.reduction.body import ReducedBody


class ShaftJournal(Journal):
    """Couples the coordinates of a shaft and of a clamped body with the film between them.

    Coordinates ``xi = (a, q)``: those of the shaft, then those of the body. The shaft's centre
    at height z of the bore lies at ``e(z) = e + z (psi_y, -psi_x)`` and

        h = c + n . (Psi q - e(z))

    is linear in xi, (4) and (5) to leading order in c / R. A shaft that moves to one side is a
    bore that moves to the other, so that its columns are those of the bore's translations,
    turned around and, for the tilt, times z.

    Parameters
    ----------
    body
        Reduced body with the bore.
    film
        Film in its bore.
    shaft
        The shaft's ``(e_x, e_y, psi_x, psi_y)`` at mid-width of the bore for unit coordinates,
        shape (4, s) [m], [rad].
    transfer, damping_time
        See `Journal`.

    Attributes
    ----------
    centre
        Position of the shaft's centre relative to the bore's, x and y, shape (2, n) [m].
    tilt
        Rotation of the shaft about x and y, shape (2, n) [rad].
    """

    def __init__(
        self,
        body: ReducedBody,
        film: Film,
        shaft: np.ndarray,
        transfer: str = "conservative",
        damping_time: float = 0.0,
    ):
        super().__init__(body, film, transfer, damping_time)
        inside = film.points.height.ravel()
        watched = np.concatenate([inside, film.parameters.grid.node_positions[:, 1]])
        mean = self._mean_motion()
        pushed = _moved(self.thickness, inside) @ shaft
        on_shaft = film.load(pushed.reshape(*film.points.height.shape, -1))
        self._watched = np.hstack([_moved(self._watched, watched) @ shaft, self._watched[:, 2:]])
        self.thickness, self.mean_velocity, self.sliding_velocity = (
            np.hstack([_moved(columns, inside) @ shaft, columns[:, 2:]])
            for columns in (self.thickness, self.mean_velocity, self.sliding_velocity)
        )
        self.load = np.vstack([self.load[:1], on_shaft, self.load[3:]])
        self.centre = np.hstack([shaft[:2], -mean])
        self.tilt = np.hstack([shaft[2:], np.zeros_like(mean)])

    def _mean_motion(self) -> np.ndarray:
        """X and y components of every elastic field's mean over the bore, shape (2, n)."""
        fields = slice(2, self.coordinates)
        outward, tangential = (x[..., fields] for x in (self.bore.outward, self.bore.tangential))
        cosine, sine = (x[..., None] for x in self.film.points.normal)
        area = self.film.assembly.area / self.film.assembly.area.sum()
        x = np.einsum("cq,cqn->n", area, cosine * outward - sine * tangential)
        y = np.einsum("cq,cqn->n", area, sine * outward + cosine * tangential)
        return np.stack([x, y])


def _moved(columns: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Columns of ``(e_x, e_y, psi_x, psi_y)`` from the bore's translations, the first two."""
    x, y = -columns[:, 0], -columns[:, 1]
    return np.column_stack([x, y, -height * y, height * x])
