"""Mechanism of a rigid bearing: a massless journal in one lubricated joint.

The film's mesh is graded by the gap, and made for one position of the journal. If the bore is
round, the film's frame has its x axis through the journal; grooves are turned into this frame. The
mesh is made again if the journal comes to rest at a position for which it is not suited.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from fenics_ehd.analysis.bearing_gap import AROUND, gaps, open_gaps, shape_of
from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.analysis.equilibrium import Equilibrium, balanced
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.grid import FilmGrid, gap_graded_grid
from fenics_ehd.film.lubricant import make_lubricant
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.rough_surfaces import RoughSurfaces
from fenics_ehd.film.supply import AxialGroove, Sides
from fenics_ehd.multibody.body import MasslessBody, ground
from fenics_ehd.multibody.forces import PointForce
from fenics_ehd.multibody.joints import Revolute, Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism, System
from fenics_ehd.multibody.quantities import JointStep

#: Largest factor between the gap that a mesh was made for and the gap that it is used for.
LARGEST_FACTOR = 1.2

#: Largest angle from the journal to the x axis of the film's frame, of a round bore [rad].
ALIGNED = 1e-3

#: The same if the pressure is zero on the line of the maximum film, which is a line of the mesh.
ALIGNED_WITH_LINE = 1e-7

#: Below this share of the largest pressure times the area, a force is round-off.
ROUND_OFF = 1e-11

#: Below this share of ``12 eta Omega (R / c)^2``, a pressure is round-off.
NO_PRESSURE = 1e-13


@attrs.frozen
class HeldPoint(Revolute):
    """A point that is held at another point, with a velocity [m/s]."""

    velocity: np.ndarray = attrs.field(factory=lambda: np.zeros(2))

    def imposed(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Distance and velocity of the point, see `Joint`."""
        return np.zeros(2), self.velocity


