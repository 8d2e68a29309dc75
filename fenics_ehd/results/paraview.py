"""ParaView series of a run: moving bodies and films in space.

The file ``run.pvd`` opens a multi-block file for each time, whose blocks are the bodies and films
of the mechanism. A flexible body is its complete part, displaced by the recorded elastic
coordinates and residual patterns. Any other body is drawn as lines from its origin to its points. A
film is drawn on its bore, with pressure, gap and fluid fraction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import claim
from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.recorded_quantities import FilmResult
from fenics_ehd.multibody.shaft import ShaftBody
from fenics_ehd.reduction.body import ReducedBody, bore_fields
from fenics_ehd.reduction.part_files import BasisFile
from fenics_ehd.reduction.residual_completion import pattern_fields
from fenics_ehd.reduction.structure import Structure
from fenics_ehd.results.motion import RecordedMotion, nearest_steps

#: Names of quadratic cells in meshio, by their number of nodes.
CELL_NAMES = {20: "hexahedron20", 10: "tetra10"}

#: Largest difference between bore rows of a basis and of its body, over the largest bore row.
AGREEMENT = 1e-6


@dataclass(frozen=True, eq=False)
class PartFields:
    """A complete part on one rank, with the displacement fields of its recorded coordinates.

    Attributes
    ----------
    nodes
        Positions of the nodes, shape (p, 3) [m].
    cells
        Nodes of every cell in the order of VTK's quadratic hexahedron or tetrahedron, shape (c, 20
        or 10).
    basis
        Displacements of the nodes for unit elastic coordinates, shape (p, 3, n) [m].
    patterns
        Displacements of the nodes for unit amplitudes of the residual patterns (M4), shape
        (p, 3, r) [m/Pa]; r = 0 for other reduction methods.
    """

    nodes: np.ndarray
    cells: np.ndarray
    basis: np.ndarray
    patterns: np.ndarray

    def displacement(self, coordinates: np.ndarray, quasi_static: np.ndarray) -> np.ndarray:
        """Elastic displacement of the nodes, shape (p, 3) [m].

        Parameters
        ----------
        coordinates, amplitudes
            Elastic coordinates, shape (n,), and amplitudes of residual patterns, shape (r,).
        """
        return self.basis @ coordinates + self.patterns @ quasi_static


def gather_part(structure: Structure, body: ReducedBody, columns: np.ndarray) -> PartFields | None:
    """Collect a distributed part with its displacement fields on rank 0; None on other ranks.

    Parameters
    ----------
    structure, body
        Structure of the part, and its reduced body.
    columns
        Basis of displacement fields of the complete part: rows of the dofs of this rank, shape
        (dofs, n).

    Raises
    ------
    SettingsError
        The structure has no elements.
    VerificationError
        Raised by `pattern_fields`.
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


def part_of_basis(file: BasisFile, body: ReducedBody) -> PartFields | None:
    """Complete part from a basis file; None if the basis belongs to another body.

    Basis files contain no residual patterns (M4); these patterns move only the nodes of bores.
    """
    nodes = file.nodes
    moved = bore_fields(body)
    distance, bore = cKDTree(nodes).query(body.positions())
    if distance.max() > 1e-9 or not len(file.cells) or file.modes != body.modes:
        return None
    basis = np.moveaxis(file.displacement(np.eye(file.modes)), 0, -1)
    rows = body.bore_basis
    at_bores = basis[bore]
    # The sign of a mode is arbitrary, and may differ between two reductions of a part.
    signs = np.where(np.einsum("mcn,mcn->n", rows, at_bores) < 0, -1.0, 1.0)
    if np.abs(signs * at_bores - rows).max(initial=0.0) > AGREEMENT * np.abs(rows).max(initial=0.0):
        return None
    fields = np.zeros((len(nodes), 3, moved.shape[2]))
    fields[..., : body.modes] = signs * basis
    fields[bore] = moved
    return PartFields(nodes, file.cells, *np.split(fields, [body.modes], axis=2))


def parts_of_bases(bodies: Mapping[str, Body], bases: Sequence[str]) -> dict[str, PartFields]:
    """Complete parts of flexible bodies by name, from their basis files.

    Raises
    ------
    SettingsError
        A basis belongs to none of the bodies; the message has the names of the bodies.
    """
    reduced = {n: body.reduced for n, body in bodies.items() if body.reduced is not None}
    parts: dict[str, PartFields] = {}
    for path in bases:
        with BasisFile(path) as file:
            candidates = {name: part_of_basis(file, part) for name, part in reduced.items()}
        fitting = {name: part for name, part in candidates.items() if part is not None}
        if not fitting:
            sizes = ", ".join(f"{name} of {part.modes} modes" for name, part in reduced.items())
            raise SettingsError(
                f"--basis {path}: the basis fits no flexible body of the run; flexible bodies: "
                f"{sizes or 'none'}"
            )
        parts |= fitting
    return parts


#: Names of the fields that ParaView shows first.
DISPLACEMENT = "displacement_m"
PRESSURE = "pressure_Pa"

