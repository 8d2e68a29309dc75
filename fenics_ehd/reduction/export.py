"""A reduced body for other programs: NumPy's ``.npz`` and Matrix Market files."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fenics_ehd.errors import ExportError
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.whole_file import write_whole

FORMAT = "fenics_ehd reduced body, exported"
FORMAT_VERSION = 1

#: Written to Matrix Market as one triangle.
_SYMMETRIC = ("stiffness", "mass", "rigid_mass", "residual_mass")

#: Arrays that Matrix Market files do without.
_NPZ_ONLY = (
    "bore_cells",
    "pressure_cells",
    "inertia_mass",
    "inertia_spin",
    "inertia_centrifugal",
)


class Item(NamedTuple):
    """One array of an export and what it is."""

    value: np.ndarray
    meaning: str


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
    ``bore_radius``, ``bore_width``
        Numbers [m].
    ``bore_nodes``
        Positions from the bore's centre, the bore's axis along z, shape (m, 3) [m].
    ``bore_basis``
        Displacement of the bore nodes for unit coordinates, shape (m, 3, n).
    ``bore_cells``, ``bore_family``, ``pressure_cells``, ``pressure_family``
        Surface meshes of bore and pressure nodes as in `Bore`; without cells and with an
        empty name when unknown.
    ``pressure_nodes``
        Positions, shape (k, 3) [m].
    ``load_projection``
        ``T^T J``: generalised force of nodal pressures, shape (n, k) [m^2].
    ``rigid_mass``, ``rigid_coupling``, ``rigid_load``
        ``R^T M R``, ``R^T M T`` and ``R^T J`` of the unit translations [m] and rotations
        [rad] R about the bore's centre, shapes (6, 6), (6, n) and (6, k); the free part has
        the mass matrix ``[[R^T M R, R^T M T], [T^T M R, T^T M T]]``.
    ``total_mass``, ``centre_of_mass``, ``inertia_tensor``
        [kg], from the bore's centre, shape (3,) [m], and about it, shape (3, 3) [kg m^2].
    ``inertia_mass``, ``inertia_spin``, ``inertia_centrifugal``
        `InertiaIntegrals` of plane motion, shape (3 + n, 3 + n).
    ``points``, ``point_position``, ``point_basis``
        Names of the b boundary points, their mean positions, shape (b, 3) [m], and mean
        displacements for unit coordinates, shape (b, 3, n).
    ``residual_displacement``, ``residual_patterns``, ``residual_stiffness``, ``residual_mass``
        `ResidualFlexibility` (M4), shapes (m, 3, r) [m/Pa], (r, k), (r,) [J/Pa^2] and (r, r)
        [kg m^2/Pa^2] or empty: the bore's displacement is ``bore_basis @ q +
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
    return write_npz(path, {name: item.value for name, item in contents(body).items()})


def export_matrix_market(body: ReducedBody, directory: str | Path) -> Path:
    """Write a body as Matrix Market files, all digits, with a ``README.txt`` that explains them.

    ``NAME.mtx`` for every numeric array of `export_npz` but single numbers, surface meshes and
    plane inertia integrals. Where components x, y, z belong to a node the row is
    ``3 * node + component``: `bore_basis` has shape (3 m, n), `residual_displacement`
    (3 m, r). Stiffness and mass matrices are coordinate lists, symmetric ones by one triangle;
    the others are dense.

    Parameters
    ----------
    body
        Any body with modes.
    directory
        Folder, made when missing; files of the same names are replaced.

    Returns
    -------
    pathlib.Path
        The folder.

    Raises
    ------
    ExportError
        The body has no modes: there are no matrices to write.
    """
    if not body.modes:
        raise ExportError("this body is rigid: it has no matrices for Matrix Market, use npz")
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    listed = []
    for name, item in contents(body).items():
        value = item.value
        if name in _NPZ_ONLY or value.dtype.kind == "U" or not (value.ndim and value.size):
            continue
        matrix = value.reshape(-1, value.shape[-1] if value.ndim > 1 else 1)
        _write_matrix(directory / f"{name}.mtx", matrix, item.meaning, name in _SYMMETRIC)
        listed.append(f"{name}.mtx, {matrix.shape[0]} x {matrix.shape[1]}: {item.meaning}")
    (directory / "README.txt").write_text(_readme(body, listed), encoding="utf-8")
    return directory


def _write_matrix(path: Path, matrix: np.ndarray, meaning: str, square: bool) -> None:
    from scipy import sparse
    from scipy.io import mmwrite

    # One triangle would lose what the other has in its last digit.
    symmetry = "symmetric" if square and np.array_equal(matrix, matrix.T) else "general"
    mmwrite(
        str(path),
        sparse.coo_matrix(matrix) if square else matrix,
        comment=f" {meaning}",
        precision=17,
        symmetry=symmetry,
    )


def _readme(body: ReducedBody, listed: list[str]) -> str:
    kinds = [f"{body.kinds.count(kind)} {kind}" for kind in dict.fromkeys(body.kinds)]
    text = [
        f"Reduced body of fenics_ehd: method {body.method}, frame {body.frame}, "
        f"{body.modes} modes ({', '.join(kinds)}).",
        f"Bore of radius {body.bore_radius!r} m and width {body.bore_width!r} m about the z axis, "
        "its centre in the origin.",
        f"Boundary points, in order: {', '.join(body.points) or 'none'}.",
        "SI units. Where three components belong to a node, row = 3 * node + component, both and "
        "the rows counted from 0, the components in the order x, y, z.",
        "Stiffness and mass matrices are coordinate lists, symmetric ones by one triangle; the "
        "others are dense.",
        "Motion of the free part: [rigid_mass, rigid_coupling; rigid_coupling^T, mass] a + "
        "[0, 0; 0, stiffness] x = [rigid_load; load_projection] p.",
    ]
    if body.residual is not None:
        text.append(
            "The bore moves by bore_basis q + residual_displacement residual_patterns p: without "
            "the residual part it is too stiff."
        )
    return "\n".join([*text, "", *listed, ""])


def contents(body: ReducedBody) -> dict[str, Item]:
    """Everything an export may hold, by the names of `export_npz`."""
    points = list(body.points.values())
    n = body.modes
    arrays = {
        "format": (FORMAT, "format"),
        "format_version": (FORMAT_VERSION, "its version"),
        "method": (body.method, "reduction method"),
        "frame": (body.frame, "floating frame"),
        "kinds": (np.array(body.kinds, dtype=str), "kind of each mode"),
        "stiffness": (body.stiffness, "T^T K T [N/m]"),
        "mass": (body.mass, "T^T M T [kg]"),
        "frequencies": (body.frequencies, "frequency of each mode taken alone [Hz]"),
        "bore_radius": (body.bore_radius, "radius of the bore [m]"),
        "bore_width": (body.bore_width, "width of the bore [m]"),
        "bore_nodes": (body.bore_nodes, "positions of the bore's nodes [m]"),
        "bore_basis": (body.bore_basis, "displacement of the bore's nodes for unit coordinates"),
        "bore_cells": (body.bore_cells, "nodes of each cell of the bore"),
        "bore_family": (body.bore_family, "its family"),
        "pressure_cells": (body.pressure_cells, "pressure nodes of each cell of the bore"),
        "pressure_family": (body.pressure_family, "its family"),
        "pressure_nodes": (body.pressure_nodes, "positions of the pressure nodes [m]"),
        "load_projection": (
            body.load_projection[3:],
            "T^T J, generalised force of nodal pressures on the modes [m^2]",
        ),
        **_rigid_arrays(body),
        "inertia_mass": (body.inertia.mass, "B^T M B of plane motion"),
        "inertia_spin": (body.inertia.spin, "B^T M S B of plane motion"),
        "inertia_centrifugal": (body.inertia.centrifugal, "(S B)^T M (S B) of plane motion"),
        "points": (np.array(list(body.points), dtype=str), "names of the boundary points"),
        "point_position": (
            np.array([row[:, 0] for row in points]).reshape(len(points), 3),
            "mean positions of the boundary points [m]",
        ),
        "point_basis": (
            np.array([row[:, 3:] for row in points]).reshape(len(points), 3, n),
            "mean displacements of the boundary points for unit coordinates",
        ),
        **_residual_arrays(body),
    }
    return {name: Item(np.asarray(value), meaning) for name, (value, meaning) in arrays.items()}


def _rigid_arrays(body: ReducedBody) -> dict[str, tuple]:
    rigid = body.rigid_mass
    if not rigid.size:
        return {}
    total = rigid[0, 0]
    # R^T M R of translations with rotations is the mass times the cross product with the centre.
    centre = np.array([rigid[1, 5], rigid[2, 3], rigid[0, 4]]) / total
    unit = "[kg], [kg m] and [kg m^2] for translations and rotations"
    return {
        "rigid_mass": (rigid, f"R^T M R of unit translations and rotations R {unit}"),
        "rigid_coupling": (body.rigid_coupling, f"R^T M T {unit}"),
        "rigid_load": (body.rigid_load, "R^T J, force [m^2] and moment [m^3] of nodal pressures"),
        "total_mass": (total, "mass [kg]"),
        "centre_of_mass": (centre, "centre of mass from the bore's centre [m]"),
        "inertia_tensor": (rigid[3:, 3:], "inertia tensor about the bore's centre [kg m^2]"),
    }


def _residual_arrays(body: ReducedBody) -> dict[str, tuple]:
    r = body.residual
    if r is None:
        return {}
    return {
        "residual_displacement": (
            r.displacement,
            "displacement of the bore's nodes for unit amplitudes of the residual patterns [m/Pa]",
        ),
        "residual_patterns": (r.patterns, "amplitudes of nodal pressures"),
        "residual_stiffness": (r.stiffness, "twice the energy of unit amplitudes [J/Pa^2]"),
        "residual_mass": (r.mass, "mass matrix of the residual displacements [kg m^2/Pa^2]"),
    }


def write_npz(path: str | Path, arrays: Mapping[str, np.ndarray]) -> Path:
    """Write named arrays; an existing file is replaced only once the new one is whole.

    Raises
    ------
    ExportError
        An array could only be written as a pickle.
    """
    path = Path(path)
    if path.suffix != ".npz":
        path = path.with_name(path.name + ".npz")
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise ExportError(f"{path}: {name} is no plain array")
    content = BytesIO()
    np.savez(content, **arrays)
    write_whole(path, content.getbuffer())
    return path
