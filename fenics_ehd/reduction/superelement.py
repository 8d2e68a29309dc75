"""Craig-Bampton superelement of a reduced body, for Nastran and others: OUTPUT4 and DMIG files.

The boundary of the superelement has a grid point at the centre of every bore and at every boundary
point of the body. A grid point of a bore has six degrees of freedom, the mean motion of the bore's
nodes with equal weights, as of an RBE3; one of a boundary point has three, the mean displacement of
its surface. They are linear functions ``u = B y`` of the coordinates y of the body: six rigid
motions of a free part, then its elastic coordinates. With a basis N of the null space of B, the
constraint modes C and the fixed-interface modes are those of Craig and Bampton (AIAA Journal 6
(1968) 1313) within the reduced body:

    C = B^+ - N (N^T K N)^+ N^T K B^+,
    N^T K N Z = N^T M N Z diag(w^2),    Z^T N^T M N Z = 1,
    y = C u + N Z q.

The change of coordinates is invertible: no mode of the body is lost. K has the blocks ``C^T K C``
and ``diag(w^2)``; M couples them by ``C^T M N Z``. A body of M4 has flexibility without
coordinates, which a superelement cannot have.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag, eigh

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.files import beginning_with, write_whole
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.bore import mean_motion, rigid_fields
from fenics_ehd.reduction.matrices import symmetric

#: Smallest singular value of B, relative to the largest one, at which the displacements of the
#: boundary count as independent. That of the shipped rod is 2e-3; of dependent ones 1e-16.
INDEPENDENT = 1e-9

#: Stiffness of a motion with a fixed boundary, relative to the largest one, below which it counts
#: as rigid. An elastic mode of a steel part has 1e-6 or more.
RIGID = 1e-10

#: First number of the scalar points, whose displacements are the modal coordinates.
FIRST_MODE = 1001

#: Values in a line of a text file of OUTPUT4, with 16 digits.
OP4_LINE = 3

#: Magnitude below which a value is written as zero. A field holds exponents of two digits, readers
#: differ in three, and entries of K in N/m and M in kg are round-off long before.
SMALLEST = 1e-99

#: Names of the matrices in an OUTPUT4 file: stiffness, mass, displacements of the bores' nodes.
OP4_NAMES = ("KAA", "MAA", "UBORE")

#: Names of the matrices on DMIG cards.
DMIG_NAMES = ("KAAX", "MAAX")

#: Kinds of exported files, recognised before they are replaced.
OP4_KIND = beginning_with("an exported superelement (OUTPUT4)", b"KAA     1P,3E23.16", at=32)
DMIG_HEAD = "$ superelement of fenics_ehd"
DMIG_KIND = beginning_with("an exported superelement (DMIG)", DMIG_HEAD.encode())


@dataclass(frozen=True)
class GridPoint:
    """Grid point of the boundary.

    Attributes
    ----------
    name
        Name of the bore or of the boundary point.
    position
        Position relative to the origin of the body, the centre of its first bore, shape (3,) [m].
    components
        Degrees of freedom: 6 of a bore, 3 of a boundary point.
    """

    name: str
    position: np.ndarray
    components: int


@dataclass(frozen=True, eq=False)
class Superelement:
    """Matrices of a body in the coordinates of its boundary and of its fixed-interface modes.

    Attributes
    ----------
    stiffness, mass
        K [N/m] and M [kg], shape (b + n, b + n): b degrees of freedom of the grid points, one grid
        point after the other, then n modal coordinates, mass-normalised.
    grid_points
        Grid points in the order of the rows.
    frequencies
        Natural frequencies with a fixed boundary, shape (n,) [Hz].
    bore_displacement
        Displacement of the bores' m nodes for unit coordinates, shape (m, 3, b + n).
    """

    stiffness: np.ndarray
    mass: np.ndarray
    grid_points: tuple[GridPoint, ...]
    frequencies: np.ndarray
    bore_displacement: np.ndarray

    @property
    def rows(self) -> Iterator[tuple[int, int]]:
        """Number of the grid or scalar point and component of every row; component 0 of a mode."""
        for number, point in enumerate(self.grid_points, start=1):
            for component in range(1, point.components + 1):
                yield number, component
        for mode in range(len(self.frequencies)):
            yield FIRST_MODE + mode, 0


def superelement(body: ReducedBody) -> Superelement:
    """Craig-Bampton superelement of a reduced body.

    Raises
    ------
    StructureError
        If the body has flexibility without coordinates (M4), if the rigid motions of a free part
        are unknown, or if the body has fewer independent coordinates than its boundary.
    """
    if body.residual is not None:
        raise StructureError(
            "a body of M4 has flexibility without coordinates, which a superelement cannot have: "
            "reduce with method m1, m2 or m3"
        )
    free = body.frame != "clamped"
    if free and not body.rigid_mass.size:
        raise StructureError("the body's file has no rigid motions: reduce the part again")
    stiffness = block_diag(np.zeros((6, 6)), body.stiffness) if free else body.stiffness
    mass = body.mass
    if free:
        mass = np.block([[body.rigid_mass, body.rigid_coupling], [body.rigid_coupling.T, mass]])
    bores = _nodes(body.positions(), body.bore_basis, free=free)
    points, boundary = _boundary(body, bores, free=free)
    constraint, inner = _split(boundary, stiffness)
    squares = np.zeros(0)
    change = constraint
    if inner.shape[1]:
        squares, shapes = eigh(inner.T @ stiffness @ inner, inner.T @ mass @ inner)
        change = np.hstack([constraint, inner @ shapes])
    count = boundary.shape[0]
    reduced = symmetric(change.T @ stiffness @ change)
    # Zero in exact arithmetic, by the definition of the constraint and the eigenmodes.
    reduced[:count, count:] = 0.0
    reduced[count:, :count] = 0.0
    squares = np.maximum(squares, 0.0)
    reduced[count:, count:] = np.diag(squares)
    return Superelement(
        stiffness=reduced,
        mass=symmetric(change.T @ mass @ change),
        grid_points=points,
        frequencies=np.sqrt(squares) / (2.0 * np.pi),
        bore_displacement=bores @ change,
    )


def _nodes(positions: np.ndarray, elastic: np.ndarray, *, free: bool) -> np.ndarray:
    """Displacements of points for unit coordinates of the body, shape (points, 3, coordinates)."""
    shapes = elastic.reshape(len(positions), 3, -1)
    if not free:
        return shapes
    return np.concatenate([rigid_fields(positions).reshape(-1, 3, 6), shapes], axis=2)


def _boundary(
    body: ReducedBody, bores: np.ndarray, *, free: bool
) -> tuple[tuple[GridPoint, ...], np.ndarray]:
    """Grid points, and their displacements B for unit coordinates of the body, (b, coordinates).

    Raises
    ------
    StructureError
        If the displacements of the bores are not independent in the body's coordinates.
    """
    points = []
    blocks = np.zeros((0, bores.shape[2]))
    for rows in body.each_bore():
        local = rows.surface.coordinates
        weights = mean_motion(local, np.ones(len(local)))
        points.append(GridPoint(rows.name, np.asarray(rows.surface.centre, dtype=float), 6))
        blocks = np.vstack([blocks, np.einsum("mck,mcj->kj", weights, bores[rows.nodes])])
    if not _independent(blocks):
        raise StructureError(
            f"the body has {blocks.shape[1]} coordinates, too few independent ones for the "
            f"{len(blocks)} displacements of its {len(body.bores)} bores: keep more modes"
        )
    for name, fields in body.points.items():
        block = _nodes(fields[None, :, 0], fields[None, :, 3:], free=free)[0]
        # The surface of a point may be a bore, whose motion is there already.
        if _independent(np.vstack([blocks, block])):
            points.append(GridPoint(name, fields[:, 0], 3))
            blocks = np.vstack([blocks, block])
    return tuple(points), blocks


def _independent(rows: np.ndarray) -> bool:
    """Whether rows are linearly independent."""
    if len(rows) > rows.shape[1]:
        return False
    values = np.linalg.svd(rows, compute_uv=False)
    return bool(values[-1] > INDEPENDENT * values[0])


def _split(boundary: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Constraint modes C, and a basis N of the motions that leave the boundary at rest."""
    displacements, values, coordinates = np.linalg.svd(boundary)
    count = len(boundary)
    particular = coordinates[:count].T @ (displacements / values).T
    inner = coordinates[count:].T
    squares, modes = np.linalg.eigh(symmetric(inner.T @ stiffness @ inner))
    elastic = squares > RIGID * squares.max(initial=0.0)
    flexibility = (modes[:, elastic] / squares[elastic]) @ modes[:, elastic].T
    return particular - inner @ (flexibility @ (inner.T @ (stiffness @ particular))), inner


