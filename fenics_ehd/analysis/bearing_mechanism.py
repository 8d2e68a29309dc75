"""One rigid bearing with a film mesh for a position of its journal, and its equilibrium.

The film's mesh is made for one position of the journal: cells are small where the film is thin. If
the bore is round, the x axis of the film's frame points to the journal, and grooves are rotated
into this frame. The mesh is made again if the equilibrium position has another gap or direction
than the position for which the mesh was made (`MeshedBearing.suits`).

`Bearing.build` makes the mechanism (`fenics_ehd.scenes.bearing`): the bodies ``shaft`` and
``bore``, the joint ``film``, and drives. This module adds the position of the journal, and either a
load or a joint that holds the journal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.analysis.equilibrium import Equilibrium, balanced
from fenics_ehd.base.errors import GapClosedError
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.film import FilmState
from fenics_ehd.film.grid import FilmGrid, MeshMaker, gap_graded_grid
from fenics_ehd.film.rough_surfaces import DEEPEST_CONTACT, length_scale
from fenics_ehd.multibody.body import MasslessBody, ground
from fenics_ehd.multibody.forces import PointForce
from fenics_ehd.multibody.joints import Revolute
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism, System
from fenics_ehd.multibody.quantities import JointStep

#: Angles and heights at which the gap is sampled before the film has a mesh.
ANGLES = 720
HEIGHTS = 41
AROUND = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)

#: Largest ratio between the gap that a mesh is used for and the gap that it was made for.
LARGEST_FACTOR = 1.2

#: Largest angle between the journal's position and the x axis of the film's frame, in a round bore
#: [rad].
ALIGNED = 1e-3

#: The same limit if zero pressure is imposed on the line of the maximum film, which must be a line
#: of the mesh [rad].
ALIGNED_WITH_LINE = 1e-7

#: Ratio of force to largest pressure times area below which the force is round-off.
ROUND_OFF = 1e-11

#: Ratio of pressure to ``12 eta Omega (R / c)^2`` below which the pressure is round-off.
NO_PRESSURE = 1e-13

#: Function that makes the mechanism of a bearing from its settings, the angle from the load line to
#: the film's frame [rad], and the film's mesh.
BuildBearing = Callable[[BearingSettings, float, MeshMaker], Mechanism]


@dataclass(frozen=True)
class Bearing:
    """A rigid bearing that can be meshed for any position of its journal.

    Attributes
    ----------
    settings
        Settings of the bearing.
    build
        Function that makes the mechanism of the bearing, see `BuildBearing`.
    """

    settings: BearingSettings
    build: BuildBearing

    def changed(self, **changes: Any) -> Bearing:
        """Copy of the bearing with other values of some settings."""
        return replace(self, settings=attrs.evolve(self.settings, **changes))

    def gaps(self, position: np.ndarray) -> np.ndarray:
        """Film thickness at angles and heights for a position of the journal [m].

        `position` is the eccentricity, x along the load, shape (2,) [m].

        Returns
        -------
        numpy.ndarray
            Film thickness at the `ANGLES` from the load line and the `HEIGHTS`, shape (720, 41)
            [m].
        """
        s = self.settings
        height = s.width * np.linspace(-0.5, 0.5, HEIGHTS)
        around = np.stack([np.cos(AROUND), np.sin(AROUND)], axis=-1)
        round_gap = s.clearance - around @ position
        return round_gap[:, None] + s.relative_shape().radial(AROUND[:, None], height)

    def open_gaps(self, position: np.ndarray) -> np.ndarray:
        """Film thickness for a position of the journal, see `gaps`, if the gap is open.

        Raises
        ------
        GapClosedError
            The journal touches the bore; rough surfaces may overlap by up to a limit.
        """
        s = self.settings
        thickness = self.gaps(position)
        thinnest = float(thickness.min())
        least = DEEPEST_CONTACT * s.roughness
        if not thinnest > least:
            also = ", or the deviations of the bore" if s.bore_shape is not None else ""
            raise GapClosedError(
                f"the minimum film thickness is {thinnest * 1e6:.3g} um, but must be "
                f"{f'above {least * 1e6:.3g} um' if least else 'positive'}: "
                f"lower the eccentricity or the tilt{also}"
            )
        return thickness


@attrs.frozen
class HeldPoint(Revolute):
    """Joint that holds a point at another point, and at the same time imposes a velocity [m/s].

    The velocity enters the squeeze motion of a film, but does not change positions.
    """

    velocity: np.ndarray = attrs.field(factory=lambda: np.zeros(2))

    def imposed(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Imposed distance of the two points, which is 0, and imposed velocity, see `Joint`."""
        return np.zeros(2), self.velocity


