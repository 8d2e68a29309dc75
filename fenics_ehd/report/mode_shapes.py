"""Shapes of the bore in the modes of each method, as a polar picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from scipy.interpolate import CubicSpline

from fenics_ehd.reduction import ReducedBody
from fenics_ehd.reduction.body import outward
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.report.study_data import Study, default_reduction
from fenics_ehd.report.style import COLOURS, SELECTIONS, WIDTH, plt, save

#: Height of a row [inches].
HEIGHT = 1.75

#: Modes of a row, and largest deflection in the picture, bore radius 1.
COLUMNS, DEFLECTION = 6, 0.32


#: Circles of the bore that are drawn, by their place along z, and their lines.
RINGS: dict[str, dict[str, Any]] = {
    "lower edge": {"linewidth": 0.9, "linestyle": ":"},
    "upper edge": {"linewidth": 0.9, "linestyle": "--"},
    "middle": {"linewidth": 1.8},
}


@dataclass(frozen=True, eq=False)
class ShapeRow:
    """A row of the picture: whose modes, bore displacements (m, 3, c), a note on each."""

    title: str
    colour: str
    displacements: np.ndarray
    notes: tuple[str, ...]


def variant(body: ReducedBody) -> str:
    """Method of a body with the pressure set and the selection of M3."""
    told = body.provenance
    if body.method != "m3":
        return body.method.upper()
    selection = SELECTIONS.get(told.get("selection", ""), ("", "-"))[0]
    return f"M3 {told.get('pressure_set', '')}, {selection}"


def shape_rows(bodies: Sequence[ReducedBody], default_set: str) -> list[ShapeRow]:
    """First modes of each method, and what M3's variants and M4 add to the vibration modes.

    Of the bodies of a variant, the one with the fewest coordinates that fills a row.

    Parameters
    ----------
    bodies
        Few coordinates first.
    default_set
        Pressure set of M3 of which every selection is shown, of other sets only one.
    """
    chosen: dict[str, ReducedBody] = {}
    for body in bodies:
        if _fills_a_row(body):
            chosen.setdefault(variant(body), body)
    plain = [item for item in chosen.items() if item[1].method in ("m1", "m2")]
    loaded = {name: body for name, body in chosen.items() if body.method in ("m3", "m4")}
    rows = [
        _coordinates(body, "fixed-boundary", f"{name}, fixed-boundary modes")
        for name, body in sorted(plain)
    ]
    if loaded:
        first = next(iter(loaded.values()))
        rows.append(_coordinates(first, "vibration", "M3 and M4, vibration modes"))
    rows += [
        _coordinates(body, "static", f"{name}, static modes")
        for name, body in sorted(loaded.items())
        if body.method == "m3" and _shown(body, default_set)
    ]
    rows += [_quasi_static(body) for body in loaded.values() if body.residual is not None]
    return [row for row in rows if row.displacements.shape[2]]


def _fills_a_row(body: ReducedBody) -> bool:
    if body.method in ("full", "rigid") or body.modes <= COLUMNS:
        return False
    return int(body.provenance.get("residual_modes", COLUMNS)) >= COLUMNS


def _shown(body: ReducedBody, default_set: str) -> bool:
    pressures = body.provenance.get("pressure_set", "")
    largest = body.provenance.get("selection") == "largest-eigenvalue"
    return pressures == default_set or (pressures in ("pc1", "pc2") and largest)


def _coordinates(body: ReducedBody, kind: str, title: str) -> ShapeRow:
    """Modes of a kind, by frequency."""
    members = [i for i, name in enumerate(body.kinds) if name == kind]
    members = sorted(members, key=lambda i: body.frequencies[i])[:COLUMNS]
    notes = tuple(f"{body.frequencies[i] * 1e-3:.3g} kHz" for i in members)
    shapes = body.bore_basis[:, :, members]
    return ShapeRow(title, COLOURS[body.method], _elastic(body.bore_nodes, shapes), notes)


def _quasi_static(body: ReducedBody) -> ShapeRow:
    """Most flexible patterns of M4, which have no frequency."""
    assert body.residual is not None
    size = np.abs(body.residual.displacement).max(axis=(0, 1))
    members = np.argsort(-size, kind="stable")[:COLUMNS]
    shapes = _elastic(body.bore_nodes, body.residual.displacement[:, :, members])
    return ShapeRow(
        "M4, quasi-static patterns", COLOURS["m4"], shapes, ("no inertia",) * len(members)
    )


def _elastic(nodes: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Shapes less the rigid motion of the bore, which would hide how it is bent."""
    rigid = rigid_fields(nodes)
    flat = shapes.reshape(len(rigid), -1)
    share, *_ = np.linalg.lstsq(rigid, flat, rcond=None)
    return (flat - rigid @ share).reshape(shapes.shape)


