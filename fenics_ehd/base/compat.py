"""Functions that hide differences between dolfinx versions, which are detected by feature.

Names are those of the newest version. No other module distinguishes versions.

Imports inside functions: dolfinx.io.gmsh imports Gmsh, which replaces Python's handler of Ctrl-C.
Runs that need no mesh therefore must not import dolfinx.io.gmsh. The submodule dolfinx.fem.petsc is
imported explicitly, because ``import dolfinx`` does not import it in version 0.11.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import partial, wraps
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import basix
import dolfinx
import ffcx
import ffcx.codegeneration.jit as ffcx_jit
import numpy as np
import ufl
from dolfinx import cpp, fem, jit, mesh
from mpi4py import MPI

from fenics_ehd.base.compile_lock import LIMIT, compiling, forms_folder, is_compiled
from fenics_ehd.base.compiler import compiler_errors, quiet_compiler
from fenics_ehd.base.dolfinx_version import require_version
from fenics_ehd.base.processes import in_neutral_folder

require_version(dolfinx)

try:
    import basix.ufl as _basix_ufl
except ImportError:
    _basix_ufl = None
    from basix.ufl_wrapper import BasixElement as _BasixElement


#: Placeholders in annotations for classes whose names are private or differ between versions.
Element: TypeAlias = Any
MeshTags: TypeAlias = Any


def model_to_mesh(
    model: Any, comm: MPI.Comm, rank: int = 0
) -> tuple[mesh.Mesh, MeshTags, MeshTags]:
    """Convert the current Gmsh model of one rank to a mesh, its cell tags and its facet tags."""
    try:
        from dolfinx.io import gmsh as gmshio
    except ImportError:
        from dolfinx.io import gmshio
    return tuple(gmshio.model_to_mesh(model, comm, rank, gdim=3))[:3]


def _cell(name: str, dimension: int = 3) -> ufl.Cell:
    """Make a UFL cell that has a geometric dimension, because elements of the old UFL need one."""
    return ufl.Cell(name, geometric_dimension=dimension)


def lagrange_element(
    cell: str, degree: int, shape: tuple[int, ...] = (), *, dimension: int = 3
) -> Element:
    """Lagrange element on cells in space or in the plane; with `shape` (3,), a vector element."""
    if _basix_ufl is not None:
        return _basix_ufl.element("Lagrange", cell, degree, shape=shape)
    if shape:
        return ufl.VectorElement("Lagrange", _cell(cell, dimension), degree, dim=shape[0])
    return ufl.FiniteElement("Lagrange", _cell(cell, dimension), degree)


def custom_element(
    cell: str,
    wcoeffs: np.ndarray,
    x: Sequence[Sequence[np.ndarray]],
    interpolation: Sequence[Sequence[np.ndarray]],
    degree: int,
    superdegree: int,
    shape: tuple[int, ...] = (),
) -> Element:
    """Make an element from its polynomials and point evaluations, as basix does.

    With `shape` (3,) it is a vector element. For the other parameters see
    ``basix.create_custom_element``.
    """
    cell_type = getattr(basix.CellType, cell)
    if _basix_ufl is not None:
        scalar = _basix_ufl.custom_element(
            cell_type,
            (),
            wcoeffs,
            x,
            interpolation,
            0,
            basix.MapType.identity,
            basix.SobolevSpace.H1,
            False,
            degree,
            superdegree,
        )
        return _basix_ufl.blocked_element(scalar, shape=shape) if shape else scalar
    scalar = _BasixElement(
        basix.create_custom_element(
            cell_type,
            [],
            wcoeffs,
            x,
            interpolation,
            0,
            basix.MapType.identity,
            False,
            degree,
            superdegree,
        )
    )
    scalar._cell = _cell(cell)
    return ufl.VectorElement(scalar, dim=shape[0]) if shape else scalar


def functionspace(domain: mesh.Mesh, element: Element) -> fem.FunctionSpace:
    """Make the function space of an element on a mesh."""
    return getattr(fem, "functionspace", fem.FunctionSpace)(domain, element)


def _cell_rows(dofmap: Any, domain: mesh.Mesh) -> np.ndarray:
    """Array of a dofmap with one row for each local cell, ghosts included."""
    cells = domain.topology.index_map(domain.topology.dim)
    raw = np.asarray(getattr(dofmap, "array", dofmap))
    return raw.reshape(cells.size_local + cells.num_ghosts, -1)


def geometry_dofmap(domain: mesh.Mesh) -> np.ndarray:
    """Indices of the geometry nodes of every local cell, shape (cells, nodes per cell)."""
    geometry = domain.geometry
    dofmap = geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap
    return _cell_rows(dofmap, domain)


def space_dofmap(space: fem.FunctionSpace) -> np.ndarray:
    """Dofs of every local cell of a space, shape (cells, dofs); a vector counts as one dof."""
    return _cell_rows(space.dofmap.list, space.mesh)


def evaluated(expression: fem.Expression, domain: mesh.Mesh, cells: np.ndarray) -> np.ndarray:
    """Evaluate a dolfinx expression at its points in the given cells."""
    return expression.eval(*(() if _OLD else (domain,)), cells)


def fem_petsc() -> ModuleType:
    """Module `dolfinx.fem.petsc`."""
    import dolfinx.fem.petsc as module

    return module


_OLD = _basix_ufl is None

#: Name of the options of a compilation in this version of FFCx and dolfinx.
_OPTIONS = "parameters" if _OLD else "options"

_FORM_OPTIONS: Any = getattr(ffcx, _OPTIONS)


def _no_options() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return empty options of FFCx instead of options from files in the home or current folder."""
    return {}, {}


