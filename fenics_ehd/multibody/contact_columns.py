"""Exact derivatives of contact in the Newton system of a step.

Contact that depends on coordinates alone has the stiffness ``N^T p_c' N`` of its forces in the
core. Where residual patterns answer it at once (M4) the contact pressures that count are unknowns
in x behind the others,

    dp_c - p_c' (N dxi + S dp_c + sum_f S_f dP_f) = 0,

and change the gaps of all the body's films by S. The pressures themselves are known at every
evaluation (`contacts`), so that the right-hand side is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fenics_ehd.multibody.border import FilmBorder
from fenics_ehd.multibody.bore_responses import BoreResponses
from fenics_ehd.multibody.contacts import Contacts
from fenics_ehd.multibody.film_columns import FilmColumns, FilmPoint
from fenics_ehd.multibody.system import FilmPlace, consecutive


class ContactColumns:
    """Derivatives of contact at one point.

    Parameters
    ----------
    contacts, responses, places, films
        Of the mechanism, the last two of every film.
    first
        Number of the other unknowns x.

    Attributes
    ----------
    size
        Number of all unknowns x.
    """

    def __init__(
        self,
        contacts: Contacts,
        responses: BoreResponses,
        places: Sequence[FilmPlace],
        films: Sequence[FilmPoint],
        first: int,
    ):
        self._contacts, self._responses = contacts, responses
        self._places, self._films = places, films
        self._points = []
        for body, flexibility in enumerate(responses.flexibilities):
            found = np.zeros(0, dtype=int)
            if contacts.areas[body] is not None:
                thickness = [films[i].gap.thickness.ravel() for i in flexibility.films]
                found = np.flatnonzero(contacts.near(body, np.concatenate(thickness)))
            self._points.append(found)
        self._unknowns = consecutive(first, [len(points) for points in self._points])
        self.size = self._unknowns[-1].stop if self._unknowns else first

    def enter(self, core: np.ndarray, speed: np.ndarray) -> None:
        """Take all that does not depend on film pressures into S.

        Parameters
        ----------
        core
            Ones on the diagonal of the contact pressures.
        speed
            Derivative of all rates along the unknowns of motion.
        """
        for i, film in enumerate(self._films):
            joint = self._contacts.joints[i]
            if joint is None:
                continue
            touch = film.touch
            assert touch is not None
            points, unknowns = self._own(i)
            stiffness = touch.slope[points, None] * joint.outward(film.turned)[points]
            forces = joint.per_pressure(film.gap, points, film.turned)
            if unknowns is None:
                core[np.ix_(joint.rows, joint.rows)] -= forces @ stiffness
            else:
                core[np.ix_(joint.rows, unknowns)] -= forces
                core[np.ix_(unknowns, joint.rows)] -= stiffness
            if film.turned is not None:
                core[np.ix_(joint.rows, joint.rows)] -= joint.bent(touch, film.turned)
            if joint.friction:
                along = joint.rubbing_per_rate(touch, film.gap, points)
                core[joint.rows, : speed.shape[1]] += along @ speed[joint.rows]
        for body, points in enumerate(self._points):
            if len(points):
                own = self._unknowns[body]
                core[own, own] -= self._slopes(body)[:, None] * self._moved(body)[points]

    def _own(self, i: int) -> tuple[np.ndarray, np.ndarray | None]:
        """A film's Gauss points that count, and their unknowns where they have any."""
        body = self._responses.of_film(i)
        if body is None:
            joint = self._contacts.joints[i]
            assert joint is not None
            return np.flatnonzero(joint.near(self._films[i].gap.thickness)), None
        rows, points = self._rows(body, i), self._points[body]
        inside = np.flatnonzero((points >= rows.start) & (points < rows.stop))
        return points[inside] - rows.start, inside + self._unknowns[body].start

    def _rows(self, body: int, i: int) -> slice:
        """Gauss points of a film among those of its body."""
        films = self._responses.flexibilities[body].films
        sizes = [self._films[other].gap.thickness.size for other in films]
        return consecutive(0, sizes)[films.index(i)]

    def _slopes(self, body: int) -> np.ndarray:
        """``p_c'`` at the points that count, shape (a,)."""
        flexibility = self._responses.flexibilities[body]
        touches = [self._films[i].touch for i in flexibility.films]
        values = [
            np.zeros(self._films[i].gap.thickness.size) if touch is None else touch.slope
            for i, touch in zip(flexibility.films, touches, strict=True)
        ]
        return np.concatenate(values)[self._points[body]]

    def _moved(self, body: int) -> np.ndarray:
        """Gap change at all Gauss points for unit contact pressures, shape (g, a)."""
        reached = self._contacts.reached(body, self._points[body])
        return self._responses.share(body) * reached.of(self._points[body])

    def extend(self, i: int, border: FilmBorder, scale: float, columns: FilmColumns) -> FilmBorder:
        """Border of a film with what contact and pressures do by its bore."""
        body = self._responses.of_film(i)
        if body is None or not len(self._points[body]):
            return border
        film, own = self._places[i].film.film, self._unknowns[body]
        moved = self._moved(body)[self._rows(body, i)]
        inputs = (border.along_gap @ moved)[columns.nodes] / scale
        spread = np.zeros((inputs.shape[1], border.spread.shape[1]))
        spread[:, own] = np.eye(len(spread))
        answered = self._responses.pressed_at(body, i, self._points[body])
        answered = columns.of_pressures(answered)
        factor = film.parameters.pressure_scale * self._responses.share(body) * self._slopes(body)
        return replace(
            border,
            inputs=np.hstack([border.inputs, inputs]),
            spread=np.vstack([border.spread, spread]),
            outputs=np.vstack([border.outputs, -factor[:, None] * answered]),
            rows=np.concatenate([border.rows, np.arange(own.start, own.stop)]),
            contact=(own, moved),
        )
