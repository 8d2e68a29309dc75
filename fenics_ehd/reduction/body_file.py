"""A reduced body in one HDF5 file, bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.base.errors import BodyFileError
from fenics_ehd.base.sealed_file import digest, named, open_sealed, read_tree, save_tree
from fenics_ehd.reduction.body import ModeRecord, ReducedBody, ResidualFlexibility
from fenics_ehd.reduction.bore import BoreSurface
from fenics_ehd.reduction.inertia import InertiaIntegrals

FORMAT = "fenics_ehd reduced body"
FORMAT_VERSION = 5


def save_body(body: ReducedBody, path: str | Path) -> None:
    """Write a body; an existing file is replaced only once the new one is whole."""
    save_tree(path, _tree(body), FORMAT, FORMAT_VERSION)


def body_digest(body: ReducedBody) -> str:
    """SHA-256 of all numbers of a body, the same before and after it was in a file."""
    return digest(_tree(body))


def _tree(body: ReducedBody) -> dict[str, Any]:
    stored = {k: v for k, v in vars(body).items() if k != "columns" and v is not None}
    records = body.inventory
    return stored | {
        # The order of the bores is that of their nodes, a file's that of their names.
        "bore_names": tuple(body.bores),
        "accuracy": {name: float(value) for name, value in body.accuracy.items()},
        "inventory": {
            "kind": tuple(r.kind for r in records),
            "frequency": np.array([r.frequency for r in records], dtype=float),
            "participation": np.array([r.participation for r in records], dtype=float),
            "dropped": tuple(r.dropped for r in records),
        },
    }


def load_body(path: str | Path) -> ReducedBody:
    """Read a body written by `save_body`.

    Raises
    ------
    BodyFileError
        The file is missing, is not HDF5, changed since it was written, or holds no reduced body
        of this format.
    """
    with named(BodyFileError, f"body file {path}"):
        with open_sealed(path, FORMAT, FORMAT_VERSION, remedy="reduce the part again") as file:
            tree = read_tree(file)
        names = tree.pop("bore_names")
        tree["bores"] = {name: BoreSurface(**tree["bores"][name]) for name in names}
        tree["inertia"] = InertiaIntegrals(**tree["inertia"])
        if "residual" in tree:
            tree["residual"] = ResidualFlexibility(**tree["residual"])
        tree["inventory"] = _inventory(tree["inventory"])
        return ReducedBody(**tree)


def _inventory(columns: Mapping[str, Any]) -> tuple[ModeRecord, ...]:
    names = [field.name for field in fields(ModeRecord)]
    rows = zip(*(columns[name] for name in names), strict=True)
    return tuple(
        ModeRecord(kind, float(frequency), float(share), dropped)
        for kind, frequency, share, dropped in rows
    )
