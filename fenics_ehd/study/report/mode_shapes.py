"""Shapes of a bore in the modes of each method, as a polar picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.interpolate import CubicSpline

from fenics_ehd.base.errors import BodyFileError
from fenics_ehd.reduction import ReducedBody, load_body
from fenics_ehd.reduction.bore import outward
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.study.report.curves import best
from fenics_ehd.study.report.study_data import StudyData
from fenics_ehd.study.report.style import COLOURS, WIDTH, plt

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

#: What is shown of each method.
SHOWN = {
    "m1": ("fixed-boundary",),
    "m2": ("fixed-boundary",),
    "m3": ("vibration", "static"),
    "m4": ("quasi-static",),
}


def best_bodies(study: StudyData) -> dict[str, dict[str, ReducedBody]]:
    """Reduced bodies of the best run of each method at each of their bores, by name and method.

    The name is the body's, of one with several bores with the bore's. Broken files are left out.
    """
    found: dict[str, dict[str, ReducedBody]] = {}
    for row in (row for method in SHOWN for row in best(study, method)):
        for path in sorted(study.folder(row["run"]).glob("body-*.h5")):
            try:
                body = load_body(path)
            except BodyFileError:
                continue
            name = path.stem.removeprefix("body-")
            for bore in body.bores:
                key = f"{name}_{bore}" if len(body.bores) > 1 else name
                found.setdefault(key, {})[row["method"]] = body.at_bore(bore)
    return found


def first_shapes(body: ReducedBody, kind: str) -> tuple[np.ndarray, list[str]]:
    """Displacement of the bore, shape (m, 3, c), in its first modes of a kind, a note on each.

    Modes by frequency; quasi-static patterns, which have none, the most flexible first.
    """
    if kind == "quasi-static":
        patterns = body.residual.displacement if body.residual else np.empty((0, 3, 0))
        order = np.argsort(-np.abs(patterns).max(axis=(0, 1), initial=0.0), kind="stable")
        return patterns[:, :, order[:COLUMNS]], ["no inertia"] * min(len(order), COLUMNS)
    order = np.argsort(body.frequencies, kind="stable")
    members = [i for i in order if body.kinds[i] == kind][:COLUMNS]
    notes = [f"{body.frequencies[i] * 1e-3:.3g} kHz" for i in members]
    return body.bore_basis[:, :, members], notes


def _elastic(nodes: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Shapes less the rigid motion of the bore, which would hide how it is bent."""
    rigid = rigid_fields(nodes)
    flat = shapes.reshape(len(rigid), -1)
    share, *_ = np.linalg.lstsq(rigid, flat, rcond=None)
    return (flat - rigid @ share).reshape(shapes.shape)


def draw_mode_shapes(bodies: Mapping[str, ReducedBody]) -> Figure | None:
    """First mode shapes of the bore of one part, reduced by several methods; None without any."""
    shown = [
        (method, kind, body, *first_shapes(body, kind))
        for method, body in bodies.items()
        for kind in SHOWN[method]
    ]
    shown = [row for row in shown if row[-1]]
    if not shown:
        return None
    size = (WIDTH, HEIGHT * len(shown))
    figure, panels = plt.subplots(len(shown), COLUMNS, figsize=size, squeeze=False)
    # Nothing stands outside these panels that a layout would have to find room for.
    top = 1 - 0.25 / (HEIGHT * len(shown))
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.0, top=top, hspace=0.16, wspace=0.0)
    for axes in panels.flat:
        axes.set_axis_off()
    for row, (method, kind, body, shapes, notes) in zip(panels, shown, strict=True):
        title = f"{method.upper()}, {kind} modes"
        row[0].set_title(title, loc="left", fontsize=10, fontweight="bold")
        radial = outward(body.bore_nodes, _elastic(body.bore_nodes, shapes))
        for axes, deflection, note in zip(row, radial.T, notes, strict=False):
            _draw_shape(axes, body.bore_nodes, deflection, COLOURS[method])
            axes.text(0, 0, note, ha="center", va="center", fontsize=8.5)
    rings = [Line2D([], [], color="0.3", label=ring, **style) for ring, style in RINGS.items()]
    figure.legend(handles=rings, loc="upper right", ncols=len(rings), frameon=False,
                  borderaxespad=0.1)  # fmt: skip
    return figure


def _draw_shape(axes: Axes, nodes: np.ndarray, radial: np.ndarray, colour: str) -> None:
    """Bore in one mode, from its deflection at the nodes."""
    turn = np.linspace(0, 2 * np.pi, 181)
    axes.plot(np.cos(turn), np.sin(turn), color="0.75", linewidth=0.8)
    angle = np.arctan2(nodes[:, 1], nodes[:, 0])
    for ring, style in zip(_rings(nodes), RINGS.values(), strict=True):
        order = ring[np.argsort(angle[ring])]
        radius = 1 + DEFLECTION * radial[order] / np.abs(radial).max()
        ends = np.append(angle[order], angle[order[0]] + 2 * np.pi)
        smooth = CubicSpline(ends, np.append(radius, radius[0]), bc_type="periodic")(turn)
        axes.plot(smooth * np.cos(turn), smooth * np.sin(turn), color=colour, **style)
    axes.set(aspect="equal", xlim=(-1.38, 1.38), ylim=(-1.38, 1.38))


def _rings(nodes: np.ndarray) -> list[np.ndarray]:
    """Nodes of both edges and of the whole circle of nodes nearest to mid-width."""
    levels, member = np.unique(np.round(nodes[:, 2] / np.ptp(nodes[:, 2]), 6), return_inverse=True)
    sizes = np.bincount(member)
    whole = np.flatnonzero(sizes == sizes[[0, -1]].max())
    middle = whole[np.abs(levels[whole] - levels.mean()).argmin()]
    return [np.flatnonzero(member == i) for i in (0, len(levels) - 1, middle)]
