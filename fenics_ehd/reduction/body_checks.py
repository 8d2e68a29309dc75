"""Is this a reduced body? What cannot be, whatever the digest of its file says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.reduction.body import BoreRows, ReducedBody
from fenics_ehd.reduction.bore_checks import SWEPT_TOLERANCE
from fenics_ehd.reduction.faces import CYLINDER_TOLERANCE, surface_load_matrix
from fenics_ehd.reduction.inertia import ELASTIC, TRANSLATIONS
from fenics_ehd.reduction.surface_checks import surface_defects

if TYPE_CHECKING:
    from scipy import sparse

#: Largest difference of two figures that are the same one, relative.
SAME = 1e-6

#: Largest difference of a mode's load from the work on its displacement, relative: what another
#: program's rule of integration may cost.
LOAD_TOLERANCE = 1e-2


def defects(body: ReducedBody) -> Iterator[str]:
    """What contradicts itself or mechanics in a body, one line each, the grossest first.

    Shapes, types, finite values; symmetric matrices, positive definite where they must be; masses
    and loads of the rigid motions, the same wherever they are stored; nodes on the bore; where its
    surface mesh is known, loads of the modes that are those of their displacements.
    """
    for check in (_surfaces, _shapes, _matrices, _rigid_motions, _bores, _loads):
        found = list(check(body))
        yield from found
        if found:
            return


def _surfaces(body: ReducedBody) -> Iterator[str]:
    return surface_defects(body.bores)


def _shapes(body: ReducedBody) -> Iterator[str]:
    n, square = body.modes, (3 + body.modes, 3 + body.modes)
    nodes = sum(len(bore.coordinates) for bore in body.bores.values())
    pressures = sum(len(bore.pressure_coordinates) for bore in body.bores.values())
    shapes = {
        "stiffness": (body.stiffness, (n, n)),
        "mass": (body.mass, (n, n)),
        "frequencies": (body.frequencies, (n,)),
        "bore_basis": (body.bore_basis, (nodes, 3, n)),
        "load_projection": (body.load_projection, (3 + n, pressures)),
        "spin_load_projection": (body.spin_load_projection, (3 + n, pressures)),
        "inertia/mass": (body.inertia.mass, square),
        "inertia/spin": (body.inertia.spin, square),
        "inertia/centrifugal": (body.inertia.centrifugal, square),
        **{f"points/{name}": (rows, (3, 3 + n)) for name, rows in body.points.items()},
    }
    if body.residual is not None:
        rank = body.residual.rank
        shapes |= {
            "residual/displacement": (body.residual.displacement, (nodes, 3, rank)),
            "residual/patterns": (body.residual.patterns, (rank, pressures)),
            "residual/stiffness": (body.residual.stiffness, (rank,)),
        }
        if body.residual.mass.size:
            shapes["residual/mass"] = (body.residual.mass, (rank, rank))
    if body.rigid_mass.size:
        shapes |= {
            "rigid_mass": (body.rigid_mass, (6, 6)),
            "rigid_coupling": (body.rigid_coupling, (6, n)),
            "rigid_load": (body.rigid_load, (6, pressures)),
        }
    if body.missing_flexibility.size:
        shapes["missing_flexibility"] = (body.missing_flexibility, (nodes, pressures))
    for name, (array, shape) in shapes.items():
        if array.shape != shape:
            yield f"{name} has shape {array.shape}, {n} modes need {shape}"
        elif array.dtype != np.float64:
            yield f"{name} holds {array.dtype}, not float64"
        elif not np.isfinite(array).all():
            yield f"{name} holds a value that is not finite"
    if len(body.kinds) != n:
        yield f"kinds names {len(body.kinds)} of {n} modes"


def _matrices(body: ReducedBody) -> Iterator[str]:
    """Symmetric, and positive definite but for the accelerations and the residual's mass."""
    named = {
        "stiffness": body.stiffness,
        "mass": body.mass,
        "inertia/mass": body.inertia.mass,
        "inertia/centrifugal": body.inertia.centrifugal,
        "rigid_mass": body.rigid_mass,
    }
    if body.residual is not None:
        named["residual/mass"] = body.residual.mass
        if not (body.residual.stiffness > 0).all():
            yield "residual/stiffness holds a value that is not positive"
    for name, matrix in named.items():
        sizes = _sizes(matrix)
        if _differ(matrix, matrix.T, sizes):
            yield f"{name} is not symmetric"
        elif name not in ("inertia/centrifugal", "residual/mass"):
            scaled = matrix / sizes if sizes.all() else -np.eye(len(matrix))
            if len(matrix) and not np.linalg.eigvalsh(scaled).min() > -1e-9:
                yield f"{name} is not positive definite"
    if _differ(body.inertia.spin, -body.inertia.spin.T, _sizes(body.inertia.mass)):
        yield "inertia/spin is not antisymmetric"


def _sizes(matrix: np.ndarray) -> np.ndarray:
    """What the entries of a positive matrix cannot exceed."""
    root = np.sqrt(np.abs(np.diag(matrix)))
    return np.outer(root, root)


def _differ(one: np.ndarray, other: np.ndarray, scale: np.ndarray | float) -> bool:
    return not bool((np.abs(one - other) <= SAME * scale).all())


