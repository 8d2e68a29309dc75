"""A reduced body for Exudyn: input of its floating frame of reference with reduced order.

Exudyn (https://github.com/jgerstmayr/EXUDYN) moves a body by a reference frame and modal
coordinates, A. Zwoelfer and J. Gerstmayr, Acta Mechanica 232 (2021) 835. Its inertia couplings
are made of `SpatialInertia`: with ``~`` for the matrix of a cross product, column c of ``psi~``
is ``psi x e_c = -S_c psi``.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from fenics_ehd.errors import ExportError
from fenics_ehd.reduction import exudyn_body
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.export import write_npz
from fenics_ehd.reduction.spatial_inertia import FIRST_MODE, SpatialInertia

#: Largest difference of the inertia couplings' mass matrix from the body's, relative.
SAME_BODY = 1e-6

#: Corners of a surface cell with their neighbours on its edges, then what is left between the
#: edges, by family, in dolfinx order.
_TRIANGLES = {
    8: ((0, 4, 5), (1, 6, 4), (2, 5, 7), (3, 7, 6), (4, 6, 7), (4, 7, 5)),
    6: ((0, 5, 4), (1, 3, 5), (2, 4, 3), (3, 4, 5)),
}


def export_exudyn(
    body: ReducedBody, path: str | Path, spatial: SpatialInertia | None = None
) -> Path:
    """Write a body as one ``.npz`` for Exudyn, and the script `exudyn_body` beside it.

    ``add_body`` of that script puts the body into an Exudyn system, without fenics_ehd. The
    file has the keys of Exudyn's ``ObjectFFRFreducedOrderInterface.SaveToFile``, whose
    ``LoadFromFile`` reads it as well, and some more; existing files are replaced. With m nodes
    of the bore, b boundary points, n modes and k pressure nodes it holds, in SI units:

    ``format``, ``fileVersion``, ``type``, ``rigidBodyNodeType``, ``postProcessingModes``
        Text and numbers that Exudyn and `exudyn_body` ask for.
    ``infoList``
        Shape (6,): n, m + b, 3, 4, 7, 7 + n.
    ``modeBasis``, ``xRef``
        Displacement for unit coordinates, shape (3 (m + b), n), and position, shape
        (3 (m + b),) [m], of the bore's nodes, then of each boundary point, the mean of
        its surface; rows ``3 * node + component``.
    ``trigList``
        Triangles of the bore's surface, shape (t, 3), for drawing.
    ``massMatrixReduced``, ``stiffnessMatrixReduced``
        ``T^T M T`` [kg] and ``T^T K T`` [N/m], shape (n, n).
    ``totalMass``, ``Mtt``
        Mass [kg], alone and times the unit matrix (3, 3).
    ``inertiaLocal``
        Inertia tensor about the bore's centre, shape (3, 3) [kg m^2].
    ``chiU``, ``chiUtilde``
        Centre of mass from the bore's centre, shape (3,), and the matrix of its cross
        product, shape (3, 3) [m].
    ``mPhitTPsi``, ``mPhitTPsiTilde``
        Coupling of translations with modes, shape (3, n), and turned modes, (3, 3 n) [kg].
    ``mXRefTildePsi``, ``mXRefTildePsiTilde``
        The same of rotations about the bore's centre [kg m].
    ``mPsiTildePsi``, ``mPsiTildePsiTilde``
        The same of turned modes, shapes (3 n, n) and (3 n, 3 n) [kg].
    ``frequencies``
        Natural frequency of each coordinate taken alone, shape (n,) [Hz].
    ``load_projection``, ``rigid_load``
        Generalised force of nodal pressures on the modes, shape (n, k), and their force [m^2]
        and moment [m^3] about the bore's centre, shape (6, k), in the part's axes.
    ``pressure_nodes``
        Their positions, shape (k, 3) [m].
    ``bore_node_count``, ``point_names``
        m, and the names of the b boundary points.
    ``method``, ``frame``
        Text, as in `ReducedBody`.

    Parameters
    ----------
    body
        With a frame at the mean axis or at the bore's centre.
    path
        File; ``.npz`` is added when it has another ending.
    spatial
        Its inertia couplings, see `spatial_inertia`; those in the body when None.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ExportError
        Exudyn has no way to hold this body: it has residual flexibility (M4), is clamped, has no
        modes; or its inertia couplings are unknown or another body's.
    """
    _refuse(body)
    spatial = _couplings_of(body, spatial)
    written = write_npz(path, exudyn_arrays(body, spatial))
    shutil.copyfile(exudyn_body.__file__, written.with_name("exudyn_body.py"))
    return written


def _refuse(body: ReducedBody) -> None:
    if body.residual is not None and body.residual.rank:
        raise ExportError(
            f"this {body.method} body has {body.residual.rank} residual patterns, flexibility "
            "without mass, and Exudyn knows no coordinate without mass: reduce with m3 or full "
            "(m3 with body.residual.patterns.T as pressure set, all kept, bends alike)"
        )
    if body.frame == "clamped":
        raise ExportError(
            "this body was clamped when it was reduced and has no frame to move: give Exudyn "
            "its stiffness and mass of export_npz in an ObjectGenericODE2, or reduce it free"
        )
    if not body.modes:
        raise ExportError(
            "this body is rigid: give Exudyn its rigid_mass of export_npz as a rigid body"
        )
    if not body.rigid_mass.size:
        raise ExportError("the body's rigid_mass is empty, its inertia unknown: reduce it again")


def _couplings_of(body: ReducedBody, spatial: SpatialInertia | None) -> SpatialInertia:
    """The given couplings, or the body's own, if they belong to it."""
    found = spatial if spatial is not None else getattr(body, "spatial", None)
    if found is None:
        raise ExportError(
            "the body does not hold how its modes couple with rotations in space: give "
            "spatial = spatial_inertia(structure, MassOperator(structure.mass), body.columns), "
            "with columns kept by keep_basis when the part was reduced"
        )
    if found.modes != body.modes:
        raise ExportError(f"spatial has {found.modes} modes, the body has {body.modes}")
    ours = _free_mass(body.rigid_mass, body.rigid_coupling, body.mass)
    size = np.sqrt(np.diag(ours))
    defect = np.abs((_mass_of(found) - ours) / np.outer(size, size)).max()
    if not defect <= SAME_BODY:
        raise ExportError(
            f"spatial is of other modes than the body: its mass matrix differs by {defect:.1e}, "
            f"limit {SAME_BODY:.0e}"
        )
    return found


