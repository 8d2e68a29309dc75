"""Static correction (M4): quasi-static part of the flexibility of surfaces.

The displacement of a body's surfaces is

    u = Psi q + sum_i d_i y_i,    y + zeta y' = V p

with elastic modes Psi, residual patterns ``d_i`` and their amplitudes ``y_i``, nodal pressures p of
the body's films, and static amplitudes V for unit pressures. The structural damping time zeta
delays y, but y has no inertia. An implicit step ``y' = alpha y + past`` gives
``y = s (V p - zeta past)`` with ``s = 1 / (1 + zeta alpha)``. Amplitudes thus follow from
pressures, and add no unknowns to the step. Patterns are displacements of the nodes of a body's
surfaces, which are interpolated to the films; `Compliance` has the maps of one surface.
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

#: Names of the matrices of a `Compliance` between its surface and a film.
MATRICES = ("to_gap", "to_observed", "from_pressure", "from_forces")

#: Largest number of Gauss points of all films for which the responses to unit forces are stored:
#: the dense matrix has 32 MB.
FEW_POINTS = 2000


@dataclass(frozen=True, eq=False)
class _Body:
    """Residual patterns of one body on all its surfaces with films.

    Attributes
    ----------
    films
        Indices of the body's films among all films.
    patterns, displacements, loads
        Indices of the body's amplitudes, of the displacements of its surfaces' nodes, and of the
        loads of its surfaces, in the arrays with the values of all bodies.
    shapes, amplitudes
        Displacements for unit amplitudes, and static amplitudes for unit loads, see `Compliance`,
        of all surfaces of the body together.
    stiffness
        Stiffness of every amplitude, shape (r,).
    mortar
        Whether a mortar transfers pressures to one of the surfaces.
    """

    films: list[int]
    patterns: slice
    displacements: np.ndarray
    loads: np.ndarray
    shapes: np.ndarray
    amplitudes: np.ndarray
    stiffness: np.ndarray
    mortar: bool

    @cached_property
    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrices from l loads to r amplitudes, and from r amplitudes to u static displacements.

        With a mortar they are `amplitudes` and `shapes`. Without a mortar, loads are forces on the
        nodes, and the response is symmetric. Amplitudes are then scaled so that the first matrix is
        the transpose of the second: both use one array, because reading its entries takes most of
        the time of a product.
        """
        if self.mortar:
            return self.amplitudes, self.shapes
        root = self.shapes / np.sqrt(self.stiffness)
        return root.T, root