# Files


def export_op4(body: ReducedBody, path: str | Path) -> Path:
    """Write the superelement of a body as a text file of OUTPUT4.

    The file has three matrices with 17 digits: ``KAA`` and ``MAA`` in the order of
    `Superelement.rows`, and ``UBORE``, the displacements of the bores' nodes for unit coordinates,
    with three rows for a node.

    Parameters
    ----------
    body
        Reduced body of M1, M2 or M3.
    path
        Path of the file, which is replaced.

    Raises
    ------
    StructureError
        See `superelement`.
    """
    element = superelement(body)
    displacement = element.bore_displacement
    matrices = (element.stiffness, element.mass, displacement.reshape(-1, displacement.shape[2]))
    # Form 6 is a symmetric matrix, form 2 a rectangular one.
    blocks = zip(OP4_NAMES, matrices, (6, 6, 2), strict=True)
    lines = [line for name, matrix, form in blocks for line in _op4_lines(name, matrix, form)]
    write_whole(Path(path), "\n".join(lines) + "\n")
    return Path(path)


def _op4_lines(name: str, matrix: np.ndarray, form: int) -> Iterator[str]:
    """Lines of a matrix in a text file of OUTPUT4, in double precision and with full columns."""
    rows, columns = matrix.shape
    yield f"{columns:8d}{rows:8d}{form:8d}{2:8d}{name:<8s}1P,{OP4_LINE}E23.16"
    for number, column in enumerate(_storable(matrix).T, start=1):
        filled = np.flatnonzero(column)
        if len(filled):
            values = column[filled[0] : filled[-1] + 1]
            yield f"{number:8d}{filled[0] + 1:8d}{2 * len(values):8d}"
            yield from _value_lines(values)
    yield f"{columns + 1:8d}{1:8d}{2:8d}"
    yield from _value_lines(np.ones(1))


