"""Assembly from tabulated cells against dolfinx on a closed surface mesh."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx_cases import create_mesh, quadrature_element
from film_cases import FAMILIES, R
from mpi4py import MPI
from scipy import sparse
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from fenics_ehd.base import compat
from fenics_ehd.fem.elements import quadratic_element
from fenics_ehd.film.assembly import Assembly, Coefficients
from fenics_ehd.film.forms import GAUSS_POINTS, cell_tensors
from fenics_ehd.film.grid import FilmGrid

pytestmark = pytest.mark.kernels

DX = ufl.dx(metadata={"quadrature_degree": 2 * GAUSS_POINTS - 1})


def crooked_grid(family):
    """No two cells alike."""
    random = np.random.default_rng(2)
    angles = np.append(0.0, np.cumsum(random.uniform(0.5, 1.5, 7)))
    heights = np.cumsum(random.uniform(0.3, 1.0, 4)) * R
    return FilmGrid(R, 0.4 + 2 * np.pi * angles / angles[-1], heights, family)


class Prism:
    """The film as a polygonal prism of flat cells, sides as long as the arcs, lengths over R."""

    def __init__(self, grid):
        self.grid = grid
        self.sides = np.diff(grid.angles)
        radius = brentq(
            lambda r: np.arcsin(self.sides / (2 * r)).sum() - np.pi, self.sides.max() / 2, 10.0,
            xtol=1e-15,
        )  # fmt: skip
        turn = np.cumsum(np.append(0.0, 2 * np.arcsin(self.sides / (2 * radius))))
        self.polygon = radius * np.column_stack([np.cos(turn), np.sin(turn)])
        around, along = grid.cells
        corners = self.place(np.repeat(grid.angles[:-1], along + 1), np.tile(grid.heights, around))
        i, j = (x.ravel() for x in np.meshgrid(range(around), range(along), indexing="ij"))
        number = [((i + a) % around) * (along + 1) + j + b for b in (0, 1) for a in (0, 1)]
        self.cells = np.column_stack(number)
        geometry = compat.lagrange_element("quadrilateral", 1, (3,))
        self.mesh = create_mesh(MPI.COMM_SELF, self.cells, geometry, corners)
        centres = corners[self.cells].mean(axis=1)
        own = self.mesh.geometry.x[compat.geometry_dofmap(self.mesh)].mean(axis=1)
        #: Film cell of every dolfinx cell.
        self.order = cKDTree(centres).query(own)[1]

    def place(self, angle, height):
        """Where on the prism a point of the film lies."""
        flat = [np.interp(angle, self.grid.angles, x) for x in self.polygon.T]
        return np.column_stack([*flat, height / R])

    def coefficient(self, values):
        """Function with given values (film cells, points) at the quadrature points."""
        element = quadrature_element("quadrilateral", 2 * GAUSS_POINTS - 1)
        function = fem.Function(compat.functionspace(self.mesh, element))
        function.x.array[compat.space_dofmap(function.function_space)] = values[self.order]
        return function


@pytest.mark.parametrize("family", FAMILIES)
def test_vectors_and_matrices_are_those_of_dolfinx(family):
    grid = crooked_grid(family)
    prism = Prism(grid)
    element = (
        compat.lagrange_element("quadrilateral", 1)
        if family == "bilinear"
        else quadratic_element(family, "quadrilateral")
    )
    space = compat.functionspace(prism.mesh, element)
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    around, along = (
        (lambda w, i=i: ufl.dot(direction(prism.mesh, i), ufl.grad(w))) for i in (0, 1)
    )
    values = np.random.default_rng(5).uniform(-1, 1, (8, int(np.prod(grid.cells)), 9))
    f, g, s, *k = (prism.coefficient(x) for x in values)
    petsc = compat.fem_petsc()
    vector = petsc.assemble_vector(fem.form((f * around(v) + g * along(v) + s * v) * DX)).array
    matrix = petsc.assemble_matrix(
        fem.form(
            (
                (k[0] * around(u) + k[2] * u) * around(v)
                + (k[1] * along(u) + k[3] * u) * along(v)
                + k[4] * u * v
            )
            * DX
        )
    )
    matrix.assemble()
    matrix = sparse.csr_matrix(matrix.getValuesCSR()[::-1]).toarray()
    places = prism.place(*grid.node_positions.T)
    distance, order = cKDTree(space.tabulate_dof_coordinates()).query(places)
    assert distance.max() < 1e-12
    free = np.flatnonzero(np.arange(len(order)) % 5 != 2)
    assembly = Assembly(grid, free)
    np.testing.assert_allclose(assembly.vector(*values[:3]), vector[order], atol=1e-13)
    found = assembly.pattern.matrix(assembly.matrix(Coefficients(*values[3:]))).toarray()
    np.testing.assert_allclose(found, matrix[order][:, order][free][:, free], atol=1e-13)


@pytest.mark.parametrize("family", FAMILIES)
def test_many_directions_and_values_at_points_belong_to_the_vector(family):
    grid = crooked_grid(family)
    assembly = Assembly(grid, np.arange(5))
    f, g, s = np.random.default_rng(5).uniform(-1, 1, (3, int(np.prod(grid.cells)), 9))
    directions = np.random.default_rng(6).uniform(-1, 1, (f.size, 4))
    columns = assembly.gather(assembly.flux_elements(f, g)) @ directions
    columns = columns + assembly.source_vectors(s, directions)
    for column, direction in zip(columns.T, directions.T, strict=True):
        scale = direction.reshape(f.shape)
        expected = assembly.vector(f * scale, g * scale, s * scale)
        np.testing.assert_allclose(column, expected, atol=1e-14)
    # p . r is the integral of flux times slopes and of source times value.
    p = np.random.default_rng(7).uniform(-1, 1, len(grid.node_positions))
    value, around, along = assembly.at_points(p)
    work = np.sum(assembly.area * (f * around + g * along + s * value))
    assert work == pytest.approx(p @ assembly.vector(f, g, s), abs=1e-13)


def direction(mesh, axis):
    """Unit vector along a reference axis of the cells."""
    jacobian = ufl.Jacobian(mesh)
    column = ufl.as_vector([jacobian[i, axis] for i in range(3)])
    return column / ufl.sqrt(ufl.dot(column, column))


@pytest.mark.parametrize("family", FAMILIES)
def test_tabulated_shape_functions_are_nodal_polynomials(family):
    t = cell_tensors(family)
    x, y = t.points.T
    # dolfinx order of the nodes.
    nodes = np.array([(0, 0), (1, 0), (0, 1), (1, 1), (0.5, 0), (0, 0.5), (1, 0.5), (0.5, 1),
                      (0.5, 0.5)])[: t.value.shape[1]]  # fmt: skip
    powers = [(a, b) for a in range(3) for b in range(3)]
    if family == "bilinear":
        powers = [(a, b) for a, b in powers if max(a, b) < 2]
    elif family == "serendipity":
        powers = powers[:-1]
    for a, b in powers:
        nodal = nodes[:, 0] ** a * nodes[:, 1] ** b
        np.testing.assert_allclose(t.value @ nodal, x**a * y**b, atol=1e-13)
        np.testing.assert_allclose(t.around @ nodal, a * x ** max(a - 1, 0) * y**b, atol=1e-13)
        np.testing.assert_allclose(t.along @ nodal, b * x**a * y ** max(b - 1, 0), atol=1e-13)
    assert t.weights.sum() == pytest.approx(1.0, abs=1e-14)
