"""Extremes between nodes and between steps: rules against runs that are refined in mesh and steps.

    python benchmarks/extremes.py [--bearings] [--machines]

The rules for a film are the largest node (for the gap Gauss points, too, as a step has them), the
interpolation of the finite elements, parabolas through the largest node and its neighbours in both
directions, cubics around through the row of the largest node, and cubics around and then along
(`fenics_ehd.base.extremes`). Those for the time are the largest step, the parabola through it
and its neighbours, Akima's curve and the cubics. A rule is judged by the error of the extreme
against that of a reference: the root mean square and the largest over all meshes of a row.

The reference of a bearing has 192 x 32 cells, that of a machine twice as many cells either way and
a thirtieth of the tolerance. Its own extreme is that of the cubics; other rules change it by less
than the digits that are printed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.spatial import cKDTree

import fenics_ehd as ehd
from fenics_ehd.base.extremes import FilmRows, between_points, over_time
from fenics_ehd.film.grid import FilmGrid

#: Curve over the steps of the largest value of a film: angle, height, values, shape (k, nodes).
FilmRule = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]

#: Extreme of a curve: times, values, period.
TimeRule = Callable[[np.ndarray, np.ndarray, float | None], float]


def largest_node(angle: np.ndarray, height: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Largest of the nodal values."""
    return values.max(axis=1)


