"""Nodal forces of film pressures by quadrature, on the intersections of two meshes or anywhere."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from fenics_ehd.film.transfer import Surface, outward_displacement, overlay, triangle_rule


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Quadrature points on a cylinder: angle [rad], height [m], weight [m^2], shape (p,) each."""

    phi: np.ndarray
    z: np.ndarray
    weights: np.ndarray


def intersection_points(
    structure: Surface, film: Surface, radius: float, degree: int
) -> SurfacePoints:
    """Quadrature points on the intersections of two meshes of one cylinder.

    Parameters
    ----------
    structure, film
        The meshes.
    radius
        Radius of the cylinder [m].
    degree
        Total polynomial degree in (phi, z) integrated exactly on every intersection.
    """
    tiles = overlay(structure, film)
    barycentric, weights = triangle_rule(degree)
    cells = tiles.structure_cells
    xi = barycentric @ tiles.on_structure
    x = structure.corners[cells][:, :1] + xi @ structure.jacobians[cells].swapaxes(1, 2)
    return SurfacePoints(
        phi=x[:, :, 0].ravel(),
        z=x[:, :, 1].ravel(),
        weights=(radius * tiles.areas[:, None] * weights).ravel(),
    )


def conservative_load(
    structure: Surface,
    phi: np.ndarray,
    z: np.ndarray,
    weights: np.ndarray,
    film_values: sparse.spmatrix,
) -> sparse.csr_matrix:
    """Nodal forces on the bore ``F = int N_s n p dA`` of film pressures.

    At the film's own quadrature points the resultant force and the moments
    about x and y are the film's to round-off, because the shape functions
    reproduce 1 and z. At those of `intersection_points` every nodal force is
    exact up to the quadrature of cos and sin.

    Parameters
    ----------
    structure
        Bore mesh of the displacements, m nodes.
    phi, z, weights
        Quadrature points [rad], [m] and weights [m^2], shape (p,).
    film_values
        Shape functions of the film's k pressure nodes there, shape (p, k).

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (3 m, k) [m^2]: the weighted transpose of `outward_displacement`.
    """
    rows = outward_displacement(structure, phi, z)
    return (rows.T @ (sparse.diags(weights) @ sparse.csr_matrix(film_values))).tocsr()
