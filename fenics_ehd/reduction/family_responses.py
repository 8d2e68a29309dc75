"""Static responses of a part to a pressure family, and the flexibility that they determine.

With the load matrix J of the bores and the static flexibility G of the part, the flexibility of the
bores is ``S = J^T G J``. S is symmetric and positive semidefinite. The flexibility that a basis
does not contain, S minus the flexibility of the basis, has the same properties. Responses to r
pressures Q of a `PressureFamily` have the displacement D of the bores' nodes and the work
``E = S Q`` on the nodal pressures. The formula of Nystroem gives S from Q and E by a decomposition
into eigenvalues w and one into singular values s:

    Q^T E = Z diag(w) Z^T,   C = Z w^(-1/2),   E C = V diag(s) W^T,   S = V s^2 V^T.

Eigenvalues w that are round-off are dropped, with their vectors. The columns of V are orthonormal
pressure patterns, s^2 is twice the strain energy for a unit amplitude of each pattern, and D C W s
are the displacements due to the patterns.

The result is exact for pressures of the family. A pressure outside of the family is projected onto
the family in the norm of energy. The result is therefore never more flexible than S. A projection
of nodal values by least squares has errors 10 to 30 times as large. If Q contains every nodal
pressure, the result is S itself.
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
        Nodal pressures Q on all bores, shape (k, r) [Pa].
    displacement
        Displacement of the nodes of all bores, shape (m, 3, r) [m].
    work
        Work of unit nodal pressures on the responses, ``J^T G J Q``, shape (k, r) [m^3].
    columns
        Part-size responses in blocks, rows of this rank, shapes (owned dofs, columns of the block)
        [m]; empty if they were not kept.
    """

    pressures: np.ndarray
    displacement: np.ndarray
    work: np.ndarray
    columns: tuple[np.ndarray, ...] = ()

    def some(self, columns: slice) -> Responses:
        """Select a range of the responses, without part-size columns."""
        return Responses(
            self.pressures[:, columns], self.displacement[..., columns], self.work[:, columns]
        )

    def joined(self, other: Responses) -> Responses:
        """Append other responses to these responses."""
        return Responses(
            np.hstack([self.pressures, other.pressures]),
            np.concatenate([self.displacement, other.displacement], axis=2),
            np.hstack([self.work, other.work]),
            (*self.columns, *other.columns),
        )


def respond(solver: StaticSolver, pressures: np.ndarray, kept: int = 0) -> Responses:
    """Compute static responses to nodal pressures on all bores; collective.

    Parameters
    ----------
    solver
        Static solver of the part.
    pressures
        Nodal pressures, the same on every rank, shape (k, r) [Pa].
    kept
        Number of responses whose part-size columns are kept: the first ones.
    """
    structure = solver.structure
    comm = structure.comm
    rows = structure.load.local_size[0]
    displacements = [np.zeros((len(structure.bore_nodes), 3, 0))]
    works = [np.zeros((structure.load.size[1], 0))]
    columns = room_for_columns(rows, kept, comm)
    count = pressures.shape[1]
    with solver.work.progress.stage("static solves", count) as stage:
        for part in blocks(count, rows, comm):
            responses = solver.solve(load_columns(structure.load, pressures[:, part]))
            displacements.append(bore_rows(structure, responses))
            works.append(transpose_multiply(structure.load, responses))
            last = min(part.stop, kept)
            columns[:, part.start : last] = responses[:, : max(last - part.start, 0)]
            stage.to(part.stop)
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
        Static solver of the part.
    family
        Pressure family of the part's bores.
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
        """Send the pressures of the first rank to all ranks, so that they are bitwise the same."""
        return np.asarray(self._solver.structure.comm.bcast(pressures))

    def up_to(self, level: int) -> Responses:
        """Responses to all pressures of the family up to a level; collective."""
        while len(self._levels) <= level:
            former = self._levels[-1]
            added = self._columns(len(self._levels), former.pressures)
            kept = added.shape[1] if self.keeps_columns else 0
            self._levels.append(former.joined(respond(self._solver, added, kept)))
        return self._levels[level]


class FlexibilityForm(NamedTuple):
    """Flexibility ``V s^2 V^T`` from responses to r pressures, see the equations of this module.

    Attributes
    ----------
    patterns
        Orthonormal pressure patterns V, shape (k, n).
    stiffness
        Twice the strain energy for a unit amplitude of each pattern, ``s^2``, shape (n,).
    combinations
        Weights ``C W s`` of the r responses whose combinations are the responses to the n patterns,
        shape (r, n).
    """

    patterns: np.ndarray
    stiffness: np.ndarray
    combinations: np.ndarray


def flexibility_form(pressures: np.ndarray, work: np.ndarray, energy: float) -> FlexibilityForm:
    """Compute a flexibility in the form ``V s^2 V^T`` from the work of responses.

    Parameters
    ----------
    pressures
        Orthonormal pressures Q, shape (k, r) [Pa].
    work
        Work E of unit nodal pressures on the responses, shape (k, r) [m^3].
    energy
        Largest energy of a pressure with the complete flexibility. The energy below which a
        combination of pressures counts as round-off is relative to this energy.
    """
    values, vectors = falling_eigenpairs(symmetric(pressures.T @ work))
    least = max(SMALLEST_ENERGY * values.max(initial=0.0), ROUND_OFF * len(pressures) * energy)
    kept = values > least
    scaled = vectors[:, kept] / np.sqrt(values[kept])
    patterns, sizes, turn = np.linalg.svd(work @ scaled, full_matrices=False)
    return FlexibilityForm(patterns, sizes**2, scaled @ (turn.T * sizes))


def largest_energy(responses: Responses) -> float:
    """Largest work that any of the pressures does on the displacement it causes [J/Pa^2]."""
    work = np.einsum("kr,kr->r", responses.pressures, responses.work)
    return float(work.max(initial=0.0))


def missing_flexibility(responses: Responses, body: ReducedBody) -> np.ndarray:
    """Outward bore displacement per nodal pressure, exact minus reduced, (m, k) [m/Pa].

    The result is exact for the pressures of `responses`. For other pressures, its strain energy is
    at most the exact energy.
    """
    displacement, work = body.pressure_responses(responses.pressures)
    form = flexibility_form(responses.pressures, responses.work - work, largest_energy(responses))
    missing = body.outward(responses.displacement - displacement)
    return np.asarray(missing @ form.combinations @ form.patterns.T)


def largest_error(responses: Responses, body: ReducedBody) -> float:
    """Largest relative error of a body's outward bore displacement under several pressures."""
    displacement, _ = body.pressure_responses(responses.pressures)
    return relative_error(
        all_outward(body.bores, responses.displacement - displacement),
        all_outward(body.bores, responses.displacement),
    )


def relative_error(errors: np.ndarray, displacements: np.ndarray) -> float:
    """Largest relative error of c displacements of m nodes.

    The relative error of a displacement is its largest error at any node, divided by its largest
    magnitude at any node.
    Both arguments have the shape (m, c).
    """
    sizes = np.abs(displacements).max(axis=0, initial=np.finfo(float).tiny)
    return float((np.abs(errors).max(axis=0, initial=0.0) / sizes).max(initial=0.0))
