"""The reduced body: everything the time simulation needs, and no part-size array."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np


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


def no_cells() -> np.ndarray:
    """Cells of a bore whose surface mesh is unknown."""
    return np.zeros((0, 0), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class ReducedBody:
    """A part described by ``n`` modal coordinates.

    Attributes
    ----------
    method, frame
        Reduction method and floating frame (``"mean-axis"``).
    stiffness, mass
        ``T^T K T`` [N/m] and ``T^T M T`` [kg], block diagonal, shape (n, n).
    frequencies
        Natural frequency of each coordinate taken alone [Hz], shape (n,).
    kinds
        ``"vibration"`` or ``"static"`` for each coordinate.
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
        Inertia integrals.
    points
        Mean displacement of each boundary point for the same fields, shape (3, 3 + n).
    missing_flexibility
        Outward bore displacement per nodal pressure that the basis cannot
        follow, shape (m, k) [m/Pa]; empty when not computed.
    bore_cells, bore_family
        Surface mesh of the bore as in `Bore`: nodes of each cell, shape (c, k), and
        family; empty when unknown.
    pressure_cells, pressure_family
        The same of the pressure nodes.
    accuracy
        Figures of the reduction: rank, dropped columns, residuals.
    provenance
        What the body was made from, text by name.
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
    bore_cells: np.ndarray = field(default_factory=no_cells)
    bore_family: str = ""
    pressure_cells: np.ndarray = field(default_factory=no_cells)
    pressure_family: str = ""
    accuracy: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Products round differently for another memory order; a body read from a file is
        # row-major, and must give the same run to the last bit.
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, f.name, np.ascontiguousarray(value))

    @property
    def modes(self) -> int:
        """Number of elastic coordinates n."""
        return len(self.frequencies)

    def basis_flexibility(self) -> np.ndarray:
        """Outward bore displacement per nodal pressure that the basis follows, (m, k) [m/Pa]."""
        responses = np.linalg.solve(self.stiffness, self.load_projection[3:])
        return outward(self.bore_nodes, self.bore_basis) @ responses

    def rigid(self) -> ReducedBody:
        """The same body without elastic coordinates."""
        first = slice(0, 3)
        return replace(
            self,
            method="rigid",
            stiffness=np.zeros((0, 0)),
            mass=np.zeros((0, 0)),
            frequencies=np.zeros(0),
            kinds=(),
            bore_basis=self.bore_basis[:, :, :0],
            load_projection=self.load_projection[first],
            spin_load_projection=self.spin_load_projection[first],
            inertia=InertiaIntegrals(
                self.inertia.mass[first, first],
                self.inertia.spin[first, first],
                self.inertia.centrifugal[first, first],
            ),
            points={name: point[:, first] for name, point in self.points.items()},
            missing_flexibility=self.missing_flexibility + self.basis_flexibility()
            if self.missing_flexibility.size
            else self.missing_flexibility,
        )


def outward(nodes: np.ndarray, displacements: np.ndarray) -> np.ndarray:
    """Radial component at bore nodes, shape (m, 3, n) to (m, n)."""
    radial = nodes[:, :2] / np.linalg.norm(nodes[:, :2], axis=1)[:, None]
    return np.einsum("ic,icn->in", radial, displacements[:, :2])