def _rigid_motions(body: ReducedBody) -> Iterator[str]:
    """What the rigid motions weigh, in all the places where it stands."""
    inertia, total = body.inertia, body.inertia.total_mass
    sizes = _sizes(inertia.mass)
    turning = np.sqrt(np.abs(np.diag(inertia.centrifugal)))
    if _differ(body.mass, inertia.mass[ELASTIC, ELASTIC], sizes[ELASTIC, ELASTIC]):
        yield "mass is not that of inertia/mass"
    if _differ(inertia.mass[TRANSLATIONS, TRANSLATIONS], total * np.eye(2), total):
        yield "inertia/mass: the translations do not weigh the same"
    if not body.inertia.polar_inertia > -SAME * turning[0] ** 2:
        yield "inertia/centrifugal: a negative moment of inertia about the centre of mass"
    with np.errstate(invalid="ignore"):
        frequencies = np.sqrt(np.diag(body.stiffness) / np.diag(body.mass)) / (2 * np.pi)
    if _differ(body.frequencies, frequencies, frequencies):
        yield "frequencies are not those of stiffness and mass"
    for name, rows in body.points.items():
        if _differ(rows[:, 1:3], np.eye(3)[:, :2], 1.0):
            yield f"points/{name} does not move with the part"
    if not body.rigid_mass.size:
        return
    # Rows and columns x, y and the rotation about z, as fields 1, 2 and the turned 0.
    plane = [0, 1, 5]
    lever = turning[0] / np.sqrt(total)
    of_moves = np.array([1.0, 1.0, lever])
    moments = np.append(inertia.mass[TRANSLATIONS, 0][::-1] * [-1, 1], inertia.centrifugal[0, 0])
    expected = np.diag([total, total, 0.0])
    expected[2], expected[:, 2] = moments, moments
    rigid = body.rigid_mass[np.ix_(plane, plane)]
    if _differ(rigid, expected, total * np.outer(of_moves, of_moves)):
        yield "rigid_mass is not that of inertia/mass and inertia/centrifugal"
    coupling = np.vstack([inertia.mass[TRANSLATIONS, ELASTIC], inertia.spin[ELASTIC, 0]])
    scale = np.sqrt(total) * np.outer(of_moves, np.sqrt(np.diag(body.mass)))
    if _differ(body.rigid_coupling[plane], coupling, scale):
        yield "rigid_coupling is not that of inertia/mass and inertia/spin"


def _bores(body: ReducedBody) -> Iterator[str]:
    """Loads of the cylinders' areas."""
    load, spun = body.load_projection, body.spin_load_projection
    for rows in body.each_bore():
        bore, own = rows.surface, load[:, rows.pressures]
        x, y = bore.pressure_coordinates[:, :2].T / bore.radius
        area = 2 * np.pi * bore.radius * bore.width
        pushes = ((0, np.ones(len(x)), area * bore.radius), (1, x, area / 2), (2, y, area / 2))
        for row, pressure, swept in pushes:
            share = own[row] @ pressure / swept
            if not abs(share - 1) <= SWEPT_TOLERANCE:
                yield (
                    f"load_projection: a pressure in {rows.name} pushes with {share:.3g} times "
                    "its area"
                )
    scale = np.abs(load[TRANSLATIONS]).max(initial=0.0)
    if _differ(spun[TRANSLATIONS], np.array([load[2], -load[1]]), scale):
        yield "spin_load_projection is not load_projection turned"
    if body.rigid_load.size:
        expected = np.vstack([load[TRANSLATIONS], spun[0]])
        reach = max(b.radius + np.linalg.norm(b.centre) for b in body.bores.values())
        if _differ(body.rigid_load[[0, 1, 5]], expected, scale * np.array([[1], [1], [reach]])):
            yield "rigid_load is not that of load_projection"


def _loads(body: ReducedBody) -> Iterator[str]:
    """Loads of the modes and of the residual patterns, by their displacements of the bores."""
    for rows in body.each_bore():
        bore = rows.surface
        if not (bore.family and bore.pressure_family):
            continue
        surface = (bore.coordinates, bore.cells, bore.family)
        pressures = (bore.pressure_coordinates, bore.pressure_cells, bore.pressure_family)
        # Cells of another order, or of a mesh of the pressures' own, say nothing.
        places = [nodes[cells[:, :3]] for nodes, cells, _ in (surface, pressures)]
        if places[0].shape != places[1].shape:
            continue
        apart = np.abs(places[0] - places[1]).max(initial=0.0)
        if apart <= CYLINDER_TOLERANCE * bore.radius:
            yield from _load_defects(body, rows, surface_load_matrix(surface, pressures).T)


def _load_defects(body: ReducedBody, rows: BoreRows, work: sparse.csr_matrix) -> Iterator[str]:
    """What differs from the work that pressures do on the displacements of their own bore."""
    pairs = {"load_projection": (body.bore_basis[rows.nodes], body.load_projection[ELASTIC])}
    if body.residual is not None:
        load = body.residual.stiffness[:, None] * body.residual.patterns
        pairs["residual/patterns"] = (body.residual.displacement[rows.nodes], load)
    bore = rows.surface
    area = 2 * np.pi * bore.radius * bore.width / max(1, len(bore.pressure_coordinates))
    for name, (fields, every) in pairs.items():
        load = every[:, rows.pressures]
        expected = (work @ fields.reshape(work.shape[1], -1)).T
        size = np.abs([load, expected]).max(axis=(0, 2), initial=0.0)
        limit = LOAD_TOLERANCE * size + SAME * area * np.abs(fields).max(axis=(0, 1), initial=0.0)
        wrong = np.flatnonzero(~(np.abs(load - expected).max(axis=1, initial=0.0) <= limit))
        if len(wrong):
            yield (
                f"{name}: the load of mode {wrong[0]} is not that of its displacement of "
                f"{rows.name}"
            )