def _free_mass(rigid: np.ndarray, coupling: np.ndarray, elastic: np.ndarray) -> np.ndarray:
    """Mass matrix of the six rigid motions and the modes, shape (6 + n, 6 + n)."""
    return np.block([[rigid, coupling], [coupling.T, elastic]])


def _mass_of(spatial: SpatialInertia) -> np.ndarray:
    """The same of inertia couplings."""
    s, e = spatial, slice(FIRST_MODE, None)
    moves = slice(1, FIRST_MODE)
    # (e_c x x) M F = -x M S_c F = -spin[c][0]
    turning = -s.spin[:, 0]
    rigid = np.block(
        [[s.mass[moves, moves], turning[:, moves].T], [turning[:, moves], s.inertia_tensor]]
    )
    return _free_mass(rigid, np.vstack([s.mass[moves, e], turning[:, e]]), s.mass[e, e])


def exudyn_arrays(body: ReducedBody, spatial: SpatialInertia) -> dict[str, np.ndarray]:
    """Contents of the file by key, see `export_exudyn`."""
    nodes, basis = _mesh_nodes(body)
    n = body.modes
    return {
        "format": np.array(exudyn_body.FORMAT),
        "fileVersion": np.array(1),
        "type": np.array("ObjectFFRFreducedOrderInterface"),
        "rigidBodyNodeType": np.array("NodeType.RotationEulerParameters"),
        # Exudyn looks for a key in it: in a text there is none, and a text is no pickle.
        "postProcessingModes": np.array(""),
        "infoList": np.array([n, len(nodes), 3, 4, 7, 7 + n]),
        "modeBasis": basis.reshape(-1, n),
        "xRef": nodes.ravel(),
        "trigList": bore_triangles(body),
        "massMatrixReduced": body.mass,
        "stiffnessMatrixReduced": body.stiffness,
        **couplings(spatial),
        "frequencies": body.frequencies,
        "load_projection": body.load_projection[3:],
        "rigid_load": body.rigid_load,
        "pressure_nodes": body.pressure_nodes,
        "bore_node_count": np.array(len(body.bore_nodes)),
        "point_names": np.array(list(body.points), dtype=str),
        "method": np.array(body.method),
        "frame": np.array(body.frame),
    }


def couplings(spatial: SpatialInertia) -> dict[str, np.ndarray]:
    """Constant matrices of Exudyn's equations, column ``3 * mode + axis`` of turned modes."""
    s, n = spatial, spatial.modes
    e, moves = slice(FIRST_MODE, None), slice(1, FIRST_MODE)
    centre = s.centre_of_mass
    return {
        "totalMass": np.array(s.total_mass),
        "Mtt": s.total_mass * np.eye(3),
        "inertiaLocal": s.inertia_tensor,
        "chiU": centre,
        "chiUtilde": np.cross(centre, np.eye(3)).T,
        "mPhitTPsi": s.mass[moves, e],
        "mPhitTPsiTilde": -s.spin[:, moves, e].transpose(1, 2, 0).reshape(3, 3 * n),
        "mXRefTildePsi": s.spin[:, 0, e],
        "mXRefTildePsiTilde": s.centrifugal[:, :, 0, e].transpose(0, 2, 1).reshape(3, 3 * n),
        "mPsiTildePsi": s.spin[:, e, e].transpose(1, 0, 2).reshape(3 * n, n),
        "mPsiTildePsiTilde": s.centrifugal[:, :, e, e].transpose(2, 0, 3, 1).reshape(3 * n, 3 * n),
    }


def _mesh_nodes(body: ReducedBody) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m + b, 3) and basis (m + b, 3, n) of the bore's nodes and boundary points."""
    rows = list(body.points.values())
    if not rows:
        return body.bore_nodes, body.bore_basis
    # The mean of a surface moves with the frame as a node does: both are affine.
    positions = np.array([row[:, 0] for row in rows])
    basis = np.array([row[:, 3:] for row in rows])
    return np.vstack([body.bore_nodes, positions]), np.concatenate([body.bore_basis, basis])


def bore_triangles(body: ReducedBody) -> np.ndarray:
    """Triangles of the bore's surface mesh, normals to the axis, shape (t, 3); none if unknown."""
    if not body.bore_cells.size:
        return np.zeros((0, 3), dtype=np.int64)
    pattern = np.array(_TRIANGLES[6 if body.bore_cells.shape[1] == 6 else 8])
    found = body.bore_cells[:, pattern].reshape(-1, 3)
    x = body.bore_nodes[found]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    outward = np.einsum("ti,ti->t", normal[:, :2], x[:, 0, :2]) > 0.0
    found[outward] = found[outward][:, [0, 2, 1]]
    return found
