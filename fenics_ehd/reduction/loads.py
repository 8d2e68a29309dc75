"""Loads whose static responses make a basis, and the small products of those responses."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from fenics_ehd.reduction.distributed import (
    blocks,
    combine,
    inner,
    load_columns,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.linear_solver import ColumnStore
from fenics_ehd.reduction.projection import BoreFlexibility, bore_rows
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

    def combination(self, weights: np.ndarray) -> np.ndarray:
        """Owned rows of ``L @ weights``."""
        a = self.fields.shape[1]
        columns = combine(self.fields, weights[:a])
        if self.pressures.shape[1]:
            load = self.structure.load
            columns = columns + load_columns(load, self.pressures @ weights[a:])
        return np.asfortranarray(columns)

    def nodal_work(self, columns: np.ndarray) -> np.ndarray:
        """``J^T @ columns``, on every rank, shape (k, width)."""
        return transpose_multiply(self.structure.load, columns)

    def work(self, columns: np.ndarray, nodal: np.ndarray | None = None) -> np.ndarray:
        """``L^T @ columns`` on every rank, shape (count, width); `nodal` if known already."""
        by_fields = inner(self.fields, columns, self.structure.comm)
        if not self.pressures.shape[1]:
            return by_fields
        nodal = self.nodal_work(columns) if nodal is None else nodal
        return np.vstack([by_fields, self.pressures.T @ nodal])


class StaticResponses:
    """Static responses ``X = G L`` of (29), less what given modes cover (30).

    Parameters
    ----------
    solver
        Free or clamped part.
    loads
        L.
    angular, modes
        Modes to be filtered out, mass-normalised and uncoupled in stiffness.

    Attributes
    ----------
    stiffness
        ``X^T K X = L^T X``, shape (count, count).
    nodal_work
        ``J^T X``, shape (k, count).
    columns
        X.
    """

    def __init__(
        self, solver: StaticSolver, loads: LoadSet, angular: np.ndarray, modes: np.ndarray
    ):
        self.solver, self.loads = solver, loads
        covered = loads.work(modes).T / angular[:, None] ** 2
        stiffness, works = np.empty((loads.count,) * 2), [loads.nodal_work(modes[:, :0])]
        self.columns = ColumnStore(len(modes), loads.count, solver.structure.comm)
        for part in self.columns.parts:
            responses = solver.solve(loads.combination(np.eye(loads.count)[:, part]))
            responses -= combine(modes, covered[:, part])
            works.append(loads.nodal_work(responses))
            stiffness[:, part] = loads.work(responses, works[-1])
            self.columns.put(part, responses)
        self.stiffness, self.nodal_work = symmetric(stiffness), np.hstack(works)

    @cached_property
    def mass(self) -> np.ndarray:
        """``X^T M X``, shape (count, count), two blocks in memory at a time; collective."""
        mass = np.empty((self.loads.count,) * 2)
        for part, right in self.columns:
            inertia = self.solver.mass.multiply(right)
            for other in self.columns.parts:
                if other.start <= part.start:
                    left = self.columns.get(other)
                    product = inner(left, inertia, self.solver.structure.comm)
                    mass[other, part], mass[part, other] = product, product.T
        return symmetric(mass)

    def combination(self, weights: np.ndarray) -> np.ndarray:
        """Owned rows of ``X @ weights``, shape (owned dofs, r)."""
        rows = self.solver.structure.stiffness.local_size[0]
        result = np.zeros((rows, weights.shape[1]), order="F")
        for part, columns in self.columns:
            result += combine(columns, weights[part])
        return result


def bore_flexibility(solver: StaticSolver) -> BoreFlexibility:
    """Static response of all bores to every nodal pressure."""
    structure = solver.structure
    load, owned = structure.load, structure.stiffness.local_size[0]
    identity = np.eye(load.size[1])
    rows, work = [], []
    for part in blocks(len(identity), owned, structure.comm):
        responses = solver.solve(load_columns(load, identity[:, part]))
        rows.append(bore_rows(structure, responses))
        work.append(transpose_multiply(load, responses))
    return BoreFlexibility(np.concatenate(rows, axis=2), np.hstack(work))
