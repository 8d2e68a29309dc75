"""Surfaces of a film: deviation, elastic deformation and rotation on each side of a gap.

The gap of a film lies between two surfaces: that of the bore, with the sign s = +1, and that of the
journal, with s = -1. In the frame of the bore,

    h = c - n . (e + z (psi_y, -psi_x)) + sum s v(phi_s),    v = delta + Psi q,

with the radial deviation delta of a surface (`fenics_ehd.film.kinematics.Shape`) and the outward
displacements Psi of its elastic modes. Both are functions of the surface's own angle ``phi_s``,
which is phi for the bore and ``phi - alpha`` for a journal at the angle alpha relative to the bore.
The deviation of a journal that is not round rotates relative to the film,

    dh/dalpha = dv/dphi (phi - alpha),    h' = ... - Psi q' + alpha' dh/dalpha,

and pressures exert the torque ``int p dh/dalpha dA`` on it. Forces on the modes are
``int p s Psi dA``: gap and force are conjugate.

Surfaces at rest in the bore's frame have constant derivatives of the gap (`SurfaceRows`). Those of
a turning surface, with respect to its k coordinates ``(q, alpha)``, are computed at every iterate
of Newton's method (`TurningRows`). The tangential velocity of its elastic modes and its power are
neglected: both are c / R of those of the radial displacement.

`Body.surface` returns the surface of a body at one of its points. `Surface` itself is rigid; it is
the base class of surfaces with elastic modes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from fenics_ehd.film.kinematics import Shape

if TYPE_CHECKING:
    from fenics_ehd.film.film import Film

#: Signs with which outward displacements of a bore and of a journal change the gap.
BORE = 1.0
JOURNAL = -1.0


def observed_positions(film: Film) -> tuple[np.ndarray, np.ndarray]:
    """Angles [rad] and heights [m] of the w points at which gaps are observed, shape (w,) each.

    The points are the Gauss points of a film, followed by its nodes.
    """
    nodes = film.parameters.grid.node_positions
    points = film.points
    return (
        np.concatenate([points.angle.ravel(), nodes[:, 0]]),
        np.concatenate([points.height.ravel(), nodes[:, 1]]),
    )


@dataclass(frozen=True, eq=False)
class Side:
    """Side of a film, bore or journal, for which a body makes a surface.

    Attributes
    ----------
    film
        The film.
    sign
        Sign of outward displacements in the gap, `BORE` or `JOURNAL`.
    shape
        Radial deviation of the surface in the frame of its body; None if it is round.
    transfer
        Transfer of pressures to a mesh that does not match that of the film, one of `TRANSFERS`.
    """

    film: Film
    sign: float = BORE
    shape: Shape | None = None
    transfer: str = "conservative"

    @property
    def name(self) -> str:
        """Name of the side, ``"bore"`` or ``"journal"``."""
        return "bore" if self.sign == BORE else "journal"


@dataclass(frozen=True, eq=False)
class SurfaceRows:
    """Constant linear maps between a film and the n elastic modes of a surface.

    Attributes
    ----------
    gap
        Change of the gap at the w Gauss points and nodes for unit amplitudes of the modes, shape
        (w, n).
    mean_velocity, sliding_velocity
        Change of the mean and the sliding velocity at the g Gauss points for unit rates of the
        amplitudes, shape (g, n) each.
    load
        Generalised forces on the modes for unit nodal pressures, shape (n, nodes).
    resultant
        Force of unit nodal pressures on the surface along x and y, shape (2, nodes); None if this
        force is the integral of the pressure over the film.
    """

    gap: np.ndarray
    mean_velocity: np.ndarray
    sliding_velocity: np.ndarray
    load: np.ndarray
    resultant: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class TurningRows:
    """Derivatives of a gap with respect to the k coordinates ``(q, alpha)`` of a turning surface.

    Attributes
    ----------
    gap, gap_rate
        Derivatives of the gap and of its rate at the g Gauss points, shape (g, k) each.
    second_derivative
        Second derivatives of the gap with respect to alpha and each coordinate, shape (g, k). All
        other second derivatives are zero.
    load, load_derivative
        Generalised forces for unit nodal pressures, and their derivatives with respect to alpha,
        shape (k, nodes) each.
    """

    gap: np.ndarray
    gap_rate: np.ndarray
    second_derivative: np.ndarray
    load: np.ndarray
    load_derivative: np.ndarray

    @staticmethod
    def stiffness(along_angle: np.ndarray) -> np.ndarray:
        """Matrix of the derivatives of k forces with respect to the k coordinates (q, alpha).

        Its last row and column are `along_angle`, shape (k,): the derivatives of the forces with
        respect to the angle alpha. All other entries are zero.
        """
        matrix = np.zeros((len(along_angle), len(along_angle)))
        matrix[-1] = along_angle
        matrix[:, -1] = along_angle
        return matrix


@dataclass(frozen=True, eq=False)
class Compliance:
    """Residual patterns of a surface: displacement fields that respond to forces without inertia.

    Displacements are those of the surface's m nodes along x and y. Each of the r patterns of a body
    displaces the nodes of all its surfaces.

    Attributes
    ----------
    shapes
        Displacements of the nodes for unit amplitudes, shape (2 m, r).
    amplitudes
        Static amplitudes of the patterns for unit values of the l loads of the surface, shape
        (r, l). Loads are forces on the nodes, l = 2 m; with a mortar, pressures at the body's
        pressure nodes.
    to_gap, to_observed
        Matrices from displacements to changes of the gap at the g Gauss points, shape (g, 2 m), and
        at the w Gauss points and film nodes, shape (w, 2 m).
    from_pressure, from_forces
        Matrices to loads from nodal pressures of the film, shape (l, nodes), and from normal forces
        on its Gauss points, shape (l, g). `from_forces` is zero with a mortar.
    stiffness
        Stiffness of every amplitude, shape (r,).
    damping_time
        Structural damping zeta of the body [s].
    """

    shapes: np.ndarray
    amplitudes: np.ndarray
    to_gap: sparse.csr_matrix
    to_observed: sparse.csr_matrix
    from_pressure: sparse.csr_matrix
    from_forces: sparse.csr_matrix
    stiffness: np.ndarray
    damping_time: float


@dataclass(frozen=True, eq=False)
class MissingFlexibility:
    """Flexibility that the model of a body lacks at one surface, which causes an error of the gap.

    Attributes
    ----------
    flexibility
        Outward displacements of m points of the surface for unit loads of the body, shape (m, k);
        empty if the error is not known. Loads are the pressures `Surface.loads` [m/Pa], followed by
        forces on points of the body [m/N].
    to_observed
        Matrix from displacements of the m points to changes of the gap at the w Gauss points and
        nodes of the film, shape (w, m).
    damping_time
        Structural damping zeta of the body [s].
    neglected_inertia
        Outward displacement of the m points per acceleration of the r residual amplitudes, shape
        (m, r); None if no inertia is neglected.
    inertia_time
        Time constant of the slowest residual pattern [s].
    """

    flexibility: np.ndarray
    to_observed: sparse.spmatrix
    damping_time: float
    neglected_inertia: np.ndarray | None = None
    inertia_time: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the missing flexibility is known."""
        return bool(self.flexibility.size)

    def scaled(self, factor: float) -> MissingFlexibility:
        """Return the missing flexibility multiplied by a factor."""
        return replace(self, flexibility=factor * self.flexibility)

    def gap_changes(self, displacements: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Changes of the gap at w points and t instants, shape (t, w) [m].

        `displacements` are those of m points of the surface, shape (t, m) [m]. `angles` are those
        of the surface relative to the bore, shape (t,) [rad]; they have no effect here, because the
        surface is at rest.
        """
        return (self.to_observed @ displacements.T).T


class Surface:
    """Surface of a body on one side of a film; rigid, with the shape of its side.

    Parameters
    ----------
    side
        Side of the film.
    modes
        Number n of elastic modes, which are the body's last coordinates.

    Attributes
    ----------
    side, modes
        Arguments of the constructor.
    shape
        Radial deviation of the surface.
    """

    #: Whether the surface deforms.
    elastic = False

    #: Whether a mortar transfers pressures to the body; it cannot transfer forces at Gauss points.
    mortar = False

    #: Centre of the undeformed surface on the mesh of the body, shape (3,) [m]; None without a
    #: mesh.
    centre: np.ndarray | None = None

    def __init__(self, side: Side, modes: int = 0):
        self.side = side
        self.modes = modes
        self.shape = side.shape or Shape()
        self._angle, self._height = observed_positions(side.film)
        self._inside = side.film.points.angle.size

    @property
    def turning(self) -> bool:
        """Whether the shape of this surface makes the gap depend on the angle of the journal."""
        return self.side.sign == JOURNAL and (self.elastic or not self.shape.round)

    @property
    def largest_second_derivative(self) -> float:
        """Largest second derivative of the surface's deviation with respect to angle [m/rad^2].

        Its sign is ignored.
        """
        return float(np.abs(self.shape.radial(self._angle, self._height, 2)).max())

    def outward(self, angle: np.ndarray, height: np.ndarray, order: int = 0) -> np.ndarray:
        """Outward displacement of the surface in each of n elastic modes, or its derivative.

        The derivative is that with respect to angle.

        Parameters
        ----------
        angle, height
            Angles [rad] and heights [m] of p points in the frame of the body, shape (p,) each.
        order
            Order of the derivative, 0, 1 or 2.

        Returns
        -------
        numpy.ndarray
            Displacements for unit coordinates, shape (p, n).
        """
        return np.zeros((len(angle), self.modes))

    @cached_property
    def deviation(self) -> np.ndarray:
        """Constant gap change at the w Gauss points and nodes due to the surface's shape, (w,) [m].

        It is zero for a turning surface, whose effect is not constant.
        """
        if self.turning:
            return np.zeros(len(self._angle))
        return self.side.sign * self.shape.radial(self._angle, self._height)

    @property
    def rows(self) -> SurfaceRows | None:
        """Constant linear maps between the film and the elastic modes of the surface.

        None if the surface has no modes, or turns through the film.
        """
        if not self.modes or self.turning:
            return None
        film = self.side.film
        gap = self.side.sign * self.outward(self._angle, self._height)
        load = film.load(gap[: self._inside].reshape(*film.points.angle.shape, self.modes))
        still = np.zeros((self._inside, self.modes))
        return SurfaceRows(gap, still, still, load)

    @property
    def compliance(self) -> Compliance | None:
        """Residual patterns of the surface (M4); None if the surface has no patterns."""
        return None

    def missing_flexibility(self, component: str) -> MissingFlexibility | None:
        """Flexibility that the model of the body lacks at this surface.

        Parameters
        ----------
        component
            Component of an error budget: ``"basis"`` for the error of the body's reduction,
            ``"part_mesh"`` for that of its mesh.

        Returns
        -------
        MissingFlexibility or None
            None if the surface has no such error, or if the error cannot be computed.
        """
        return None

    def loads(self, pressure: np.ndarray, angle: float) -> np.ndarray | None:
        """Loads of the body due to film pressures, as in `MissingFlexibility.flexibility`.

        Parameters
        ----------
        pressure
            Pressures at the film's nodes [Pa].
        angle
            Angle of the surface relative to the bore [rad].

        Returns
        -------
        numpy.ndarray or None
            Pressures at the k pressure nodes of all surfaces of the body, shape (k,) [Pa]; 0 at
            nodes of other films. None if the body has no such nodes.
        """
        return None

    def displacement(self, angle: np.ndarray, height: np.ndarray) -> np.ndarray | None:
        """Displacement of the surface in elastic modes and residual patterns, for pictures.

        Parameters
        ----------
        angle, height
            Angles [rad] and heights [m] of p points in the frame of the body, shape (p,) each.

        Returns
        -------
        numpy.ndarray or None
            Components x, y, z of the displacement of p points, for unit amplitudes of the n modes
            and then of the r patterns, shape (p, 3, n + r). None if the surface is rigid, or its
            displacement is not known.
        """
        return None

    def nodal_forces(
        self, pressure: np.ndarray, contact: np.ndarray | float, angles: np.ndarray
    ) -> np.ndarray | None:
        """Forces of a film on the nodes of the surface at t instants, for stresses.

        Parameters
        ----------
        pressure
            Pressures at the film's nodes, shape (nodes, t) [Pa].
        contact
            Forces of contact at the Gauss points, shape (g, t) [N]; 0 between smooth surfaces.
        angles
            Angles of the surface relative to the bore, shape (t,) [rad].

        Returns
        -------
        numpy.ndarray or None
            Components x, y, z of the forces on the m nodes in the frame of the body, shape
            (t, m, 3) [N]; None if the surface has no nodes.
        """
        return None

    def _displacement(
        self, coordinates: np.ndarray, points: slice = slice(None), order: int = 0
    ) -> np.ndarray:
        """Outward displacement of a turning surface [m], or its derivative with respect to angle.

        `coordinates` are ``(q, alpha)``. `points` selects some of the points where gaps are
        observed. `order` is the order of the derivative.
        """
        angle = self._angle[points] - coordinates[-1]
        height = self._height[points]
        displacement = self.shape.radial(angle, height, order)
        if self.modes:
            displacement = displacement + self.outward(angle, height, order) @ coordinates[:-1]
        return displacement

    def gap_change(self, coordinates: np.ndarray) -> np.ndarray:
        """Gap change due to this surface if it turns, at its coordinates ``(q, alpha)``.

        Returns
        -------
        numpy.ndarray
            Gap change at the w Gauss points and nodes, shape (w,) [m].
        """
        return self.side.sign * self._displacement(coordinates)

    def turning_gap(
        self, coordinates: np.ndarray, rates: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Gap change at the Gauss points due to this surface if it turns, and rate of the change.

        Parameters
        ----------
        coordinates, rates
            Coordinates ``(q, alpha)`` and their time derivatives, shape (k,) each.

        Returns
        -------
        change, rate : numpy.ndarray
            Gap change [m] and its rate [m/s], shape (g,) each.
        """
        inside = slice(self._inside)
        sign = self.side.sign
        change = sign * self._displacement(coordinates, inside)
        rate = rates[-1] * (-sign * self._displacement(coordinates, inside, 1))
        if self.modes:
            angle = self._angle[inside] - coordinates[-1]
            rate = rate + sign * (self.outward(angle, self._height[inside]) @ rates[:-1])
        return change, rate

    def turning_rows(self, coordinates: np.ndarray, rates: np.ndarray) -> TurningRows:
        """Derivatives of the gap with respect to the coordinates ``(q, alpha)`` of this surface.

        The surface turns through the film. `rates` are the rates of the coordinates, see
        `turning_gap`.
        """
        inside = slice(self._inside)
        sign = self.side.sign
        slope = -sign * self._displacement(coordinates, inside, 1)
        second = sign * self._displacement(coordinates, inside, 2)
        gap = slope[:, None]
        second = second[:, None]
        gap_rate = rates[-1] * second
        if self.modes:
            angle = self._angle[inside] - coordinates[-1]
            height = self._height[inside]
            along_modes = -sign * self.outward(angle, height, 1)
            gap = np.hstack([sign * self.outward(angle, height), gap])
            second = np.hstack([along_modes, second])
            gap_rate = rates[-1] * second
            gap_rate[:, -1] += along_modes @ rates[:-1]
        film = self.side.film
        fields = np.hstack([gap, second])
        k = gap.shape[1]
        loads = film.load(fields.reshape(*film.points.angle.shape, 2 * k))
        return TurningRows(gap, gap_rate, second, loads[:k], loads[k:])
