"""A part taken as rigid: its inertia and bore, no elastic coordinate."""

from __future__ import annotations

import numpy as np

from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.load_dependent import bore_flexibility
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.projection import Basis, project
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure


def rigid(
    structure: Structure,
    *,
    estimate_error: bool = False,
    keep_basis: bool = False,
    options_prefix: str = "",
) -> ReducedBody:
    """Body without elastic coordinates; nothing is factorised unless the error is asked for.

    Parameters
    ----------
    structure
        The part, free.
    estimate_error
        Also compute the bore flexibility that is left out, one static solve per
        pressure node.
    keep_basis
        Leave the basis of no columns in the body.
    options_prefix
        Put before the prefix ``static_`` of the PETSc options.
    """
    flexibility = None
    if estimate_error:
        static = StaticSolver(structure, options_prefix=f"{options_prefix}static_")
        flexibility = bore_flexibility(static)
    nothing = np.zeros((0, 0))
    columns = np.zeros((structure.stiffness.local_size[0], 0))
    return project(
        structure,
        MassOperator(structure.mass),
        Basis(columns, nothing, nothing, (), (), {}),
        method="rigid",
        frame="mean-axis",
        full_flexibility=flexibility,
        keep_basis=keep_basis,
    )
