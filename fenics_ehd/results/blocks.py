"""What of a mechanism is drawn in space: parts, bodies as lines, films, each over the time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.film.transfer import interpolation_matrix
from fenics_ehd.multibody.bore_film import bore_surface
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.result import FilmResult
from fenics_ehd.multibody.shaft_body import ShaftBody
from fenics_ehd.multibody.system import FilmPlace
from fenics_ehd.reduction.body import bore_fields
from fenics_ehd.results.part_fields import CELL_NAMES, PartFields
from fenics_ehd.results.replay import Replay

#: Names of fields in a file, which ParaView shows at first.
DISPLACEMENT, PRESSURE = "displacement_m", "pressure_Pa"

#: meshio's names of a film's cells by family, with what takes their nodes to VTK's order.
FILM_CELLS = {
    "bilinear": ("quad", [0, 1, 3, 2]),
    "serendipity": ("quad8", [0, 1, 3, 2, 4, 6, 7, 5]),
    "lagrange": ("quad9", [0, 1, 3, 2, 4, 6, 7, 5, 8]),
}

#: Largest distance of a node of a part from a pressure node that it is, over the bore's radius.
_SAME = 1e-4

#: Points, elastic displacement, each (p, 3) [m], and other fields at an instant.
View = tuple[np.ndarray, np.ndarray, Mapping[str, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Block:
    """One thing that is drawn.

    Attributes
    ----------
    group, name
        ``bodies`` or ``films``, and of it.
    kind, cells
        meshio's name of its cells, and their nodes.
    at
        Of every instant by its number.
    """

    group: str
    name: str
    kind: str
    cells: np.ndarray
    at: Callable[[int], View]


def mechanism_blocks(
    replay: Replay, films: Mapping[str, FilmResult], parts: Mapping[str, PartFields]
) -> list[Block]:
    """All bodies and films of a mechanism at the instants of a replay.

    Parameters
    ----------
    replay
        Of it.
    films
        Of lubricated joints, at the same instants.
    parts
        Whole parts by body; any other is drawn as lines from its origin to its points.
    """
    bodies = [
        part_block(replay, name, parts[name]) if name in parts else line_block(replay, name)
        for name in replay.bodies
    ]
    return bodies + [film_block(replay, p, films[p.name]) for p in replay.system.films]


def part_block(replay: Replay, name: str, part: PartFields) -> Block:
    """A flexible body by the nodes of its part, with the films' pressure on its bores."""
    body, poses = replay.part(name), replay.marker(name, "")
    elastic, pressures = replay.elastic(name), replay.bore_pressure(name)
    distance, nearest = cKDTree(body.places(of_pressures=True)).query(part.nodes)
    on_bore = distance < _SAME * min(bore.radius for bore in body.bores.values())

    def at(i: int) -> View:
        turn, origin = frame(poses[i])
        moved = part.displacement(*(values[i] for values in elastic))
        pressure = np.where(on_bore, pressures[i][nearest], 0.0)
        return origin + part.nodes @ turn.T, moved @ turn.T, {PRESSURE: pressure}

    return Block("bodies", name, CELL_NAMES[part.cells.shape[1]], part.cells, at)


def line_block(replay: Replay, name: str) -> Block:
    """A body by lines from its origin to its points, or from one end of a shaft to the other."""
    body, own = replay.bodies[name], replay.coordinates(name)
    points = ["", *body.points()]
    heights = np.zeros(len(points))
    if isinstance(body, ShaftBody):
        points = sorted(body.points(), key=lambda point: body.stations[point]) or [""]
        heights = np.array([height_at(replay, name, point) for point in points])
        pairs = np.column_stack([np.arange(len(points) - 1), np.arange(1, len(points))])
    else:
        pairs = np.array([(0, i) for i in range(1, len(points))])
    # Coordinates that the films see are small motions, all others large ones.
    resting = np.where(body.weights < 1.0, 0.0, own)
    there, rest = (
        np.stack([replay.marker(name, point, z)[:, :2] for point in points], axis=1)
        for z in (own, resting)
    )

    def at(i: int) -> View:
        moved = np.column_stack([there[i] - rest[i], np.zeros(len(points))])
        return np.column_stack([rest[i], heights]), moved, {}

    alone = len(pairs) == 0
    cells = np.arange(len(points))[:, None] if alone else pairs
    return Block("bodies", name, "vertex" if alone else "line", cells, at)


def film_block(replay: Replay, place: FilmPlace, film: FilmResult) -> Block:
    """A film on its bore, which moves and bends with its body."""
    kind, order = FILM_CELLS[film.family]
    angle, height = np.asarray(film.angle), np.asarray(film.height)
    local = np.column_stack([film.radius * np.cos(angle), film.radius * np.sin(angle), height])
    point = replay.system.bore_at_rest(place).partition(".")[2]
    poses, bend = replay.marker(place.bore_body, point), np.zeros((len(local), 3, 0))
    if place.bore:
        bore, bend = _bending(replay, place, angle, height)
        local[:, 2] += bore[2]
        amplitudes = np.hstack(replay.elastic(place.bore_body))
    else:
        local[:, 2] += _journal_height(replay, place.joint)
        amplitudes = np.zeros((len(poses), 0))

    def at(i: int) -> View:
        turn, origin = frame(poses[i])
        fields = {PRESSURE: film.pressure[i], "gap_m": film.gap[i]}
        if film.fluid_fraction is not None:
            fields["fluid_fraction"] = film.fluid_fraction[i]
        return origin + local @ turn.T, (bend @ amplitudes[i]) @ turn.T, fields

    return Block("films", place.name, kind, film.cells[:, order], at)


def _bending(
    replay: Replay, place: FilmPlace, angle: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centre (3,) [m] of a flexible body's bore, displacement at nodes of its film (p, 3, n)."""
    part = replay.part(place.bore_body)
    rows = part.rows_of(place.bore)
    surface = bore_surface(rows.surface.coordinates, rows.surface.cells, rows.surface.family)
    fields = bore_fields(part)[rows.nodes]
    share = interpolation_matrix(surface, angle, height)
    moved = share @ fields.reshape(len(fields), -1)
    return rows.surface.centre, moved.reshape(len(angle), 3, -1)


def _journal_height(replay: Replay, joint: LubricatedJoint) -> float:
    """Where along z a journal in a rigid bore is: of a shaft, where its point is [m]."""
    name, _, point = joint.journal.partition(".")
    return height_at(replay, name, point)


def height_at(replay: Replay, name: str, point: str) -> float:
    """Height of a point of a body [m]: 0, but along a shaft from its first end.

    A shaft in the bore of a flexible body is there at the height of that bore.
    """
    body = replay.bodies[name]
    if not isinstance(body, ShaftBody):
        return 0.0
    length, start = body.rotor.beam.shaft.length, 0.0
    for place in replay.system.films:
        journal, _, station = place.joint.journal.partition(".")
        if journal == name and place.bore:
            centre = replay.part(place.bore_body).rows_of(place.bore).surface.centre
            start = float(centre[2]) - length * body.stations[station]
    return start + length * body.stations.get(point, 0.0)


def frame(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and origin (3,) of a frame at ``(x, y, angle)``."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn, np.array([pose[0], pose[1], 0.0])
