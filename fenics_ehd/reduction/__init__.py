"""Model reduction of a structure with a lubricated bore: matrices in, reduced body out.

Needs petsc4py, slepc4py, mpi4py, numpy, SciPy and h5py; dolfinx and Gmsh are not imported.
"""

import fenics_ehd.base.petsc_start  # noqa: F401
from fenics_ehd.reduction.body import (
    InertiaIntegrals,
    ModeRecord,
    ReducedBody,
    ResidualFlexibility,
    body_digest,
    export_npz,
    load_body,
    save_body,
)
from fenics_ehd.reduction.bore import Bore, bore_from_faces, bore_load_matrix, mean_motion
from fenics_ehd.reduction.craig_bampton import craig_bampton, two_step_craig_bampton
from fenics_ehd.reduction.foreign_matrices import (
    ForeignMatrices,
    read_abaqus,
    read_calculix,
    tetrahedron_mass,
)
from fenics_ehd.reduction.load_dependent import (
    PRESSURE_SETS,
    SELECTIONS,
    full_interface,
    load_dependent,
    proper_orthogonal,
)
from fenics_ehd.reduction.matrices import as_matrix, reorder
from fenics_ehd.reduction.part_files import (
    BasisFile,
    load_structure,
    save_basis,
    save_structure,
    von_mises,
)
from fenics_ehd.reduction.reductor import Reductor, rigid
from fenics_ehd.reduction.residual_flexibility import residual_flexibility
from fenics_ehd.reduction.structure import PointWeights, Recovery, Structure, check_structure

__all__ = [
    "PRESSURE_SETS",
    "SELECTIONS",
    "BasisFile",
    "Bore",
    "ForeignMatrices",
    "InertiaIntegrals",
    "ModeRecord",
    "PointWeights",
    "Recovery",
    "ReducedBody",
    "Reductor",
    "ResidualFlexibility",
    "Structure",
    "as_matrix",
    "body_digest",
    "bore_from_faces",
    "bore_load_matrix",
    "check_structure",
    "craig_bampton",
    "export_npz",
    "full_interface",
    "load_body",
    "load_dependent",
    "load_structure",
    "mean_motion",
    "proper_orthogonal",
    "read_abaqus",
    "read_calculix",
    "reorder",
    "residual_flexibility",
    "rigid",
    "save_basis",
    "save_body",
    "save_structure",
    "tetrahedron_mass",
    "two_step_craig_bampton",
    "von_mises",
]