class PatternResponses:
    """Responses of all films' surfaces to forces, through the residual patterns of their bodies.

    Arrays at Gauss points, at points where gaps are observed, and at nodes contain all films, one
    after the other, because the pressure of one film deforms all surfaces of its bodies.

    Parameters
    ----------
    system
        The mechanism.

    Attributes
    ----------
    size
        Number r of the patterns of all bodies.
    indices
        Indices of the patterns' amplitudes y in the state ``(z, y)``.
    bodies
        Patterns of the bodies that have patterns, by name, in the order of their films.
    points
        Indices of every film's Gauss points among those of all films.
    shift
        Shift alpha of the step's formula ``y' = alpha y + past`` [1/s].
    share
        Response within the step over the static response, ``1 / (1 + zeta alpha)`` with the
        structural damping time zeta of the body, at the Gauss points of all films, shape (g,).
    past_gap
        Part ``h' - alpha h`` of the rate of the gap change h, from past amplitudes, shape (g,)
        [m/s].

    Raises
    ------
    SettingsError
        If a turning journal has patterns, or both surfaces of a film have patterns and different
        damping.
    """

    def __init__(self, system: System):
        films = system.films
        surfaces = list(_compliant_surfaces(films))
        of_film = [[each for film, _, each in surfaces if film == i] for i in range(len(films))]
        matrices = [_of_film(*each) for each in zip(films, of_film, strict=True)]
        self._to_gap, self._to_observed, self._from_pressure, self._from_forces = (
            # Empty blocks at the end, because `block_diag` needs a block for mechanisms without
            # films.
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
                first.stiffness,
                any(not compliances[k].from_forces.nnz for k in members),
            )
            self.size += rank
            self._damping_at[_indices(self.points, body_films)] = first.damping_time
            damping.append(np.full(rank, first.damping_time))
            stiffness.append(first.stiffness)
        self._damping = np.concatenate(damping)
        self._stiffness = np.concatenate(stiffness)
        self.indices = slice(system.n, system.n + self.size)

    def bodies_of(self, i: int) -> list[_Body]:
        """Residual patterns of the bodies of film i: at most two, of bore and journal."""
        return [body for body in self.bodies.values() if i in body.films]

    def of_body(self, name: str) -> slice:
        """Indices of a body's amplitudes y in the state ``(z, y)`` of the time integration.

        The slice is empty if the body has no patterns.
        """
        if name not in self.bodies:
            return slice(0, 0)
        patterns = self.bodies[name].patterns
        first = self.indices.start
        return slice(first + patterns.start, first + patterns.stop)

    def observed(self, amplitudes: np.ndarray) -> np.ndarray:
        """Gap change at the w points where gaps are observed, for amplitudes y, shape (w,) [m]."""
        return self._to_observed @ self._displacement(amplitudes)

    def _displacement(self, amplitudes: np.ndarray) -> np.ndarray:
        """Displacements of the nodes of all surfaces for amplitudes y of residual patterns [m]."""
        displacement = np.zeros(self._to_gap.shape[1])
        for body in self.bodies.values():
            displacement[body.displacements] = body.shapes @ amplitudes[body.patterns]
        return displacement

    def _static_response(self, loads: Any, first: int = 0) -> np.ndarray:
        """Static gap change at the Gauss points of all films due to residual patterns [m].

        `loads` has the l loads of all surfaces, shape (l,), or several sets of them, shape (l, k).
        The first `first` patterns of every body do not respond.
        """
        displacement = np.zeros((self._to_gap.shape[1], *loads.shape[1:]))
        for body in self.bodies.values():
            amplitudes, shapes = body.factors
            values = amplitudes[first:] @ loads[body.loads]
            displacement[body.displacements] = shapes[:, first:] @ values
        return self._to_gap @ displacement

    def gap_change_from_pressure(
        self, pressures: Sequence[np.ndarray], first: int = 0
    ) -> np.ndarray:
        """Gap change at the Gauss points in this step due to nodal pressures of all films [Pa].

        The first `first` patterns of every body do not contribute.
        """
        loads = self._from_pressure @ np.concatenate(pressures)
        return self.share * self._static_response(loads, first)

    def gap_change_from_forces(self, forces: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points of all films in this step, shape (g,) [m].

        It is due to normal forces at the same points, shape (g,) [N].
        """
        return self.share * self._static_response(self._from_forces @ forces)

    def unit_force_response(self, points: np.ndarray) -> np.ndarray:
        """Gap change at all Gauss points in this step, for unit normal forces at some of them.

        `points` has the indices of the loaded points, shape (a,); the result has the shape (g, a)
        [m/N].
        """
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
        """Gap change in this step at some Gauss points for unit nodal pressures of film i.

        `points` has the indices of these points, shape (a,); the result has the shape (a, nodes)
        [m/Pa].
        """
        response = np.zeros((len(points), self._pressures[i].stop - self._pressures[i].start))
        for body in self.bodies_of(i):
            values = self._to_gap[points][:, body.displacements]
            amplitudes, shapes = body.factors
            values = (values @ shapes) @ amplitudes
            from_pressure = self._from_pressure[body.loads][:, self._pressures[i]]
            response += (from_pressure.T @ values.T).T
        return self.share[points, None] * response

    def retained_patterns(self, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Softest residual patterns at every film, at most `count` for each body of the film.

        Returns
        -------
        list of tuples
            For every film: gap change for unit amplitudes of k patterns, shape (g, k), and static
            amplitudes for unit nodal pressures, shape (k, nodes). Patterns are in the order of
            `pattern_indices`; k is 0 if no surface of the film has patterns.
        """
        retained = []
        for i, (points, nodes) in enumerate(zip(self.points, self._pressures, strict=True)):
            gaps = [np.zeros((points.stop - points.start, 0))]
            amplitudes = [np.zeros((0, nodes.stop - nodes.start))]
            for body in self.bodies_of(i):
                gaps.append(self._to_gap[points][:, body.displacements] @ body.shapes[:, :count])
                from_pressure = self._from_pressure[body.loads][:, nodes]
                amplitudes.append((from_pressure.T @ body.amplitudes[:count].T).T)
            gap = np.ascontiguousarray(np.hstack(gaps))
            retained.append((gap, np.ascontiguousarray(np.vstack(amplitudes))))
        return retained

    def pattern_indices(self, count: int, first: int) -> tuple[list[np.ndarray], int]:
        """Indices of every film's retained patterns among the unknowns, and the next free index.

        All films on a body have the same patterns of this body.

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
        """Start a time step: store the shift of its formula, and the past amplitudes."""
        self.shift = step.shift
        self._past = step.past_x[self.indices]
        self._share_of_patterns = 1.0 / (1.0 + self._damping * self.shift)
        self.share = 1.0 / (1.0 + self._damping_at * self.shift)
        self.past_gap = self._to_gap @ self._displacement(self._past)

    def add(self, pressures: Sequence[np.ndarray], gaps: list[Gap]) -> None:
        """Replace the gaps of all films by gaps that include the deformation in residual patterns.

        The deformation is due to nodal pressures, one array for every film [Pa].
        """
        if not self.size:
            return
        # Without pressure, the gap change and its rate are multiples of `past_gap`.
        by_pressure = self.gap_change_from_pressure(pressures)
        resting = self.share * self.past_gap
        change = by_pressure - self._damping_at * resting
        rate = self.shift * by_pressure + resting
        for i, points in enumerate(self.points):
            gaps[i] = gaps[i].changed(change[points], rate[points])

    def add_amplitudes(self, amplitudes: np.ndarray, rates: np.ndarray, gaps: list[Gap]) -> None:
        """Replace the gaps of all films by gaps with the deformation of given amplitudes.

        `amplitudes` are those of the residual patterns, `rates` their rates, shape (r,) each.
        """
        if not self.size:
            return
        change, rate = (self._to_gap @ self._displacement(y) for y in (amplitudes, rates))
        for i, points in enumerate(self.points):
            gaps[i] = gaps[i].changed(change[points], rate[points])

    def static(self, pressures: Sequence[np.ndarray], forces: np.ndarray) -> np.ndarray:
        """Static amplitudes of the r patterns of all bodies for loads on the films, shape (r,).

        Loads are nodal pressures of every film [Pa], and normal forces at all Gauss points [N].
        """
        loads = self._from_pressure @ np.concatenate(pressures)
        if forces.any():
            loads = loads + self._from_forces @ forces
        amplitudes = np.zeros(self.size)
        for body in self.bodies.values():
            amplitudes[body.patterns] = body.amplitudes @ loads[body.loads]
        return amplitudes

    def state(self, static: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes of the residual patterns at the end of the step, and their rates, (r,) each.

        `static` are the amplitudes without damping, shape (r,).
        """
        y = self._share_of_patterns * (static - self._damping * self._past)
        return y, self.shift * y + self._past

    def energy(self, amplitudes: np.ndarray) -> float:
        """Strain energy of the residual patterns for given amplitudes [J]."""
        return float(0.5 * self._stiffness @ amplitudes**2)

    def dissipation(self, rates: np.ndarray) -> float:
        """Power that structural damping dissipates in residual patterns [W].

        `rates` are the rates of their amplitudes, shape (r,).
        """
        return float(self._damping * self._stiffness @ rates**2)


def _compliant_surfaces(films: Sequence[FilmBinding]) -> Iterator[tuple[int, str, Compliance]]:
    """Yield index of the film, name of the body, and compliance of every surface with patterns.

    Raises
    ------
    SettingsError
        See `PatternResponses`.
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
    """Refuse residual patterns that a film cannot have.

    They are patterns of a surface that turns through the film, and patterns of both surfaces whose
    bodies have different damping.
    """
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
            f"M4), but different damping_time ({different}): give both bodies the same damping_time"
        )


def _of_film(
    binding: FilmBinding, compliances: Sequence[Compliance]
) -> tuple[sparse.csr_matrix, ...]:
    """Matrices of the residual patterns of both surfaces of a film, in the order of `MATRICES`.

    `Compliance` describes them. Displacements and loads of one surface follow those of the other.
    The matrices are empty if no surface has residual patterns.
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
    """Indices in the slices with the numbers `chosen`, one slice after the other, in one array."""
    return np.concatenate([np.arange(slices[i].start, slices[i].stop) for i in chosen])
