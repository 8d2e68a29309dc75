"""Static correction (M4): quasi-static part of the bores' flexibility.

    u_bore = Psi q + sum_i d_i y_i,    y + zeta y' = V p

with the residual patterns ``d_i`` of every `ReducedBody`, and V their amplitudes at rest for unit
nodal pressures. Structural damping gives y a memory but no inertia: an implicit step ``y' = alpha y
+ past`` yields ``y = s (V p - zeta past)`` with ``s = 1 / (1 + zeta alpha)``, so that the patterns
add no unknowns to those of the film. Patterns are displacements of the bores' nodes, which the
films interpolate.
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
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.mechanism import System, consecutive

#: Number of Gauss points of all films up to which the responses to unit forces are stored: a dense
#: matrix of this size has 32 MB.
FEW_POINTS = 2000


@dataclass(frozen=True, eq=False)
class _Bore:
    """Residual patterns at one bore and the film in it.

    Attributes
    ----------
    shapes
        Displacements of the bore's m nodes for unit amplitudes, shape (2 m, r).
    amplitudes
        Amplitudes at rest for unit loads of the bore, shape (r, l). Loads are forces on its nodes,
        l = 2 m; with a mortar, pressures at the body's pressure nodes.
    to_gap, to_observed
        Matrices from displacements to the gap at the Gauss points, and where gaps are observed.
    from_pressure, from_forces
        Matrices from the film's nodal pressures, and from normal forces on its Gauss points, to
        loads. The latter is zero with a mortar.
    """

    shapes: np.ndarray
    amplitudes: np.ndarray
    to_gap: sparse.csr_matrix
    to_observed: sparse.csr_matrix
    from_pressure: sparse.csr_matrix
    from_forces: sparse.csr_matrix

    @classmethod
    def of(cls, body: FlexibleBody | None, binding: FilmBinding) -> _Bore:
        """Patterns of a body at the film of a joint; None: there are none."""
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
        to_gap = bore.normal[:, plane].tocsr()
        to_observed = bore.observed_normal[:, plane].tocsr()
        if bore.projected is not None:
            # Pressures that reach the bore by the mortar load it with the body's own matrix.
            from_pressure = sparse.csr_matrix(bore.projected)
            none = sparse.csr_matrix((from_pressure.shape[0], to_gap.shape[0]))
            return cls(shapes, residual.patterns, to_gap, to_observed, from_pressure, none)
        amplitudes = np.ascontiguousarray(shapes.T / residual.stiffness[:, None])
        area = sparse.csr_matrix(joint.film.pressure_areas)
        if bore.solid is not None:
            area = sparse.diags(bore.solid.ravel()) @ area
        from_forces = to_gap.T.tocsr()
        from_pressure = (from_forces @ area).tocsr()
        return cls(shapes, amplitudes, to_gap, to_observed, from_pressure, from_forces)


@dataclass(frozen=True, eq=False)
class _Body:
    """Residual patterns of one body in all its bores with films.

    Attributes
    ----------
    films
        Indices of its films.
    patterns, displacements, loads
        Indices of its amplitudes, of the displacements of its bores' nodes, and of the loads of
        its bores among those of all bodies.
    shapes, amplitudes
        As of `_Bore`, for all its bores together.
    """

    films: list[int]
    patterns: slice
    displacements: np.ndarray
    loads: np.ndarray
    shapes: np.ndarray
    amplitudes: np.ndarray

    @cached_property
    def response(self) -> tuple[np.ndarray, ...]:
        """Factors from loads to displacements: two matrices, or their product if it is smaller."""
        product = self.shapes.shape[0] * self.amplitudes.shape[1]
        if self.shapes.size + self.amplitudes.size < product:
            return self.amplitudes, self.shapes
        return (self.shapes @ self.amplitudes,)


class BoreResponses:
    """Residual patterns of all bodies that have patterns and films.

    Arrays at Gauss points, at points where gaps are observed, and at nodes contain all films, one
    after the other: the pressure of one film deforms all bores of its body.

    Parameters
    ----------
    system
        The mechanism.

    Attributes
    ----------
    size
        Number r of all patterns.
    indices
        Indices of their amplitudes y in the state ``(z, y)``.
    points
        Indices of every film's Gauss points.
    shift
        alpha of the step [1/s].
    share
        s of the step at the Gauss points, shape (g,).
    past_gap
        ``h' - alpha h`` of the gap change h from past amplitudes, shape (g,) [m/s].
    """

    def __init__(self, system: System):
        films = system.films
        flexible = _flexible_bodies(system)
        parts = [_Bore.of(flexible.get(binding.bore_body), binding) for binding in films]
        self._to_gap = _block_diagonal([part.to_gap for part in parts])
        self._to_observed = _block_diagonal([part.to_observed for part in parts])
        self._from_pressure = _block_diagonal([part.from_pressure for part in parts])
        self._from_forces = _block_diagonal([part.from_forces for part in parts])
        self.points = consecutive(0, [part.to_gap.shape[0] for part in parts])
        self._pressures = consecutive(0, [part.from_pressure.shape[1] for part in parts])
        displacements = consecutive(0, [part.to_gap.shape[1] for part in parts])
        loads = consecutive(0, [part.from_pressure.shape[0] for part in parts])
        self.bodies: dict[str, _Body] = {}
        self.size = 0
        self._damping_at = np.zeros(self._to_gap.shape[0])
        damping = [np.zeros(0)]
        stiffness = [np.zeros(0)]
        for name, body in flexible.items():
            members = [i for i, film in enumerate(films) if film.bore_body == name and film.bore]
            residual = body.reduced.residual
            zeta = body.damping_time
            assert residual is not None
            self.bodies[name] = _Body(
                members,
                slice(self.size, self.size + residual.rank),
                _indices(displacements, members),
                _indices(loads, members),
                np.vstack([parts[i].shapes for i in members]),
                np.hstack([parts[i].amplitudes for i in members]),
            )
            self.size += residual.rank
            self._damping_at[_indices(self.points, members)] = zeta
            damping.append(np.full(residual.rank, zeta))
            stiffness.append(residual.stiffness)
        self._damping = np.concatenate(damping)
        self._stiffness = np.concatenate(stiffness)
        self.indices = slice(system.n, system.n + self.size)

    def body_of(self, i: int) -> _Body | None:
        """Body with patterns whose bore a film is in."""
        return next((body for body in self.bodies.values() if i in body.films), None)

    def of_body(self, name: str) -> slice:
        """Indices of a body's amplitudes in the state; an empty slice if it has none."""
        if name not in self.bodies:
            return slice(0, 0)
        patterns = self.bodies[name].patterns
        first = self.indices.start
        return slice(first + patterns.start, first + patterns.stop)

    def observed(self, amplitudes: np.ndarray) -> np.ndarray:
        """Gap change where gaps are observed, for amplitudes, shape (w,)."""
        return self._to_observed @ self._displacement(amplitudes)

    def _displacement(self, amplitudes: np.ndarray) -> np.ndarray:
        """Displacements of the bores' nodes for amplitudes."""
        displacement = np.zeros(self._to_gap.shape[1])
        for body in self.bodies.values():
            displacement[body.displacements] = body.shapes @ amplitudes[body.patterns]
        return displacement

    def _static_response(self, loads: Any) -> np.ndarray:
        """Gap change at rest at the Gauss points for loads of shape (l,) or (l, a)."""
        displacement = np.zeros((self._to_gap.shape[1], *loads.shape[1:]))
        for body in self.bodies.values():
            values = loads[body.loads]
            for matrix in body.response:
                values = matrix @ values
            displacement[body.displacements] = values
        return self._to_gap @ displacement

    def gap_change_from_pressure(self, pressures: Sequence[np.ndarray]) -> np.ndarray:
        """Gap change at the Gauss points due to nodal pressures of the films [m], [Pa]."""
        return self.share * self._static_response(self._from_pressure @ np.concatenate(pressures))

    def gap_change_from_forces(self, forces: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points due to normal forces there [N], shape (g,)."""
        return self.share * self._static_response(self._from_forces @ forces)

    def unit_force_response(self, points: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points for unit normal forces on some of them, shape (g, a)."""
        few = self._to_gap.shape[0] <= FEW_POINTS
        if few:
            response = self._unit_force_responses[:, points]
        else:
            response = self._static_response(self._from_forces[:, points])
        return self.share[:, None] * response

    @cached_property
    def _unit_force_responses(self) -> np.ndarray:
        return self._static_response(self._from_forces)

    def unit_pressure_response(self, i: int, points: np.ndarray) -> np.ndarray:
        """Gap change at some Gauss points for unit nodal pressures of a film.

        Returns
        -------
        numpy.ndarray
            shape (a, nodes) [m/Pa].
        """
        body = self.body_of(i)
        assert body is not None
        values = self._to_gap[points][:, body.displacements]
        for matrix in reversed(body.response):
            values = values @ matrix
        from_pressure = self._from_pressure[body.loads][:, self._pressures[i]]
        return self.share[points, None] * (from_pressure.T @ values.T).T

    def retained_patterns(self, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """The k softest patterns at every film, k at most `count`, 0 if its bore has none.

        Returns
        -------
        list of tuples
            Gap change for unit amplitudes, shape (g, k), and amplitudes at rest for unit nodal
            pressures, shape (k, nodes).
        """
        retained = []
        for i, (points, nodes) in enumerate(zip(self.points, self._pressures, strict=True)):
            body = self.body_of(i)
            if body is None:
                empty = np.zeros((points.stop - points.start, 0))
                retained.append((empty, np.zeros((0, nodes.stop - nodes.start))))
                continue
            gap = self._to_gap[points][:, body.displacements] @ body.shapes[:, :count]
            from_pressure = self._from_pressure[body.loads][:, nodes]
            amplitudes = from_pressure.T @ body.amplitudes[:count].T
            retained.append((gap, np.ascontiguousarray(amplitudes.T)))
        return retained

    def begin(self, step: ImplicitStep) -> None:
        """Start a step."""
        self.shift = step.shift
        self._past = step.past_x[self.indices]
        self._share_of_patterns = 1.0 / (1.0 + self._damping * self.shift)
        self.share = 1.0 / (1.0 + self._damping_at * self.shift)
        self.past_gap = self._to_gap @ self._displacement(self._past)

    def add(self, pressures: Sequence[np.ndarray], gaps: list[Gap]) -> None:
        """Add the gap changes due to nodal pressures of all films [Pa] to the gaps."""
        if not self.size:
            return
        # The gap change without pressure and its rate are multiples of the past.
        by_pressure = self.gap_change_from_pressure(pressures)
        resting = self.share * self.past_gap
        change = by_pressure - self._damping_at * resting
        rate = self.shift * by_pressure + resting
        for i, points in enumerate(self.points):
            gaps[i] = gaps[i].changed(change[points], rate[points])

    def static(self, pressures: Sequence[np.ndarray], forces: np.ndarray) -> np.ndarray:
        """Amplitudes at rest under nodal pressures [Pa] and forces on the Gauss points [N]."""
        loads = self._from_pressure @ np.concatenate(pressures)
        if forces.any():
            loads = loads + self._from_forces @ forces
        amplitudes = np.zeros(self.size)
        for body in self.bodies.values():
            amplitudes[body.patterns] = body.amplitudes @ loads[body.loads]
        return amplitudes

    def state(self, static: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes y and their rates, from amplitudes at rest under the step's forces."""
        y = self._share_of_patterns * (static - self._damping * self._past)
        return y, self.shift * y + self._past

    def energy(self, amplitudes: np.ndarray) -> float:
        """Strain energy [J]."""
        return float(0.5 * self._stiffness @ amplitudes**2)

    def dissipation(self, rates: np.ndarray) -> float:
        """Power dissipated by structural damping [W]."""
        return float(self._damping * self._stiffness @ rates**2)


def _flexible_bodies(system: System) -> dict[str, FlexibleBody]:
    """Bodies with residual patterns and films in their bores, in the order of the films."""
    bodies = {}
    for binding in system.films:
        body = system.mechanism.bodies.get(binding.bore_body)
        if binding.bore and isinstance(body, FlexibleBody):
            residual = body.reduced.residual
            if residual is not None and residual.rank:
                bodies[binding.bore_body] = body
    return bodies


def _block_diagonal(blocks: list[sparse.csr_matrix]) -> sparse.csr_matrix:
    """Blocks along a diagonal; the empty block serves lists without any."""
    return sparse.block_diag([*blocks, sparse.csr_matrix((0, 0))], format="csr")


def _indices(slices: Sequence[slice], chosen: Sequence[int]) -> np.ndarray:
    """Indices in the chosen slices."""
    return np.concatenate([np.arange(slices[i].start, slices[i].stop) for i in chosen])
