"""A part as another program would give it: a ring of 8-node hexahedra, in numpy and SciPy alone."""

import itertools

import numpy as np
from scipy import sparse

import fenics_ehd as ehd
from fenics_ehd.reduction.structure import PointWeights

RADIUS, OUTER, WIDTH = 0.02, 0.03, 0.024
YOUNG, POISSON, DENSITY = 210e9, 0.3, 7850.0

#: Corners of the hexahedron, first coordinate fastest.
CORNERS = np.array([(a, b, c) for c, b, a in itertools.product((0, 1), repeat=3)])


def ring_mesh(around=12, along=2, across=1):
    """Nodes (n, 3), hexahedra (c, 8), and bore faces (f, 4) in the order of the package."""
    angle = np.arange(around) * 2 * np.pi / around
    z = np.linspace(-WIDTH / 2, WIDTH / 2, along + 1)
    r = np.linspace(RADIUS, OUTER, across + 1)
    z, a, r = (x.ravel() for x in np.meshgrid(z, angle, r, indexing="ij"))
    nodes = np.column_stack([r * np.cos(a), r * np.sin(a), z])

    def number(layer, place, ring):
        return (layer * around + place % around) * (across + 1) + ring

    places = list(itertools.product(range(along), range(around), range(across)))
    cells = np.array([[number(k + c, j + b, i + a) for a, b, c in CORNERS] for k, j, i in places])
    return nodes, cells, cells[0::across][:, [0, 2, 4, 6]]


def element_matrices(x):
    """Stiffness and mass (24, 24) of the hexahedron with corners x (8, 3)."""
    mu, lame = YOUNG / (2 * (1 + POISSON)), YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    stiffness, mass = np.zeros((24, 24)), np.zeros((24, 24))
    for point in itertools.product((0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5), repeat=3):
        factors = np.where(CORNERS == 1, point, 1 - np.array(point))
        slopes = np.where(CORNERS == 1, 1.0, -1.0)
        values = factors.prod(axis=1)
        local = np.column_stack(
            [slopes[:, d] * np.delete(factors, d, axis=1).prod(axis=1) for d in range(3)]
        )
        jacobian = x.T @ local
        weight = abs(np.linalg.det(jacobian)) / 8
        gradient = local @ np.linalg.inv(jacobian)
        # d[i, c, a, b]: strain component ab of a unit displacement c of node i.
        d = 0.5 * (
            np.einsum("ib,ca->icab", gradient, np.eye(3))
            + np.einsum("ia,cb->icab", gradient, np.eye(3))
        )
        strain = d.reshape(24, 9)
        trace = np.einsum("icaa->ic", d).ravel()
        stiffness += weight * (2 * mu * strain @ strain.T + lame * np.outer(trace, trace))
        mass += weight * DENSITY * np.kron(np.outer(values, values), np.eye(3))
    return stiffness, mass


def ring_matrices(nodes, cells):
    """K and M as SciPy matrices."""
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 24)
    blocks = np.array([element_matrices(nodes[cell]) for cell in cells])
    rows, columns = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, 24).ravel()
    size = 3 * len(nodes)
    return (
        sparse.coo_matrix((blocks[:, i].ravel(), (rows, columns)), shape=(size, size)).tocsr()
        for i in range(2)
    )


def ring_arguments(**changes):
    """Arguments of the ring's `Structure`, some of them changed."""
    nodes, cells, faces = ring_mesh()
    stiffness, mass = ring_matrices(nodes, cells)
    outer = np.flatnonzero(np.linalg.norm(nodes[:, :2], axis=1) > 0.5 * (RADIUS + OUTER))
    return {
        "stiffness": stiffness,
        "mass": mass,
        "coordinates": nodes,
        "bores": ehd.bore_from_faces(nodes, faces, "bilinear"),
        "attachments": {
            "right": outer[nodes[outer, 0] > 0],
            "left": PointWeights(
                outer[nodes[outer, 0] < 0], 1 + np.arange((nodes[outer, 0] < 0).sum())
            ),
        },
        **changes,
    }


def ring(**changes):
    return ehd.Structure(**ring_arguments(**changes))


def to_scipy(matrix):
    """A PETSc matrix on one rank as SciPy matrix."""
    indptr, indices, data = matrix.getValuesCSR()
    return sparse.csr_matrix((data, indices, indptr), shape=matrix.size)
