"""Model reduction of a structure with a lubricated bore: matrices in, reduced body out.

Needs petsc4py, slepc4py, mpi4py, numpy and h5py; dolfinx is not imported.
"""

from fenics_ehd.reduction.body import InertiaIntegrals, ReducedBody
from fenics_ehd.reduction.body_file import load_body, save_body
from fenics_ehd.reduction.load_dependent import LoadDependentBasis, load_dependent
from fenics_ehd.reduction.pressure_sets import PRESSURE_SETS
from fenics_ehd.reduction.residual_modes import SELECTIONS
from fenics_ehd.reduction.rigid import rigid
from fenics_ehd.reduction.structure import Bore, Recovery, Structure

__all__ = [
    "PRESSURE_SETS",
    "SELECTIONS",
    "Bore",
    "InertiaIntegrals",
    "LoadDependentBasis",
    "Recovery",
    "ReducedBody",
    "Structure",
    "load_body",
    "load_dependent",
    "rigid",
    "save_body",
]
