"""Checks of the lubricated bore of a part."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import Bore
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.row_blocks import agree
from fenics_ehd.reduction.structure import Structure
from fenics_ehd.reduction.surface_checks import surface_defects

#: Largest distance of a bore's node from that of the part, relative to the radius: in files whose
#: numbers are rounded the one is on the cylinder, the other where K has it. Others are far away.
PLACE_TOLERANCE = 1e-4

#: Largest difference of the volume that a uniform pressure sweeps from that of a cylinder,
#: relative: a hexagon with its corners on the circle has 9 % less.
SWEPT_TOLERANCE = 0.2

#: Largest defect of the mean motion of a rigidly moved bore.
REFERENCE_TOLERANCE = 1e-8

#: Largest force on a node off the bore, relative to the largest on it.
ROUND_OFF = 1e-9


def check_bores(structure: Structure) -> None:
    """Check nodes, load matrix and mean motion of every bore.

    Raises
    ------
    StructureError
        See `check_structure`.
    """
    for defect in surface_defects(structure.bores):
        raise StructureError(defect)
    for name, bore in structure.bores.items():
        _check_bore(structure, bore, name)
    if structure.bores and len(np.unique(structure.bore_nodes)) < len(structure.bore_nodes):
        raise StructureError(f"the bores {', '.join(structure.bores)} share a node")


def _check_bore(structure: Structure, bore: Bore, name: str) -> None:
    _check_shapes(bore, name)
    _check_nodes(structure, bore, name)
    _check_load(structure, bore, name)
    if bore.reference is not None:
        motion = np.einsum(
            "ick,icl->kl", bore.reference, rigid_fields(bore.coordinates).reshape(-1, 3, 6)
        )
        # Rotations are small where lengths are, so compare them at the bore's surface.
        lever = np.r_[np.ones(3), np.full(3, bore.radius)]
        defect = np.abs(motion * lever[:, None] / lever - np.eye(6)).max()
        if not defect <= REFERENCE_TOLERANCE:
            raise StructureError(
                f"{name}.reference: the mean motion of a rigidly moved bore is off by "
                f"{defect:.1e}, limit {REFERENCE_TOLERANCE:.0e}"
            )


def _check_shapes(bore: Bore, label: str) -> None:
    count, pressures = len(bore.coordinates), len(bore.pressure_coordinates)
    shapes = {"nodes": (bore.nodes, (count,)), "reference": (bore.reference, (count, 3, 6))}
    for name, (array, shape) in shapes.items():
        if array is not None and array.shape != shape:
            raise StructureError(f"{label}.{name} has shape {array.shape}, not {shape}")
    if bore.reference is not None and not np.isfinite(bore.reference).all():
        raise StructureError(f"{label}.reference holds a value that is not finite")
    if bore.load.size[1] != pressures:
        raise StructureError(
            f"{label}.load has {bore.load.size[1]} columns, there are {pressures} pressure nodes"
        )


def _check_nodes(structure: Structure, bore: Bore, label: str) -> None:
    last = structure.size // 3 - 1
    nodes = bore.nodes
    if (
        nodes.dtype.kind not in "iu"
        or not len(nodes)
        or not 0 <= nodes.min() <= nodes.max() <= last
    ):
        outside = nodes[(nodes < 0) | (nodes > last)]
        which = f"node {outside[0]} is" if len(outside) else "they are"
        raise StructureError(f"{label}.nodes: {which} not among the whole numbers 0 to {last}")
    numbers, uses = np.unique(nodes, return_counts=True)
    if (uses > 1).any():
        raise StructureError(
            f"{label}.nodes names node {numbers[np.argmax(uses > 1)]} {uses.max()} times"
        )
    _check_numbers(structure, bore, label)


def _check_numbers(structure: Structure, bore: Bore, label: str) -> None:
    """The bore's nodes lie where the part has them: numbers from 1 or of another mesh do not."""
    local = bore.nodes - structure.node_range[0]
    mine = np.flatnonzero((local >= 0) & (local < len(structure.coordinates)))
    there = bore.centre + bore.coordinates[mine]
    apart = np.linalg.norm(structure.coordinates[local[mine]] - there, axis=1)
    problem = None
    if (apart > PLACE_TOLERANCE * bore.radius).any():
        worst = int(np.argmax(apart))
        problem = (
            f"{label}.nodes: node {bore.nodes[mine[worst]]} of the part lies {apart[worst]:.1e} m "
            f"from where {label}.coordinates has it: do the numbers begin at 0?"
        )
    agree(structure.comm, problem)


def _check_load(structure: Structure, bore: Bore, label: str) -> None:
    """A uniform pressure sweeps the lateral area when the bore grows, and loads nothing else."""
    pressure, force = bore.load.createVecs()
    pressure.set(1.0)
    bore.load.mult(pressure, force)
    x = structure.coordinates - bore.centre
    force = force.array.reshape(-1, 3)
    on_bore = np.isin(np.arange(*structure.node_range), bore.nodes)
    work = np.sum(force[on_bore, :2] * x[on_bore, :2]) / bore.radius
    comm = structure.comm
    there, elsewhere = (
        comm.allreduce(np.abs(force[rows]).max(initial=0.0), op=MPI.MAX)
        for rows in (on_bore, ~on_bore)
    )
    swept = comm.allreduce(work) / (2 * np.pi * bore.radius * bore.width)
    if not elsewhere <= ROUND_OFF * there:
        raise StructureError(f"{label}.load has forces on nodes that are not in {label}.nodes")
    if not abs(swept - 1) <= SWEPT_TOLERANCE:
        raise StructureError(
            f"{label}.load: a uniform pressure pushes the bore outward with {swept:.3g} times the "
            "force of radius, width and 2 pi: it must push outward, and units must agree"
        )
