"""ParaView series of a finished slider-crank run, from its history."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from fenics_ehd.multibody.crank import ConstantSpeedCrank
from fenics_ehd.multibody.guide import rotation
from fenics_ehd.output import read_history
from fenics_ehd.paraview import PartFields, write_series
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings


def write_run_series(
    settings: SliderCrankSettings, body: ReducedBody, part: PartFields, directory: Path, frames: int
) -> Path:
    """Write `frames` recorded steps, evenly spread over the run, to ``DIR/vtk``."""
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