def vertex_rise(before: np.ndarray, after: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Rise of parabolas above 0 at 0, from points before (< 0) and after, with values below 0."""
    slope_before = below[:, 0] / before
    slope_after = below[:, 1] / after
    square = (slope_after - slope_before) / (after - before)
    slope = slope_before - square * before
    return np.where(square < 0.0, -(slope**2) / (4.0 * np.where(square < 0.0, square, -1.0)), 0.0)


def parabolas(angle: np.ndarray, height: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Vertex of the parabolas through the largest node and its neighbours, around and along."""
    rows = FilmRows.of(angle, height)
    each = values[:, rows.nodes]
    found = np.empty(len(values))
    for k, field in enumerate(each):
        i, j = np.unravel_index(np.argmax(field), field.shape)
        n = len(rows.angles)
        near = rows.angles[[(j - 1) % n, j, (j + 1) % n]]
        before, after = -np.mod(near[1] - near[0], 2 * np.pi), np.mod(near[2] - near[1], 2 * np.pi)
        top = field[i, j]
        below = np.array([[field[i, j - 1] - top, field[i, (j + 1) % n] - top]])
        found[k] = top + vertex_rise(np.array([before]), np.array([after]), below)[0]
        if 0 < i < len(field) - 1:
            before, after = rows.heights[[i - 1, i + 1]] - rows.heights[i]
            below = np.array([[field[i - 1, j] - top, field[i + 1, j] - top]])
            found[k] += vertex_rise(np.array([before]), np.array([after]), below)[0]
    return found


def cubics_around(angle: np.ndarray, height: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Cubics around through the row of the largest node."""
    rows = FilmRows.of(angle, height)
    each = values[:, rows.nodes]
    best = each.max(axis=2).argmax(axis=1)
    chosen = each[np.arange(len(each)), best]
    return between_points(rows.angles, chosen, 2 * np.pi)[0]


def cubics(angle: np.ndarray, height: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Cubics around, then along."""
    return FilmRows.of(angle, height).largest(values)[0]


def elements(angle: np.ndarray, height: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolation of the finite elements, sampled about the largest node."""
    grid, order = grid_of(angle, height)
    positions = grid.node_positions
    values = values[:, order]
    found = np.empty(len(values))
    for k, nodal in enumerate(values):
        centre = positions[int(np.argmax(nodal))]
        extent = np.array([np.diff(grid.angles).max(), np.diff(grid.heights).max()])
        offsets = np.linspace(-1.0, 1.0, 21)
        for _ in range(3):
            a, z = (x.ravel() for x in np.meshgrid(*(centre[:, None] + np.outer(extent, offsets))))
            z = np.clip(z, grid.heights[0], grid.heights[-1])
            sampled = grid.interpolation(a, z) @ nodal
            best = int(np.argmax(sampled))
            centre = np.array([a[best], z[best]])
            extent = extent * 2 / 21
            found[k] = sampled[best]
    return found


def grid_of(angle: np.ndarray, height: np.ndarray) -> tuple[FilmGrid, np.ndarray]:
    """Grid with nodes at angles and heights, and the index of the node at each of its positions."""
    rows = FilmRows.of(angle, height)
    nodes = np.column_stack([np.cos(angle), np.sin(angle), height / np.ptp(height)])
    for family, step, first in (
        ("lagrange", 2, 0),
        ("lagrange", 2, 1),
        ("serendipity", 2, 0),
        ("serendipity", 2, 1),
        ("bilinear", 1, 0),
    ):
        angles = rows.angles[first::step]
        heights = rows.heights[:: 2 if family == "lagrange" else 1]
        grid = FilmGrid(1.0, np.append(angles, angles[0] + 2 * np.pi), heights, family)
        a, z = grid.node_positions.T
        wanted = np.column_stack([np.cos(a), np.sin(a), z / np.ptp(height)])
        distance, order = cKDTree(nodes).query(wanted)
        if len(wanted) == len(nodes) and distance.max() < 1e-6:
            return grid, order
    raise ValueError("the nodes are not those of a grid")


FILM_RULES: dict[str, FilmRule] = {
    "largest node": largest_node,
    "elements": elements,
    "parabolas": parabolas,
    "cubics around": cubics_around,
    "cubics": cubics,
}


def largest_step(times: np.ndarray, values: np.ndarray, period: float | None) -> float:
    """Largest value at a step."""
    return float(values.max())


def parabola(times: np.ndarray, values: np.ndarray, period: float | None) -> float:
    """Vertex of the parabola through the largest step and its neighbours."""
    k = int(np.argmax(values))
    if not 0 < k < len(values) - 1:
        return float(values[k])
    before, after = times[[k - 1, k + 1]] - times[k]
    below = values[[k - 1, k + 1]][None] - values[k]
    return float(values[k] + vertex_rise(np.array([before]), np.array([after]), below)[0])


def akima(times: np.ndarray, values: np.ndarray, period: float | None) -> float:
    """Largest value of Akima's curve."""
    fine = np.linspace(times[0], times[-1], 40 * len(times))
    return float(Akima1DInterpolator(times, values)(fine).max())


def cubic(times: np.ndarray, values: np.ndarray, period: float | None) -> float:
    """Cubics."""
    return over_time(times, values, period)[0]


TIME_RULES: dict[str, TimeRule] = {
    "largest step": largest_step,
    "parabola": parabola,
    "Akima": akima,
    "cubics": cubic,
}

#: Eccentricity ratios, and meshes of bearings by element.
ECCENTRICITIES = (0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95)
MESHES = ((24, 4), (27, 5), (32, 6), (36, 6), (48, 8))
TILT = (0.0, 2e-4)


def table(title: str, errors: Mapping[str, Sequence[float]]) -> None:
    """Rows of a table: root mean square and largest error of every rule in per cent."""
    print(f"\n{title}\n\n| rule | root mean square | largest |\n|---|---|---|")
    for rule, values in errors.items():
        own = 100 * np.abs(values)
        print(f"| {rule} | {np.sqrt(np.mean(own**2)):.3f} % | {own.max():.3f} % |", flush=True)


def bearings() -> None:
    """Peak pressure and thinnest film of rigid bearings."""
    for element in ("lagrange", "serendipity", "bilinear"):
        errors: dict[str, list[float]] = {rule: [] for rule in FILM_RULES}
        films: dict[str, list[float]] = {rule: [] for rule in FILM_RULES}
        for tilt in ((0.0, 0.0), TILT):
            for ratio in ECCENTRICITIES[: 7 if tilt == (0.0, 0.0) else 5]:
                settings = {"eccentricity": ratio, "tilt": tilt, "element": element}
                fine = bearing_curves(settings, (192, 32), cubics)
                for cells in MESHES:
                    for name, rule in FILM_RULES.items():
                        own = bearing_curves(settings, cells, rule)
                        errors[name].append(own[0] / fine[0] - 1)
                        films[name].append(own[1] / fine[1] - 1)
        table(f"Rigid bearings, {element}: peak pressure", errors)
        table(f"Rigid bearings, {element}: thinnest film", films)


SOLVED: dict[str, Any] = {}


def bearing_curves(
    settings: Mapping[str, Any], cells: tuple[int, int], rule: FilmRule
) -> tuple[float, float]:
    """Peak pressure and thinnest film of a bearing by a rule."""
    key = f"{settings} {cells}"
    if key not in SOLVED:
        SOLVED[key] = ehd.bearing(cells_around=cells[0], cells_along=cells[1], **settings)
    found = SOLVED[key]
    nodes = found.film.parameters.grid.node_positions
    s = found.settings
    angle = nodes[:, 0] + found.angle
    across = found.position[0] * np.cos(angle) + found.position[1] * np.sin(angle)
    tilted = nodes[:, 1] * (-s.tilt[0] * np.sin(angle) + s.tilt[1] * np.cos(angle))
    gap = s.clearance - across - tilted
    pressure = found.state.pressure[None]
    peak = rule(nodes[:, 0], nodes[:, 1], pressure)[0]
    return float(peak), float(-rule(nodes[:, 0], nodes[:, 1], -gap[None])[0])


#: Scene, changes, meshes of the joint with the name, cells and tolerance of the reference.
MACHINES: dict[str, tuple[str, dict[str, Any], str, Sequence[tuple[int, int]], tuple[int, int]]] = {
    "slider-crank, M4": (
        "slider-crank",
        {"bodies.rod.reduction.method": "m4"},
        "big_end",
        ((16, 4), (18, 4), (20, 5), (24, 6)),
        (48, 12),
    ),
    "four-bar": ("four-bar", {}, "rocker_end", ((16, 4), (20, 4), (24, 6)), (48, 12)),
    "loaded journal": ("loaded-journal", {}, "bearing", ((24, 4), (32, 6), (36, 6)), (72, 12)),
}

TOLERANCES = (1e-3, 1e-4)


def histories() -> Iterator[tuple[str, str, Any, Any]]:
    """Row, joint, reference, and runs with other meshes and tolerances."""
    for row, (name, changes, joint, meshes, finest) in MACHINES.items():
        reference = solved(name, changes, joint, finest, TOLERANCES[-1] / 30)
        for cells in meshes:
            for tolerance in TOLERANCES:
                yield row, joint, reference, solved(name, changes, joint, cells, tolerance)


def solved(
    name: str, changes: Mapping[str, Any], joint: str, cells: tuple[int, int], tolerance: float
) -> Any:
    """Cycle of a scene on a mesh, at a tolerance."""
    own = {f"joints.{joint}.cells": list(cells), "time.tolerance": tolerance}
    key = f"{name} {cells} {tolerance}"
    if key not in SOLVED:
        scene = ehd.read_scene(name, **changes, **own)
        machine = ehd.build(scene, bodies=BODIES.get(name), cache=False)
        BODIES[name] = machine.bodies
        SOLVED[key] = ehd.simulate(machine.mechanism, **machine.options)
        print(f"  ({key}: {len(SOLVED[key])} steps)", flush=True)
    return SOLVED[key]


BODIES: dict[str, Any] = {}


def extremes(history: Any, joint: str, film_rule: FilmRule, time_rule: TimeRule) -> np.ndarray:
    """Peak pressure and thinnest film of a history."""
    film = history.joints[joint].film
    times = np.asarray(history.time)
    angle, height = np.asarray(film.angle), np.asarray(film.height)
    curves = (np.asarray(film.pressure), -np.asarray(film.gap))
    return np.abs([time_rule(times, film_rule(angle, height, own), None) for own in curves])


def machines() -> None:
    """Peak pressure and thinnest film of machines over their cycle."""
    found: dict[str, dict[str, list[np.ndarray]]] = {}
    for row, joint, reference, history in histories():
        fine = extremes(reference, joint, cubics, cubic)
        rows = found.setdefault(row, {})
        for film_name, film_rule in FILM_RULES.items():
            own = extremes(history, joint, film_rule, cubic)
            rows.setdefault(f"{film_name}; cubics in time", []).append(own / fine - 1)
        for time_name, time_rule in TIME_RULES.items():
            own = extremes(history, joint, cubics, time_rule)
            rows.setdefault(f"cubics; {time_name}", []).append(own / fine - 1)
    for row, rules in found.items():
        for i, quantity in enumerate(("peak pressure", "thinnest film")):
            table(f"{row}: {quantity}", {k: [error[i] for error in v] for k, v in rules.items()})


def main() -> None:
    """Tables that are asked for; without an option all of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bearings", action="store_true")
    parser.add_argument("--machines", action="store_true")
    options = parser.parse_args()
    if options.bearings or not options.machines:
        bearings()
    if options.machines or not options.bearings:
        machines()


if __name__ == "__main__":
    main()
