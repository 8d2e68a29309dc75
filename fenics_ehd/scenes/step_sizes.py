"""Step sizes of a machine that turns."""

from __future__ import annotations

import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.bdf import StepControl
from fenics_ehd.scenes.slider_crank_settings import Time


def step_sizes(settings: Time, speed: float, end: float) -> StepControl:
    """Step control of a run at a speed [rad/s] up to a time [s].

    Raises
    ------
    SettingsError
        The smallest step is not the smallest.
    """
    largest = float(np.radians(settings.largest_step)) / speed
    for name, value in (
        ("time.first_step", settings.first_step),
        ("time.largest_step", largest),
        ("the simulated time", end),
    ):
        if not settings.smallest_step < value:
            raise SettingsError(
                f"time.smallest_step = {settings.smallest_step:g} s must be below {name} = "
                f"{value:g} s"
            )
    return StepControl(
        settings.tolerance, settings.first_step, settings.smallest_step, largest, settings.order
    )
