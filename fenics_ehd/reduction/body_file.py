"""A reduced body in one HDF5 file, bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fenics_ehd.errors import BodyFileError
from fenics_ehd.reduction.body import (
    InertiaIntegrals,
    ModeRecord,
    ReducedBody,
    ResidualFlexibility,
)
from fenics_ehd.whole_file import whole_hdf5

FORMAT = "fenics_ehd reduced body"
FORMAT_VERSION = 3

#: Nodes of a surface cell of each family.
_FAMILY_NODES = {"bilinear": 4, "serendipity": 8, "lagrange": 9, "triangle": 6}

#: Fields of `ModeRecord` in a file.
_RECORD = {
    "kind": h5py.string_dtype(),
    "frequency": float,
    "participation": float,
    "dropped": h5py.string_dtype(),
}

_ARRAYS = tuple(f.name for f in fields(ReducedBody) if f.type == "np.ndarray")


def save_body(body: ReducedBody, path: str | Path) -> None:
    """Write a body; an existing file is replaced only once the new one is whole."""
    with whole_hdf5(Path(path)) as file:
        file.attrs.update(
            format=FORMAT,
            format_version=FORMAT_VERSION,
            method=body.method,
            frame=body.frame,
            bore_radius=body.bore_radius,
            bore_width=body.bore_width,
            bore_family=body.bore_family,
            pressure_family=body.pressure_family,
        )
        for name in _ARRAYS:
            file[name] = getattr(body, name)
        file["kinds"] = np.array(body.kinds, dtype=h5py.string_dtype())
        for f in fields(InertiaIntegrals):
            file[f"inertia/{f.name}"] = getattr(body.inertia, f.name)
        file.create_group("points")
        for name, rows in body.points.items():
            file[f"points/{name}"] = rows
        if body.residual is not None:
            for f in fields(ResidualFlexibility):
                file[f"residual/{f.name}"] = getattr(body.residual, f.name)
        _write_inventory(file.create_group("inventory"), body.inventory)
        file.create_group("accuracy").attrs.update(body.accuracy)
        file.create_group("provenance").attrs.update(body.provenance)


def _write_inventory(group: h5py.Group, inventory: tuple[ModeRecord, ...]) -> None:
    for name, dtype in _RECORD.items():
        group[name] = np.array([getattr(r, name) for r in inventory], dtype=dtype)


def _read_inventory(group: h5py.Group) -> tuple[ModeRecord, ...]:
    columns = [
        group[name].asstr()[()] if dtype is not float else group[name][()]
        for name, dtype in _RECORD.items()
    ]
    return tuple(
        ModeRecord(str(kind), float(frequency), float(share), str(dropped))
        for kind, frequency, share, dropped in zip(*columns, strict=True)
    )


def _read_residual(file: h5py.File) -> ResidualFlexibility | None:
    if "residual" not in file:
        return None
    return ResidualFlexibility(
        *(np.array(file[f"residual/{f.name}"]) for f in fields(ResidualFlexibility))
    )


def load_body(path: str | Path) -> ReducedBody:
    """Read a body written by `save_body`.

    Raises
    ------
    BodyFileError
        The file is missing, is not HDF5, or holds no reduced body of this format.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise BodyFileError(f"body file {path}: not a {FORMAT}")
            if file.attrs["format_version"] != FORMAT_VERSION:
                raise BodyFileError(
                    f"body file {path}: format version {file.attrs['format_version']}, "
                    f"this program reads {FORMAT_VERSION}; reduce the part again"
                )
            arrays: dict[str, Any] = {name: np.array(file[name]) for name in _ARRAYS}
            body = ReducedBody(
                **arrays,
                method=str(file.attrs["method"]),
                frame=str(file.attrs["frame"]),
                bore_radius=float(file.attrs["bore_radius"]),
                bore_width=float(file.attrs["bore_width"]),
                bore_family=str(file.attrs["bore_family"]),
                pressure_family=str(file.attrs["pressure_family"]),
                kinds=tuple(file["kinds"].asstr()[()]),
                inertia=InertiaIntegrals(
                    *(np.array(file[f"inertia/{f.name}"]) for f in fields(InertiaIntegrals))
                ),
                residual=_read_residual(file),
                inventory=_read_inventory(file["inventory"]),
                points={name: np.array(rows) for name, rows in file["points"].items()},
                accuracy={k: float(v) for k, v in file["accuracy"].attrs.items()},
                provenance={k: str(v) for k, v in file["provenance"].attrs.items()},
            )
    except FileNotFoundError:
        raise BodyFileError(f"body file {path}: no such file") from None
    except (OSError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise BodyFileError(f"body file {path}: {str(error).splitlines()[0]}") from error
    for defect in defects(body):
        raise BodyFileError(f"body file {path}: {defect}")
    return body


def defects(body: ReducedBody) -> Iterator[str]:
    """What contradicts itself in a body, one line each."""
    n, nodes, pressures = body.modes, len(body.bore_nodes), len(body.pressure_nodes)
    square = (3 + n, 3 + n)
    shapes = {
        "stiffness": (body.stiffness, (n, n)),
        "mass": (body.mass, (n, n)),
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
        elif not np.isfinite(array).all():
            yield f"{name} holds a value that is not finite"
        elif name == "residual/stiffness" and not (array > 0).all():
            yield f"{name} holds a value that is not positive"
        elif name in ("stiffness", "mass", "inertia/mass"):
            scale = np.sqrt(np.abs(np.diag(array)))
            scaled = array / np.outer(scale, scale) if scale.all() else -np.eye(len(array))
            if len(array) and not np.linalg.eigvalsh(scaled).min() > -1e-9:
                yield f"{name} is not positive definite"
    yield from _cell_defects("bore", body.bore_cells, body.bore_family, nodes)
    yield from _cell_defects("pressure", body.pressure_cells, body.pressure_family, pressures)
    if not (body.bore_radius > 0 and body.bore_width > 0):
        yield f"bore of radius {body.bore_radius:g} m and width {body.bore_width:g} m"


def _cell_defects(name: str, cells: np.ndarray, family: str, nodes: int) -> Iterator[str]:
    """What is wrong with one of the two surface meshes; having none is right."""
    if not cells.size and not family:
        return
    size = _FAMILY_NODES.get(family)
    if size is None:
        yield f"{name}_family {family!r} is not one of {', '.join(_FAMILY_NODES)}"
    elif cells.ndim != 2 or not len(cells) or cells.shape[1] != size:
        yield f"{name}_cells has shape {cells.shape}, {family} cells have {size} nodes each"
    elif cells.dtype.kind not in "iu" or not np.array_equal(np.unique(cells), np.arange(nodes)):
        yield f"{name}_cells must use each of the {nodes} nodes"
