"""Orbits of journals in the clearance circle, and the forces that drive them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from fenics_ehd.plotting.picture import in_formats, plt, save, style

#: Shares of the recorded time at which a direction is drawn.
ARROWS = (1 / 8, 3 / 8, 5 / 8, 7 / 8)


def plot_orbits(
    joints: Mapping[str, Mapping[str, np.ndarray]],
    directory: str | Path,
    paths: Mapping[str, np.ndarray] | None = None,
) -> list[Path]:
    """Orbit of every journal in its bore, and the force on the bore.

    Parameters
    ----------
    joints
        Columns of lubricated joints by the name to show in the legend.
    directory
        Where the picture goes.
    paths
        Of journals by that name, over the clearance, shape (t, 2), see `Replay.orbits`; of one
        that is not there, as of a rigid bore.

    Returns
    -------
    list of Path
        ``orbit`` in each of `FORMATS`.
    """
    figure, (orbits, forces) = plt.subplots(1, 2, figsize=(10.0, 5.0), layout="constrained")
    clearance_circle(orbits)
    for number, (name, columns) in enumerate(joints.items()):
        force = -1e-3 * _pair(columns, "force", "N")
        path = paths[name] if paths and name in paths else _in_rigid_bore(columns)
        _draw_path(orbits, columns["time_s"], path, number, name)
        _draw_path(forces, columns["time_s"], force, number, name)
    orbits.legend(loc="upper right", framealpha=0.9)
    forces.plot(0, 0, "+", color="0.2", markersize=9)
    forces.set_aspect("equal", adjustable="datalim")
    forces.set(xlabel="force x [kN]", ylabel="force y [kN]", title="force of the film on the bore")
    forces.grid(alpha=0.3)
    return save(figure, in_formats(directory, "orbit"))


def clearance_circle(axes: Axes) -> None:
    """Where the journal's centre is, over the clearance, in the frame of the bore."""
    for radius in (0.25, 0.5, 0.75, 1.0):
        ring = {"color": "0.2", "lw": 1.6} if radius == 1.0 else {"color": "0.85", "lw": 0.8}
        axes.add_patch(plt.Circle((0, 0), radius, fill=False, **ring))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="eccentricity x / c", ylabel="eccentricity y / c")


def _in_rigid_bore(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Path over the clearance, which film and eccentricity make up."""
    path = _pair(columns, "eccentricity", "m")
    return path / (columns["min_film_thickness_m"] + np.hypot(*path.T)).max()


def _pair(columns: Mapping[str, np.ndarray], name: str, unit: str) -> np.ndarray:
    """Components along x and y, shape (t, 2)."""
    missing = np.full(len(columns["time_s"]), np.nan)
    return np.column_stack([columns.get(f"{name}_{axis}_{unit}", missing) for axis in "xy"])


def _draw_path(axes: Axes, time: np.ndarray, path: np.ndarray, number: int, name: str) -> None:
    """A curve with its direction, its first point filled."""
    time = time[: len(path)]  # the last steps may not be on the disk yet
    axes.plot(*path.T, linewidth=1.4, label=name, **style(number))
    axes.plot(*path[0], "o", color=f"C{number}", markersize=5)
    arrow = {"arrowstyle": "-|>", "color": f"C{number}", "linewidth": 0, "mutation_scale": 13}
    for share in ARROWS:
        ends = time[0] + np.ptp(time) * np.array([share - 0.004, share + 0.004])
        tail, head = np.column_stack([np.interp(ends, time, x) for x in path.T])
        if np.isfinite(tail).all():
            axes.annotate("", xy=head, xytext=tail, arrowprops=arrow)
