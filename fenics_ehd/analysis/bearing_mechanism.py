"""Mechanism of a rigid bearing: a massless journal in one lubricated joint.

The film's mesh is graded by the gap for one position of the journal. If the bore is round, the x
axis of the film's frame points to the journal, and grooves are rotated into this frame. The mesh is
made again if it does not suit the position of the journal in equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from fenics_ehd.analysis.bearing_gap import AROUND, gaps, minimum_film, shape_of
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

#: Largest ratio between the gap for which a mesh was made and the gap for which it is used.
LARGEST_FACTOR = 1.2

#: Largest angle between the journal's position and the x axis of the film's frame, in a round bore
#: [rad].
ALIGNED = 1e-3

#: The same limit if the pressure is zero on the line of the maximum film, a line of the mesh [rad].
ALIGNED_WITH_LINE = 1e-7

#: Force over largest pressure times area, below which the force is round-off.
ROUND_OFF = 1e-11

#: Pressure over ``12 eta Omega (R / c)^2``, below which the pressure is round-off.
NO_PRESSURE = 1e-13


@attrs.frozen
class HeldPoint(Revolute):
    """A point that is held at another point and has a velocity [m/s]."""

    velocity: np.ndarray = attrs.field(factory=lambda: np.zeros(2))

    def imposed(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Distance of the two points, which is 0, and velocity of the point, see `Joint`."""
        return np.zeros(2), self.velocity


class MeshedBearing:
    """A bearing with a film mesh for one position of the journal.

    Parameters
    ----------
    settings
        Settings of the bearing.
    position
        Eccentricity for which the mesh is made, x along the load, shape (2,) [m].

    Attributes
    ----------
    settings
        Settings of the bearing.
    angle
        Angle from the load line to the x axis of the film's frame [rad].
    film
        Film in the frame with this angle.
    """

    def __init__(self, settings: BearingSettings, position: np.ndarray):
        minimum_film(settings, position)
        self.settings = settings
        self.angle = 0.0 if settings.bore_shape is not None else direction_of(position)
        self._surfaces = RoughSurfaces.of(settings, settings.contact_modulus)
        self._made_for = self._profile(position)
        self.film = self._film()

    def _film(self) -> Film:
        """Make the film, on a mesh graded by the gap."""
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
        """Mesh that is finer where the film is thin, with lines at the edges of grooves."""
        s = self.settings
        edges = sorted(edge for region in regions for edge in region.edges)
        cells = s.cells_around, s.cells_along
        return gap_graded_grid(s.radius, s.width, cells, s.element, self._thickness, edges)

    def _profile(self, position: np.ndarray) -> np.ndarray:
        """Thickness by angle that grades the mesh: minimum over the width, or rough length."""
        thickness = gaps(self.settings, position).min(axis=1)
        return thickness if self._surfaces is None else self._surfaces.length(thickness)

    def _thickness(self, angle: np.ndarray) -> np.ndarray:
        """Thickness that grades the mesh, at angles in the film's frame."""
        return np.asarray(np.interp(angle + self.angle, AROUND, self._made_for, period=2 * np.pi))

    def suits(self, position: np.ndarray) -> bool:
        """True if the mesh can be used for another eccentricity."""
        if self.settings.bore_shape is None:
            off = direction_of(rotation(-self.angle) @ position)
            if abs(off) > (ALIGNED_WITH_LINE if self.settings.line_at_max_film else ALIGNED):
                return False
        factor = self._profile(position) / self._made_for
        return bool(np.all((factor < LARGEST_FACTOR) & (factor > 1 / LARGEST_FACTOR)))

    def meshed_for(self, position: np.ndarray) -> MeshedBearing:
        """The bearing itself if its mesh suits an eccentricity, else one with a mesh for it."""
        return self if self.suits(position) else MeshedBearing(self.settings, position)

    def mechanism(self, position: np.ndarray, load: float | None) -> Mechanism:
        """Mechanism with the journal at an eccentricity [m], under a load [N] or held (None)."""
        s = self.settings
        into_frame = rotation(-self.angle)
        # The rate of the eccentricity is needed in the frame of the bore, which rotates.
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
        """Equilibrium under a load [N]; without one, the journal is held at the position [m]."""
        return OperatingPoint(self, balanced(System(self.mechanism(position, load))))


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """A bearing whose journal is in equilibrium.

    Attributes
    ----------
    bearing
        Bearing with the mesh of its film.
    rest
        Equilibrium of the mechanism.
    """

    bearing: MeshedBearing
    rest: Equilibrium

    @cached_property
    def joint(self) -> JointStep:
        """The lubricated joint in equilibrium."""
        return self.rest.joints()["film"]

    @property
    def state(self) -> FilmState:
        """Solution of the film."""
        return self.joint.state

    @property
    def position(self) -> np.ndarray:
        """Eccentricity of the journal, x along the load, shape (2,) [m]."""
        eccentricity = self.rest.z[self.rest.system.bodies["shaft"]][:2]
        centred = np.hypot(*eccentricity) < ROUND_OFF * self.bearing.settings.clearance
        return np.zeros(2) if centred else eccentricity

    @property
    def force_on_bore(self) -> np.ndarray:
        """Force of the film on the bore, x along the load, shape (2,) [N]."""
        return -self.joint.force

    @property
    def carries(self) -> bool:
        """True if the force of the film is larger than round-off of the pressures."""
        s = self.bearing.settings
        scale = self.bearing.film.parameters.pressure_scale
        least = ROUND_OFF * self.state.pressure.max() + NO_PRESSURE * scale
        return float(np.hypot(*self.force_on_bore)) > least * s.radius * s.width


def direction_of(vector: np.ndarray) -> float:
    """Angle of a vector from the x axis [rad]."""
    return float(np.arctan2(vector[1], vector[0]))
