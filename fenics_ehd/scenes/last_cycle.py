"""Which recorded instants are a run's last cycle."""

from __future__ import annotations

import numpy as np

from fenics_ehd.scenes.scene import Scene


def last_cycle(scene: Scene, time: np.ndarray) -> tuple[slice, str]:
    """Rows of the last cycle, and what they are in words.

    Parameters
    ----------
    scene
        Of the run.
    time
        Of its steps, ascending [s]. A periodic run keeps those of its last cycle alone.
    """
    if scene.time.periodic:
        return slice(None), "the last cycle"
    if not scene.time.revolutions:
        return slice(None), "all of the run, which has no cycle"
    turn = 2 * np.pi / abs(scene.speed_of(scene.time.of))
    if time[-1] < turn * (1 - 1e-9):
        return slice(None), f"all of the run, less than a revolution of {scene.time.of}"
    first = int(np.searchsorted(time, time[-1] - turn * (1 + 1e-9)))
    return slice(first, None), f"the last revolution of {scene.time.of}"
