"""Picture of a map of one rigid bearing: coefficients and stability over speed or load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.axes import Axes

from fenics_ehd.base.units import RPM
from fenics_ehd.plotting.picture import SETTINGS, WIDTH, legend, plt, save, style

#: Weight of a mass of 1 kg [N].
GRAVITY = 9.80665

#: Axis of a map by the column of the table: label with unit.
ALONG = {"frequency": "speed of the shaft [rad/s]", "load_N": "load [N]"}

#: Ratio of the largest to the smallest value above which an axis is logarithmic.
WIDE = 30.0


def plot_bearing_map(
    rows: Sequence[Mapping[str, float | None]], along: str, path: str | Path
) -> None:
    """Draw stiffness, damping, whirl ratio and critical mass over speed or load.

    Parameters
    ----------
    rows
        Rows of the map, see `BearingMap.rows`; at least one row.
    along
        Column of the horizontal axis: ``frequency`` or ``load_N``.
    path
        Path of the picture; its ending determines the format.
    """
    columns = {
        name: np.array([np.nan if row[name] is None else row[name] for row in rows], dtype=float)
        for name in rows[0]
    }
    x = columns[along]
    with plt.rc_context(SETTINGS):
        figure, axes = plt.subplots(
            2, 2, figsize=(1.4 * WIDTH, 0.95 * WIDTH), layout="constrained", sharex=True
        )
        _draw_entries(axes[0, 0], x, columns, "k", "stiffness [MN/m]", 1e-6)
        _draw_entries(axes[0, 1], x, columns, "c", "damping [kN s/m]", 1e-3)
        axes[1, 0].plot(x, columns["whirl_frequency_ratio"], marker=".", **style(0))
        axes[1, 0].set_ylabel("whirl ratio at the stability limit")
        axes[1, 0].set_ylim(0.0, max(0.6, axes[1, 0].get_ylim()[1]))
        _draw_critical_mass(axes[1, 1], x, columns)
        for lower in axes[1]:
            lower.set_xlabel(ALONG[along])
            if x.min() > 0 and x.max() > WIDE * x.min():
                lower.set_xscale("log")
        if along == "frequency":
            for upper in axes[0]:
                turns = upper.secondary_xaxis("top", functions=(_to_rpm, _from_rpm))
                turns.set_xlabel("[rpm]")
        save(figure, [path])


def _to_rpm(speed: np.ndarray) -> np.ndarray:
    """Convert speeds in rad/s to revolutions per minute."""
    return speed * RPM


def _from_rpm(turns: np.ndarray) -> np.ndarray:
    """Convert revolutions per minute to speeds in rad/s."""
    return turns / RPM


def _draw_entries(
    axes: Axes,
    x: np.ndarray,
    columns: Mapping[str, np.ndarray],
    letter: str,
    label: str,
    factor: float,
) -> None:
    """Draw the four entries of a matrix over `x`, times a factor.

    `letter` is the first letter of their columns, k in ``kxx``.
    """
    for number, entry in enumerate(("xx", "xy", "yx", "yy")):
        name = f"{letter}{entry}"
        axes.plot(x, factor * columns[name], label=name, marker=".", **style(number))
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    axes.set_ylabel(label)
    legend(axes)


def _draw_critical_mass(axes: Axes, x: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
    """Draw the critical mass per bearing, and the mass whose weight is the load."""
    mass = columns["critical_mass_kg"]
    weight = columns["load_N"] / GRAVITY
    label = "critical mass of a rigid rotor, per bearing"
    axes.plot(x, mass, label=label, marker=".", **style(0))
    axes.plot(x, weight, label="mass whose weight is the load", **style(1))
    positive = np.concatenate([mass, weight])
    positive = positive[np.isfinite(positive) & (positive > 0)]
    if positive.size and positive.max() > WIDE * positive.min():
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)
    if np.isnan(mass).any():
        axes.set_title("no critical mass: every mass is stable", fontsize=8.5, loc="left")
    axes.set_ylabel("mass [kg]")
    legend(axes)
