"""Are these surfaces of bores? Of a part, and of the body that a file holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from fenics_ehd.reduction.bore import BoreSurface
from fenics_ehd.reduction.faces import CYLINDER_TOLERANCE
from fenics_ehd.reduction.surface_elements import ELEMENTS

_NODES = ("coordinates", "pressure_coordinates")


def surface_defects(bores: Mapping[str, BoreSurface]) -> Iterator[str]:
    """What contradicts itself in surfaces of bores, one line each, the grossest first.

    Shapes, types, finite values; surface meshes of their nodes; nodes on the cylinder; the first
    bore at the origin.
    """
    for name, bore in bores.items():
        for check in (_arrays, _cells, _cylinder):
            found = [f"{name}.{line}" for line in check(bore)]
            yield from found
            if found:
                return
    for name, bore in list(bores.items())[:1]:
        if not np.abs(bore.centre).max() <= CYLINDER_TOLERANCE * bore.radius:
            yield f"{name}.centre: the first bore's must be the origin of the part"


def _arrays(bore: BoreSurface) -> Iterator[str]:
    for key in (*_NODES, "centre"):
        array = getattr(bore, key)
        shape = (3,) if key == "centre" else (len(array), 3)
        if array.shape != shape:
            yield f"{key} has shape {array.shape}, not {shape}"
        elif array.dtype.kind != "f" or not np.isfinite(array).all():
            yield f"{key} holds a value that is not finite, or no number"
    if not (0 < bore.radius < np.inf and 0 < bore.width < np.inf):
        yield f"radius {bore.radius:g} m or width {bore.width:g} m is not above 0"


def _cells(bore: BoreSurface) -> Iterator[str]:
    """What is wrong with one of the two surface meshes; having none is right."""
    for prefix, nodes in (("", bore.coordinates), ("pressure_", bore.pressure_coordinates)):
        cells, family = getattr(bore, f"{prefix}cells"), getattr(bore, f"{prefix}family")
        if not cells.size and not family:
            continue
        size = len(ELEMENTS[family].nodes) if family in ELEMENTS else 0
        if cells.ndim != 2 or not len(cells) or cells.shape[1] != size:
            need = f"needs (cells, {size})" if size else f"is not one of {', '.join(ELEMENTS)}"
            yield f"{prefix}cells has shape {cells.shape}, {prefix}family {family!r} {need}"
        elif cells.dtype.kind not in "iu" or not np.array_equal(
            np.unique(cells), np.arange(len(nodes))
        ):
            yield f"{prefix}cells must use each of the {len(nodes)} nodes"


def _cylinder(bore: BoreSurface) -> Iterator[str]:
    for key in _NODES:
        x = getattr(bore, key)
        reach = np.linalg.norm(x[:, :2], axis=1), np.abs(x[:, 2])
        off = np.maximum(np.abs(reach[0] - bore.radius), reach[1] - 0.5 * bore.width)
        if not off.max(initial=0.0) <= CYLINDER_TOLERANCE * bore.radius:
            yield (
                f"{key}: node {np.argmax(off)} lies {off.max():.1e} m off the cylinder of radius "
                f"{bore.radius:.6g} m and width {bore.width:.6g} m about z, centred at z = 0, "
                f"limit {CYLINDER_TOLERANCE:.0e} radii"
            )
