"""Quasi-static responses of all bores of a mechanism to their films, within one step (M4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.flexibility import BodyFlexibility
from fenics_ehd.multibody.flexible_body import FlexibleBody
from fenics_ehd.multibody.implicit_step import ImplicitStep
from fenics_ehd.multibody.system import FilmPlace, System, consecutive


class BoreResponses:
    """Residual patterns of the bodies that have films and such patterns.

    Parameters
    ----------
    system
        The mechanism.
    dense
        Whether the matrix of each film is dense: it then has its body's answer, where no other
        film is on the same body.

    Attributes
    ----------
    flexibilities, amplitudes
        Patterns body by body, and the places of their amplitudes y in the state ``(z, y)``.
    matrices
        Gap changes of unit pressures at the free nodes of a film whose own matrix has its body's
        answer; None for other bodies.
    """

    def __init__(self, system: System, dense: Sequence[bool]):
        self._system = system
        self.flexibilities = _flexibilities(system)
        self.amplitudes = consecutive(system.n, [f.size for f in self.flexibilities])
        self.matrices = [
            np.ascontiguousarray(f.answer_matrix[:, system.films[f.films[0]].film.film.free])
            if len(f.films) == 1 and dense[f.films[0]]
            else None
            for f in self.flexibilities
        ]
        # Of the pressures that are given.
        self._given = [
            f.moved(np.concatenate([_scaled(system.films[i], None) for i in f.films]))
            for f in self.flexibilities
        ]

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
        self._answers = [
            f.answer(step.shift, step.past_x[places])
            for f, places in zip(self.flexibilities, self.amplitudes, strict=True)
        ]
        # What is left without pressure, and its rate: both are multiples of the past.
        self._resting = [
            f.outward(a.share * a.past)
            for f, a in zip(self.flexibilities, self._answers, strict=True)
        ]

    def past_gap(self, i: int) -> np.ndarray | float:
        """``h' - alpha h`` of a film that its body's patterns make, at the Gauss points [m/s]."""
        body = self.of_film(i)
        if body is None:
            return 0.0
        flexibility = self.flexibilities[body]
        past = flexibility.each(flexibility.outward(self._answers[body].past))
        return past[flexibility.films.index(i)]

    def share(self, body: int) -> float:
        """``s`` of `Answer`."""
        return self._answers[body].share

    def shift(self, body: int) -> float:
        """Alpha of `Answer`."""
        return self._answers[body].shift

    def pressed_at(self, body: int, i: int, points: np.ndarray) -> np.ndarray:
        """Gap change at Gauss points of a body's films for unit pressures of one, (a, nodes)."""
        flexibility = self.flexibilities[body]
        return flexibility.pressed_at(points)[flexibility.films.index(i)]

    def moved(self, body: int, pressures: Sequence[np.ndarray]) -> np.ndarray:
        """Gap change of a body's films that its patterns answer to dimensionless pressures [m].

        Of every film at its free nodes.
        """
        flexibility, matrix = self.flexibilities[body], self.matrices[body]
        share, films = self.share(body), self._system.films
        if matrix is not None:
            (i,) = flexibility.films
            return matrix @ (share * films[i].film.film.parameters.pressure_scale * pressures[i])
        nodal = [_scaled(films[i], share * pressures[i]) for i in flexibility.films]
        return flexibility.moved(np.concatenate(nodal))

    def add(self, pressures: Sequence[np.ndarray], gaps: list[Gap]) -> None:
        """Add what the patterns answer to the gaps of their films."""
        for body, (flexibility, answer) in enumerate(
            zip(self.flexibilities, self._answers, strict=True)
        ):
            resting = self._resting[body]
            moved = self.moved(body, pressures) + answer.share * self._given[body]
            change = flexibility.each(moved - flexibility.damping_time * resting)
            rate = flexibility.each(answer.shift * moved + resting)
            for place, i in enumerate(flexibility.films):
                gap, shape = gaps[i], gaps[i].thickness.shape
                gaps[i] = replace(
                    gap,
                    thickness=gap.thickness + change[place].reshape(shape),
                    thickness_rate=gap.thickness_rate + rate[place].reshape(shape),
                )

    def state(self, pressures: Sequence[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Amplitudes y of every body and their rates, for pressures of every film [Pa]."""
        values, rates = [], []
        for flexibility, answer in zip(self.flexibilities, self._answers, strict=True):
            nodal = np.concatenate([pressures[i] for i in flexibility.films])
            y = answer.share * flexibility.amplitudes(nodal) + answer.rest
            values.append(y)
            rates.append(answer.shift * y + answer.past)
        return values, rates


def _scaled(place: FilmPlace, free: np.ndarray | None) -> np.ndarray:
    """Pressures [Pa] at all nodes of a film of dimensionless free ones; None: those given."""
    film = place.film.film
    nodal = film.equation.given if free is None else np.zeros(film.assembly.size)
    if free is not None:
        nodal[film.free] = free
    return film.parameters.pressure_scale * nodal


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
