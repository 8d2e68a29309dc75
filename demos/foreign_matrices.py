# # Matrices from another program
#
# The reduction needs K, M, the nodes and the faces of the bore, from whichever program they come.
# Here "another program" is forty lines of NumPy: a bearing ring of 8-node hexahedra, written to
# Matrix Market files. dolfinx is not imported. Run it with
#
#     python demos/foreign_matrices.py

# +
import itertools
import tempfile
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.io import mmwrite
from scipy.sparse.linalg import eigsh

import fenics_ehd as ehd

RADIUS, OUTER, WIDTH = 0.0225, 0.0340, 0.022  # [m]
YOUNG, POISSON, DENSITY = 210e9, 0.3, 7850.0
CORNERS = np.array([(a, b, c) for c, b, a in itertools.product((0, 1), repeat=3)])
# -

# ## The other program
#
# Nodes lie on cylinders about the z axis, with z = 0 in the middle of the bore. Cells are numbered
# with the radius fastest, so that the corners 0, 2, 4 and 6 of the innermost cells form the bore.
# The corners of a 4-node face have the same order: the first direction is fastest.


def mesh(around: int = 36, along: int = 4, across: int = 3) -> tuple[np.ndarray, ...]:
    """Nodes (n, 3) [m], cells (c, 8) and bore faces (f, 4) of the ring."""
    r, z = np.linspace(RADIUS, OUTER, across + 1), np.linspace(-WIDTH / 2, WIDTH / 2, along + 1)
    angle = 2 * np.pi * np.arange(around) / around
    z, a, r = (x.ravel() for x in np.meshgrid(z, angle, r, indexing="ij"))
    nodes = np.column_stack([r * np.cos(a), r * np.sin(a), z])
    k, j, i = (x.reshape(-1, 1) for x in np.indices((along, around, across)))
    a, b, c = CORNERS.T
    cells = ((k + c) * around + (j + b) % around) * (across + 1) + i + a
    return nodes, cells, cells[::across, [0, 2, 4, 6]]


def assemble(nodes: np.ndarray, cells: np.ndarray) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Matrices K and M of linear elasticity; dofs are numbered 3 * node + component."""
    mu, lame = YOUNG / (2 * (1 + POISSON)), YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    size, x = 3 * len(nodes), nodes[cells]
    stiffness, mass = np.zeros((2, len(cells), 24, 24))
    for point in itertools.product((0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5), repeat=3):
        factors = np.where(CORNERS, point, 1 - np.array(point))
        values, signs = factors.prod(axis=1), np.where(CORNERS, 1.0, -1.0)
        local = signs * np.column_stack([np.delete(factors, d, 1).prod(axis=1) for d in range(3)])
        jacobian = np.einsum("cni,nd->cid", x, local)
        weight = np.abs(np.linalg.det(jacobian))[:, None, None] / 8
        gradient = local @ np.linalg.inv(jacobian)
        # Strain (a, b) for a unit displacement d of node n, nine components per row.
        strain = np.einsum("cna,bd->cndab", gradient, np.eye(3))
        strain = (0.5 * (strain + np.swapaxes(strain, 3, 4))).reshape(len(cells), 24, 9)
        trace = strain[:, :, ::4].sum(axis=2)
        stiffness += 2 * mu * weight * (strain @ np.swapaxes(strain, 1, 2))
        stiffness += lame * weight * trace[:, :, None] * trace[:, None, :]
        mass += DENSITY * weight * np.kron(np.outer(values, values), np.eye(3))
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(-1, 24)
    rows, columns = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, 24).ravel()
    k, m = (
        sparse.coo_matrix((blocks.ravel(), (rows, columns)), (size, size)).tocsr()
        for blocks in (stiffness, mass)
    )
    return k, m


# ## The reduction
#
# `bore_from_faces` integrates the load matrix J (15), which gives nodal forces from nodal
# pressures. A boundary point is a list of nodes, of which the mean displacement is a coordinate.
# Here it is a strip of the outer surface, at which a rod could be joined. `Structure` takes files
# as well as SciPy or PETSc matrices. Every method first checks symmetry, definiteness, the six
# rigid motions and the bore's shape, and reports what is wrong.


def main() -> tuple[float, float]:
    """Reduce the ring; first frequency [Hz] of the stored body, and from SciPy with K and M."""
    nodes, cells, faces = mesh()
    radius, angle = np.hypot(*nodes[:, :2].T), np.arctan2(nodes[:, 1], nodes[:, 0])
    pin = np.flatnonzero((radius > 0.999 * OUTER) & (np.abs(angle) < 0.3))
    k, m = assemble(nodes, cells)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for matrix, file in ((k, "K.mtx"), (m, "M.mtx")):
            mmwrite(folder / file, matrix, precision=17, symmetry="symmetric")
        bore = ehd.bore_from_faces(nodes, faces, "bilinear")
        part = ehd.Structure(folder / "K.mtx", folder / "M.mtx", nodes, bore, {"pin": pin})
        ehd.save_body(ehd.load_dependent(part, 6, 31), folder / "ring.h5")
        body = ehd.load_body(folder / "ring.h5")
    print(f"{k.shape[0]} degrees of freedom, {body.modes} modes, {body.inertia.total_mass:.3f} kg")
    for kind in dict.fromkeys(body.kinds):
        own = [f for f, of in zip(body.frequencies, body.kinds, strict=True) if of == kind]
        print(f"{len(own):3d} {kind:9s} {min(own):8.0f} to {max(own):8.0f} Hz")

    # SciPy on the same matrices: six rigid motions, then the first elastic mode.
    squares = eigsh(k, 8, m, sigma=-((2 * np.pi * 500) ** 2), return_eigenvectors=False)
    expected = float(np.sqrt(np.sort(squares)[6]) / (2 * np.pi))
    print(f"first frequency {body.frequencies[0]:.3f} Hz, by SciPy {expected:.3f} Hz")
    return float(body.frequencies[0]), expected


# From here on the body is like any other: `body.bore_basis` has the displacements of the bore, and
# `fenics-ehd run slider-crank --body FILE` accepts a rod with a point named `pin`.

if __name__ == "__main__":
    main()
