"""Files of a slider-crank run: its summary, its history, its ParaView series."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from fenics_ehd.multibody.crank import ConstantSpeedCrank
from fenics_ehd.output import HistoryWriter, read_history, versions
from fenics_ehd.plane import rotation
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.run import Totals
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

if TYPE_CHECKING:
    from fenics_ehd.paraview import PartFields


def summarise(
    settings: SliderCrankSettings,
    body: ReducedBody,
    totals: Totals,
    status: str,
    reduction_seconds: float,
) -> dict[str, object]:
    """Figures of ``summary.json``."""
    return {
        "status": status,
        "scene": settings.scene,
        "method": body.method,
        "modes": body.modes,
        "max_pressure_Pa": float(totals.max_pressure),
        "max_pressure_time_s": totals.max_pressure_time,
        "min_film_thickness_m": float(totals.min_film_thickness),
        "min_film_thickness_time_s": totals.min_film_thickness_time,
        "basis_error_estimate_m": totals.basis_error,
        "energy_balance_error": totals.energy_error,
        "simulated_time_s": totals.time,
        "steps": totals.steps,
        "rejected_steps": totals.rejected_steps,
        "newton_iterations": totals.newton_iterations,
        "film_solves": totals.film_solves,
        "rod_mass_kg": body.inertia.total_mass,
        "rod_centre_of_mass_m": float(body.inertia.centre_of_mass[0]),
        "rod_polar_inertia_kg_m2": body.inertia.polar_inertia,
        "frequencies_Hz": [float(f) for f in body.frequencies],
        "reduction_time_s": reduction_seconds,
        "wall_time_s": totals.wall_time,
        "versions": versions(),
    }


def open_history(directory: str | Path, body: ReducedBody) -> HistoryWriter:
    """History files for a run of this body."""
    fields = {
        "coordinates": 2 + body.modes,
        "rates": 2 + body.modes,
        "pressure_Pa": len(body.pressure_nodes),
    }
    if body.residual is not None:
        fields["quasi_static"] = body.residual.rank
    return HistoryWriter(
        directory,
        fields=fields,
        constants={"pressure_nodes_m": body.pressure_nodes, "bore_nodes_m": body.bore_nodes},
    )


def write_run_series(
    settings: SliderCrankSettings, body: ReducedBody, part: PartFields, directory: Path, frames: int
) -> Path:
    """Write `frames` recorded steps, evenly spread over the run, to ``DIR/vtk``."""
    from fenics_ehd.paraview import write_series

    history = read_history(directory)
    times = history["time_s"]
    wanted = np.linspace(times[0], times[-1], frames)
    chosen = np.unique(np.abs(times[:, None] - wanted).argmin(axis=0))
    with h5py.File(directory / "history.h5", "r") as file:
        coordinates = file["coordinates"][()][chosen]
        pressures = file["pressure_Pa"][()][chosen]
    mechanism = settings.mechanism
    crank = ConstantSpeedCrank(mechanism.crank_length, mechanism.crank_speed)
    angles = history["rod_angle_rad"][chosen]
    # The frame's origin, the bore centre, is C1 - A e.
    origins = [
        crank.at(time).position + rotation(angle) @ x[:2]
        for time, angle, x in zip(times[chosen], angles, coordinates, strict=True)
    ]
    poses = np.column_stack([origins, angles])
    return write_series(
        directory / "vtk", part, body, times[chosen], poses, coordinates[:, 2:], pressures
    )
