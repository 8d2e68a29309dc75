"""A body whose surface has a given compliance that is not round, on either side of a film."""

from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import attrs
import numpy as np
from scipy import sparse

import fenics_ehd as ehd
from fenics_ehd.multibody.body import PlanarBody, rigid_integrals
from fenics_ehd.multibody.surface import Compliance, Side, Surface
from fenics_ehd.reduction.body import InertiaIntegrals

#: Waves around of the modes: a wave of one is the eccentricity.
WAVES = (0, 2, 3, 4)

#: Displacement of residual patterns for unit amplitudes [m/Pa].
UNIT_PATTERN = 1e-13


def waves(angle, order=0):
    """Outward displacement of the modes, uniform along the axis, or its derivative, (p, n)."""
    columns = []
    for k in WAVES:
        quarters = order * (0.5 * np.pi)
        columns.append(k**order * np.cos(k * angle + quarters))
        if k:
            columns.append(k**order * np.sin(k * angle + quarters))
    return np.stack(columns, axis=-1)


def compliance(angle):
    """Radial compliance over its mean."""
    return 1.0 + 0.5 * np.cos(2 * angle) + 0.3 * np.sin(3 * angle)


def stiffness(radius, width, mean):
    """Stiffness of the modes for a mean compliance [m/Pa], shape (n, n) [N/m].

    The displacement is the projection on the modes of compliance times the pressure's projection.
    """
    angle = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    shapes = waves(angle)
    area = 2 * np.pi * radius * width / len(angle)
    gram = area * shapes.T @ shapes
    weighted = area * shapes.T @ (mean * compliance(angle)[:, None] * shapes)
    return gram @ np.linalg.solve(weighted, gram)


class GivenSurface(Surface):
    """Surface with the modes of `waves`, or residual patterns of this span."""

    elastic = True
    turning = False

    def __init__(self, side, body):
        super().__init__(side, len(body.stiffness_of_modes))
        self.turning = Surface.turning.fget(self) and not body.still
        self._body = body

    @property
    def compliance(self):
        """Residual patterns, those that the stiffness makes independent."""
        if self._body.stiffness_of_patterns is None:
            return None
        stiffness, shapes = np.linalg.eigh(self._body.stiffness_of_patterns)
        shapes = UNIT_PATTERN * shapes
        stiffness = UNIT_PATTERN**2 * stiffness
        film = self.side.film
        observed = sparse.csr_matrix(self.side.sign * waves(self._angle))
        gap = observed[: self._inside]
        areas = sparse.csr_matrix(film.pressure_areas)
        return Compliance(
            shapes,
            shapes.T / stiffness[:, None],
            gap,
            observed,
            (gap.T @ areas).tocsr(),
            gap.T.tocsr(),
            stiffness,
            self._body.damping_time,
        )

    def outward(self, angle, height, order=0):
        """Outward displacement of the modes, see `Surface`."""
        return waves(angle, order)


@attrs.frozen(eq=False, slots=False)
class GivenBody(PlanarBody):
    """A body of `GivenSurface`, without mass unless given; its only point is the origin.

    Damping lets a run start undeformed: pressures on modes without mass and damping are zero then.
    The surface of a body that stays still does not turn, even if it is a journal's.
    """

    stiffness_of_modes: np.ndarray
    held: bool = False
    mass: float = 0.0
    inertia: float = 0.0
    centre = (0.0, 0.0)
    damping_time: float = 1e-4
    stiffness_of_patterns: np.ndarray | None = None
    still: bool = False
    fields = MappingProxyType({})

    @property
    def stiffness(self):
        """Stiffness of the modes, shape (n, n) [N/m]."""
        return self.stiffness_of_modes

    @cached_property
    def integrals(self):
        """Integrals of the rigid body; the modes have no mass."""
        rigid = rigid_integrals(self.mass, self.inertia, np.zeros(2))
        elastic = (0, len(self.stiffness_of_modes))
        return InertiaIntegrals(*(np.pad(matrix, elastic) for matrix in rigid.matrices))

    def surface(self, point, side: Side):
        """The same surface on either side of a film."""
        return GivenSurface(side, self)

    def error_measure(self):
        """The frame alone, as the modes have no mass."""
        measure = np.zeros((3, 3 + len(self.stiffness_of_modes)))
        measure[:, :3] = np.eye(3)
        return np.zeros((0, self.size)) if self.held else measure


@dataclass(frozen=True, eq=False)
class Bearing:
    """One bearing whose surface deforms, of a journal that turns or of a bore at rest."""

    film: ehd.Film
    mean: float
    speed: float
    load: float

    @property
    def _stiffness(self):
        grid = self.film.parameters.grid
        return stiffness(grid.radius, grid.width, self.mean)

    def at_rest(self, eccentricity, **joint):
        """An elastic bore at rest, a journal that turns backwards, and a constant load."""
        bodies = {
            "journal": ehd.MasslessBody({}),
            "housing": GivenBody(self._stiffness, held=True),
        }
        return self._mechanism(bodies, "housing", -self.speed, 0.0, eccentricity, **joint)

    def turning(self, eccentricity, **joint):
        """An elastic journal that turns, and the load with it, in a bore at rest."""
        bodies = {"journal": GivenBody(self._stiffness)}
        x, y = eccentricity
        rate = (-self.speed * y, self.speed * x)
        joint = {"eccentricity_rate": rate} | joint
        return self._mechanism(bodies, "ground", self.speed, self.speed, eccentricity, **joint)

    def _mechanism(self, bodies, bore, speed, load_speed, eccentricity, **joint):
        bearing = ehd.LubricatedJoint(
            "journal", bore, self.film, eccentricity=eccentricity, **joint
        )
        return ehd.Mechanism(
            bodies,
            {"bearing": bearing},
            {"journal": ehd.Speed(speed)},
            {"load": ehd.RotatingForce("journal", self.load, load_speed)},
        )
