"""Static correction (M4): quasi-static part of the flexibility of surfaces.

    u = Psi q + sum_i d_i y_i,    y + zeta y' = V p

with the residual patterns ``d_i`` of a body, and V their amplitudes at rest for unit nodal
pressures. Structural damping gives y a memory but no inertia: an implicit step ``y' = alpha y +
past`` yields ``y = s (V p - zeta past)`` with ``s = 1 / (1 + zeta alpha)``, so that the patterns
add no unknowns to those of the film. Patterns are displacements of the nodes of a body's surfaces,
which the films interpolate: `Compliance` has the maps of one surface.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.film_binding import BoundSurface, FilmBinding
from fenics_ehd.multibody.mechanism import System, consecutive
from fenics_ehd.multibody.surface import Compliance

#: Matrices of a `Compliance` between its surface and a film.
MATRICES = ("to_gap", "to_observed", "from_pressure", "from_forces")

#: Number of Gauss points of all films up to which the responses to unit forces are stored: a dense
#: matrix of this size has 32 MB.
FEW_POINTS = 2000


@dataclass(frozen=True, eq=False)
class _Body:
    """Residual patterns of one body on all its surfaces with films.

    Attributes
    ----------
    films
        Indices of its films.
    patterns, displacements, loads
        Indices of its amplitudes, of the displacements of its surfaces' nodes, and of the loads of
        its surfaces, each among those of all bodies.
    shapes, amplitudes
        As of `Compliance`, for all its surfaces together.
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
    after the other: the pressure of one film deforms all surfaces of its bodies.

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
    bodies
        Bodies with patterns by name, in the order of their films.
    points
        Indices of every film's Gauss points.
    shift
        alpha of the step [1/s].
    share
        s of the step at the Gauss points, shape (g,).
    past_gap
        ``h' - alpha h`` of the gap change h from past amplitudes, shape (g,) [m/s].

    Raises
    ------
    SettingsError
        A journal that turns has patterns, or two surfaces with patterns and different damping face
        each other.
    """

    def __init__(self, system: System):
        films = system.films
        surfaces = list(_compliant_surfaces(films))
        of_film = [[each for film, _, each in surfaces if film == i] for i in range(len(films))]
        matrices = [_of_film(*each) for each in zip(films, of_film, strict=True)]
        self._to_gap, self._to_observed, self._from_pressure, self._from_forces = (
            # The last, empty blocks serve mechanisms without films.
            sparse.block_diag(blocks, format="csr")
            for blocks in zip(*matrices, [sparse.csr_matrix((0, 0))] * 4, strict=True)
        )
        self.points = consecutive(0, [len(film.film.thickness) for film in films])
        self._pressures = consecutive(0, [film.film.load.shape[1] for film in films])
        compliances = [each for _, _, each in surfaces]
        displacements = consecutive(0, [each.to_gap.shape[1] for each in compliances])
        loads = consecutive(0, [each.from_pressure.shape[0] for each in compliances])
        self.bodies: dict[str, _Body] = {}
        self.size = 0
        self._damping_at = np.zeros(self._to_gap.shape[0])
        damping = [np.zeros(0)]
        stiffness = [np.zeros(0)]
        for name in dict.fromkeys(body for _, body, _ in surfaces):
            members = [k for k, (_, body, _) in enumerate(surfaces) if body == name]
            body_films = [surfaces[k][0] for k in members]
            first = compliances[members[0]]
            rank = len(first.stiffness)
            self.bodies[name] = _Body(
                body_films,
                slice(self.size, self.size + rank),
                _indices(displacements, members),
                _indices(loads, members),
                np.vstack([compliances[k].shapes for k in members]),
                np.hstack([compliances[k].amplitudes for k in members]),
            )
            self.size += rank
            self._damping_at[_indices(self.points, body_films)] = first.damping_time
            damping.append(np.full(rank, first.damping_time))
            stiffness.append(first.stiffness)
        self._damping = np.concatenate(damping)
        self._stiffness = np.concatenate(stiffness)
        self.indices = slice(system.n, system.n + self.size)

    def bodies_of(self, i: int) -> list[_Body]:
        """Bodies with patterns that have a surface of film i, at most two."""
        return [body for body in self.bodies.values() if i in body.films]

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
        response = np.zeros((len(points), self._pressures[i].stop - self._pressures[i].start))
        for body in self.bodies_of(i):
            values = self._to_gap[points][:, body.displacements]
            for matrix in reversed(body.response):
                values = values @ matrix
            from_pressure = self._from_pressure[body.loads][:, self._pressures[i]]
            response += (from_pressure.T @ values.T).T
        return self.share[points, None] * response

    def retained_patterns(self, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """The softest patterns at every film, at most `count` of every body.

        Returns
        -------
        list of tuples
            Gap change for unit amplitudes, shape (g, k), and amplitudes at rest for unit nodal
            pressures, shape (k, nodes). The k patterns are in the order of `pattern_indices`; k is
            0 if no surface of the film has patterns.
        """
        retained = []
        for i, (points, nodes) in enumerate(zip(self.points, self._pressures, strict=True)):
            gaps = [np.zeros((points.stop - points.start, 0))]
            amplitudes = [np.zeros((0, nodes.stop - nodes.start))]
            for body in self.bodies_of(i):
                gaps.append(self._to_gap[points][:, body.displacements] @ body.shapes[:, :count])
                from_pressure = self._from_pressure[body.loads][:, nodes]
                amplitudes.append((from_pressure.T @ body.amplitudes[:count].T).T)
            both = np.hstack(gaps), np.vstack(amplitudes)
            retained.append((np.ascontiguousarray(both[0]), np.ascontiguousarray(both[1])))
        return retained

    def pattern_indices(self, count: int, first: int) -> tuple[list[np.ndarray], int]:
        """Indices of every film's retained patterns among unknowns, and the end of all.

        Films on one body have its patterns in common.

        Parameters
        ----------
        count
            Largest number of retained patterns of a body.
        first
            Index of the first pattern.
        """
        indices = [np.zeros(0, dtype=int)] * len(self.points)
        last = first
        for body in self.bodies.values():
            patterns = np.arange(last, last + min(count, len(body.amplitudes)))
            last += len(patterns)
            for i in body.films:
                indices[i] = np.concatenate([indices[i], patterns])
        return indices, last

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


def _compliant_surfaces(films: Sequence[FilmBinding]) -> Iterator[tuple[int, str, Compliance]]:
    """Index of the film, name of the body, and compliance of every surface with patterns.

    Raises
    ------
    SettingsError
        See `BoreResponses`.
    """
    for i, binding in enumerate(films):
        compliances = [(bound, bound.surface.compliance) for bound in binding.surfaces]
        patterns = [(bound, each) for bound, each in compliances if each is not None]
        _check_patterns(binding, patterns)
        for bound, each in patterns:
            yield i, bound.body, each


def _check_patterns(
    binding: FilmBinding, patterns: Sequence[tuple[BoundSurface, Compliance]]
) -> None:
    """Refuse patterns of a surface that turns through the film, and two kinds of damping."""
    for bound, _ in patterns:
        if bound.surface.turning:
            raise SettingsError(
                f"joints.{binding.name}.journal = {binding.joint.journal!r}: residual patterns "
                f"(method M4) of a journal that turns are not available: reduce body {bound.body} "
                "by another method"
            )
    times = {bound.body: compliance.damping_time for bound, compliance in patterns}
    if len(set(times.values())) > 1:
        different = ", ".join(f"{name}: {time:g} s" for name, time in times.items())
        raise SettingsError(
            f"joints.{binding.name}: the bodies of both surfaces have residual patterns (method "
            f"M4), but different damping_time ({different}): it must be the same"
        )


def _of_film(
    binding: FilmBinding, compliances: Sequence[Compliance]
) -> tuple[sparse.csr_matrix, ...]:
    """Matrices `to_gap`, `to_observed`, `from_pressure`, `from_forces` of all surfaces of a film.

    Loads and displacements of the surfaces follow each other; there are none without compliance.
    """
    joint = binding.film
    g = len(joint.thickness)
    w = len(joint.observed)
    none = [
        sparse.csr_matrix(shape) for shape in ((g, 0), (w, 0), (0, joint.load.shape[1]), (0, g))
    ]
    to_gap, to_observed, from_pressure, from_forces = (
        [matrix, *(getattr(each, name) for each in compliances)]
        for name, matrix in zip(MATRICES, none, strict=True)
    )
    return (
        sparse.hstack(to_gap, format="csr"),
        sparse.hstack(to_observed, format="csr"),
        sparse.vstack(from_pressure, format="csr"),
        sparse.vstack(from_forces, format="csr"),
    )


def _indices(slices: Sequence[slice], chosen: Sequence[int]) -> np.ndarray:
    """Indices in the chosen slices."""
    return np.concatenate([np.arange(slices[i].start, slices[i].stop) for i in chosen])
