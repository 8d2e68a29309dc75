"""A part taken as rigid: its inertia and bore, no elastic coordinate."""

from __future__ import annotations

from typing import Unpack

import numpy as np

from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.projection import Basis
from fenics_ehd.reduction.reductor import Options, Reductor
from fenics_ehd.reduction.structure import Structure


def rigid(
    part: Structure | Reductor,
    *,
    estimate_error: bool = False,
    keep_basis: bool = False,
    **options: Unpack[Options],
) -> ReducedBody:
    """Body without elastic coordinates; nothing is factorised unless the error is asked for.

    Parameters
    ----------
    part
        The part, free or clamped, or a `Reductor` of it.
    estimate_error
        Also compute the bore flexibility that is left out, one static solve per
        pressure node.
    keep_basis
        Leave the basis of no columns in the body.
    options
        As in `load_dependent`.
    """
    reductor = Reductor.of(part, **options)
    nothing = np.zeros((0, 0))
    columns = np.zeros((reductor.structure.stiffness.local_size[0], 0))
    return reductor.project(
        Basis(columns, nothing, nothing, (), (), {}),
        "rigid",
        estimate_error=estimate_error,
        keep_basis=keep_basis,
    )
