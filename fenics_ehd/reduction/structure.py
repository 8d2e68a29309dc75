"""What a reduction needs to know about a part, whichever program made it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from fenics_ehd.errors import SettingsError

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True, eq=False)
class Bore:
    """Lubricated interface: nodes and pressure load.

    Attributes
    ----------
    radius, width
        Bore radius R2 and bearing width B [m]; the axis is z through the origin.
    nodes
        Global node numbers, shape (m,), sorted by z, then angle, the same on every rank.
    coordinates
        Their positions, shape (m, 3) [m].
    pressure_coordinates
        Positions of the pressure nodes, shape (k, 3) [m], in the same order.
    load
        J = M_ss of (15), (3 nodes) x k: nodal forces [N] of unit nodal pressures
        [Pa], pushing the bore outward.
    cells, family
        Surface mesh of the displacement: positions in `nodes` of the nodes of each
        bore cell, shape (c, 8, 9 or 6), corners, edge midpoints, centre in dolfinx
        order, and ``"serendipity"``, ``"lagrange"`` or ``"triangle"``. None when
        unknown; a film that does not match the bore needs it.
    pressure_cells, pressure_family
        The same of the pressure nodes.
    """

    radius: float
    width: float
    nodes: np.ndarray
    coordinates: np.ndarray
    pressure_coordinates: np.ndarray
    load: PETSc.Mat
    cells: np.ndarray | None = None
    family: str | None = None
    pressure_cells: np.ndarray | None = None
    pressure_family: str | None = None


@dataclass(frozen=True, eq=False)
class Recovery:
    """Elements of the part, to draw displacement fields.

    `cells` holds the global node numbers of the cells this rank owns, shape
    (cells, 20), in the order of VTK's quadratic hexahedron.
    """

    cells: np.ndarray


@dataclass(frozen=True, eq=False)
class Structure:
    """Linear structure ``M x'' + K x = f`` (16) with a lubricated bore.

    Degrees of freedom are ``3 * node + component``; rows are distributed over
    the ranks of `comm` by whole nodes.

    Attributes
    ----------
    stiffness, mass
        K [N/m] and M [kg], symmetric.
    coordinates
        Positions of the owned nodes, shape (owned nodes, 3) [m].
    bore
        The lubricated interface; None for a part without one, of which only
        static responses and vibration modes can be computed.
    attachments
        Load vectors of unit forces along x, y and z at each boundary point.
        The same vectors give the point's mean displacement: force and
        displacement are dual.
    recovery
        Elements, when displacement fields are to be drawn.
    owner
        Whatever must outlive the matrices; dolfinx frees the communicator they
        live on together with the mesh.
    """

    stiffness: PETSc.Mat
    mass: PETSc.Mat
    coordinates: np.ndarray
    bore: Bore | None = None
    attachments: Mapping[str, tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]] = field(default_factory=dict)
    recovery: Recovery | None = None
    owner: object = None

    @property
    def comm(self) -> MPI.Comm:
        """MPI communicator (mpi4py) of the matrices."""
        return self.stiffness.comm.tompi4py()

    @property
    def lubricated_bore(self) -> Bore:
        """The bore, of a part that must have one.

        Raises
        ------
        SettingsError
            The part has no bore.
        """
        if self.bore is None:
            raise SettingsError("the structure has no bore: pressure loads need one")
        return self.bore

    @property
    def size(self) -> int:
        """Number of degrees of freedom of the whole part."""
        return self.stiffness.size[0]
