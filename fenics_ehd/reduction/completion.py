"""What a basis misses of the static answer to loads, of the whole part.

    (G - T K_r^-1 T^T) f

added to the displacement ``T q`` makes a recovery of what the loads balance statically: the mode
acceleration method (T. Irvine, The mode acceleration method, 2014, scribd.com/document/659487661).
Of a free part f is made self-equilibrated first. The answer is right but for a rigid motion, which
is another one in another frame and has no stress.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.distributed import blocks, combine, inner
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.projection import on_bores
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure


def missing_answer(
    static: StaticSolver, body: ReducedBody, columns: np.ndarray, loads: np.ndarray
) -> np.ndarray:
    """Static answers less what the basis answers, owned rows (owned dofs, c); collective.

    Parameters
    ----------
    static
        Of the part.
    body
        Its reduction.
    columns
        The part-size basis T, owned rows, shape (owned dofs, n).
    loads
        Owned rows, shape (owned dofs, c) [N].
    """
    work = inner(columns, static.equilibrate(loads), static.structure.comm)
    return static.solve(loads) - combine(columns, np.linalg.solve(body.stiffness, work))


def centrifugal_load(structure: Structure, mass: MassOperator) -> np.ndarray:
    """``M (x, y, 0)``: inertia of unit rate about z, owned rows (owned dofs, 1)."""
    radius = structure.coordinates.copy()
    radius[:, 2] = 0.0
    return mass.multiply(np.asfortranarray(radius.reshape(-1, 1)))


def missing_fields(
    structure: Structure,
    body: ReducedBody,
    columns: np.ndarray,
    forces: np.ndarray,
    speeds: np.ndarray,
) -> np.ndarray:
    """What a basis misses of the answers to forces on bores and to turning, in whatever frame.

    Forces of boundary points are in every basis. The rigid inertia that balances them in M1's and
    M2's frame, and that of elastic motion, stay left out.

    Parameters
    ----------
    structure, body, columns
        As in `missing_answer`.
    forces
        On the nodes of all bores, shape (c, m, 3) [N].
    speeds
        Of the part about z, shape (c,) [rad/s].

    Returns
    -------
    numpy.ndarray
        Owned rows, shape (owned dofs, c) [m].
    """
    static, fields = StaticSolver(structure), np.empty((len(columns), len(speeds)))
    turning = centrifugal_load(structure, static.mass)
    for some in blocks(len(speeds), len(columns), structure.comm):
        loads = on_bores(structure, np.moveaxis(forces[some], 0, 2))
        loads += turning * speeds[some] ** 2
        fields[:, some] = missing_answer(static, body, columns, loads)
    return fields
