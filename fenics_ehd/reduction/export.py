"""A reduced body for other programs, as NumPy's ``.npz``."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np

from fenics_ehd.base.whole_file import write_whole
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.inertia import ELASTIC

FORMAT = "fenics_ehd reduced body, exported"
FORMAT_VERSION = 2


def export_npz(body: ReducedBody, path: str | Path) -> Path:
    """Write a body as one ``.npz`` of plain arrays, read by ``numpy.load`` without pickles.

    With n modes, m bore nodes, k pressure nodes and r residual patterns it holds, in SI units:

    ``format``, ``format_version``
        Text and number.
    ``method``, ``frame``, ``kinds``
        Text as in `ReducedBody`; `kinds` has shape (n,).
    ``stiffness``, ``mass``
        ``T^T K T`` [N/m] and ``T^T M T`` [kg], shape (n, n).
    ``frequencies``
        Of each coordinate taken alone, shape (n,) [Hz].
    ``bore_names``, ``bore_radius``, ``bore_width``, ``bore_centre``, ``bore_sizes``
        Of every bore: text, [m], [m], from the origin (3,) [m], and how many of the m nodes and k
        pressure nodes are its own, one bore after the other.
    ``bore_nodes``, ``pressure_nodes``
        Positions, the bores' axes along z, shapes (m, 3) and (k, 3) [m].
    ``bore_basis``
        Displacement of the bore nodes for unit coordinates, shape (m, 3, n).
    ``bore_cells``, ``bore_family``, ``pressure_cells``, ``pressure_family``
        Surface meshes of bore and pressure nodes as in `BoreSurface`; without cells and with an
        empty name when unknown.
    ``load_projection``
        ``T^T J``: generalised force of nodal pressures, shape (n, k) [m^2].
    ``rigid_mass``, ``rigid_coupling``, ``rigid_load``
        ``R^T M R``, ``R^T M T`` and ``R^T J`` of the unit translations [m] and rotations
        [rad] R about the origin, shapes (6, 6), (6, n) and (6, k); the free part has
        the mass matrix ``[[R^T M R, R^T M T], [T^T M R, T^T M T]]``.
    ``inertia_mass``, ``inertia_spin``, ``inertia_centrifugal``
        `InertiaIntegrals` of plane motion, shape (3 + n, 3 + n).
    ``points``, ``point_position``, ``point_basis``
        Names of the b boundary points, their mean positions, shape (b, 3) [m], and mean
        displacements for unit coordinates, shape (b, 3, n).
    ``residual_displacement``, ``residual_patterns``, ``residual_stiffness``, ``residual_mass``
        `ResidualFlexibility` (M4), shapes (m, 3, r) [m/Pa], (r, k), (r,) [J/Pa^2] and (r, r)
        [kg m^2/Pa^2] or empty: the bores' displacement is ``bore_basis @ q +
        residual_displacement @ residual_patterns @ p`` of coordinates q and pressures p. Not
        there without.

    Parameters
    ----------
    body
        Any body.
    path
        File; ``.npz`` is added when it has another ending. An existing one is replaced.

    Returns
    -------
    pathlib.Path
        The file.
    """
    path = Path(path)
    if path.suffix != ".npz":
        path = path.with_name(path.name + ".npz")
    content = BytesIO()
    np.savez(content, **contents(body))
    write_whole(path, content.getbuffer())
    return path


def contents(body: ReducedBody) -> dict[str, np.ndarray]:
    """Everything an export may hold, by the names of `export_npz`."""
    every, points, n = list(body.each_bore()), list(body.points.values()), body.modes
    bores = [rows.surface for rows in every]
    found = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "bore_names": list(body.bores),
        "bore_radius": [bore.radius for bore in bores],
        "bore_width": [bore.width for bore in bores],
        "bore_centre": [bore.centre for bore in bores],
        "bore_sizes": [(len(b.coordinates), len(b.pressure_coordinates)) for b in bores],
        "bore_nodes": body.places(),
        "bore_cells": np.vstack([r.nodes.start + r.surface.cells for r in every]),
        "bore_family": bores[0].family,
        "pressure_nodes": body.places(of_pressures=True),
        "pressure_cells": np.vstack([r.pressures.start + r.surface.pressure_cells for r in every]),
        "pressure_family": bores[0].pressure_family,
        "load_projection": body.load_projection[ELASTIC],
        "points": np.array(list(body.points), dtype=str),
        "point_position": np.array([row[:, 0] for row in points]).reshape(len(points), 3),
        "point_basis": np.array([row[:, 3:] for row in points]).reshape(len(points), 3, n),
        "kinds": np.array(body.kinds, dtype=str),
    }
    for name in ("method", "frame", "stiffness", "mass", "frequencies", "bore_basis"):
        found[name] = getattr(body, name)
    if body.rigid_mass.size:
        found |= {name: getattr(body, name) for name in vars(body) if name.startswith("rigid_")}
    for prefix, record in (("inertia", body.inertia), ("residual", body.residual)):
        if record is not None:
            found |= {f"{prefix}_{name}": value for name, value in vars(record).items()}
    return {name: np.asarray(value) for name, value in found.items()}
