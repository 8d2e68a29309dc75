"""Model reduction of a structure with lubricated bores: from matrices to a reduced body.

The package needs petsc4py, slepc4py, mpi4py, numpy, SciPy and h5py; dolfinx and Gmsh are not
imported. The module of a public name is imported at the first use of the name.
"""

from fenics_ehd.base.lazy import lazily

#: Public names by the module that defines them.
NAMES = {
    "body": (
        "InertiaIntegrals",
        "ModeRecord",
        "ReducedBody",
        "ResidualFlexibility",
        "body_digest",
        "export_npz",
        "load_body",
        "save_body",
    ),
    "bore": (
        "Bore",
        "bore_from_faces",
        "bore_load_matrix",
        "mean_motion",
    ),
    "fixed_interface_modes": (
        "craig_bampton",
        "two_step_craig_bampton",
    ),
    "foreign_matrices": (
        "ForeignMatrices",
        "read_abaqus",
        "read_ansys",
        "read_calculix",
        "tetrahedron_mass",
    ),
    "load_dependent_basis": (
        "PRESSURE_SETS",
        "SELECTIONS",
        "full_interface",
        "load_dependent",
        "proper_orthogonal",
    ),
    "matrices": (
        "as_matrix",
        "reorder",
    ),
    "matrix_check": (
        "MatrixCheck",
        "check_matrices",
    ),
    "nastran_matrices": (
        "read_dmig",
        "read_op4",
        "read_op4_matrices",
    ),
    "part_files": (
        "BasisFile",
        "load_structure",
        "save_basis",
        "save_structure",
        "von_mises",
    ),
    "reductor": (
        "Reductor",
        "rigid",
    ),
    "residual_completion": ("residual_flexibility",),
    "structure": (
        "PointWeights",
        "Recovery",
        "Structure",
        "check_structure",
    ),
    "superelement": (
        "Superelement",
        "export_dmig",
        "export_op4",
        "superelement",
    ),
}

__all__ = [name for names in NAMES.values() for name in names]
__getattr__ = lazily(__name__, NAMES)
