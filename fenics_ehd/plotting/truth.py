"""How far a run may be trusted, as pictures: its energy balance and its basis error."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fenics_ehd.plotting.picture import FORMATS, plt, save

#: Columns of the works that a machine exchanges, and what they are called.
EXCHANGED = {"drive_work_J": "drive", "gas_work_J": "gas on the piston"}

#: The same of what is lost, by far smaller.
LOST = {
    "film_work_J": "film",
    "damping_work_J": "structural damping",
    "drag_work_J": "drag on the oil (gained)",
}


def plot_energy(
    history: Mapping[str, np.ndarray], directory: str | Path, formats: tuple[str, ...] = FORMATS
) -> list[Path]:
    """Stored energy against the works that change it, and the defect of their balance.

    Parameters
    ----------
    history
        Columns of a machine's ``history.csv``.
    directory
        Where ``energy`` goes, in each format.
    formats
        File formats.
    """
    time = 1e3 * history["time_s"]
    figure, panels = plt.subplots(
        3, figsize=(6.4, 7.2), layout="constrained", sharex=True, height_ratios=(3, 2, 2)
    )
    stored = history["kinetic_energy_J"] + history["strain_energy_J"]
    panels[0].plot(time, stored - stored[0], "k", label="kinetic and strain energy")
    for axes, works in zip(panels, (EXCHANGED, LOST), strict=False):
        for column, name in works.items():
            if column in history and np.any(history[column]):
                axes.plot(time, history[column], "--" if works is EXCHANGED else "-", label=name)
        axes.legend()
    panels[2].plot(time, history["energy_defect_J"], "k")
    panels[2].set(xlabel="time [ms]")
    for axes, label in zip(panels, ("energy, work [J]", "losses [J]", "defect [J]"), strict=True):
        axes.set(ylabel=label)
        axes.margins(x=0)
        axes.grid(alpha=0.3)
    return save(figure, [Path(directory) / f"energy.{suffix}" for suffix in formats])


def plot_basis_error(
    history: Mapping[str, np.ndarray], directory: str | Path, formats: tuple[str, ...] = FORMATS
) -> list[Path]:
    """Estimated error of the gap beside the film thickness; nothing where it was not computed.

    Parameters are those of `plot_energy`; the picture is ``basis_error``.
    """
    error = history["basis_error_estimate_m"]
    if not np.any(error > 0):
        return []
    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    time = 1e3 * history["time_s"]
    axes.semilogy(time, 1e6 * history["min_film_thickness_m"], label="minimum film thickness")
    axes.semilogy(time, 1e6 * error, label="estimated error of the gap")
    axes.set(xlabel="time [ms]", ylabel="[µm]")
    axes.margins(x=0)
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    return save(figure, [Path(directory) / f"basis_error.{suffix}" for suffix in formats])
