"""Is this a reduced body? What cannot be, whatever the digest of its file says."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.bore_checks import SWEPT_TOLERANCE
from fenics_ehd.reduction.faces import CYLINDER_TOLERANCE, surface_load_matrix
from fenics_ehd.reduction.surface_elements import ELEMENTS

#: Largest difference of two figures that are the same one, relative.
SAME = 1e-6

#: Largest difference of a mode's load from the work on its displacement, relative: what another
#: program's rule of integration may cost.
LOAD_TOLERANCE = 1e-2

#: Families of the surface meshes of a bore.
_FAMILIES = ("bilinear", "serendipity", "lagrange", "triangle")


def defects(body: ReducedBody) -> Iterator[str]:
    """What contradicts itself or mechanics in a body, one line each, the grossest first.

    Shapes, types, finite values; symmetric matrices, positive definite where they must be; masses
    and loads of the rigid motions, the same wherever they are stored; nodes on the bore; where its
    surface mesh is known, loads of the modes that are those of their displacements.
    """
    for check in (_shapes, _cells, _matrices, _rigid_motions, _bore, _loads):
        found = list(check(body))
        yield from found
        if found:
            return


def _shapes(body: ReducedBody) -> Iterator[str]:
    n, nodes, pressures = body.modes, len(body.bore_nodes), len(body.pressure_nodes)
    square = (3 + n, 3 + n)
    shapes = {
        "stiffness": (body.stiffness, (n, n)),
        "mass": (body.mass, (n, n)),
        "frequencies": (body.frequencies, (n,)),
        "bore_nodes": (body.bore_nodes, (nodes, 3)),
        "bore_basis": (body.bore_basis, (nodes, 3, n)),
        "pressure_nodes": (body.pressure_nodes, (pressures, 3)),
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


def _cells(body: ReducedBody) -> Iterator[str]:
    yield from _cell_defects("bore", body.bore_cells, body.bore_family, len(body.bore_nodes))
    pressures = len(body.pressure_nodes)
    yield from _cell_defects("pressure", body.pressure_cells, body.pressure_family, pressures)


def _cell_defects(name: str, cells: np.ndarray, family: str, nodes: int) -> Iterator[str]:
    """What is wrong with one of the two surface meshes; having none is right."""
    if not cells.size and not family:
        return
    size = len(ELEMENTS[family].nodes) if family in _FAMILIES else 0
    if not size:
        yield f"{name}_family {family!r} is not one of {', '.join(_FAMILIES)}"
    elif cells.ndim != 2 or not len(cells) or cells.shape[1] != size:
        yield f"{name}_cells has shape {cells.shape}, {family} cells have {size} nodes each"
    elif cells.dtype.kind not in "iu" or not np.array_equal(np.unique(cells), np.arange(nodes)):
        yield f"{name}_cells must use each of the {nodes} nodes"


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
    if _differ(body.mass, inertia.mass[3:, 3:], sizes[3:, 3:]):
        yield "mass is not that of inertia/mass"
    if _differ(inertia.mass[1:3, 1:3], total * np.eye(2), total):
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
    moments = np.append(inertia.mass[1:3, 0][::-1] * [-1, 1], inertia.centrifugal[0, 0])
    expected = np.diag([total, total, 0.0])
    expected[2], expected[:, 2] = moments, moments
    rigid = body.rigid_mass[np.ix_(plane, plane)]
    if _differ(rigid, expected, total * np.outer(of_moves, of_moves)):
        yield "rigid_mass is not that of inertia/mass and inertia/centrifugal"
    coupling = np.vstack([inertia.mass[1:3, 3:], inertia.spin[3:, 0]])
    scale = np.sqrt(total) * np.outer(of_moves, np.sqrt(np.diag(body.mass)))
    if _differ(body.rigid_coupling[plane], coupling, scale):
        yield "rigid_coupling is not that of inertia/mass and inertia/spin"


def _bore(body: ReducedBody) -> Iterator[str]:
    """Nodes on the cylinder, and a load of the cylinder's area."""
    radius, width = body.bore_radius, body.bore_width
    if not (0 < radius < np.inf and 0 < width < np.inf):
        yield f"bore of radius {radius:g} m and width {width:g} m"
        return
    for name, nodes in (("bore_nodes", body.bore_nodes), ("pressure_nodes", body.pressure_nodes)):
        off = np.abs(np.linalg.norm(nodes[:, :2], axis=1) - radius).max(initial=0.0)
        beyond = np.abs(nodes[:, 2]).max(initial=0.0) - 0.5 * width
        if not max(off, beyond) <= CYLINDER_TOLERANCE * radius:
            yield (
                f"{name} are up to {max(off, beyond):.1e} m off the cylinder of radius "
                f"{radius:g} m and width {width:g} m"
            )
            return
    load, spun, area = body.load_projection, body.spin_load_projection, 2 * np.pi * radius * width
    x, y = body.pressure_nodes[:, :2].T / radius
    ones = np.ones(len(x))
    for row, pressure, swept in ((0, ones, area * radius), (1, x, area / 2), (2, y, area / 2)):
        share = load[row] @ pressure / swept
        if not abs(share - 1) <= SWEPT_TOLERANCE:
            yield f"load_projection: a pressure pushes with {share:.3g} times the bore's area"
    scale = np.abs(load[1:3]).max(initial=0.0)
    if _differ(spun[1:3], np.array([load[2], -load[1]]), scale):
        yield "spin_load_projection is not load_projection turned"
    if body.rigid_load.size:
        expected = np.vstack([load[1:3], spun[0]])
        if _differ(body.rigid_load[[0, 1, 5]], expected, scale * np.array([[1], [1], [radius]])):
            yield "rigid_load is not that of load_projection"


def _loads(body: ReducedBody) -> Iterator[str]:
    """Loads of the modes and of the residual patterns, by their displacements of the bore."""
    surface = (body.bore_nodes, body.bore_cells, body.bore_family)
    pressures = (body.pressure_nodes, body.pressure_cells, body.pressure_family)
    if not (body.bore_family and body.pressure_family):
        return
    # Cells of another order, or of a mesh of the pressures' own, say nothing.
    places = [nodes[cells[:, :3]] for nodes, cells, _ in (surface, pressures)]
    if places[0].shape != places[1].shape:
        return
    apart = np.abs(places[0] - places[1]).max(initial=0.0)
    if not apart <= CYLINDER_TOLERANCE * body.bore_radius:
        return
    work = surface_load_matrix(surface, pressures).T
    pairs = {"load_projection": (body.bore_basis, body.load_projection[3:])}
    if body.residual is not None:
        load = body.residual.stiffness[:, None] * body.residual.patterns
        pairs["residual/patterns"] = (body.residual.displacement, load)
    area = 2 * np.pi * body.bore_radius * body.bore_width / max(1, len(body.pressure_nodes))
    for name, (fields, load) in pairs.items():
        expected = (work @ fields.reshape(work.shape[1], -1)).T
        size = np.abs([load, expected]).max(axis=(0, 2), initial=0.0)
        limit = LOAD_TOLERANCE * size + SAME * area * np.abs(fields).max(axis=(0, 1), initial=0.0)
        wrong = np.flatnonzero(~(np.abs(load - expected).max(axis=1, initial=0.0) <= limit))
        if len(wrong):
            yield f"{name}: the load of mode {wrong[0]} is not that of its displacement of the bore"
