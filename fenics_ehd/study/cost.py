"""What the tasks of a study take, roughly: for the estimate of the time left, and long ones first.

Seconds of processor time on the machine where the figures of docs/measurements.md were taken. Only
their ratios matter: the display learns the speed of the machine at hand.
"""

from __future__ import annotations

from typing import Any

#: Reduction by method [s], and per mode of those that compute many of them.
REDUCTION = {"m1": 2.0, "m2": 6.0, "m3": 3.0, "m4": 4.0, "full": 7.0, "rigid": 2.0}
PER_MODE = {"m1": 0.05, "m2": 0.1}

#: Steps of one revolution at a tolerance of 1e-5 by scene, and seconds for each of them.
STEPS = {"slider-crank": 500, "rotor": 1800}
STEP = {"slider-crank": 0.007, "rotor": 0.02}

#: How much longer a step takes with these methods, and per coordinate.
FACTOR = {"full": 6.0, "m4": 1.4}
PER_COORDINATE = 0.006

#: Pressure nodes of the default film.
NODES = 440


def reduction_cost(settings: Any) -> float:
    """Of the body that these settings need [s]."""
    reduction = settings.reduction
    return REDUCTION[reduction.method] + PER_MODE.get(reduction.method, 0.0) * reduction.modes


def run_cost(settings: Any) -> float:
    """Of a run [s]."""
    scene, time = settings.scene, settings.time
    turns = settings.shaft if scene == "rotor" else settings.mechanism
    at_default = STEPS[scene] * turns.revolutions
    steps = at_default * (time.tolerance / 1e-5) ** (-1.0 / (time.order + 1))
    steps *= 0.6 if time.order == 3 else 1.0
    around, along = settings.film.cells or (20, 5)
    nodes = 2 * around * (2 * along + 1) / NODES
    factor = FACTOR.get(settings.reduction.method, 1.0 + PER_COORDINATE * _modes(settings))
    return steps * STEP[scene] * factor * max(nodes, 0.3)


def _modes(settings: Any) -> int:
    reduction = settings.reduction
    if reduction.method in ("m1", "m2"):
        return reduction.modes
    return reduction.residual_modes + reduction.vibration_modes
