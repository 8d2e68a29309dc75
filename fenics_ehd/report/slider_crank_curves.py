"""What the reference of the slider-crank shows of its plateau, between 6 and 8 ms."""

from __future__ import annotations

import numpy as np

from fenics_ehd.report.curves import History
from fenics_ehd.report.needed import MissingRunsError, need, reference_history
from fenics_ehd.report.pressure_map import read_pressures
from fenics_ehd.report.statement import FAILS, HOLDS, Finding, verdict
from fenics_ehd.report.study_data import FILM, PRESSURE, Study

#: Plateau of the peak pressure [s].
PLATEAU = (6e-3, 8e-3)


def _plateau_of(study: Study) -> tuple[History, np.ndarray]:
    """History of the reference, and which of its steps lie on the plateau."""
    history = reference_history(study, until=PLATEAU[1])
    inside = (history["time_s"] >= PLATEAU[0]) & (history["time_s"] <= PLATEAU[1])
    need(list(history["time_s"][inside]), "steps of the reference between 6 and 8 ms")
    return history, inside


def plateau(study: Study) -> Finding:
    """Peak pressure and film of the reference between 6 and 8 ms."""
    history, inside = _plateau_of(study)
    pressure, film = history[PRESSURE.column][inside], history[FILM.column][inside]
    change, loss = np.ptp(pressure) / pressure.max(), 1 - film[-1] / film[0]
    falls = bool(np.mean(np.diff(film) < 0) > 0.95)
    words = (
        f"pressure {1e-6 * pressure.min():.1f} to {1e-6 * pressure.max():.1f} MPa "
        f"({100 * change:.0f} %), film {1e6 * film[0]:.2f} to {1e6 * film[-1]:.2f} µm "
        f"(-{100 * loss:.0f} %)"
    )
    return Finding(words, verdict([change <= 0.1, falls and loss >= 0.1]))


def peak_at_the_axis(study: Study) -> Finding:
    """Where on the bore the pressure is highest during the plateau."""
    history, inside = _plateau_of(study)
    angles = history["max_pressure_angle_deg"][inside]
    words = f"{angles.min():.0f} to {angles.max():.0f} degrees between 6 and 8 ms"
    return Finding(words, HOLDS if np.abs(angles).max() <= 15 else FAILS)


def smoother_flank(study: Study) -> Finding:
    """How far behind the peak, in the widening gap, the pressure has fallen to half."""
    reference_history(study, until=PLATEAU[1])
    fields = read_pressures(study)
    if fields is None or fields.time[-1] < PLATEAU[1]:
        raise MissingRunsError("pressure fields of the reference up to 8 ms")
    heights = fields.nodes[:, 2]
    ring = np.abs(heights - heights[np.abs(heights).argmin()]) < 1e-9
    order = np.argsort(fields.angle[ring])
    degrees = np.degrees(fields.angle[ring][order])
    flanks = []
    for time in PLATEAU:
        pressure = fields.at(time)[ring][order]
        peak = int(pressure.argmax())
        ahead = np.roll(pressure, -peak)
        step = int(np.argmax(ahead < 0.5 * ahead[0]))
        part = (ahead[step - 1] - 0.5 * ahead[0]) / (ahead[step - 1] - ahead[step])
        flanks.append((step - 1 + part) * 360 / len(degrees))
    words = f"half the peak {flanks[0]:.1f} degrees behind it at 6 ms, {flanks[1]:.1f} at 8 ms"
    return Finding(words, HOLDS if flanks[1] > 1.1 * flanks[0] else FAILS)
