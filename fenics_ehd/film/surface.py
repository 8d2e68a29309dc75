"""A mesh of a whole cylinder, unwrapped to the plane (phi, z) and periodic in phi.

It may have holes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.base.errors import InterfaceMismatchError, StructureError
from fenics_ehd.reduction.bore_holes import BoreHole, bore_holes
from fenics_ehd.reduction.surface_elements import ELEMENTS

TURN = 2 * np.pi

#: Largest distance of a node from its place in the affine cell, in reference coordinates.
SHAPE_TOLERANCE = 1e-6

#: The same as the first for nodes in the middle of the edges of a hole: they lie on its rim.
RIM_TOLERANCE = 0.2


def unwrap(angle: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Angles moved by whole turns to within half a turn of others."""
    return angle - TURN * np.round((angle - near) / TURN)


@dataclass(frozen=True, eq=False)
class Surface:
    """Mesh of a cylinder about the z axis.

    Attributes
    ----------
    nodes
        Angle [rad] and height [m] of the nodes, shape (m, 2); angles may lie
        anywhere, cells across the seam unwrap themselves.
    cells
        Nodes of each cell, shape (c, k): corners, edge midpoints, centre, in
        dolfinx order; those of a `FilmGrid` are its `cell_nodes`.
    family
        ``"bilinear"``, ``"serendipity"``, ``"lagrange"`` (4, 8, 9 nodes on
        quadrilaterals) or ``"triangle"`` (6 nodes).

    Raises
    ------
    InterfaceMismatchError
        The cells are no straight-edged ones that cover a whole cylinder once, but for holes.
    """

    nodes: np.ndarray
    cells: np.ndarray
    family: str

    def __post_init__(self) -> None:
        size = len(ELEMENTS[self.family].nodes)
        if self.cells.ndim != 2 or self.cells.shape[1] != size:
            raise InterfaceMismatchError(
                f"surface cells of family {self.family} have {size} nodes each, the array of "
                f"cells has shape {self.cells.shape}"
            )
        used = np.unique(self.cells)
        if not np.array_equal(used, np.arange(len(self.nodes))):
            raise InterfaceMismatchError(
                f"surface cells use {len(used)} nodes numbered up to {used.max(initial=-1)}, "
                f"they must use each of the {len(self.nodes)} given"
            )
        self._check_shape()

    @classmethod
    def on_cylinder(cls, positions: np.ndarray, cells: np.ndarray, family: str) -> Surface:
        """Surface of nodes on a cylinder about the z axis, positions of shape (m, 3) [m]."""
        angle = np.arctan2(positions[:, 1], positions[:, 0])
        return cls(np.column_stack([angle, positions[:, 2]]), cells, family)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest z [m]."""
        return float(self.nodes[:, 1].min()), float(self.nodes[:, 1].max())

    @property
    def width(self) -> float:
        """Length along z [m]."""
        return self.bounds[1] - self.bounds[0]

    @cached_property
    def covered(self) -> float:
        """Area of the cells [rad m]."""
        return float(self.determinants.sum() * (0.5 if self.triangular else 1.0))

    @cached_property
    def holes(self) -> list[BoreHole]:
        """Holes that the cells leave."""
        if not self.covered < (1 - SHAPE_TOLERANCE) * TURN * self.width:
            return []
        angle, z = self.nodes.T
        try:
            found = bore_holes(
                np.column_stack([np.cos(angle), np.sin(angle), z]), self.cells, self.family
            )
        except StructureError:  # what they leave is no hole
            return []
        return [hole.straight() for hole in found] if self.family != "bilinear" else found

    @property
    def triangular(self) -> bool:
        """Whether the cells are triangles."""
        return ELEMENTS[self.family].corners == 3

    @cached_property
    def cell_nodes(self) -> np.ndarray:
        """Nodes of every cell side by side in the plane, shape (c, k, 2)."""
        x = self.nodes[self.cells]
        x[:, :, 0] = unwrap(x[:, :, 0], x[:, :1, 0])
        return x

    @cached_property
    def corners(self) -> np.ndarray:
        """Corners of every cell in dolfinx order, shape (c, 3 or 4, 2)."""
        return self.cell_nodes[:, : 3 if self.triangular else 4]

    @cached_property
    def jacobians(self) -> np.ndarray:
        """Derivative of (phi, z) with respect to the reference coordinates, shape (c, 2, 2)."""
        first = self.corners[:, 0]
        return np.stack([self.corners[:, 1] - first, self.corners[:, 2] - first], axis=2)

    @cached_property
    def determinants(self) -> np.ndarray:
        """Area [rad m] per reference area of every cell, shape (c,)."""
        return np.abs(np.linalg.det(self.jacobians))

    @cached_property
    def _inverse_transposes(self) -> np.ndarray:
        return np.linalg.inv(self.jacobians).swapaxes(1, 2)

    def reference(self, cells: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Reference coordinates of points (p, n, 2), each row in the cell given for it (p,)."""
        offsets = points - self.corners[:, 0][cells][:, None]
        return offsets @ self._inverse_transposes[cells]

    def _check_shape(self) -> None:
        covered = self.covered
        if not abs(covered - TURN * self.width) <= SHAPE_TOLERANCE * TURN * self.width:
            covered += sum(hole.area for hole in self.holes)
        if not abs(covered - TURN * self.width) <= SHAPE_TOLERANCE * TURN * self.width:
            raise InterfaceMismatchError(
                f"surface cells cover {covered / max(self.width, 1e-300):.6g} rad of the "
                "circumference, not a whole turn: they must be narrower than half a turn and "
                "neither overlap nor leave gaps"
            )
        places = ELEMENTS[self.family].nodes
        found = self.reference(np.arange(len(self.cells)), self.cell_nodes)
        off = np.abs(found - places).max(axis=2)
        for hole in self.holes:
            on_rim = np.isin(self.cells, hole.rim)
            off[on_rim & (off <= RIM_TOLERANCE)] = 0.0
        defect = off.max()
        if not defect <= SHAPE_TOLERANCE:
            raise InterfaceMismatchError(
                f"a surface node lies {defect:.1e} cells off its place, above "
                f"{SHAPE_TOLERANCE:.0e}: quadrilaterals must be parallelograms in (phi, z), with "
                "mid-side nodes at the middle of the edges"
            )

    @cached_property
    def centres(self) -> np.ndarray:
        """Centres of the cells, shape (c, 2)."""
        return self.corners.mean(axis=1)
