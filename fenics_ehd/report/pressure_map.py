"""Film pressure over the unwrapped bore at the moments that matter."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator
from scipy.interpolate import CloughTocher2DInterpolator

from fenics_ehd.errors import InputError
from fenics_ehd.history_file import read_fields
from fenics_ehd.report.curves import REFERENCE_RUN
from fenics_ehd.report.study_data import FILM, PRESSURE, Study
from fenics_ehd.report.style import WIDTH, plt, save

#: Share of the highest pressure from which on a colour is drawn.
EDGE = 0.01


@dataclass(frozen=True, eq=False)
class PressureFields:
    """Pressures of a run on its bore: time [s], nodes (k, 3) [m], pressure (steps, k) [Pa]."""

    time: np.ndarray
    nodes: np.ndarray
    pressure: np.ndarray

    def at(self, time: float) -> np.ndarray:
        """Nodal pressures at the step nearest to a time."""
        return self.pressure[int(np.abs(self.time - time).argmin())]

    @property
    def angle(self) -> np.ndarray:
        """Angle of the nodes about the bore's axis, from -pi to pi [rad]."""
        return np.arctan2(self.nodes[:, 1], self.nodes[:, 0])

    def sampled(self, pressure: np.ndarray, angle: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Smooth interpolation of nodal pressures, shape (heights, angles) [Pa]."""
        own, every = self.angle, np.arange(len(self.nodes))
        # Nodes near the cut once more beyond it, so that the picture has no seam.
        low, high = every[own > 2.0], every[own < -2.0]
        nodes = np.concatenate([every, low, high])
        unwrapped = np.concatenate([own, own[low] - 2 * np.pi, own[high] + 2 * np.pi])
        points = np.column_stack([unwrapped, self.nodes[nodes, 2]])
        values = CloughTocher2DInterpolator(points, pressure[nodes], rescale=True)
        # A smooth surface through the nodes may overshoot them.
        sampled = np.nan_to_num(values(*np.meshgrid(angle, height)))
        return np.clip(sampled, 0.0, pressure.max())


def read_pressures(study: Study, run: str = REFERENCE_RUN) -> PressureFields | None:
    """Pressures of a run, None when it left none."""
    history = study.history(run)
    if history is None:
        return None
    try:
        fields = read_fields(study.folder(run), ("pressure_nodes_m", "pressure_Pa"))
    except InputError:
        return None
    count = min(len(history["time_s"]), len(fields["pressure_Pa"]))
    return PressureFields(
        history["time_s"][:count], fields["pressure_nodes_m"], fields["pressure_Pa"][:count]
    )


def draw_pressure(study: Study, folder: Path, name: str) -> bool:
    """Pressure at the highest peak and at the thinnest film, of the reference."""
    fields, history = read_pressures(study), study.history(REFERENCE_RUN)
    if fields is None or history is None:
        return False
    moments = {
        "highest pressure": history["time_s"][history[PRESSURE.column].argmax()],
        "thinnest film": history["time_s"][history[FILM.column].argmin()],
    }
    highest = 1e-6 * max(fields.at(time).max() for time in moments.values())
    levels = MaxNLocator(14).tick_values(0, highest)
    levels[0] = EDGE * highest
    heights = fields.nodes[:, 2]
    angle, height = np.linspace(-np.pi, np.pi, 361), np.linspace(heights.min(), heights.max(), 61)
    figure, panels = plt.subplots(
        2, 1, figsize=(WIDTH, 5.6), layout="constrained", sharex=True, sharey=True
    )
    for axes, (moment, time) in zip(panels, moments.items(), strict=True):
        nodal = 1e-6 * fields.at(time)
        sampled = fields.sampled(nodal, angle, height)
        image = axes.contourf(np.degrees(angle), 1e3 * height, sampled, levels, cmap="YlOrRd")
        peak = nodal.argmax()
        axes.plot(np.degrees(fields.angle[peak]), 1e3 * heights[peak], "k+", markersize=9)
        told = f"nodal maximum {nodal[peak]:.1f} MPa (cross)"
        axes.set_title(f"{moment}: {1e3 * time:.3f} ms, {told}", fontsize=10)
        axes.set(ylabel="z [mm]", xlim=(-180, 180), xticks=np.arange(-180, 181, 45))
    panels[-1].set_xlabel("angle on the bore from the part's x axis, in direction of rotation [°]")
    ticks = [levels[0], *levels[2::2]]
    bar = figure.colorbar(image, ax=list(panels), label="pressure [MPa]", pad=0.01)
    bar.set_ticks(ticks, labels=[f"{tick:.2g}" for tick in ticks])
    save(figure, folder, name)
    return True