# Option files in the home or current folder could change results, or name compilers and plugins.
for _module in (jit, _FORM_OPTIONS):
    setattr(_module, f"_load_{_OPTIONS}", _no_options)

#: Folder with the compiled forms, elements and expressions of this package only.
FORMS = forms_folder()

_DEFAULTS: dict[str, Any] = getattr(jit, f"DOLFINX_DEFAULT_JIT_{_OPTIONS.upper()}")
_DEFAULTS["cache_dir"] = (FORMS, "folder of compiled forms")
_DEFAULTS["timeout"] = (LIMIT, "seconds that a process waits for another one that compiles")

_JIT = getattr(jit, f"get_{_OPTIONS}")(
    {"cffi_extra_compile_args": ["-O3", "-fno-math-errno", "-g0"]}
)


class _NotCompiledError(Exception):
    """A module of forms is not compiled yet."""


def _load_or_begin(
    begin: Callable[..., Any], name: str, objects: Sequence[str], folder: Path, timeout: int
) -> Any:
    """Load a compiled module. If it is not compiled and `timeout` is not 0, begin to compile it.

    Parameters
    ----------
    begin
        Function ``get_cached_module`` of FFCx: it loads a compiled module, or writes the first file
        of a module that is not compiled.
    name, objects, folder
        Arguments of `begin`: name of the module, names of its objects, and folder of the files.
    timeout
        Seconds to wait for another process that compiles the module.

    Raises
    ------
    _NotCompiledError
        If the module is not compiled and `timeout` is 0.
    """
    if not (timeout or is_compiled(Path(folder, f"{name}.c"))):
        raise _NotCompiledError
    return begin(name, objects, folder, timeout or 1)


