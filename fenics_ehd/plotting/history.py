"""Plots of a run, after the paper's figures 5 to 8."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fenics_ehd.plotting.picture import FORMATS, plt, save

#: Typical safe film thickness of engine bearings, section 4.2 [um].
SAFE_FILM_THICKNESS = 2.5


def plot_machine(label: str, directory: str | Path) -> list[Path]:
    """Every picture of one run of a machine, in its own folder."""
    from fenics_ehd.output import read_history
    from fenics_ehd.plotting.truth import plot_basis_error, plot_energy

    history = read_history(directory)
    return [
        *plot_history({label: history}, directory),
        *plot_energy(history, directory),
        *plot_basis_error(history, directory),
    ]


def plot_joints(label: str, directory: str | Path) -> list[Path]:
    """Every picture of one run of a mechanism, the films of all its joints in one."""
    from fenics_ehd.output import read_history
    from fenics_ehd.plotting.truth import plot_energy

    history = read_history(directory)
    names = [name.rpartition(".")[0] for name in history if name.endswith("max_pressure_Pa")]
    joints = {
        name or label: {
            "time_s": history["time_s"],
            **{
                column: history[f"{name}.{column}" if name else column]
                for column in ("max_pressure_Pa", "min_film_thickness_m")
            },
        }
        for name in names
    }
    return [*(plot_history(joints, directory) if joints else []), *plot_energy(history, directory)]


def plot_runs(
    histories: Mapping[str, Mapping[str, np.ndarray]], directory: str | Path
) -> list[Path]:
    """Curves of runs once through, orbits of runs in cycles; arguments as of `plot_history`."""
    from fenics_ehd.plotting.orbit import plot_orbits

    orbits = {name: history for name, history in histories.items() if "cycle" in history}
    others = {name: history for name, history in histories.items() if name not in orbits}
    written = plot_history(others, directory) if others else []
    return written + (plot_orbits(orbits, directory) if orbits else [])


def plot_history(
    histories: Mapping[str, Mapping[str, np.ndarray]],
    directory: str | Path,
    formats: tuple[str, ...] = FORMATS,
) -> list[Path]:
    """Peak pressure and minimum film thickness against time.

    Parameters
    ----------
    histories
        Columns of ``history.csv`` by the name to show in the legend.
    directory
        Where the pictures go.
    formats
        File formats.

    Returns
    -------
    list of Path
        ``max_pressure`` and ``min_film_thickness`` in each format.
    """
    panels = (
        ("max_pressure", "max_pressure_Pa", 1e-6, "maximum pressure [MPa]"),
        ("min_film_thickness", "min_film_thickness_m", 1e6, "minimum film thickness [µm]"),
    )
    written = []
    for name, column, factor, label in panels:
        figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
        for legend, history in histories.items():
            axes.plot(1e3 * history["time_s"], factor * history[column], label=legend)
        if name == "min_film_thickness":
            axes.axhline(
                SAFE_FILM_THICKNESS,
                color="0.4",
                linestyle="--",
                linewidth=1,
                label=f"safe film, {SAFE_FILM_THICKNESS} µm",
            )
        axes.set(xlabel="time [ms]", ylabel=label, ylim=(0, None))
        axes.margins(x=0)
        axes.grid(alpha=0.3)
        axes.legend()
        written += save(figure, [Path(directory) / f"{name}.{suffix}" for suffix in formats])
    return written
