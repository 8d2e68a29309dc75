"""Meshes and elements of dolfinx that only tests need, for every version."""

import inspect

import ufl
from dolfinx import mesh

from fenics_ehd.base import compat


def quadrature_element(cell, degree):
    """Element of values at the points of the default quadrature rule of a degree."""
    if compat._basix_ufl is not None:
        return compat._basix_ufl.quadrature_element(cell, scheme="default", degree=degree)
    return ufl.FiniteElement("Quadrature", compat._cell(cell), degree, quad_scheme="default")


def create_mesh(comm, cells, element, x):
    """Mesh from cells (nodes in dolfinx order), a blocked Lagrange element and node positions."""
    if compat._basix_ufl is None:
        return mesh.create_mesh(comm, cells, x, ufl.Mesh(element))
    x_comes_last = list(inspect.signature(mesh.create_mesh).parameters)[3] == "x"
    return mesh.create_mesh(comm, cells, *((element, x) if x_comes_last else (x, element)))
