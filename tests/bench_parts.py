"""What tests take of parts, their matrices and their reduction below the public names."""

# ruff: noqa: F401

from fenics_ehd.fem import drawing as drawing_module
from fenics_ehd.fem import stress, structure
from fenics_ehd.fem.drawing import TRIED_SIZES, CellSizes, read_drawing
from fenics_ehd.fem.drawing_unit import unit_ratio
from fenics_ehd.fem.drawn_part import NamedFaces, open_part, place_part, write_part
from fenics_ehd.fem.elements import FAMILIES, quadratic_element
from fenics_ehd.fem.faces import fit_cylinder
from fenics_ehd.fem.foreign_mesh import ForeignMesh
from fenics_ehd.fem.gmsh_session import gmsh, session
from fenics_ehd.fem.models import store_mesh_error, stored_mesh_error
from fenics_ehd.fem.solid import (
    GMSH_HEX,
    GMSH_TET,
    Solid,
    corner_volumes,
    inside_out,
    raised,
    refined,
    second_order,
)
from fenics_ehd.fem.solid_file import read_deck, read_mesh, read_part
from fenics_ehd.fem.stress import NodalStress, StressField, largest_half_range, largest_principal
from fenics_ehd.fem.structure import _elastic_matrices, _place_centre_nodes, part_answers
from fenics_ehd.reduction import PRESSURE_SETS as PRESSURE_SETS_REDUCTION
from fenics_ehd.reduction import SELECTIONS, eigenmodes, matrices, reductor, static
from fenics_ehd.reduction.body import (
    InertiaIntegrals,
    ResidualFlexibility,
    body_digest,
    contents,
    export_npz,
)
from fenics_ehd.reduction.bore import (
    BoreSurface,
    _unrolled,
    bore_holes,
    bore_load_matrix,
    mean_motion,
    no_cells,
    outward,
    rigid_fields,
    surface_gram,
)
from fenics_ehd.reduction.eigenmodes import lowest_modes
from fenics_ehd.reduction.elements import ELEMENTS, SOLIDS, package_order
from fenics_ehd.reduction.fixed_interface_modes import centre_constraints, two_step_craig_bampton
from fenics_ehd.reduction.foreign_matrices import tetrahedron_mass
from fenics_ehd.reduction.load_dependent_basis import PRESSURE_SETS as PRESSURE_SETS_LOAD_DEPENDENT
from fenics_ehd.reduction.load_dependent_basis import (
    _columns,
    _hats,
    bearing_shapes,
    energy_orthonormal,
    pressure_patterns,
    proper_orthogonal,
    unit_pressures,
    without_redundancy,
)
from fenics_ehd.reduction.matrices import (
    MassOperator,
    as_matrix,
    inner,
    load_columns,
    multiply,
    reorder,
)
from fenics_ehd.reduction.mesh_error import (
    PATTERNS,
    SMOOTH,
    compliance_errors,
    excess,
    smooth_answers,
    smooth_fields,
)
from fenics_ehd.reduction.part_files import (
    BasisFile,
    load_structure,
    save_basis,
    save_structure,
    von_mises,
)
from fenics_ehd.reduction.reductor import Basis, bore_rows, gram_matrices, rigid
from fenics_ehd.reduction.residual_completion import basis_of, missing_fields, pattern_fields
from fenics_ehd.reduction.static import LinearSolver, StaticSolver, rigid_body_modes
from fenics_ehd.reduction.structure import PointWeights, check_structure