class MeshedBearing:
    """A bearing with a film mesh for one position of the journal.

    Parameters
    ----------
    bearing
        The bearing.
    position
        Eccentricity of the journal for which the mesh is made, x along the load, shape (2,) [m].

    Attributes
    ----------
    bearing, settings
        The bearing and its settings.
    angle
        Angle from the load line to the x axis of the film's frame [rad].
    film
        Film, in this frame.

    Raises
    ------
    GapClosedError
        The journal touches the bore.
    """

    def __init__(self, bearing: Bearing, position: np.ndarray):
        thickness = bearing.open_gaps(position)
        self.bearing = bearing
        self.settings = bearing.settings
        self.angle = 0.0 if self.settings.bore_shape is not None else direction_of(position)
        self._made_for = self._profile(thickness)
        self._unloaded = bearing.build(self.settings, self.angle, self._mesh)
        self.film = self._joint.film

    @property
    def _joint(self) -> LubricatedJoint:
        """Lubricated joint of the bearing, without a load or an eccentricity of the journal."""
        joint = self._unloaded.joints["film"]
        assert isinstance(joint, LubricatedJoint)
        return joint

    def _mesh(self, edges: np.ndarray) -> FilmGrid:
        """Film mesh that is finer where the film is thin, with cell boundaries at groove edges.

        `edges` are the angles of the edges [rad].
        """
        s = self.settings
        cells = s.cells_around, s.cells_along
        return gap_graded_grid(s.radius, s.width, cells, s.element, self._thickness, sorted(edges))

    def _profile(self, thickness: np.ndarray) -> np.ndarray:
        """Smallest film thickness along the axis at each of the `ANGLES`, shape (720,) [m].

        The mesh is finer where this thickness is small. If the surfaces are rough, the result is
        the length scale of their contact instead, see `length_scale`.
        """
        thinnest = thickness.min(axis=1)
        roughness = self.settings.roughness
        return length_scale(thinnest, roughness) if roughness else thinnest

    def _thickness(self, angle: np.ndarray) -> np.ndarray:
        """Smallest film thickness along the axis [m], at angles in the film's frame [rad]."""
        return np.asarray(np.interp(angle + self.angle, AROUND, self._made_for, period=2 * np.pi))

    def suits(self, position: np.ndarray) -> bool:
        """True if the mesh can be used for another position of the journal, shape (2,) [m]."""
        if self.settings.bore_shape is None:
            off = direction_of(rotation(-self.angle) @ position)
            if abs(off) > (ALIGNED_WITH_LINE if self.settings.line_at_max_film else ALIGNED):
                return False
        factor = self._profile(self.bearing.gaps(position)) / self._made_for
        return bool(np.all((factor < LARGEST_FACTOR) & (factor > 1 / LARGEST_FACTOR)))

    def meshed_for(self, position: np.ndarray) -> MeshedBearing:
        """Bearing with a film mesh for a position of the journal [m].

        It is the same bearing if its mesh can be used for this position.
        """
        return self if self.suits(position) else MeshedBearing(self.bearing, position)

    def mechanism(self, position: np.ndarray, load: float | None) -> Mechanism:
        """Mechanism with the journal at a position [m], under a load [N].

        If the load is None, the journal is held at the position.
        """
        s = self.settings
        into_frame = rotation(-self.angle)
        # The rate of the eccentricity is needed in the frame of the bore, which rotates.
        turning = s.direction * s.bore_speed * np.array([-position[1], position[0]])
        unloaded = self._unloaded
        start = tuple(position)
        shaft = MasslessBody(position=start, velocity=s.squeeze)
        bodies = {**unloaded.bodies, "shaft": shaft, "ground": ground({"held": start})}
        film = replace(
            self._joint,
            eccentricity=tuple(into_frame @ position),
            eccentricity_rate=tuple(into_frame @ (s.squeeze - turning)),
        )
        joints = {**unloaded.joints, "film": film}
        forces = {}
        if load is None:
            joints["held"] = HeldPoint(("shaft", "ground.held"), np.array(s.squeeze))
        else:
            forces["load"] = PointForce("shaft", (1.0, 0.0), lambda _: (load, 0.0))
        return replace(unloaded, bodies=bodies, joints=joints, forces=forces)

    def rest(self, position: np.ndarray, load: float | None = None) -> OperatingPoint:
        """Operating point under a load [N], searched from a position of the journal [m].

        If the load is None, the journal is held at the position.
        """
        return OperatingPoint(self, balanced(System(self.mechanism(position, load))))


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """A bearing with its journal in equilibrium, under a load or held at a position.

    Attributes
    ----------
    meshed
        Bearing with its film mesh.
    rest
        Equilibrium of the mechanism.
    """

    meshed: MeshedBearing
    rest: Equilibrium

    @cached_property
    def joint(self) -> JointStep:
        """The lubricated joint in equilibrium."""
        return self.rest.joints()["film"]

    @property
    def state(self) -> FilmState:
        """Solution of the film in equilibrium."""
        return self.joint.state

    @property
    def position(self) -> np.ndarray:
        """Eccentricity of the journal, x along the load, shape (2,) [m]."""
        eccentricity = self.rest.z[self.rest.system.bodies["shaft"]][:2]
        centred = np.hypot(*eccentricity) < ROUND_OFF * self.meshed.settings.clearance
        return np.zeros(2) if centred else eccentricity

    @property
    def force_on_bore(self) -> np.ndarray:
        """Force of the film on the bore, x along the load, shape (2,) [N]."""
        return -self.joint.force

    @property
    def carries(self) -> bool:
        """True if the film carries a load: its force exceeds the round-off of its pressures."""
        s = self.meshed.settings
        scale = self.meshed.film.parameters.pressure_scale
        least = ROUND_OFF * self.state.pressure.max() + NO_PRESSURE * scale
        return float(np.hypot(*self.force_on_bore)) > least * s.radius * s.width


def direction_of(vector: np.ndarray) -> float:
    """Angle of a vector from the x axis [rad]."""
    return float(np.arctan2(vector[1], vector[0]))
