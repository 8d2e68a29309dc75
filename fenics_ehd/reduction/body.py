"""The reduced body: everything the time simulation needs, and no part-size array."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.reduction.rigid_motion import rigid_fields

if TYPE_CHECKING:
    from fenics_ehd.reduction.spatial_inertia import SpatialInertia


@dataclass(frozen=True, eq=False)
class InertiaIntegrals:
    """Inertia coupling of a planar floating frame, exact for the finite-element mass matrix.

    Fields, in order: the position x (from the bore centre), the unit
    translations along x and y, the elastic modes; ``B`` holds them as columns,
    ``S`` is ``e_z x`` node by node.

    Attributes
    ----------
    mass
        ``B^T M B``, shape (3 + n, 3 + n).
    spin
        ``B^T M S B``, antisymmetric: Coriolis and Euler accelerations.
    centrifugal
        ``(S B)^T M (S B)``, symmetric.
    """

    mass: np.ndarray
    spin: np.ndarray
    centrifugal: np.ndarray

    @property
    def total_mass(self) -> float:
        """Mass of the part [kg]."""
        return float(self.mass[1, 1])

    @property
    def centre_of_mass(self) -> np.ndarray:
        """Centre of mass from the bore centre, x and y [m]."""
        return self.mass[0, 1:3] / self.total_mass

    @property
    def polar_inertia(self) -> float:
        """Moment of inertia about the z axis through the centre of mass [kg m^2]."""
        offset = self.centre_of_mass
        return float(self.centrifugal[0, 0] - self.total_mass * offset @ offset)


@dataclass(frozen=True, eq=False)
class ResidualFlexibility:
    """Bore flexibility beyond the coordinates, answered at once (M4).

    Attributes
    ----------
    displacement
        Of the bore nodes for unit amplitudes of the r patterns, shape (m, 3, r) [m/Pa].
    patterns
        Orthonormal pressure patterns, shape (r, k): the amplitudes of nodal pressures w are
        ``patterns @ w`` [Pa].
    stiffness
        Energy of unit amplitudes, twice: diagonal of ``V^T J^T G_res J V``, shape (r,),
        [J/Pa^2]. The generalised force of a pressure on an amplitude is this times the
        amplitude of the pressure.
    mass
        Mass matrix of the patterns' displacements, shape (r, r) [kg m^2/Pa^2]: neglected by the
        method, known for its error estimate; empty when not computed.
    """

    displacement: np.ndarray
    patterns: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray

    @property
    def rank(self) -> int:
        """Number r of patterns."""
        return len(self.stiffness)


@dataclass(frozen=True)
class ModeRecord:
    """One line of the mode inventory.

    Attributes
    ----------
    kind
        What sort of mode.
    frequency
        Natural frequency of the mode taken alone [Hz], infinite without mass.
    participation
        Its share of the bore's flexibility, the trace of ``J^T G J``; of the flexibility
        listed when the whole is not known.
    dropped
        Why it was left out, empty when it was kept.
    """

    kind: str
    frequency: float
    participation: float
    dropped: str = ""


def unknown() -> np.ndarray:
    """A matrix that was not given."""
    return np.zeros((0, 0))


def no_cells() -> np.ndarray:
    """Cells of a bore whose surface mesh is unknown."""
    return np.zeros((0, 0), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class ReducedBody:
    """A part described by ``n`` modal coordinates.

    Attributes
    ----------
    method
        Reduction method: ``"m1"`` to ``"m4"``, ``"full"`` or ``"rigid"``.
    frame
        Floating frame: ``"mean-axis"``, ``"bore-centre"`` or, of a part held by its
        support, ``"clamped"``.
    stiffness, mass
        ``T^T K T`` [N/m] and ``T^T M T`` [kg], shape (n, n). Damping is ``zeta`` times the
        stiffness with the zeta of the scene.
    frequencies
        Natural frequency of each coordinate taken alone [Hz], shape (n,).
    kinds
        ``"vibration"``, ``"fixed-boundary"``, ``"constraint"`` or ``"static"`` for each
        coordinate.
    bore_radius, bore_width
        [m].
    bore_nodes
        Positions of the bore nodes, shape (m, 3) [m].
    bore_basis
        Displacement of the bore nodes for unit coordinates, shape (m, 3, n).
    pressure_nodes
        Positions of the pressure nodes, shape (k, 3) [m].
    load_projection
        ``B^T J``, shape (3 + n, k): generalised force of nodal pressures on the
        fields of `InertiaIntegrals`.
    spin_load_projection
        ``(S B)^T J``, same shape: their moment about z.
    inertia
        Inertia integrals of plane motion.
    points
        Mean displacement of each boundary point for the same fields, shape (3, 3 + n).
    missing_flexibility
        Outward bore displacement per nodal pressure that the basis cannot
        follow, shape (m, k) [m/Pa]; empty when not computed.
    rigid_mass, rigid_coupling
        ``R^T M R``, shape (6, 6), and ``R^T M T``, shape (6, n), of the unit translations
        and rotations R about the bore's centre; empty when unknown.
    rigid_load
        ``R^T J``, shape (6, k): force and moment of nodal pressures; empty when unknown.
    residual
        Flexibility that M4 adds without coordinates, None for the other methods.
    inventory
        Every mode kept and dropped.
    bore_cells, bore_family
        Surface mesh of the bore as in `Bore`: nodes of each cell, shape (c, k), and
        family; empty when unknown.
    pressure_cells, pressure_family
        The same of the pressure nodes.
    accuracy
        Figures of the reduction: rank, dropped columns, residuals.
    provenance
        What the body was made from, text by name.
    columns
        The part-size basis T, rows owned by this rank, when it was asked for; not in the
        body's file (see `save_basis`).
    spatial
        Inertia couplings of motion in space, for other programs, when they were asked for;
        not in the body's file either.
    """

    method: str
    frame: str
    stiffness: np.ndarray
    mass: np.ndarray
    frequencies: np.ndarray
    kinds: tuple[str, ...]
    bore_radius: float
    bore_width: float
    bore_nodes: np.ndarray
    bore_basis: np.ndarray
    pressure_nodes: np.ndarray
    load_projection: np.ndarray
    spin_load_projection: np.ndarray
    inertia: InertiaIntegrals
    points: Mapping[str, np.ndarray]
    missing_flexibility: np.ndarray
    rigid_mass: np.ndarray = field(default_factory=unknown)
    rigid_coupling: np.ndarray = field(default_factory=unknown)
    rigid_load: np.ndarray = field(default_factory=unknown)
    residual: ResidualFlexibility | None = None
    inventory: tuple[ModeRecord, ...] = ()
    bore_cells: np.ndarray = field(default_factory=no_cells)
    bore_family: str = ""
    pressure_cells: np.ndarray = field(default_factory=no_cells)
    pressure_family: str = ""
    accuracy: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    columns: np.ndarray | None = None
    spatial: SpatialInertia | None = None

    def __post_init__(self) -> None:
        # Products round differently for another memory order; a body read from a file is
        # row-major, and must give the same run to the last bit.
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, np.ndarray) and f.name != "columns":
                object.__setattr__(self, f.name, np.ascontiguousarray(value))

    @property
    def modes(self) -> int:
        """Number of elastic coordinates n."""
        return len(self.frequencies)

    def basis_flexibility(self) -> np.ndarray:
        """Outward bore displacement per nodal pressure that the body follows, (m, k) [m/Pa].

        Of a free part: to pressures made self-equilibrated by its rigid inertia,
        less the rigid motion, whatever its frame.
        """
        return outward(self.bore_nodes, self.bore_flexibility())

    def bore_flexibility(self) -> np.ndarray:
        """The same with all three components, shape (m, 3, k) [m/Pa]."""
        m = len(self.bore_nodes)
        shape, load = self.bore_basis.reshape(3 * m, -1), self.load_projection[3:]
        if self.frame != "clamped" and self.rigid_mass.size:
            share = np.linalg.solve(self.rigid_mass, self.rigid_coupling)
            shape = shape - rigid_fields(self.bore_nodes) @ share
            load = load - share.T @ self.rigid_load
        response = shape @ np.linalg.solve(self.stiffness, load)
        if self.residual is not None:
            r = self.residual
            response = response + r.displacement.reshape(3 * m, -1) @ r.patterns
        return response.reshape(m, 3, -1)


def outward(nodes: np.ndarray, displacements: np.ndarray) -> np.ndarray:
    """Radial component at bore nodes, shape (m, 3, n) to (m, n)."""
    radial = nodes[:, :2] / np.linalg.norm(nodes[:, :2], axis=1)[:, None]
    return np.einsum("ic,icn->in", radial, displacements[:, :2])