#: Names of a film's cells in meshio by family, and the order of their nodes in VTK.
FILM_CELLS = {
    "bilinear": ("quad", [0, 1, 3, 2]),
    "serendipity": ("quad8", [0, 1, 3, 2, 4, 6, 7, 5]),
    "lagrange": ("quad9", [0, 1, 3, 2, 4, 6, 7, 5, 8]),
}

#: Largest distance between a node of a part and the pressure node at its position, over the bore's
#: radius.
_SAME = 1e-4


@dataclass(frozen=True, eq=False)
class Block:
    """Mesh and fields of one body or film of a ParaView series, at t instants.

    Attributes
    ----------
    group, name
        Group, ``bodies`` or ``films``, and name of the body or film.
    kind, cells
        Meshio's name of the cells, and node indices of each cell, shape (c, k).
    points, displacement
        Positions and elastic displacements of the nodes, each of shape (t, p, 3) [m].
    fields
        Scalar fields at the nodes by name, shape (t, p).
    """

    group: str
    name: str
    kind: str
    cells: np.ndarray
    points: np.ndarray
    displacement: np.ndarray
    fields: Mapping[str, np.ndarray]


def moved_along(
    poses: np.ndarray, points: np.ndarray, displacement: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Transform points and displacements from a moving frame to space.

    Both results have the shape (t, p, 3) [m].

    Parameters
    ----------
    poses
        Poses of the frame, ``(x, y, angle)``, shape (t, 3) [m], [rad].
    points, displacement
        Positions, shape (p, 3), and displacements, shape (t, p, 3), in the moving frame [m].
    """
    turns = Rotation.from_euler("z", poses[:, 2, None]).as_matrix().transpose(0, 2, 1)
    origins = np.pad(poses[:, None, :2], [(0, 0), (0, 0), (0, 1)])
    return origins + points @ turns, displacement @ turns


def part_block(replay: RecordedMotion, name: str, part: PartFields) -> Block:
    """Block of a flexible body: the nodes of its part, and the film pressure on its bores."""
    body = replay.part(name)
    distance, nearest = cKDTree(body.positions(of_pressures=True)).query(part.nodes)
    on_bore = distance < _SAME * min(bore.radius for bore in body.bores.values())
    pressure = np.where(on_bore, replay.bore_pressure(name)[:, nearest], 0.0)
    states = zip(*replay.elastic(name), strict=True)
    bent = np.array([part.displacement(*state) for state in states])
    there = moved_along(replay.marker(name, ""), part.nodes, bent)
    kind = CELL_NAMES[part.cells.shape[1]]
    return Block("bodies", name, kind, part.cells, *there, {PRESSURE: pressure})


def line_block(replay: RecordedMotion, name: str) -> Block:
    """Block of a body without a complete part: lines from origin to points, or along a shaft."""
    body = replay.bodies[name]
    coordinates = replay.coordinates(name)
    points = ["", *body.point_names]
    first = np.zeros(len(points) - 1, dtype=int)
    if isinstance(body, ShaftBody):
        points = sorted(body.points, key=body.points.__getitem__) or [""]
        first = np.arange(len(points) - 1)
    kind = "line"
    cells = np.column_stack([first, np.arange(1, len(first) + 1)])
    if len(points) == 1:
        kind = "vertex"
        cells = np.array([[0]])
    # Coordinates on which films depend are small motions, all other coordinates large motions.
    resting = np.where(body.weights < 1.0, 0.0, coordinates)
    there, rest = (
        np.stack([replay.marker(name, point, z) for point in points], axis=1)
        for z in (coordinates, resting)
    )
    moved = there - rest
    moved[..., 2] = 0.0
    rest[..., 2] = [height_at(replay, name, point) for point in points]
    return Block("bodies", name, kind, cells, rest, moved, {})


def film_block(replay: RecordedMotion, binding: FilmBinding, film: FilmResult) -> Block:
    """Block of a film on the surface of its bore, which moves and deforms with the bore's body."""
    kind, order = FILM_CELLS[film.family]
    angle = np.asarray(film.angle)
    height = np.asarray(film.height)
    local = np.column_stack([film.radius * np.cos(angle), film.radius * np.sin(angle), height])
    bore, journal = binding.surfaces
    poses = replay.marker(bore.body, bore.marker.partition(".")[2])
    bent = np.zeros((len(poses), *local.shape))
    centre = bore.surface.centre
    local[:, 2] += height_at(replay, journal.body, journal.point) if centre is None else centre[2]
    displacement = bore.surface.displacement(angle, height)
    if displacement is not None:
        bent = np.tensordot(np.hstack(replay.elastic(bore.body)), displacement, (1, 2))
    fields = {PRESSURE: film.pressure, "gap_m": film.gap}
    if film.fluid_fraction is not None:
        fields["fluid_fraction"] = film.fluid_fraction
    there = moved_along(poses, local, bent)
    return Block("films", binding.name, kind, film.cells[:, order], *there, fields)


def height_at(replay: RecordedMotion, name: str, point: str) -> float:
    """Height of a point of a body [m]: on a shaft, the distance from its first end, otherwise 0.

    If the height of a bore is known, all heights on the shaft in it are shifted by the same length,
    so that the journal is at the height of the bore's centre.
    """
    body = replay.bodies[name]
    if not isinstance(body, ShaftBody):
        return 0.0
    length = body.length
    start = 0.0
    for binding in replay.system.films:
        bore, journal = binding.surfaces
        if journal.body == name and bore.surface.centre is not None:
            start = float(bore.surface.centre[2]) - length * body.points[journal.point]
    return start + length * body.points.get(point, 0.0)


#: Name of the file in a series that ParaView opens.
SERIES = "run.pvd"


def write_run(
    mechanism: Mechanism,
    result: History,
    parts: Mapping[str, PartFields],
    directory: Path,
    frames: int,
) -> Path:
    """Write steps of a run, evenly spaced in time, as a ParaView series.

    Parameters
    ----------
    mechanism, result
        Mechanism and history of the run, with nodal fields.
    parts
        Complete parts of flexible bodies by name; bodies without a part are drawn as lines.
    directory
        Folder of the files.
    frames
        Largest number of steps to write.

    Returns
    -------
    Path
        Path of ``run.pvd``, see `write_series`.
    """
    chosen = nearest_steps(result.time, frames)
    shown = result.each(lambda values: values[chosen])
    replay = RecordedMotion(mechanism, shown)
    blocks = [
        part_block(replay, name, parts[name]) if name in parts else line_block(replay, name)
        for name in replay.bodies
    ]
    blocks += [film_block(replay, p, shown.joints[p.name].film) for p in replay.system.films]
    return write_series(directory, shown.time, blocks)


def write_series(directory: Path, times: np.ndarray, blocks: Sequence[Block]) -> Path:
    """Write ``run.pvd``, which opens one multi-block ``.vtm`` file for each time.

    Parameters
    ----------
    directory
        Folder of the files.
    times
        Times of the instants, shape (t,) [s].
    blocks
        Bodies and films at these instants.

    Returns
    -------
    Path
        Path of ``run.pvd``, which has times in seconds. Points move with the bodies.
        ``displacement_m`` is the elastic displacement, for ParaView's filter "Warp By Vector".
        ``pressure_Pa`` is the film pressure, on films and on complete parts, where it is zero
        outside of bores. ``gap_m`` is the film thickness.
    """
    frames = [(f"run_{i:04d}.vtm", float(time)) for i, time in enumerate(times)]
    files = [
        [f"{block.group}-{block.name}_{i:04d}.vtu" for block in blocks] for i in range(len(times))
    ]
    claim(directory, [SERIES, *(frame for frame, _ in frames), *chain(*files)])
    for i, (frame, _) in enumerate(frames):
        groups: dict[str, list[tuple[str, str]]] = {}
        for block, file in zip(blocks, files[i], strict=True):
            _write_block(directory / file, block, i)
            groups.setdefault(block.group, []).append((block.name, file))
        (directory / frame).write_text(_multi_block(groups))
    series = directory / SERIES
    lines = [
        f'    <DataSet timestep="{time:.9e}" part="0" file={quoteattr(file)}/>'
        for file, time in frames
    ]
    series.write_text(_xml("Collection", ["  <Collection>", *lines, "  </Collection>"]))
    return series


def _write_block(path: Path, block: Block, instant: int) -> None:
    data = {DISPLACEMENT: block.displacement[instant]}
    data |= {name: np.asarray(values[instant]) for name, values in block.fields.items()}
    meshio.Mesh(block.points[instant], [(block.kind, block.cells)], point_data=data).write(path)
    # ParaView shows these fields first; meshio does not write their names.
    scalars = f' Scalars="{PRESSURE}"' if PRESSURE in block.fields else ""
    named = f'<PointData{scalars} Vectors="{DISPLACEMENT}">'.encode()
    path.write_bytes(path.read_bytes().replace(b"<PointData>", named, 1))


def _multi_block(groups: Mapping[str, Sequence[tuple[str, str]]]) -> str:
    """Text of a multi-block file; `groups` has the name and file path of every block by group."""
    lines = ["  <vtkMultiBlockDataSet>"]
    for number, (group, members) in enumerate(groups.items()):
        lines.append(f'    <Block index="{number}" name={quoteattr(group)}>')
        lines += [
            f'      <DataSet index="{i}" name={quoteattr(name)} file={quoteattr(file)}/>'
            for i, (name, file) in enumerate(members)
        ]
        lines.append("    </Block>")
    return _xml("vtkMultiBlockDataSet", [*lines, "  </vtkMultiBlockDataSet>"])


def _xml(kind: str, lines: Sequence[str]) -> str:
    head = f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian">'
    return "\n".join(['<?xml version="1.0"?>', head, *lines, "</VTKFile>", ""])
