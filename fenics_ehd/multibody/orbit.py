"""Parts of a journal's orbit at the speed of its shaft (1x) and at half of it (0.5x).

The orbit is the path of the journal's centre in a bore that does not turn, as a complex number
``z = x + i y``. With the angle theta of the shaft it is the sum of ellipses

    z = mean + sum over k of  f_k exp(i k theta) + b_k exp(-i k theta),    k = 1/2, 1, 3/2, ... 4.

The amplitude of a part is the larger half axis of its ellipse, ``|f_k| + |b_k|``. Its phase is the
angle of the part that whirls in the sense of rotation, ``arg f_k``, when the x axis of the shaft
points along the x axis of the bore: for 1x the angle of the high spot from the shaft's x axis. The
parts are fitted by least squares over the last two revolutions. A run with one revolution, or a
cycle of one, has no 0.5x part.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fenics_ehd.multibody.cycle import FIRST_STEP, Cycle
from fenics_ehd.multibody.film_binding import FilmBinding

#: Highest order of a fit, over the speed of the shaft.
HIGHEST = 4.0

#: Reported orders by the name in the summary.
PARTS = {"orbit_1x": 1.0, "orbit_0_5x": 0.5}

#: Largest change of the speed of a shaft, and of the speed of a bore at rest, over the mean speed.
STEADY = 0.01
AT_REST = 1e-6

#: Least number of steps per unknown of a fit.
STEPS_PER_UNKNOWN = 2


def orbit_figures(
    binding: FilmBinding, cycle: Cycle, columns: Mapping[str, np.ndarray]
) -> dict[str, float]:
    """Entries of ``summary.json``: amplitude [m] and phase [degrees] of the parts of an orbit.

    The result is empty if the journal does not turn steadily, if the bore turns, or if the cycle
    is shorter than a revolution.

    Parameters
    ----------
    binding, cycle, columns
        Film with its bodies, last complete cycle, and columns of all steps by path.
    """
    rows = cycle.rows(columns["time_s"]) if cycle.periodic else slice(None)
    bore, journal = (bound.body for bound in binding.surfaces)
    speed = columns.get(f"bodies/{journal}/speed_rad_per_s", np.zeros(1))[rows]
    mean = float(np.mean(speed)) if speed.size else 0.0
    bore_speed = columns.get(f"bodies/{bore}/speed_rad_per_s", np.zeros(1))
    if not mean or np.abs(bore_speed).max() > AT_REST * abs(mean):
        return {}
    angle = columns[f"bodies/{journal}/angle_rad"][rows]
    turned = abs(mean) * cycle.period if cycle.periodic else float(np.ptp(angle))
    turns = min(int(turned / (2 * np.pi) + FIRST_STEP), 2)
    last = np.abs(angle[-1] - angle) <= 2 * np.pi * turns * (1 + FIRST_STEP)
    if not turns or np.ptp(speed[last]) > STEADY * abs(mean):
        return {}
    x, y = (columns[f"joints/{binding.name}/eccentricity_{axis}_m"][rows] for axis in "xy")
    return orbit_parts(angle[last], x[last] + 1j * y[last], turns)


def orbit_parts(angle: np.ndarray, orbit: np.ndarray, turns: int) -> dict[str, float]:
    """Amplitude [m] and phase [degrees] of the parts of an orbit, see `orbit_figures`.

    Parameters
    ----------
    angle, orbit
        Angle of the shaft [rad], and position ``x + i y`` of the journal [m] at every step, shape
        (steps,).
    turns
        Number of revolutions of the steps, 1 or 2; 2 are needed for 0.5x.
    """
    orders = np.arange(1, HIGHEST * turns + 1) / turns
    exponents = np.concatenate([[0.0], orders, -orders])
    if len(angle) < STEPS_PER_UNKNOWN * len(exponents):
        return {}
    weights = np.sqrt(np.abs(np.gradient(angle)))
    matrix = np.exp(1j * np.outer(angle, exponents))
    solution = np.linalg.lstsq(weights[:, None] * matrix, weights * orbit, rcond=None)[0]
    parts = dict(zip(exponents.tolist(), solution, strict=True))
    figures: dict[str, float] = {}
    for name, order in PARTS.items():
        if order in parts:
            figures[f"{name}_amplitude_m"] = float(abs(parts[order]) + abs(parts[-order]))
            figures[f"{name}_phase_deg"] = float(np.degrees(np.angle(parts[order])))
    return figures
