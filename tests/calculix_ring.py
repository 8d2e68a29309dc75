"""A ring of 20-node hexahedra or 10-node tetrahedra as a deck of CalculiX and as a model."""

import shutil
import subprocess

import example_parts
import numpy as np
from foreign_parts import OUTER, RADIUS, ring_mesh

from fenics_ehd.fem.drawn_part import write_part
from fenics_ehd.fem.solid import Solid, raised
from fenics_ehd.reduction.elements import SOLIDS

YOUNG, POISSON, DENSITY = 210e9, 0.3, 7850.0

#: Tetrahedra of a hexahedron in tensor order, all about its diagonal: neighbours fit.
_KUHN = [(0, a, a | b, 7) for a in (1, 2, 4) for b in (1, 2, 4) if a != b]


def ring_solid(kind, around=12, along=2, across=1):
    """The ring's solid; its middles of edges are on cylinders."""
    points, cells, _ = ring_mesh(around, along, across)
    if kind == "hex":
        corners = cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    else:
        corners = np.concatenate([cells[:, row] for row in _KUHN])
        a, b, c, d = np.swapaxes(points[corners], 0, 1)
        turned = np.einsum("ci,ci->c", np.cross(b - a, c - a), d - a) < 0
        corners[turned] = corners[turned][:, [1, 0, 2, 3]]
    solid = raised(points, corners, kind)
    x, radii = solid.points.copy(), np.linalg.norm(points[:, :2], axis=1)
    for place, edge in enumerate(SOLIDS[kind].edges, SOLIDS[kind].corners):
        middles, ends = solid.cells[:, place], solid.cells[:, list(edge)]
        length = np.linalg.norm(solid.points[middles, :2], axis=1)
        x[middles, :2] = solid.points[middles, :2] * (radii[ends].mean(axis=1) / length)[:, None]
    return Solid(x, solid.cells, kind)


def surfaces(solid):
    """Facets of the bore and, as the boundary point, of the outer surface where x > 0."""
    facets = solid.facets()
    radius = np.linalg.norm(solid.points[facets, :2], axis=2)
    outside = (radius > 0.999 * OUTER).all(axis=1)
    return {
        "bore": facets[(radius < 1.001 * RADIUS).all(axis=1)],
        "pin": facets[outside & (solid.points[facets, 0] > -1e-9).all(axis=1)],
    }


def write_model(path, solid):
    write_part(path, solid, surfaces(solid))


def write_deck(path, solid, numbers, held=()):
    """Input of CalculiX that stores the matrices; nodes have the given numbers."""
    example_parts.write_deck(path, solid, numbers, (YOUNG, POISSON, DENSITY), held)


def run_calculix(deck):
    """Have ccx write the matrices of a deck; the job's path."""
    program = shutil.which("ccx")
    done = subprocess.run(
        [program, deck.stem], cwd=deck.parent, capture_output=True, text=True, timeout=100,
        check=False,
    )  # fmt: skip
    assert "Storing the mass matrix" in done.stdout, done.stdout[-2000:]
    return deck.with_suffix("")
