"""Responses with boundary points held, (18) and (19).

A, the boundary points, and C2, the bore's centre, are means over surfaces:
holding them is ``C^T x = 0``. With G the elastic flexibility of (29) and U the
rigid-body modes, the response to f is ``G (f - C mu) + U alpha`` where

    C^T G C mu - C^T U alpha = C^T G f,       U^T C mu = U^T f,

so the factorisation of the free part serves, corrected by a few columns.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from fenics_ehd.base.errors import VerificationError
from fenics_ehd.reduction.distributed import combine, inner
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.static import held_solver
from fenics_ehd.reduction.structure import Structure

#: Smallest reciprocal condition number at which constraints count as independent.
INDEPENDENT = 1e-12


class Flexibility(Protocol):
    """What holds a part and answers loads: `StaticSolver` and the classes built on one."""

    structure: Structure
    mass: MassOperator
    #: Motions left free, mass-orthonormal, owned rows (owned dofs, u).
    rigid_modes: np.ndarray

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """Static response, owned rows (owned dofs, k)."""

    def admissible(self, columns: np.ndarray) -> np.ndarray:
        """Columns less what the support forbids."""

    def without_reactions(self, forces: np.ndarray) -> np.ndarray:
        """Forces less what the support takes up."""


class FixedBoundary:
    """Flexibility of a part with ``C^T x = 0``.

    Parameters
    ----------
    support
        Flexibility of the part without these constraints.
    constraints
        C, owned rows, shape (owned dofs, c), c >= 1.

    Raises
    ------
    VerificationError
        The constraints do not hold every rigid motion, or depend on each other.
    """

    def __init__(self, support: Flexibility, constraints: np.ndarray):
        self.structure, self.mass = support.structure, support.mass
        self.rigid_modes = support.rigid_modes[:, :0]
        self._support = support
        comm = self.structure.comm
        rigid = support.rigid_modes
        self._constraints = constraints
        self._responses = support.apply(constraints)
        flexibility = inner(constraints, self._responses, comm)
        self._lever = inner(constraints, rigid, comm)
        # Flexibilities are 1e-9 and lever arms 1: without a scale the system looks singular.
        sizes = np.sqrt(np.abs(np.diag(flexibility)))
        self._sizes = np.where(sizes > 0, sizes, 1.0)
        lever = self._lever / self._sizes[:, None]
        self._motion = 1.0 / max(np.abs(lever).max(initial=0.0), 1e-300)
        lever = lever * self._motion
        n = rigid.shape[1]
        self._matrix = np.block(
            [
                [flexibility / np.outer(self._sizes, self._sizes), -lever],
                [lever.T, np.zeros((n, n))],
            ]
        )
        singular = np.linalg.svd(self._matrix, compute_uv=False)
        if not singular[-1] > INDEPENDENT * singular[0]:
            raise VerificationError(
                f"the {constraints.shape[1]} boundary constraints depend on each other or leave a "
                f"rigid motion free (reciprocal condition {singular[-1] / singular[0]:.1e}, limit "
                f"{INDEPENDENT:.0e}): is a boundary point named twice?"
            )

    def _hold(self, prescribed: np.ndarray, balance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reactions mu and rigid motion alpha for the right sides of the system above."""
        right = np.vstack([prescribed / self._sizes[:, None], balance * self._motion])
        solution = np.linalg.solve(self._matrix, right)
        c = len(self._sizes)
        return solution[:c] / self._sizes[:, None], solution[c:] * self._motion

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """Static response with the boundary held, owned rows (owned dofs, k)."""
        comm = self.structure.comm
        rigid = self._support.rigid_modes
        response = self._support.apply(loads)
        reactions, motion = self._hold(
            inner(self._constraints, response, comm), inner(rigid, loads, comm)
        )
        response -= combine(self._responses, reactions)
        if rigid.shape[1]:
            response += combine(rigid, motion)
        return response

    def constraint_modes(self, prescribed: np.ndarray) -> np.ndarray:
        """Static modes of (19): ``C^T x`` as given, no load but the reactions.

        Parameters
        ----------
        prescribed
            Values of ``C^T x``, shape (c, k).
        """
        rigid = self._support.rigid_modes
        reactions, motion = self._hold(-prescribed, np.zeros((rigid.shape[1], prescribed.shape[1])))
        return combine(rigid, motion) - combine(self._responses, reactions)

    def _projection(self, left: np.ndarray, right: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Columns less a combination of `right` that makes them orthogonal to `left`."""
        comm = self.structure.comm
        share = np.linalg.solve(inner(left, right, comm), inner(left, columns, comm))
        return columns - combine(right, share)

    def admissible(self, columns: np.ndarray) -> np.ndarray:
        """Columns less the motion of the boundary, taken out by forces there."""
        columns = self._support.admissible(columns) if not len(self._lever.T) else columns
        return self._projection(self._constraints, self._constraints, columns)

    def without_reactions(self, forces: np.ndarray) -> np.ndarray:
        """Forces less the reactions of the boundary (least squares)."""
        if not len(self._lever.T):
            forces = self._support.without_reactions(forces)
        return self._projection(self._constraints, self._constraints, forces)


class InteriorSolver:
    """Flexibility of a part with every dof of given nodes held: ``K_ii`` of (21).

    Parameters
    ----------
    structure
        The part.
    mass
        Products with M.
    nodes
        Global numbers of the held nodes, the same on every rank.
    solver, options_prefix
        As in `StaticSolver`.
    """

    def __init__(
        self,
        structure: Structure,
        mass: MassOperator,
        nodes: np.ndarray,
        *,
        solver: str = "auto",
        options_prefix: str = "interior_",
    ):
        self.structure, self.mass = structure, mass
        self.rigid_modes = np.zeros((structure.stiffness.local_size[0], 0))
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        first, last = structure.stiffness.getOwnershipRange()
        held = dofs[(dofs >= first) & (dofs < last)]
        self._held = held - first
        self._linear = held_solver(structure, held, solver, options_prefix, kernel=False)

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """Static response with the nodes held, owned rows (owned dofs, k)."""
        return self._linear.solve(self.admissible(loads))

    def admissible(self, columns: np.ndarray) -> np.ndarray:
        """Columns with zeros at the held nodes."""
        columns = columns.copy(order="F")
        columns[self._held] = 0.0
        return columns

    #: Forces but those on the held nodes.
    without_reactions = admissible
