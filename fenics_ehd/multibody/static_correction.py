"""Static correction (M4): bore flexibility that answers the films' pressures at once.

    u_bore = Psi q + sum_i d_i y_i,    y + zeta y' = V p

with the residual patterns ``d_i`` of every `ReducedBody` and V their share of nodal pressures.
Structural damping gives y a memory but no inertia: an implicit step ``y' = alpha y + past``
leaves ``y = s (V p - zeta past)`` with ``s = 1 / (1 + zeta alpha)``, so that the patterns add no
unknowns to those of the film. They live on the bores' nodes, the films only read them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.body import FlexibleBody
from fenics_ehd.multibody.mechanism import FilmBinding, System, consecutive

#: Gauss points of all films up to which answers to forces on all of them are kept.
FEW_POINTS = 2000


@dataclass(frozen=True, eq=False)
class _Bore:
    """Residual patterns at one bore and the film in it.

    Attributes
    ----------
    shapes
        Displacement of the bore's m nodes, shape (2 m, r).
    own
        Amplitudes of what presses on them, shape (r, 2 m); by a mortar, on pressure nodes.
    reading, observing
        From the nodes' displacement to the gap at the Gauss points, and where it is observed.
    spread, pushing
        From the film's nodal pressures and from normal forces on its Gauss points to what presses;
        forces do not reach a bore that pressures reach by a mortar.
    """

    shapes: np.ndarray
    own: np.ndarray
    reading: sparse.csr_matrix
    observing: sparse.csr_matrix
    spread: sparse.csr_matrix
    pushing: sparse.csr_matrix

    @classmethod
    def of(cls, body: FlexibleBody | None, binding: FilmBinding) -> _Bore:
        """Patterns at the film of a joint; without a body there are none."""
        joint = binding.film
        if body is None or not binding.bore:
            g = len(joint.thickness)
            w = len(joint.observed)
            nodes = joint.load.shape[1]
            none = [sparse.csr_matrix(shape) for shape in ((g, 0), (w, 0), (0, nodes), (0, g))]
            return cls(np.zeros((0, 0)), np.zeros((0, 0)), *none)
        bore = joint.bore
        residual = body.reduced.at_bore(binding.bore).residual
        assert residual is not None
        assert bore is not None
        m = len(residual.displacement)
        shapes = residual.displacement[:, :2].reshape(2 * m, -1)
        plane = (3 * np.arange(m)[:, None] + np.arange(2)).ravel()
        reading = bore.normal[:, plane].tocsr()
        observing = bore.observed_normal[:, plane].tocsr()
        if bore.projected is not None:
            # Pressures that reach the bore by the mortar load it with the body's own matrix.
            spread = sparse.csr_matrix(bore.projected)
            none = sparse.csr_matrix((spread.shape[0], reading.shape[0]))
            return cls(shapes, residual.patterns, reading, observing, spread, none)
        own = np.ascontiguousarray(shapes.T / residual.stiffness[:, None])
        area = sparse.csr_matrix(joint.film.pressure_areas)
        if bore.solid is not None:
            area = sparse.diags(bore.solid.ravel()) @ area
        pushing = reading.T.tocsr()
        return cls(shapes, own, reading, observing, (pushing @ area).tocsr(), pushing)


@dataclass(frozen=True, eq=False)
class _Body:
    """Residual patterns of one body in all its bores with films.

    Attributes
    ----------
    films
        Numbers of its films.
    patterns, nodes, pressed
        Places of its amplitudes, of the displacements of its bores' nodes, and of what presses on
        them, among those of all bodies.
    shapes, own
        Those of its bores together.
    """

    films: list[int]
    patterns: slice
    nodes: np.ndarray
    pressed: np.ndarray
    shapes: np.ndarray
    own: np.ndarray

    @cached_property
    def response(self) -> tuple[np.ndarray, ...]:
        """From what presses on the bores' nodes to their displacement: one matrix or two."""
        if self.shapes.size + self.own.size < self.shapes.shape[0] * self.own.shape[1]:
            return self.own, self.shapes
        return (self.shapes @ self.own,)


