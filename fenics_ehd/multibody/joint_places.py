"""Where force, journal, thinnest film and peak pressure of a lubricated joint are, step by step.

Angles are those of the bore's frame, from its x axis, positive from x to y, in -180..180 degrees:
what is at rest in the bore, a groove say, keeps its angle. Heights count from mid-width.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.multibody.deformed_bore import nearest_circle
from fenics_ehd.multibody.marker import ANGLE
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.system import FilmPlace, System

#: Values that differ by less than this share are equal: of the two mirrored places of a film
#: without misalignment the upper one is told, not the one that round-off chose.
EQUAL = 1e-9


class JointPlaces:
    """Columns of one lubricated joint.

    Parameters
    ----------
    system, place
        Which.
    """

    def __init__(self, system: System, place: FilmPlace):
        film = place.film.film
        self._place = place
        self._nodes = film.parameters.grid.node_positions
        # Where the gap is observed: at Gauss points, then at nodes.
        inside = np.column_stack([film.points.angle.ravel(), film.points.height.ravel()])
        self._observed = np.vstack([inside, self._nodes])
        round_and_rigid = place.film.bore is None and place.film.shape is None
        self._circle = None if round_and_rigid else nearest_circle(film)[1:]
        self._turned = 0.0
        body = system.mechanism.bodies.get(place.bore_body)
        if place.bore_angle is None and body is not None:
            self._turned = float(body.marker("", body.start).values[ANGLE])

    def columns(
        self, step: MechanismStep, pressure: np.ndarray, gap: np.ndarray
    ) -> dict[str, float]:
        """Columns at an accepted step.

        Parameters
        ----------
        step
            With the film's solution.
        pressure, gap
            At the nodes [Pa] and where it is observed [m].
        """
        place = self._place
        force = step.solution.motion.multipliers[place.rows]
        # Of the journal's load on the bore: the joint's own force is the one on the journal.
        towards = np.arctan2(-force[1], -force[0]) - place.angles(step.x)[1] - self._turned
        x, y = step.x[place.xi[:2]]
        if self._circle is not None:
            x, y = self._circle @ gap[-len(self._nodes) :]
        (_, peak_height), (thin_angle, thin_height) = (
            upper_most(self._nodes, -pressure),
            upper_most(self._observed, gap),
        )
        return {
            "force_N": float(np.hypot(force[0], force[1])),
            "force_angle_deg": in_degrees(towards),
            "eccentricity_in_bore_x_m": float(x),
            "eccentricity_in_bore_y_m": float(y),
            "eccentricity_ratio": float(np.hypot(x, y)) / place.film.clearance,
            "attitude_angle_deg": in_degrees(np.arctan2(y, x) - towards),
            "max_pressure_height_m": peak_height,
            "min_film_angle_deg": in_degrees(thin_angle),
            "min_film_height_m": thin_height,
        }


def upper_most(places: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Angle [rad] and height [m] of the least value, the upper of equal ones.

    Parameters
    ----------
    places, values
        shape (k, 2), (k,).
    """
    least = values.min()
    equal = np.flatnonzero(values <= least + EQUAL * abs(least))
    angle, height = places[equal[np.argmax(places[equal, 1])]]
    return float(angle), float(height)


def in_degrees(angle: float) -> float:
    """In -180 up to 180, of an angle [rad]."""
    return float(np.degrees((angle + np.pi) % (2 * np.pi) - np.pi))
