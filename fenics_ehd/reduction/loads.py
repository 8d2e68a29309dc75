"""Loads whose static responses make a basis, and the small products of those responses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fenics_ehd.reduction.column_store import ColumnStore
from fenics_ehd.reduction.distributed import (
    blocks,
    combine,
    inner,
    load_columns,
    node_rows,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure


class LoadSet:
    """Load columns L: given fields first, then pressure patterns of the bore (33).

    Parameters
    ----------
    structure
        The part.
    fields
        Loads given by their owned rows, shape (owned dofs, a) [N].
    pressures
        Patterns ``P_c``, the same on every rank, shape (k, p) [Pa]; None without a bore.
    """

    def __init__(self, structure: Structure, fields: np.ndarray, pressures: np.ndarray | None):
        self.structure = structure
        self.fields = fields
        self.pressures = np.zeros((0, 0)) if pressures is None else pressures
        self.count = fields.shape[1] + self.pressures.shape[1]

    def columns(self, part: slice) -> np.ndarray:
        """Owned rows of some of the columns, shape (owned dofs, width)."""
        return self.combination(np.eye(self.count)[:, part])

    def combination(self, weights: np.ndarray) -> np.ndarray:
        """Owned rows of ``L @ weights``."""
        a = self.fields.shape[1]
        columns = combine(self.fields, weights[:a])
        if self.pressures.shape[1]:
            load = self.structure.lubricated_bore.load
            columns = columns + load_columns(load, self.pressures @ weights[a:])
        return np.asfortranarray(columns)

    def nodal_work(self, columns: np.ndarray) -> np.ndarray:
        """``J^T @ columns``, on every rank, shape (k, width); no rows without a bore."""
        if self.structure.bore is None:
            return np.zeros((0, columns.shape[1]))
        return transpose_multiply(self.structure.bore.load, columns)

    def work(self, columns: np.ndarray, nodal: np.ndarray | None = None) -> np.ndarray:
        """``L^T @ columns`` on every rank, shape (count, width); `nodal` if known already."""
        by_fields = inner(self.fields, columns, self.structure.comm)
        if not self.pressures.shape[1]:
            return by_fields
        nodal = self.nodal_work(columns) if nodal is None else nodal
        return np.vstack([by_fields, self.pressures.T @ nodal])


def attachment_loads(structure: Structure, directions: tuple[int, ...]) -> np.ndarray:
    """Unit forces ``J_a`` at every boundary point along the given axes, owned rows."""
    vectors = [point[d].array for point in structure.attachments.values() for d in directions]
    return np.column_stack(vectors or [np.zeros((structure.stiffness.local_size[0], 0))])


@dataclass(frozen=True, eq=False)
class StaticResponses:
    """Static responses ``X = G L`` of (29), less what given modes cover (30).

    Attributes
    ----------
    stiffness
        ``X^T K X = L^T X``, shape (count, count).
    mass
        ``X^T M X``, same shape; empty when not asked for.
    nodal_work
        ``J^T X``, shape (k, count).
    columns
        X.
    """

    solver: StaticSolver
    loads: LoadSet
    stiffness: np.ndarray
    mass: np.ndarray
    nodal_work: np.ndarray
    columns: ColumnStore

    @staticmethod
    def of(
        solver: StaticSolver,
        loads: LoadSet,
        angular: np.ndarray,
        modes: np.ndarray,
        *,
        with_mass: bool = True,
    ) -> StaticResponses:
        """Solve for every load.

        Parameters
        ----------
        solver
            Free or clamped part.
        loads
            L.
        angular, modes
            Modes to be filtered out, mass-normalised and uncoupled in stiffness.
        with_mass
            Also compute ``X^T M X``.
        """
        comm, count = solver.structure.comm, loads.count
        covered = loads.work(modes).T / angular[:, None] ** 2
        stiffness, works = np.empty((count, count)), [loads.nodal_work(modes[:, :0])]
        columns = ColumnStore(len(modes), count, comm)
        for part in columns.parts:
            responses = solver.solve(loads.columns(part))
            responses -= combine(modes, covered[:, part])
            nodal = loads.nodal_work(responses)
            works.append(nodal)
            stiffness[:, part] = loads.work(responses, nodal)
            columns.put(part, responses)
        mass = mass_products(solver, columns) if with_mass else np.empty((0, 0))
        return StaticResponses(solver, loads, symmetric(stiffness), mass, np.hstack(works), columns)

    def combination(self, weights: np.ndarray) -> np.ndarray:
        """Owned rows of ``X @ weights``, shape (owned dofs, r)."""
        rows = self.solver.structure.stiffness.local_size[0]
        result = np.zeros((rows, weights.shape[1]), order="F")
        for part, columns in self.columns:
            result += combine(columns, weights[part])
        return result


def mass_products(solver: StaticSolver, columns: ColumnStore) -> np.ndarray:
    """``X^T M X`` on every rank, two blocks in memory at a time."""
    mass = np.empty((columns.count, columns.count))
    for part, right in columns:
        inertia = solver.mass.multiply(right)
        for other in columns.parts:
            if other.start <= part.start:
                product = inner(columns.get(other), inertia, solver.structure.comm)
                mass[other, part], mass[part, other] = product, product.T
    return symmetric(mass)


def bore_responses(
    solver: StaticSolver, pressures: np.ndarray
) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Bore rows of ``G J`` for blocks of pressure patterns.

    Yields
    ------
    part : slice
        Columns of `pressures`.
    rows : numpy.ndarray
        Displacement of the bore nodes, shape (m, 3, width).
    work : numpy.ndarray
        ``J^T G J`` times the patterns, shape (k, width).
    """
    structure = solver.structure
    bore = structure.lubricated_bore
    first = structure.stiffness.getOwnershipRange()[0] // 3
    rows = structure.stiffness.local_size[0]
    for part in blocks(pressures.shape[1], rows, structure.comm):
        responses = solver.solve(load_columns(bore.load, pressures[:, part]))
        yield (
            part,
            node_rows(responses, first, bore.nodes, structure.comm),
            transpose_multiply(bore.load, responses),
        )
