"""Static responses of a part to a pressure family, and the flexibility that they determine.

The flexibility ``S = J^T G J`` of the bores, or the part of it that a basis lacks, is symmetric and
positive semidefinite. Responses to r pressures Q of a `PressureFamily` give the displacement D of
the bores' nodes and the work ``E = S Q`` on the nodal pressures. The flexibility follows from them
by the formula of Nystroem:

    c = Q^T E = Z diag(w) Z^T,   C = Z w^(-1/2)   (w above round-off),   Y = E C = V s W^T,
    patterns V^T,   energies s^2,   displacements of the patterns D C W s.

It is exact for pressures of the family. A pressure outside of the family is projected onto it in
energy: error and result have no mutual energy, and the result is never more flexible than S. The
projection of nodal values in the mean-square sense has errors 10 to 30 times as large. If Q
contains every nodal pressure, the result is S itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.bore import all_outward
from fenics_ehd.reduction.matrices import (
    blocks,
    falling_eigenpairs,
    load_columns,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.pressure_family import PressureFamily
from fenics_ehd.reduction.static import StaticSolver, bore_rows, room_for_columns

#: Energy of a combination of pressures, relative to the largest of the missing flexibility and of
#: the complete one, below which it is round-off.
SMALLEST_ENERGY = 1e-12
ROUND_OFF = 1e-14


class Responses(NamedTuple):
    """Static responses ``G J Q`` of the whole part to r pressures.

    Attributes
    ----------
    pressures
        Q, shape (k, r) [Pa].
    displacement
        Displacement of the nodes of all bores, shape (m, 3, r) [m].
    work
        ``J^T G J Q``, shape (k, r) [m^3].
    columns
        Blocks of the responses, owned rows, shapes (owned dofs, columns of the block) [m]; none if
        they were not kept.
    """

    pressures: np.ndarray
    displacement: np.ndarray
    work: np.ndarray
    columns: tuple[np.ndarray, ...] = ()

    def some(self, columns: slice) -> Responses:
        """A range of the responses without their part-size columns."""
        return Responses(
            self.pressures[:, columns], self.displacement[..., columns], self.work[:, columns]
        )

    def joined(self, other: Responses) -> Responses:
        """These responses followed by other ones."""
        return Responses(
            np.hstack([self.pressures, other.pressures]),
            np.concatenate([self.displacement, other.displacement], axis=2),
            np.hstack([self.work, other.work]),
            (*self.columns, *other.columns),
        )


def respond(solver: StaticSolver, pressures: np.ndarray, kept: int = 0) -> Responses:
    """Static responses to pressures on all bores; collective.

    Parameters
    ----------
    solver
        Static responses of the part.
    pressures
        Nodal pressures, the same on every rank, shape (k, r) [Pa].
    kept
        Number of responses, from the first one, whose part-size columns are kept.
    """
    structure = solver.structure
    comm = structure.comm
    rows = structure.load.local_size[0]
    displacements = [np.zeros((len(structure.bore_nodes), 3, 0))]
    works = [np.zeros((structure.load.size[1], 0))]
    columns = room_for_columns(rows, kept, comm)
    for part in blocks(pressures.shape[1], rows, comm):
        responses = solver.solve(load_columns(structure.load, pressures[:, part]))
        displacements.append(bore_rows(structure, responses))
        works.append(transpose_multiply(structure.load, responses))
        last = min(part.stop, kept)
        columns[:, part.start : last] = responses[:, : max(last - part.start, 0)]
    return Responses(
        pressures,
        np.concatenate(displacements, axis=2),
        np.hstack(works),
        (columns,) if kept else (),
    )


class FamilyResponses:
    """Responses of a part to a pressure family, level by level, and to verification pressures.

    Parameters
    ----------
    solver
        Static responses of the part.
    family
        The pressure family.
    keep_columns
        Whether part-size responses are kept.

    Attributes
    ----------
    verification
        Responses to the pressures of `PressureFamily.verification`, which are solved for together
        with the base family.
    """

    def __init__(self, solver: StaticSolver, family: PressureFamily, *, keep_columns: bool = False):
        self._solver = solver
        self.family = family
        self.keeps_columns = keep_columns
        base = self._columns(0, np.zeros((solver.structure.pressures, 0)))
        count = base.shape[1]
        together = np.hstack([base, self._shared(family.verification())])
        every = respond(solver, together, count if keep_columns else 0)
        self.verification = every.some(slice(count, None))
        self._levels = [every.some(slice(count))._replace(columns=every.columns)]

    def _columns(self, level: int, known: np.ndarray) -> np.ndarray:
        return self._shared(self.family.columns(level, known))

    def _shared(self, pressures: np.ndarray) -> np.ndarray:
        """Pressures of the first rank, so that all ranks have the same to the last digit."""
        return np.asarray(self._solver.structure.comm.bcast(pressures))

    def up_to(self, level: int) -> Responses:
        """Responses to all pressures up to a level; collective."""
        while len(self._levels) <= level:
            former = self._levels[-1]
            added = self._columns(len(self._levels), former.pressures)
            kept = added.shape[1] if self.keeps_columns else 0
            self._levels.append(former.joined(respond(self._solver, added, kept)))
        return self._levels[level]


class FlexibilityForm(NamedTuple):
    """Flexibility from responses to r pressures, see the equations of this module.

    Attributes
    ----------
    patterns
        Orthonormal pressure patterns V, shape (k, n).
    stiffness
        Twice the energies of the patterns ``s^2``, shape (n,).
    combinations
        ``C W s``: the patterns' responses as combinations of the r responses, shape (r, n).
    """

    patterns: np.ndarray
    stiffness: np.ndarray
    combinations: np.ndarray


def flexibility_form(pressures: np.ndarray, work: np.ndarray, energy: float) -> FlexibilityForm:
    """Form of a flexibility by its work on the nodal pressures.

    Parameters
    ----------
    pressures
        Orthonormal pressures Q, shape (k, r) [Pa].
    work
        E, shape (k, r) [m^3].
    energy
        Largest energy of the complete flexibility, of which round-off is a share.
    """
    values, vectors = falling_eigenpairs(symmetric(pressures.T @ work))
    least = max(SMALLEST_ENERGY * values.max(initial=0.0), ROUND_OFF * len(pressures) * energy)
    kept = values > least
    scaled = vectors[:, kept] / np.sqrt(values[kept])
    patterns, sizes, turn = np.linalg.svd(work @ scaled, full_matrices=False)
    return FlexibilityForm(patterns, sizes**2, scaled @ (turn.T * sizes))


def largest_energy(responses: Responses) -> float:
    """Largest work of one of the pressures on its own displacement [J/Pa^2]."""
    work = np.einsum("kr,kr->r", responses.pressures, responses.work)
    return float(work.max(initial=0.0))


def missing_flexibility(responses: Responses, body: ReducedBody) -> np.ndarray:
    """Outward bore displacement per nodal pressure that a body lacks, shape (m, k) [m/Pa].

    It is exact for the pressures of the responses, and never too large in energy for others.
    """
    displacement, work = body.pressure_responses(responses.pressures)
    form = flexibility_form(responses.pressures, responses.work - work, largest_energy(responses))
    missing = body.outward(responses.displacement - displacement)
    return np.asarray(missing @ form.combinations @ form.patterns.T)


def largest_error(responses: Responses, body: ReducedBody) -> float:
    """Largest error of a body's outward bore displacement under pressures, relative to it."""
    displacement, _ = body.pressure_responses(responses.pressures)
    return relative_error(
        all_outward(body.bores, responses.displacement - displacement),
        all_outward(body.bores, responses.displacement),
    )


def relative_error(errors: np.ndarray, displacements: np.ndarray) -> float:
    """Largest error of any column, shape (m, c), over the largest displacement of the column."""
    sizes = np.abs(displacements).max(axis=0, initial=np.finfo(float).tiny)
    return float((np.abs(errors).max(axis=0, initial=0.0) / sizes).max(initial=0.0))