def _one_at_a_time(compile_objects: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a compiling function of FFCx: lock the folder of its files, and suppress its output.

    Modules that are compiled already are loaded without a lock.
    """

    @wraps(compile_objects)
    def compiled(*arguments: Any, **options: Any) -> Any:
        try:
            return compile_objects(*arguments, **options | {"timeout": 0})
        except _NotCompiledError:
            pass
        folder = Path(options["cache_dir"]).absolute()
        limit = options.get("timeout", LIMIT)
        with (
            compiling(folder, limit=limit),
            in_neutral_folder(),
            quiet_compiler(),
            compiler_errors(folder),
        ):
            return compile_objects(*arguments, **options | {"cache_dir": folder})

    return compiled


ffcx_jit.get_cached_module = partial(_load_or_begin, ffcx_jit.get_cached_module)
for _name in [name for name in vars(ffcx_jit) if name.startswith("compile_")]:
    setattr(ffcx_jit, _name, _one_at_a_time(getattr(ffcx_jit, _name)))

_INTEGRAL_TYPE: Any = getattr(fem, "IntegralType", getattr(cpp.fem, "IntegralType", None))


def plane(element: Element) -> Element:
    """Give an element the geometric dimension 2, which the old UFL needs, and return it."""
    if _OLD and hasattr(element, "_cell"):
        element._cell = _cell("quadrilateral", 2)
    return element


def quadrature_element(degree: int) -> Element:
    """Element on plane quadrilaterals with values at the Gauss points of a quadrature degree."""
    if _OLD:
        cell = _cell("quadrilateral", 2)
        return ufl.FiniteElement("Quadrature", cell, degree, quad_scheme="default")
    return _basix_ufl.quadrature_element("quadrilateral", scheme="default", degree=degree)


def plane_domain() -> ufl.Mesh:
    """UFL domain of quadrilaterals in the plane, for forms that are independent of a mesh."""
    return ufl.Mesh(lagrange_element("quadrilateral", 1, (2,), dimension=2))


def plane_mesh(cells: np.ndarray, x: np.ndarray) -> mesh.Mesh:
    """Make a mesh of quadrilaterals in the plane, on this process only.

    Parameters
    ----------
    cells
        Indices of the corners of every cell in dolfinx order, shape (cells, 4).
    x
        Positions of the points, shape (n, 2).
    """
    domain = plane_domain()
    points_last = list(inspect.signature(mesh.create_mesh).parameters)[3] == "x"
    return mesh.create_mesh(MPI.COMM_SELF, cells, *((domain, x) if points_last else (x, domain)))


class Coefficient(ufl.Coefficient):
    """UFL coefficient of a form that is independent of a mesh.

    The old FFCx uses ``str(coefficient)`` as the name of a variable in C.
    """

    def __str__(self) -> str:
        return f"w_{self.count()}"


def numbered_space(space: fem.FunctionSpace, numbers: np.ndarray, size: int) -> fem.FunctionSpace:
    """Copy a function space with new numbers of its degrees of freedom.

    Nodes with the same number become one degree of freedom. Periodic spaces are made in this way.

    Parameters
    ----------
    space
        Function space to be copied.
    numbers
        New number of every degree of freedom of every cell, shape (cells, dofs per cell).
    size
        Number of degrees of freedom of the new space.
    """
    dofmap = cpp.fem.DofMap(
        space.dofmap.dof_layout,
        cpp.common.IndexMap(MPI.COMM_SELF, size),
        1,
        cpp.graph.AdjacencyList_int32(np.ascontiguousarray(numbers, dtype=np.int32)),
        1,
    )
    native = space._cpp_object
    arguments = (native.mesh, native.element, dofmap)
    if _OLD:
        return fem.FunctionSpace(space.mesh, space.ufl_element(), cpp.fem.FunctionSpace(*arguments))
    try:
        numbered = cpp.fem.FunctionSpace_float64(*arguments)
    except TypeError:
        numbered = cpp.fem.FunctionSpace_float64(*arguments, [])
    return fem.FunctionSpace(space.mesh, space.ufl_element(), numbered)


def compile_forms(forms: Sequence[ufl.Form]) -> list[Any]:
    """Compile forms that are independent of a mesh; return handles for `create_form`."""
    scalar = {"scalar_type": "double" if _OLD else np.float64}
    options = {_OPTIONS: getattr(ffcx, f"get_{_OPTIONS}")(scalar)}
    compiled, module, _ = ffcx_jit.compile_forms(list(forms), **options, **_JIT)
    return [(module, form) for form in compiled]


def coefficient_positions(compiled: Any) -> list[int]:
    """Indices of the coefficients that the kernel of a compiled form reads, in the kernel's order.

    An index is a position in the list of all coefficients of the form, of which the kernel may read
    only some.
    """
    name = "original_coefficient_position"
    positions = getattr(compiled[1], name if hasattr(compiled[1], name) else f"{name}s")
    return [positions[i] for i in range(compiled[1].num_coefficients)]


def create_form(
    compiled: Any,
    spaces: Sequence[fem.FunctionSpace],
    coefficients: Sequence[fem.Function],
    constant: fem.Constant,
    domain: mesh.Mesh,
) -> Any:
    """Make a dolfinx form over all cells of a mesh.

    Parameters
    ----------
    compiled
        Handle from `compile_forms`.
    spaces
        Function spaces of the test and trial functions.
    coefficients
        Coefficients in the order of the kernel, see `coefficient_positions`.
    constant
        Constant that occurs in the form.
    domain
        Mesh over which the form is integrated.
    """
    module, ufcx = compiled
    pointer = int(module.ffi.cast("uintptr_t", module.ffi.addressof(ufcx)))
    native = [space._cpp_object for space in spaces]
    values = [c._cpp_object for c in coefficients]
    numbers = [constant._cpp_object]
    if _OLD:
        names = ("cell", "exterior_facet", "interior_facet", "vertex")
        subdomains = {getattr(_INTEGRAL_TYPE, name): None for name in names}
        return cpp.fem.Form_float64(pointer, native, values, numbers, subdomains, native[0].mesh)
    cells = domain.topology.index_map(domain.topology.dim).size_local
    every = {_INTEGRAL_TYPE.cell: [(-1, np.arange(cells, dtype=np.int32))]}
    return cpp.fem.create_form_float64(pointer, native, values, numbers, every, domain._cpp_object)


def native_matrix(form: Any, spaces: Sequence[fem.FunctionSpace], domain: mesh.Mesh) -> Any:
    """Make an empty dolfinx matrix with the sparsity pattern of a form."""
    if _OLD:
        dofmaps = [space._cpp_object.dofmap for space in spaces]
        pattern = cpp.fem.create_sparsity_pattern(domain.topology, dofmaps, {_INTEGRAL_TYPE.cell})
        pattern.assemble()
    else:
        pattern = cpp.fem.create_sparsity_pattern(form)
        pattern.finalize()
    return cpp.la.MatrixCSR_float64(pattern)