def draw_mode_shapes(study: Study, folder: Path, name: str) -> bool:
    """First mode shapes of the bore, a row a method; whether there was any body."""
    bodies = study.bodies
    rows = shape_rows(bodies, default_reduction(study.scene).pressure_set)
    if not rows:
        return False
    nodes = bodies[0].bore_nodes
    figure, panels = plt.subplots(
        len(rows),
        COLUMNS,
        figsize=(WIDTH, HEIGHT * len(rows)),
        squeeze=False,
    )
    # Nothing stands outside these panels that a layout would have to find room for.
    top = 1 - 0.25 / (HEIGHT * len(rows))
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.0, top=top, hspace=0.16, wspace=0.0)
    for row, axes_row in zip(rows, panels, strict=True):
        for axes in axes_row:
            axes.set_axis_off()
        axes_row[0].set_title(row.title, loc="left", fontsize=10, fontweight="bold")
        for i, note in enumerate(row.notes):
            _draw_shape(axes_row[i], nodes, row.displacements[:, :, i], row.colour, note)
    rings = [Line2D([], [], color="0.3", label=ring, **style) for ring, style in RINGS.items()]
    figure.legend(handles=rings, loc="upper right", ncols=len(rings), frameon=False,
                  borderaxespad=0.1)  # fmt: skip
    save(figure, folder, name)
    return True


def _draw_shape(
    axes: Axes, nodes: np.ndarray, displacement: np.ndarray, colour: str, note: str
) -> None:
    """Bore in one mode."""
    radial = outward(nodes, displacement[:, :, None])[:, 0]
    radial = DEFLECTION * radial / np.abs(radial).max()
    turn = np.linspace(0, 2 * np.pi, 181)
    axes.plot(np.cos(turn), np.sin(turn), color="0.75", linewidth=0.8)
    for (edge, ring), style in zip(_rings(nodes).items(), RINGS.values(), strict=True):
        angle = np.arctan2(nodes[ring, 1], nodes[ring, 0])
        order = ring[np.argsort(angle)]
        angle = np.append(np.sort(angle), np.min(angle) + 2 * np.pi)
        radius = 1 + np.append(radial[order], radial[order[0]])
        smooth = CubicSpline(angle, radius, bc_type="periodic")(turn)
        axes.plot(smooth * np.cos(turn), smooth * np.sin(turn), color=colour, label=edge, **style)
    axes.set(aspect="equal", xlim=(-1.38, 1.38), ylim=(-1.38, 1.38))
    axes.text(0, 0, note, ha="center", va="center", fontsize=8.5)


def _rings(nodes: np.ndarray) -> dict[str, np.ndarray]:
    """Nodes of both edges and of the whole circle of nodes nearest to mid-width."""
    levels, member = np.unique(np.round(nodes[:, 2] / np.ptp(nodes[:, 2]), 6), return_inverse=True)
    sizes = np.bincount(member)
    whole = np.flatnonzero(sizes == sizes[[0, -1]].max())
    middle = whole[np.abs(levels[whole] - levels.mean()).argmin()]
    chosen = (0, len(levels) - 1, middle)
    return {name: np.flatnonzero(member == i) for name, i in zip(RINGS, chosen, strict=True)}
