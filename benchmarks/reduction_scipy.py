"""M1, M3 and M4 the obvious way, on the same matrices: SciPy's `splu` and `eigsh`.

One process, whole arrays, right-hand sides in one block: what an engineer writes in an
afternoon, with the one trick that matters (a determinate support instead of the dense
rows of (29)), without which it is slower still.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, eigsh, splu

import fenics_ehd as ehd
from fenics_ehd.reduction.bore import rigid_fields
from fenics_ehd.reduction.load_dependent_basis import PRESSURE_SETS


def csr(matrix: object) -> sparse.csr_matrix:
    """PETSc to SciPy, serial."""
    indptr, indices, data = matrix.getValuesCSR()
    return sparse.csr_matrix((data, indices, indptr), matrix.getSize())


class FreePart:
    """K, M, J of a free part and the factors of K on a determinate support."""

    def __init__(self, structure: ehd.Structure):
        self.structure = structure
        self.stiffness, self.mass = csr(structure.stiffness), csr(structure.mass)
        self.load = csr(structure.bore.load)
        fields = rigid_fields(structure.coordinates)
        gram = fields.T @ (self.mass @ fields)
        self.rigid = np.linalg.solve(np.linalg.cholesky(gram), fields.T).T
        held = linalg.qr(self.rigid.T, pivoting=True, mode="economic")[2][:6]
        self.free = np.delete(np.arange(len(fields)), held)
        self.factors = splu(
            self.stiffness[self.free][:, self.free].tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        self.pin = np.column_stack([v.array for v in structure.attachments["pin"][:2]])

    def respond(self, loads: np.ndarray) -> np.ndarray:
        """G of (29)."""
        balanced = loads - self.mass @ (self.rigid @ (self.rigid.T @ loads))
        response = np.zeros_like(balanced)
        response[self.free] = self.factors.solve(np.ascontiguousarray(balanced[self.free]))
        return response - self.rigid @ (self.rigid.T @ (self.mass @ response))

    def modes(self, count: int, inverse: object) -> tuple[np.ndarray, np.ndarray]:
        """Lowest modes of the part with the given inverse of K."""
        n = len(self.rigid)
        operator = LinearOperator((n, n), lambda x: inverse(np.atleast_2d(x.T).T)[:, 0])
        values, vectors = eigsh(
            self.stiffness, count, self.mass, sigma=0.0, OPinv=operator, tol=1e-10
        )
        return np.sqrt(values), vectors

    def outward(self, columns: np.ndarray) -> np.ndarray:
        """Outward bore displacement of part-size columns."""
        bore = self.structure.bore
        rows = columns.reshape(-1, 3, columns.shape[1])[bore.nodes]
        radial = bore.coordinates[:, :2] / np.linalg.norm(bore.coordinates[:, :2], axis=1)[:, None]
        return np.einsum("ic,icn->in", radial, rows[:, :2])


def craig_bampton(structure: ehd.Structure, count: int) -> tuple[np.ndarray, np.ndarray]:
    """M1; the bore's mean motion and the pin held by Lagrange multipliers."""
    part = FreePart(structure)
    centre = np.zeros((len(structure.coordinates), 3, 6))
    centre[structure.bore.nodes] = structure.bore.reference
    held = np.hstack([centre.reshape(-1, 6), part.pin])
    response = part.respond(held)
    lever = held.T @ part.rigid
    scale = np.abs(held.T @ response).max()
    saddle = np.block([[held.T @ response / scale, -lever], [lever.T, np.zeros((6, 6))]])

    def reactions(given: np.ndarray, balance: np.ndarray) -> np.ndarray:
        solution = np.linalg.solve(saddle, np.vstack([given, balance * scale]))
        return part.rigid @ solution[len(lever) :] - response @ (solution[: len(lever)] / scale)

    def inverse(loads: np.ndarray) -> np.ndarray:
        free = part.respond(loads)
        return free + reactions(held.T @ free, part.rigid.T @ loads)

    angular, modes = part.modes(count, inverse)
    static = reactions(-np.eye(8)[:, 6:], np.zeros((6, 2)))
    basis = np.hstack([modes, static])
    balanced = basis - part.rigid @ (part.rigid.T @ (part.mass @ basis))
    return angular / (2 * np.pi), _flexibility(part, balanced)


def load_dependent(
    structure: ehd.Structure, n_vibration: int, n_residual: int, pressure_set: str
) -> tuple[np.ndarray, np.ndarray]:
    """M3 with the residual modes of lowest frequency."""
    part = FreePart(structure)
    angular, modes = part.modes(n_vibration, part.respond)
    pressures = PRESSURE_SETS[pressure_set](structure.bore)
    loads = np.hstack([part.pin, part.load @ pressures])
    responses = part.respond(loads) - modes / angular**2 @ (modes.T @ loads)
    candidates = responses[:, 2:]
    energies, patterns = np.linalg.eigh(candidates.T @ (part.stiffness @ candidates))
    real = energies > 1e-12 * energies.max()
    candidates = candidates @ (patterns[:, real] / np.sqrt(energies[real]))
    _, vectors = np.linalg.eigh(candidates.T @ (part.mass @ candidates))
    static = np.hstack([responses[:, :2], candidates @ vectors[:, ::-1][:, :n_residual]])
    static /= np.linalg.norm(static, axis=0)
    values, vectors = linalg.eigh(
        static.T @ (part.mass @ static), static.T @ (part.stiffness @ static)
    )
    basis = np.hstack([modes, static @ (vectors / np.sqrt(values))[:, ::-1]])
    return angular / (2 * np.pi), _flexibility(part, basis)


def residual_flexibility(
    structure: ehd.Structure, n_vibration: int
) -> tuple[np.ndarray, np.ndarray]:
    """M4 without truncation: every static response, all at once."""
    part = FreePart(structure)
    angular, _ = part.modes(n_vibration, part.respond)
    responses = part.respond(part.load.toarray())
    np.linalg.eigh(part.load.T @ responses)
    return angular / (2 * np.pi), part.outward(responses)


def _flexibility(part: FreePart, basis: np.ndarray) -> np.ndarray:
    stiffness = basis.T @ (part.stiffness @ basis)
    return part.outward(basis) @ np.linalg.solve(stiffness, (part.load.T @ basis).T)


SCIPY_METHODS = {
    "m1-37": lambda s: craig_bampton(s, 37),
    "m1-127": lambda s: craig_bampton(s, 127),
    "m3-pc2": lambda s: load_dependent(s, 6, 31, "pc2"),
    "m3-pc1": lambda s: load_dependent(s, 6, 31, "pc1"),
    "m4": lambda s: residual_flexibility(s, 6),
}
