"""The deformed bore and its journal, seen along the axis, what is small enlarged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from fenics_ehd.plotting.curves import Rows, common_axis, said
from fenics_ehd.plotting.picture import BLUE, PANEL, RED, legend, plt
from fenics_ehd.plotting.shown import ANGLE, ShownFilm, ShownJoint

#: Largest of clearance and radial displacement as drawn, height of the largest pressure, and half
#: the side of a panel, over the bore's radius.
ENLARGED, FAN, REACH = 0.2, 0.35, 1.62

#: Points around the bore.
AROUND = 361


@dataclass(frozen=True)
class Bores:
    """Bore, journal and pressure at the instants of peak pressure and of minimum film.

    The bore is drawn about the centre of the circle that comes nearest to it, as in the orbit:
    what lies between it and the journal is the film, in the section where it is thinnest.
    """

    def has(self, joint: ShownJoint) -> bool:
        """Whether there is anything to draw."""
        return bool(joint.name)

    def draw(self, rows: Rows) -> Figure:
        """The figure: two instants beside each other, every joint and run below the other."""
        cells = [(title, joint, joints) for title, joints in rows.items() for joint in joints]
        figure, panels = plt.subplots(
            len(cells), 2, figsize=(2 * PANEL, (PANEL + 0.4) * len(cells)), layout="constrained",
            squeeze=False,
        )  # fmt: skip
        for places, (title, joint, joints) in zip(panels, cells, strict=True):
            name = ", ".join(filter(None, (title, joint.run.name if len(joints) > 1 else "")))
            steps = {
                "peak pressure": int(joint.columns["max_pressure_Pa"].argmax()),
                "minimum film": int(joint.columns["min_film_thickness_m"].argmin()),
            }
            scale = _scale(joint.film, list(steps.values()))
            for axes, (instant, step) in zip(places, steps.items(), strict=True):
                over = common_axis([joint])
                now = joint.columns[over][step] * (1.0 if over == ANGLE else 1e3)
                _draw(axes, joint, step, scale)
                told = f"{instant}, {said(now, over)}\nclearance and deformation × {scale:g}"
                axes.set_title(f"{name}: {told}" if name else told)
        return figure


def profile(film: ShownFilm, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gap and pressure around the bore at a step, and the journal's place in the bore.

    Returns
    -------
    gap, pressure
        Of the section with the thinnest film; largest over the width, shape (a,) [m], [Pa].
    place
        Eccentricity of the circle that comes nearest to that gap, shape (2,) [m].
    """
    angle = np.linspace(-np.pi, np.pi, AROUND)
    height = np.unique(film.grid.node_positions[:, 1].round(9))
    around, along = (x.ravel() for x in np.meshgrid(angle, height))
    reading = film.grid.interpolation(around, along)
    gaps, pressures = (
        (reading @ values[step]).reshape(-1, AROUND) for values in (film.gap, film.pressure)
    )
    gap = gaps[np.argmin(gaps.min(axis=1))]
    waves = np.column_stack([np.ones(AROUND), -np.cos(angle), -np.sin(angle)])
    place = np.linalg.lstsq(waves[:-1], gap[:-1], rcond=None)[0][1:]
    return gap, np.maximum(pressures, 0.0).max(axis=0), place


def outward(gap: np.ndarray, place: np.ndarray, clearance: float) -> np.ndarray:
    """Radial displacement of the bore from its circle, shape (a,) [m]."""
    angle = np.linspace(-np.pi, np.pi, AROUND)
    return gap - clearance + place[0] * np.cos(angle) + place[1] * np.sin(angle)


def _scale(film: ShownFilm, steps: list[int]) -> float:
    """Enlargement, to two digits."""
    largest = film.clearance
    for step in steps:
        gap, _, place = profile(film, step)
        largest = max(largest, float(np.abs(outward(gap, place, film.clearance)).max()))
    scale = ENLARGED * film.grid.radius / largest
    digits = 10.0 ** (np.floor(np.log10(scale)) - 1)
    return float(np.floor(scale / digits) * digits)


def _draw(axes: Axes, joint: ShownJoint, step: int, scale: float) -> None:
    film, now = joint.film, {name: values[step] for name, values in joint.columns.items()}
    angle = np.linspace(-np.pi, np.pi, AROUND)
    gap, pressure, place = profile(film, step)
    radius = film.grid.radius
    bore = 1.0 + scale / radius * outward(gap, place, film.clearance)
    round_about = np.array([np.cos(angle), np.sin(angle)])
    highest = film.pressure.max()
    tip = bore + FAN * (pressure / highest if highest > 0 else pressure)
    fan = np.hstack([bore * round_about, (tip * round_about)[:, ::-1]])
    told = f"pressure, up to {1e-6 * now['max_pressure_Pa']:.4g} MPa"
    axes.fill(*fan, color=RED, alpha=0.35, linewidth=0, clip_on=False, label=told)
    axes.plot(*round_about, color="0.4", linewidth=1.0, linestyle=":", label="round bore")
    centre = scale / radius * place
    shaft = 1.0 - scale / radius * film.clearance
    axes.add_patch(Circle(centre, shaft, facecolor="0.92", edgecolor="0.35", linewidth=1.2))
    axes.plot(*(bore * round_about), color=BLUE, linewidth=2.0, label="deformed bore")
    axes.plot(*centre, "+", color="0.35")
    thin = int(gap.argmin())
    axes.plot(*(bore[thin] * round_about[:, thin]), "o", color="white", markeredgecolor="black",
              label=f"thinnest, {1e6 * now['min_film_thickness_m']:.4g} µm")  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH))
    axes.axis("off")
    for turn in np.radians([0, 90, 180, 270]):
        axes.text(*(0.5 * np.array([np.cos(turn), np.sin(turn)])), f"{np.degrees(turn):.0f}°",
                  ha="center", va="center", color="0.4", fontsize=8)  # fmt: skip
    legend(axes, loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2, frameon=False)
