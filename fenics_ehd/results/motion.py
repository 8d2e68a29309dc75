"""Recorded motion of a mechanism: bodies, gaps and loads at the instants of a run."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator, interp1d

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.multibody.body import Body, PlanarBody, ground
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.history import FIELDS_NAME, History
from fenics_ehd.multibody.mechanism import Mechanism, System
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.trust import surface_loads
from fenics_ehd.reduction.body import ReducedBody


def between_steps(history: History, time: np.ndarray) -> History:
    """Interpolate a recorded run at instants between its first and its last step [s].

    Coordinates are interpolated by cubic polynomials through the values and rates at two steps, so
    that joints remain closed between steps. All other quantities are interpolated by monotone
    cubics, or linearly if the quantity is unknown (NaN) at some step.
    """
    clock = np.asarray(history.run.time)

    def between(values: np.ndarray) -> np.ndarray:
        known = values.size and np.isfinite(values).all()
        curve = PchipInterpolator(clock, values) if known else interp1d(clock, values, axis=0)
        return curve(time)

    cubics = CubicHermiteSpline(clock, history.coordinates, history.rates)
    return history.each(between).changed({"state/coordinates": cubics(time)})


def nearest_steps(time: np.ndarray, count: int) -> np.ndarray:
    """Indices of the steps nearest to `count` evenly spaced times, each index once."""
    wanted = np.linspace(time[0], time[-1], count)
    return np.unique(np.abs(time[:, None] - wanted).argmin(axis=0))


class RecordedMotion:
    """Bodies and films of a mechanism at recorded instants.

    Parameters
    ----------
    mechanism
        Mechanism of the run.
    motion
        Recorded steps of a run, or instants between them; methods on films need nodal fields.

    Attributes
    ----------
    time
        Times since the start of the run, shape (t,) [s].
    bodies
        Bodies by name, including the ground.
    system
        Coordinates of the mechanism.

    Raises
    ------
    InputError
        The motion belongs to another mechanism.
    """

    def __init__(self, mechanism: Mechanism, motion: History):
        self.motion = motion
        self.time = motion.run.time
        self.bodies: dict[str, Body] = {"ground": ground(), **mechanism.bodies}
        self.system = System(mechanism)
        self._equations = StepEquations(self.system)
        self._states = np.hstack([motion.coordinates, motion.quasi_static])
        expected = {
            "coordinates": (motion.coordinates, self.system.n),
            "quasi_static": (motion.quasi_static, self._equations.responses.size),
            **{
                p.name: (motion.pressures[p.name], self.nodes(p))
                for p in self.system.films
                if p.name in motion.pressures
            },
        }
        for name, (values, size) in expected.items():
            if values.shape[1] != size:
                raise InputError(
                    f"{FIELDS_NAME}: it has {values.shape[1]} values of {name} per step, but its "
                    f"scene and bodies have {size}: it belongs to another run"
                )

    def coordinates(self, body: str) -> np.ndarray:
        """Coordinates of one body, shape (t, n)."""
        return self.motion.coordinates[:, self.system.bodies[body]]

    def marker(self, body: str, point: str, coordinates: np.ndarray | None = None) -> np.ndarray:
        """Position [m] and angle [rad] of a point of a body, ``(x, y, angle)``, shape (t, 3).

        Parameters
        ----------
        body, point
            Names of body and point; an empty point name is the origin of the body.
        coordinates
            Coordinates of the body in place of the recorded ones, shape (t, n).
        """
        rows = self.coordinates(body) if coordinates is None else coordinates
        return np.array([self.bodies[body].marker(point, row).values[:3] for row in rows])

    def part(self, body: str) -> ReducedBody:
        """Reduced part of a flexible body."""
        reduced = self.bodies[body].reduced
        assert reduced is not None
        return reduced

    def elastic(self, body: str) -> tuple[np.ndarray, np.ndarray]:
        """Elastic coordinates of a flexible body and amplitudes of its residual patterns.

        Returns
        -------
        coordinates, amplitudes : numpy.ndarray
            Coordinates, shape (t, n), and amplitudes, shape (t, r).
        """
        part = self.part(body)
        coordinates = self.coordinates(body)
        amplitudes = np.zeros((len(coordinates), part.residual.rank if part.residual else 0))
        responses = self._equations.responses
        if body in responses.bodies:
            amplitudes = self._states[:, responses.of_body(body)]
        return coordinates[:, coordinates.shape[1] - part.modes :], amplitudes

    def in_equilibrium(self, body: str) -> tuple[np.ndarray, np.ndarray]:
        """Elastic coordinates and amplitudes that balance the loads without damping forces.

        The coordinates are ``q + zeta q'``: elastic coordinates q, damping time zeta. The
        amplitudes are the static ones, ``V p`` for nodal pressures p, because amplitudes y of the
        run obey ``y + zeta y' = V p``. Shapes are those of `elastic`.
        """
        part = self.part(body)
        (coordinates, amplitudes) = self.elastic(body)
        flexible = self.bodies[body]
        assert isinstance(flexible, PlanarBody)
        rates = self.motion.rates[:, self.system.bodies[body]]
        rates = rates[:, rates.shape[1] - part.modes :]
        films = self.system.films
        equations = self._equations
        if body in equations.responses.bodies:
            patterns = equations.responses.bodies[body].patterns
            pressures = [self.motion.pressures[p.name] for p in films]
            gaps = [self.observed[p.name][:, : -self.nodes(p)] for p in films]
            amplitudes = np.zeros_like(amplitudes)  # amplitudes of the run do not change
            for row in range(len(amplitudes)):
                forces = equations.contacts.forces([gap[row] for gap in gaps])
                static = equations.responses.static([p[row] for p in pressures], forces)
                amplitudes[row] = static[patterns]
        return coordinates + flexible.damping_time * rates, amplitudes

    def loads(self, body: str) -> tuple[np.ndarray, np.ndarray]:
        """Nodal forces of films on the bores of a flexible body, and its angular speed.

        Returns
        -------
        forces, speeds : numpy.ndarray
            Forces of oil and asperity contact on the m nodes of the bores, integrated over the
            films, shape (t, m, 3) [N]; angular speed of the body's frame, shape (t,) [rad/s].

        Raises
        ------
        SettingsError
            The transfer of a film to the bore is ``mortar``: nodal forces are then unknown.
        """
        part = self.part(body)
        forces = np.zeros((len(self.time), len(part.bore_basis), 3))
        for i, binding in enumerate(self.system.films):
            own_angles = np.transpose([binding.own_angles(z) for z in self.motion.coordinates])
            for bound, angles in zip(binding.surfaces, own_angles, strict=True):
                if bound.body != body or not bound.surface.elastic:
                    continue
                if bound.surface.mortar:
                    raise SettingsError(
                        f"joints.{binding.name}.transfer = 'mortar': nodal forces on the bore are "
                        "known only with 'conservative'"
                    )
                pressure = self.motion.pressures[binding.name].T
                nodal = bound.surface.nodal_forces(pressure, self._contact_forces(i), angles)
                if nodal is not None:
                    forces[:, part.rows_of(bound.point).nodes] = nodal
        angle = self.bodies[body].angle_index
        rates = self.motion.rates[:, self.system.bodies[body]]
        return forces, np.zeros(len(forces)) if angle is None else rates[:, angle]

    def _contact_forces(self, i: int) -> np.ndarray | float:
        """Contact forces at the Gauss points of film i, shape (g, t) [N]; 0 without contact."""
        joint = self._equations.contacts.joints[i]
        if joint is None:
            return 0.0
        binding = self.system.films[i]
        gaps = self.observed[binding.name][:, : -self.nodes(binding)]
        contact = np.array([joint.at_gap(gap).pressure for gap in gaps])
        return joint.area[:, None] * contact.T

    @cached_property
    def gaps(self) -> dict[str, np.ndarray]:
        """Film thickness at the k nodes of every film, by joint, shape (t, k) [m]."""
        films = self.system.films
        return {p.name: self.observed[p.name][:, -self.nodes(p) :] for p in films}

    @cached_property
    def observed(self) -> dict[str, np.ndarray]:
        """Film thickness of every film, by joint, shape (t, g + k) [m].

        The g Gauss points of the film come first, then its k nodes.
        """
        norm = StepNorm(self._equations)
        rows = [norm.film_gaps(norm.observe(state)) for state in self._states]
        names = [binding.name for binding in self.system.films]
        return {name: np.array([gaps[i] for gaps in rows]) for i, name in enumerate(names)}

    @cached_property
    def orbits(self) -> dict[str, np.ndarray]:
        """Eccentricity of the journal in the deformed bore, by joint, shape (t, 2) [m].

        The eccentricity is in the frame of the bore's body, see `JointFilm.circle`. In a rigid bore
        it is the recorded eccentricity.
        """
        return {
            binding.name: self.gaps[binding.name] @ binding.film.circle.T
            for binding in self.system.films
        }

    @staticmethod
    def nodes(binding: FilmBinding) -> int:
        """Number of nodes of a film."""
        return len(binding.film.film.parameters.grid.node_positions)

    def bore_pressure(self, body: str) -> np.ndarray:
        """Pressures at all pressure nodes of a flexible body, bore by bore, shape (t, k) [Pa]."""
        none = np.zeros(self.part(body).load_projection.shape[1])
        films = [self.motion.pressures[binding.name] for binding in self.system.films]
        steps = ([pressures[i] for pressures in films] for i in range(len(self.time)))
        each = zip(steps, self.motion.coordinates, strict=True)
        return np.array([surface_loads(self.system, *step).get(body, none) for step in each])
