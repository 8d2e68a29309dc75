"""What forms of a film need of dolfinx, whatever its version: to be `fenics_ehd.base.compat`."""

from __future__ import annotations

import fcntl
import inspect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ffcx
import ffcx.codegeneration.jit as ffcx_jit
import numpy as np
import ufl
from dolfinx import cpp, fem, jit, mesh
from mpi4py import MPI

from fenics_ehd.base import compat

_OLD = compat._basix_ufl is None
_JIT = (jit.get_parameters if _OLD else jit.get_options)(
    {"cffi_extra_compile_args": ["-O3", "-fno-math-errno", "-g0"]}
)
#: Where forms of the film are kept; nothing else compiles into it.
FOLDER = Path(_JIT["cache_dir"]) / "fenics_ehd"
_JIT["cache_dir"] = FOLDER
_TYPE = getattr(fem, "IntegralType", getattr(cpp.fem, "IntegralType", None))
_CELL = _TYPE.cell


def plane_element(degree: int) -> Any:
    """Lagrange element on quadrilaterals of the plane."""
    if _OLD:
        return ufl.FiniteElement("Lagrange", ufl.Cell("quadrilateral"), degree)
    return compat.lagrange_element("quadrilateral", degree)


def plane_domain() -> ufl.Mesh:
    """UFL's domain of a mesh of quadrilaterals in the plane."""
    if _OLD:
        return ufl.Mesh(ufl.VectorElement("Lagrange", ufl.Cell("quadrilateral"), 1))
    return ufl.Mesh(compat._basix_ufl.element("Lagrange", "quadrilateral", 1, shape=(2,)))


def plane_mesh(cells: np.ndarray, x: np.ndarray) -> mesh.Mesh:
    """Mesh of quadrilaterals (corners in dolfinx order) of points (n, 2), of this process alone."""
    last = list(inspect.signature(mesh.create_mesh).parameters)[3] == "x"
    domain = plane_domain()
    return mesh.create_mesh(MPI.COMM_SELF, cells, *((domain, x) if last else (x, domain)))


def quadrature_element(degree: int) -> Any:
    """Element of values at the Gauss points of quadrilaterals."""
    if _OLD:
        cell = ufl.Cell("quadrilateral")
        return ufl.FiniteElement("Quadrature", cell, degree, quad_scheme="default")
    return compat._basix_ufl.quadrature_element("quadrilateral", scheme="default", degree=degree)


class Coefficient(ufl.Coefficient):
    """Coefficient of no mesh; the old FFCx makes a name in C of what the old UFL prints."""

    def __str__(self) -> str:
        return f"w_{self.count()}"


def plane(element: Any) -> Any:
    """An element that the old UFL asks for a geometric dimension, in the plane."""
    if _OLD and hasattr(element, "_cell"):
        element._cell = ufl.Cell("quadrilateral")
    return element


def numbered_space(space: fem.FunctionSpace, numbers: np.ndarray, size: int) -> fem.FunctionSpace:
    """The same space with other numbers (cells, dofs per cell) of its degrees of freedom.

    Nodes of one number are one degree of freedom: so a plane mesh is periodic.
    """
    numbers = np.ascontiguousarray(numbers, dtype=np.int32)
    dofmap = cpp.fem.DofMap(
        space.dofmap.dof_layout,
        cpp.common.IndexMap(MPI.COMM_SELF, size),
        1,
        cpp.graph.AdjacencyList_int32(numbers),
        1,
    )
    own = space._cpp_object
    arguments = (own.mesh, own.element, dofmap)
    if _OLD:
        return fem.FunctionSpace(space.mesh, space.ufl_element(), cpp.fem.FunctionSpace(*arguments))
    try:
        made = cpp.fem.FunctionSpace_float64(*arguments)
    except TypeError:
        made = cpp.fem.FunctionSpace_float64(*arguments, [])
    return fem.FunctionSpace(space.mesh, space.ufl_element(), made)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """No other process of ours compiles into a folder; a process that is killed lets go."""
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def orphans(folder: Path) -> list[Path]:
    """Forms that somebody began to compile and did not end.

    FFCx marks a form that it compiles by its C file, and one that is compiled by a second file. Of
    the first without the second any later process believes that another one is at work, and gives
    up after its patience. Where nobody is at work they are what killed processes left.
    """
    sources = folder.glob("libffcx_*.c")
    return [source for source in sources if not source.with_suffix(".c.cached").exists()]


def compile_forms(forms: Sequence[ufl.Form]) -> list[Any]:
    """Compile forms together, as one module: handles for `create_form`."""
    with alone(FOLDER):
        for source in orphans(FOLDER):
            source.unlink()
        keyword, options = ("parameters", {"scalar_type": "double"})
        if not _OLD:
            keyword, options = ("options", {"scalar_type": np.float64})
        options = getattr(ffcx, f"get_{keyword}")(options)
        compiled, module, _ = ffcx_jit.compile_forms(list(forms), **{keyword: options}, **_JIT)
    return [(module, form) for form in compiled]


def coefficient_places(compiled: Any) -> list[int]:
    """Which of a form's own coefficients its kernel takes, in order."""
    form = compiled[1]
    name = "original_coefficient_position" + ("" if _has(form, "") else "s")
    return [getattr(form, name)[i] for i in range(form.num_coefficients)]


def _has(form: Any, plural: str) -> bool:
    return hasattr(form, f"original_coefficient_position{plural}")


def create_form(
    compiled: Any,
    spaces: Sequence[fem.FunctionSpace],
    coefficients: Sequence[fem.Function],
    constants: Sequence[fem.Constant],
    domain: mesh.Mesh,
) -> Any:
    """A compiled form over all cells of a mesh, nothing compiled; coefficients as its kernel's."""
    module, ufcx = compiled
    pointer = int(module.ffi.cast("uintptr_t", module.ffi.addressof(ufcx)))
    own = [space._cpp_object for space in spaces]
    values = [c._cpp_object for c in coefficients]
    numbers = [c._cpp_object for c in constants]
    cells = domain.topology.index_map(domain.topology.dim).size_local
    if _OLD:

        class Form(cpp.fem.Form_float64):
            """Keeps the module alive."""

        subdomains = {
            getattr(_TYPE, n): None for n in ("cell", "exterior_facet", "interior_facet", "vertex")
        }
        form = Form(pointer, own, values, numbers, subdomains, own[0].mesh)
        form.module = module
        return form
    every = {_CELL: [(-1, np.arange(cells, dtype=np.int32))]}
    return cpp.fem.create_form_float64(pointer, own, values, numbers, every, domain._cpp_object)


def native_matrix(form: Any, spaces: Sequence[fem.FunctionSpace], domain: mesh.Mesh) -> Any:
    """Matrix of a form's pattern, kept by dolfinx itself."""
    if _OLD:
        dofmaps = [space._cpp_object.dofmap for space in spaces]
        pattern = cpp.fem.create_sparsity_pattern(domain.topology, dofmaps, {_CELL})
        pattern.assemble()
    else:
        pattern = cpp.fem.create_sparsity_pattern(form)
        pattern.finalize()
    return cpp.la.MatrixCSR_float64(pattern)
