"""Stresses of a flexible body over the cycle of a run: fields, extremes, and a ParaView file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import meshio
import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.files import claim
from fenics_ehd.fem.stress import (
    HalfRange,
    NodalStress,
    largest_half_range,
    largest_principal,
)
from fenics_ehd.multibody.figures import figures_of
from fenics_ehd.multibody.trust import NOT_ESTIMATED
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.part_files import von_mises
from fenics_ehd.reduction.residual_completion import missing_fields, pattern_fields
from fenics_ehd.reduction.structure import Structure
from fenics_ehd.results.paraview import CELL_NAMES

#: Components of the error of a stress.
COMPONENTS = ("mesh", "reduction", "run")

#: Errors by the reduction and by the run if neither is known.
NO_ERRORS = MappingProxyType(dict.fromkeys(COMPONENTS[1:], NOT_ESTIMATED))

#: Reduction methods whose modes contain only a part of the bore's static flexibility.
PARTIAL = ("m1", "m2", "m3")


@dataclass(frozen=True, eq=False)
class CycleStress:
    """Extreme stresses over the instants of a cycle, at every node of a part.

    Attributes
    ----------
    nodes, cells
        Positions of the nodes, shape (p, 3) [m]; nodes of every cell in VTK's order, shape (c, 20
        or 10).
    half_range
        Largest half-range of the stress at every node, see `HalfRange`.
    principal, principal_instants
        Largest principal stress at every node [Pa], and index of its instant, shape (p,).
    half_range_node, principal_node
        Index of the node with the largest half-range, and index of the node with the largest
        principal stress.
    half_range_around, principal_around
        Least and largest value of the cells around a node, before averaging over these cells:
        half-range at `half_range_node`, and principal stress at `principal_node` [Pa].
    """

    nodes: np.ndarray
    cells: np.ndarray
    half_range: HalfRange
    principal: np.ndarray
    principal_instants: np.ndarray
    half_range_node: int
    principal_node: int
    half_range_around: tuple[float, float]
    principal_around: tuple[float, float]


def cycle_stress(
    structure: Structure,
    body: ReducedBody,
    columns: np.ndarray,
    coordinates: np.ndarray,
    amplitudes: np.ndarray,
    loads: tuple[np.ndarray, np.ndarray] | None = None,
) -> CycleStress:
    """Extreme stresses of a part over a cycle, from its coordinates; on one rank.

    Stresses are linear in the modes and the residual patterns. They are therefore computed for
    every mode and pattern. If there are fewer instants than modes and patterns, they are computed
    for the displacements at every instant instead. Blocks of cells are processed one by one.

    Parameters
    ----------
    structure, body
        Structure of the part, and its reduced body.
    columns
        Basis T of displacement fields of the complete part, shape (dofs, n).
    coordinates, amplitudes
        Coordinates q, shape (t, n), and amplitudes of residual patterns, shape (t, r), at the
        instants, see `RecordedMotion.in_equilibrium`.
    loads
        Forces and speeds, see `missing_fields`. The displacements that the basis does not contain
        are computed from them. If None, the residual patterns with their `amplitudes` are used as
        these displacements.

    Raises
    ------
    SettingsError
        The structure has no elements, and therefore no stresses.
    VerificationError
        Raised by `pattern_fields`.
    """
    recovery = structure.recovery
    if recovery is None or recovery.stress is None:
        raise SettingsError("the structure has no elements: stresses need them")
    histories = None
    if loads is None:
        fields, histories = _displacements(structure, body, columns, coordinates, amplitudes)
    else:
        fields = columns @ coordinates.T + missing_fields(structure, body, columns, *loads)
    nodal = NodalStress(recovery.stress(fields))
    count = nodal.nodes
    pairs = np.zeros((count, 2), dtype=int)
    tensors = np.zeros((2, count, 6))
    half_range = HalfRange(pairs, np.zeros(count), *tensors)
    principal = np.zeros(count)
    instants = np.zeros(count, dtype=int)
    for nodes, stress in nodal.blocks():
        history = stress if histories is None else stress @ histories
        largest = largest_half_range(history)
        half_range.instants[nodes] = largest.instants
        half_range.von_mises[nodes] = largest.von_mises
        half_range.half_range[nodes] = largest.half_range
        half_range.mean[nodes] = largest.mean
        principal[nodes], instants[nodes] = largest_principal(history)

    def around(node: int) -> np.ndarray:
        stress = nodal.around(node)
        return stress if histories is None else stress @ histories

    widest = int(half_range.von_mises.argmax())
    highest = int(principal.argmax())
    return CycleStress(
        structure.coordinates,
        recovery.cells,
        half_range,
        principal,
        instants,
        widest,
        highest,
        _ends(largest_half_range(around(widest)).von_mises),
        _ends(largest_principal(around(highest))[0]),
    )


def _ends(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _displacements(
    structure: Structure,
    body: ReducedBody,
    columns: np.ndarray,
    coordinates: np.ndarray,
    amplitudes: np.ndarray,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Displacement fields of a part, and their factors at the instants.

    Returns
    -------
    fields
        Displacement fields, shape (dofs, c) [m].
    factors
        Factor of each field at each instant, shape (c, t). None: the fields are the displacements
        at the instants, c = t.
    """
    time, modes = coordinates.shape
    rank = amplitudes.shape[1]
    if modes + rank <= time:
        patterns = pattern_fields(structure, body, columns)
        return np.hstack([columns, patterns]), np.vstack([coordinates.T, amplitudes.T])
    fields = columns @ coordinates.T
    if rank:
        fields += pattern_fields(structure, body, columns, amplitudes.T)
    return fields, None


