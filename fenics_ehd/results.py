"""Files of a run: summary of a slider-crank, and the ParaView series of any machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.motion import crank_angles, read_motion
from fenics_ehd.output import versions
from fenics_ehd.plane import rotation
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.run import Totals
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.settings import unusual

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
        "warnings": unusual(settings),
        "scene": settings.scene,
        "method": body.method,
        "modes": body.modes,
        **totals.figures(),
        "rod_mass_kg": body.inertia.total_mass,
        "rod_centre_of_mass_m": float(body.inertia.centre_of_mass[0]),
        "rod_polar_inertia_kg_m2": body.inertia.polar_inertia,
        "frequencies_Hz": [float(f) for f in body.frequencies],
        "reduction_time_s": reduction_seconds,
        "wall_time_s": totals.wall_time,
        "versions": versions(),
    }


def bore_constants(body: ReducedBody) -> dict[str, np.ndarray]:
    """What a history holds once of a body, beside its steps."""
    return {"pressure_nodes_m": body.pressure_nodes, "bore_nodes_m": body.bore_nodes}


def write_run_series(
    settings: SliderCrankSettings, body: ReducedBody, part: PartFields, directory: Path, frames: int
) -> Path:
    """Write `frames` recorded steps, evenly spread over the run, to ``DIR/vtk``."""
    from fenics_ehd.paraview import write_series

    motion = read_motion(directory).nearest(frames)
    mechanism, angles = settings.mechanism, motion.columns["rod_angle_rad"]
    turned = crank_angles(motion, mechanism.crank_speed)
    pins = mechanism.crank_length * np.column_stack([np.cos(turned), np.sin(turned)])
    # The frame's origin, the bore centre, is C1 - A e.
    origins = [
        pin + rotation(angle) @ x[:2]
        for pin, angle, x in zip(pins, angles, motion.coordinates, strict=True)
    ]
    return write_series(
        directory / "vtk",
        "rod",
        part,
        body,
        motion.time,
        np.column_stack([origins, angles]),
        motion.coordinates[:, 2 : 2 + body.modes],
        motion.quasi_static,
        motion.pressure,
    )


def write_housing_series(body: ReducedBody, part: PartFields, directory: Path, frames: int) -> Path:
    """Write `frames` recorded steps of a rotor's housing, evenly spread, to ``DIR/vtk``."""
    from fenics_ehd.paraview import write_series

    motion = read_motion(directory).nearest(frames)
    # Behind the coordinates of the shaft come those of the housing.
    shaft = motion.coordinates.shape[1] - body.modes
    return write_series(
        directory / "vtk",
        "housing",
        part,
        body,
        motion.time,
        np.zeros((len(motion.time), 3)),
        motion.coordinates[:, shaft:],
        motion.quasi_static,
        motion.pressure,
    )
