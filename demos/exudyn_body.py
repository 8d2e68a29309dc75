# # A reduced body in another program
#
# Exudyn (https://github.com/jgerstmayr/EXUDYN, `pip install exudyn` in an environment of its own)
# moves a body by a reference frame and modal coordinates, A. Zwoelfer and J. Gerstmayr, Acta
# Mechanica 232 (2021) 835. Its equations contain the coupling of the modes with rotations about all
# three axes, which is computed from the part's mass matrix M. With fields F (position x, unit
# translations, modes) and `S_c F = e_c x F` at every node, these are the matrices `F^T M F`,
# `F^T M S_c F` and `(S_c F)^T M (S_d F)`. Residual patterns (M4) have no mass in these equations:
# use M1 or M3.
#
#     python demos/exudyn_body.py
#
# reduces the connecting rod, writes `rod.npz` with the keys that Exudyn's
# `ObjectFFRFreducedOrderInterface.LoadFromFile` reads, and prints the frequencies of the free rod
# from Exudyn and from the reduction.


from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.linalg import eigh

import fenics_ehd as ehd
from fenics_ehd.reduction.bore import rigid_fields, turned
from fenics_ehd.reduction.matrices import MassOperator, inner, symmetric

#: Columns of the unit translations, after the position, and of the elastic modes.
MOVES, MODES = slice(1, 4), slice(4, None)


def inertia(structure: ehd.Structure, columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """``F^T M F``, ``F^T M S_c F``, ``(S_c F)^T M (S_d F)`` for modes of all dofs (dofs, n)."""
    mass, comm = MassOperator(structure.mass), structure.comm
    position = structure.coordinates.reshape(-1, 1)
    fields = np.hstack([position, rigid_fields(structure.coordinates)[:, :3], columns])
    spun = [turned(fields, axis) for axis in range(3)]
    forces = [mass.multiply(each) for each in spun]
    spin = np.array([inner(fields, force, comm) for force in forces])
    centrifugal = np.array([[inner(s, force, comm) for force in forces] for s in spun])
    return symmetric(inner(fields, mass.multiply(fields), comm)), spin, centrifugal


def couplings(structure: ehd.Structure, columns: np.ndarray) -> dict[str, np.ndarray]:
    """Constant matrices of Exudyn's equations; rotated modes have the columns 3 * mode + axis."""
    gram, spin, centrifugal = inertia(structure, columns)
    total, n = gram[1, 1], columns.shape[1]
    centre = gram[0, MOVES] / total
    turned_twice = centrifugal[:, :, MODES, MODES].transpose(2, 0, 3, 1)
    return {
        "totalMass": np.array(total),
        "Mtt": total * np.eye(3),
        "inertiaLocal": centrifugal[:, :, 0, 0],
        "chiU": centre,
        "chiUtilde": np.cross(centre, np.eye(3)).T,
        "mPhitTPsi": gram[MOVES, MODES],
        "mPhitTPsiTilde": -spin[:, MOVES, MODES].transpose(1, 2, 0).reshape(3, 3 * n),
        "mXRefTildePsi": spin[:, 0, MODES],
        "mXRefTildePsiTilde": centrifugal[:, :, 0, MODES].transpose(0, 2, 1).reshape(3, 3 * n),
        "mPsiTildePsi": spin[:, MODES, MODES].transpose(1, 0, 2).reshape(3 * n, n),
        "mPsiTildePsiTilde": turned_twice.reshape(3 * n, 3 * n),
    }


def export(body: ehd.ReducedBody, structure: ehd.Structure, path: Path) -> Path:
    """Write a body for Exudyn; the body must have kept its basis.

    Mesh nodes for markers are those of the bore, then each boundary point, the mean of its
    surface: it moves with the frame as a node does.

    Raises
    ------
    InputError
        Exudyn cannot hold it: it has no modes, is clamped, or has flexibility without mass.
    """
    if not body.modes or body.frame == "clamped" or body.residual is not None:
        raise ehd.errors.InputError(
            "Exudyn moves a free body whose coordinates all have mass: M1, M2, M3"
        )
    points, n = list(body.points.values()), body.modes
    nodes = np.vstack([body.bore_nodes, *(row[:, :1].T for row in points)])
    basis = np.concatenate([body.bore_basis, *(row[None, :, 3:] for row in points)])
    arrays: dict[str, Any] = {
        "fileVersion": 1,
        "type": "ObjectFFRFreducedOrderInterface",
        "rigidBodyNodeType": "NodeType.RotationEulerParameters",
        # Exudyn searches this entry for a key, which a text does not contain.
        "postProcessingModes": "",
        "infoList": [n, len(nodes), 3, 4, 7, 7 + n],
        "modeBasis": basis.reshape(-1, n),
        "xRef": nodes.ravel(),
        "trigList": np.zeros((0, 3), dtype=np.int64),
        "massMatrixReduced": body.mass,
        "stiffnessMatrixReduced": body.stiffness,
        **couplings(structure, body.columns),
    }
    np.savez(path, **arrays)
    return path


def add_body(mbs: Any, path: Path, **motion: Any) -> dict[str, Any]:
    """Add the body to an Exudyn system, a ``MainSystem`` that is not assembled yet.

    `motion` are arguments of Exudyn's ``AddObjectFFRFreducedOrder``: ``positionRef`` (where the
    bore's centre lies), ``rotationMatrixRef``, ``initialVelocity``, ``initialAngularVelocity``,
    ``gravity``, ``stiffnessProportionalDamping``.
    """
    from exudyn.FEM import ObjectFFRFreducedOrderInterface

    interface = ObjectFFRFreducedOrderInterface()
    interface.LoadFromFile(str(path), mode="NPZ")
    return interface.AddObjectFFRFreducedOrder(mbs, **motion)


def frequencies(path: Path) -> np.ndarray:
    """Frequencies of the free part from Exudyn [Hz]; six of them are zero except for round-off."""
    import exudyn
    from exudyn.solver import ComputeODE2Eigenvalues

    container = exudyn.SystemContainer()
    mbs = container.AddSystem()
    add_body(mbs, path)
    mbs.Assemble()
    return np.asarray(ComputeODE2Eigenvalues(mbs, convert2Frequencies=True)[0])


def free_frequencies(body: ehd.ReducedBody) -> np.ndarray:
    """Elastic frequencies of the free part [Hz], without rigid motion."""
    share = body.rigid_coupling.T @ np.linalg.solve(body.rigid_mass, body.rigid_coupling)
    return np.sqrt(eigh(body.stiffness, body.mass - share, eigvals_only=True)) / (2 * np.pi)


def main() -> tuple[np.ndarray, np.ndarray]:
    """Print the frequencies of the rod [Hz] from Exudyn and from the reduction."""
    from mpi4py import MPI

    from fenics_ehd.scenes.part import elastic_part

    rod = ehd.read_scene("slider-crank-paper").bodies["rod"]
    structure = elastic_part(rod, "rod", "lagrange", MPI.COMM_SELF).source
    body = ehd.load_dependent(structure, 6, 31, keep_basis=True, estimate_error=False)
    with TemporaryDirectory() as folder:
        path = export(body, structure, Path(folder, "rod.npz"))
        return frequencies(path)[6:], free_frequencies(body)


if __name__ == "__main__":
    for by_exudyn, by_reduction in zip(*main(), strict=True):
        print(f"{by_exudyn:14.3f} Hz  {by_reduction:14.3f} Hz")
