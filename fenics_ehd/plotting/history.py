"""Curves of runs over time: lubricated joints, energy balance, basis error."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.multibody.result import Result
from fenics_ehd.plotting.joint_rates import plot_joint_rates
from fenics_ehd.plotting.orbit import plot_orbits
from fenics_ehd.plotting.picture import in_formats, over_time, plt, save, style
from fenics_ehd.plotting.recorded import recorded
from fenics_ehd.results.load import load_results

#: Columns of the works that a mechanism exchanges, and what they are called.
EXCHANGED = {"drive_work_J": "drive", "applied_work_J": "applied forces"}

#: The same of what is lost, by far smaller.
LOST = {
    "film_work_J": "film",
    "damping_work_J": "structural damping",
    "drag_work_J": "drag on the oil (gained)",
}


def plot_joints(label: str, directory: str | Path) -> list[Path]:
    """Every picture of one run, in its own folder."""
    result = load_results(directory).last_cycle()
    joints = joint_columns({label: result})
    energies = result.run.columns | {"time_s": np.asarray(result.time)}
    return [
        *plot_runs({label: directory}, directory),
        *plot_energy(energies, directory),
        *(plot_basis_error(joints, directory) if joints else []),
        *plot_joint_rates(joints, directory),
    ]


def plot_runs(runs: Mapping[str, str | Path], directory: str | Path) -> list[Path]:
    """Curves and orbits of every lubricated joint of one or more runs.

    Parameters
    ----------
    runs
        Their folders by the name to show in the legend.
    directory
        Where the pictures go.

    Returns
    -------
    list of Path
        Those of `plot_history` and `plot_orbits`, none without a lubricated joint.

    Raises
    ------
    InputError
        A folder holds no history.
    """
    results = {label: load_results(folder).last_cycle() for label, folder in runs.items()}
    joints = joint_columns(results)
    if not joints:
        return []
    orbits: dict[str, np.ndarray] = {}
    for label, folder in runs.items():
        names = results[label].joints
        paths = _orbits(folder, results[label])
        orbits |= {legend(results, label, name): paths[name] for name in names if name in paths}
    return [*plot_history(joints, directory), *plot_orbits(joints, directory, orbits)]


def _orbits(directory: str | Path, result: Result) -> dict[str, np.ndarray]:
    """Of every lubricated joint by its name, over the clearance."""
    with suppress(SettingsError, InputError):  # a folder without scene or bodies
        run = recorded(directory, result)
        return {
            place.name: run.orbits[place.name] / place.film.film.parameters.clearance
            for place in run.system.films
        }
    return {}


def joint_columns(results: Mapping[str, Result]) -> dict[str, dict[str, np.ndarray]]:
    """Columns of every joint of runs, and their time, by what the legend says."""
    return {
        legend(results, label, name): joint.columns | {"time_s": np.asarray(result.time)}
        for label, result in results.items()
        for name, joint in result.joints.items()
    }


def legend(results: Mapping[str, Result], label: str, joint: str) -> str:
    """Name of a joint's curve: of the run, and of the joint where the run has several."""
    if len(results[label].joints) == 1:
        return label
    return joint if len(results) == 1 else f"{label}, {joint}"


def plot_history(
    histories: Mapping[str, Mapping[str, np.ndarray]],
    directory: str | Path,
) -> list[Path]:
    """Peak pressure and minimum film thickness against time.

    Parameters
    ----------
    histories
        Columns of lubricated joints by the name to show in the legend.
    directory
        Where the pictures go.

    Returns
    -------
    list of Path
        ``max_pressure`` and ``min_film_thickness`` in each of `FORMATS`.
    """
    panels = (
        ("max_pressure", "max_pressure_Pa", 1e-6, "maximum pressure [MPa]"),
        ("min_film_thickness", "min_film_thickness_m", 1e6, "minimum film thickness [µm]"),
    )
    written = []
    for name, column, factor, label in panels:
        figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
        for number, (legend, history) in enumerate(histories.items()):
            values = factor * history[column]
            axes.plot(1e3 * history["time_s"], values, label=legend, **style(number))
        over_time(axes, label)
        axes.set_ylim(0, None)
        written += save(figure, in_formats(directory, name))
    return written


def plot_energy(history: Mapping[str, np.ndarray], directory: str | Path) -> list[Path]:
    """Stored energy against the works that change it, and the defect of their balance.

    Parameters
    ----------
    history
        Energies and works of a run over ``time_s``.
    directory
        Where ``energy`` goes, in each of `FORMATS`.
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
    panels[2].plot(time, history["energy_defect_J"], "k", label="defect of the balance")
    for axes, label in zip(panels, ("energy, work [J]", "losses [J]", "defect [J]"), strict=True):
        over_time(axes, label)
    return save(figure, in_formats(directory, "energy"))


def plot_basis_error(
    joints: Mapping[str, Mapping[str, np.ndarray]],
    directory: str | Path,
) -> list[Path]:
    """Estimated error of the gap, dashed, beside the film thickness of joints by name.

    Other parameters are those of `plot_energy`; the picture is ``basis_error``, and there is none
    where no estimate was computed.
    """
    error, film = "basis_error_estimate_m", "min_film_thickness_m"
    known = {name: c for name, c in joints.items() if error in c and np.any(c[error] > 0)}
    if not known:
        return []
    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for number, (name, columns) in enumerate(known.items()):
        for column, line in ((film, "-"), (error, "--")):
            values = 1e6 * columns[column]
            axes.semilogy(1e3 * columns["time_s"], values, f"C{number}{line}", label=name)
            name = "estimated error of its gap"
    over_time(axes, "minimum film thickness [µm]")
    return save(figure, in_formats(directory, "basis_error"))