def _storable(values: np.ndarray) -> np.ndarray:
    """Values with zeros in place of those below `SMALLEST`, which would overflow their fields."""
    return np.where(np.abs(values) < SMALLEST, 0.0, values)


def _value_lines(values: np.ndarray) -> Iterator[str]:
    """Lines of values in a text file of OUTPUT4."""
    for start in range(0, len(values), OP4_LINE):
        yield "".join(f"{value:23.16E}" for value in values[start : start + OP4_LINE])


def export_dmig(body: ReducedBody, path: str | Path) -> Path:
    """Write the superelement of a body as bulk data: GRID, SPOINT and DMIG cards.

    A deck includes the file and selects the matrices by ``K2GG = KAAX`` and ``M2GG = MAAX``. Values
    have 10 digits, as many as a field of a card.

    Parameters
    ----------
    body
        Reduced body of M1, M2 or M3.
    path
        Path of the file, which is replaced.

    Raises
    ------
    StructureError
        See `superelement`.
    """
    element = superelement(body)
    write_whole(Path(path), "\n".join(_dmig_lines(element)) + "\n")
    return Path(path)


def _dmig_lines(element: Superelement) -> Iterator[str]:
    """Lines of bulk data of a superelement."""
    yield f"{DMIG_HEAD}: N, m, kg; case control: K2GG = KAAX, M2GG = MAAX"
    for number, point in enumerate(element.grid_points, start=1):
        x, y, z = (_field(value) for value in _storable(point.position))
        yield f"$ {point.name}: components 1 to {point.components}"
        yield f"{'GRID*':<8s}{number:16d}{'':16s}{x}{y}"
        # A boundary point has no rotations: they are constrained on its card.
        held = "456" if point.components == 3 else ""
        yield f"{'*':<8s}{z}{'':16s}{held:>16s}"
    modes = len(element.frequencies)
    if modes:
        first = FIRST_MODE
        yield f"{'SPOINT':<8s}{first:8d}{'THRU':<8s}{first + modes - 1:8d}"
    rows = list(element.rows)
    matrices = [_storable(matrix) for matrix in (element.stiffness, element.mass)]
    for name, matrix in zip(DMIG_NAMES, matrices, strict=True):
        # Symmetric (6), real double precision (2).
        yield f"{'DMIG':<8s}{name:<8s}{0:8d}{6:8d}{2:8d}{0:8d}{'':16s}{len(rows):8d}"
        for column, (number, component) in enumerate(rows):
            filled = column + np.flatnonzero(matrix[column:, column])
            if len(filled):
                yield f"{'DMIG*':<8s}{name:<16s}{number:16d}{component:16d}"
            for row in filled:
                value = _field(matrix[row, column])
                yield f"{'*':<8s}{rows[row][0]:16d}{rows[row][1]:16d}{value}"


def _field(value: float) -> str:
    """Value in a field of 16 characters."""
    return f"{value:16.9E}"