class MeshedBearing:
    """A bearing whose film has a mesh for one position of the journal.

    Parameters
    ----------
    settings
        Settings of the bearing.
    position
        Eccentricity that the mesh is made for, x along the load, shape (2,) [m].

    Attributes
    ----------
    settings
        Settings of the bearing.
    angle
        Angle from the load line to the x axis of the film's frame [rad].
    film
        Film in this frame.
    """

    def __init__(self, settings: BearingSettings, position: np.ndarray):
        self.settings = settings
        self.angle = 0.0 if settings.bore_shape is not None else direction_of(position)
        self._surfaces = RoughSurfaces.of(settings, settings.contact_modulus)
        self._made_for = self._profile(open_gaps(settings, position))
        self.film = self._film()

    def _film(self) -> Film:
        """Film on a mesh graded by the gap."""
        s = self.settings
        regions = tuple(replace(g, angle=g.angle - self.angle) for g in s.grooves)
        if s.line_at_max_film:
            regions = (AxialGroove(np.pi, 0.0),)
        oil = make_lubricant(s, 0.0 if s.graded else s.viscosity)
        squeeze = float(np.hypot(*s.squeeze)) / s.clearance
        rate = max(abs(s.speed), abs(s.bore_speed), squeeze) or 1.0
        sides = Sides(lower=s.ambient, upper=s.ambient)
        grid = self._grid(regions)
        return Film(
            FilmParameters(grid, s.clearance, oil, rate, sides, regions, surfaces=self._surfaces)
        )

    def _grid(self, regions: tuple[AxialGroove, ...]) -> FilmGrid:
        """Mesh that is finer in the thin film, with lines at the edges of grooves."""
        s = self.settings
        edges = sorted(edge for region in regions for edge in region.edges)
        cells = s.cells_around, s.cells_along
        return gap_graded_grid(s.radius, s.width, cells, s.element, self._thickness, edges)

    def _profile(self, film: np.ndarray) -> np.ndarray:
        """Thickness that the mesh follows, by angle: the smallest, or the length of rough ones."""
        thickness = film.min(axis=1)
        return thickness if self._surfaces is None else self._surfaces.length(thickness)

    def _thickness(self, angle: np.ndarray) -> np.ndarray:
        """Thickness that the mesh was made for, at angles in the film's frame."""
        return np.asarray(np.interp(angle + self.angle, AROUND, self._made_for, period=2 * np.pi))

    def suits(self, position: np.ndarray) -> bool:
        """True if the mesh is suited for another eccentricity."""
        if self.settings.bore_shape is None:
            off = direction_of(rotation(-self.angle) @ position)
            if abs(off) > (ALIGNED_WITH_LINE if self.settings.line_at_max_film else ALIGNED):
                return False
        factor = self._profile(gaps(self.settings, position)) / self._made_for
        return bool(np.all((factor < LARGEST_FACTOR) & (factor > 1 / LARGEST_FACTOR)))

    def meshed_for(self, position: np.ndarray) -> MeshedBearing:
        """A bearing with a mesh for an eccentricity: the bearing itself if its mesh is suited."""
        return self if self.suits(position) else MeshedBearing(self.settings, position)

    def mechanism(self, position: np.ndarray, load: float | None) -> Mechanism:
        """Mechanism with the journal at an eccentricity [m], under a load [N] or held (None)."""
        s = self.settings
        into_frame = rotation(-self.angle)
        # In the frame of the bore, which turns.
        turning = s.direction * s.bore_speed * np.array([-position[1], position[0]])
        joint = LubricatedJoint(
            "shaft",
            "bore",
            self.film,
            eccentricity=tuple(into_frame @ position),
            eccentricity_rate=tuple(into_frame @ (s.squeeze - turning)),
            bore_shape=shape_of(s, self.angle),
            shear_rule=s.shear_rule,
            cavitation=s.cavitation,
        )
        joints: dict[str, Any] = {"film": joint, "axis": Revolute(("bore", "ground"))}
        forces = {}
        if load is None:
            joints["held"] = HeldPoint(("shaft", "ground.held"), np.array(s.squeeze))
        else:
            forces["load"] = PointForce("shaft", (1.0, 0.0), lambda _: (load, 0.0))
        start = tuple(position)
        bodies = {
            "shaft": MasslessBody(position=start, velocity=s.squeeze),
            "bore": MasslessBody(),
            "ground": ground({"held": start}),
        }
        drives = {
            "shaft": Speed(s.direction * s.speed),
            "bore": Speed(s.direction * s.bore_speed, self.angle),
        }
        return Mechanism(bodies, joints, drives, forces)

    def rest(self, position: np.ndarray, load: float | None = None) -> OperatingPoint:
        """Equilibrium under a load [N], or with the journal held at an eccentricity [m]."""
        return OperatingPoint(self, balanced(System(self.mechanism(position, load))))


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """A journal in equilibrium in its bearing.

    Attributes
    ----------
    bearing
        Bearing with its mesh.
    rest
        Equilibrium of the mechanism.
    """

    bearing: MeshedBearing
    rest: Equilibrium

    @cached_property
    def joint(self) -> JointStep:
        """The lubricated joint."""
        return self.rest.joints()["film"]

    @property
    def state(self) -> FilmState:
        """State of the film."""
        return self.joint.state

    @property
    def position(self) -> np.ndarray:
        """Eccentricity, x along the load, shape (2,) [m]."""
        eccentricity = self.rest.z[self.rest.system.bodies["shaft"]][:2]
        centred = np.hypot(*eccentricity) < ROUND_OFF * self.bearing.settings.clearance
        return np.zeros(2) if centred else eccentricity

    @property
    def force_on_bore(self) -> np.ndarray:
        """Force of the film on the bore, x along the load, shape (2,) [N]."""
        return -self.joint.force

    @property
    def carries(self) -> bool:
        """True if the film's force exceeds the round-off of the pressures that it is the sum of."""
        s = self.bearing.settings
        scale = self.bearing.film.parameters.pressure_scale
        least = ROUND_OFF * self.state.pressure.max() + NO_PRESSURE * scale
        return float(np.hypot(*self.force_on_bore)) > least * s.radius * s.width


def direction_of(vector: np.ndarray) -> float:
    """Angle of a vector from the x axis [rad]."""
    return float(np.arctan2(vector[1], vector[0]))
