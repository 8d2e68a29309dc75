"""Loads whose static responses make a basis, and those responses without keeping them all.

A block of responses is as tall as the part. For a pressure at every bore node
they would be as large as everything else together, so only their small
products are kept: with ``G = G^T``, ``L^T G L`` and ``L^T G M G L`` follow from
bore rows, at the price of solving twice.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

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


#: Up to so many responses are kept instead of solving again.
KEPT_COLUMNS = 128


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
    """

    solver: StaticSolver
    loads: LoadSet
    angular: np.ndarray
    modes: np.ndarray
    covered: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray
    nodal_work: np.ndarray
    kept: np.ndarray | None

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
        comm, count, rows = solver.structure.comm, loads.count, len(modes)
        covered = loads.work(modes).T
        stiffness = np.empty((count, count))
        mass = np.empty((count, count) if with_mass else (0, 0))
        kept = np.empty((rows, count), order="F") if count <= KEPT_COLUMNS else None
        parts, works = blocks(count, rows, comm), [loads.nodal_work(modes[:, :0])]
        for part in parts:
            responses = solver.solve(loads.columns(part))
            responses -= combine(modes, covered[:, part] / angular[:, None] ** 2)
            nodal = loads.nodal_work(responses)
            works.append(nodal)
            stiffness[:, part] = loads.work(responses, nodal)
            if kept is not None:
                kept[:, part] = responses
            elif with_mass:
                inertia = solver.mass.multiply(responses)
                answer = solver.apply(inertia)
                answer -= combine(modes, inner(modes, inertia, comm) / angular[:, None] ** 2)
                mass[:, part] = loads.work(answer)
        if kept is not None and with_mass:
            for part in parts:
                mass[:, part] = inner(kept, solver.mass.multiply(kept[:, part]), comm)
        return StaticResponses(
            solver,
            loads,
            angular,
            modes,
            covered,
            symmetric(stiffness),
            symmetric(mass) if with_mass else mass,
            np.hstack(works),
            kept,
        )

    def combination(self, weights: np.ndarray) -> np.ndarray:
        """Owned rows of ``X @ weights``, shape (owned dofs, r): solved again unless still there."""
        if self.kept is not None:
            return combine(self.kept, weights)
        rows = len(self.modes)
        result = np.empty((rows, weights.shape[1]), order="F")
        for part in blocks(weights.shape[1], rows, self.solver.structure.comm):
            responses = self.solver.solve(self.loads.combination(weights[:, part]))
            covered = self.covered @ weights[:, part] / self.angular[:, None] ** 2
            responses -= combine(self.modes, covered)
            result[:, part] = responses
        return result


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
