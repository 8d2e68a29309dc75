"""Step sizes of a machine that turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.bdf import StepControl
from fenics_ehd.scenes.slider_crank_settings import Time

#: Damping ratio above which the formula of order 3 damps a mode at every step: it is A(82)-stable.
DAMPED = float(np.cos(np.radians(82.0)))


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


def with_stable_order(
    control: StepControl, frequencies: np.ndarray, damping_time: float
) -> StepControl:
    """Step control whose formula feeds no mode of a body.

    Order 3 feeds modes of little damping, by 5 to 10 % a step where a step is a radian of theirs:
    a full interface without damping was 71 % off (`docs/extremes.md`).

    Parameters
    ----------
    control
        As asked for.
    frequencies
        Of the body [Hz].
    damping_time
        zeta of ``D_e = zeta K_e`` [s]: a mode's damping ratio is zeta times half its frequency.
    """
    ratios = np.pi * frequencies * damping_time
    if control.order < 3 or ratios.min(initial=np.inf) >= DAMPED:
        return control
    return replace(control, order=2)
