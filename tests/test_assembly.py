"""Films of a flat mesh with folded numbers against dolfinx on a closed surface mesh."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx_cases import create_mesh, quadrature_element
from film_cases import FAMILIES, OMEGA, C, R, make_film
from mpi4py import MPI
from scipy import sparse
from scipy.optimize import brentq
from scipy.spatial import cKDTree

import fenics_ehd as ehd
from fenics_ehd.base import compat
from fenics_ehd.fem.elements import quadratic_element
from fenics_ehd.film.assembly import GAUSS_POINTS, Assembly
from fenics_ehd.film.kinematics import Gap

pytestmark = pytest.mark.kernels

DX = ufl.dx(metadata={"quadrature_degree": 2 * GAUSS_POINTS - 1})


def crooked_grid(family):
    """No two cells alike."""
    random = np.random.default_rng(2)
    angles = np.append(0.0, np.cumsum(random.uniform(0.5, 1.5, 7)))
    heights = np.cumsum(random.uniform(0.3, 1.0, 4)) * R
    return ehd.FilmGrid(R, 0.4 + 2 * np.pi * angles / angles[-1], heights, family)


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
        corners = self.positions(
            np.repeat(grid.angles[:-1], along + 1), np.tile(grid.heights, around)
        )
        i, j = (x.ravel() for x in np.meshgrid(range(around), range(along), indexing="ij"))
        number = [((i + a) % around) * (along + 1) + j + b for b in (0, 1) for a in (0, 1)]
        self.cells = np.column_stack(number)
        geometry = compat.lagrange_element("quadrilateral", 1, (3,))
        self.mesh = create_mesh(MPI.COMM_SELF, self.cells, geometry, corners)
        centres = corners[self.cells].mean(axis=1)
        own = self.mesh.geometry.x[compat.geometry_dofmap(self.mesh)].mean(axis=1)
        #: Film cell of every dolfinx cell.
        self.order = cKDTree(centres).query(own)[1]

    def positions(self, angle, height):
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
def test_residual_and_matrix_are_those_of_a_closed_surface(family):
    grid = crooked_grid(family)
    prism = Prism(grid)
    element = (
        compat.lagrange_element("quadrilateral", 1)
        if family == "bilinear"
        else quadratic_element(family, "quadrilateral")
    )
    space = compat.functionspace(prism.mesh, element)
    v, pressure = ufl.TestFunction(space), fem.Function(space)
    around, along = (
        (lambda w, i=i: ufl.dot(direction(prism.mesh, i), ufl.grad(w))) for i in (0, 1)
    )
    values = np.random.default_rng(5).uniform(0.5, 1, (3, int(np.prod(grid.cells)), 9))
    height, rate, speed = (prism.coefficient(x) for x in values)
    flow = height**3 * around(pressure) - height * speed
    residual = (flow * around(v) + height**3 * along(pressure) * along(v) + rate * v) * DX
    positions = prism.positions(*grid.node_positions.T)
    distance, order = cKDTree(space.tabulate_dof_coordinates()).query(positions)
    assert distance.max() < 1e-12
    film = make_film(grid=grid)
    p = np.random.default_rng(6).uniform(0, 1, len(film.free))
    pressure.x.array[order] = film.equation.nodal(p)
    petsc = compat.fem_petsc()
    vector = petsc.assemble_vector(fem.form(residual)).array
    matrix = petsc.assemble_matrix(
        fem.form(ufl.derivative(residual, pressure, ufl.TrialFunction(space)))
    )
    matrix.assemble()
    matrix = sparse.csr_matrix(matrix.getValuesCSR()[::-1]).toarray()
    units = C, C * OMEGA, OMEGA * R
    gap = Gap(*(x * unit for x, unit in zip(values, units, strict=True)), np.zeros_like(values[0]))
    problem = film.equation.problem(gap)
    np.testing.assert_allclose(problem.residual(p), vector[order][film.free], atol=1e-13)
    found = film.equation.pattern.matrix(problem.entries(p)).toarray()
    expected = matrix[order][:, order][film.free][:, film.free]
    np.testing.assert_allclose(found, expected, atol=1e-13)


@pytest.mark.parametrize("family", FAMILIES)
def test_values_at_points_belong_to_integrals(family):
    assembly = Assembly(crooked_grid(family))
    source = np.random.default_rng(5).uniform(-1, 1, assembly.area.shape)
    p, q = np.random.default_rng(7).uniform(-1, 1, (2, assembly.size))
    values = [assembly.at_points(x)[0] for x in (p, q)]
    assert np.sum(assembly.area * source * values[0]) == pytest.approx(
        p @ assembly.source(source), abs=1e-13
    )
    mass = assembly.mass(np.arange(assembly.size))
    assert p @ (mass @ q) == pytest.approx(np.sum(assembly.area * values[0] * values[1]), abs=1e-13)


def direction(mesh, axis):
    """Unit vector along a reference axis of the cells."""
    jacobian = ufl.Jacobian(mesh)
    column = ufl.as_vector([jacobian[i, axis] for i in range(3)])
    return column / ufl.sqrt(ufl.dot(column, column))


@pytest.mark.parametrize("family", FAMILIES)
def test_shape_functions_are_nodal_polynomials(family):
    assembly = Assembly(crooked_grid(family))
    # Of one cell, in its own coordinates: two terms that no seam breaks.
    cell, (around, along) = 9, assembly.grid.cell_sizes
    nodes, corner = assembly.grid.cell_nodes[cell], assembly.grid.node_positions
    x, y = (corner[nodes] / (1.0, R)).T
    first = x[0], y[0]
    powers = [(a, b) for a in range(3) for b in range(3)]
    if family == "bilinear":
        powers = [(a, b) for a, b in powers if max(a, b) < 2]
    elif family == "serendipity":
        powers = powers[:-1]
    s, t = assembly.reference.T
    width, height = around[cell], along[cell]
    for a, b in powers:
        nodal = np.zeros(assembly.size)
        nodal[nodes] = ((x - first[0]) / width) ** a * ((y - first[1]) / height) ** b
        value, slope, rise = (w[cell] for w in assembly.at_points(nodal))
        np.testing.assert_allclose(value, s**a * t**b, atol=1e-12)
        np.testing.assert_allclose(slope * width, a * s ** max(a - 1, 0) * t**b, atol=1e-12)
        np.testing.assert_allclose(rise * height, b * s**a * t ** max(b - 1, 0), atol=1e-12)
