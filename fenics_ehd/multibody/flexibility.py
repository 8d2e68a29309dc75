"""Bore flexibility of one body that answers the films' pressures at once (M4).

    u_bore = Psi q + sum_i d_i y_i,    y + zeta y' = V p

with the residual patterns ``d_i`` of a `ReducedBody` and V their share of nodal pressures.
Structural damping gives y a memory but no inertia: an implicit step ``y' = alpha y + past``
leaves ``y = s (V p - zeta past)`` with ``s = 1 / (1 + zeta alpha)``, so that the patterns add no
unknowns to those of the film. They live on the bore's nodes, the film only reads them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from fenics_ehd.multibody.lubricated_joint import JointFilm
from fenics_ehd.reduction.body import ReducedBody


@dataclass(frozen=True, eq=False)
class Answer:
    """How the patterns answer within one step.

    Attributes
    ----------
    shift, share
        alpha and s.
    past
        ``y' - alpha y``, shape (r,).
    rest
        ``-s zeta past``: amplitudes without pressure.
    """

    shift: float
    share: float
    past: np.ndarray
    rest: np.ndarray


class BodyFlexibility:
    """Residual patterns of one body and the film in its bore.

    Parameters
    ----------
    body
        With a residual flexibility.
    film
        The film of its bore.
    damping_time
        zeta [s].

    Attributes
    ----------
    size
        Number r of patterns.
    stiffness
        Energy of unit amplitudes, twice, shape (r,) [J/Pa^2].
    """

    def __init__(self, body: ReducedBody, film: JointFilm, damping_time: float):
        residual, bore = body.residual, film.bore
        assert residual is not None
        assert bore is not None
        self.size, self.stiffness = residual.rank, residual.stiffness
        self.damping_time = damping_time
        m = len(body.bore_nodes)
        self._shapes = residual.displacement[:, :2].reshape(2 * m, -1)
        plane = (3 * np.arange(m)[:, None] + np.arange(2)).ravel()
        self._reading = bore.normal[:, plane].tocsr()
        self._own = np.ascontiguousarray(self._shapes.T / self.stiffness[:, None])
        area = sparse.csr_matrix(film.film.pressure_areas)
        self._spread = (self._reading.T @ area).tocsr()
        if bore.projected is not None:
            # Pressures that reach the bore by the mortar load it with the body's own matrix.
            self._own, self._spread = residual.patterns, bore.projected
        watched = bore.watched_normal[:, plane]
        self.watched = watched @ self._shapes

    def amplitudes(self, pressure: np.ndarray) -> np.ndarray:
        """``V p`` of nodal pressures of the film [Pa], shape (r,)."""
        return self._own @ (self._spread @ pressure)

    def outward(self, amplitudes: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points for amplitudes, shape (g,) or, of columns, (g, k)."""
        return self._reading @ (self._shapes @ amplitudes)

    def moved(self, pressure: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points for nodal pressures [Pa], shape (g,)."""
        values = self._spread @ pressure
        for matrix in self._response:
            values = matrix @ values
        return self._reading @ values

    @cached_property
    def _response(self) -> tuple[np.ndarray, ...]:
        """From what presses on the bore's nodes to their displacement: one matrix or two."""
        if self._shapes.size + self._own.size < self._shapes.shape[0] * self._own.shape[1]:
            return self._own, self._shapes
        return (self._shapes @ self._own,)

    @property
    def answer_matrix(self) -> np.ndarray:
        """Gap change at the Gauss points for unit nodal pressures, shape (g, nodes) [m/Pa]."""
        spread = (self._spread.T @ self._own.T).T
        return self._reading @ (self._shapes @ spread)

    def leading(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Gap change (g, k) and share of nodal pressures (k, nodes) of the k softest patterns."""
        spread = (self._spread.T @ self._own[:count].T).T
        return self._reading @ self._shapes[:, :count], np.ascontiguousarray(spread)

    def answer(self, shift: float, past: np.ndarray) -> Answer:
        """See `Answer`."""
        share = 1.0 / (1.0 + self.damping_time * shift)
        return Answer(shift, share, past, -share * self.damping_time * past)

    def energy(self, amplitudes: np.ndarray) -> float:
        """Strain energy [J]."""
        return float(0.5 * self.stiffness @ amplitudes**2)

    def dissipation(self, rates: np.ndarray) -> float:
        """Power lost in the structure [W]."""
        return float(self.damping_time * self.stiffness @ rates**2)
