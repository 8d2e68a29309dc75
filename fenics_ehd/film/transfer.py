"""Pressure and displacement between film and bore meshes that do not match, section 2.2.

Two ways to the nodal forces of a film pressure. The mortar (14) gives pressures
on the bore's nodes, to be loaded with (15). The conservative one integrates the
film's pressure against the bore's shape functions: resultant force and moment
stay those of the film to round-off. Either way the transpose carries
displacements back, so force and gap are conjugate.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from fenics_ehd.film.overlay import overlay, triangle_rule
from fenics_ehd.film.surface import Surface
from fenics_ehd.film.surface_reading import interpolation_matrix
from fenics_ehd.reduction.surface_elements import ELEMENTS

#: Triangles integrated at once.
BLOCK = 20_000

#: Weights of three Gauss points on the unit interval.
GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0

#: Round-off of the area of a film cell's parts.
WHOLE = 1e-9


class Mortar:
    """``P_s = H_sf P_f`` (14), the L2 projection of film pressures onto the bore's mesh.

    ``H = D^-1 M`` with ``D = int N_s N_s dA`` and ``M = int N_s N_f dA``, the
    latter integrated exactly over the true intersections of the cells: what
    both meshes can represent is reproduced, and the integral of every pressure
    is kept. H itself is full and is not formed.

    Parameters
    ----------
    structure
        Bore mesh of the pressures of (15), m nodes.
    film
        Film mesh, k nodes.
    radius
        Radius of both [m].

    Attributes
    ----------
    mass, coupling
        D, shape (m, m), and M, shape (m, k), sparse [m^2].

    Raises
    ------
    InterfaceMismatchError
        The meshes do not cover the same cylinder.
    """

    def __init__(self, structure: Surface, film: Surface, radius: float):
        self.mass = radius * _mass(structure)
        self.coupling = radius * _coupling(structure, film)
        self._factor = splu(self.mass.tocsc())

    def to_structure(self, pressures: np.ndarray) -> np.ndarray:
        """``H P_f`` for film pressures of shape (k,) or (k, columns)."""
        return self._factor.solve(self.coupling @ pressures)

    def matrix(self) -> np.ndarray:
        """H as a dense array, shape (m, k): bore size, to be projected with J of a body."""
        return self._factor.solve(self.coupling.toarray())


def _mass(surface: Surface) -> sparse.csr_matrix:
    """``int N N dphi dz`` on the whole cells."""
    barycentric, weights = triangle_rule(2 * ELEMENTS[surface.family].degree)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    halves = [corners] if surface.triangular else [corners, 1.0 - corners]
    points = np.vstack([barycentric @ half for half in halves])
    values = ELEMENTS[surface.family].shapes(points)
    local = values.T @ (0.5 * np.tile(weights, len(halves))[:, None] * values)
    entries = surface.determinants[:, None, None] * local
    size = len(surface.nodes)
    return _assemble(surface.cells, surface.cells, entries, (size, size))


def _coupling(structure: Surface, film: Surface) -> sparse.csr_matrix:
    """``int N_s N_f dphi dz`` on the intersections of the cells."""
    tiles = overlay(structure, film)
    degree = ELEMENTS[structure.family].degree + ELEMENTS[film.family].degree
    barycentric, weights = triangle_rule(degree)
    size = (len(structure.nodes), len(film.nodes))
    total = sparse.csr_matrix(size)
    for start in range(0, len(tiles.areas), BLOCK):
        part = slice(start, start + BLOCK)
        ours, theirs = (
            ELEMENTS[surface.family]
            .shapes((barycentric @ corners[part]).reshape(-1, 2))
            .reshape(-1, len(weights), surface.cells.shape[1])
            for surface, corners in ((structure, tiles.on_structure), (film, tiles.on_film))
        )
        scaled = (tiles.areas[part, None] * weights)[:, :, None] * theirs
        entries = ours.swapaxes(1, 2) @ scaled
        rows = structure.cells[tiles.structure_cells[part]]
        total = total + _assemble(rows, film.cells[tiles.film_cells[part]], entries, size)
    return total


def solid_share(structure: Surface, film: Surface, points: np.ndarray) -> np.ndarray:
    """What holes of a bore leave of the area that each Gauss point of a film stands for.

    Weights that integrate all products of quadratics exactly over what a hole leaves of a film
    cell; with them the pressure of the film acts on the remaining surface.

    Parameters
    ----------
    structure
        Bore mesh, its holes polygons.
    film
        Film mesh.
    points
        3 x 3 Gauss points of a film cell, shape (9, 2).

    Returns
    -------
    numpy.ndarray
        shape (cells, 9), 1 where a cell is whole.
    """
    tiles = overlay(structure, film)
    barycentric, weights = triangle_rule(4)
    x = (barycentric @ tiles.on_film).reshape(-1, 2)
    powers = [(i, j) for i in range(3) for j in range(3)]

    def monomials(at: np.ndarray) -> np.ndarray:
        return np.stack([at[:, 0] ** i * at[:, 1] ** j for i, j in powers], axis=1)

    lagrange = (monomials(x) @ np.linalg.inv(monomials(points))).reshape(-1, len(weights), 9)
    moments = tiles.areas[:, None] * np.einsum("q,tqg->tg", weights, lagrange)
    found = np.zeros((len(film.cells), 9))
    np.add.at(found, tiles.film_cells, moments)
    whole = film.determinants[:, None] * np.outer(*[GAUSS_WEIGHTS] * 2).ravel()
    share = found / whole
    share[np.abs(found.sum(axis=1) / whole.sum(axis=1) - 1.0) < WHOLE] = 1.0
    return share


def _assemble(
    rows: np.ndarray, columns: np.ndarray, entries: np.ndarray, shape: tuple[int, int]
) -> sparse.csr_matrix:
    """Sum cell matrices (c, i, j) with rows (c, i) and columns (c, j)."""
    i = np.broadcast_to(rows[:, :, None], entries.shape).ravel()
    j = np.broadcast_to(columns[:, None, :], entries.shape).ravel()
    return sparse.coo_matrix((entries.ravel(), (i, j)), shape=shape).tocsr()


def outward_displacement(structure: Surface, phi: np.ndarray, z: np.ndarray) -> sparse.csr_matrix:
    """Gap change ``n . N_s u`` at points of the film per displacement of the bore nodes.

    Parameters
    ----------
    structure
        Bore mesh of the displacements, m nodes.
    phi, z
        Points, shape (p,) [rad], [m]; ``n = (cos phi, sin phi, 0)``.

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (p, 3 m), columns ``3 node + component``.
    """
    shape = interpolation_matrix(structure, phi, z)
    normal = np.repeat(np.column_stack([np.cos(phi), np.sin(phi)]), np.diff(shape.indptr), axis=0)
    return sparse.csr_matrix(
        (
            (shape.data[:, None] * normal).ravel(),
            (3 * shape.indices[:, None] + np.arange(2)).ravel(),
            2 * shape.indptr,
        ),
        shape=(len(phi), 3 * len(structure.nodes)),
    )