class BoreResponses:
    """Residual patterns of the bodies that have films and such patterns.

    Values at Gauss points, where gaps are observed, and nodal pressures are those of all films,
    one film after the other: what one of them presses moves all bores of its body.

    Parameters
    ----------
    system
        The mechanism.

    Attributes
    ----------
    size
        Number r of all patterns.
    places
        Of their amplitudes y in the state ``(z, y)``.
    points
        Places of every film's Gauss points among all.
    shift, share, past_gap
        Of the step: alpha, and at the Gauss points s and ``h' - alpha h`` by the patterns, shape
        (g,) [m/s].
    """

    def __init__(self, system: System):
        films = system.films
        flexible = _flexible_bodies(system)
        parts = [_Bore.of(flexible.get(binding.bore_body), binding) for binding in films]
        self._reading = _beside([part.reading for part in parts])
        self._observing = _beside([part.observing for part in parts])
        self._spread = _beside([part.spread for part in parts])
        self._pushing = _beside([part.pushing for part in parts])
        self.points = consecutive(0, [part.reading.shape[0] for part in parts])
        self._pressures = consecutive(0, [part.spread.shape[1] for part in parts])
        nodes = consecutive(0, [part.reading.shape[1] for part in parts])
        pressed = consecutive(0, [part.spread.shape[0] for part in parts])
        self.bodies: dict[str, _Body] = {}
        self.size = 0
        self._damping_at = np.zeros(self._reading.shape[0])
        damping = [np.zeros(0)]
        stiffness = [np.zeros(0)]
        for name, body in flexible.items():
            own = [i for i, binding in enumerate(films) if binding.bore_body == name and binding.bore]
            residual = body.reduced.residual
            zeta = body.damping_time
            assert residual is not None
            self.bodies[name] = _Body(
                own,
                slice(self.size, self.size + residual.rank),
                _joined(nodes, own),
                _joined(pressed, own),
                np.vstack([parts[i].shapes for i in own]),
                np.hstack([parts[i].own for i in own]),
            )
            self.size += residual.rank
            self._damping_at[_joined(self.points, own)] = zeta
            damping.append(np.full(residual.rank, zeta))
            stiffness.append(residual.stiffness)
        self._damping = np.concatenate(damping)
        self._stiffness = np.concatenate(stiffness)
        self.places = slice(system.n, system.n + self.size)

    def body_of(self, i: int) -> _Body | None:
        """Body with patterns whose bore a film is in."""
        return next((body for body in self.bodies.values() if i in body.films), None)

    def of_body(self, name: str) -> slice:
        """Places in the state of a body's amplitudes; none without."""
        if name not in self.bodies:
            return slice(0, 0)
        own = self.bodies[name].patterns
        first = self.places.start
        return slice(first + own.start, first + own.stop)

    def observed(self, amplitudes: np.ndarray) -> np.ndarray:
        """Gap change where gaps are observed, for amplitudes, shape (w,)."""
        return self._observing @ self._displacement(amplitudes)

    def _displacement(self, amplitudes: np.ndarray) -> np.ndarray:
        """Displacement of the bores' nodes for amplitudes."""
        found = np.zeros(self._reading.shape[1])
        for body in self.bodies.values():
            found[body.nodes] = body.shapes @ amplitudes[body.patterns]
        return found

    def _response(self, pressed: Any) -> np.ndarray:
        """Gap change at the Gauss points, at once, for what presses, of shape (k,) or (k, a)."""
        found = np.zeros((self._reading.shape[1], *pressed.shape[1:]))
        for body in self.bodies.values():
            values = pressed[body.pressed]
            for matrix in body.response:
                values = matrix @ values
            found[body.nodes] = values
        return self._reading @ found

    def gap_change_from_pressure(self, pressures: Sequence[np.ndarray]) -> np.ndarray:
        """Gap change at the Gauss points that answers nodal pressures of the films [m], [Pa]."""
        return self.share * self._response(self._spread @ np.concatenate(pressures))

    def gap_change_from_forces(self, forces: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points that answers normal forces on them [N], shape (g,)."""
        return self.share * self._response(self._pushing @ forces)

    def unit_force_response(self, points: np.ndarray) -> np.ndarray:
        """The same for unit forces on some Gauss points, shape (g, a)."""
        few = self._reading.shape[0] <= FEW_POINTS
        found = (
            self._all_unit_force_responses[:, points]
            if few
            else self._response(self._pushing[:, points])
        )
        return self.share[:, None] * found

    @cached_property
    def _all_unit_force_responses(self) -> np.ndarray:
        return self._response(self._pushing)

    def unit_pressure_response(self, i: int, points: np.ndarray) -> np.ndarray:
        """Gap change at some Gauss points that answers unit nodal pressures of a film.

        Returns
        -------
        numpy.ndarray
            shape (a, nodes) [m/Pa].
        """
        body = self.body_of(i)
        assert body is not None
        values = self._reading[points][:, body.nodes]
        for matrix in reversed(body.response):
            values = values @ matrix
        spread = self._spread[body.pressed][:, self._pressures[i]]
        return self.share[points, None] * (spread.T @ values.T).T

    def retained_patterns(self, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Gap change (g, k) and share of nodal pressures (k, nodes) of the k softest patterns.

        Of every film: at most `count`, none where the bore has none.
        """
        found = []
        for i, (points, nodes) in enumerate(zip(self.points, self._pressures, strict=True)):
            body = self.body_of(i)
            if body is None:
                empty = np.zeros((points.stop - points.start, 0))
                found.append((empty, np.zeros((0, nodes.stop - nodes.start))))
                continue
            gap = self._reading[points][:, body.nodes] @ body.shapes[:, :count]
            spread = self._spread[body.pressed][:, nodes].T @ body.own[:count].T
            found.append((gap, np.ascontiguousarray(spread.T)))
        return found

    def begin(self, step: ImplicitStep) -> None:
        """Take another step."""
        self.shift = step.shift
        self._past = step.past_x[self.places]
        self._own_share = 1.0 / (1.0 + self._damping * self.shift)
        self.share = 1.0 / (1.0 + self._damping_at * self.shift)
        self.past_gap = self._reading @ self._displacement(self._past)

    def add(self, pressures: Sequence[np.ndarray], gaps: list[Gap]) -> None:
        """Add what the patterns answer to nodal pressures [Pa] to the gaps of their films."""
        if not self.size:
            return
        # What is left without pressure, and its rate: both are multiples of the past.
        moved = self.gap_change_from_pressure(pressures)
        resting = self.share * self.past_gap
        change = moved - self._damping_at * resting
        rate = self.shift * moved + resting
        for i, own in enumerate(self.points):
            gaps[i] = gaps[i].changed(change[own], rate[own])

    def static(self, pressures: Sequence[np.ndarray], forces: np.ndarray) -> np.ndarray:
        """Amplitudes at rest under nodal pressures [Pa] and forces on the Gauss points [N]."""
        pressed = self._spread @ np.concatenate(pressures)
        found = np.zeros(self.size)
        if forces.any():
            pressed = pressed + self._pushing @ forces
        for body in self.bodies.values():
            found[body.patterns] = body.own @ pressed[body.pressed]
        return found

    def state(self, static: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes y and their rates, from those at rest under the step's forces."""
        y = self._own_share * (static - self._damping * self._past)
        return y, self.shift * y + self._past

    def energy(self, amplitudes: np.ndarray) -> float:
        """Strain energy [J]."""
        return float(0.5 * self._stiffness @ amplitudes**2)

    def dissipation(self, rates: np.ndarray) -> float:
        """Power lost in the structures [W]."""
        return float(self._damping * self._stiffness @ rates**2)


def _flexible_bodies(system: System) -> dict[str, FlexibleBody]:
    """Bodies with residual patterns and films in their bores, in the order of the films."""
    found = {}
    for binding in system.films:
        body = system.mechanism.bodies.get(binding.bore_body)
        if binding.bore and isinstance(body, FlexibleBody):
            residual = body.reduced.residual
            if residual is not None and residual.rank:
                found[binding.bore_body] = body
    return found


def _beside(blocks: list[sparse.csr_matrix]) -> sparse.csr_matrix:
    """Blocks along a diagonal."""
    return sparse.block_diag([*blocks, sparse.csr_matrix((0, 0))], format="csr")


def _joined(places: Sequence[slice], chosen: Sequence[int]) -> np.ndarray:
    """Numbers in some of the places."""
    return np.concatenate([np.arange(places[i].start, places[i].stop) for i in chosen])
