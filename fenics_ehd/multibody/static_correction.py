"""Static correction (M4): bore flexibility that answers the films' pressures at once.

Bore flexibility of one body that answers the films' pressures at once (M4).

    u_bore = Psi q + sum_i d_i y_i,    y + zeta y' = V p

with the residual patterns ``d_i`` of a `ReducedBody` and V their share of nodal pressures.
Structural damping gives y a memory but no inertia: an implicit step ``y' = alpha y + past``
leaves ``y = s (V p - zeta past)`` with ``s = 1 / (1 + zeta alpha)``, so that the patterns add no
unknowns to those of the film. They live on the bore's nodes, the film only reads them.

Quasi-static responses of all bores of a mechanism to their films, within one step (M4).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import linalg, sparse

from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.body import FlexibleBody
from fenics_ehd.multibody.mechanism import FilmPlace, System, consecutive
from fenics_ehd.reduction.body import ReducedBody

#: Gauss points of a body's films up to which answers to forces on all of them are kept.
FEW_POINTS = 2000


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
        """Patterns at the film of a joint."""
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
    shift, share, past
        Of the step: alpha, s and ``y' - alpha y``, shape (r,).
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

    def rows(self, i: int) -> slice:
        """Places of a film's Gauss points among all."""
        return self._points[self.films.index(i)]

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
        return self._answered(self._spread @ pressure)

    def _answered(self, values: Any) -> np.ndarray:
        """Gap change at the Gauss points for what presses on the nodes of the bore."""
        for matrix in self._response:
            values = matrix @ values
        return self._reading @ values

    def pushed(self, forces: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points for normal forces on them [N], shape (g,).

        Here and below of bores that pressures reach by the work they do, not by a mortar.
        """
        return self._answered(self._reading.T @ forces)

    def pushed_by(self, points: np.ndarray) -> np.ndarray:
        """The same for unit forces on some Gauss points, shape (g, a)."""
        if self._reading.shape[0] <= FEW_POINTS:
            return self._pushed[:, points]
        return self._push(points)

    @cached_property
    def _pushed(self) -> np.ndarray:
        return self._push(np.arange(self._reading.shape[0]))

    def _push(self, points: np.ndarray) -> np.ndarray:
        return self._answered(self._reading[points].T)

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

    def leading(self, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Gap change (g, k) and share of nodal pressures (k, nodes) of the k softest patterns.

        Of every film.
        """
        gap = self.each(self._reading @ self._shapes[:, :count])
        spread = np.split(self._spread.T @ self._own[:count].T, self._nodes)
        return [(g, np.ascontiguousarray(s.T)) for g, s in zip(gap, spread, strict=True)]

    def begin(self, shift: float, past: np.ndarray) -> None:
        """Take another step."""
        self.shift, self.past = shift, past
        self.share = 1.0 / (1.0 + self.damping_time * shift)
        # What is left without pressure, and its rate: both are multiples of the past.
        self._resting = self.outward(self.share * past)

    def gap_changes(self, moved: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Changes of every film's gap and of its rate, where pressures move it by so much."""
        change = self.each(moved - self.damping_time * self._resting)
        return list(zip(change, self.each(self.shift * moved + self._resting), strict=True))

    def state(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes y and their rates for nodal pressures [Pa]."""
        y = self.share * (self.amplitudes(pressure) - self.damping_time * self.past)
        return y, self.shift * y + self.past

    def energy(self, amplitudes: np.ndarray) -> float:
        """Strain energy [J]."""
        return float(0.5 * self.stiffness @ amplitudes**2)

    def dissipation(self, rates: np.ndarray) -> float:
        """Power lost in the structure [W]."""
        return float(self.damping_time * self.stiffness @ rates**2)


class BoreResponses:
    """Residual patterns of the bodies that have films and such patterns.

    Parameters
    ----------
    system
        The mechanism.

    Attributes
    ----------
    flexibilities, amplitudes
        Patterns body by body, and the places of their amplitudes y in the state ``(z, y)``.
    """

    def __init__(self, system: System):
        self._system = system
        self.flexibilities = _flexibilities(system)
        self.amplitudes = consecutive(system.n, [f.size for f in self.flexibilities])

    @property
    def size(self) -> int:
        """Number of all amplitudes: unknowns behind z in the state."""
        return sum(f.size for f in self.flexibilities)

    def of_film(self, i: int) -> int | None:
        """Number of the flexibility that a film is part of."""
        return next((b for b, f in enumerate(self.flexibilities) if i in f.films), None)

    def of_body(self, name: str) -> slice:
        """Places in the state of a body's amplitudes; none without."""
        films = {i for i, place in enumerate(self._system.films) if place.bore_body == name}
        found = zip(self.flexibilities, self.amplitudes, strict=True)
        return next((places for own, places in found if films & {*own.films}), slice(0, 0))

    def begin(self, step: ImplicitStep) -> None:
        """Take another step."""
        for flexibility, places in zip(self.flexibilities, self.amplitudes, strict=True):
            flexibility.begin(step.shift, step.past_x[places])

    def past_gap(self, i: int) -> np.ndarray | float:
        """``h' - alpha h`` of a film that its body's patterns make, at the Gauss points [m/s]."""
        body = self.of_film(i)
        if body is None:
            return 0.0
        flexibility = self.flexibilities[body]
        return flexibility.outward(flexibility.past)[flexibility.rows(i)]

    def pressed_at(self, body: int, i: int, points: np.ndarray) -> np.ndarray:
        """Gap change at Gauss points of a body's films for unit pressures of one, (a, nodes)."""
        flexibility = self.flexibilities[body]
        return flexibility.pressed_at(points)[flexibility.films.index(i)]

    def moved(self, body: int, pressures: Sequence[np.ndarray]) -> np.ndarray:
        """Gap change of a body's films that its patterns answer to nodal pressures [m], [Pa]."""
        flexibility = self.flexibilities[body]
        nodal = np.concatenate([pressures[i] for i in flexibility.films])
        return flexibility.moved(flexibility.share * nodal)

    def add(self, pressures: Sequence[np.ndarray], gaps: list[Gap]) -> None:
        """Add what the patterns answer to nodal pressures [Pa] to the gaps of their films."""
        for body, flexibility in enumerate(self.flexibilities):
            changes = flexibility.gap_changes(self.moved(body, pressures))
            for i, change in zip(flexibility.films, changes, strict=True):
                gaps[i] = gaps[i].changed(*change)

    def state(self, pressures: Sequence[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Amplitudes y of every body and their rates, for pressures of every film [Pa]."""
        values, rates = [], []
        for flexibility in self.flexibilities:
            y, rate = flexibility.state(np.concatenate([pressures[i] for i in flexibility.films]))
            values.append(y)
            rates.append(rate)
        return values, rates


def _flexibilities(system: System) -> list[BodyFlexibility]:
    """Residual patterns of bodies with films in their bores, in the order of the films."""
    by_body: dict[str, dict[int, FilmPlace]] = {}
    for i, place in enumerate(system.films):
        if place.bore:
            by_body.setdefault(place.bore_body, {})[i] = place
    found = []
    for name, places in by_body.items():
        body = system.mechanism.bodies[name]
        assert isinstance(body, FlexibleBody)
        if body.reduced.residual is not None and body.reduced.residual.rank:
            found.append(BodyFlexibility(body.reduced, places, body.damping_time))
    return found
