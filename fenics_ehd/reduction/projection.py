"""Project a structure onto a basis: the last step of every reduction method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fenics_ehd.reduction.body import InertiaIntegrals, ReducedBody, no_cells, outward
from fenics_ehd.reduction.distributed import (
    inner,
    load_columns,
    multiply,
    node_rows,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.rigid_body import rigid_fields, spin
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure

#: Right-hand sides solved at once when the full bore flexibility is computed.
BLOCK = 64


def inertia_integrals(structure: Structure, fields: np.ndarray) -> InertiaIntegrals:
    """Inertia coupling of the given fields, owned rows (owned dofs, 3 + n)."""
    mass_fields = multiply(structure.mass, fields)
    spun = spin(fields)
    spin_matrix = inner(mass_fields, spun, structure.comm)
    return InertiaIntegrals(
        mass=symmetric(inner(fields, mass_fields, structure.comm)),
        spin=0.5 * (spin_matrix - spin_matrix.T),
        centrifugal=symmetric(inner(spun, multiply(structure.mass, spun), structure.comm)),
    )


def attachment_rows(structure: Structure, fields: np.ndarray) -> dict[str, np.ndarray]:
    """Mean displacement of every boundary point for unit fields, shape (3, fields) each."""
    return {
        name: inner(np.column_stack([v.array for v in vectors]), fields, structure.comm)
        for name, vectors in structure.attachments.items()
    }


def bore_flexibility(solver: StaticSolver) -> np.ndarray:
    """Outward bore displacement per unit nodal pressure of the full part, (m, k) [m/Pa]."""
    structure = solver.structure
    bore = structure.lubricated_bore
    identity = np.eye(len(bore.pressure_coordinates))
    first = structure.stiffness.getOwnershipRange()[0] // 3
    blocks = []
    for start in range(0, len(identity), BLOCK):
        loads = load_columns(bore.load, identity[:, start : start + BLOCK])
        rows = node_rows(solver.solve(loads), first, bore.nodes, structure.comm)
        blocks.append(outward(bore.coordinates, rows))
    return np.hstack(blocks)


def project(
    structure: Structure,
    basis: np.ndarray,
    stiffness: np.ndarray,
    mass: np.ndarray,
    frequencies: np.ndarray,
    kinds: tuple[str, ...],
    *,
    method: str,
    frame: str,
    full_flexibility: np.ndarray | None,
    accuracy: Mapping[str, float],
    provenance: Mapping[str, str],
) -> ReducedBody:
    """Reduced body of a basis whose reduced stiffness and mass are known.

    Parameters
    ----------
    structure
        The part.
    basis
        Owned rows of T, shape (owned dofs, n).
    stiffness, mass, frequencies, kinds, method, frame, accuracy, provenance
        As in `ReducedBody`.
    full_flexibility
        From `bore_flexibility`, or None when no error estimate is wanted.
    """
    position = structure.coordinates.reshape(-1, 1)
    translations = rigid_fields(structure.coordinates)[:, :2]
    fields = np.hstack([position, translations, basis])
    bore = structure.lubricated_bore
    first = structure.stiffness.getOwnershipRange()[0] // 3
    body = ReducedBody(
        method=method,
        frame=frame,
        stiffness=stiffness,
        mass=mass,
        frequencies=frequencies,
        kinds=kinds,
        bore_radius=bore.radius,
        bore_width=bore.width,
        bore_nodes=bore.coordinates,
        bore_basis=node_rows(basis, first, bore.nodes, structure.comm),
        pressure_nodes=bore.pressure_coordinates,
        load_projection=transpose_multiply(bore.load, fields).T,
        spin_load_projection=transpose_multiply(bore.load, spin(fields)).T,
        inertia=inertia_integrals(structure, fields),
        points=attachment_rows(structure, fields),
        missing_flexibility=np.zeros((0, 0)),
        bore_cells=no_cells() if bore.cells is None else bore.cells,
        bore_family=bore.family or "",
        pressure_cells=no_cells() if bore.pressure_cells is None else bore.pressure_cells,
        pressure_family=bore.pressure_family or "",
        accuracy=accuracy,
        provenance=provenance,
    )
    if full_flexibility is None:
        return body
    return replace(body, missing_flexibility=full_flexibility - body.basis_flexibility())
