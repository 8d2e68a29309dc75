"""Deformed rod with film pressure for ParaView."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.errors import SettingsError
from fenics_ehd.reduction import ReducedBody, Structure

#: meshio's names of quadratic cells, by their number of nodes.
_CELL_NAMES = {20: "hexahedron20", 10: "tetra10"}


@dataclass(frozen=True, eq=False)
class PartFields:
    """The whole part on one rank: nodes (n, 3) [m], cells (c, 20 or 10), basis (n, 3, modes)."""

    nodes: np.ndarray
    cells: np.ndarray
    basis: np.ndarray


def gather_part(structure: Structure, columns: np.ndarray) -> PartFields | None:
    """Collect nodes, cells and basis of a distributed part on rank 0; None elsewhere.

    Raises
    ------
    SettingsError
        The structure holds no elements.
    """
    if structure.recovery is None:
        raise SettingsError("the structure has no elements: displacement fields need them")
    parts = structure.comm.gather((structure.coordinates, structure.recovery.cells, columns))
    if parts is None:
        return None
    nodes, cells, basis = (np.concatenate(pieces) for pieces in zip(*parts, strict=True))
    return PartFields(nodes, cells, basis.reshape(len(nodes), 3, basis.shape[1]))


def write_series(
    directory: str | Path,
    part: PartFields,
    body: ReducedBody,
    times: np.ndarray,
    poses: np.ndarray,
    coordinates: np.ndarray,
    pressures: np.ndarray,
) -> Path:
    """Write ``rod.pvd`` and one ``.vtu`` file for each time.

    Parameters
    ----------
    directory
        Where the files go.
    part
        Nodes, cells and basis.
    body
        The reduced body, for its pressure nodes.
    times
        shape (t,) [s].
    poses
        Position of the bore centre and angle of the rod's frame, (x, y, theta), shape (t, 3).
    coordinates
        Elastic coordinates, shape (t, n).
    pressures
        Nodal pressures, shape (t, k) [Pa].

    Returns
    -------
    Path
        The ``.pvd`` file: points move with the rod, the vector field
        ``displacement`` is the elastic one, to be warped by.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    reach = 1e-4 * body.bore_radius
    distance, nearest = cKDTree(body.pressure_nodes).query(part.nodes)
    on_bore = distance < reach
    entries = []
    for i, (time, pose) in enumerate(zip(times, poses, strict=True)):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        origin = np.array([pose[0], pose[1], 0.0])
        displacement = part.basis @ coordinates[i]
        pressure = np.where(on_bore, pressures[i][nearest], 0.0)
        mesh = meshio.Mesh(
            origin + part.nodes @ rotation.T,
            [(_CELL_NAMES[part.cells.shape[1]], part.cells)],
            point_data={"displacement": displacement @ rotation.T, "pressure_Pa": pressure},
        )
        name = f"rod_{i:04d}.vtu"
        mesh.write(directory / name)
        entries.append(f'    <DataSet timestep="{time:.9e}" file="{name}"/>')
    collection = directory / "rod.pvd"
    collection.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        + "\n".join(entries)
        + "\n  </Collection>\n</VTKFile>\n"
    )
    return collection
