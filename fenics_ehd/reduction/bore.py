"""Lubricated bores of a part: cylinders along z with their surface meshes, and rigid motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fenics_ehd.base.errors import SettingsError, StructureError

if TYPE_CHECKING:
    from petsc4py import PETSc


def rigid_fields(coordinates: np.ndarray) -> np.ndarray:
    """Unit translations and rotations about the origin, shape (3 nodes, 6)."""
    x, y, z = coordinates.T
    fields = np.zeros((len(coordinates), 3, 6))
    fields[:, range(3), range(3)] = 1.0
    fields[:, 1, 3], fields[:, 2, 3] = -z, y
    fields[:, 0, 4], fields[:, 2, 4] = z, -x
    fields[:, 0, 5], fields[:, 1, 5] = -y, x
    return fields.reshape(-1, 6)


def turned(columns: np.ndarray, axis: int) -> np.ndarray:
    """``e_axis x u`` node by node, for displacement fields of shape (3 nodes, k)."""
    result = np.zeros_like(columns)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    result[first::3] = -columns[second::3]
    result[second::3] = columns[first::3]
    return result


B = TypeVar("B", bound="BoreSurface")

#: Name of the bore of a part that has one.
BORE = "bore"


def make_row_major(record: Any) -> None:
    """Have the arrays of a dataclass in the memory order of a file, part-size columns apart.

    Products round differently for another one, and a body that was in a file must give the same
    run to the last bit.
    """
    for name, value in vars(record).items():
        if isinstance(value, np.ndarray) and name != "columns":
            object.__setattr__(record, name, np.ascontiguousarray(value))


def no_cells() -> np.ndarray:
    """Cells of a bore whose surface mesh is unknown."""
    return np.zeros((0, 0), dtype=np.int64)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoreSurface:
    """Surface of a bore; positions are counted from its centre.

    Attributes
    ----------
    radius, width
        Bore radius R2 and bearing width B [m]; the axis is along z through the centre.
    coordinates
        Positions of the bore's nodes, shape (m, 3) [m].
    pressure_coordinates
        Positions of the pressure nodes, shape (k, 3) [m].
    cells, family
        Surface mesh of the displacement: positions in `coordinates` of the nodes of each
        bore cell, shape (c, 8, 9 or 6), corners, edge midpoints, centre in dolfinx
        order, and ``"serendipity"``, ``"lagrange"`` or ``"triangle"``. Empty when
        unknown; a film that does not match the bore needs it.
    pressure_cells, pressure_family
        The same of the pressure nodes.
    centre
        Of the bore, from the origin of the part, shape (3,) [m]. The origin is the centre of
        the part's first bore.
    """

    radius: float
    width: float
    coordinates: np.ndarray
    pressure_coordinates: np.ndarray
    cells: np.ndarray = field(default_factory=no_cells)
    family: str = ""
    pressure_cells: np.ndarray = field(default_factory=no_cells)
    pressure_family: str = ""
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        make_row_major(self)

    def surface(self) -> BoreSurface:
        """The surface alone, without what a `Bore` adds."""
        return BoreSurface(**{f.name: getattr(self, f.name) for f in fields(BoreSurface)})


@dataclass(frozen=True, eq=False, kw_only=True)
class Bore(BoreSurface):
    """Lubricated interface of a part: surface, nodes and pressure load.

    Attributes
    ----------
    nodes
        Global node numbers, shape (m,), sorted by z, then angle, the same on every rank.
    load
        J = M_ss of (15), (3 nodes) x k: nodal forces [N] of unit nodal pressures
        [Pa], pushing the bore outward. Whatever `as_matrix` takes; in a `Structure` it is
        a PETSc matrix with the rows of K.
    reference
        Mean motion of the bore, its centre C2: ``sum_ic reference[i, c, k] u[i, c]`` is for
        k < 3 the mean translation [m], else the mean rotation about its centre [rad], see
        `mean_motion`; shape (m, 3, 6). Read the other way it spreads a unit force or moment
        at C2 over the nodes. None when unknown; M1 and M2 need that of the first bore.
    """

    nodes: np.ndarray
    load: PETSc.Mat
    reference: np.ndarray | None = None


def only(bores: Mapping[str, B], of: str) -> B:
    """The bore of a part that has exactly one.

    Raises
    ------
    SettingsError
        It has none, or several: say which.
    """
    if len(bores) == 1:
        return next(iter(bores.values()))
    if bores:
        raise SettingsError(f"the {of} has the bores {', '.join(bores)}: name one of them")
    raise SettingsError(f"the {of} has no bore: pressure loads need one")


def outward(nodes: np.ndarray, displacements: np.ndarray) -> np.ndarray:
    """Radial component at nodes of one bore, shape (m, 3, n) to (m, n)."""
    radial = nodes[:, :2] / np.linalg.norm(nodes[:, :2], axis=1)[:, None]
    return np.einsum("ic,icn->in", radial, displacements[:, :2])


def all_outward(bores: Mapping[str, BoreSurface], displacements: np.ndarray) -> np.ndarray:
    """Radial component at the nodes of all bores in turn, each away from its own axis."""
    nodes = np.vstack([bore.coordinates for bore in bores.values()])
    return outward(nodes, displacements)


def mean_motion(coordinates: np.ndarray, weights: Any) -> np.ndarray:
    """Mean rigid motion of a surface as linear functions of its nodal displacements.

    Least-squares fit of ``a + b x r`` to the displacement u over the surface: the
    a and b that minimise ``int |u - a - b x r|^2 dA``. On a surface centred at the
    origin a is the area-weighted mean of u.

    Parameters
    ----------
    coordinates
        Positions r of the nodes, shape (m, 3) [m].
    weights
        ``int N_i N_j dA`` of the shape functions, shape (m, m), an array or a SciPy sparse
        matrix; or lumped nodal areas, shape (m,) [m^2].

    Returns
    -------
    numpy.ndarray
        shape (m, 3, 6): weights of u_i for the components of a, and those of b about the
        origin. A rigid motion of all nodes gives itself. As nodal forces, column k has a
        resultant of a unit force or moment along its axis at the origin, and no other.

    Raises
    ------
    StructureError
        The nodes lie on one line, so that they have no rotation about it.
    """
    size = np.abs(coordinates).max()
    fields = rigid_fields(coordinates / size).reshape(len(coordinates), 18)
    weighted = weights[:, None] * fields if weights.ndim == 1 else weights @ fields
    weighted, fields = (a.reshape(-1, 6) for a in (weighted, fields))
    gram = fields.T @ weighted
    if not np.linalg.cond(gram) < 1e12:
        raise StructureError("the nodes of a surface lie on one line: it has no mean rotation")
    motion = np.linalg.solve(gram, weighted.T).T
    motion[:, 3:] /= size
    return motion.reshape(-1, 3, 6)
