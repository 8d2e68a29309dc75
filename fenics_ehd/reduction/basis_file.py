"""The part-size basis in one HDF5 file: displacements and stresses from modal coordinates."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fenics_ehd.base.errors import BodyFileError, SettingsError, StructureError
from fenics_ehd.base.sealed_file import named, open_sealed
from fenics_ehd.reduction.row_blocks import Rows, append, sealed_by_ranks
from fenics_ehd.reduction.structure import Structure

FORMAT = "fenics_ehd part basis"
FORMAT_VERSION = 2

#: Order of the stress components.
VOIGT = ("xx", "yy", "zz", "yz", "xz", "xy")

#: Rows read or written at a time; computing stresses takes some five times as much.
_BLOCK_BYTES = 1 << 22


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Equivalent stress of Voigt stresses, shape (..., 6) to (...) [Pa]."""
    stress = np.asarray(stress)
    normal, shear = stress[..., :3], stress[..., 3:]
    differences = normal - np.roll(normal, 1, axis=-1)
    return np.sqrt(0.5 * (differences**2).sum(axis=-1) + 3 * (shear**2).sum(axis=-1))


def save_basis(
    path: str | Path, structure: Structure, columns: np.ndarray, *, stress: bool = True
) -> None:
    """Write the basis of a part; an existing file is replaced only once the new one is whole.

    Collective. The ranks write one after the other, each its own rows.

    Parameters
    ----------
    path
        The same on every rank.
    structure
        Nodes and cells of the part.
    columns
        Displacements of unit modal coordinates, owned rows of shape (owned dofs, n) [m].
    stress
        Also write the modal stresses, the larger part, if the structure knows them.

    Raises
    ------
    SettingsError
        The columns do not fit the structure.
    BodyFileError
        The file cannot be written. Every rank raises it.
    """
    comm, nodes, modes = structure.comm, len(structure.coordinates), columns.shape[-1]
    shapes = comm.allgather((columns.shape, 3 * nodes))
    for shape, owned in shapes:
        if len(shape) != 2 or shape != (owned, shapes[0][0][-1]):
            raise SettingsError(f"columns of shape {shape} on a rank with {owned} dofs")
    recovery, path = structure.recovery, Path(path)
    tables: dict[str, np.ndarray | Rows] = {
        "nodes": structure.coordinates,
        "basis": columns.reshape(nodes, 3, modes),
        "cells": recovery.cells if recovery else np.zeros((0, 0), dtype=np.int64),
    }
    if stress and recovery and recovery.stress:
        tables |= _stresses(recovery.stress(columns))

    def begin(file: h5py.File) -> None:
        file.attrs.update(format=FORMAT, format_version=FORMAT_VERSION)
        file.attrs["stress_components"] = " ".join(VOIGT)

    try:
        with sealed_by_ranks(path, comm, begin) as partial:
            append(partial, comm, tables)
    except StructureError as error:
        raise BodyFileError(f"basis {error}") from error


def _stresses(field: Any) -> dict[str, Rows]:
    """Where stresses are and what they are, cell after cell, block by block."""
    cells, points, components, modes = field.shape
    step = max(1, _BLOCK_BYTES // max(1, 8 * points * components * modes))
    parts = [slice(start, min(start + step, cells)) for start in range(0, cells, step)]
    return {
        "stress_points": Rows(
            (cells * points, 3), (field.positions(part).reshape(-1, 3) for part in parts)
        ),
        "stress": Rows(
            (cells * points, components, modes),
            (field.block(part, slice(modes)).reshape(-1, components, modes) for part in parts),
        ),
    }


class BasisFile:
    """Displacements and stresses of a part from its modal coordinates.

    The basis stays in the file, read a few MB at a time. A context manager.

    Parameters
    ----------
    path
        A file of `save_basis`.

    Raises
    ------
    BodyFileError
        The file is missing, is not HDF5, is cut short, or holds no basis of this format.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        with self._named():
            self._file = open_sealed(
                self.path, FORMAT, FORMAT_VERSION, remedy="reduce the part again"
            )

    def __enter__(self) -> BasisFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _named(self) -> AbstractContextManager[None]:
        return named(BodyFileError, f"basis file {self.path}")

    @property
    def modes(self) -> int:
        """Number of modal coordinates n."""
        return int(self._file["basis"].shape[2])

    @property
    def nodes(self) -> np.ndarray:
        """Positions of the nodes, shape (nodes, 3) [m]."""
        return self._table("nodes")[()]

    @property
    def cells(self) -> np.ndarray:
        """Nodes of every cell in VTK's order, shape (cells, 20 or 10); empty when unknown."""
        return self._table("cells")[()]

    @property
    def stress_points(self) -> np.ndarray:
        """Where the stresses are, cell after cell, shape (points, 3) [m]."""
        return self._table("stress_points")[()]

    def displacement(self, coordinates: np.ndarray, nodes: np.ndarray | None = None) -> np.ndarray:
        """Displacement field of modal coordinates.

        Parameters
        ----------
        coordinates
            shape (n,), or (t, n) for t instants: the file is read once.
        nodes
            Numbers of the nodes wanted; None for all.

        Returns
        -------
        numpy.ndarray
            shape (nodes, 3) or (t, nodes, 3) [m].

        Raises
        ------
        SettingsError
            The coordinates do not fit the modes, or there is no such node.
        BodyFileError
            The file cannot be read.
        """
        return self._combine("basis", coordinates, nodes)

    def stress(self, coordinates: np.ndarray, points: np.ndarray | None = None) -> np.ndarray:
        """Stresses in the order of `VOIGT`, shape (points, 6) or (t, points, 6) [Pa].

        Everything else as in `displacement`; a file without stresses raises BodyFileError.
        """
        return self._combine("stress", coordinates, points)

    def _table(self, name: str) -> h5py.Dataset:
        if self._file and name not in self._file:
            raise BodyFileError(f"basis file {self.path} holds no stresses: none were saved")
        return self._file[name]

    def _combine(self, name: str, coordinates: np.ndarray, rows: np.ndarray | None) -> np.ndarray:
        """Rows of a table times coordinates, read block by block."""
        table = self._table(name)
        size, components, modes = table.shape
        q = np.asarray(coordinates, dtype=float)
        if q.ndim not in (1, 2) or q.shape[-1] != modes:
            raise SettingsError(f"coordinates of shape {q.shape} for the {modes} modes of a basis")
        wanted = np.arange(size) if rows is None else np.asarray(rows, dtype=np.int64).ravel()
        if wanted.size and not 0 <= wanted.min() <= wanted.max() < size:
            raise SettingsError(f"row {wanted.min()} or {wanted.max()} is not in 0 to {size - 1}")
        history = np.atleast_2d(q)
        step = max(1, _BLOCK_BYTES // (8 * components * max(*history.shape, 1)))
        if rows is not None and table.chunks:
            step = min(step, table.chunks[0])
        result = np.empty((len(history), len(wanted), components))
        order = np.argsort(wanted, kind="stable")
        for start in step * np.unique(wanted // step):
            there = order[slice(*np.searchsorted(wanted, (start, start + step), sorter=order))]
            with self._named():
                block = table[start : start + step]
            result[:, there] = np.tensordot(history, block[wanted[there] - start], (1, 2))
        return result if q.ndim == 2 else result[0]
