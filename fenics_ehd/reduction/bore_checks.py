"""Checks of the lubricated bore of a part."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from fenics_ehd.errors import StructureError
from fenics_ehd.reduction.faces import CYLINDER_TOLERANCE
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.row_blocks import agree
from fenics_ehd.reduction.structure import Bore, Structure
from fenics_ehd.reduction.surface_elements import surface_element

#: Largest difference of the volume that a uniform pressure sweeps from that of a cylinder,
#: relative: a hexagon with its corners on the circle has 9 % less.
SWEPT_TOLERANCE = 0.2

#: Largest defect of the mean motion of a rigidly moved bore.
REFERENCE_TOLERANCE = 1e-8

#: Largest force on a node off the bore, relative to the largest on it.
ROUND_OFF = 1e-9


def check_bore(structure: Structure, bore: Bore) -> None:
    """Check nodes, load matrix and mean motion of a bore.

    Raises
    ------
    StructureError
        See `check_structure`.
    """
    _check_shapes(structure, bore)
    _check_positions(structure, bore)
    _check_load(structure, bore)
    if bore.reference is not None:
        motion = np.einsum(
            "ick,icl->kl", bore.reference, rigid_fields(bore.coordinates).reshape(-1, 3, 6)
        )
        # Rotations are small where lengths are, so compare them at the bore's surface.
        lever = np.r_[np.ones(3), np.full(3, bore.radius)]
        defect = np.abs(motion * lever[:, None] / lever - np.eye(6)).max()
        if not defect <= REFERENCE_TOLERANCE:
            raise StructureError(
                f"bore.reference: the mean motion of a rigidly moved bore is off by {defect:.1e}, "
                f"limit {REFERENCE_TOLERANCE:.0e}"
            )


def _check_shapes(structure: Structure, bore: Bore) -> None:
    count, pressures = len(bore.nodes), len(bore.pressure_coordinates)
    shapes = {
        "nodes": (bore.nodes, (count,)),
        "coordinates": (bore.coordinates, (count, 3)),
        "pressure_coordinates": (bore.pressure_coordinates, (pressures, 3)),
        "reference": (bore.reference, (count, 3, 6)),
    }
    for name, (array, shape) in shapes.items():
        if array is not None and array.shape != shape:
            raise StructureError(f"bore.{name} has shape {array.shape}, not {shape}")
        if array is not None and not np.isfinite(array).all():
            raise StructureError(f"bore.{name} holds a value that is not finite")
    if not (bore.radius > 0 and bore.width > 0):
        raise StructureError(f"bore of radius {bore.radius:g} m and width {bore.width:g} m")
    if bore.load.size[1] != pressures:
        raise StructureError(
            f"bore.load has {bore.load.size[1]} columns, there are {pressures} pressure nodes"
        )
    _check_cells("", bore.cells, bore.family, count)
    _check_cells("pressure_", bore.pressure_cells, bore.pressure_family, pressures)


def _check_cells(prefix: str, cells: np.ndarray | None, family: str | None, nodes: int) -> None:
    if cells is None and not family:
        return
    if cells is None or not family:
        raise StructureError(f"bore.{prefix}cells and bore.{prefix}family: give both or neither")
    surface_element(family, cells)
    if not np.array_equal(np.unique(cells), np.arange(nodes)):
        raise StructureError(f"bore.{prefix}cells must use each of the {nodes} nodes")


def _check_positions(structure: Structure, bore: Bore) -> None:
    last = structure.size // 3 - 1
    nodes = bore.nodes
    if (
        nodes.dtype.kind not in "iu"
        or not len(nodes)
        or not 0 <= nodes.min() <= nodes.max() <= last
    ):
        outside = nodes[(nodes < 0) | (nodes > last)]
        raise StructureError(
            f"bore.nodes: {f'node {outside[0]} is' if len(outside) else 'they are'} not among the "
            f"whole numbers 0 to {last}"
        )
    numbers, uses = np.unique(nodes, return_counts=True)
    if (uses > 1).any():
        raise StructureError(
            f"bore.nodes names node {numbers[np.argmax(uses > 1)]} {uses.max()} times"
        )
    heights = bore.coordinates[:, 2]
    middle = 0.5 * (heights.min() + heights.max())
    if not abs(middle) <= CYLINDER_TOLERANCE * bore.radius:
        raise StructureError(
            "bore.coordinates: the bore must be centred at z = 0, its middle is at "
            f"z = {middle:.3e} m"
        )
    for name, x in (("node", bore.coordinates), ("pressure node", bore.pressure_coordinates)):
        off = np.linalg.norm(x[:, :2], axis=1) - bore.radius
        worst = int(np.argmax(np.abs(off)))
        if not abs(off[worst]) <= CYLINDER_TOLERANCE * bore.radius:
            number = nodes[worst] if name == "node" else worst
            raise StructureError(
                f"bore: {name} {number} lies {off[worst]:.1e} m off the cylinder of radius "
                f"{bore.radius:.6g} m about z, limit {CYLINDER_TOLERANCE:.0e} radii"
            )
    _check_numbers(structure, bore)


def _check_numbers(structure: Structure, bore: Bore) -> None:
    """The bore's nodes lie where the part has them: numbers from 1 or of another mesh do not."""
    local = bore.nodes - structure.node_range[0]
    mine = np.flatnonzero((local >= 0) & (local < len(structure.coordinates)))
    apart = np.linalg.norm(structure.coordinates[local[mine]] - bore.coordinates[mine], axis=1)
    problem = None
    if (apart > CYLINDER_TOLERANCE * bore.radius).any():
        worst = int(np.argmax(apart))
        problem = (
            f"bore.nodes: node {bore.nodes[mine[worst]]} of the part lies {apart[worst]:.1e} m "
            "from where bore.coordinates has it: do the numbers begin at 0?"
        )
    agree(structure.comm, problem)


def _check_load(structure: Structure, bore: Bore) -> None:
    """A uniform pressure sweeps the lateral area when the bore grows, and loads nothing else."""
    pressure, force = bore.load.createVecs()
    pressure.set(1.0)
    bore.load.mult(pressure, force)
    x = structure.coordinates
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
        raise StructureError("bore.load has forces on nodes that are not in bore.nodes")
    if not abs(swept - 1) <= SWEPT_TOLERANCE:
        raise StructureError(
            f"bore.load: a uniform pressure pushes the bore outward with {swept:.3g} times the "
            "force of radius, width and 2 pi: it must push outward, and units must agree"
        )
