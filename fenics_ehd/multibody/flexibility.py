"""Bore flexibility of one body that answers the films' pressures at once (M4).

    u_bore = Psi q + sum_i d_i y_i,    y + zeta y' = V p

with the residual patterns ``d_i`` of a `ReducedBody` and V their share of nodal pressures.
Structural damping gives y a memory but no inertia: an implicit step ``y' = alpha y + past``
leaves ``y = s (V p - zeta past)`` with ``s = 1 / (1 + zeta alpha)``, so that the patterns add no
unknowns to those of the film. They live on the bore's nodes, the film only reads them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import linalg, sparse

from fenics_ehd.multibody.system import FilmPlace, consecutive
from fenics_ehd.reduction.body import ReducedBody

#: Gauss points of a body's films up to which answers to forces on all of them are kept.
FEW_POINTS = 2000


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


@dataclass(frozen=True, eq=False)
class _BorePatterns:
    """Residual patterns at one bore and the film in it.

    Attributes
    ----------
    shapes
        Displacement of the bore's m nodes, shape (2 m, r).
    own
        Amplitudes of what presses on them, shape (r, 2 m); by a mortar, on pressure nodes.
    reading, observing, spread
        From the nodes' displacement to the gap at the Gauss points, and where it is observed; from
        the film's nodal pressures to what presses.
    """

    shapes: np.ndarray
    own: np.ndarray
    reading: sparse.csr_matrix
    observing: sparse.csr_matrix
    spread: Any

    @classmethod
    def of(cls, body: ReducedBody, place: FilmPlace) -> _BorePatterns:
        """Of the film of a joint."""
        bore, residual = place.film.bore, body.at_bore(place.bore).residual
        assert residual is not None
        assert bore is not None
        m = len(residual.displacement)
        shapes = residual.displacement[:, :2].reshape(2 * m, -1)
        plane = (3 * np.arange(m)[:, None] + np.arange(2)).ravel()
        reading, observing = bore.normal[:, plane].tocsr(), bore.observed_normal[:, plane].tocsr()
        if bore.projected is not None:
            # Pressures that reach the bore by the mortar load it with the body's own matrix.
            return cls(shapes, residual.patterns, reading, observing, bore.projected)
        own = np.ascontiguousarray(shapes.T / residual.stiffness[:, None])
        area = sparse.csr_matrix(place.film.film.pressure_areas)
        if bore.solid is not None:
            area = sparse.diags(bore.solid.ravel()) @ area
        return cls(shapes, own, reading, observing, (reading.T @ area).tocsr())


def _beside(blocks: list[Any]) -> Any:
    """Blocks along a diagonal: sparse, or dense where one is."""
    if len(blocks) == 1:
        return blocks[0]
    if all(sparse.issparse(block) for block in blocks):
        return sparse.block_diag(blocks, format="csr")
    return linalg.block_diag(*(b.toarray() if sparse.issparse(b) else b for b in blocks))


class BodyFlexibility:
    """Residual patterns of one body and the films in its bores.

    Nodal pressures and Gauss points are those of its films, one film after the other: what one
    of them presses moves the bores of all.

    Parameters
    ----------
    body
        With a residual flexibility.
    places
        Its lubricated joints by their numbers in `System.films`.
    damping_time
        zeta [s].

    Attributes
    ----------
    size
        Number r of patterns.
    films
        Numbers of its films.
    stiffness
        Energy of unit amplitudes, twice, shape (r,) [J/Pa^2].
    """

    def __init__(self, body: ReducedBody, places: Mapping[int, FilmPlace], damping_time: float):
        residual = body.residual
        assert residual is not None
        self.size, self.stiffness = residual.rank, residual.stiffness
        self.films, self.damping_time = tuple(places), damping_time
        parts = [_BorePatterns.of(body, place) for place in places.values()]
        self._shapes = np.vstack([part.shapes for part in parts])
        self._own = np.hstack([part.own for part in parts])
        self._reading = _beside([part.reading for part in parts])
        self._spread = _beside([part.spread for part in parts])
        self._observing = _beside([part.observing for part in parts])
        self._points = consecutive(0, [part.reading.shape[0] for part in parts])
        self._observed = consecutive(0, [part.observing.shape[0] for part in parts])
        self._nodes = np.cumsum([part.spread.shape[1] for part in parts])[:-1]

    def each(self, values: np.ndarray) -> list[np.ndarray]:
        """Rows of all Gauss points, film by film."""
        return [values[own] for own in self._points]

    def observed(self, amplitudes: np.ndarray) -> list[np.ndarray]:
        """Gap change of every film where it is observed, for amplitudes, shape (w,) each."""
        values = self._observing @ (self._shapes @ amplitudes)
        return [values[own] for own in self._observed]

    def amplitudes(self, pressure: np.ndarray) -> np.ndarray:
        """``V p`` of nodal pressures [Pa], shape (r,)."""
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

    def pushed(self, forces: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points for normal forces on them [N], shape (g,).

        Here and below of bores that pressures reach by the work they do, not by a mortar.
        """
        values = self._reading.T @ forces
        for matrix in self._response:
            values = matrix @ values
        return self._reading @ values

    def pushed_by(self, points: np.ndarray) -> np.ndarray:
        """The same for unit forces on some Gauss points, shape (g, a)."""
        if self._reading.shape[0] <= FEW_POINTS:
            return self._pushed[:, points]
        return self._push(points)

    @cached_property
    def _pushed(self) -> np.ndarray:
        return self._push(np.arange(self._reading.shape[0]))

    def _push(self, points: np.ndarray) -> np.ndarray:
        values = self._reading[points]
        for matrix in self._response:
            values = values @ matrix.T
        return self._reading @ values.T

    def pushed_amplitudes(self, forces: np.ndarray) -> np.ndarray:
        """Amplitudes for normal forces on the Gauss points [N], shape (r,)."""
        return self._own @ (self._reading.T @ forces)

    def pressed_at(self, points: np.ndarray) -> list[np.ndarray]:
        """Gap change at some Gauss points for unit nodal pressures, film by film, (a, nodes)."""
        values = self._reading[points]
        for matrix in reversed(self._response):
            values = values @ matrix
        return np.split((self._spread.T @ values.T).T, self._nodes, axis=1)

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

    def leading(self, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Gap change (g, k) and share of nodal pressures (k, nodes) of the k softest patterns.

        Of every film.
        """
        gap = self.each(self._reading @ self._shapes[:, :count])
        spread = np.split(self._spread.T @ self._own[:count].T, self._nodes)
        return [(g, np.ascontiguousarray(s.T)) for g, s in zip(gap, spread, strict=True)]

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
