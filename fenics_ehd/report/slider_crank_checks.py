"""Measures of the slider-crank by which the paper's statements are judged."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from scipy import stats

from fenics_ehd.report.comparisons import (
    at_size,
    default_m3,
    m3_best,
    too_stiff,
)
from fenics_ehd.report.pressure_map import read_pressures
from fenics_ehd.report.statement import (
    FAILS,
    HOLDS,
    OPEN,
    PARTLY,
    WELL,
    Finding,
    MissingRunsError,
    listed,
    near,
    need,
    reference_history,
    runs_of,
    told,
    verdict,
)
from fenics_ehd.report.study_data import FILM, PRESSURE, Study
from fenics_ehd.report.style import family

#: Plateau of the peak pressure [s].
PLATEAU = (6e-3, 8e-3)

#: n_r + n_v + n_a of the paper's M3 with n_r = 31, and of M1 and M2 with 127 modes.
M3_SIZE, M2_SIZE = 39, 129

#: Residual modes of the paper's reference, and those that M1 and M2 with 127 modes stand beside.
RICH = (60, 61)

#: (31)-(32) as printed.
LITERAL = "smallest-eigenvalue"


def rich_reference(study: Study) -> Finding:
    """M3 with about 60 residual modes of unit pressures against the full interface."""
    runs = [
        run for run in study.pick(method="m3", pressure_set="pc1") if run.residual_modes in RICH
    ]
    need(runs, "M3 pc1 with 60 residual modes")
    best = min(run.worst_error for run in runs)
    return Finding("; ".join(map(told, runs)), HOLDS if best <= WELL else FAILS)


def plateau(study: Study) -> Finding:
    """Peak pressure and film of the reference between 6 and 8 ms."""
    history = reference_history(study)
    inside = (history["time_s"] >= PLATEAU[0]) & (history["time_s"] <= PLATEAU[1])
    need(list(history["time_s"][inside]), "a reference that reaches 8 ms")
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
    history = reference_history(study)
    inside = (history["time_s"] >= PLATEAU[0]) & (history["time_s"] <= PLATEAU[1])
    angles = history["max_pressure_angle_deg"][inside]
    need(list(angles), "a reference that reaches 8 ms")
    words = f"{angles.min():.0f} to {angles.max():.0f} degrees between 6 and 8 ms"
    return Finding(words, HOLDS if np.abs(angles).max() <= 15 else FAILS)


def smoother_flank(study: Study) -> Finding:
    """How far behind the peak, in the widening gap, the pressure has fallen to half."""
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


def m1_stiff(study: Study) -> Finding:
    """M1 at high loads, any number of coordinates."""
    return too_stiff(study, runs_of(study, "M1", method="m1"))


def m2_stiff(study: Study) -> Finding:
    """M2 with 127 modes at high loads."""
    runs = near(study.pick(method="m2"), M2_SIZE)[:1]
    return too_stiff(study, need(runs, f"M2 with about {M2_SIZE} coordinates"))


def enough_with_31(study: Study) -> Finding:
    """M3 with pressure shapes and 31 residual modes, the best of its selections."""
    runs = runs_of(
        study, "M3 pc2 with 31 residual modes", method="m3", pressure_set="pc2", residual_modes=31
    )
    best = min(run.worst_error for run in runs)
    return Finding("; ".join(map(told, runs)), HOLDS if best <= WELL else FAILS)


def literal_selection(study: Study) -> Finding:
    """Rule (31)-(32) to the letter against the other selections of the same number of modes."""
    wanted: dict[str, Any] = {"method": "m3", "pressure_set": "pc2", "residual_modes": 31}
    others = [run for run in study.pick(**wanted) if run.selection != LITERAL]
    best = min(
        need(others, "M3 pc2 with 31 residual modes, other selections"),
        key=lambda run: run.worst_error,
    )
    rest = "; ".join(map(told, others))
    literal = study.pick(**wanted, selection=LITERAL)
    if literal:
        good = literal[0].worst_error <= max(WELL, best.worst_error)
        return Finding(f"{told(literal[0])}; {rest}", HOLDS if good else FAILS)
    ended = [
        run
        for run in study.runs
        if run.selection == LITERAL and run.pressure_set == "pc2" and not run.complete
    ]
    failed = need(ended, "M3 pc2 with 31 residual modes, smallest eigenvalues")[0]
    return Finding(f"{family(failed)}: {failed.status}; {rest}", FAILS)


def quarter_of_m2(study: Study) -> Finding:
    """Coordinates that M2 needs for the error of M3 with 31 residual modes."""
    m3 = need(near(default_m3(study), M3_SIZE), "M3 pc2 with 31 residual modes")[0]
    runs = runs_of(study, "M2", method="m2")
    equal = [run for run in runs if run.worst_error <= m3.worst_error]
    if equal:
        ratio = equal[0].coordinates / m3.coordinates
        words = f"M2 as good with {equal[0].coordinates:.0f}: {ratio:.1f} times"
        return Finding(f"M3 {listed([m3])}; {words}", HOLDS if ratio > 4 else FAILS)
    ratio = runs[-1].coordinates / m3.coordinates
    words = f"M2 not as good yet with {listed(runs[-1:])}: above {ratio:.1f} times"
    return Finding(f"M3 {listed([m3])}; {words}", HOLDS if ratio >= 4 else OPEN)


def one_shape_is_not_enough(study: Study) -> Finding:
    """Long or short bearing shapes alone against both with as many modes."""
    alone = [
        run for name in ("pc2-long", "pc2-short") for run in study.pick(pressure_set=name)[-1:]
    ]
    size = max(run.coordinates for run in need(alone, "M3 with pc2-long or pc2-short"))
    within = [run for run in study.pick(pressure_set="pc2") if run.coordinates <= size]
    both = min(need(within, "M3 pc2 with as many modes"), key=lambda run: run.worst_error)
    words = "; ".join([*map(told, alone), f"both: {told(both)}"])
    return Finding(
        words, verdict(run.worst_error > max(WELL, 2 * both.worst_error) for run in alone)
    )


def time_grows(study: Study) -> Finding:
    """Rank correlation of integration time and number of coordinates."""
    runs = [run for run in study.pick() if run.method in ("m1", "m2", "m3")]
    sizes = {run.coordinates for run in runs}
    if len(sizes) < 3:
        raise MissingRunsError("M1, M2 and M3 with three numbers of coordinates")
    order, _ = stats.spearmanr([r.coordinates for r in runs], [r.online_s for r in runs])
    small, large = min(sizes), max(sizes)
    times = [np.mean([r.online_s for r in runs if r.coordinates == n]) for n in (small, large)]
    words = (
        f"rank correlation {order:.2f} over {len(runs)} runs; {times[0]:.1f} s with {small:.0f} "
        f"coordinates, {times[1]:.1f} s with {large:.0f}"
    )
    grows = times[1] > 1.5 * times[0]
    return Finding(words, HOLDS if order > 0.7 and grows else PARTLY if order > 0.3 else FAILS)


def m3_fastest(study: Study) -> Finding:
    """Whether for each run of M1 and M2 some run of M3 is as accurate in less time."""
    rivals = need([r for r in study.pick() if r.method in ("m1", "m2")], "M1 or M2")
    own = runs_of(study, "M3", method="m3")
    beaten, words = [], []
    for rival in rivals:
        better = [run for run in own if run.worst_error <= rival.worst_error]
        quickest = min(better, key=lambda run: run.online_s, default=None)
        beaten.append(quickest is not None and quickest.online_s < rival.online_s)
        time = "none" if quickest is None else f"{quickest.online_s:.1f} s"
        name = f"{rival.method.upper()} with {rival.coordinates:.0f}"
        words.append(f"{name} {rival.online_s:.1f} s, M3 {time}")
    return Finding("; ".join(words), verdict(beaten))


def independent_numbers(study: Study) -> Finding:
    """Vibration frequencies of M3's bodies with different numbers of residual modes."""
    bodies = [body for body in study.bodies if body.method == "m3"]
    pairs = [
        (one, two)
        for one, two in itertools.pairwise(bodies)
        if one.kinds.count("vibration") == two.kinds.count("vibration")
        and one.kinds.count("static") != two.kinds.count("static")
    ]
    need(pairs, "bodies of M3 with different numbers of residual modes")
    gaps = []
    for one, two in pairs:
        n = one.kinds.count("vibration")
        gaps.append(np.abs(two.frequencies[:n] / one.frequencies[:n] - 1).max())
    numbers = sorted({body.kinds.count("static") for pair in pairs for body in pair})
    words = (
        f"{pairs[0][0].kinds.count('vibration')} vibration modes beside "
        f"{', '.join(map(str, numbers))} static ones: frequencies equal to {max(*gaps, 1e-16):.0e}"
    )
    return Finding(words, HOLDS if max(gaps) < 1e-6 else FAILS)


def best_at_every_size(study: Study) -> Finding:
    """M3 against M1 and M2 wherever all three have equally many coordinates."""
    sizes = []
    for run in default_m3(study):
        try:
            at_size(study, run.coordinates)
        except MissingRunsError:
            continue
        sizes.append(run.coordinates)
    need(sizes, "M1, M2 and M3 with equally many coordinates")
    return m3_best(study, tuple(sizes))
