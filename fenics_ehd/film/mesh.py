"""The unwrapped bore as a closed cylinder of 9-node quadrilaterals.

Topology cannot be periodic in the plane, so the film mesh is a closed
manifold in 3D. Its second-order geometry is the one the bore facets of the
part have: nodes on the circle, which straight cells would miss by 0.4 % of
the circumference at 20 cells.
"""

from __future__ import annotations

import numpy as np
from dolfinx.mesh import Mesh
from mpi4py import MPI

from fenics_ehd import compat


def _cell_nodes(around: int, along: int) -> np.ndarray:
    """Node indices of every cell in dolfinx order: corners, edges, centre."""
    i, j = np.meshgrid(np.arange(around), np.arange(along), indexing="ij")

    def node(a: int, b: int) -> np.ndarray:
        return ((2 * i + a) % (2 * around)) * (2 * along + 1) + 2 * j + b

    offsets = [(0, 0), (2, 0), (0, 2), (2, 2), (1, 0), (0, 1), (2, 1), (1, 2), (1, 1)]
    return np.stack([node(a, b).ravel() for a, b in offsets], axis=1).astype(np.int64)


def cylinder_mesh(
    radius: float, width: float, around: int, along: int, comm: MPI.Comm = MPI.COMM_SELF
) -> Mesh:
    """Closed cylinder about the z axis, z from ``-width/2`` to ``width/2``.

    Parameters
    ----------
    radius, width
        Bore radius and bearing width [m].
    around, along
        Cells along the circumference and along the axis.
    comm
        Communicator; the film is solved on one rank.

    Returns
    -------
    dolfinx.mesh.Mesh
        Quadratic quadrilaterals, a cell boundary at angle zero.
    """
    angle = np.pi * np.arange(2 * around) / around
    height = np.linspace(-width / 2, width / 2, 2 * along + 1)
    x = np.empty((2 * around, 2 * along + 1, 3))
    x[:, :, 0] = radius * np.cos(angle)[:, None]
    x[:, :, 1] = radius * np.sin(angle)[:, None]
    x[:, :, 2] = height
    element = compat.lagrange_element("quadrilateral", 2, (3,))
    return compat.create_mesh(comm, _cell_nodes(around, along), element, x.reshape(-1, 3))
