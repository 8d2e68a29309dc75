"""Deformed parts with film pressure for ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.reduction import ReducedBody, Structure
from fenics_ehd.reduction.residual_flexibility import pattern_fields
from fenics_ehd.results.motion import read_motion
from fenics_ehd.results.replay import Replay

#: meshio's names of quadratic cells, by their number of nodes.
CELL_NAMES = {20: "hexahedron20", 10: "tetra10"}


@dataclass(frozen=True, eq=False)
class PartFields:
    """The whole part on one rank, its displacement from what a run records.

    Attributes
    ----------
    nodes
        shape (p, 3) [m].
    cells
        In the order of VTK's quadratic hexahedron or tetrahedron, shape (c, 20 or 10).
    basis
        Displacements of unit elastic coordinates, shape (p, 3, n) [m].
    patterns
        Displacements of unit residual patterns (M4), shape (p, 3, r) [m/Pa]; r = 0 for others.
    """

    nodes: np.ndarray
    cells: np.ndarray
    basis: np.ndarray
    patterns: np.ndarray

    def displacement(self, coordinates: np.ndarray, quasi_static: np.ndarray) -> np.ndarray:
        """Elastic displacement for coordinates (n,) and amplitudes (r,), shape (p, 3) [m]."""
        return self.basis @ coordinates + self.patterns @ quasi_static


def gather_part(structure: Structure, body: ReducedBody, columns: np.ndarray) -> PartFields | None:
    """Collect nodes, cells and displacements of a distributed part on rank 0; None elsewhere.

    Parameters
    ----------
    structure, body
        The part and its reduction.
    columns
        The part-size basis, owned rows.

    Raises
    ------
    SettingsError
        The structure holds no elements.
    VerificationError
        From `pattern_fields`.
    """
    if structure.recovery is None:
        raise SettingsError("the structure has no elements: displacement fields need them")
    patterns = pattern_fields(structure, body, columns)
    parts = structure.comm.gather(
        (structure.coordinates, structure.recovery.cells, columns, patterns)
    )
    if parts is None:
        return None
    nodes, cells, *fields = (np.concatenate(pieces) for pieces in zip(*parts, strict=True))
    basis, patterns = (f.reshape(len(nodes), 3, f.shape[1]) for f in fields)
    return PartFields(nodes, cells, basis, patterns)


def write_bodies(
    mechanism: Mechanism, parts: Mapping[str, PartFields], directory: Path, frames: int
) -> list[Path]:
    """Write flexible bodies at recorded steps, evenly spread over a run, to ``DIR/vtk``.

    Parameters
    ----------
    mechanism
        Of the run.
    parts
        Whole parts by the name of their body.
    directory
        Of the run.
    frames
        At most how many steps.

    Returns
    -------
    list of Path
        See `write_series`.

    Raises
    ------
    InputError
        The folder holds no history.
    """
    replay = Replay(mechanism, read_motion(directory, mechanism).nearest(frames))
    return [
        write_series(
            directory / "vtk",
            name,
            part,
            replay.part(name),
            replay.motion.time,
            replay.marker(name, ""),
            *replay.elastic(name),
            replay.bore_pressure(name),
        )
        for name, part in parts.items()
    ]


def write_series(
    directory: str | Path,
    name: str,
    part: PartFields,
    body: ReducedBody,
    times: np.ndarray,
    poses: np.ndarray,
    coordinates: np.ndarray,
    quasi_static: np.ndarray,
    pressures: np.ndarray,
) -> Path:
    """Write ``NAME.pvd`` and one ``.vtu`` file for each time.

    Parameters
    ----------
    directory
        Where the files go.
    name
        Of the part.
    part
        Nodes, cells and basis.
    body
        The reduced body, for the pressure nodes of its bores.
    times
        shape (t,) [s].
    poses
        Origin [m] and angle of the part's frame [rad], (x, y, theta),
        shape (t, 3).
    coordinates
        Elastic coordinates, shape (t, n).
    quasi_static
        Amplitudes of the residual patterns, shape (t, r) [Pa].
    pressures
        Nodal pressures, bore by bore, shape (t, k) [Pa].

    Returns
    -------
    Path
        The ``.pvd`` file, times in seconds: points move with the part, the vector field
        ``displacement_m`` is the elastic one, to be warped by; ``pressure_Pa`` is that of
        the films on the bores and zero elsewhere.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    bores = body.bores.values()
    places = np.vstack([bore.centre + bore.pressure_coordinates for bore in bores])
    distance, nearest = cKDTree(places).query(part.nodes)
    on_bore = distance < 1e-4 * min(bore.radius for bore in bores)
    entries = []
    for i, (time, pose) in enumerate(zip(times, poses, strict=True)):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        origin = np.array([pose[0], pose[1], 0.0])
        displacement = part.displacement(coordinates[i], quasi_static[i])
        pressure = np.where(on_bore, pressures[i][nearest], 0.0)
        mesh = meshio.Mesh(
            origin + part.nodes @ rotation.T,
            [(CELL_NAMES[part.cells.shape[1]], part.cells)],
            point_data={"displacement_m": displacement @ rotation.T, "pressure_Pa": pressure},
        )
        file = directory / f"{name}_{i:04d}.vtu"
        mesh.write(file)
        _choose_fields(file)
        entries.append(f'    <DataSet timestep="{time:.9e}" file="{file.name}"/>')
    collection = directory / f"{name}.pvd"
    collection.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        + "\n".join(entries)
        + "\n  </Collection>\n</VTKFile>\n"
    )
    return collection


def _choose_fields(path: Path) -> None:
    """Name the fields that ParaView shows at first, which meshio does not."""
    named = b'<PointData Scalars="pressure_Pa" Vectors="displacement_m">'
    path.write_bytes(path.read_bytes().replace(b"<PointData>", named, 1))
