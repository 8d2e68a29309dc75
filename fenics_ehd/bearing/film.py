"""Film force on the shaft of a rigid bearing and its exact derivatives.

Vectors are in the frame of the load (`fenics_ehd.bearing.settings.BearingSettings`). The
film's mesh has a frame of its own, turned by an angle: zero once there are grooves,
which are fixed in the load's frame; that of the shaft's eccentricity at which the mesh
was made otherwise; and following the eccentricity when everything that acts does,
so that the force of a plain bearing turns with the eccentricity exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.plane import rotation
from fenics_ehd.bearing.contact import BearingContact, ContactFigures, surfaces_of
from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.bearing.thinnest import end_shifts, minimum_film, shaped_film
from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.grading import gap_graded_grid
from fenics_ehd.film.kinematics import (
    GapDerivatives,
    ShaftMotion,
    shaft_gap,
    shaft_gap_derivatives,
)
from fenics_ehd.film.lubricant import Lubricant
from fenics_ehd.film.mass_conserving import MassConservingFilm
from fenics_ehd.film.oil_settings import make_lubricant
from fenics_ehd.film.oil_state import OilState
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.piezoviscous import PiezoviscousFilm
from fenics_ehd.film.supply import AxialGroove, Sides

#: A mesh made for one gap serves another as long as no thickness differs by more than this factor.
MESH_REACH = 1.2


@dataclass(frozen=True, eq=False)
class Operation:
    """A shaft somewhere in the bearing.

    Attributes
    ----------
    position
        Eccentricity, shape (2,) [m].
    force
        Of the film's pressure on the shaft, shape (2,) [N].
    angle
        Of the mesh's frame [rad].
    motion
        Of the shaft, in the mesh's frame.
    state
        The film's solution.
    """

    position: np.ndarray
    force: np.ndarray
    angle: float
    motion: ShaftMotion
    state: FilmState


class BearingFilm:
    """Film of a bearing, on a mesh made for a given eccentricity.

    Parameters
    ----------
    settings
        The bearing.
    position
        Eccentricity for which the mesh is graded, shape (2,) [m].
    options_prefix
        Prefix of the PETSc options of SNES-VI.

    Raises
    ------
    GapClosedError
        The shaft touches the bore there.

    Attributes
    ----------
    outside
        Deviation of a bore that is not round, at the Gauss points [m]; None: it is.
    """

    def __init__(
        self, settings: BearingSettings, position: np.ndarray, options_prefix: str = "film_"
    ):
        self.settings = settings
        free = not (settings.grooves or any(settings.tilt) or any(settings.squeeze))
        if settings.bore_shape is not None:
            free = free and settings.bore_shape.round
        self._follows = free or settings.line_at_max_film
        self._angle = 0.0 if settings.grooves else _direction(position)
        self._made_for = self._motion(position)
        minimum_film(settings, position)
        regions = self._regions()
        edges = sorted(edge for region in regions for edge in region.edges)
        grid = gap_graded_grid(
            settings.radius,
            settings.width,
            (settings.cells_around, settings.cells_along),
            settings.element,
            self._profile(self._made_for),
            edges,
        )
        self.film = Film(
            FilmParameters(
                grid,
                settings.clearance,
                _lubricant(settings),
                _rate(settings),
                _sides(settings),
                regions,
                surfaces=surfaces_of(settings),
            ),
            options_prefix=options_prefix,
        )
        conserving = settings.cavitation == "mass-conserving"
        self._piezoviscous = (
            None
            if self.film.parameters.lubricant.linear
            else PiezoviscousFilm(self.film, options_prefix, conserving=conserving)
        )
        self._oil = MassConservingFilm(self.film) if conserving else None
        self._load = self.film.load(np.stack(self.film.points.normal, axis=-1))
        self._contact: BearingContact | None = None
        if self.film.parameters.surfaces is not None:
            self._contact = BearingContact(self.film)
        self.outside: np.ndarray | None = None
        if settings.bore_shape is not None:
            points = self.film.points
            self.outside = settings.bore_shape.radial(points.angle + self._angle, points.height)

    def _regions(self) -> tuple[AxialGroove, ...]:
        if self.settings.line_at_max_film:
            return (AxialGroove(np.pi, 0.0),)
        return tuple(AxialGroove(g.angle, g.width, g.pressure) for g in self.settings.grooves)

    def frame_angle(self, position: np.ndarray) -> float:
        """Angle of the mesh's frame for an eccentricity [rad]."""
        return _direction(position) if self._follows else self._angle

    def _motion(self, position: np.ndarray) -> ShaftMotion:
        """Of the shaft, in the mesh's frame."""
        s = self.settings
        turn = rotation(-self.frame_angle(position))
        return ShaftMotion(
            turn @ position,
            s.direction * s.speed,
            turn @ np.array(s.squeeze),
            turn @ np.array(s.tilt),
            bore_speed=s.direction * s.bore_speed,
        )

    def _profile(self, motion: ShaftMotion) -> Callable[[np.ndarray], np.ndarray]:
        """Smallest gap over the width, by angle in the mesh's frame, over the clearance."""
        s = self.settings

        def thickness(angle: np.ndarray) -> np.ndarray:
            normal = np.stack([np.cos(angle), np.sin(angle)])
            ends = [
                motion.eccentricity @ normal + shift @ normal
                for shift in end_shifts(s.width, motion.tilt)
            ]
            gap = 1.0 - np.max(ends, axis=0) / s.clearance
            return gap if surfaces_of(s) is None else _meshed(s, s.clearance * gap)

        def shaped(angle: np.ndarray) -> np.ndarray:
            film = shaped_film(s, angle, motion.eccentricity, motion.tilt, self._angle)
            return _meshed(s, film.min(axis=1))

        return thickness if s.bore_shape is None else shaped

    def suits(self, position: np.ndarray) -> bool:
        """Whether the mesh is good for an eccentricity, too."""
        angles = np.linspace(0.0, 2 * np.pi, 361)
        made, now = (self._profile(m)(angles) for m in (self._made_for, self._motion(position)))
        return bool(np.all((now < MESH_REACH * made) & (made < MESH_REACH * now)))

    def operate(self, position: np.ndarray, guess: FilmState | None = None) -> Operation:
        """Film force for an eccentricity.

        Raises
        ------
        GapClosedError
            The shaft touches the bore.
        SolverError
            From `Film.solve` or `PiezoviscousFilm.solve`.
        """
        s, motion, angle = self.settings, self._motion(position), self.frame_angle(position)
        minimum_film(s, position)
        gap = shaft_gap(self.film.points, s.radius, s.clearance, motion)
        if self.outside is not None:
            gap = replace(gap, thickness=gap.thickness + self.outside)
        if self._piezoviscous is not None:
            state = self._piezoviscous.solve(gap)
        elif self._oil is not None:
            state = self._oil.steady(gap, guess)
        else:
            state = self.film.solve(gap, guess)
        push = self._load @ state.pressure
        if self._contact is not None:
            push += self._contact.push(gap)
        force = -rotation(angle) @ push
        return Operation(position, force, angle, motion, state)

    def contact_figures(self, operation: Operation) -> ContactFigures | None:
        """Contact of an operation; None for smooth surfaces."""
        if self._contact is None:
            return None
        return self._contact.figures(operation.state.gap, float(np.hypot(*operation.force)))

    def derivatives(
        self, operation: Operation, *, line_held: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Exact derivatives of the force.

        Parameters
        ----------
        operation
            From `operate`.
        line_held
            Whether the line without pressure stays where it is when the shaft moves, which
            otherwise turns with the eccentricity.

        Returns
        -------
        numpy.ndarray
            With respect to the eccentricity, shape (2, 2) [N/m].
        numpy.ndarray
            With respect to its rate, shape (2, 2) [N s/m]; that of a film that keeps
            account of its oil depends on the frequency, this is the part at once.
        """
        motion, turn = operation.motion, rotation(operation.angle)
        distance = float(np.linalg.norm(operation.position))
        follows = self._follows and distance > 0 and not line_held
        # Directions in the mesh's frame, in (e_x, e_y, psi_x, psi_y) and in their rates.
        places, rates = np.zeros((4, 4)), np.zeros((4, 4))
        places[:2, :2] = rates[:2, 2:] = np.eye(2)
        if follows:
            # e = (distance, 0) there: the second direction turns all that is fixed outside.
            places[:, 1] = 0.0
            places[2:, 1] = _quarter(-motion.tilt) / distance
            rates[:2, 1] = _quarter(-motion.eccentricity_rate) / distance
        derivatives = self._gap_derivatives(motion, places, rates)
        push = self._load @ self._sensitivity(operation.state, derivatives)
        if self._contact is not None:
            push += self._contact.stiffness(operation.state.gap, derivatives)
        force = -turn @ push
        if follows:
            force[:, 1] += _quarter(operation.force) / distance
        return force[:, :2] @ turn.T, force[:, 2:] @ turn.T

    def _sensitivity(self, state: FilmState, derivatives: GapDerivatives) -> np.ndarray:
        """Derivative of the nodal pressure, shape (nodes, n)."""
        if self._oil is None:
            return self.film.sensitivity(state, derivatives)
        assert isinstance(state, OilState)
        return self._oil.sensitivity(state, derivatives)[0]

    def _gap_derivatives(
        self, motion: ShaftMotion, places: np.ndarray, rates: np.ndarray
    ) -> GapDerivatives:
        """Derivatives of the gap along directions of place and rate, each shape (4, n)."""
        s = self.settings
        place, rate = shaft_gap_derivatives(self.film.points, s.radius, s.clearance, motion)
        return GapDerivatives(
            *(
                getattr(place, name) @ places + getattr(rate, name) @ rates
                for name in GapDerivatives.__dataclass_fields__
            )
        )


def _direction(position: np.ndarray) -> float:
    return float(np.arctan2(position[1], position[0]))


def _quarter(vector: np.ndarray) -> np.ndarray:
    """Turned by 90 degrees."""
    return np.array([-vector[1], vector[0]])


def _meshed(settings: BearingSettings, gap: np.ndarray) -> np.ndarray:
    """What the mesh follows over the clearance: gaps [m], or their lengths of rough surfaces."""
    surfaces = surfaces_of(settings)
    return (gap if surfaces is None else surfaces.length(gap)) / settings.clearance


def _lubricant(settings: BearingSettings) -> Lubricant:
    return make_lubricant(settings, 0.0 if settings.graded else settings.viscosity)


def _sides(settings: BearingSettings) -> Sides:
    return Sides(
        **{
            name: None if settings.closed_side == name else settings.ambient
            for name in ("lower", "upper")
        }
    )


def _rate(settings: BearingSettings) -> float:
    """Largest rate in sight [rad/s], to make the film equation dimensionless."""
    squeeze = float(np.hypot(*settings.squeeze)) / settings.clearance
    return max(abs(settings.speed), abs(settings.bore_speed), squeeze) or 1.0
