"""A reduced body in one HDF5 file, bit for bit."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np

from fenics_ehd.errors import BodyFileError
from fenics_ehd.reduction.body import InertiaIntegrals, ReducedBody

FORMAT = "fenics_ehd reduced body"
FORMAT_VERSION = 1

_ARRAYS = tuple(f.name for f in fields(ReducedBody) if f.type == "np.ndarray")


def save_body(body: ReducedBody, path: str | Path) -> None:
    """Write a body; an existing file is replaced only once the new one is whole."""
    path = Path(path)
    partial = path.with_name(path.name + ".part")
    with h5py.File(partial, "w") as file:
        file.attrs.update(
            format=FORMAT,
            format_version=FORMAT_VERSION,
            method=body.method,
            frame=body.frame,
            bore_radius=body.bore_radius,
            bore_width=body.bore_width,
        )
        for name in _ARRAYS:
            file[name] = getattr(body, name)
        file["kinds"] = np.array(body.kinds, dtype=h5py.string_dtype())
        for f in fields(InertiaIntegrals):
            file[f"inertia/{f.name}"] = getattr(body.inertia, f.name)
        for name, rows in body.points.items():
            file[f"points/{name}"] = rows
        file.create_group("accuracy").attrs.update(body.accuracy)
        file.create_group("provenance").attrs.update(body.provenance)
    partial.replace(path)


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
            return ReducedBody(
                **{name: np.array(file[name]) for name in _ARRAYS},
                method=str(file.attrs["method"]),
                frame=str(file.attrs["frame"]),
                bore_radius=float(file.attrs["bore_radius"]),
                bore_width=float(file.attrs["bore_width"]),
                kinds=tuple(file["kinds"].asstr()[()]),
                inertia=InertiaIntegrals(
                    *(np.array(file[f"inertia/{f.name}"]) for f in fields(InertiaIntegrals))
                ),
                points={name: np.array(rows) for name, rows in file["points"].items()},
                accuracy={k: float(v) for k, v in file["accuracy"].attrs.items()},
                provenance={k: str(v) for k, v in file["provenance"].attrs.items()},
            )
    except (OSError, KeyError) as error:
        raise BodyFileError(f"body file {path}: {str(error).splitlines()[0]}") from error
