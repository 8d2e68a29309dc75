"""Film pressure over an unwrapped bore at the moments that matter."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fenics_ehd.plotting.picture import PRESSURES, plt
from fenics_ehd.study.report.study_data import FILM, PRESSURE, REFERENCE_RUN, JointData
from fenics_ehd.study.report.style import WIDTH

#: Share of the highest pressure from which on a colour is drawn.
EDGE = 0.01


def draw_pressure(joint: JointData, run: str = REFERENCE_RUN) -> Figure | None:
    """Pressure of a run at its highest peak and at the thinnest film, None without it."""
    fields, history = joint.pressures(run), joint.history(run)
    if fields is None or history is None:
        return None
    nodes, pressure = fields
    moments = {
        "highest pressure": int(history[PRESSURE.column].argmax()),
        "thinnest film": int(history[FILM.column].argmin()),
    }
    highest = 1e-6 * max(pressure[step].max() for step in moments.values())
    levels = MaxNLocator(14).tick_values(0, highest)
    levels[0] = EDGE * highest
    # Once more on either side, so that the picture has no seam.
    angle = np.degrees(nodes[:, 0] + 2 * np.pi * np.array([[-1], [0], [1]])).ravel()
    height = np.tile(1e3 * nodes[:, 1], 3)
    figure, panels = plt.subplots(
        2, 1, figsize=(WIDTH, 5.6), layout="constrained", sharex=True, sharey=True
    )
    for axes, (moment, step) in zip(panels, moments.items(), strict=True):
        nodal = np.tile(1e-6 * pressure[step], 3)
        image = axes.tricontourf(angle, height, nodal, levels, cmap=PRESSURES)
        highest_nodes = np.flatnonzero(nodal == nodal.max())
        axes.plot(angle[highest_nodes], height[highest_nodes], "k+", markersize=9)
        told = f"{1e3 * history['time_s'][step]:.3f} ms, {nodal.max():.1f} MPa (cross)"
        axes.set_title(f"{moment}: {told}", fontsize=10)
        axes.set(ylabel="z [mm]", xlim=(-180, 180), xticks=np.arange(-180, 181, 45))
    panels[-1].set_xlabel("angle on the bore from the part's x axis, from x to y [°]")
    figure.colorbar(image, ax=list(panels), label="pressure [MPa]", pad=0.01, ticks=levels[::2],
                    format="%.2g")  # fmt: skip
    return figure