def figures(
    stress: CycleStress,
    instants: Mapping[str, np.ndarray],
    errors: Mapping[str, float | str] = NO_ERRORS,
) -> dict[str, Any]:
    """Values, errors, positions and instants of the largest stresses, for ``stress.json``.

    Parameters
    ----------
    stress
        Stresses of a body.
    instants
        Times or angles of the instants by column name, shape (t,) each.
    errors
        Relative errors by the reduction and by the run, see `stress_errors`.
    """
    node = stress.half_range_node
    half_range = stress.half_range
    pair = half_range.instants[node]
    top = stress.principal_node
    when = stress.principal_instants[top]
    mean = half_range.mean[node]
    largest = float(half_range.von_mises[node])
    principal = float(stress.principal[top])
    return {
        "half_range": {
            "von_mises_Pa": largest,
            "errors": summed_errors(largest, stress.half_range_around, errors),
            "in_cells_around_Pa": list(stress.half_range_around),
            "place_m": stress.nodes[node].tolist(),
            **{name: values[pair].tolist() for name, values in instants.items()},
            "half_range_Pa": half_range.half_range[node].tolist(),
            "mean_Pa": mean.tolist(),
            "mean_von_mises_Pa": float(von_mises(mean)),
            "mean_hydrostatic_Pa": float(mean[:3].mean()),
        },
        "largest_principal": {
            "stress_Pa": principal,
            "errors": summed_errors(principal, stress.principal_around, errors),
            "in_cells_around_Pa": list(stress.principal_around),
            "place_m": stress.nodes[top].tolist(),
            **{name: float(values[when]) for name, values in instants.items()},
        },
    }


def stress_errors(
    summary: Mapping[str, Any], body: ReducedBody, name: str, complete: bool
) -> dict[str, float | str]:
    """Relative errors of a body's stresses by the reduction and by the run.

    Parameters
    ----------
    summary
        Summary of the run with its error budget.
    body, name
        Reduced body and its name.
    complete
        Whether the static response that the basis lacks was added.

    Returns
    -------
    dict
        ``reduction``: verified relative error of the displacement of the bores, or 0 if nothing is
        missing. ``run``: largest relative error of the force extremes of all joints, to which
        stresses are proportional. In place of an error that is not known there is a text.
    """
    verified = {
        **summary.get("verified_flexibility_errors", {}),
        **summary.get("flexibility_errors", {}),
    }
    reduction: float | str = float(verified.get(name, 0.0))
    unverified = body.method == "m4" and np.isnan(body.flexibility_error)
    if unverified or (body.method in PARTIAL and not complete):
        reduction = NOT_ESTIMATED
    forces = [
        figure.relative
        for figure in figures_of(summary)
        if figure.name == "cycle_max_force_N" and figure.relative is not None
    ]
    return {"reduction": reduction, "run": max(forces, default=NOT_ESTIMATED)}


def summed_errors(
    value: float, around: tuple[float, float], errors: Mapping[str, float | str]
) -> dict[str, float | str]:
    """Relative errors of an extreme stress by component, and their sum ``known``.

    The error of the mesh is half the range of the values of single cells around the node.

    Parameters
    ----------
    value, around
        Stress, and its least and largest value in the cells around the node [Pa].
    errors
        Errors by the reduction and by the run, see `stress_errors`.
    """
    mesh = 0.5 * (around[1] - around[0]) / abs(value) if value else 0.0
    each = {"mesh": mesh, **errors}
    return {**each, "known": sum(error for error in each.values() if not isinstance(error, str))}


def write_fields(path: Path, stress: CycleStress, time: np.ndarray) -> None:
    """Write a ParaView file of the extreme stresses on the undeformed part.

    `time` has the times of the instants [s].
    """
    half_range = stress.half_range
    data = {
        "half_range_von_mises_Pa": half_range.von_mises,
        "mean_von_mises_Pa": von_mises(half_range.mean),
        "mean_hydrostatic_Pa": half_range.mean[:, :3].mean(axis=1),
        "half_range_Pa": half_range.half_range,
        "mean_Pa": half_range.mean,
        "half_range_from_s": time[half_range.instants[:, 0]],
        "half_range_to_s": time[half_range.instants[:, 1]],
        "largest_principal_Pa": stress.principal,
        "largest_principal_at_s": time[stress.principal_instants],
    }
    claim(path.parent, [path.name])
    kind = CELL_NAMES[stress.cells.shape[1]]
    meshio.Mesh(stress.nodes, [(kind, stress.cells)], point_data=data).write(path)
